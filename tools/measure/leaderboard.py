# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Run all SLAM systems over the worlds of the catalogue and the recorded logs, and write the leaderboard.

    python -m tools.measure.leaderboard DIR [--systems odometry,karto] [--worlds office,lab] [--logs intel] [--seeds 5]
    python -m tools.measure.leaderboard DIR [the same words] --tables

Writes: docs/leaderboard.md (worlds), docs/leaderboard.md (places), docs/leaderboard.md (logs)

DIR holds sweeps over the logs, with one seed for the systems that draw no random numbers, and sweeps over each world,
those with a short tour first. Systems of this package have sweeps of their own: another version of it computes only
those anew (remove their directories, which end in -own). The tables name the commit of each. Worlds with a tour of more
than 500 m get one seed. The command goes on where it was stopped; Ctrl-C writes the tables of what there is, and so
does --tables, which computes nothing, also while another process computes. All systems and logs with five seeds take
many hours. Logs are read from $TESTBED_DATASETS, by default ../shared/datasets; those that are absent are left out. Of
logs without relations the published gMapping poses are the reference, which are some centimetres off themselves.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
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
OWN = ("gmapping", "scan-matching")
"""Systems that another version of this package changes."""
NOT_HERE = ("localization",)
"""Systems that do no SLAM."""


SAME_DRIVE = 1e-6
"""The odometry errs by the same in all runs of a drive, up to this [m]."""
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
    groups = {"": [one for one in systems if one not in OWN], "-own": [one for one in systems if one in OWN]}
    for suffix, group in groups.items():
        drawing = [system for system in group if system in DRAW_NUMBERS]
        for name, chosen, count in (
            (f"logs{suffix}", [system for system in group if system not in drawing], 1),
            (f"logs-drawn{suffix}", drawing, seeds),
        ):
            if chosen and logs:
                sources = [source_of(log, folder) for log in logs]
                found.append(Part(name, {"logs": sources, "seeds": count, **_systems(chosen)}))
    tours = {place: tour_length(place) for place in places}
    for place in sorted(places, key=lambda place: tours[place]):
        count = 1 if tours[place] > LONG_TOUR else seeds
        document = {"worlds": [place], "seeds": count, "settings": {"route": "random"}}
        found += [
            Part(f"world-{place}{suffix}", {**document, **_systems(group)}) for suffix, group in groups.items() if group
        ]
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


@dataclass(frozen=True)
class WorldRuns:
    """What the sweeps over one world hold; arrays (systems, seeds), NaN where a run lacks the figure."""

    world: str
    commits: dict[str, str]
    """Commit of the sweep of each system, in the order of the rows."""
    conditions: str
    ran: np.ndarray
    failed: np.ndarray
    error: np.ndarray
    """Trajectory error [m]."""
    map_f1: np.ndarray
    cost: np.ndarray
    """CPU time per scan [ms]: other work on the machine makes it no longer."""

    @property
    def systems(self) -> list[str]:
        """The systems in the order of the rows."""
        return list(self.commits)


def world_runs(tables: Sequence[SweepTable]) -> WorldRuns:
    """Put the sweeps over one world together, those of systems of this package first.

    Raises ValueError where they did not see the same drives: then the odometry errs otherwise.
    """
    tables = sorted(tables, key=lambda table: table.lines[0] not in OWN)
    seeds = max(table.ran.shape[-1] for table in tables)

    def rows(of: Callable[[SweepTable], np.ndarray], missing: float) -> np.ndarray:
        own = [of(table)[0, :, 0] for table in tables]
        return np.concatenate(
            [np.pad(one.astype(float), ((0, 0), (0, seeds - one.shape[1])), constant_values=missing) for one in own]
        )

    wheels = rows(lambda table: table.cube("trajectory.odometry.ate_rmse_m"), np.nan)
    apart = np.array([np.ptp(column[np.isfinite(column)]) if np.isfinite(column).any() else 0.0 for column in wheels.T])
    if (apart > SAME_DRIVE).any():
        raise ValueError(f"{tables[0].places[0]}: the sweeps are of different drives, expected the same of each seed")
    return WorldRuns(
        world=tables[0].places[0],
        commits={line: table.commit for table in tables for line in table.lines},
        conditions=tables[0].conditions,
        ran=rows(lambda table: table.ran, 0.0) > 0.0,
        failed=rows(lambda table: table.failed, 0.0) > 0.0,
        error=rows(lambda table: table.cube("trajectory.ate_rmse_m"), np.nan),
        map_f1=rows(lambda table: table.cube("map.f1_1_cells"), np.nan),
        cost=1e3 * rows(lambda table: table.cube("cpu_s") / table.cube("scans"), np.nan),
    )


def worlds_table(worlds_done: Sequence[WorldRuns]) -> str:
    """Failures, errors, maps and cost of each system, as Markdown, over the drives that all systems have done."""
    lines = [
        "| system | version | failed runs | trajectory error [cm] | map F1, within a cell | CPU time per scan [ms] |",
        "|---|---|---|---|---|---|",
    ]
    done = [world.ran.all(axis=0) for world in worlds_done]
    for k, system in enumerate(worlds_done[0].systems):

        def of_drives(name: str, k: int = k) -> np.ndarray:
            values = [getattr(world, name)[k, there] for world, there in zip(worlds_done, done, strict=True)]
            return np.concatenate(values)

        failed = of_drives("failed")
        cells = (
            failures_text(int(failed.sum()), len(failed)),
            _median(100.0 * of_drives("error"), "{:.1f}"),
            _median(of_drives("map_f1"), "{:.3f}"),
            _median(of_drives("cost"), "{:.1f}"),
        )
        lines.append(f"| {system} | {version_of(system)} | {' | '.join(cells)} |")
    drives = ", ".join(f"{world.world} {int(there.sum())}" for world, there in zip(worlds_done, done, strict=True))
    planned, counted = sum(there.size for there in done), sum(int(there.sum()) for there in done)
    share = "" if counted == planned else f" of {planned} that were begun"
    about = f"{counted} drives{share}, which all systems did: {drives}. {worlds_done[0].conditions}."
    return "\n".join([*lines, "", f"{about} {computed_with(worlds_done)}"])


def computed_with(worlds_done: Sequence[WorldRuns]) -> str:
    """Which version of this package drove and scored which systems, as a sentence."""
    systems: dict[str, list[str]] = {}
    for world in worlds_done:
        for system, commit in world.commits.items():
            named = systems.setdefault(commit, [])
            named += [] if system in named else [system]
    return "Computed with " + "; ".join(f"{commit}: {', '.join(named)}" for commit, named in systems.items()) + "."


def places_table(worlds_done: Sequence[WorldRuns]) -> str:
    """Median error and failures of each system in each world, as Markdown; a row for each world."""
    systems = worlds_done[0].systems
    lines = [f"| world | {' | '.join(systems)} |", f"|---|{'---|' * len(systems)}"]
    for world in worlds_done:
        rows = zip(100.0 * world.error, world.failed, world.ran, strict=True)
        lines.append(f"| {world.world} | {' | '.join(_cell(*row, '{:.1f} cm') for row in rows)} |")
    return "\n".join(lines)


def logs_table(tables: Sequence[SweepTable]) -> str:
    """Error of each system on each log, as Markdown: median over the seeds, failures, range."""
    places = list(dict.fromkeys(place for table in tables for place in table.places))
    lines = [
        f"| system | version | failed runs | {' | '.join(places)} | CPU time per scan [ms] |",
        f"|---|---|---|{'---|' * len(places)}---|",
    ]
    for table in tables:
        cost = 1e3 * table.cube("cpu_s") / table.cube("scans")
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
    of_worlds = [
        world_runs(found)
        for place in dict.fromkeys(name.removesuffix("-own") for name in tables if name.startswith("world-"))
        if len(found := [tables[name] for name in (place, f"{place}-own") if name in tables]) == 1 + _has_both(systems)
    ]
    if of_worlds:
        write_table(PAGE, "worlds", f"{worlds_table(of_worlds)}\n\n{command}")
        write_table(PAGE, "places", places_table(of_worlds))
    if of_logs := [table for name, table in tables.items() if name.startswith("logs")]:
        write_table(PAGE, "logs", f"{logs_table(of_logs)}\n\n{command}")


def _has_both(systems: Sequence[str]) -> bool:
    """Whether there are systems of this package and others: then a world counts once both have been run."""
    return 0 < sum(system in OWN for system in systems) < len(systems)


def _words(text: str | None) -> list[str]:
    return [word.strip() for word in (text or "").split(",") if word.strip()]


if __name__ == "__main__":
    main()
