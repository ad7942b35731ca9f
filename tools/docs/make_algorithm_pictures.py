# SPDX-License-Identifier: MIT
"""Draw the pictures of docs/algorithm.md, each from a real run over the Intel log with default settings and seed 0.

    python -m tools.measure.measure_variants RUNS
    python -m tools.docs.make_algorithm_pictures RUNS

Writes: docs/pictures/algorithm_*.png

RUNS holds the paths and the maps of the variants. The other pictures show steps of the filter on the first scans of the
log, which are mapped twice: the first time to find the steps to show, the second time to draw them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eval.map.grids import cell_centres
from eval.report.map_images import UNSEEN, draw_map, frame_around
from eval.report.plots import BAD, ESTIMATE, GOOD, ODOMETRY, QUIET, STYLE, TRUTH
from slam import se2
from slam.config import FilterConfig
from slam.gmapping import GMapping
from slam.matching.proposal import ProposalResult
from slam.motion.odometry_model import motion_prior
from slam.occupancy import OccupancyGrid
from slam.particles.weights import Weights
from slam.se2 import Pose
from slam.sensor.rays import make_rays
from testbed.frame import Frame
from testbed.seeds import RunSeeds
from tools.measure.measure_variants import TABLES, recording

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
SCANS = 900
"""Steps are chosen from this many scans at the start of the log."""
SEED = 0
FAMILY_COLOURS = (ESTIMATE, ODOMETRY, GOOD, BAD, TRUTH, "#862e9c", "#0b7285", QUIET)
"""One colour for each family of particles."""


@dataclass(frozen=True, eq=False)
class Step:
    """One pass of Algorithm 1, with the values that the filter does not keep."""

    number: int
    """Number of the update; the first scan is update 0."""
    frame: Frame
    motion: Pose
    """Displacement by odometry since the last step, (3,)."""
    predicted: Pose
    """Poses predicted by odometry, (particles, 3)."""
    proposed: ProposalResult
    weights: NDArray[np.float64]
    """Before resampling, (particles,)."""
    resampled: bool
    loop_closed: bool


def steps(frames: Iterable[Frame], mapper: GMapping) -> Iterator[Step]:
    """Feed the filter and yield one step for each update after the first."""
    number, odometry = 0, np.zeros(3)
    share = mapper.config.match.weight_share
    for frame in frames:
        if frame.scan is None:
            continue
        poses, weights = mapper.poses, mapper.weights
        report = mapper.process(frame.odometry, frame.scan, twist=frame.twist)
        if report.proposed is not None:
            motion = se2.between(odometry, frame.odometry)
            number += 1
            yield Step(
                number=number,
                frame=frame,
                motion=motion,
                predicted=se2.compose(poses, motion),
                proposed=report.proposed,
                weights=Weights(np.log(weights)).times(share * report.proposed.log_gain)[0].values,
                resampled=report.resampled,
                loop_closed=report.loop_closed,
            )
        if report.updated:
            odometry = frame.odometry


def new_filter() -> GMapping:
    """The filter of all pictures."""
    return GMapping(FilterConfig(), seed=RunSeeds.from_seed(SEED).filter)


def corrections(step: Step) -> NDArray[np.float64]:
    """How far matching moved each particle [m], (particles,)."""
    moved = se2.between(step.predicted, step.proposed.mean)
    length: NDArray[np.float64] = np.hypot(moved[:, 0], moved[:, 1])
    return length


def hits(step: Step) -> NDArray[np.float64]:
    """End points of the scan in the robot's frame [m], (k, 2)."""
    assert step.frame.scan is not None
    rays = make_rays([step.frame.scan], usable_range=FilterConfig().map.usable_range)
    return rays.ends[rays.hit]


def main() -> None:
    """Draw all pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="directory that tools.measure.measure_variants wrote")
    runs = parser.parse_args().runs
    frames = [frame for frame in recording("intel", SEED).frames if frame.scan is not None]
    looked_at = list(steps(frames[:SCANS], new_filter()))
    matched = max(looked_at, key=lambda step: float(corrections(step).max()))
    particle = int(np.argmax(corrections(matched)))
    resampled = next(step for step in looked_at if step.resampled)
    closing = next(step for step in looked_at if step.loop_closed)
    with rc_context(STYLE):
        save(odometry_picture(runs), "odometry")
        save(proposal_picture(matched, particle), "proposal")
        mapper = new_filter()
        for step in steps(frames[:SCANS], mapper):
            if step.number == matched.number - 1:
                save(match_picture(matched, particle, mapper.map(particle)), "match")
            if step.number == resampled.number:
                save(resampling_picture(resampled, mapper.poses), "resampling")
            if step.number == closing.number:
                save(loop_picture(closing, mapper), "loop")
                save(ancestry_picture(mapper, [s.number for s in looked_at if s.resampled]), "ancestry")
        for place in ("intel-1500", "office"):
            save(variants_picture(runs, place), f"variants_{place.split('-')[0]}")


def save(figure: Figure, name: str) -> None:
    """Write one picture."""
    figure.savefig(PICTURES / f"algorithm_{name}.png", dpi=110, metadata={"Software": None})


def show_map(ax: Axes, grid: OccupancyGrid, window: Sequence[float] | None = None, faint: float = 1.0) -> None:
    """A map in equal axes; window = x, x, y, y to show [m]; faint = strength of the map, 0 to 1."""
    picture = draw_map(grid, frame_around(grid, np.zeros(3), [], 1.0), np.zeros(3))
    pixels = (255.0 - faint * (255.0 - picture.pixels)).astype(np.uint8)
    ax.imshow(pixels, extent=picture.extent, interpolation="nearest", zorder=0)
    ax.set_aspect("equal")
    ax.grid(False)
    if window is not None:
        ax.set_xlim(window[0], window[1])
        ax.set_ylim(window[2], window[3])


def around(points: NDArray[np.float64], margin: float) -> tuple[float, float, float, float]:
    """The window that holds points (k, 2) with a margin [m]."""
    (left, low), (right, high) = points.min(axis=0) - margin, points.max(axis=0) + margin
    return left, right, low, high


def odometry_picture(runs: Path) -> Figure:
    """Draw the odometry path and the filter's path over the filter's map."""
    run = np.load(runs / f"intel-1500-default-{SEED}.npz")
    figure = Figure(figsize=(6.4, 5.2))
    ax = figure.add_subplot()
    show_map(ax, grid_of(run), faint=0.5)
    start = se2.compose(run["path"][0], se2.between(run["odometry"][0], run["odometry"]))
    ax.plot(start[:, 0], start[:, 1], color=ODOMETRY, lw=1.0, label="odometry alone")
    ax.plot(run["path"][:, 0], run["path"][:, 1], color=ESTIMATE, lw=1.0, label="the filter's path")
    ax.autoscale()
    ax.set(xlabel="x [m]", ylabel="y [m]")
    ax.legend(loc="upper right")
    return figure


def match_picture(step: Step, particle: int, grid: OccupancyGrid) -> Figure:
    """Draw the scan over a particle's map, at the predicted pose and at the matched pose."""
    figure = Figure(figsize=(8.0, 4.2))
    ends = se2.transform_points(step.proposed.mean[particle], hits(step))
    window = around(np.clip(ends, *_box(step.proposed.mean[particle], 5.0)), 0.5)
    places = {
        "predicted by odometry": (step.predicted[particle], BAD),
        "after matching": (step.proposed.mean[particle], ESTIMATE),
    }
    for k, (name, (pose, colour)) in enumerate(places.items()):
        ax = figure.add_subplot(1, 2, k + 1)
        show_map(ax, grid, window)
        ends = se2.transform_points(pose, hits(step))
        ax.plot(ends[:, 0], ends[:, 1], "o", ms=3.0, mew=0.0, color=colour)
        nose = se2.transform_points(pose, [[0.5, 0.0]])[0]
        ax.plot([pose[0], nose[0]], [pose[1], nose[1]], color=colour, lw=2.0)
        ax.plot(pose[0], pose[1], "o", ms=8, mfc="white", mec=colour, mew=2.0)
        ax.set(title=name, xlabel="x [m]", ylabel="y [m]" if k == 0 else "")
    return figure


def _box(pose: Pose, reach: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return pose[:2] - reach, pose[:2] + reach


def proposal_picture(step: Step, particle: int) -> Figure:
    """Draw the motion model's density, the fitted Gaussian, and the K poses that it was fitted to."""
    guess, mean = step.predicted[particle], step.proposed.mean[particle]
    to_heading = 1000.0 * np.array([[np.cos(guess[2]), np.sin(guess[2])], [-np.sin(guess[2]), np.cos(guess[2])]])
    samples = (step.proposed.samples[particle, :, :2] - mean[:2]) @ to_heading.T
    predicted, drawn = to_heading @ (guess[:2] - mean[:2]), to_heading @ (step.proposed.pose[particle, :2] - mean[:2])
    fitted = to_heading @ step.proposed.covariance[particle][:2, :2] @ to_heading.T
    prior = motion_prior(step.motion, FilterConfig().motion)
    figure = Figure(figsize=(8.0, 3.9))
    wide, near = figure.subplots(1, 2)
    for component, name, dashes in ((0, "odometry, good", "-"), (1, "odometry, failed", "--")):
        covariance = np.diag(1e6 / prior.precision[component, :2])
        ellipse(wide, predicted, covariance, 2.0, ODOMETRY, f"{name}: 2 sigma", dashes)
    wide.plot(*predicted, "+", ms=9, mew=1.8, color=ODOMETRY)
    ellipse(wide, np.zeros(2), fitted, 2.0, ESTIMATE, "fitted Gaussian: 2 sigma")
    near.plot(samples[:, 0], samples[:, 1], "o", ms=4.5, mew=0.0, color=QUIET, label="the K poses")
    ellipse(near, np.zeros(2), fitted, 1.0, ESTIMATE, "1 and 2 sigma")
    ellipse(near, np.zeros(2), fitted, 2.0, ESTIMATE)
    near.plot(*drawn, "*", ms=13, mec="white", color=BAD, label="the new pose")
    for ax in (wide, near):
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(xlabel="along the heading [mm]", ylabel="across [mm]" if ax is wide else "")
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=1 if ax is wide else 3, handletextpad=0.4)
    return figure


def ellipse(
    ax: Axes, centre: NDArray[np.float64], covariance: NDArray[np.float64], sigmas: float, colour: str,
    label: str | None = None, dashes: str = "-",
) -> None:  # fmt: skip
    """Draw the curve `sigmas` standard deviations away from a centre (2,) with covariance (2, 2)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    x, y = centre[:, None] + sigmas * np.linalg.cholesky(covariance) @ np.stack([np.cos(angle), np.sin(angle)])
    ax.plot(x, y, color=colour, ls=dashes, label=label)


def resampling_picture(step: Step, after: Pose) -> Figure:
    """Draw particles before and after resampling: area = weight, one colour for each particle that has offspring."""
    before = step.proposed.pose
    offspring = (after[:, None, :2] == before[None, :, :2]).all(axis=2).sum(axis=0)
    colours = np.array([QUIET] * len(before), dtype=object)
    parents = np.flatnonzero(offspring)
    colours[parents] = [FAMILY_COLOURS[k % len(FAMILY_COLOURS)] for k in range(len(parents))]
    figure = Figure(figsize=(8.0, 3.8))
    left, right = figure.subplots(1, 2)
    centre = step.weights @ before[:, :2]
    at = (before[:, :2] - centre) * 100.0
    left.scatter(at[:, 0], at[:, 1], s=2500.0 * step.weights, c=list(colours), alpha=0.75, lw=0)
    for k in np.flatnonzero(offspring == 0):
        left.plot(*at[k], "x", ms=5, color=QUIET)
    right.scatter(
        at[parents, 0],
        at[parents, 1],
        s=2500.0 * offspring[parents] / len(before),
        c=list(colours[parents]),
        alpha=0.75,
        lw=0,
    )
    for k in parents:
        right.annotate(f"{offspring[k]}", at[k], ha="center", va="center", fontsize=8.5, color="white", weight="bold")
    ess = 1.0 / np.sum(step.weights**2)
    left.set(title=f"before: weights, effective sample size {ess:.1f} of {len(before)}", ylabel="y [cm]")
    right.set(title=f"after: {len(parents)} particles have offspring (number inside)")
    edge = 1.15 * float(np.abs(at).max())
    for ax in (left, right):
        ax.set_aspect("equal")
        ax.set(xlabel="x [cm]", xlim=(-edge, edge), ylim=(-edge, edge))
        ax.title.set_fontsize(10)
    return figure


def families(paths: Pose) -> NDArray[np.int64]:
    """Index of the oldest distinct ancestor of each path (particles, steps, 3), (particles,)."""
    first = next(k for k in range(paths.shape[1]) if len(np.unique(paths[:, k], axis=0)) > 1)
    return np.unique(paths[:, first], axis=0, return_inverse=True)[1].reshape(-1)


def loop_picture(step: Step, mapper: GMapping) -> Figure:
    """Draw the maps of three particles from different families when a loop closes."""
    paths = np.stack([mapper.path(particle) for particle in range(mapper.config.particles)])
    family = families(paths)
    heaviest = [int(np.flatnonzero(family == f)[np.argmax(step.weights[family == f])]) for f in np.unique(family)]
    heaviest.sort(key=lambda particle: -step.weights[particle])
    best = heaviest[0]
    apart = {p: float(np.linalg.norm(mapper.poses[p, :2] - mapper.poses[best, :2])) for p in heaviest}
    shown = [best, *sorted(heaviest[1:], key=lambda p: -apart[p])[:2]]
    figure = Figure(figsize=(9.4, 3.7))
    together, *alone = figure.subplots(1, 3)
    window = around(mapper.poses[shown, :2], 6.0)
    for particle, colour in zip(shown, (TRUTH, ODOMETRY, ESTIMATE), strict=True):
        grid = mapper.map(particle)
        walls = cell_centres(grid, grid.occupied)
        together.plot(walls[:, 0], walls[:, 1], "s", ms=1.3, mew=0.0, color=colour)
        together.plot(*mapper.poses[particle, :2], "o", ms=7, mfc="white", mec=colour, mew=1.8)
    together.set(title="walls of three particles", ylabel="y [m]", xlim=window[:2], ylim=window[2:], aspect="equal")
    together.grid(False)
    for ax, particle, name in zip(alone, shown, ("black particle", "orange particle"), strict=False):
        show_map(ax, mapper.map(particle), window)
        ax.plot(paths[particle, :, 0], paths[particle, :, 1], color=ESTIMATE, lw=1.1)
        ends = se2.transform_points(mapper.poses[particle], hits(step))
        ax.plot(ends[:, 0], ends[:, 1], "o", ms=2.2, mew=0.0, color=BAD)
        ax.plot(*mapper.poses[particle, :2], "o", ms=7, mfc="white", mec=ESTIMATE, mew=1.8)
        weight = 100.0 * step.weights[particle]
        ax.set(title=f"{name}: weight {f'{weight:.1f}' if weight >= 0.1 else 'below 0.1'} %")
    for ax in (together, *alone):
        ax.set(xlabel="x [m]")
        ax.title.set_fontsize(10)
    return figure


def ancestry_picture(mapper: GMapping, resampled: Sequence[int]) -> Figure:
    """Draw the ancestry tree: each line is a history that at least one particle still has."""
    paths = np.stack([mapper.path(particle) for particle in range(mapper.config.particles)])
    groups = np.stack([np.unique(poses, axis=0, return_inverse=True)[1].reshape(-1) for poses in paths.swapaxes(0, 1)])
    order = np.lexsort(groups[::-1])  # by the oldest difference first: branches do not cross
    rank = np.empty(len(order))
    rank[order] = np.arange(len(order))
    height = np.array([[rank[row == g].mean() for g in row] for row in groups])  # (steps, particles)
    figure = Figure(figsize=(8.0, 3.6))
    ax = figure.add_subplot()
    for particle, family in enumerate(families(paths)):
        ax.plot(height[:, particle], color=FAMILY_COLOURS[family % len(FAMILY_COLOURS)], lw=1.3)
    marks = [number for number in resampled if number < len(paths[0])]
    for number in marks:
        ax.axvline(
            number, color=QUIET, lw=1.0, ls=(0, (4, 2)), zorder=0, label="resampling" if number == marks[0] else None
        )
    ax.set(xlabel="scans taken in", ylabel="particles", yticks=[])
    ax.grid(False)
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


def grid_of(run: np.lib.npyio.NpzFile) -> OccupancyGrid:
    """Map of a run that tools.measure.measure_variants kept."""
    x, y, theta = run["origin"].tolist()
    return OccupancyGrid(probability=run["probability"], resolution=float(run["resolution"]), origin=(x, y, theta))


def variants_picture(runs: Path, place: str) -> Figure:
    """Draw the filter's own map of every variant, all on one scale."""
    maps = {name: np.load(runs / f"{place}-{name}-{SEED}.npz") for name in TABLES["variants"].variants.split(",")}
    window = around(maps["default"]["path"][:, :2], 4.5)
    figure = Figure(figsize=(11.0, 6.2))
    for ax, (name, run) in zip(figure.subplots(2, 4).flat, maps.items(), strict=True):
        show_map(ax, grid_of(run), window)
        ax.set(xticks=[], yticks=[], title=f"{name}: {100.0 * run['own'][0]:.1f} cm")
        ax.set_facecolor(UNSEEN)
        ax.spines[:].set_visible(False)
        ax.title.set_fontsize(10)
    return figure


if __name__ == "__main__":
    main()
