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
from eval.files.tum import read_tum
from eval.first_failure import Failure
from eval.report.check_story import self_check_sentence
from eval.wording import at_time
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


def headline_table(metrics: Mapping[str, Any], run: Path | None = None) -> Table:
    """Make the table: the outcome, its reason unless it is `ok`, and the figures that these metrics have.

    run: the directory of the run, which names the moment at which it went wrong and the cause

    Raises ValueError for damaged files in it.
    """
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(no_wrap=True)  # in a narrow terminal only the reason takes several lines
    table.add_column(overflow="fold")
    table.add_row("outcome", f"{metrics['outcome']}")
    reason = metrics.get("outcome_reason") or metrics.get("reason")
    if metrics["outcome"] != "ok" and reason:
        table.add_row("reason", f"{reason}")
    found = _failure_of(metrics, run)
    if found is not None:
        failure, stamps = found
        cause = f": {failure.cause.split(':')[0]}" if failure.cause else ""
        table.add_row("went wrong", f"at {at_time(failure.stamp - stamps[0])}{cause}")
    while_driving = _value(metrics, "outcome_online")
    if while_driving not in (None, metrics["outcome"], "unjudged"):
        table.add_row("outcome while driving", f"{while_driving}")
    if _value(metrics, "self_check.verdict") is not None:
        # its time is that of what the filter saw itself, not the moment of the loss
        table.add_row("self-check, without truth", self_check_sentence(metrics["self_check"]))
    for words, error in _trajectory_errors(metrics):
        table.add_row(words, f"{error:.3f} m")
    for keys, words, number_format in HEADLINES:
        values = [_value(metrics, key) for key in keys]
        if None not in values:
            table.add_row(words, number_format.format(*values))
    return table


def watch_command(metrics: Mapping[str, Any], run: Path) -> str | None:
    """The command that shows where a run went wrong; None where it did not, or where it has no recording.

    Raises ValueError for damaged files in its directory.
    """
    found = _failure_of(metrics, run)
    time = None if found is None else found[0].time_to_watch(found[1])
    if time is None or recording_of(run) is None:
        return None
    return f"testbed view {shlex.quote(str(run))} --time {time:.1f}"


def _failure_of(metrics: Mapping[str, Any], run: Path | None) -> tuple[Failure, NDArray[np.float64]] | None:
    """The failure that a run was judged by, and the stamps (n,) of its scans [s]; None where there is none."""
    if run is None or metrics["outcome"] not in ("lost", "broken loop"):
        return None
    finding, estimate = run / "finding.json", run / "estimate.tum"
    if not (finding.is_file() and estimate.is_file()):
        return None
    failure, stamps = read_failure(finding).failure, read_tum(estimate).stamps
    return (failure, stamps) if failure.bad and len(stamps) else None


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
