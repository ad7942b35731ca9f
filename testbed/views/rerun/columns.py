# SPDX-License-Identifier: MIT
"""Rows that are sent many at a time: a log call costs about 0.1 ms, a row among others a tenth of that.

What comes with every scan is kept here for a moment; `send` makes one call per entity of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from testbed.views.rerun import drawing, entities
from testbed.views.rerun.archetypes import strips

Values = tuple[NDArray[np.generic], ...]
"""What one row holds; its meaning is the entity's."""
Build = Callable[[Sequence[Values]], rr.ComponentColumnList]


def poses(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (pose (3,),)."""
    stacked = np.array([row[0] for row in rows], dtype=np.float64)
    turns = np.zeros((len(stacked), 4))
    turns[:, 2], turns[:, 3] = np.sin(stacked[:, 2] / 2.0), np.cos(stacked[:, 2] / 2.0)
    return rr.Transform3D.columns(translation=drawing.lifted(stacked, 0.0), quaternion=turns)


def scalars(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (values (series,),)."""
    return rr.Scalars.columns(scalars=np.concatenate([row[0] for row in rows])).partition([len(r[0]) for r in rows])


def points(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (positions (n, 3),)."""
    return rr.Points3D.columns(positions=np.concatenate([row[0] for row in rows])).partition([len(r[0]) for r in rows])


def arrows(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (origins (n, 3), vectors (n, 3), colours (n, 3))."""
    origins, vectors, colours = (np.concatenate(part) for part in zip(*rows, strict=True))
    columns = rr.Arrows3D.columns(origins=origins, vectors=vectors, colors=colours)
    return columns.partition([len(row[0]) for row in rows])


def pieces(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (strip (n, 3),)."""
    return rr.LineStrips3D.columns(strips=strips([row[0] for row in rows]))


def ellipses(rows: Sequence[Values]) -> rr.ComponentColumnList:
    """Rows (centre (3,), half axes (3,), quaternion (4,))."""
    centres, half_sizes, turns = (np.array(part) for part in zip(*rows, strict=True))
    return rr.Ellipsoids3D.columns(centers=centres, half_sizes=half_sizes, quaternions=turns)


BUILD: dict[str, Build] = {
    entities.ESTIMATED_ROBOT: poses,
    entities.TRUE_ROBOT: poses,
    entities.SCAN: points,
    entities.PARTICLES: arrows,
    entities.PROPOSAL_SAMPLES: points,
    entities.COVARIANCE: ellipses,
    entities.PROPOSAL_GAUSSIAN: ellipses,
    entities.ODOMETRY_PATH: pieces,
    entities.TRUE_PATH: pieces,
    entities.POSITION_ERROR: scalars,
    entities.HEADING_ERROR: scalars,
    entities.ESS_VALUE: scalars,
    entities.ESS_RESAMPLED: scalars,
    entities.MATCHED: scalars,
    entities.STAGES: scalars,
}


@dataclass
class Columns:
    """The rows that wait to be sent."""

    rec: rr.RecordingStream
    time: tuple[float, int] = (0.0, 0)
    """Time [s] and number of the scan that the next rows belong to."""
    _rows: dict[str, list[tuple[float, int, Values]]] = field(default_factory=dict)

    def add(self, entity: str, *values: NDArray[np.generic]) -> None:
        """Keep one row of an entity that is in `BUILD`."""
        self._rows.setdefault(entity, []).append((*self.time, values))

    def send(self) -> None:
        """Send all rows."""
        for entity, rows in self._rows.items():
            stamps, scans, values = zip(*rows, strict=True)
            times = [
                rr.TimeColumn(entities.TIMELINE, duration=stamps),
                rr.TimeColumn(entities.SCAN_TIMELINE, sequence=scans),
            ]
            self.rec.send_columns(entity, times, BUILD[entity](values))
        self._rows.clear()
