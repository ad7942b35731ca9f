# SPDX-License-Identifier: MIT
"""One moment of a comparison of systems as a picture: each system's map, path and scan, all of them close up around
the robot, and their errors over time. It shows what the viewer shows at that time, and needs no display.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eval.wording import length
from slam import se2
from slam.se2 import Pose
from testbed.views.rerun import entities
from testbed.views.rerun.figure_parts import (
    DOT,
    LOOK,
    as_png,
    draw_dots,
    draw_grid,
    draw_lines,
    draw_robot,
    rgb,
    show_around,
    title_left,
)
from testbed.views.rerun.recorded import TIME, Recorded, colours, grid_image, points, pose, strips
from testbed.views.rerun.scene import styles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

WIDTH, CLOSE_HEIGHT, MARGIN_HEIGHT = 13.0, 4.2, 0.9
"""Width, height of the close view with the curves, and of headline and legend [inch]."""
MAX_PANEL_HEIGHT = 6.0
"""Of a system's panel [inch]."""
CLOSE_WIDE = 1.3
"""Width of the close view as part of its height."""
MIN_REACH, MAX_REACH, ROOM = 0.4, 4.0, 1.25
"""The close view shows at least and at most so much around the robot [m], and so many times what it has to show."""
AROUND = 0.6
"""About the walls, or the paths, so much more is shown [m]."""
SLACK = 1e-3
"""Rows of one scan have the same time up to rounding [s]."""


@dataclass(frozen=True)
class ShownSystem:
    """What one system had at a time."""

    name: str
    colour: tuple[int, int, int]
    pose: Pose | None
    """Its last pose up to that time, (3,); None before its first."""
    since: float
    """When that was [s]."""
    error: float | None
    """Distance from the truth then [m]."""


class SystemsPictures:
    """Draws moments of a comparison from its recording. Times are seconds since the first scan."""

    def __init__(self, recorded: Recorded) -> None:
        """Take a recording in which there are systems (see `systems_in`)."""
        self._recorded = recorded
        self._names = systems_in(recorded)
        self.end = max(float(recorded.times(f"{root}/robot")[-1]) for root in map(_root, self._names))

    def png(self, time: float, compared_with: Sequence[float] = ()) -> bytes:
        """Draw the moment as a PNG; a time before the first scan or after the last one shows that scan.

        compared_with: the times of other pictures; the close views of all are on one scale
        """
        from matplotlib import rc_context
        from matplotlib.figure import Figure

        time = self._at_a_scan(time)
        shown = [self._system(name, time) for name in self._names]
        columns = math.ceil(math.sqrt(len(shown)))
        rows = math.ceil(len(shown) / columns)
        panels = rows * min(MAX_PANEL_HEIGHT, WIDTH / columns / self._shape + 0.4)
        reach = max(self._frame(self._at_a_scan(other))[1] for other in (time, *compared_with))
        with rc_context(LOOK):
            figure = Figure(figsize=(WIDTH, panels + CLOSE_HEIGHT + MARGIN_HEIGHT), layout="constrained")
            figure.suptitle(self._headline(time), x=0.01, ha="left", fontsize=11.0)
            parts: Any = figure.subfigures(2, 1, height_ratios=[panels, CLOSE_HEIGHT])
            for number, system in enumerate(shown):
                self._draw_panel(parts[0].add_subplot(rows, columns, number + 1), system, time)
            self._draw_close(parts[1], shown, time, reach)
            self._draw_legend(figure, shown)
            return as_png(figure)

    def _at_a_scan(self, time: float) -> float:
        """The time of the last scan that is drawn up to a time [s]; of the first one where that is earlier."""
        rows = [self._recorded.times(f"{_root(name)}/robot") for name in self._names]
        times = np.unique(np.concatenate([*rows, self._recorded.times(entities.TRUE_ROBOT)]))
        return float(times[max(int(np.searchsorted(times, time + SLACK, side="right")) - 1, 0)])

    def _system(self, name: str, time: float) -> ShownSystem:
        """What a system had at a time."""
        row = self._recorded.latest(f"{_root(name)}/robot", time)
        error = self._recorded.latest(_error(name), time)
        known = error is not None and row is not None and abs(error[TIME] - row[TIME]) < SLACK
        return ShownSystem(
            name=name,
            colour=_colour(self._recorded, name),
            pose=None if row is None else pose(row),
            since=math.nan if row is None else float(row[TIME]),
            error=float(error["Scalars:scalars"].as_py()[0]) if known and error is not None else None,
        )

    def _headline(self, time: float) -> str:
        """What is shown, when, and where the robot truly was."""
        true = self._recorded.latest(entities.TRUE_ROBOT, time)
        words = f"{self._recorded.name}: {time:.1f} s"
        if true is None:
            return words
        x, y, theta = pose(true).tolist()
        return f"{words}, robot truly at ({x:.2f}, {y:.2f}) m, heading {round(math.degrees(theta))}°"

    def _draw_panel(self, axes: Axes, system: ShownSystem, time: float) -> None:
        """Draw the final map of a system, its path so far, its robot and the scan from its pose, over the truth."""
        grid = self._recorded.fixed(f"{_root(system.name)}/map")
        words = [system.name, _words(system, time), "" if grid else "no map"]
        axes.set(title=", ".join(filter(None, words)), aspect="equal")
        axes.set_facecolor(rgb(styles.UNSEEN) if grid else "white")
        title_left(axes)
        if grid:
            picture = grid_image(grid)
            draw_grid(axes, picture, picture.pose)
        self._draw_truth(axes, time)
        self._draw_system(axes, system, time)
        low, high = self._extent
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))

    def _draw_close(self, part: SubFigure, shown: Sequence[ShownSystem], time: float, reach: float) -> None:
        """Draw all systems over each other around the robot, and their errors over time."""
        curves = {system.name: self._recorded.series(_error(system.name)) for system in shown}
        known = any(len(times) for times, _ in curves.values())
        axes_of: Any = part.subplots(1, 2 if known else 1, width_ratios=[1.0, 1.35][: 2 if known else 1], squeeze=False)
        close = axes_of[0, 0]
        close.set(title="All of them around the robot, with their scans", aspect="equal")
        title_left(close)
        self._draw_truth(close, time)
        for system in shown:
            self._draw_system(close, system, time)
        show_around(close, self._frame(time)[0], reach, CLOSE_WIDE)
        if known:
            _draw_curves(axes_of[0, 1], curves, shown, time)

    def _draw_truth(self, axes: Axes, time: float) -> None:
        """Draw the true walls, the true path so far and the true robot, as far as they are known."""
        walls = self._recorded.fixed(entities.TRUE_WALLS)
        if walls:
            draw_lines(axes, strips(walls["LineStrips3D:strips"]), styles.TRUTH, 0.6)
        draw_lines(axes, self._path(entities.TRUE_PATH, time), styles.TRUTH, 3.6)
        true = self._recorded.latest(entities.TRUE_ROBOT, time)
        if true is not None:
            draw_robot(axes, self._recorded, entities.TRUE_ROBOT, pose(true), styles.TRUTH)

    def _draw_system(self, axes: Axes, system: ShownSystem, time: float) -> None:
        """Draw the path of a system so far, its particles, and the robot with the scan from its pose."""
        root = _root(system.name)
        draw_lines(axes, self._path(f"{root}/path", time), system.colour, 1.4)
        if system.pose is None:
            return
        draw_robot(axes, self._recorded, f"{root}/robot", system.pose, system.colour)
        scan = self._recorded.latest(f"{root}/robot/scan", system.since)
        if scan is not None and _is_new(system, time):
            ends = se2.transform_points(system.pose, points(scan["Points3D:positions"]))
            draw_dots(axes, ends, system.colour, size=DOT)
        particles = self._recorded.latest(f"{root}/particles", time)
        if particles is not None:
            x, y = points(particles["Points3D:positions"]).T
            axes.scatter(x, y, s=5, color=colours(particles["Points3D:colors"]), zorder=7)

    def _path(self, parent: str, time: float) -> list[NDArray[np.float64]]:
        """The lines (n, 2) of a path up to a time, the last one from its end to the robot."""
        blocks = sorted(self._recorded.names(parent), key=lambda name: int(name.rpartition("_")[2]))
        rows = (self._recorded.latest(name, time) for name in blocks)
        lines = [line for row in rows if row is not None for line in strips(row["LineStrips3D:strips"]) if len(line)]
        robot = self._recorded.latest(f"{parent.rpartition('/')[0]}/robot", time)
        if lines and robot is not None:
            lines.append(np.array([lines[-1][-1], pose(robot)[:2]]))
        return lines

    def _frame(self, time: float) -> tuple[NDArray[np.float64], float]:
        """Centre (2,) of the close view and how far it reaches [m]: it has room for all robots that have a pose now."""
        systems = [self._system(name, time) for name in self._names]
        places = [system.pose[:2] for system in systems if system.pose is not None and _is_new(system, time)]
        true = self._recorded.latest(entities.TRUE_ROBOT, time)
        centre = pose(true)[:2] if true is not None else np.mean(places, axis=0)
        far = max((float(np.hypot(*(place - centre))) for place in places), default=0.0)
        return centre, min(max(ROOM * far, MIN_REACH), MAX_REACH)

    @cached_property
    def _extent(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower left and upper right corner [m] (2,) of what each panel shows: the true walls and the whole paths."""
        walls = self._recorded.fixed(entities.TRUE_WALLS)
        places = strips(walls["LineStrips3D:strips"]) if walls else []
        for name in self._names:
            places += self._path(f"{_root(name)}/path", math.inf)
        every = np.concatenate(places)
        return every.min(axis=0) - AROUND, every.max(axis=0) + AROUND

    @property
    def _shape(self) -> float:
        """Width of what a panel shows as part of its height."""
        wide, high = (self._extent[1] - self._extent[0]).tolist()
        return float(wide / high)

    def _draw_legend(self, figure: Figure, shown: Sequence[ShownSystem]) -> None:
        from matplotlib.lines import Line2D

        names = {system.name: system.colour for system in shown}
        if len(self._recorded.times(entities.TRUE_ROBOT)):
            names = {"truth": styles.TRUTH} | names
        marks = [Line2D([], [], color=rgb(colour), marker=".") for colour in names.values()]
        figure.legend(marks, names.keys(), loc="outside lower left", ncols=6, frameon=False, fontsize=8.5)


def systems_in(recorded: Recorded) -> list[str]:
    """Names of the systems of a recording that have a path, in the order of their names; empty for other recordings."""
    start = f"{entities.SYSTEMS}/"
    names = {name.removeprefix(start).partition("/")[0] for name in recorded.names(entities.SYSTEMS)}
    return sorted(name for name in names if len(recorded.times(f"{_root(name)}/robot")))


def _draw_curves(
    axes: Axes,
    curves: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]],
    shown: Sequence[ShownSystem],
    time: float,
) -> None:
    """Draw the errors (times, errors) [s, m] of the systems, with a line at the time."""
    for system in shown:
        times, errors = curves[system.name]
        axes.plot(times, 100.0 * errors, color=rgb(system.colour), lw=1.2)
    axes.axvline(time, color="black", lw=1.0, ls=(0, (4, 2)))
    axes.set(xlabel="time since the first scan [s]", ylim=(0.0, None))
    axes.set_title("Position error [cm] of the final paths, each aligned over all its poses; line: now")
    title_left(axes)


def _words(system: ShownSystem, time: float) -> str:
    """How far off a system is, or since when it has no pose."""
    if system.pose is None:
        return "no pose yet"
    if not _is_new(system, time):
        return f"no pose since {system.since:.1f} s"
    return "" if system.error is None else f"{length(system.error)} off"


def _is_new(system: ShownSystem, time: float) -> bool:
    return abs(system.since - time) < SLACK


def _colour(recorded: Recorded, name: str) -> tuple[int, int, int]:
    """The colour in which a system is drawn."""
    red, green, blue = (255.0 * colours(recorded.fixed(f"{_root(name)}/robot/scan")["Points3D:colors"])[0]).round()
    return int(red), int(green), int(blue)


def _root(name: str) -> str:
    return entities.system(entities.SYSTEMS, name)


def _error(name: str) -> str:
    return entities.system(entities.POSITION_ERROR, name)
