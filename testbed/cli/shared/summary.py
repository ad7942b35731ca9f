# SPDX-License-Identifier: MIT
"""The figures of a run that matter most, as a table for the terminal."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from eval.files.failure_json import read_failure
from eval.files.run_reader import read_steps
from eval.files.tum import read_tum
from eval.filter.closing_loop import ClosingLoop, deaths_in_words, largest_closing_loop, longer_in_words
from eval.filter.step_table import column
from eval.first_failure import Failure
from eval.loss_watch import spells
from eval.mended import Mended, find_mended
from eval.report.bent_map import behind_failure, bent_before, cause_in_short, times_of_failure
from eval.report.check_story import self_check_sentence
from eval.wording import at_time, up_to_a_tenth
from testbed.views import recording_of

HEADLINES = (
    (("localization.error_median_m",), "error in the map's frame, median", "{:.3f} m"),
    (("localization.found_after_m",), "found after driving", "{:.1f} m"),
    (("trajectory.heading_rmse_deg",), "heading error", "{:.2f} deg"),
    (("trajectory.odometry.ate_rmse_m",), "odometry's error (ATE)", "{:.3f} m"),
    (("relations.trans_mean_m", "relations.trans_std_m"), "relations, translation", "{:.4f} ± {:.4f} m"),
    (("relations.rot_mean_deg",), "relations, rotation", "{:.3f} deg"),
    (("relations.pairs",), "relations, pairs", "{}"),
    (("map.walls_within_cell_rate",), "walls within a cell of the true ones", "{:.1%}"),
    (("map.missing_wall_rate",), "walls missing", "{:.1%}"),
    (("map.double_wall_rate",), "walls double", "{:.1%}"),
    (("map.wall_thickness_m", "map.true_wall_thickness_m"), "wall thickness (true)", "{:.3f} m ({:.3f} m)"),
    (("map.wall_distance_subcell_m",), "wall distance", "{:.4f} m"),
    (("filter.resamplings",), "resamplings", "{}"),
    (("realtime_factor",), "speed", "{:.1f} x real time"),
)
"""Keys in metrics.json, words, format of their values."""
MAX_CAUSE = 160
"""Of a longer cause the terminal prints what stands before its colon [characters]."""
MAX_STRETCHES = 3
"""Of more times in which the pose while driving was off the truth the terminal prints the number."""


def headline_table(metrics: Mapping[str, Any], run: Path | None = None) -> Table:
    """Make the table: the outcome, its reason unless it is `ok`, and the figures that these metrics have.

    run: the directory of the run, which names the moment at which it went wrong and the cause

    Raises ValueError for damaged files in it.
    """
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(no_wrap=True)  # in a narrow terminal only the reason takes several lines
    table.add_column(overflow="fold")
    mended = None if run is None else find_mended(metrics, run)
    table.add_row("outcome", f"{metrics['outcome']}{'' if mended is None else ' (the final path)'}")
    reason = metrics.get("outcome_reason") or metrics.get("reason")
    if metrics["outcome"] != "ok" and reason:
        table.add_row("reason", f"{reason}")
    found = _failure_of(metrics, run)
    if found is not None:
        failure, stamps = found
        assert run is not None  # that the failure was read from
        start = float(stamps[0])
        cause = cause_in_short(failure, bent_before(read_steps(run / "steps.parquet"), failure, start))
        back = "" if failure.back is None else ", when it came back"
        table.add_row("went wrong", f"{times_of_failure(failure, start)}{back}{f': {cause}' if cause else ''}")
        behind = _behind_failure(failure, stamps, run)
        if behind:
            table.add_row("behind it", behind)
    if mended is not None:
        for words, text in _mended_rows(mended):
            table.add_row(words, text)
    elif _value(metrics, "outcome_online") not in (None, metrics["outcome"], "unjudged"):
        table.add_row("outcome while driving", f"{_value(metrics, 'outcome_online')}")
    loop = _largest_loop(run)
    if loop is not None:
        table.add_row("largest loop", _loop_in_words(*loop, told=None if mended is None else mended.stamp))
    if _value(metrics, "self_check.verdict") is not None:
        # its time is that of what the filter saw itself, not the moment of the loss
        table.add_row("self-check, without truth", self_check_sentence(metrics["self_check"], run))
    for words, error in _trajectory_errors(metrics):
        table.add_row(words, f"{error:.3f} m")
    for keys, words, number_format in HEADLINES:
        values = [_value(metrics, key) for key in keys]
        if None not in values:
            table.add_row(words, number_format.format(*values))
    return table


def watch_command(metrics: Mapping[str, Any], run: Path) -> str | None:
    """Name the moment of a run that is most worth watching, with the command that shows it: where it went wrong, also
    where the final pass has mended that, else its largest loop; None where it has neither, or no recording.

    Raises ValueError for damaged files in its directory.
    """
    if recording_of(run) is None:
        return None
    found, loop, time = _failure_of(metrics, run), _largest_loop(run), None
    mended = find_mended(metrics, run)
    if found is not None:
        what, time = "where it went wrong", found[0].time_to_watch(found[1])
    elif mended is not None:
        what, time = f"where it went wrong {mended.which}", mended.time_to_watch
    elif loop is not None:
        when = "" if loop[0].most_died is None else ", as particles die"
        what, time = f"the largest loop{when}", up_to_a_tenth(loop[0].to_watch - loop[1])
    return None if time is None else f"watch {what}: testbed view {shlex.quote(str(run))} --time {time:.1f}"


def _mended_rows(mended: Mended) -> Iterator[tuple[str, str]]:
    """Say what was wrong before the final pass: the outcome, the moment, and all times that the pose was off."""
    driving, start = mended.driving, mended.start
    evidence = "" if driving is None else f": {driving.evidence}"
    yield mended.which, f"{mended.outcome}, mended by the final pass{evidence}"
    if driving is None:
        yield f"went wrong {mended.which}", f"at {at_time(mended.stamp - start)}: {mended.cause}"
        return
    most, *others = driving.stretches
    largest = driving.largest_in_words(most, start)
    yield (
        f"went wrong {mended.which}",
        f"at {at_time(mended.stamp - start)}: {_short(mended.cause)}. {largest[0].upper()}{largest[1:]}, "
        f"{driving.back_in_words(most, start)}. {driving.part_in_words(most)} come from there",
    )
    if driving.behind:
        yield "behind it", driving.behind
    order = ", most harm first" if len(others) > 1 else ""
    for number, stretch in enumerate(others[:MAX_STRETCHES]):  # causes are left to the report
        yield (
            f"also off the truth{order}" if number == 0 else "",
            f"from {driving.times_in_words(stretch, start)}, {driving.largest_in_words(stretch, start)}; "
            f"{driving.part_in_words(stretch)}",
        )
    if len(others) > MAX_STRETCHES:
        yield "", f"and {len(others) - MAX_STRETCHES} more times, see the report"


def _short(cause: str) -> str:
    """A cause, of a long one what stands before its colon."""
    return cause if len(cause) <= MAX_CAUSE else cause.split(":", maxsplit=1)[0]


def _largest_loop(run: Path | None) -> tuple[ClosingLoop, float] | None:
    """The largest loop that closed before the estimate was lost, and the stamp of the first scan [s]; None where none
    was seen."""
    steps = None if run is None else read_steps(run / "steps.parquet")
    if steps is None:
        return None
    lost = spells(steps, "lost")
    loop = largest_closing_loop(steps, lost[0].start if lost else np.inf)
    return None if loop is None else (loop, float(column(steps, "stamp")[0]))


def _loop_in_words(loop: ClosingLoop, start: float, told: float | None) -> str:
    """Describe the largest loop, since a start [s]; told: the stamp of the moment that stands in another row."""
    deaths, longer = deaths_in_words(loop, told), longer_in_words(loop, start)
    deaths = f"; {deaths}" if deaths else ""
    longer = f" ({longer})" if longer else ""
    return f"at {at_time(loop.to_watch - start)}: {loop.metres:.0f} m of driving{deaths}{longer}"


def _failure_of(metrics: Mapping[str, Any], run: Path | None) -> tuple[Failure, NDArray[np.float64]] | None:
    """The failure that a run was judged by, and the stamps (n,) of its scans [s]; None where there is none."""
    if run is None or metrics["outcome"] not in ("lost", "broken loop"):
        return None
    finding, estimate = run / "finding.json", run / "estimate.tum"
    if not (finding.is_file() and estimate.is_file()):
        return None
    failure, stamps = read_failure(finding).failure, read_tum(estimate).stamps
    return (failure, stamps) if failure.bad and len(stamps) else None


def _behind_failure(failure: Failure, stamps: NDArray[np.float64], run: Path) -> str:
    """Say what had gone wrong before a failure, from the files of its run; stamps (n,) of its scans [s]."""
    odometry, truth = (read_tum(path) if path.is_file() else None for path in (run / "odometry.tum", run / "truth.tum"))
    return behind_failure(failure, float(stamps[0]), read_steps(run / "steps.parquet"), odometry, truth)


def _trajectory_errors(metrics: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
    """Name the path that each error is of; a trajectory that was scored by itself has no name."""
    groups = {"trajectory_filter": ", the filter's own path", "trajectory_online": ", while driving"}
    if metrics.get("refined"):
        groups = {"trajectory": ", after the final pass", **groups}
    elif _value(metrics, "trajectory_filter.ate_rmse_m") is None:
        groups = {"trajectory": "", **groups}
    for group, which in groups.items():
        error = _value(metrics, f"{group}.ate_rmse_m")
        if error is not None:
            yield f"trajectory error (ATE){which}", error


def _value(metrics: Mapping[str, Any], key: str) -> Any:
    """The value of a key with dots; None where it is missing."""
    value: Any = metrics
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value
