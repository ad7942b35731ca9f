# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Run all SLAM systems over the worlds of the catalogue and the recorded logs, and write the leaderboard.

    python -m tools.measure.leaderboard DIR [--systems odometry,karto] [--worlds office,lab] [--logs intel] [--seeds 5]

Writes: docs/leaderboard.md (worlds), docs/leaderboard.md (logs)

DIR holds a sweep over the worlds, one over the logs with the systems that draw random numbers, and one with the others,
which get one seed there. The command goes on where it was stopped; Ctrl-C writes the tables of what there is. All
systems and logs with five seeds take some hours. Logs are read from $TESTBED_DATASETS, by default ../shared/datasets;
those that are absent are left out. Of logs without relations the published gMapping poses are the reference, which are
some centimetres off themselves.
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
        testbed = str(Path(sys.executable).with_name("testbed"))
        command = ["sweep", str(spec), "--out", str(folder / self.name), "--workers", str(workers), "--no-worst"]
        return subprocess.run([testbed, *command], check=False).returncode


def parts(folder: Path, systems: Sequence[str], places: Sequence[str], logs: Sequence[str], seeds: int) -> list[Part]:
    """The sweeps of a leaderboard; those without a system or place are left out."""
    found = []
    if places:
        document = {"worlds": list(places), "seeds": seeds, "settings": {"route": "random"}}
        found.append(Part("worlds", {**document, **_systems(systems)}))
    drawing = [system for system in systems if system in DRAW_NUMBERS]
    for name, own, count in (
        ("logs-drawn", drawing, seeds),
        ("logs", [system for system in systems if system not in drawing], 1),
    ):
        if own and logs:
            sources = [source_of(log, folder) for log in logs]
            found.append(Part(name, {"logs": sources, "seeds": count, **_systems(own)}))
    return found


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


def worlds_table(table: SweepTable) -> str:
    """Failures, errors, maps and cost of each system over all worlds, as Markdown."""
    lines = [
        "| system | version | failed runs | trajectory error [cm] | map F1, within a cell | time per scan [ms] |",
        "|---|---|---|---|---|---|",
    ]
    errors = 100.0 * table.cube("trajectory.ate_rmse_m")
    maps, cost = table.cube("map.f1_1_cells"), 1e3 * table.cube("wall_s") / table.cube("scans")
    for k, line in enumerate(table.lines):
        failed, ran = int(table.failed[:, k].sum()), int(table.ran[:, k].sum())
        cells = (
            failures_text(failed, ran),
            _median(errors[:, k], "{:.1f}"),
            _median(maps[:, k], "{:.3f}"),
            _median(cost[:, k], "{:.1f}"),
        )
        lines.append(f"| {line} | {version_of(line)} | {' | '.join(cells)} |")
    names = ", ".join(table.places)
    return "\n".join(
        [*lines, "", f"{len(table.places)} worlds ({names}), {len(table.seeds)} seeds. {table.conditions}."]
    )


def logs_table(tables: Sequence[SweepTable]) -> str:
    """Error of each system on each log, as Markdown: median over the seeds, failures, range."""
    places = list(dict.fromkeys(place for table in tables for place in table.places))
    lines = [
        f"| system | version | {' | '.join(places)} | time per scan [ms] |",
        f"|---|---|{'---|' * len(places)}---|",
    ]
    for table in tables:
        cost = 1e3 * table.cube("wall_s") / table.cube("scans")
        for k, line in enumerate(table.lines):
            cells = [
                _log_cell(table, table.places.index(place), k) if place in table.places else "–" for place in places
            ]
            lines.append(f"| {line} | {version_of(line)} | {' | '.join(cells)} | {_median(cost[:, k], '{:.1f}')} |")
    return "\n".join(lines)


def _log_cell(table: SweepTable, p: int, k: int) -> str:
    relations, truth = table.cube("relations.trans_mean_m")[p, k], table.cube("trajectory.ate_rmse_m")[p, k]
    errors = np.where(np.isfinite(relations), relations, truth)
    known = errors[np.isfinite(errors)]
    failed, ran = int(table.failed[p, k].sum()), int(table.ran[p, k].sum())
    if not len(known):
        return "no result" if ran else "not run"
    text = f"{np.median(known):.3f} m"
    text += f" ({known.min():.3f} to {known.max():.3f})" if len(known) > 1 else ""
    return text + (f", {failed} of {ran} failed" if failed else "")


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
        for part in wanted:
            part.run(options.out, options.workers)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on")
    tables: dict[str, SweepTable] = {}
    for part in wanted:
        try:
            tables[part.name] = read_sweep(options.out / part.name)
        except SweepTableError as error:
            print(error)
    words = ["DIR" if word == str(options.out) else word for word in sys.argv[1:]]
    command = f"`python -m tools.measure.leaderboard {shlex.join(words)}`"
    if "worlds" in tables:
        write_table(PAGE, "worlds", f"{worlds_table(tables['worlds'])}\n\n{command}")
    if of_logs := [tables[name] for name in ("logs", "logs-drawn") if name in tables]:
        write_table(PAGE, "logs", f"{logs_table(of_logs)}\n\n{command}")


def _words(text: str | None) -> list[str]:
    return [word.strip() for word in (text or "").split(",") if word.strip()]


if __name__ == "__main__":
    main()
