# SPDX-License-Identifier: MIT
"""Several recordings in one, side by side under one time cursor: each run's time counts from its first scan."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from slam import se2
from testbed.views.map_cells import UNKNOWN
from testbed.views.rerun import entities
from testbed.views.rerun.blueprints import HALF_VIEW, WHOLE_RUN, eye, legend_view, top_view
from testbed.views.rerun.drawing import Extent
from testbed.views.rerun.layers.map_tiles import SQUARE
from testbed.views.rerun.recorded import grid_image, pose
from testbed.views.rerun.recording_file import RecordingFile

MAX_RUNS = 9
"""More views would be too small to see anything in them."""
MAP_LEGEND = f"{entities.LEGEND}/map"
SHOWN = (entities.WORLD, entities.POSITION_ERROR, entities.ESTIMATE_STATE, MAP_LEGEND)
"""What is shown of each run, with all that is below."""
FOLLOWED = (entities.ESTIMATED_ROBOT, entities.ODOMETRY_ROBOT, entities.TRUE_ROBOT)
"""Robots that the eye follows where no map says how large the place is: the first one that there is."""
COLOURS = (
    (31, 119, 180),
    (255, 127, 14),
    (44, 160, 44),
    (214, 39, 40),
    (148, 103, 189),
    (140, 86, 75),
    (227, 119, 194),
    (127, 127, 127),
    (23, 190, 207),
)
"""Colours of the curves, one for each run."""
_UNIT_SQUARE = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])


def write_side_by_side(recording: Path, runs: Sequence[tuple[str, Path]]) -> None:
    """Write one recording that shows several side by side.

    runs: title and recording of each, at most `MAX_RUNS`; they are numbered too, since titles may be equal

    Raises ValueError for more runs than that, or for a file that holds no recording.
    """
    if len(runs) > MAX_RUNS:
        raise ValueError(f"{len(runs)} runs, expected at most {MAX_RUNS} side by side")
    rec = rr.RecordingStream(entities.APPLICATION)
    rec.set_log_time_enabled(False)
    views, curves, lanes, errors = [], [], [], []
    legends: dict[bytes, list[int]] = defaultdict(list)
    chunks: list[rr.chunk.Chunk] = []
    for number, (title, path) in enumerate(runs, start=1):
        root, name = f"/run_{number}", f"{number}: {title}"
        of_run = list(_chunks(path, root))
        there = {str(chunk.entity_path) for chunk in of_run}
        if f"{root}{entities.WORLD}" not in there:
            raise ValueError(f"{path}: no recording of a run, expected what `testbed run` writes")
        chunks += of_run
        follow = next((robot for robot in (f"{root}{robot}" for robot in FOLLOWED) if robot in there), None)
        above = eye(_extent(of_run, root), follow, _landscape(len(runs)))
        views.append(top_view(name, [f"+ {root}{entities.WORLD}/**"], above, origin=f"{root}{entities.WORLD}"))
        if f"{root}{entities.POSITION_ERROR}" in there:
            errors.append(f"{root}{entities.POSITION_ERROR}")
            curves.append((errors[-1], number, title))
        if f"{root}{entities.ESTIMATE_STATE}" in there:
            lanes.append(f"{root}{entities.ESTIMATE_STATE}")
        if f"{root}{MAP_LEGEND}" in there:
            legends[_picture(of_run, f"{root}{MAP_LEGEND}")].append(number)
    with closing(RecordingFile(recording, rec, _blueprint(views, list(legends.values()), errors, lanes))):
        rec.send_recording_name("side by side")
        for entity, number, title in curves:
            colour = COLOURS[number - 1]
            faint = tuple((value + 2 * 200) // 3 for value in colour)
            names = [f"{number}: {title}", f"{number}: odometry"]
            rec.log(entity, rr.SeriesLines(names=names, colors=[colour, faint], widths=[1.8, 0.8]), static=True)
        rec.send_chunks(rr.chunk.LazyChunkStream.from_iter(iter(chunks)))


def _chunks(path: Path, root: str) -> Iterator[rr.chunk.Chunk]:
    """What is shown of a recording, below the entity `root`."""
    for chunk in rr.chunk.RrdReader(path).stream():
        entity = str(chunk.entity_path)
        if not any(entity == shown or entity.startswith(f"{shown}/") for shown in SHOWN):
            continue
        if entity == entities.POSITION_ERROR and chunk.is_static:
            continue  # names and colours of the curves: the runs' own are all the same
        yield chunk.with_entity_path(f"{root}{entity}")


def _picture(chunks: Sequence[rr.chunk.Chunk], entity: str) -> bytes:
    """The content of a picture that was logged once for all."""
    for chunk in chunks:
        if chunk.entity_path == entity and "EncodedImage:blob" in (row := chunk.to_record_batch().to_pydict()):
            return bytes(row["EncodedImage:blob"][0][0])
    return b""


def _extent(chunks: Sequence[rr.chunk.Chunk], root: str) -> Extent | None:
    """The rectangle about all maps in the world's frame: what whole maps know, and all squares of a map that grows;
    None where there are none."""
    corners: list[NDArray[np.float64]] = []
    corners_map: list[NDArray[np.float64]] = []
    T_world_map = np.zeros(3)
    for chunk in chunks:
        if not chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        row = {name: batch.column(name)[0] for name in batch.schema.names if ":" in name}
        below_map = str(chunk.entity_path).startswith(f"{root}{entities.MAP}")
        if chunk.entity_path == f"{root}{entities.SLAM}" and "Transform3D:translation" in row:
            T_world_map = pose(row)
        elif "GridMap:data" in row:
            (corners_map if below_map else corners).append(_known_corners(row))
        elif "GridMap:cell_size" in row and (place := re.search(r"/square_(-?\d+)_(-?\d+)$", str(chunk.entity_path))):
            side = SQUARE * float(row["GridMap:cell_size"].as_py()[0])
            low = np.array([int(place[1]), int(place[2])])
            corners_map.append(side * (low + _UNIT_SQUARE))
    corners += [se2.transform_points(T_world_map, some) for some in corners_map]
    if not corners:
        return None
    in_world = np.concatenate(corners)
    (x_min, y_min), (x_max, y_max) = in_world.min(axis=0), in_world.max(axis=0)
    return Extent(float(x_min), float(y_min), float(x_max), float(y_max))


def _known_corners(row: dict[str, Any]) -> NDArray[np.float64]:
    """Corners of the rectangle about all known cells of a whole map, (4, 2) [m]; of all of it where none is known."""
    grid = grid_image(row)
    known = grid.image[::-1] != UNKNOWN
    known = known if known.any() else np.ones_like(known)
    (low_y, high_y), (low_x, high_x) = (np.flatnonzero(known.any(axis=axis))[[0, -1]] for axis in (1, 0))
    low, high = np.array([low_x, low_y]), np.array([high_x, high_y]) + 1
    return se2.transform_points(grid.pose, grid.cell * (low + _UNIT_SQUARE * (high - low)))


def _landscape(views: int) -> float:
    """Width of each of so many views divided by its height."""
    columns = _columns(views)
    return 2.0 * HALF_VIEW * -(-views // columns) / columns


def _columns(views: int) -> int:
    return math.ceil(math.sqrt(views))


def _blueprint(
    views: list[rrb.Spatial3DView], legends: Sequence[Sequence[int]], errors: list[str], lanes: list[str]
) -> rrb.Blueprint:
    """The maps as a grid, below them the legends, the states and the errors of all runs.

    legends: numbers of the runs that have the same one; runs and drives without an estimate have others
    """
    below: list[rrb.View] = []
    if lanes:
        contents = [f"+ {lane}" for lane in lanes]
        axis = rrb.TimeAxis(view_range=WHOLE_RUN)
        below.append(rrb.StateTimelineView(origin="/", contents=contents, name="State", time_view=axis))
    if errors:
        contents = [f"+ {entity}" for entity in errors]
        axis = rrb.TimeAxis(view_range=WHOLE_RUN)
        legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)
        below.append(
            rrb.TimeSeriesView(
                origin="/", contents=contents, name="Position error [m]", axis_x=axis, plot_legend=legend
            )
        )
    named = ["Legend"] if len(legends) == 1 else [f"Legend of {', '.join(map(str, runs))}" for runs in legends]
    rows: list[rrb.Container | rrb.View] = [
        rrb.Grid(*views, grid_columns=_columns(len(views))),
        *(legend_view("map", f"/run_{runs[0]}", name) for runs, name in zip(legends, named, strict=True)),
    ]
    shares = [12.0, *(1.3 for _ in legends)]
    if below:
        rows.append(rrb.Horizontal(*below))
        shares.append(4.0)
    return rrb.Blueprint(
        rrb.Vertical(*rows, row_shares=shares),
        rrb.TimePanel(state="collapsed", timeline=entities.TIMELINE),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
