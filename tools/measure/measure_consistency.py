# SPDX-License-Identifier: MIT
"""Is the filter's covariance honest? The figures and the picture of docs/consistency.md.

    python tools/measure/measure_worlds.py WORLDS
    python tools/measure/measure_consistency.py RUNS WORLDS

Each run is kept as RUNS/<study>-<seed>.npz; what is there is not computed again. Short runs of 20 s take about 2 s of
one core each, those through open worlds about a minute. Long runs are those of the sweep in WORLDS.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import worlds
from eval.filter.nees import LEVEL, chi_square, nees
from eval.report.plots import BAD, ESTIMATE, GOOD, ODOMETRY, QUIET, STYLE
from eval.sweep.results import CURVE_GRID, SweepTable, read_sweep
from slam import se2
from slam.config import FilterConfig
from testbed.run.estimation import Estimation
from testbed.seeds import RunSeeds
from testbed.simulation import LidarLayers, OdometryConfig, SimulationConfig, simulate

PAGE = Path(__file__).resolve().parents[2] / "docs" / "consistency.md"
PICTURE = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "consistency.png"
PERIOD = 1.0
"""Distance of the times at which runs are compared [s]."""


@dataclass(frozen=True)
class Study:
    """Drives through one world with the noise of many seeds."""

    world: str
    duration: float = 1800.0
    """At most [s]."""
    lidar: LidarLayers = field(default_factory=LidarLayers)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    seeds: int = 20


_EXACT = OdometryConfig(systematic=False, random=False, ticks=False)
STUDIES = {
    "short": Study("office", 20.0),
    "short, scans without duration": Study("office", 20.0, LidarLayers(motion=False)),
    "short, no range noise": Study("office", 20.0, LidarLayers(range_noise=False)),
    "short, no noise of the lidar": Study("office", 20.0, LidarLayers.none()),
    "short, exact sensors": Study("office", 20.0, LidarLayers.none(), _EXACT),
    "long_corridor": Study("long_corridor", seeds=3),
    "hall": Study("hall", seeds=3),
}


OPEN = ("long_corridor", "hall")
"""Studies of places where nothing tells how far the robot has driven."""


LONG = {"office": ESTIMATE, "nested_loops": ODOMETRY, "maze": GOOD, "warehouse": BAD}
"""Worlds whose whole tours are drawn, with colours."""


@dataclass(frozen=True, eq=False)
class Honesty:
    """Error and covariance of the online pose at the updates of one run, in the frame of the first pose."""

    stamps: NDArray[np.float64]
    """(n,) [s]."""
    errors: NDArray[np.float64]
    """(n, 3) [m, m, rad]."""
    covariances: NDArray[np.float64]
    """(n, 3, 3)."""
    nees: NDArray[np.float64]
    """(n,)."""


def run(study: Study, seed: int) -> Honesty:
    """One drive through the filter."""
    seeds = RunSeeds.from_seed(seed)
    config = SimulationConfig(
        backend="fast", seeds=seeds, duration=study.duration, lidar_layers=study.lidar, odometry=study.odometry
    )
    estimation = Estimation(FilterConfig(), seeds.filter, threads=1)
    with simulate(worlds.load(study.world), config) as simulation:
        for frame in simulation:
            estimation.process(frame)
    columns = estimation.steps.columns()
    rows, values, _ = nees(columns)
    estimate, truth = (np.column_stack([columns[f"{p}{c}"] for c in ("x", "y", "theta")]) for p in ("", "true_"))
    expected = se2.compose(estimate[0], se2.between(truth[0], truth))
    errors = estimate - expected
    errors[:, 2] = se2.wrap_angle(errors[:, 2])
    names = ("xx", "xy", "xt", "xy", "yy", "yt", "xt", "yt", "tt")
    covariances = np.stack([columns[f"cov_{name}"] for name in names], axis=-1).reshape(-1, 3, 3)
    return Honesty(columns["stamp"][rows], errors[rows], covariances[rows], values)


def runs_of(name: str, folder: Path) -> list[Honesty]:
    """The runs of a study; carries out what is missing."""
    found = []
    for seed in range(STUDIES[name].seeds):
        path = folder / f"{name.replace(', ', '-').replace(' ', '_')}-{seed}.npz"
        if not path.exists():
            result = run(STUDIES[name], seed)
            np.savez_compressed(path, **vars(result))
        found.append(Honesty(**np.load(path)))
    return found


def band(seeds: int) -> tuple[float, float]:
    """Where the mean NEES of so many independent runs lies with 95 % chance, for an honest covariance."""
    low, high = ((1.0 + sign * LEVEL) / 2.0 for sign in (-1.0, 1.0))
    return chi_square(low, 3 * seeds) / seeds, chi_square(high, 3 * seeds) / seeds


def mean_over_time(runs: list[Honesty]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [s] up to the end of the shortest run, and the mean over the runs of the NEES last reached there."""
    times = np.arange(5.0, min(run.stamps[-1] for run in runs), PERIOD)
    values = [run.nees[np.searchsorted(run.stamps, times, side="right") - 1] for run in runs]
    return times, np.mean(values, axis=0)


def row(name: str, runs: list[Honesty]) -> str:
    """One line of the table of NEES; errors and stated deviations are root mean squares."""
    times, curve = mean_over_time(runs)
    low, high = band(len(runs))
    on = [run.stamps >= times[0] for run in runs]
    errors = [run.errors[rows] for run, rows in zip(runs, on, strict=True)]
    variances = [np.diagonal(run.covariances[rows], axis1=1, axis2=2) for run, rows in zip(runs, on, strict=True)]
    rms = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))
    sigma = np.sqrt(np.mean(np.concatenate(variances), axis=0))
    bias = np.mean([error.mean(axis=0) for error in errors], axis=0)
    cells = [
        name,
        f"{len(runs)}",
        f"{curve.mean():.1f}",
        f"{low:.1f} to {high:.1f}",
        f"{100.0 * np.mean((curve >= low) & (curve <= high)):.0f} %",
        f"{1000.0 * np.hypot(*rms[:2]):.0f} mm / {np.degrees(rms[2]):.2f}°",
        f"{1000.0 * np.hypot(*sigma[:2]):.0f} mm / {np.degrees(sigma[2]):.2f}°",
        f"{1000.0 * np.hypot(*bias[:2]):.0f} mm / {np.degrees(abs(bias[2])):.2f}°",
    ]
    return "| " + " | ".join(cells) + " |"


def weak_direction(name: str, runs: list[Honesty]) -> str:
    """One line of the table of places without features: error and stated deviation where the filter is least sure."""
    errors, sigmas = [], []
    for run in runs:
        values, vectors = np.linalg.eigh(run.covariances[:, :2, :2])
        errors.append(np.abs(np.einsum("ni,ni->n", vectors[:, :, 1], run.errors[:, :2])))
        sigmas.append(np.sqrt(values[:, 1]))
    error, sigma = np.concatenate(errors), np.concatenate(sigmas)
    worst = [(e.max(), s[e.argmax()]) for e, s in zip(errors, sigmas, strict=True)]
    e, s = np.median(worst, axis=0)
    return (
        f"| {name} | {np.sqrt(np.mean(error**2)):.2f} m | {np.sqrt(np.mean(sigma**2)):.2f} m | {e:.2f} m | {s:.2f} m "
        f"| {100.0 * np.mean(error <= 1.96 * sigma):.0f} % | {np.mean([run.nees.mean() for run in runs]):.0f} |"
    )


def row_head() -> str:
    """Head of the table of `row`."""
    return (
        "| runs | seeds | mean NEES | 95 % band | times within | rms error | stated | mean error |\n" + "|---" * 8 + "|"
    )


def weak_head() -> str:
    """Head of the table of `weak_direction`."""
    return "| world | rms error | rms stated | worst error | stated there | within 95 % | NEES |\n" + "|---" * 7 + "|"


def write_table(name: str, head: str, rows: list[str]) -> None:
    """Put a table between its two marks in the page."""
    begin, end = f"<!-- {name}: written by tools/measure/measure_consistency.py -->\n", f"<!-- /{name} -->\n"
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(begin)
    PAGE.write_text(before + begin + "\n".join([head, *rows]) + "\n" + end + rest.partition(end)[2], encoding="utf-8")


def picture(studies: dict[str, list[Honesty]], sweep: SweepTable) -> Figure:
    """Mean NEES over time in short runs, with and without errors of the lidar, and along whole tours; 95 % bands."""
    figure = Figure(figsize=(8.6, 3.4))
    left, right = figure.subplots(1, 2)
    for name, label, colour in (
        ("short", "default", ESTIMATE),
        ("short, no noise of the lidar", "lidar without errors", ODOMETRY),
    ):
        left.plot(*mean_over_time(studies[name]), color=colour, label=label)
    _honest(left, STUDIES["short"].seeds)
    left.set(xlabel="time in the office [s]", ylim=(0.0, None))
    for name, colour in LONG.items():
        nees_of = sweep.curves["nees"][sweep.places.index(name), 0, 0]
        right.plot(100.0 * CURVE_GRID, np.nanmean(nees_of, axis=0), color=colour, label=name)
    _honest(right, len(sweep.seeds))
    right.set(xlabel="share of the tour [%]", yscale="log")
    return figure


def _honest(ax: Axes, seeds: int) -> None:
    ax.axhspan(*band(seeds), color="#d3f9d8", lw=0, zorder=0)
    ax.axhline(3.0, color=QUIET, lw=0.8, zorder=1)
    ax.set_ylabel("mean NEES")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)


def main() -> None:
    """Carry out what is missing, write the tables into the page, draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="directory of the runs")
    parser.add_argument("worlds", type=Path, help="directory of measure_worlds.py")
    args = parser.parse_args()
    args.runs.mkdir(parents=True, exist_ok=True)
    studies = {name: runs_of(name, args.runs) for name in STUDIES}
    write_table("nees", row_head(), [row(name, runs) for name, runs in studies.items() if name not in OPEN])
    open_worlds = {name: runs for name, runs in studies.items() if name in OPEN}
    write_table("open", weak_head(), [weak_direction(name, runs) for name, runs in open_worlds.items()])
    with rc_context(STYLE):
        picture(studies, read_sweep(args.worlds)).savefig(PICTURE, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
