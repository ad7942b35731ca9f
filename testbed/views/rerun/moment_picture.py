# SPDX-License-Identifier: MIT
"""One moment of a run as a picture: the map so far, the robot with its particles and the proposal close up, and curves.

It shows what the viewer shows at that time, and needs no display.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eval.wording import length
from slam import se2
from slam.occupancy import OccupancyGrid
from testbed.views.map_cells import probability_of_greys
from testbed.views.rerun import drawing, entities
from testbed.views.rerun.figure_parts import (
    DOT,
    LOOK,
    as_png,
    legend_mark,
    rgb,
    show_around,
    title_left,
)
from testbed.views.rerun.moment_scene import PAIR_WIDE, MomentScene
from testbed.views.rerun.moment_words import MomentWords
from testbed.views.rerun.other_particles import OtherParticle, map_at, other_particles
from testbed.views.rerun.recorded import (
    TIME,
    Recorded,
)
from testbed.views.rerun.scene import styles

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

WIDTH = 13.0
"""Width [inch]."""
MAPS_HEIGHT, OTHERS_HEIGHT, CURVES_HEIGHT = 6.2, 3.4, 1.5
"""Heights of the map with the close views, of the maps of other particles, and of the curves [inch]."""
WORDS_HEIGHT = 0.35
"""Height of a line that stands for the maps of other particles before their first comparison [inch]."""
PAIR_HEIGHT = 5.6
"""Height of two moments side by side [inch]."""
MARGIN_HEIGHT = 1.5
"""Height of headline and legend [inch]."""
POSITION_ERROR = "Position error"
UNSEEN = tuple(part / 255.0 for part in styles.UNSEEN)


class MomentPictures:
    """Draws moments of one run from its recording. Times are seconds since the first scan."""

    def __init__(self, recorded: Recorded) -> None:
        """Take a recording; raises ValueError that names it where it is none of a run."""
        self._recorded = recorded
        if self._recorded.latest(entities.ESTIMATED_ROBOT, math.inf) is None:
            raise ValueError(
                f"{recorded.path}: moments are drawn of runs and comparisons; without --time it opens in the viewer"
            )
        self._scene, self._words = MomentScene(self._recorded), MomentWords(self._recorded)
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
            words = "" if others else self._words.before_comparison(time)
            others_height = OTHERS_HEIGHT if others else WORDS_HEIGHT
            heights = [MAPS_HEIGHT, *([others_height] if others or words else []), CURVES_HEIGHT]
            figure = Figure(figsize=(WIDTH, sum(heights) + MARGIN_HEIGHT), layout="constrained")
            parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights)
            figure.suptitle(self._words.headline(time), x=0.01, ha="left", fontsize=11.0)
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
        centre, reach = self._scene.frame_of_scans(times)
        with rc_context(LOOK):
            figure = Figure(figsize=(WIDTH, PAIR_HEIGHT), layout="constrained")
            axes_of: Any = figure.subplots(1, 2)
            for axes, time in zip(axes_of, times, strict=True):
                error = self._recorded.latest(entities.POSITION_ERROR, time)
                off = "" if error is None else f": the estimate is {length(error['Scalars:scalars'].as_py()[0])} off"
                axes.set(title=f"{time:.1f} s{off}", aspect="equal", facecolor=UNSEEN)
                title_left(axes)
                self._scene.draw_map(axes, map_at(self._recorded, entities.MAP, time))
                self._scene.draw_world(
                    axes, time, self._scene.robot(time), PAIR_WIDE * reach, odometry=False, dot=2.0 * DOT
                )
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

    def _draw_maps(self, figure: Figure, part: SubFigure, time: float, framed: Sequence[float]) -> None:
        """Draw the map so far and the two close views into a part of the figure, and the legend below it all; framed:
        the times for which the close views have room."""
        from matplotlib.legend_handler import HandlerTuple

        robot = self._scene.robot(time)
        shown = map_at(self._recorded, entities.MAP, time)
        halves: Any = part.subfigures(1, 2, width_ratios=[1.35, 1.0])
        left, right = halves
        overview, around, close = left.add_subplot(), right.add_subplot(2, 1, 1), right.add_subplot(2, 1, 2)
        for axes, title in (
            (overview, "Map so far"),
            (around, f"Around the robot: the particles{self._words.age_of_particles(time)}"),
            (close, "The proposal of the best particle"),
        ):
            axes.set(title=title, aspect="equal", facecolor=UNSEEN)
            title_left(axes)
            self._scene.draw_map(axes, shown)
        self._scene.draw_world(overview, time, robot)
        self._scene.draw_around(around, time, *self._scene.frame_around(time, framed))
        self._scene.draw_proposal(close, time, max(map(self._scene.reach_of_proposal, framed)))
        self._scene.show_all_of_the_map(overview, shown)
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
            self._scene.draw_map(axes, other.map)
            rows, columns = np.nonzero(other.elsewhere)
            places = np.column_stack([columns + 0.5, other.map.image.shape[0] - rows - 0.5]) * other.map.cell
            places = se2.transform_points(se2.compose(self._scene.T_world_map, other.map.pose), places)
            axes.plot(*places.T, "s", ms=2.0, color=rgb(styles.RED), mew=0.0, zorder=4)
            self._scene.show_all_of_the_map(axes, other.map)
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
