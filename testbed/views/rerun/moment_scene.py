# SPDX-License-Identifier: MIT
"""What is on the maps of one moment of a run: map, walls, paths, robots, scan, particles, and the proposal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eval.wording import length
from slam import se2
from slam.se2 import Pose
from testbed.views.map_cells import OCCUPIED_TO
from testbed.views.rerun import entities
from testbed.views.rerun.figure_parts import (
    DOT,
    draw_dots,
    draw_ellipse,
    draw_grid,
    draw_lines,
    draw_robot,
    passes_through,
    rgb,
    seen_from,
    show_around,
)
from testbed.views.rerun.recorded import (
    TIME,
    GridImage,
    Recorded,
    colours,
    ellipse,
    points,
    pose,
    strips,
)
from testbed.views.rerun.scene import styles

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAIR_WIDE = 1.3
"""Width of each of two moments side by side, as part of its height."""
MIN_REACH, MAX_REACH = 0.3, 4.0
"""The close view shows at least and at most so much around the robot [m]: its particles, and the true robot."""
MAX_TOGETHER = 3.0
"""Views that are compared show the same place where that is up to so many times what the widest of them needs."""
MIN_SCAN_REACH, MAX_SCAN_REACH = 1.5, 6.0
"""The view of two moments reaches at least so far [m], and has room for the end points within so far of the robot …"""
SCAN_SHARE = 0.95
"""… but for the outermost in each direction."""
MIN_PROPOSAL_REACH = 0.02
"""So does the view of the proposal, at least."""
MAX_PRIOR_REACH = 8.0
"""Where the prior lies far away, it is shown up to so many times what the samples take."""
MARGIN = 1.25
"""Both show so much more than what has to be seen."""
OWN_COVARIANCE = "95 % by the filter's own covariance, around the best"
BEST = "best particle: largest weight of its whole history"
TRUTH_THEN = "truth at the update of the particles"


class MomentScene:
    """Draws into axes what a recording holds at a time, in the world's frame. Times: seconds since the first scan."""

    def __init__(self, recorded: Recorded) -> None:
        self._recorded = recorded
        self.T_world_map = pose(recorded.fixed(entities.SLAM))
        self._T_world_odom = pose(recorded.fixed(entities.ODOMETRY))

    def draw_map(self, axes: Axes, shown: GridImage | None) -> None:
        """Draw the map in the world's frame, and the true walls."""
        if shown is not None:
            draw_grid(axes, shown, se2.compose(self.T_world_map, shown.pose))
        walls = self._recorded.fixed(entities.TRUE_WALLS)
        if walls:
            draw_lines(axes, strips(walls["LineStrips3D:strips"]), styles.TRUTH, 0.6)

    def draw_world(
        self, axes: Axes, time: float, robot: Pose, reach: float = math.inf, *, odometry: bool = True, dot: float = DOT
    ) -> None:
        """Draw paths, robots and scan in the world's frame; reach: how far around the robot is shown [m]; odometry:
        whether to draw its path; dot: size of an end point [pt]."""
        for entity, T, width, label in (
            (entities.TRUE_PATH, np.zeros(3), 3.6, "truth: path, robot, thin walls"),
            (entities.ODOMETRY_PATH, self._T_world_odom, 1.2, "odometry alone"),
            (entities.PATH, self.T_world_map, 1.6, "estimate: path, robot"),
        ):
            if entity == entities.ODOMETRY_PATH and not odometry:
                continue
            pieces = [name for name in self._recorded.names(entity) if self._recorded.latest(name, time) is not None]
            for name in pieces:
                row = self._recorded.latest(name, time)
                assert row is not None
                parts = [se2.transform_points(T, strip) for strip in strips(row["LineStrips3D:strips"]) if len(strip)]
                draw_lines(axes, parts, styles.PATHS[entity][0], width, label)
        true = self._recorded.latest(entities.TRUE_ROBOT, time)
        if true is not None:
            draw_robot(axes, self._recorded, entities.TRUE_ROBOT, pose(true), styles.TRUTH)
        draw_robot(axes, self._recorded, entities.ESTIMATED_ROBOT, robot, styles.ESTIMATE)
        scan = self._recorded.latest(entities.SCAN, time)
        if scan is not None:
            ends = se2.transform_points(robot, points(scan["Points3D:positions"]))
            near = np.hypot(*(ends - robot[:2]).T) <= 2.0 * reach
            draw_dots(axes, ends[near], styles.SCAN, "scan, from the estimated pose", dot)

    def robot(self, time: float) -> Pose:
        """The estimated pose of the robot in the world's frame, (3,)."""
        scan = self._recorded.latest(entities.ESTIMATED_ROBOT, time)
        assert scan is not None
        return se2.compose(self.T_world_map, pose(scan))

    def frame_around(self, time: float, framed: Sequence[float]) -> tuple[NDArray[np.float64], float]:
        """Centre (2,) of the close view at a time and how far it reaches [m]: the same for all the times `framed` where
        one view has room for all of them, else around the robot, as far as any of them needs."""
        centre, reach = self._frame_of(framed)
        needed = max(self._frame_of([other])[1] for other in framed)
        if reach > MAX_TOGETHER * needed:
            centre, reach = self._frame_of([time])[0], needed
        return centre, min(reach, MAX_REACH)

    def frame_of_scans(self, times: Sequence[float]) -> tuple[NDArray[np.float64], float]:
        """Centre (2,) of a view and how far up and down it reaches [m], so that it shows at each of these times the
        robot and most of what its scan sees near it."""
        robots = [self.robot(time) for time in times]
        shown = [np.array([robot[:2] for robot in robots])]
        for time, robot in zip(times, robots, strict=True):
            scan = self._recorded.latest(entities.SCAN, time)
            ends = np.zeros((0, 2)) if scan is None else se2.transform_points(robot, points(scan["Points3D:positions"]))
            near = ends[np.hypot(*(ends - robot[:2]).T) <= MAX_SCAN_REACH]
            if len(near):
                shown.append(np.quantile(near, [1.0 - SCAN_SHARE, SCAN_SHARE], axis=0))
        corners = np.concatenate(shown)
        low, high = corners.min(axis=0), corners.max(axis=0)
        half = MARGIN * 0.5 * (high - low)
        return 0.5 * (low + high), max(float(half[0]) / PAIR_WIDE, float(half[1]), MIN_SCAN_REACH)

    def _frame_of(self, times: Sequence[float]) -> tuple[NDArray[np.float64], float]:
        """Centre (2,) of a close view and how far it has to reach [m], so that it shows at each of these times the
        robot, the true one and the particles."""
        robots = np.array([self.robot(time)[:2] for time in times])
        centre, places = robots.mean(axis=0), [robots]
        for time in times:
            places.append(self._origins(self._recorded.latest(entities.PARTICLES, time)))
            true = self._recorded.latest(entities.TRUE_ROBOT, time)
            if true is not None:
                places.append(pose(true)[None, :2])
        far = float(np.hypot(*(np.concatenate(places) - centre).T).max())
        return centre, max(MARGIN * far, MIN_REACH)

    def draw_around(self, axes: Axes, time: float, centre: NDArray[np.float64], reach: float) -> None:
        """Draw the particles, their histories and the filter's ellipse, and all else, close up around a place (2,)."""
        T, robot = self.T_world_map, self.robot(time)
        particles = self._recorded.latest(entities.PARTICLES, time)
        origins = self._origins(particles)
        ended = self._recorded.latest(entities.DEAD_BRANCHES, time)
        dead = [] if ended is None else [line for line in strips(ended["LineStrips3D:strips"]) if len(line)]
        dead = [se2.transform_points(T, line) for line in dead]
        if len(origins) > 1:
            for lines, colour, width, label in (
                (dead, styles.DEAD, 3.0, "histories that ended at the last resampling"),
                (self._histories(time), styles.FAN, 0.8, "histories of the particles"),
            ):
                seen = any(passes_through(line, centre, reach) for line in lines)
                draw_lines(axes, lines, colour, width, label if seen else None)
        self.draw_world(axes, time, robot, reach)
        spread = self._recorded.latest(entities.COVARIANCE, time)
        if spread is not None:
            own = seen_from(T, ellipse(spread))  # about the best particle
            draw_ellipse(axes, own, styles.COVARIANCE, OWN_COVARIANCE)
            if len(origins) > 1:
                axes.plot(*own.centre, "o", ms=9.0, mfc="none", mec="black", mew=1.4, ls="", zorder=8, label=BEST)
            then = self._recorded.latest(entities.TRUE_ROBOT, spread[TIME])
            if then is not None:
                axes.plot(
                    *pose(then)[:2], "P", color=rgb(styles.TRUTH), ms=7.0, mec="white", zorder=9, label=TRUTH_THEN
                )
        if particles is not None:
            turned = se2.transform_points([0.0, 0.0, T[2]], points(particles["Arrows3D:vectors"]))
            turned *= 0.25 * reach / np.maximum(np.hypot(*turned.T), 1e-9)[:, None]
            shades = colours(particles["Arrows3D:colors"])
            axes.quiver(
                *origins.T,
                *turned.T,
                color=shades,
                angles="xy",
                scale_units="xy",
                scale=1.0,
                width=0.004,
                zorder=6,
                label="particles: light blue to red, the heaviest",
            )
            axes.scatter(origins[:, 0], origins[:, 1], s=12, color=shades, zorder=7)
        show_around(axes, centre, reach)

    def draw_proposal(self, axes: Axes, time: float, reach: float) -> None:
        """Draw how the best particle's new pose was found; reach: how far around it is shown [m]."""
        T = self.T_world_map
        names = (entities.PROPOSAL_PRIOR, entities.PROPOSAL_SAMPLES, entities.PROPOSAL_GAUSSIAN)
        prior, samples, gaussian = (self._recorded.latest(name, time) for name in names)
        optimum, scan = (
            self._recorded.latest(name, time) for name in (entities.PROPOSAL_OPTIMUM, entities.PROPOSAL_SCAN)
        )
        found = np.zeros((0, 2)) if samples is None else points(samples["Points3D:positions"])
        if gaussian is None or samples is None or len(found) == 0:
            axes.set_axis_off()
            axes.text(0.5, 0.5, "no proposal at this time", ha="center", va="center", transform=axes.transAxes)
            return
        fitted, found = seen_from(T, ellipse(gaussian)), se2.transform_points(T, found)
        if scan is not None and optimum is not None:
            ends = se2.transform_points(se2.compose(T, pose(optimum)), points(scan["Points3D:positions"]))
            draw_dots(axes, ends, styles.SCAN)
        shades = colours(samples["Points3D:colors"])
        axes.scatter(found[:, 0], found[:, 1], s=26, color=shades, zorder=6, label="samples, by weight")
        draw_ellipse(axes, fitted, styles.PROPOSAL, "Gaussian fitted to the samples, 95 %")
        if prior is not None:
            around = seen_from(T, ellipse(prior))
            draw_ellipse(axes, around, styles.ODOMETRY, "prior: odometry's prediction, 95 %")
            off = float(np.hypot(*(around.centre - fitted.centre)))
            if MARGIN * (off + float(around.half.max())) > reach + 1e-9:
                words = f"the prior lies {length(off)} away"
                axes.text(0.02, 0.96, words, va="top", transform=axes.transAxes, color=rgb(styles.ODOMETRY))
        show_around(axes, fitted.centre, reach)

    def reach_of_proposal(self, time: float) -> float:
        """How far the view of the proposal has to reach around the fitted Gaussian [m]: to all samples, and to the
        prior unless that lies far away; the least where there is no proposal."""
        names = (entities.PROPOSAL_PRIOR, entities.PROPOSAL_SAMPLES, entities.PROPOSAL_GAUSSIAN)
        prior, samples, gaussian = (self._recorded.latest(name, time) for name in names)
        found = np.zeros((0, 2)) if samples is None else points(samples["Points3D:positions"])
        if gaussian is None or len(found) == 0:
            return MIN_PROPOSAL_REACH
        fitted = ellipse(gaussian)
        far = float(np.hypot(*(found - fitted.centre).T).max())
        reach = max(MARGIN * max(far, float(fitted.half.max())), MIN_PROPOSAL_REACH)
        if prior is None:
            return reach
        around = ellipse(prior)
        needed = MARGIN * (float(np.hypot(*(around.centre - fitted.centre))) + float(around.half.max()))
        return min(max(reach, needed), MAX_PRIOR_REACH * reach)

    def show_all_of_the_map(self, axes: Axes, shown: GridImage | None) -> None:
        """Show the whole extent of the true walls and of those of the map, or of the whole path, whatever the time."""
        walls = self._recorded.fixed(entities.TRUE_WALLS)
        if walls:
            ends = np.concatenate(strips(walls["LineStrips3D:strips"]))
            if shown is not None:
                rows, columns = np.nonzero(shown.image <= OCCUPIED_TO)
                places = np.column_stack([columns + 0.5, shown.image.shape[0] - rows - 0.5]) * shown.cell
                places = se2.transform_points(se2.compose(self.T_world_map, shown.pose), places)
                ends = np.concatenate([ends, places])
        else:
            parts = [
                se2.transform_points(self.T_world_map, strip)
                for name in self._recorded.names(entities.PATH)
                if (row := self._recorded.latest(name, math.inf)) is not None
                for strip in strips(row["LineStrips3D:strips"])
                if len(strip)
            ]
            ends = np.concatenate(parts) if parts else np.zeros((1, 2))
            ends = np.concatenate([ends - 5.0, ends + 5.0])
        (left, low), (right, high) = ends.min(axis=0) - 0.6, ends.max(axis=0) + 0.6
        axes.set(xlim=(left, right), ylim=(low, high), xlabel="x [m]", ylabel="y [m]")

    def _origins(self, particles: dict[str, Any] | None) -> NDArray[np.float64]:
        """Positions of the particles of a row in the world's frame, (n, 2) [m]."""
        origins = np.zeros((0, 2)) if particles is None else points(particles["Arrows3D:origins"])
        return se2.transform_points(self.T_world_map, origins)

    def _histories(self, time: float) -> list[NDArray[np.float64]]:
        """The tree of the particles' histories as lines (n, 2) in the world's frame: as it was last logged, and from
        there through the particles of each update. Between two resamplings particle i stays particle i, and each
        resampling logs the tree; in a known map, where that is not so, only the tree."""
        tree = self._recorded.latest(entities.PARTICLE_PATHS, time)
        lines = [] if tree is None else [line for line in strips(tree["LineStrips3D:strips"]) if len(line)]
        lines = [se2.transform_points(self.T_world_map, line) for line in lines]
        if len(self._recorded.times(entities.LOCALIZATION_STATE)):
            return lines
        since = self._recorded.between(entities.PARTICLES, 0.0 if tree is None else tree[TIME], time)
        places = [self._origins(row) for row in since]
        if len({len(part) for part in places}) != 1:
            return lines
        return lines + list(np.stack(places, axis=1))
