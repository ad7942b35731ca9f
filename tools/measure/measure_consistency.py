# SPDX-License-Identifier: MIT
"""Compare the filter's covariance with its errors (NEES), over seeds.

    python -m tools.measure.measure_worlds WORLDS
    python -m tools.measure.measure_consistency RUNS WORLDS

Writes: docs/consistency.md (nees), docs/consistency.md (open), docs/pictures/consistency.png

Each run is kept as RUNS/<study>-<seed>.npz and computed only once. A short run of 20 s takes about 2 s of one core, a
run in an open world about a minute. The long runs are those of the sweep in WORLDS.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import worlds
from eval.consistency import LEVEL, chi_square
from eval.filter.nees import nees
from eval.report.plots import BAD, ESTIMATE, GOOD, ODOMETRY, QUIET, STYLE
from eval.sweep.results import CURVE_GRID, SweepTable, read_sweep
from slam import se2
from slam.config import FilterConfig, MatchConfig
from testbed.estimation.estimation import Estimation
from testbed.seeds import RunSeeds
from testbed.simulation import LidarLayers, OdometryConfig, SimulationConfig, simulate
from tools.pages import DOCS, write_table

PAGE = DOCS / "consistency.md"
PICTURE = DOCS / "pictures" / "consistency.png"
PERIOD = 1.0
"""Runs are compared at multiples of this time [s]."""


@dataclass(frozen=True)
class Study:
    """Drives through one world with the noise of many seeds."""

    world: str
    duration: float = 1800.0
    """Longest simulated time [s]."""
    lidar: LidarLayers = field(default_factory=LidarLayers)
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    seeds: int = 20
    filter: FilterConfig = field(default_factory=FilterConfig)


_EXACT = OdometryConfig(systematic=False, random=False, ticks=False)
_NARROW = FilterConfig(match=MatchConfig(outlier_distance=0.114))
"""End points farther than 3.79 `match.hit_sigma` from a wall are outliers: a loss as narrow as loses 5 % of the
information in normal errors (asymptotic efficiency)."""
STUDIES = {
    "short": Study("office", 20.0),
    "short, scans without duration": Study("office", 20.0, LidarLayers(motion=False)),
    "short, no range noise": Study("office", 20.0, LidarLayers(range_noise=False)),
    "short, no noise of the lidar": Study("office", 20.0, LidarLayers.none()),
    "short, exact sensors": Study("office", 20.0, LidarLayers.none(), _EXACT),
    "short, range noise alone": Study("office", 20.0, replace(LidarLayers.none(), range_noise=True)),
    "short, duration of scans alone": Study("office", 20.0, replace(LidarLayers.none(), motion=True)),
    "short, narrow loss": Study("office", 20.0, filter=_NARROW),
    "short, exact sensors, narrow loss": Study("office", 20.0, LidarLayers.none(), _EXACT, filter=_NARROW),
    "long_corridor": Study("long_corridor", seeds=3),
    "hall": Study("hall", seeds=3),
}


OPEN = ("long_corridor", "hall")
"""Worlds in which the lidar cannot measure how far the robot has driven."""


LONG = {"office": ESTIMATE, "nested_loops": ODOMETRY, "maze": GOOD, "warehouse": BAD}
"""Worlds whose whole tours are drawn, and their colours."""


@dataclass(frozen=True, eq=False)
class Consistency:
    """Error and covariance of the online pose at the updates of one run, in the frame of the first pose."""

    stamps: NDArray[np.float64]
    """(n,) [s]."""
    errors: NDArray[np.float64]
    """(n, 3) [m, m, rad]."""
    covariances: NDArray[np.float64]
    """(n, 3, 3)."""
    nees: NDArray[np.float64]
    """(n,)."""


def run(study: Study, seed: int) -> Consistency:
    """Simulate one drive and run the filter on it."""
    seeds = RunSeeds.from_seed(seed)
    config = SimulationConfig(
        backend="fast", seeds=seeds, duration=study.duration, lidar_layers=study.lidar, odometry=study.odometry
    )
    estimation = Estimation(study.filter, seeds.filter, threads=1)
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
    return Consistency(columns["stamp"][rows], errors[rows], covariances[rows], values)


def runs_of(name: str, folder: Path) -> list[Consistency]:
    """Runs of a study; computes those that are missing."""
    found = []
    for seed in range(STUDIES[name].seeds):
        path = folder / f"{name.replace(', ', '-').replace(' ', '_')}-{seed}.npz"
        if not path.exists():
            result = run(STUDIES[name], seed)
            np.savez_compressed(path, **vars(result))
        found.append(Consistency(**np.load(path)))
    return found


def band(seeds: int) -> tuple[float, float]:
    """95 % interval of the mean NEES of `seeds` independent runs whose covariance is right."""
    low, high = ((1.0 + sign * LEVEL) / 2.0 for sign in (-1.0, 1.0))
    return chi_square(low, 3 * seeds) / seeds, chi_square(high, 3 * seeds) / seeds


def mean_over_time(runs: list[Consistency]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [s] up to the end of the shortest run, and the mean over the runs of the NEES last reached there."""
    times = np.arange(5.0, min(run.stamps[-1] for run in runs), PERIOD)
    values = [run.nees[np.searchsorted(run.stamps, times, side="right") - 1] for run in runs]
    return times, np.mean(values, axis=0)


def scatter_nees(runs: list[Consistency]) -> float:
    """Mean NEES of the deviations from the mean error that the runs share; 3 where the covariance is right for what
    differs from run to run."""
    values = []
    for time in mean_over_time(runs)[0]:
        last = [np.searchsorted(run.stamps, time, side="right") - 1 for run in runs]
        errors = np.stack([run.errors[k] for run, k in zip(runs, last, strict=True)])
        covariances = np.stack([run.covariances[k] for run, k in zip(runs, last, strict=True)])
        away = errors - errors.mean(axis=0)
        values.append(np.mean(away[:, None] @ np.linalg.solve(covariances, away[..., None])))
    return float(np.mean(values)) * len(runs) / (len(runs) - 1)


def row(name: str, runs: list[Consistency]) -> str:
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
        f"{scatter_nees(runs):.1f}",
        f"{100.0 * np.mean((curve >= low) & (curve <= high)):.0f} %",
        f"{1000.0 * np.hypot(*rms[:2]):.0f} mm / {np.degrees(rms[2]):.2f}°",
        f"{1000.0 * np.hypot(*sigma[:2]):.0f} mm / {np.degrees(sigma[2]):.2f}°",
        f"{1000.0 * np.hypot(*bias[:2]):.0f} mm / {np.degrees(abs(bias[2])):.2f}°",
    ]
    return "| " + " | ".join(cells) + " |"


def weak_direction(name: str, runs: list[Consistency]) -> str:
    """One line of the table of open worlds: error and stated deviation along the filter's most uncertain direction."""
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
    """Head of the table whose lines are made by `row`."""
    names = (
        "runs | seeds | mean NEES | 95 % band | NEES of the scatter | times within | rms error | stated | mean error"
    )
    return f"| {names} |\n" + "|---" * 9 + "|"


def weak_head() -> str:
    """Head of the table whose lines are made by `weak_direction`."""
    return "| world | rms error | rms stated | worst error | stated there | within 95 % | NEES |\n" + "|---" * 7 + "|"


def picture(studies: dict[str, list[Consistency]], sweep: SweepTable) -> Figure:
    """Mean NEES over time in short runs, with and without errors of the lidar, and along whole tours; 95 % bands."""
    figure = Figure(figsize=(8.6, 3.4))
    left, right = figure.subplots(1, 2)
    for name, label, colour in (
        ("short", "default", ESTIMATE),
        ("short, no noise of the lidar", "lidar without errors", ODOMETRY),
    ):
        left.plot(*mean_over_time(studies[name]), color=colour, label=label)
    _draw_band(left, STUDIES["short"].seeds)
    left.set(xlabel="time in the office [s]", ylim=(0.0, None))
    for name, colour in LONG.items():
        nees_of = sweep.curves["nees"][sweep.places.index(name), 0, 0]
        right.plot(100.0 * CURVE_GRID, np.nanmean(nees_of, axis=0), color=colour, label=name)
    _draw_band(right, len(sweep.seeds))
    right.set(xlabel="share of the tour [%]", yscale="log")
    return figure


def _draw_band(ax: Axes, seeds: int) -> None:
    ax.axhspan(*band(seeds), color="#d3f9d8", lw=0, zorder=0)
    ax.axhline(3.0, color=QUIET, lw=0.8, zorder=1)
    ax.set_ylabel("mean NEES")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)


def main() -> None:
    """Compute the missing runs, write the tables into the page and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="directory of the runs")
    parser.add_argument("worlds", type=Path, help="directory that tools.measure.measure_worlds wrote")
    args = parser.parse_args()
    args.runs.mkdir(parents=True, exist_ok=True)
    studies = {name: runs_of(name, args.runs) for name in STUDIES}
    closed_rows = [row(name, runs) for name, runs in studies.items() if name not in OPEN]
    write_table(PAGE, "nees", "\n".join([row_head(), *closed_rows]))
    open_rows = [weak_direction(name, runs) for name, runs in studies.items() if name in OPEN]
    write_table(PAGE, "open", "\n".join([weak_head(), *open_rows]))
    with rc_context(STYLE):
        picture(studies, read_sweep(args.worlds)).savefig(PICTURE, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
