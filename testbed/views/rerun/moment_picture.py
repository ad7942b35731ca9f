# SPDX-License-Identifier: MIT
"""One moment of a run as a picture: the map so far, the robot with its particles and the proposal close up, and curves.

It shows what the viewer shows at that time, and needs no display.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eval.wording import length
from slam import se2
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.views.map_cells import OCCUPIED_TO, probability_of_greys
from testbed.views.rerun import drawing, entities
from testbed.views.rerun.drawing import ELLIPSE_SIGMAS
from testbed.views.rerun.figure_parts import (
    DOT,
    as_png,
    draw_dots,
    draw_ellipse,
    draw_lines,
    legend_mark,
    passes_through,
    rgb,
    seen_from,
    show_around,
    title_left,
)
from testbed.views.rerun.now import MIN_DEVIATION, in_words
from testbed.views.rerun.other_particles import OtherParticle, first_comparison, map_at, other_particles
from testbed.views.rerun.recorded import (
    TIME,
    Event,
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
    from matplotlib.figure import Figure, SubFigure

WIDTH = 13.0
"""Width [inch]."""
MAPS_HEIGHT, OTHERS_HEIGHT, CURVES_HEIGHT = 6.2, 3.4, 1.5
"""Heights of the map with the close views, of the maps of other particles, and of the curves [inch]."""
WORDS_HEIGHT = 0.35
"""Height of a line that stands for the maps of other particles before their first comparison [inch]."""
PAIR_HEIGHT = 5.6
"""Height of two moments side by side [inch]."""
PAIR_WIDE = 1.3
"""Width of each of two moments side by side, as part of its height."""
MARGIN_HEIGHT = 1.5
"""Height of headline and legend [inch]."""
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
POSITION_ERROR = "Position error"
LEVELS = ("INFO", "WARN", "ERROR")
"""Of several events at one time the one of the highest level is printed, a change of the best particle last."""
OWN_COVARIANCE = "95 % by the filter's own covariance, around the best"
BEST = "best particle: largest weight of its whole history"
TRUTH_THEN = "truth at the update of the particles"
RECENT_EVENT_S = 20.0
"""The last event is printed for this long [s]."""
LOOK: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
"""Settings for `rc_context`."""
UNSEEN = tuple(part / 255.0 for part in styles.UNSEEN)


def _weight(event: Event) -> tuple[float, int, bool]:
    """Of two events the one with the larger weight is printed."""
    return event.time, LEVELS.index(event.level), not event.text.startswith(entities.ANOTHER_BEST_EVENT)


class MomentPictures:
    """Draws moments of one run from its recording. Times are seconds since the first scan."""

    def __init__(self, recording: Path) -> None:
        """Read the recording; raises ValueError that names it where it is none of a run."""
        self._recorded = Recorded(recording)
        if self._recorded.latest(entities.ESTIMATED_ROBOT, math.inf) is None:
            raise ValueError(f"{recording}: expected the recording of a run, with an estimated pose")
        self._T_world_map = pose(self._recorded.fixed(entities.SLAM))
        self._T_world_odom = pose(self._recorded.fixed(entities.ODOMETRY))
        self.end = float(self._recorded.latest(entities.ESTIMATED_ROBOT, math.inf)[TIME])  # type: ignore[index]

    @property
    def another_best(self) -> NDArray[np.float64]:
        """Times at which the pose while driving moved because another particle became the best, in seconds since the
        first scan, (n,); empty without truth."""
        return self._recorded.times(entities.ANOTHER_BEST)

    def png(self, time: float, compared_with: Sequence[float] = ()) -> bytes:
        """Draw the moment as a PNG; a time before the first scan or after the last one shows that scan.

        compared_with: the times of other pictures; the close views of all are on one scale, and show the same place
        where the robot has hardly moved between
        """
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        time = self._within(time)
        framed = [time, *map(self._within, compared_with)]
        with rc_context(LOOK):
            others = other_particles(self._recorded, time)
            words = "" if others else self._before_comparison(time)
            others_height = OTHERS_HEIGHT if others else WORDS_HEIGHT
            heights = [MAPS_HEIGHT, *([others_height] if others or words else []), CURVES_HEIGHT]
            figure = Figure(figsize=(WIDTH, sum(heights) + MARGIN_HEIGHT), layout="constrained")
            parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights)
            figure.suptitle(self._headline(time), x=0.01, ha="left", fontsize=11.0)
            self._draw_maps(figure, parts[0], time, framed)
            self._draw_curves(parts[-1], time)
            if others:
                self._draw_others(parts[1], others)
            elif words:
                parts[1].suptitle(words, x=0.01, ha="left", fontsize=10.0, color="grey")
            return as_png(figure)

    def side_by_side(self, before: float, at: float) -> bytes:
        """Draw two moments as one PNG: map, paths, robots and scan, around the same place on one scale, wide enough for
        the walls that the scan meets."""
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        times = [self._within(time) for time in (before, at)]
        centre, reach = self._frame_of_scans(times)
        with rc_context(LOOK):
            figure = Figure(figsize=(WIDTH, PAIR_HEIGHT), layout="constrained")
            axes_of: Any = figure.subplots(1, 2)
            for axes, time in zip(axes_of, times, strict=True):
                error = self._recorded.latest(entities.POSITION_ERROR, time)
                off = "" if error is None else f": the estimate is {length(error['Scalars:scalars'].as_py()[0])} off"
                axes.set(title=f"{time:.1f} s{off}", aspect="equal", facecolor=UNSEEN)
                title_left(axes)
                self._draw_map(axes, map_at(self._recorded, entities.MAP, time))
                self._draw_world(axes, time, self._robot(time), PAIR_WIDE * reach, odometry=False, dot=2.0 * DOT)
                show_around(axes, centre, reach, PAIR_WIDE)
            handles, labels = axes_of[0].get_legend_handles_labels()
            named = dict(zip(labels, handles, strict=True))
            figure.legend(
                named.values(),
                named.keys(),
                loc="outside lower left",
                ncols=4,
                frameon=False,
                fontsize=8.5,
                markerscale=2,
            )
            return as_png(figure)

    def map_at(self, time: float) -> OccupancyGrid | None:
        """The best particle's map at a time, in the map's frame; None before the first one."""
        shown = map_at(self._recorded, entities.MAP, self._within(time))
        if shown is None:
            return None
        x, y, theta = shown.pose.tolist()
        grid = probability_of_greys(shown.image[::-1])
        return OccupancyGrid(probability=grid, resolution=shown.cell, origin=(x, y, theta))

    def _within(self, time: float) -> float:
        """A time within the run [s]."""
        return min(max(time, 0.0), self.end)

    def _before_comparison(self, time: float) -> str:
        """Words that stand where the maps of other particles will; empty from their first comparison on, and where the
        run has none."""
        first = first_comparison(self._recorded)
        return f"Maps of other particles: first compared at {first:.1f} s" if first is not None and first > time else ""

    def _draw_maps(self, figure: Figure, part: SubFigure, time: float, framed: Sequence[float]) -> None:
        """Draw the map so far and the two close views into a part of the figure, and the legend below it all; framed:
        the times for which the close views have room."""
        from matplotlib.legend_handler import HandlerTuple

        robot = self._robot(time)
        shown = map_at(self._recorded, entities.MAP, time)
        halves: Any = part.subfigures(1, 2, width_ratios=[1.35, 1.0])
        left, right = halves
        overview, around, close = left.add_subplot(), right.add_subplot(2, 1, 1), right.add_subplot(2, 1, 2)
        for axes, title in (
            (overview, "Map so far"),
            (around, f"Around the robot: the particles{self._age_of_particles(time)}"),
            (close, "The proposal of the best particle"),
        ):
            axes.set(title=title, aspect="equal", facecolor=UNSEEN)
            title_left(axes)
            self._draw_map(axes, shown)
        self._draw_world(overview, time, robot)
        self._draw_around(around, time, *self._frame_around(time, framed))
        self._draw_proposal(close, time, max(map(self._reach_of_proposal, framed)))
        self._show_all_of_the_map(overview, shown)
        handles: dict[str, Any] = {}
        for axes in (overview, around, close):
            handles |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
        for label, style in (("particles: light blue to red, the heaviest", ">"), ("samples, by weight", "o")):
            if label in handles:  # whose own mark has the weight of one of them
                handles[label] = tuple(legend_mark(style, colour) for colour in (drawing.LIGHT, drawing.HEAVY))
        if len(self.another_best):
            handles["another particle became the best (in the position error)"] = legend_mark("D", styles.PROPOSAL)
        figure.legend(
            handles.values(),
            handles.keys(),
            handler_map={tuple: HandlerTuple(ndivide=None)},
            loc="outside lower left",
            ncols=4,
            frameon=False,
            fontsize=8.5,
        )

    def _draw_others(self, part: SubFigure, others: Sequence[OtherParticle]) -> None:
        """Draw the maps of other particles side by side."""
        part.suptitle(
            "Maps of other particles when they were last compared; red: walls of which the map of the best one then "
            "has none within 10 cm",
            x=0.01,
            ha="left",
            fontsize=10.0,
        )
        for number, other in enumerate(others):
            axes = part.add_subplot(1, len(others), number + 1)
            axes.set_title(other.title, fontsize=9.0)
            axes.set(aspect="equal", facecolor=UNSEEN)
            title_left(axes)
            self._draw_map(axes, other.map)
            rows, columns = np.nonzero(other.elsewhere)
            places = np.column_stack([columns + 0.5, other.map.image.shape[0] - rows - 0.5]) * other.map.cell
            places = se2.transform_points(se2.compose(self._T_world_map, other.map.pose), places)
            axes.plot(*places.T, "s", ms=2.0, color=rgb(styles.RED), mew=0.0, zorder=4)
            self._show_all_of_the_map(axes, other.map)
            axes.set(xlabel="", ylabel="", xticks=[], yticks=[])

    def _draw_curves(self, part: SubFigure, time: float) -> None:
        """Draw the curves over time side by side."""
        curves = self._curves()
        for number, (name, unit, times, values, colour) in enumerate(curves):
            axes = part.add_subplot(1, len(curves), number + 1)
            axes.plot(times, values, color=colour, lw=1.1)
            if name == POSITION_ERROR and len(jumps := self.another_best):
                at = np.searchsorted(times, jumps - 1e-3).clip(max=len(times) - 1)
                axes.plot(times[at], values[at], "D", ms=3.5, mew=0.0, color=rgb(styles.PROPOSAL))
            axes.axvline(time, color="black", lw=1.0, ls=(0, (4, 2)))
            reach = f", up to {np.nanmax(values):.3g}{f' {unit}' if unit else ''}" if len(values) else ""
            axes.set(title=f"{name}{reach}; line: now", xlim=(0.0, self.end), ylim=(0.0, None))
            axes.set_xlabel("time since the first scan [s]")
            axes.margins(y=0.1)

    def _age_of_particles(self, time: float) -> str:
        """How long ago the last update was, in words; empty where it was just now."""
        row = self._recorded.latest(entities.PARTICLES, time)
        scan = self._recorded.latest(entities.ESTIMATED_ROBOT, time)
        if row is None or scan is None or scan[TIME] - row[TIME] < 0.05:
            return ""
        return f" {scan[TIME] - row[TIME]:.1f} s before"

    def _headline(self, time: float) -> str:
        """The moment in figures, and the last event."""
        found = []
        for entity, words, scale, unit in (
            (entities.POSITION_ERROR, "position error", 100.0, " cm"),
            (entities.HEADING_ERROR, "heading error", 1.0, "°"),
            (entities.SPREAD, "spread of the particles", 1.0, " cm"),
        ):
            row = self._recorded.latest(entity, time)
            if row is not None:
                found.append(f"{words} {scale * row['Scalars:scalars'].as_py()[0]:.1f}{unit}")
        if size := self._sample_size(time):
            found.append(size)
        states = []
        for lane, words in ((entities.ESTIMATE_STATE, "estimate:"), (entities.SELF_CHECK_STATE, "self-check:")):
            row = self._recorded.latest(lane, time)
            if row is not None:
                states.append(f"{words} {row['StateChange:state'].as_py()[0]}")
        lines = [f"{self._recorded.name or 'run'} at {time:.1f} s: {self._places(time)}"]
        lines += [";  ".join(part) for part in (found, states) if part]
        past = [event for event in self._recorded.events() if time - RECENT_EVENT_S <= event.time <= time + 1e-6]
        if past:
            last = max(past, key=_weight)
            lines.append(textwrap.shorten(f"last event, {last.time:.1f} s: {last.text}", 150, placeholder=" …"))
        return "\n".join(lines)

    def _sample_size(self, time: float) -> str:
        """The effective sample size at the last update, in words; empty where it is unknown. It is measured before a
        resampling: the particles that are drawn are those after it, and weigh the same."""
        row, particles = (self._recorded.latest(name, time) for name in (entities.ESS_VALUE, entities.PARTICLES))
        if row is None:
            return ""
        words = f"effective sample size {row['Scalars:scalars'].as_py()[0]:.1f}"
        resampled = self._recorded.latest(entities.ESS_RESAMPLED, time)
        if resampled is None or particles is None or resampled[TIME] != row[TIME]:
            return words
        return f"{words} before resampling, {len(self._origins(particles))} after"

    def _places(self, time: float) -> str:
        """Where the robot is by the estimate and by the truth, and whether the filter's ellipse held the truth when it
        was made, in words."""
        robot, true = (self._recorded.latest(name, time) for name in (entities.ESTIMATED_ROBOT, entities.TRUE_ROBOT))
        assert robot is not None
        spread, within = self._recorded.latest(entities.COVARIANCE, time), None
        then = None if spread is None else self._recorded.latest(entities.TRUE_ROBOT, spread[TIME])
        if spread is not None and then is not None:
            shape = seen_from(self._T_world_map, ellipse(spread))
            off = se2.transform_points(se2.inverse([*shape.centre, shape.angle]), [pose(then)[:2]])[0]
            within = bool(np.hypot(*(off / np.maximum(shape.half, ELLIPSE_SIGMAS * MIN_DEVIATION))) <= 1.0)
        age = 0.0 if spread is None else float(robot[TIME] - spread[TIME])
        return in_words(se2.compose(self._T_world_map, pose(robot)), None if true is None else pose(true), within, age)

    def _curves(self) -> list[tuple[str, str, NDArray[np.float64], NDArray[np.float64], Any]]:
        """Name, unit, times, values and colour of the curves below the maps; those that the run does not have are left
        out."""
        found = []
        for entity, name, unit, colour in (
            (entities.POSITION_ERROR, POSITION_ERROR, "m", styles.ESTIMATE),
            (entities.SPREAD, "Spread of the particles", "cm", styles.COVARIANCE),
            (entities.ESS_VALUE, "Effective sample size", "", styles.ESTIMATE),
            (entities.MATCHED, "Share of beams on known walls", "", styles.ESTIMATE),
        ):
            times, values = self._recorded.series(entity)
            single = entity == entities.ESS_VALUE and len(values) > 0 and float(values.max()) <= 1.0
            small = unit == "m" and len(values) > 0 and float(values.max()) < 1.0
            if len(times) and not single:
                shown = ("cm", times, 100.0 * values) if small else (unit, times, values)
                found.append((name, *shown, rgb(colour)))
        return found[:3]

    # --- what is on the maps

    def _draw_map(self, axes: Axes, shown: GridImage | None) -> None:
        """Draw the map in the world's frame, and the true walls."""
        from matplotlib.transforms import Affine2D

        if shown is not None:
            x, y, theta = se2.compose(self._T_world_map, shown.pose).tolist()
            rows, columns = shown.image.shape
            extent = (0.0, columns * shown.cell, 0.0, rows * shown.cell)
            image = axes.imshow(shown.image, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="nearest")
            image.set_transform(Affine2D().rotate(theta).translate(x, y) + axes.transData)
        walls = self._recorded.fixed(entities.TRUE_WALLS)
        if walls:
            draw_lines(axes, strips(walls["LineStrips3D:strips"]), styles.TRUTH, 0.6)

    def _draw_world(
        self, axes: Axes, time: float, robot: Pose, reach: float = math.inf, *, odometry: bool = True, dot: float = DOT
    ) -> None:
        """Draw paths, robots and scan in the world's frame; reach: how far around the robot is shown [m]; odometry:
        whether to draw its path; dot: size of an end point [pt]."""
        for entity, T, width, label in (
            (entities.TRUE_PATH, np.zeros(3), 3.6, "truth: path, robot, thin walls"),
            (entities.ODOMETRY_PATH, self._T_world_odom, 1.2, "odometry alone"),
            (entities.PATH, self._T_world_map, 1.6, "estimate: path, robot"),
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
            self._draw_robot(axes, entities.TRUE_ROBOT, pose(true), styles.TRUTH)
        self._draw_robot(axes, entities.ESTIMATED_ROBOT, robot, styles.ESTIMATE)
        scan = self._recorded.latest(entities.SCAN, time)
        if scan is not None:
            ends = se2.transform_points(robot, points(scan["Points3D:positions"]))
            near = np.hypot(*(ends - robot[:2]).T) <= 2.0 * reach
            draw_dots(axes, ends[near], styles.SCAN, "scan, from the estimated pose", dot)

    def _draw_robot(self, axes: Axes, entity: str, at: Pose, colour: tuple[int, int, int]) -> None:
        """Draw the footprint of a robot at a pose (3,)."""
        for part in ("outline", "heading"):
            shape = self._recorded.fixed(f"{entity}/{part}")
            if shape:
                lines = [se2.transform_points(at, line) for line in strips(shape["LineStrips3D:strips"])]
                draw_lines(axes, lines, colour, 1.6)

    def _robot(self, time: float) -> Pose:
        """The estimated pose of the robot in the world's frame, (3,)."""
        scan = self._recorded.latest(entities.ESTIMATED_ROBOT, time)
        assert scan is not None
        return se2.compose(self._T_world_map, pose(scan))

    def _origins(self, particles: dict[str, Any] | None) -> NDArray[np.float64]:
        """Positions of the particles of a row in the world's frame, (n, 2) [m]."""
        origins = np.zeros((0, 2)) if particles is None else points(particles["Arrows3D:origins"])
        return se2.transform_points(self._T_world_map, origins)

    def _frame_around(self, time: float, framed: Sequence[float]) -> tuple[NDArray[np.float64], float]:
        """Centre (2,) of the close view at a time and how far it reaches [m]: the same for all the times `framed` where
        one view has room for all of them, else around the robot, as far as any of them needs."""
        centre, reach = self._frame_of(framed)
        needed = max(self._frame_of([other])[1] for other in framed)
        if reach > MAX_TOGETHER * needed:
            centre, reach = self._frame_of([time])[0], needed
        return centre, min(reach, MAX_REACH)

    def _frame_of_scans(self, times: Sequence[float]) -> tuple[NDArray[np.float64], float]:
        """Centre (2,) of a view and how far up and down it reaches [m], so that it shows at each of these times the
        robot and most of what its scan sees near it."""
        robots = [self._robot(time) for time in times]
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
        robots = np.array([self._robot(time)[:2] for time in times])
        centre, places = robots.mean(axis=0), [robots]
        for time in times:
            places.append(self._origins(self._recorded.latest(entities.PARTICLES, time)))
            true = self._recorded.latest(entities.TRUE_ROBOT, time)
            if true is not None:
                places.append(pose(true)[None, :2])
        far = float(np.hypot(*(np.concatenate(places) - centre).T).max())
        return centre, max(MARGIN * far, MIN_REACH)

    def _histories(self, time: float) -> list[NDArray[np.float64]]:
        """The tree of the particles' histories as lines (n, 2) in the world's frame: as it was last logged, and from
        there through the particles of each update. Between two resamplings particle i stays particle i, and each
        resampling logs the tree; in a known map, where that is not so, only the tree."""
        tree = self._recorded.latest(entities.PARTICLE_PATHS, time)
        lines = [] if tree is None else [line for line in strips(tree["LineStrips3D:strips"]) if len(line)]
        lines = [se2.transform_points(self._T_world_map, line) for line in lines]
        if len(self._recorded.times(entities.LOCALIZATION_STATE)):
            return lines
        since = self._recorded.between(entities.PARTICLES, 0.0 if tree is None else tree[TIME], time)
        places = [self._origins(row) for row in since]
        if len({len(part) for part in places}) != 1:
            return lines
        return lines + list(np.stack(places, axis=1))

    def _draw_around(self, axes: Axes, time: float, centre: NDArray[np.float64], reach: float) -> None:
        """Draw the particles, their histories and the filter's ellipse, and all else, close up around a place (2,)."""
        T, robot = self._T_world_map, self._robot(time)
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
        self._draw_world(axes, time, robot, reach)
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

    def _reach_of_proposal(self, time: float) -> float:
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

    def _draw_proposal(self, axes: Axes, time: float, reach: float) -> None:
        """Draw how the best particle's new pose was found; reach: how far around it is shown [m]."""
        T = self._T_world_map
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

    def _show_all_of_the_map(self, axes: Axes, shown: GridImage | None) -> None:
        """Show the whole extent of the true walls and of those of the map, or of the whole path, whatever the time."""
        walls = self._recorded.fixed(entities.TRUE_WALLS)
        if walls:
            ends = np.concatenate(strips(walls["LineStrips3D:strips"]))
            if shown is not None:
                rows, columns = np.nonzero(shown.image <= OCCUPIED_TO)
                places = np.column_stack([columns + 0.5, shown.image.shape[0] - rows - 0.5]) * shown.cell
                places = se2.transform_points(se2.compose(self._T_world_map, shown.pose), places)
                ends = np.concatenate([ends, places])
        else:
            parts = [
                se2.transform_points(self._T_world_map, strip)
                for name in self._recorded.names(entities.PATH)
                if (row := self._recorded.latest(name, math.inf)) is not None
                for strip in strips(row["LineStrips3D:strips"])
                if len(strip)
            ]
            ends = np.concatenate(parts) if parts else np.zeros((1, 2))
            ends = np.concatenate([ends - 5.0, ends + 5.0])
        (left, low), (right, high) = ends.min(axis=0) - 0.6, ends.max(axis=0) + 0.6
        axes.set(xlim=(left, right), ylim=(low, high), xlabel="x [m]", ylabel="y [m]")
