# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure the self-check: lost runs named, false alarms, and whether the score ranks as references do.

    python -m tools.measure.self_check RUNS --split training --runs 150
    python -m tools.measure.self_check RUNS --split held-out --runs 150
    python -m tools.measure.self_check RUNS --split fresh --runs 96
    python -m tools.measure.self_check RUNS --split unseen --runs 96
    python -m tools.measure.self_check RUNS --split logs
    python -m tools.measure.self_check RUNS --split peers

Prints: the confusion tables and the rank correlations of docs/self-check.md, with intervals

Data suffice where localisation in the true map, from the true start, stays found on them (as in the stress suite). They
tell of a fault if that localisation is right over the metre on which the run left the truth: where even the true map
does not show where the robot is, no scan can contradict the estimate there.
The runs are short drives under the perturbations of the stress suite, with the filter's defaults and with two weakened
filters, which are lost often. Thresholds of the sum were chosen by the worlds and seeds of `training`, those of the
directions that no wall holds by `held-out`; those of `fresh`, `unseen` and the recorded logs took no part in it.

RUNS is a directory with one file for each run; the command goes on where it was stopped. A run is judged by the truth
at the scans that the filter used. Each takes some five seconds; recorded logs and estimates of other systems are read
from $TESTBED_DATASETS and the folder `peers` next to it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

import worlds
from eval.files.atomic_write import atomic_write
from eval.files.tum import read_tum
from eval.first_failure import find_failure
from eval.outcome import LOCAL_DEG, LOCAL_M, evidence_from_truth, judge
from eval.trajectory.association import associate
from eval.trajectory.relations import read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from slam import se2
from slam.config import FilterConfig, MotionConfig
from slam.diagnosis.path_check import left_out_score
from slam.sensor.rays import make_rays
from slam.step.scan_intake import gate_opens
from testbed.estimation.estimation import Estimation
from testbed.estimation.self_check import self_check_metrics
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.presets import load_lidar, load_robot
from testbed.run.estimate import Estimate
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from testbed.stress.perturbations import thin_scans
from testbed.stress.suite import PERTURBATIONS, ROBOTS, perturbed
from tools.measure import real_logs
from tools.measure.stress import localised, share, stays_found

DURATION, SCAN_PERIOD = 80.0, 0.2
"""Length of each drive and time between two scans [s]."""
WORLDS = {
    "training": (
        "office", "maze", "nested_loops", "apartment", "symmetric", "concourse", "museum", "warehouse",
        "generated:rooms:size=30x20:7101", "generated:cave:size=30x20:7102",
    ),
    "held-out": (
        "lab", "loop", "hall", "courtyard", "long_corridor", "cave",
        "generated:rooms:size=30x20:7201", "generated:cave:size=30x20:7202",
        "generated:corridors:size=40x30:7203", "generated:blocks:size=40x30:7204",
    ),
    "fresh": (
        "museum", "apartment", "hall", "long_corridor",
        "generated:rooms:size=30x20:7301", "generated:cave:size=30x20:7302",
        "generated:corridors:size=40x30:7303", "generated:corridors:size=60x30:7304",
        "generated:blocks:size=40x30:7305", "generated:blocks:size=60x40:7306",
        "generated:loops:size=40x30:7307", "generated:warehouse:size=40x20:7308",
    ),
    "unseen": (
        "office", "lab", "hall", "long_corridor",
        "generated:rooms:size=30x20:7401", "generated:cave:size=30x20:7402",
        "generated:corridors:size=40x30:7403", "generated:corridors:size=60x30:7404",
        "generated:blocks:size=40x30:7405", "generated:blocks:size=60x40:7406",
        "generated:loops:size=40x30:7407", "generated:warehouse:size=40x20:7408",
    ),
}  # fmt: skip
"""Worlds by which thresholds were chosen, and those that took no part in it: all generated ones of `fresh` and of
`unseen`; their four of the catalogue were driven along other routes before."""
FIRST_SEED = {"training": 9000, "held-out": 9500, "fresh": 9900, "unseen": 10300}
NO_JUMPS = MotionConfig(jump_share=0.0)
FILTERS = {
    "default": FilterConfig(particles=8),
    "no jumps": FilterConfig(particles=4, motion=NO_JUMPS),
    "no faults": FilterConfig(particles=1, motion=replace(NO_JUMPS, failure_share=0.0)),
}
"""The defaults; without the jumps of the motion model, which switches the wide search off; without its faults too."""
FILTER_SHARES = (0.2, 0.4, 0.4)
HARD_FAULTS = ("spin", "push", "stuck-odometry", "backward-odometry")
"""Perturbations under which the weakened filters are lost often …"""
HARD_SHARE = 0.7
"""… and the share of the runs that have one of them; the others have another one, or none."""
VERDICTS = ("plausible", "doubtful", "lost")
LOG_SEEDS = (1,)
PEERS = real_logs.ROOT.parent / "peers"
NEAR_STAMP = 0.02
"""A pose belongs to a scan if their stamps differ by no more than this [s]."""


@dataclass(frozen=True)
class Case:
    """One simulated run."""

    split: str
    number: int
    world: str
    robot: str
    lidar: str
    perturbation: str
    """One of the stress suite's, or "none"."""
    severity: int
    """1 middle or 2 severe."""
    filter: str
    """One of `FILTERS`."""
    seed: int


def cases(split: str, runs: int) -> list[Case]:
    """The first runs of a split, drawn from a fixed seed."""
    rng = np.random.default_rng(FIRST_SEED[split])
    found = []
    for number in range(runs):
        robot, lidar = ROBOTS[rng.integers(len(ROBOTS))]
        others = ("none", *(name for name in PERTURBATIONS if name not in HARD_FAULTS))
        perturbation = str(rng.choice(HARD_FAULTS if rng.uniform() < HARD_SHARE else others))
        world, kind = WORLDS[split][number % len(WORLDS[split])], str(rng.choice(list(FILTERS), p=FILTER_SHARES))
        severity, seed = int(rng.integers(1, 3)), FIRST_SEED[split] + number
        found.append(Case(split, number, world, robot, lidar, perturbation, severity, kind, seed))
    return found


def frames_of(case: Case) -> list[Frame]:
    """The frames of the drive, perturbed."""
    seeds = RunSeeds.from_seed(case.seed)
    world = worlds.random_route(worlds.load(case.world), np.random.default_rng(seeds.route))
    config = SimulationConfig(
        backend="fast", robot=load_robot(case.robot), lidar=load_lidar(case.lidar), seeds=seeds, duration=DURATION
    )
    with simulate(world, config) as simulation:
        frames = list(thin_scans(simulation, SCAN_PERIOD))
    return frames if case.perturbation == "none" else perturbed(frames, case.perturbation, case.severity)


def run_case(case: Case) -> dict[str, Any]:
    """Estimate one drive and judge it by the truth and by its own check; a robot that does not fit gives no result."""
    try:
        frames = frames_of(case)
    except worlds.WorldError as error:
        return {**asdict(case), "skipped": str(error)}
    estimation, final = estimate(frames, FILTERS[case.filter], case.seed)
    truth, used = estimation.trajectory_at_scans("truth"), np.asarray(estimation.mapper.update_scans)
    assert truth is not None
    return {
        **asdict(case),
        "final": judged(final.at_scans[used], truth),
        "driving": judged(estimation.online()[used], truth),
        "self_check": self_check_metrics(estimation, final, replay=True),
    }


def estimate(frames: list[Frame], config: FilterConfig, seed: int) -> tuple[Estimation, Estimate]:
    """Run the filter and the final pass."""
    estimation = Estimation(config, RunSeeds.from_seed(seed).filter)
    for frame in frames:
        estimation.process(frame)
    return estimation, estimation.refined(estimation.filtered())


def judged(path: Trajectory, truth: Trajectory) -> dict[str, Any]:
    """Judge a path by the truth.

    lost: its outcome is `lost` or `broken loop`, and it does not come back; good: neither; blip: the rest, paths that
    left the truth and came back, or left it by less than makes an outcome
    """
    outcome, failure = judge(evidence_from_truth(associate(path, truth))), find_failure(path, truth=truth)
    bad, broken = failure is not None and failure.bad, outcome.label in ("lost", "broken loop")
    kind = "lost" if bad and broken else "blip" if bad or broken else "good"
    stamp = failure.stamp if failure is not None and bad else None
    return {"truth": kind, "outcome": outcome.label, "reason": outcome.reason, "stamp": stamp}


def run_log(name: str, kind: str, seed: int) -> dict[str, Any]:
    """Estimate a recorded log and judge it by its reference: `lost` above the error at which `real_logs` says so."""
    case = real_logs.CASES[name]
    relations = None if case.relations is None else read_relations(case.relations)
    estimation, final = estimate(list(open_log(case.log).frames), FILTERS[kind], seed)
    error = real_logs.error_of(case, final, relations)[0]
    truth = {"truth": "lost" if error > case.failed else "good", "error_m": error}
    check = self_check_metrics(estimation, final, replay=True)
    return {"world": name, "filter": kind, "seed": seed, "final": truth, "self_check": check}


def run_peers(name: str) -> dict[str, Any]:
    """Score all estimates of one log that there are: those of other systems, the odometry and this project's own."""
    case = real_logs.CASES[name]
    assert case.relations is not None
    frames, relations = list(open_log(case.log).frames), read_relations(case.relations)
    paths = {path.stem: read_tum(path) for path in sorted(PEERS.glob(f"{name}_*.tum"))}
    for kind in ("default", "no faults"):
        estimation, final = estimate(frames, FILTERS[kind], 1)
        paths |= {f"filter, {kind}": estimation.filtered().dense, f"final pass, {kind}": final.dense}
    paths["odometry"] = Trajectory(estimation.stamps, estimation.odometry)
    rows = []
    for label, path in paths.items():
        error = relation_error(path, relations).all
        score = score_of(path, frames)
        rows.append({"estimate": label, "m": error.translation.mean, "deg": error.rotation.mean, "score": score})
    return {"log": name, "rows": rows}


def score_of(path: Trajectory, frames: list[Frame]) -> float | None:
    """Score of a path over the scans that pass the filter's update gates by odometry and have a pose."""
    gate, last, poses, rays = FilterConfig().gate, None, [], []
    order = np.argsort(path.stamps, kind="stable")
    for frame in frames:
        if frame.scan is None or not (last is None or gate_opens(gate, se2.between(last, frame.odometry), 0.0)):
            continue
        row = order[min(np.searchsorted(path.stamps[order], frame.stamp - NEAR_STAMP), len(order) - 1)]
        if abs(path.stamps[row] - frame.stamp) <= NEAR_STAMP:
            last = frame.odometry
            poses.append(path.poses[row])
            rays.append(make_rays([frame.scan], usable_range=FilterConfig().map.usable_range))
    return left_out_score(np.array(poses), rays, FilterConfig().map)


def with_survival(out: Path, case: Case, row: dict[str, Any]) -> dict[str, Any]:
    """The result of a run; of a lost one also whether its data suffice, and whether they tell of the fault."""
    if row.get("final", {}).get("truth") != "lost":
        return row
    file = out / f"{case.split}-{case.number:03d}-survivable.json"
    return row | kept(file, lambda: what_the_true_map_shows(case, row["final"]["stamp"]))


def what_the_true_map_shows(case: Case, stamp: float) -> dict[str, bool]:
    """Whether localisation in the true map stays found, and whether it is right where a run was lost at `stamp` [s]."""
    localisation = localised(case, frames_of(case))
    truth = localisation.trajectory_at_scans("truth")
    assert truth is not None
    matched = associate(localisation.online(), truth)
    return {"survivable": stays_found(localisation), "told": is_right(matched.estimate, matched.reference, stamp)}


def is_right(path: Trajectory, truth: Trajectory, stamp: float) -> bool:
    """Whether a path in the frame of the truth stays within `LOCAL_M` and `LOCAL_DEG` of it over a metre.

    The metre begins one scan before `stamp` [s]: an outcome is lost where the motion over the next metre is wrong by
    so much.
    """
    away = truth.poses[:, :2] - path.poses[:, :2]
    turned = np.abs(se2.wrap_angle(truth.poses[:, 2] - path.poses[:, 2]))
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth.poses[:, :2], axis=0).T))])
    first = max(int(np.searchsorted(truth.stamps, stamp)) - 1, 0)
    metre = slice(first, int(np.searchsorted(driven, driven[first] + 1.0)) + 1)
    return bool(np.all(np.hypot(*away[metre].T) <= LOCAL_M) and np.all(turned[metre] <= np.radians(LOCAL_DEG)))


def kept(file: Path, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The result in a file, which is computed first if there is none yet."""
    if not file.exists():
        result = compute()
        with atomic_write(file) as temporary:
            temporary.write_text(json.dumps(result, indent=1), encoding="utf-8")
        print(
            f"{file.stem}: {result.get('final', {}).get('truth', '')} {verdict_of(result, '')}".strip(": "), flush=True
        )
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return found


def verdict_of(row: dict[str, Any], which: str) -> str:
    """The verdict of a run's own check, of the final estimate (""), or of the filter ("while_driving")."""
    check = row.get("self_check", {})
    return str((check.get(which, {}) if which else check).get("verdict", ""))


def table(rows: Sequence[dict[str, Any]], truth: str, which: str) -> str:
    """The confusion table, and what follows from it, as Markdown."""
    lines = [f"| by the truth | {' | '.join(VERDICTS)} |", "|---|---|---|---|"]
    named: dict[str, list[str]] = {}
    for kind in ("lost", "blip", "good"):
        named[kind] = [verdict_of(row, which) for row in rows if row[truth]["truth"] == kind]
        lines.append(f"| {kind} | {' | '.join(str(named[kind].count(word)) for word in VERDICTS)} |")
    lost, good = named["lost"], named["good"]
    of_lost = [(verdict_of(row, which), row) for row in rows if row[truth]["truth"] == "lost"]
    seen = [verdict for verdict, row in of_lost if row.get("survivable", True)]
    told = [verdict for verdict, row in of_lost if row.get("told", True)]
    lines += [
        "",
        f"lost runs named lost: {share(lost.count('lost'), len(lost))}; "
        f"lost or doubtful: {share(len(lost) - lost.count('plausible'), len(lost))}",
        f"those of them whose data suffice: {share(seen.count('lost'), len(seen))}; "
        f"lost or doubtful: {share(len(seen) - seen.count('plausible'), len(seen))}",
        f"those whose data tell of the fault: {share(told.count('lost'), len(told))}; "
        f"lost or doubtful: {share(len(told) - told.count('plausible'), len(told))}",
        f"good runs called lost: {share(good.count('lost'), len(good))}; "
        f"lost or doubtful: {share(len(good) - good.count('plausible'), len(good))}",
    ]
    return "\n".join(lines)


def details(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The gap between good and lost runs, when lost runs were named, and the runs that were judged wrongly."""
    sums = {
        kind: sorted(row["self_check"]["contradiction_scans"] for row in rows if row["final"]["truth"] == kind)
        for kind in ("lost", "good")
    }
    lines = [
        f"largest sums of good runs: {_figures(sums['good'][-5:])}; smallest of lost runs: {_figures(sums['lost'][:5])}"
    ]
    late = [
        row["self_check"]["stamp"] - row["final"]["stamp"]
        for row in rows
        if row["final"]["truth"] == "lost" and row["final"].get("stamp") and row["self_check"]["stamp"] is not None
    ]
    if late:
        lines.append(
            f"the named time less that at which the truth was left: median {np.median(late):.1f} s, 10 and 90 % "
            f"{_figures(np.percentile(late, [10, 90]))} s"
        )
    for row in rows:
        wrong = {"lost": ("plausible", "doubtful"), "good": ("lost",)}.get(row["final"]["truth"], ())
        if (called := verdict_of(row, "")) in wrong:
            what = row["final"].get("reason", "")
            label = ", ".join(str(row[key]) for key in Case.__annotations__ if key in row)
            label += "" if row.get("survivable", True) else " (data do not suffice)"
            label += "" if row.get("told", True) else " (data do not tell)"
            lines.append(f"{row['final']['truth']}, called {called}: {label}: {what}")
    return lines


def _figures(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.2f}" for value in values)


def print_ranks(found: dict[str, Any]) -> None:
    """Print errors and scores of the estimates of a log, and their rank correlations."""
    print(f"\n{found['log']}\n| estimate | translation m | rotation deg | score nats |\n|---|---|---|---|")
    rows = sorted(found["rows"], key=lambda row: -row["score"])
    for row in rows:
        print(f"| {row['estimate']} | {row['m']:.4f} | {row['deg']:.2f} | {row['score']:.3f} |")
    for words, chosen in (
        ("other systems", [r for r in rows if r["estimate"].startswith(found["log"])]),
        ("all", rows),
    ):
        if len(chosen) > 2:
            ranks = [-spearmanr([r["score"] for r in chosen], [r[key] for r in chosen])[0] for key in ("m", "deg")]
            print(
                f"rank correlation, {words} ({len(chosen)}): {ranks[0]:.2f} with translation, "
                f"{ranks[1]:.2f} with rotation"
            )


def main() -> None:
    """Run what is missing, then print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="RUNS")
    parser.add_argument("--split", choices=(*WORLDS, "logs", "peers"), default="held-out")
    parser.add_argument("--runs", type=int, default=150)
    parser.add_argument("--logs", default="intel,fr079,aces,csail,seattle,edmonton,acapulco")
    options = parser.parse_args()
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    if options.split == "peers":
        for name in ("intel", "fr079"):
            print_ranks(kept(out / f"peers-{name}.json", partial(run_peers, name)))
        return
    if options.split == "logs":
        runs = [(name, kind, seed) for name in options.logs.split(",") for kind in FILTERS for seed in LOG_SEEDS]
        rows = [
            kept(out / f"log-{'-'.join(map(str, run))}.json".replace(" ", "_"), partial(run_log, *run)) for run in runs
        ]
    else:
        chosen = cases(options.split, options.runs)
        rows = [kept(out / f"{case.split}-{case.number:03d}.json", partial(run_case, case)) for case in chosen]
        rows = [with_survival(out, case, row) for case, row in zip(chosen, rows, strict=True)]
    rows = [row for row in rows if "skipped" not in row]
    print(f"\n{len(rows)} runs, final estimate\n\n{table(rows, 'final', '')}\n")
    print("\n".join(details(rows)))
    if options.split != "logs":
        print(f"\nwhile driving\n\n{table(rows, 'driving', 'while_driving')}")


if __name__ == "__main__":
    main()
