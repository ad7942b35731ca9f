# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Compare the rules of `eval.outcome` with labels that a person gave to runs.

    python -m tools.measure.check_outcomes            # prints the table and the cases that were misjudged
    python -m tools.measure.check_outcomes --write    # also writes the table into docs/metrics.md

Writes: docs/metrics.md (outcomes)

Simulated and recorded runs were labelled from their figures, some also from pictures of their maps. Copies of good
estimates are damaged on purpose, and labelled by the damage. Runs are kept in --runs and computed only once. Recorded
logs are read from $TESTBED_DATASETS, by default ../shared/datasets; estimates of other systems from the directory
`peers` next to it. Takes about five minutes.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eval.files.tum import read_tum
from eval.outcome import Outcome, evidence_from_relations, evidence_from_truth, judge
from eval.trajectory.association import associate, covered_share
from eval.trajectory.relations import read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from slam.se2 import between, compose
from tools.pages import DOCS, write_table

ROOT = Path(__file__).resolve().parents[2]
DATASETS = Path(os.environ.get("TESTBED_DATASETS") or ROOT.parent / "shared" / "datasets")
BLIND = ("--filter.proposal.kind", "motion", "--no-refine")
"""FastSLAM 1 with few particles: the path is odometry with some luck."""
POOR = ("--odometry.grade", "poor")


@dataclass(frozen=True)
class Run:
    """A run of this testbed and the label that a person gave it."""

    label: str
    seen: str
    """Description of its map, as a person saw it."""
    arguments: tuple[str, ...]

    @property
    def name(self) -> str:
        """Directory of the run."""
        words = [Path(word).name.split(".")[0] if "/" in word else word.lstrip("-") for word in self.arguments]
        return "_".join(word for word in words if word not in ("run", "slam", "relations"))


def simulated(label: str, seen: str, world: str, *options: str) -> Run:
    """A run in a simulated world, by the fast backend."""
    return Run(label, seen, ("run", world, "--backend", "fast", *options))


def recorded(label: str, seen: str, log: str, relations: str, *options: str) -> Run:
    """A run on a recorded log that has relations."""
    return Run(label, seen, ("slam", str(DATASETS / log), "--relations", str(DATASETS / relations), *options))


GOOD = "as the truth"
SIMULATED = (
    simulated("ok", GOOD, "office"),
    simulated("ok", GOOD, "apartment"),
    simulated("ok", GOOD, "cave", "--particles", "15"),
    simulated("ok", GOOD, "loop", "--particles", "15"),
    simulated("ok", GOOD, "museum", "--particles", "10"),
    simulated("ok", GOOD, "symmetric", "--particles", "10"),
    simulated("ok", GOOD, "long_corridor", "--particles", "10"),
    simulated("ok", GOOD, "warehouse", "--particles", "10"),
    simulated("ok", GOOD, "lab", "--particles", "10"),
    simulated("ok", GOOD, "office", "--duration", "25"),
    simulated("ok", GOOD, "office", "--particles", "1", *POOR),
    simulated("ok", GOOD, "maze", "--particles", "1", *POOR),
    simulated("drift", "in one piece, but a metre too long", "courtyard", "--particles", "5"),
    simulated("lost", "walls out of reach, then 0.7 m off at once", "hall", "--particles", "10"),
    simulated("broken loop", "door frames stand twice", "long_corridor", "--particles", "1", *POOR),
    simulated("broken loop", "walls stand twice", "office", "--particles", "10", *BLIND),
    simulated("broken loop", "the ring does not close", "loop", "--particles", "5", *POOR, *BLIND),
    simulated("broken loop", "the rings do not close", "nested_loops", "--particles", "3", *POOR, *BLIND),
)
INTEL = ("intel/intel-merged.clf.gz", "intel/intel-resolved.relations")
FR079 = ("fr079/fr079-merged.clf.gz", "fr079/fr079.relations")
RECORDED = (
    recorded("ok", "straight corridors, single walls", *INTEL, "--particles", "10"),
    recorded("broken loop", "corridors lie across each other", *INTEL, "--particles", "5", *BLIND),
    recorded("ok", "straight corridors, single walls", *FR079, "--particles", "15"),
    recorded("lost", "no room can be recognised", *FR079, "--particles", "10", *BLIND),
)
PEERS = (
    ("ok", "intel_gmapping_30_seed1", INTEL[1]),
    ("ok", "intel_gmapping_15_seed1", INTEL[1]),
    ("ok", "intel_gmapping_5_seed2", INTEL[1]),
    ("ok", "intel_karto", INTEL[1]),
    ("broken loop", "intel_gmapping_5_seed1", INTEL[1]),
    ("lost", "fr079_gmapping_15_seed1", FR079[1]),
)


# --- estimates that are damaged on purpose


def moved_from(share: float, by: tuple[float, float, float]) -> Callable[[Trajectory], Trajectory]:
    """Move all poses after a share of the path by a motion in the robot's frame (x, y, theta) [m, m, rad]."""

    def broken(estimate: Trajectory) -> Trajectory:
        row, poses = int(share * len(estimate)), estimate.poses.copy()
        poses[row:] = compose(compose(poses[row], by), between(poses[row], poses[row:]))
        return Trajectory(estimate.stamps, poses)

    return broken


def heading_bias(estimate: Trajectory, degrees_per_metre: float = 0.3) -> Trajectory:
    """Turn each motion a little too far."""
    poses = estimate.poses
    steps = between(poses[:-1], poses[1:])
    steps[:, 2] += np.radians(degrees_per_metre) * np.hypot(steps[:, 0], steps[:, 1])
    turned = [poses[0]]
    for step in steps:
        turned.append(compose(turned[-1], step))
    return Trajectory(estimate.stamps, np.array(turned))


def frozen(estimate: Trajectory) -> Trajectory:
    """Stop after three fifths of the time."""
    row, poses = int(0.6 * len(estimate)), estimate.poses.copy()
    poses[row:] = poses[row]
    return Trajectory(estimate.stamps, poses)


def cut_off(estimate: Trajectory) -> Trajectory:
    """End after three fifths of the time."""
    return estimate[: int(0.6 * len(estimate))]


def stretched(estimate: Trajectory) -> Trajectory:
    """Enlarge the path by 8 %."""
    return Trajectory(estimate.stamps, estimate.poses * [1.08, 1.08, 1.0])


def jittered(estimate: Trajectory) -> Trajectory:
    """Add noise of 2 cm and half a degree to every pose."""
    noise = np.random.default_rng(0).normal(0.0, [0.02, 0.02, np.radians(0.5)], estimate.poses.shape)
    return Trajectory(estimate.stamps, estimate.poses + noise)


BREAKS: tuple[tuple[str, str, Callable[[Trajectory], Trajectory]], ...] = (
    ("ok", "jitter of 2 cm and 0.5°", jittered),
    ("drift", "stretched by 8 %", stretched),
    ("broken loop", "turned by 12° at a third", moved_from(1 / 3, (0.0, 0.0, np.radians(12.0)))),
    ("broken loop", "heading bias of 0.3°/m", heading_bias),
    ("lost", "jump of 0.7 m at a half", moved_from(0.5, (0.7, 0.0, 0.0))),
    ("lost", "turned by 30° at a half", moved_from(0.5, (0.0, 0.0, np.radians(30.0)))),
    ("lost", "stands still after 60 %", frozen),
    ("lost", "ends after 60 %", cut_off),
)


# --- judging


@dataclass(frozen=True)
class Case:
    """A label and the outcome by the rules."""

    label: str
    name: str
    outcome: Outcome


def by_truth(estimate: Trajectory, truth: Trajectory) -> Outcome:
    """Outcome by the rules of an estimate whose truth is known."""
    matched = associate(estimate, truth)
    return judge(evidence_from_truth(matched, covered_share(matched, truth)))


def by_relations(estimate: Trajectory, relations: Path) -> Outcome:
    """Outcome by the rules of an estimate on a recorded log."""
    known = read_relations(relations)
    return judge(evidence_from_relations(relation_error(estimate, known), known))


def directory_of(run: Run, runs: Path) -> Path:
    """Directory of the run; computes the run first if it is missing."""
    folder = runs / run.name
    if not (folder / "metrics.json").exists():
        print(f"computing {run.name}", file=sys.stderr)
        testbed = Path(sys.executable).with_name("testbed")
        subprocess.run([testbed, *run.arguments, "--out", folder, "--overwrite"], check=True, capture_output=True)
    return folder


def cases(runs: Path) -> Iterator[Case]:
    """Yield all cases."""
    for run in SIMULATED:
        folder = directory_of(run, runs)
        estimate, truth = read_tum(folder / "estimate.tum"), read_tum(folder / "truth.tum")
        yield Case(run.label, f"{run.name} ({run.seen})", by_truth(estimate, truth))
        if run in SIMULATED[:4]:
            for label, how, broken in BREAKS:
                yield Case(label, f"{run.name}, {how}", by_truth(broken(estimate), truth))
    if not DATASETS.is_dir():
        print(f"skipping the recorded logs: {DATASETS} does not exist", file=sys.stderr)
        return
    for run in RECORDED:
        estimate = read_tum(directory_of(run, runs) / "estimate_dense.tum")
        yield Case(run.label, f"{run.name} ({run.seen})", by_relations(estimate, Path(run.arguments[3])))
    for label, name, relations in PEERS:
        path = DATASETS.parent / "peers" / f"{name}.tum"
        if path.exists():
            yield Case(label, name, by_relations(read_tum(path), DATASETS / relations))


def table(judged: list[Case]) -> str:
    """Markdown table: one row for each label given, one column for each outcome found."""
    labels = ["ok", "drift", "broken loop", "lost"]
    counts = Counter((case.label, case.outcome.label) for case in judged)
    lines = [f"| label \\ outcome by the rules | {' | '.join(labels)} |", "|---|" + "---|" * len(labels)]
    lines += [
        f"| {label} | " + " | ".join(str(counts[label, found] or "") for found in labels) + " |" for label in labels
    ]
    wrong = [
        f"- {case.name}: {case.outcome.label} ({case.outcome.reason})"
        for case in judged
        if case.label != case.outcome.label
    ]
    return "\n".join([*lines, *(["", "Misjudged:", *wrong] if wrong else [])]) + "\n"


def main() -> None:
    """Judge all labelled runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--runs", type=Path, default=ROOT / "runs" / "outcomes", help="directory of the runs; missing ones are computed"
    )
    parser.add_argument("--write", action="store_true", help="write the table into docs/metrics.md")
    options = parser.parse_args()
    judged = list(cases(options.runs))
    for case in judged:
        mark = " " if case.label == case.outcome.label else "!"
        print(f"{mark} {case.label:12s} {case.outcome.label:12s} {case.name}: {case.outcome.reason}")
    text = table(judged)
    print(f"\n{text}")
    if options.write:
        write_table(DOCS / "metrics.md", "outcomes", text)


if __name__ == "__main__":
    main()
