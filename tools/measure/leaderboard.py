# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Run all SLAM systems over the worlds of the catalogue and the recorded logs, and write the leaderboard.

    python -m tools.measure.leaderboard DIR [--systems odometry,karto] [--worlds office,lab] [--logs intel] [--seeds 5]
    python -m tools.measure.leaderboard DIR [the same words] --tables

Writes: docs/leaderboard.md (worlds), docs/leaderboard.md (places), docs/leaderboard.md (logs)

DIR holds a sweep over the logs with the systems that draw no random numbers, which get one seed there, one with the
others, and one sweep over each world, those with a short tour first. Worlds with a tour of more than 500 m get one
seed. The command goes on where it was stopped; Ctrl-C writes the tables of what there is, and so does --tables, which
computes nothing, also while another process computes. All systems and logs with five seeds take many hours. Logs are
read from $TESTBED_DATASETS, by default ../shared/datasets; those that are absent are left out. Of logs without
relations the published gMapping poses are the reference, which are some centimetres off themselves.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import worlds
from eval.files.tum import write_tum
from eval.sweep.results import SweepTable, SweepTableError, read_sweep
from eval.sweep.statistics import bootstrap_interval
from eval.sweep.systems_page import failures_text
from eval.trajectory.trajectory import Trajectory
from testbed.formats import open_log
from testbed.systems.entrant import entrant_of
from testbed.systems.finding import BUILT_IN, BUILT_IN_PROGRAMS
from testbed.toml import dump_toml
from tools.measure.real_logs import CASES
from tools.pages import DOCS, write_table

PAGE = DOCS / "leaderboard.md"
DRAW_NUMBERS = ("gmapping", "mrpt-rbpf")
"""Systems whose result depends on the seed: they get several seeds on each log."""
PARTICLES = 30
NOT_HERE = ("localization",)
"""Systems that do no SLAM."""


LONG_TOUR = 500.0
"""Worlds with a longer tour get one seed [m]: a drive takes half an hour and more."""


@dataclass(frozen=True)
class Part:
    """One of the sweeps."""

    name: str
    document: dict[str, Any]
    """Its specification."""

    def run(self, folder: Path, workers: int) -> int:
        """Compute what is missing; returns the exit status of `testbed sweep`."""
        spec = folder / f"{self.name}.toml"
        spec.write_text(dump_toml(self.document), encoding="utf-8")
        return _testbed("sweep", str(spec), "--out", str(folder / self.name), "--workers", str(workers), "--no-worst")

    def table(self, folder: Path) -> SweepTable | None:
        """Gather what was computed; None where nothing was."""
        if not (folder / self.name).is_dir():
            return None
        _testbed("gather", str(folder / self.name), "--no-worst")
        try:
            return read_sweep(folder / self.name)
        except SweepTableError as error:
            print(error)
            return None


def _testbed(*words: str) -> int:
    """Call the command line; returns its exit status."""
    return subprocess.run([str(Path(sys.executable).with_name("testbed")), *words], check=False).returncode


def parts(folder: Path, systems: Sequence[str], places: Sequence[str], logs: Sequence[str], seeds: int) -> list[Part]:
    """The sweeps of a leaderboard in their order; those without a system or place are left out."""
    found = []
    drawing = [system for system in systems if system in DRAW_NUMBERS]
    for name, own, count in (
        ("logs", [system for system in systems if system not in drawing], 1),
        ("logs-drawn", drawing, seeds),
    ):
        if own and logs:
            sources = [source_of(log, folder) for log in logs]
            found.append(Part(name, {"logs": sources, "seeds": count, **_systems(own)}))
    tours = {place: tour_length(place) for place in places}
    for place in sorted(places, key=lambda place: tours[place]):
        count = 1 if tours[place] > LONG_TOUR else seeds
        document = {"worlds": [place], "seeds": count, "settings": {"route": "random"}}
        found.append(Part(f"world-{place}", {**document, **_systems(systems)}))
    return found


def tour_length(place: str) -> float:
    """Length of the tour of a world of the catalogue [m]."""
    tour = worlds.load(place).tour
    assert tour is not None
    return float(np.hypot(*np.diff(np.array(tour.points), axis=0).T).sum())


def _systems(systems: Sequence[str]) -> dict[str, Any]:
    return {"axes": {"system": list(systems)}, "particles": [PARTICLES]}


def source_of(name: str, folder: Path) -> dict[str, str]:
    """The entry of a log in a specification. A reference whose stamps are rounded gets those of the nearest scans."""
    case = CASES[name]
    source = {"log": str(case.log.resolve())}
    if case.relations is not None and case.tolerance is None:
        return {**source, "relations": str(case.relations.resolve())}
    reference = folder / "references" / f"{name}{'.tum' if case.poses else '.relations'}"
    if not reference.exists():
        reference.parent.mkdir(parents=True, exist_ok=True)
        table = open_log(case.log).table
        scans = np.sort(table.stamps[table.scan_rows])
        if case.poses is not None:
            rows = np.loadtxt(case.poses)
            write_tum(reference, Trajectory(_nearest(scans, rows[:, 0]), rows[:, 1:4]))
        else:
            assert case.relations is not None
            rows = np.loadtxt(case.relations)
            rows[:, :2] = _nearest(scans, rows[:, :2])
            np.savetxt(reference, rows, fmt="%.6f")
    return {**source, "truth" if case.poses is not None else "relations": str(reference.resolve())}


def _nearest(stamps: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The nearest of increasing stamps (n,) to each wanted one."""
    after = np.clip(np.searchsorted(stamps, wanted), 1, len(stamps) - 1)
    before = stamps[after - 1]
    return np.where(wanted - before < stamps[after] - wanted, before, stamps[after])


def worlds_table(tables: Sequence[SweepTable]) -> str:
    """Failures, errors, maps and cost of each system, as Markdown, over the drives that all systems have done."""
    lines = [
        "| system | version | failed runs | trajectory error [cm] | map F1, within a cell | time per scan [ms] |",
        "|---|---|---|---|---|---|",
    ]
    done = [table.ran.all(axis=1) for table in tables]
    for k, line in enumerate(tables[0].lines):
        failed = _of_drives([table.failed[:, k] for table in tables], done)
        cost = [1e3 * (table.cube("wall_s") / table.cube("scans"))[:, k] for table in tables]
        cells = (
            failures_text(int(failed.sum()), len(failed)),
            _median(
                _of_drives([100.0 * table.cube("trajectory.ate_rmse_m")[:, k] for table in tables], done), "{:.1f}"
            ),
            _median(_of_drives([table.cube("map.f1_1_cells")[:, k] for table in tables], done), "{:.3f}"),
            _median(_of_drives(cost, done), "{:.1f}"),
        )
        lines.append(f"| {line} | {version_of(line)} | {' | '.join(cells)} |")
    drives = ", ".join(f"{table.places[0]} {int(there.sum())}" for table, there in zip(tables, done, strict=True))
    planned = sum(there.size for there in done)
    counted = sum(int(there.sum()) for there in done)
    share = "" if counted == planned else f" of {planned} that were begun"
    return "\n".join([*lines, "", f"{counted} drives{share}, which all systems did: {drives}. {tables[0].conditions}."])


def _of_drives(values: Sequence[np.ndarray], chosen: Sequence[np.ndarray]) -> np.ndarray:
    """The chosen of the values (places, counts, seeds) of several tables, one after another."""
    return np.concatenate([own[there] for own, there in zip(values, chosen, strict=True)])


def places_table(tables: Sequence[SweepTable]) -> str:
    """Median error and failures of each system in each world, as Markdown; a row for each world."""
    systems = tables[0].lines
    lines = [f"| world | {' | '.join(systems)} |", f"|---|{'---|' * len(systems)}"]
    for table in tables:
        errors = 100.0 * table.cube("trajectory.ate_rmse_m")
        cells = [_cell(errors[0, k], table.failed[0, k], table.ran[0, k], "{:.1f} cm") for k in range(len(systems))]
        lines.append(f"| {table.places[0]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def logs_table(tables: Sequence[SweepTable]) -> str:
    """Error of each system on each log, as Markdown: median over the seeds, failures, range."""
    places = list(dict.fromkeys(place for table in tables for place in table.places))
    lines = [
        f"| system | version | failed runs | {' | '.join(places)} | time per scan [ms] |",
        f"|---|---|---|{'---|' * len(places)}---|",
    ]
    for table in tables:
        cost = 1e3 * table.cube("wall_s") / table.cube("scans")
        relations, truth = table.cube("relations.trans_mean_m"), table.cube("trajectory.ate_rmse_m")
        errors = np.where(np.isfinite(relations), relations, truth)
        for k, line in enumerate(table.lines):
            cells = ["–"] * len(places)
            for p, place in enumerate(table.places):
                cells[places.index(place)] = _cell(errors[p, k], table.failed[p, k], table.ran[p, k], "{:.3f} m")
            failures = failures_text(int(table.failed[:, k].sum()), int(table.ran[:, k].sum()))
            told = [line, version_of(line), failures, *cells, _median(cost[:, k], "{:.1f}")]
            lines.append(f"| {' | '.join(told)} |")
    return "\n".join(lines)


def _cell(errors: np.ndarray, failed: np.ndarray, ran: np.ndarray, shape: str) -> str:
    """Median and range of the errors of some runs, and how many of them failed; shape: of a number with its unit."""
    known, count = errors[np.isfinite(errors)], int(ran.sum())
    if not count:
        return "not run"
    text = shape.format(np.median(known)) if len(known) else "no result"
    if len(known) > 1:
        low, high = (shape.split(maxsplit=1)[0].format(value) for value in (known.min(), known.max()))
        text += f" ({low} to {high})"
    lost = int(failed[ran].sum())
    return text + (f", {lost} of {count} failed" if lost else f", {count} runs" if count > 1 else "")


def _median(values: np.ndarray, shape: str) -> str:
    """A median with its 95 % interval."""
    found = bootstrap_interval(values.ravel(), np.median)
    if not found.count:
        return "–"
    text = shape.format(found.value)
    return text if np.isnan(found.low) else f"{text} ({shape.format(found.low)} to {shape.format(found.high)})"


def version_of(line: str) -> str:
    """Version of a system of the package; empty where it cannot be made here."""
    try:
        return str(entrant_of(line).facts()["version"])
    except ValueError:
        return ""


def main() -> None:
    """Compute what is missing and write the tables of what there is."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="DIR")
    parser.add_argument("--systems", help="default: all that are installed")
    parser.add_argument("--worlds", help="default: the catalogue; none")
    parser.add_argument("--logs", help="default: all that are there; none")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--tables", action="store_true", help="compute nothing, write the tables of what there is")
    options = parser.parse_args()
    installed = [
        name for name, entry in (BUILT_IN | BUILT_IN_PROGRAMS).items() if entry.is_installed and name not in NOT_HERE
    ]
    systems = _words(options.systems) or installed
    places = [] if options.worlds == "none" else _words(options.worlds) or sorted(worlds.catalogue())
    there = [name for name, case in CASES.items() if case.log.is_file()]
    logs = [] if options.logs == "none" else _words(options.logs) or there
    options.out.mkdir(parents=True, exist_ok=True)
    wanted = parts(options.out, systems, places, logs, options.seeds)
    try:
        for part in [] if options.tables else wanted:
            part.run(options.out, options.workers)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on")
    tables = {part.name: table for part in wanted if (table := part.table(options.out)) is not None}
    words = ["DIR" if word == str(options.out) else word for word in sys.argv[1:] if word != "--tables"]
    command = f"`python -m tools.measure.leaderboard {shlex.join(words)}`"
    if of_worlds := [table for name, table in tables.items() if name.startswith("world-")]:
        write_table(PAGE, "worlds", f"{worlds_table(of_worlds)}\n\n{command}")
        write_table(PAGE, "places", places_table(of_worlds))
    if of_logs := [tables[name] for name in ("logs", "logs-drawn") if name in tables]:
        write_table(PAGE, "logs", f"{logs_table(of_logs)}\n\n{command}")


def _words(text: str | None) -> list[str]:
    return [word.strip() for word in (text or "").split(",") if word.strip()]


if __name__ == "__main__":
    main()
