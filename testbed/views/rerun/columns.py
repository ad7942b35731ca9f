# SPDX-License-Identifier: MIT
"""Rows that are sent many at a time: a log call costs about 0.1 ms, a row among others a tenth of that.

Rows are kept here for a moment, as they come; `send` turns all rows of an entity into what is drawn in one go, and
makes one call for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from slam import se2
from slam.se2 import Pose
from testbed.views.rerun import drawing, entities
from testbed.views.rerun.archetypes import image_buffers, straight_strips, strips
from testbed.views.rerun.scene.styles import Z_ELLIPSE, Z_TOP

Values = tuple[Any, ...]
"""What one row holds, mostly arrays; its meaning is the entity's."""
Build = Callable[[Sequence[Values]], rr.ComponentColumnList]


def poses(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (pose (3,),)."""
    stacked = np.array([row[0] for row in rows], dtype=np.float64)
    turns = np.zeros((len(stacked), 4))
    turns[:, 2], turns[:, 3] = np.sin(stacked[:, 2] / 2.0), np.cos(stacked[:, 2] / 2.0)
    return rr.Transform3D.columns(translation=drawing.lifted(stacked, 0.0), quaternion=turns)


def places(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (pose (3,),), without their headings."""
    return rr.Transform3D.columns(translation=drawing.lifted(np.array([row[0] for row in rows]), 0.0))


def world_places(T_world_map: Pose) -> Build:
    """Rows (pose (3,),) in the map's frame, which are drawn in the world's, without their headings."""
    return lambda rows: places([(pose,) for pose in se2.compose(T_world_map, np.array([row[0] for row in rows]))])


def spreads(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (poses (n, 3), weights (n,)) as standard deviations of the position over the particles [cm]."""
    return rr.Scalars.columns(scalars=100.0 * drawing.spreads([(poses, weights) for poses, weights in rows]))


def numbers(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (value, value, ...), one for each series."""
    return rr.Scalars.columns(scalars=np.array(rows, np.float64).ravel()).partition([len(row) for row in rows])


def scans(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (ranges (n,), angles (n,), mount (3,)) of the hits of a scan, see `drawing.thinned_hits`."""
    ranges, angles = (np.concatenate(part) for part in zip(*(row[:2] for row in rows), strict=True))
    mounts = np.repeat([row[2] for row in rows], _lengths(rows), axis=0)
    directions = angles + mounts[:, 2]
    ends = mounts[:, :2] + ranges[:, None] * np.column_stack([np.cos(directions), np.sin(directions)])
    return rr.Points3D.columns(positions=drawing.lifted(ends, Z_TOP)).partition(_lengths(rows))


def dots(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (poses (n, 3), weights (n,)) of weighted poses, drawn as dots."""
    positions = drawing.lifted(np.concatenate([row[0] for row in rows]), Z_TOP)
    return rr.Points3D.columns(positions=positions, colors=_colours(rows)).partition(_lengths(rows))


def arrows(length: float, rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (poses (n, 3), weights (n,)) of weighted poses, drawn as arrows of a length [m]."""
    stacked = np.concatenate([row[0] for row in rows])
    vectors = drawing.headings(stacked, length)
    columns = rr.Arrows3D.columns(origins=drawing.lifted(stacked, Z_TOP), vectors=vectors, colors=_colours(rows))
    return columns.partition(_lengths(rows))


def labels(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (text,), of a label that has its place."""
    return rr.Points3D.columns(labels=[row[0] for row in rows])


def lines(z: float, rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (strip (n, 2 or 3), strip (n, 2 or 3), ...) of lines at a height [m]."""
    all_strips = [strip[:, :2] for row in rows for strip in row]
    return rr.LineStrips3D.columns(strips=strips(all_strips, z)).partition([len(row) for row in rows])


def pairs(z: float, rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (pose (3,), pose (3,)), of one straight line each at a height [m]."""
    ends = np.array(rows, np.float64)[:, :, :2]
    return rr.LineStrips3D.columns(strips=straight_strips(ends, z))


def ellipses(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (pose (3,), covariance (3, 3)): the ellipses that hold 95 % of the positions."""
    centres = drawing.lifted(np.array([row[0] for row in rows]), Z_ELLIPSE)
    half, angles = drawing.ellipses(np.array([row[1] for row in rows]))
    sizes = np.column_stack([half, np.full(len(half), 1e-4)])
    turns = np.zeros((len(rows), 4))
    turns[:, 2], turns[:, 3] = np.sin(angles / 2.0), np.cos(angles / 2.0)
    return rr.Ellipsoids3D.columns(centers=centres, half_sizes=sizes, quaternions=turns)


def images(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (grey levels (rows, columns),), of squares of a map."""
    return rr.GridMap.columns(data=image_buffers([row[0] for row in rows]))


def text_lines(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (text, level) of a log, see `Columns.add_event`."""
    return rr.TextLog.columns(text=[row[0] for row in rows], level=[row[1] for row in rows])


def states(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (state,) of a lane."""
    return rr.StateChange.columns(state=[row[0] for row in rows])


def _lengths(rows: Sequence[Values]) -> list[int]:
    return [len(row[0]) for row in rows]


def _colours(rows: Sequence[Values]) -> NDArray[np.uint8]:
    """Colours (n, 3) by the second value of the rows, weights (n,); each row has its own heaviest."""
    weights, lengths = np.concatenate([row[1] for row in rows]), np.array(_lengths(rows))
    starts = np.cumsum(lengths) - lengths
    held = lengths > 0
    heaviest = np.maximum.reduceat(weights, starts[held]) if held.any() else weights
    return drawing.weight_colours(weights / np.repeat(heaviest, lengths[held]))


@dataclass(eq=False)
class ErrorColumns:
    """Errors of estimate and odometry; rows (truth (3,), estimate (3,), odometry (3,)), each in its own frame."""

    T_world_map: Pose
    T_world_odom: Pose
    heading: bool
    """Whether the errors are of the heading [deg], not of the position [m]."""
    maxima: tuple[float, float] = (0.0, 0.0)
    """Largest errors of estimate and odometry so far."""

    def __call__(self, rows: Sequence[Values]) -> rr.ComponentColumnList:
        """Errors (rows, 2)."""
        errors = self.of(rows)
        largest = errors.max(axis=0).tolist()
        self.maxima = max(self.maxima[0], largest[0]), max(self.maxima[1], largest[1])
        return rr.Scalars.columns(scalars=errors.ravel()).partition([2] * len(rows))

    def of(self, rows: Sequence[Values]) -> NDArray[np.float64]:
        """Errors (rows, 2) of estimate and odometry [m] or [deg]."""
        truth, estimate, odometry = (np.array(part) for part in zip(*rows, strict=True))
        miss = np.stack(
            [
                se2.between(truth, se2.compose(self.T_world_map, estimate)),
                se2.between(truth, se2.compose(self.T_world_odom, odometry)),
            ],
            axis=1,
        )
        errors: NDArray[np.float64] = (
            np.degrees(np.abs(miss[..., 2])) if self.heading else np.hypot(miss[..., 0], miss[..., 1])
        )
        return errors

    def estimates(self, rows: Sequence[Values]) -> rr.ComponentColumnList:
        """Errors (rows,) of the estimate alone."""
        return rr.Scalars.columns(scalars=self.of(rows)[:, 0])


BUILD: dict[str, Build] = {
    entities.ESTIMATED_ROBOT: poses,
    entities.TRUE_ROBOT: poses,
    entities.SCAN: scans,
    entities.PARTICLE_DOTS: dots,
    entities.COVARIANCE: ellipses,
    entities.PROPOSAL_PRIOR: ellipses,
    entities.PROPOSAL_SAMPLES: dots,
    entities.PROPOSAL_GAUSSIAN: ellipses,
    entities.PROPOSAL_OPTIMUM: poses,
    entities.PROPOSAL_EYE: places,
    entities.PROPOSAL_SCAN: scans,
    entities.ESS_VALUE: numbers,
    entities.ESS_RESAMPLED: numbers,
    entities.SPREAD: spreads,
    entities.MATCHED: numbers,
    entities.STAGES: numbers,
    entities.EVENTS: text_lines,
    entities.ESTIMATE_STATE: states,
    entities.SELF_CHECK_STATE: states,
    entities.MATCHING_STATE: states,
    entities.ROBOT_STATE: states,
    entities.LOCALIZATION_STATE: states,
}
"""How the rows of an entity become columns; those of the others are stated with the rows."""


@dataclass
class Columns:
    """The rows that wait to be sent."""

    rec: rr.RecordingStream
    time: tuple[float, int] = (0.0, 0)
    """Time [s] and number of the scan that the next rows belong to."""
    build: dict[str, Build] = field(default_factory=lambda: dict(BUILD))
    """How the rows of each entity become columns."""
    _rows: dict[str, tuple[list[tuple[float, int]], list[Values]]] = field(default_factory=dict)
    _late: set[str] = field(default_factory=set)  # entities whose rows are not in the order of time

    def add(
        self,
        entity: str,
        *values: NDArray[Any] | float | str | None,
        build: Build | None = None,
        at: tuple[float, int] | None = None,
    ) -> None:
        """Keep one row of an entity that is in `build`, or is built by the argument of that name; at: when it belongs
        to another time than the next rows."""
        kept = self._rows.get(entity)
        if kept is None:
            kept = self._rows[entity] = ([], [])
            if build is not None:
                self.build[entity] = build
        if at is None:
            kept[0].append(self.time)
        else:
            self._late.add(entity)
            kept[0].append(at)
        kept[1].append(values)

    def add_event(self, text: str, level: str, at: tuple[float, int] | None = None) -> None:
        """Keep a line of the event log.

        Its time is rounded up to a tenth of a second: the log cuts longer numbers, and a click on the line moves the
        cursor to a time at which it can be seen.
        """
        stamp, scan = self.time if at is None else at
        self.add(entities.EVENTS, text, level, at=(math.ceil(10.0 * stamp - 1e-6) / 10.0, scan))

    def send(self) -> None:
        """Send all rows."""
        made: dict[tuple[tuple[float, int], ...], list[rr.TimeColumn]] = {}
        for entity in self._rows:
            times, rows = self._in_order(entity)
            key = tuple(times)
            if key not in made:  # most entities have rows at the same times
                stamps, numbers = np.array(times).T
                made[key] = [
                    rr.TimeColumn(entities.TIMELINE, duration=stamps),
                    rr.TimeColumn(entities.SCAN_TIMELINE, sequence=numbers.astype(np.int64)),
                ]
            self.rec.send_columns(entity, made[key], self.build[entity](rows))
        self._rows.clear()
        self._late.clear()

    def _in_order(self, entity: str) -> tuple[list[tuple[float, int]], list[Values]]:
        """Times and rows of an entity in the order of the scans: the viewer mixes up those of a log that are not."""
        times, rows = self._rows[entity]
        if entity not in self._late:
            return times, rows
        order = sorted(range(len(times)), key=lambda row: times[row][1])
        return [times[row] for row in order], [rows[row] for row in order]


@cache
def pair_columns(z: float) -> Build:
    """Columns of straight lines between two poses, at a height [m]."""
    return partial(pairs, z)


@cache
def line_columns(z: float) -> Build:
    """Columns of lines at a height [m]."""
    return partial(lines, z)


def arrow_columns(length: float) -> Build:
    """Columns of weighted poses, drawn as arrows of a length [m]."""
    return partial(arrows, length)
