# SPDX-License-Identifier: MIT
"""What a recording holds at a time, read back from its file."""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.views.map_cells import UNKNOWN
from testbed.views.rerun import entities

TIME, SCAN = entities.TIMELINE, entities.SCAN_TIMELINE


class Event(NamedTuple):
    """A line of the event log."""

    time: float
    """Seconds since the first scan."""
    level: str
    text: str


class Recorded:
    """The rows of a recording by entity. Times are seconds since the first scan."""

    def __init__(self, recording: Path) -> None:
        """Read the file; raises ValueError that names it where it is no recording."""
        self.path = recording
        self._chunks: dict[tuple[str, bool], list[Any]] = defaultdict(list)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the file of a run that goes on has no index yet
                for chunk in rr.chunk.RrdReader(recording).stream():
                    self._chunks[chunk.entity_path.lstrip("/"), chunk.is_static].append(chunk)
        except (RuntimeError, ValueError, OSError) as error:
            reason = " ".join(f"{error}".split())
            raise ValueError(f"{recording}: expected a recording of Rerun: {reason}") from None
        self._rows: dict[str, tuple[NDArray[np.float64], pa.Table]] = {}

    @property
    def name(self) -> str | None:
        """Name of the recording, if it has one."""
        name = self.fixed("__properties").get("RecordingInfo:name")
        return None if name is None else str(name.as_py()[0])

    def names(self, parent: str) -> list[str]:
        """The entities below another one, in the order of their names."""
        start = f"{parent.lstrip('/')}/"
        return sorted({f"/{name}" for name, _ in self._chunks if name.startswith(start)})

    def fixed(self, entity: str) -> dict[str, Any]:
        """What was logged once for all, by component."""
        found: dict[str, Any] = {}
        for chunk in self._chunks.get((entity.lstrip("/"), True), ()):
            batch = chunk.to_record_batch()
            found |= {name: batch.column(name)[0] for name in batch.schema.names if ":" in name}
        return found

    def latest(self, entity: str, time: float) -> dict[str, Any] | None:
        """The last row of an entity up to a time, by component, and its time; None before its first row."""
        times, rows = self._of(entity)
        at = int(np.searchsorted(times, time + 1e-6, side="right")) - 1
        if at < 0:
            return None
        return {name: rows.column(name)[at] for name in rows.schema.names if ":" in name} | {TIME: float(times[at])}

    def between(self, entity: str, first: float, last: float) -> list[dict[str, Any]]:
        """The rows of an entity from a time to another one, both included, as `latest` gives them."""
        times, rows = self._of(entity)
        names = [name for name in rows.schema.names if ":" in name]
        return [
            {name: rows.column(name)[at] for name in names} | {TIME: float(times[at])}
            for at in np.flatnonzero((times >= first - 1e-6) & (times <= last + 1e-6)).tolist()
        ]

    def times(self, entity: str) -> NDArray[np.float64]:
        """Times of the rows of an entity, (n,) [s]."""
        return self._of(entity)[0]

    def series(self, entity: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times (n,) and the first value (n,) of each row of a plot; both are empty where it has none."""
        times, rows = self._of(entity)
        if len(times) == 0:
            return times, times
        return times, np.array([row[0] for row in rows.column("Scalars:scalars").to_pylist()])

    def events(self) -> list[Event]:
        """All lines of the event log, in the order of time."""
        times, rows = self._of(entities.EVENTS)
        if len(times) == 0:
            return []
        parts = (rows.column(f"TextLog:{name}").to_pylist() for name in ("level", "text"))
        return [Event(time, level[0], text[0]) for time, level, text in zip(times.tolist(), *parts, strict=True)]

    def states(self) -> list[Event]:
        """All changes of state as lines with the level STATE, lane by lane."""
        found = []
        for lane in self.names(entities.STATE):
            times, rows = self._of(lane)
            names = rows.column("StateChange:state").to_pylist() if len(times) else []
            words = lane.rpartition("/")[2].replace("_", "-")
            found += [
                Event(time, "STATE", f"{words}: {name[0]}") for time, name in zip(times.tolist(), names, strict=True)
            ]
        return found

    def _of(self, entity: str) -> tuple[NDArray[np.float64], pa.Table]:
        """Times (n,) and rows of an entity in the order of time."""
        if entity not in self._rows:
            batches = [chunk.to_record_batch() for chunk in self._chunks.get((entity.lstrip("/"), False), ())]
            batches = [batch for batch in batches if TIME in batch.schema.names]
            if not batches:
                return np.zeros(0), pa.table({})
            rows = pa.concat_tables([pa.Table.from_batches([batch]) for batch in batches], promote_options="default")
            times = rows.column(TIME).cast(pa.int64()).to_numpy() * 1e-9
            order = np.lexsort((rows.column(SCAN).to_numpy(), times))
            self._rows[entity] = times[order], rows.take(pa.array(order))
        return self._rows[entity]


def points(value: Any) -> NDArray[np.float64]:
    """Positions of a component as (n, 2) [m]."""
    return np.array(value.as_py(), dtype=np.float64).reshape(-1, 3)[:, :2]


def strips(value: Any) -> list[NDArray[np.float64]]:
    """Lines of a component, each (n, 2) [m]."""
    return [np.array(strip, dtype=np.float64).reshape(-1, 3)[:, :2] for strip in value.as_py()]


def colours(value: Any) -> NDArray[np.float64]:
    """Colours of a component as red, green, blue (n, 3), each 0 to 1."""
    packed = np.array(value.as_py(), dtype=np.int64)
    return np.column_stack([packed >> 24 & 255, packed >> 16 & 255, packed >> 8 & 255]) / 255.0


def pose(row: dict[str, Any]) -> Pose:
    """The pose (3,) of a transform."""
    x, y, _ = row["Transform3D:translation"].as_py()[0]
    _, _, sin, cos = row["Transform3D:quaternion"].as_py()[0]
    return np.array([x, y, 2.0 * np.arctan2(sin, cos)])


class Ellipse(NamedTuple):
    """An ellipse in the plane."""

    centre: NDArray[np.float64]
    """[m], (2,)."""
    half: NDArray[np.float64]
    """Half axes [m], (2,)."""
    angle: float
    """Of the first half axis [rad]."""


def ellipse(row: dict[str, Any]) -> Ellipse:
    """The ellipse of a row."""
    centre, half = (points(row[f"Ellipsoids3D:{name}"])[0] for name in ("centers", "half_sizes"))
    _, _, sin, cos = row["Ellipsoids3D:quaternions"].as_py()[0]
    return Ellipse(centre, half, 2.0 * float(np.arctan2(sin, cos)))


class GridImage(NamedTuple):
    """A piece of a map."""

    image: NDArray[np.uint8]
    """Grey levels, (rows, columns), row 0 at the highest y."""
    pose: Pose
    """Pose of its lower left corner in the map's frame, (3,)."""
    cell: float
    """Side of a pixel [m]."""


def grid_image(row: dict[str, Any]) -> GridImage:
    """The picture of a grid map."""
    form = row["GridMap:format"].as_py()[0]
    data = row["GridMap:data"].values[0].values.to_numpy(zero_copy_only=False)
    x, y, _ = row["GridMap:translation"].as_py()[0]
    _, _, sin, cos = row["GridMap:quaternion"].as_py()[0] if "GridMap:quaternion" in row else (0.0, 0.0, 0.0, 1.0)
    image: NDArray[np.uint8] = np.asarray(data, np.uint8).reshape(form["height"], form["width"])
    return GridImage(image, np.array([x, y, 2.0 * np.arctan2(sin, cos)]), float(row["GridMap:cell_size"].as_py()[0]))


def joined(pieces: Sequence[GridImage]) -> GridImage | None:
    """Pieces of one map, which lie side by side and are not turned, as one; what lies between them was never seen. A
    single piece is returned as it is; None for none."""
    if len(pieces) < 2:
        return pieces[0] if pieces else None
    cell = pieces[0].cell
    corners = np.rint([piece.pose[:2] / cell for piece in pieces]).astype(np.intp)
    low = corners.min(axis=0)
    columns, rows = np.max(
        [corner - low + piece.image.shape[::-1] for corner, piece in zip(corners, pieces, strict=True)], axis=0
    )
    image = np.full((rows, columns), UNKNOWN, np.uint8)
    for (left, below), piece in zip((corners - low).tolist(), pieces, strict=True):
        high, wide = piece.image.shape
        image[rows - below - high : rows - below, left : left + wide] = piece.image
    return GridImage(image, np.array([*(low * cell), 0.0]), cell)
