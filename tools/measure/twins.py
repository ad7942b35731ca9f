# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Compare recorded logs with their twins: odometry, failures and errors of the filter, over seeds.

    python -m tools.measure.twins DIR [--studies aces-10,intel-1] [--seeds 20]

Writes: docs/twins.md (twins), docs/twins.md (wheels)

Prints: one line for each run; with --print the tables, too, and writes nothing

DIR/LOG/run is a run of `testbed slam`, DIR/LOG/twin the twin that `testbed twin` makes of it, DIR/LOG/drives its drives
by `testbed simulate`, one for each seed. DIR/runs.csv has a row for each run of the filter; the command goes on where
it was stopped. A directory that is removed is made anew; rows of a twin that has changed are not used again.

Log and twin are mapped with the same settings and seeds and scored in the same way, by the mean error of relations: of
the hand-checked ones of the log, and of those between the twin's true poses at the same pairs of times. ACES has no
relations: all pairs of every eighth published gMapping pose stand in. Relations of logs are themselves some centimetres
off, those of twins are not. The filter on a log is therefore also scored by the path that the twin was made from, which
is the twin's truth. The logs are read from $TESTBED_DATASETS, by default ../shared/datasets.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import math
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.files.tum import read_tum
from eval.sweep.statistics import bootstrap_interval, min_values, wilson_interval
from eval.sweep.systems_page import failures_text
from eval.trajectory.relations import EXACT, Relations, read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from slam import FilterConfig, se2
from slam.se2 import Pose
from testbed.estimation.estimation import Estimation
from testbed.formats import Log, open_log
from testbed.presets import load_robot
from testbed.seeds import RunSeeds
from testbed.simulation.config import CONTROL_PERIOD
from testbed.twin.reconstruction import read_reconstruction
from tools.measure.real_logs import CASES, settings
from tools.pages import DOCS, write_table

PAGE = DOCS / "twins.md"
MAPPED_BY = {"aces": 10, "intel": 2, "fr079": 2}
"""Particles of the run that the twin is made from: its final path is as accurate as with more."""
RESAMPLES = 4000
"""Bootstrap resamples of a difference."""


@dataclass(frozen=True)
class Study:
    """Settings with which a log and its twin are mapped."""

    log: str
    particles: int
    seeds: int = 20

    @property
    def config(self) -> FilterConfig:
        """The settings."""
        return settings([], self.particles)

    @property
    def words(self) -> str:
        """What is changed, for the table."""
        return f"{self.particles} particle{'' if self.particles == 1 else 's'}"


STUDIES = {
    "aces-3": Study("aces", 3),
    "aces-10": Study("aces", 10),
    "intel-1": Study("intel", 1),
    "fr079-1": Study("fr079", 1),
}
"""Particle counts and settings with which the filter can fail: with 30 particles it hardly ever does."""


APART = 8
"""Where there are no relations, every so many published poses make up the pairs."""
FAILED = {"aces": 0.5, "intel": 0.1, "fr079": 0.1}
"""Mean error of the relations above which the final result of a run counts as failed [m]."""
DRIVES = 5
"""Drives of each twin whose odometry is compared with that of the log."""
REFINED = 3
"""The final pass, which costs as much as the filter, is carried out for so many seeds."""
LENGTHS = (0.3, 1.0, 3.0, 10.0, 30.0)
"""Lengths of way, where a radian counts as a metre, over which the odometry is compared [m]."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One run of the filter; errors are mean errors of the relations [m]."""

    study: str
    source: str
    """`log`, or the digest of the twin."""
    seed: int
    own: float
    """Error of the filter's own path."""
    own_by_path: float
    """The same by the relations of the path that the twin was made from; of a twin, whose truth that is, equal to
    `own`."""
    refined: float
    """Error after the final pass; NaN where there was none."""
    odometry: float
    """Error of the odometry."""
    updates: int
    matched: float
    """Mean share of the hits that the matcher found near a wall."""
    seconds: float
    """Processor time."""


class Source:
    """A log with its twin."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder = name, folder / name

    @cached_property
    def log(self) -> Log:
        """The recording."""
        return open_log(CASES[self.name].log)

    @cached_property
    def relations(self) -> Relations:
        """The relations of the log whose stamps it has, or those between its published poses."""
        case = CASES[self.name]
        if case.poses is not None:
            rows = np.loadtxt(case.poses)[::APART]
            one, two = np.triu_indices(len(rows), 1)
            published = Relations(rows[one, 0], rows[two, 0], se2.between(rows[one, 1:4], rows[two, 1:4]))
            return there(published, self.log.table.stamps)
        assert case.relations is not None
        return there(read_relations(case.relations), self.log.table.stamps)

    @cached_property
    def by_path(self) -> Relations:
        """The relations of the path that the twin is made from, at the times of those of the log."""
        dense = read_tum(self.folder / "run" / "estimate_dense.tum")
        path = Trajectory(self.log.table.stamps, dense.poses)
        return relations_at(path, self.relations.first, self.relations.second, EXACT)

    def make(self, seeds: int) -> None:
        """Map the log, make its twin, and drive it with so many seeds, as far as that has not been done."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if not (self.folder / "run").exists():
            options = ("--particles", str(MAPPED_BY[self.name]), "--seed", "0", "--threads", "1")
            testbed("slam", str(CASES[self.name].log), *options, "--out", str(self.folder / "run"))
        if not (self.folder / "twin").exists():
            testbed("twin", str(self.folder / "run"), "--out", str(self.folder / "twin"))
        config, count = self.folder / "twin" / "config.toml", str(seeds)
        testbed("simulate", "--config", str(config), "--count", count, "--format", "parquet", "--out", str(self.drives))

    @cached_property
    def digest(self) -> str:
        """What the twin is made of, in a few letters."""
        files = sorted((self.folder / "twin").iterdir())
        return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:8]

    @property
    def drives(self) -> Path:
        """Directory of the drives of this twin."""
        return self.folder / f"drives-{self.digest}"

    def drive(self, seed: int) -> Log:
        """The twin's drive with the noise of a seed."""
        (path,) = self.drives.glob(f"*-{seed:04d}")
        return open_log(path)

    def relations_of(self, drive: Log) -> Relations:
        """The relations of the true poses at the same moments of the drive."""
        begin = float(self.log.table.stamps[0])
        truth = Trajectory(drive.table.stamps, self.true_path(drive.table.truth))
        return relations_at(truth, self.relations.first - begin, self.relations.second - begin, CONTROL_PERIOD)

    def true_path(self, truth: Pose) -> Pose:
        """True poses (n, 3) of the point that estimates from scans mean, of those of the robot's centre.

        Where the lidar sits elsewhere than the log states, these are two points; relations of logs are from scans, too.
        """
        offset = load_robot(str(self.folder / "twin" / "robot.toml")).lidar_mount.offset_x
        return se2.compose(truth, np.array([offset, 0.0, 0.0]))


def testbed(*arguments: str) -> None:
    """Run the command line, as a reader would; raises CalledProcessError where it fails."""
    subprocess.run([str(Path(sys.executable).with_name("testbed")), *arguments], check=True, stdout=subprocess.DEVNULL)


def there(relations: Relations, stamps: NDArray[np.float64]) -> Relations:
    """Those relations of which both stamps are among the stamps (n,)."""
    known = np.ones(len(relations), dtype=np.bool_)
    for times in (relations.first, relations.second):
        known &= np.abs(stamps[nearest_rows(stamps, times)] - times) <= EXACT
    return Relations(relations.first[known], relations.second[known], relations.poses[known])


def relations_at(
    path: Trajectory, first: NDArray[np.float64], second: NDArray[np.float64], tolerance: float
) -> Relations:
    """Relations of a path between its stamps that are nearest to pairs of times (k,) [s], within the tolerance."""
    one, two = nearest_rows(path.stamps, first), nearest_rows(path.stamps, second)
    off = np.maximum(np.abs(path.stamps[one] - first), np.abs(path.stamps[two] - second))
    one, two = one[off <= tolerance], two[off <= tolerance]
    return Relations(path.stamps[one], path.stamps[two], se2.between(path.poses[one], path.poses[two]))


def nearest_rows(stamps: NDArray[np.float64], times: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index of the stamp (n,), in any order, that is nearest to each time (k,); the first of equal ones."""
    unique, rows = np.unique(stamps, return_index=True)
    after = np.clip(np.searchsorted(unique, times), 0, len(unique) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.where(np.abs(times - unique[before]) < np.abs(unique[after] - times), before, after)
    found: NDArray[np.intp] = rows[nearer]
    return found


def mean_error(path: Trajectory, relations: Relations) -> float:
    """Mean error of the relations [m]."""
    return relation_error(path, relations).all.translation.mean


def run(name: str, source: str, seed: int, drive: Log, relations: Relations, by_path: Relations) -> Row:
    """Map a log or a drive once and score it by its relations, and by those of the path that the twin was made from."""
    begin = time.process_time()
    estimation = Estimation(STUDIES[name].config, RunSeeds.from_seed(seed).filter, threads=1)
    for frame in drive.frames:
        estimation.process(frame)
    own = estimation.filtered()
    refined = mean_error(estimation.refined(own).dense, relations) if seed < REFINED else math.nan
    seconds = time.process_time() - begin
    steps = estimation.steps.columns()
    return Row(
        study=name,
        source=source,
        seed=seed,
        own=mean_error(own.dense, relations),
        own_by_path=mean_error(own.dense, by_path),
        refined=refined,
        odometry=mean_error(Trajectory(own.dense.stamps, estimation.odometry), relations),
        updates=int(steps["updated"].sum()),
        matched=float(np.nanmean(steps["matched_share"])),
        seconds=seconds,
    )


def read_rows(file: Path) -> list[Row]:
    """The rows of finished runs."""
    if not file.is_file():
        return []
    kinds = {field.name: {"str": str, "int": int, "float": float}[str(field.type)] for field in fields(Row)}
    with file.open(newline="", encoding="utf-8") as lines:
        return [Row(**{name: kinds[name](value) for name, value in line.items()}) for line in csv.DictReader(lines)]


def add_row(file: Path, row: Row) -> None:
    """Append the row of a finished run."""
    new = not file.is_file()
    with file.open("a", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, [field.name for field in fields(Row)])
        if new:
            writer.writeheader()
        writer.writerow(asdict(row))


def carry_out(folder: Path, name: str, source: Source, seeds: int | None) -> list[Row]:
    """Carry out the missing runs of a study; returns all its rows, of the log and of the twin as it is now."""
    file, wanted, seeds = folder / "runs.csv", [], STUDIES[name].seeds if seeds is None else seeds
    source.make(max(seeds, DRIVES))
    rows = {(row.study, row.source, row.seed): row for row in read_rows(file)}
    for seed in range(seeds):
        for kind in ("log", source.digest):
            key = (name, kind, seed)
            if key not in rows:
                drive = source.log if kind == "log" else source.drive(seed)
                relations = source.relations if kind == "log" else source.relations_of(drive)
                rows[key] = run(*key, drive, relations, source.by_path if kind == "log" else relations)
                add_row(file, rows[key])
                print(rows[key], flush=True)
            wanted.append(rows[key])
    return wanted


def odometry_errors(odometry: Pose, path: Pose, length: float) -> tuple[float, float]:
    """Median error of the odometry (n, 3) over ways of a length on the path (n, 3): position [m] and heading [deg].

    The way is that of the odometry, where a radian counts as a metre; only pairs of poses count that are at most half
    as long again apart.
    """
    steps, true_steps = se2.between(odometry[:-1], odometry[1:]), se2.between(path[:-1], path[1:])
    way = np.append(0.0, np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + np.abs(steps[:, 2])))
    heading = np.append(0.0, np.cumsum(steps[:, 2] - true_steps[:, 2]))
    end = np.searchsorted(way, way + length)
    begin = np.flatnonzero(end < len(way))
    begin = begin[way[end[begin]] - way[begin] < 1.5 * length]
    end = end[begin]
    if not len(begin):
        return math.nan, math.nan
    off = se2.between(path[begin], path[end])[:, :2] - se2.between(odometry[begin], odometry[end])[:, :2]
    return float(np.median(np.hypot(*off.T))), float(np.degrees(np.median(np.abs(heading[end] - heading[begin]))))


def difference_of_medians(values: Sequence[float], others: Sequence[float]) -> tuple[float, float, float]:
    """Median of values (n,) minus that of others (m,), with its 95 % interval by the bootstrap of both."""
    rng, a, b = np.random.default_rng(0), np.asarray(values), np.asarray(others)
    drawn = [np.median(x[rng.integers(0, len(x), (RESAMPLES, len(x)))], axis=1) for x in (a, b)]
    low, high = np.quantile(drawn[0] - drawn[1], [0.025, 0.975])
    return float(np.median(a) - np.median(b)), float(low), float(high)


def difference_of_rates(failed: int, runs: int, failed_others: int, others: int) -> tuple[float, float, float]:
    """Share of failures minus that of others, with its 95 % interval.

    Source: Newcombe, "Interval estimation for the difference between independent proportions", Statistics in Medicine
    17(8), 1998, method 10.
    """
    p, q = failed / runs, failed_others / others
    (low, high), (other_low, other_high) = wilson_interval(failed, runs), wilson_interval(failed_others, others)
    return p - q, p - q - math.hypot(p - low, other_high - q), p - q + math.hypot(high - p, q - other_low)


def table_of_runs(rows: Sequence[Row]) -> str:
    """Two tables, a line for each study: failures of logs and twins, and their errors."""
    failures = ["| log | filter | above the bound: log | above the bound: twin | difference |"]
    errors = [
        "| log | filter | log, by its relations | log, by its path | twin | twin minus log, by its path | final pass: "
        "log | final pass: twin |"
    ]
    for lines in (failures, errors):
        lines.append("|---" * (lines[0].count("|") - 1) + "|")
    for name in dict.fromkeys(row.study for row in rows):
        log, twin = ([r for r in rows if r.study == name and (r.source == "log") == is_log] for is_log in (True, False))
        limit = FAILED[STUDIES[name].log]
        failed, failed_twin = (sum(r.own_by_path > limit for r in part) for part in (log, twin))
        rate = difference_of_rates(failed_twin, len(twin), failed, len(log))
        by_path, of_twin = [r.own_by_path for r in log], [r.own for r in twin]
        refined = [np.nanmedian([r.refined for r in part]) for part in (log, twin)]
        study = [STUDIES[name].log, STUDIES[name].words]
        cells = [failures_text(failed, len(log)), failures_text(failed_twin, len(twin))]
        cells.append("{:+.0f} % [{:+.0f}, {:+.0f}]".format(*(100.0 * value for value in rate)))
        failures.append("| " + " | ".join([*study, *cells]) + " |")
        cells = [median_text(values) for values in ([r.own for r in log], by_path, of_twin)]
        difference = [100.0 * value for value in difference_of_medians(of_twin, by_path)]
        enough = min(len(log), len(twin)) >= min_values()
        cells.append(("{:+.1f} cm [{:+.1f}, {:+.1f}]" if enough else "{:+.1f} cm").format(*difference))
        cells += [f"{100.0 * value:.1f} cm" for value in refined]
        errors.append("| " + " | ".join([*study, *cells]) + " |")
    return "\n".join([*failures, "", *errors])


def median_text(errors: Sequence[float]) -> str:
    """The median of errors [m] with its interval, in centimetres."""
    found = bootstrap_interval(errors, np.median)
    if found.count < min_values():
        return f"{100.0 * found.value:.1f} cm"
    return f"{100.0 * found.value:.1f} cm [{100.0 * found.low:.1f}, {100.0 * found.high:.1f}]"


def table_of_odometry(sources: Sequence[Source], drives: int) -> str:
    """Errors of the odometry over ways of several lengths, of logs and of the first drives of their twins."""
    lines = ["| | " + " | ".join(f"{length:g} m" for length in LENGTHS) + " |", "|---" * (1 + len(LENGTHS)) + "|"]
    for source in sources:
        found = read_reconstruction(source.folder / "run")
        errors = {"log": [[odometry_errors(found.odometry, found.path, length) for length in LENGTHS]], "twin": []}
        for seed in range(drives):
            table = source.drive(seed).table
            poses = source.true_path(table.truth)[table.scan_rows]
            odometry = table.odometry[table.scan_rows]
            errors["twin"].append([odometry_errors(odometry, poses, length) for length in LENGTHS])
        for kind, drawn in errors.items():
            cells = [
                f"{100.0 * d:.1f} cm, {t:.1f}°" if math.isfinite(d) else ""
                for d, t in np.median(drawn, axis=0).tolist()
            ]
            lines.append(f"| {source.name}, {kind} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Carry out the missing runs, then write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="directory of runs, twins and drives")
    parser.add_argument("--studies", default=",".join(STUDIES), help="settings of the filter, of: %(default)s")
    parser.add_argument("--seeds", type=int, help="seeds of each study; default: as many as the page has")
    parser.add_argument("--print", action="store_true", help="print the tables and write nothing")
    args = parser.parse_args()
    names = args.studies.split(",")
    sources = {name: Source(name, args.folder) for name in dict.fromkeys(STUDIES[study].log for study in names)}
    rows = [row for name in names for row in carry_out(args.folder, name, sources[STUDIES[name].log], args.seeds)]
    tables = {"twins": table_of_runs(rows), "wheels": table_of_odometry(list(sources.values()), DRIVES)}
    for name, table in tables.items():
        if args.print:
            print(table)
        else:
            write_table(PAGE, name, table)


if __name__ == "__main__":
    main()
