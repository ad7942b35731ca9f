# SPDX-License-Identifier: MIT
"""Several recordings in one, side by side under one time cursor: each run's time counts from its first scan."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from testbed.views.rerun import entities
from testbed.views.rerun.blueprints import WHOLE_RUN, eye, eye_above, legend_view, top_view
from testbed.views.rerun.drawing import Extent
from testbed.views.rerun.layers.map_tiles import SQUARE
from testbed.views.rerun.recording_file import RecordingFile
from testbed.views.rerun.scene import styles

MAX_RUNS = 9
"""More views would be too small to see anything in them."""
SHOWN = (entities.WORLD, entities.POSITION_ERROR, entities.ESTIMATE_STATE)
"""What is shown of each run, with all that is below."""
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
    chunks: list[rr.chunk.Chunk] = []
    for number, (title, path) in enumerate(runs, start=1):
        root, name = f"/run_{number}", f"{number}: {title}"
        of_run = list(_chunks(path, root))
        if not of_run:
            raise ValueError(f"{path}: no recording of a run, expected what `testbed run` writes")
        chunks += of_run
        extent = _extent(of_run, root)
        follow = f"{root}{entities.ESTIMATED_ROBOT}"
        above = eye_above((0.0, 0.0), 25.0, follow) if extent is None else eye(extent, follow)
        views.append(top_view(name, [f"+ {root}{entities.WORLD}/**"], above, origin=f"{root}{entities.WORLD}"))
        if any(chunk.entity_path == f"{root}{entities.POSITION_ERROR}" for chunk in of_run):
            errors.append(f"{root}{entities.POSITION_ERROR}")
            curves.append((errors[-1], number, title))
        if any(chunk.entity_path == f"{root}{entities.ESTIMATE_STATE}" for chunk in of_run):
            lanes.append(f"{root}{entities.ESTIMATE_STATE}")
    with closing(RecordingFile(recording, rec, _blueprint(views, errors, lanes))):
        rec.send_recording_name("side by side")
        for entity, number, title in curves:
            colour = COLOURS[number - 1]
            faint = tuple((value + 2 * 200) // 3 for value in colour)
            names = [f"{number}: {title}", f"{number}: odometry"]
            rec.log(entity, rr.SeriesLines(names=names, colors=[colour, faint], widths=[1.8, 0.8]), static=True)
        image = rr.EncodedImage(contents=styles.legend_of_maps(), media_type="image/png")
        rec.log(f"{entities.LEGEND}/map", image, static=True)
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


def _extent(chunks: Sequence[rr.chunk.Chunk], root: str) -> Extent | None:
    """The rectangle about all squares of the map in the world's frame; None where there are none."""
    corners: list[NDArray[np.float64]] = []
    T_world_map = np.zeros(3)
    for chunk in chunks:
        place = re.fullmatch(re.escape(f"{root}{entities.MAP}") + r"/square_(-?\d+)_(-?\d+)", str(chunk.entity_path))
        slam = chunk.entity_path == f"{root}{entities.SLAM}"
        if not chunk.is_static or not (place or slam):
            continue
        row = chunk.to_record_batch().to_pydict()
        if slam and "Transform3D:translation" in row:
            (x, y, _), (_, _, sin, cos) = row["Transform3D:translation"][0][0], row["Transform3D:quaternion"][0][0]
            T_world_map = np.array([x, y, 2.0 * np.arctan2(sin, cos)])
        if place and "GridMap:cell_size" in row:
            side = SQUARE * float(row["GridMap:cell_size"][0][0])
            low = np.array([int(place[1]), int(place[2])]) * side
            corners += [low + np.array(offset) * side for offset in ((0, 0), (0, 1), (1, 0), (1, 1))]
    if not corners:
        return None
    x, y, theta = T_world_map
    turn = np.array([[np.cos(theta), np.sin(theta)], [-np.sin(theta), np.cos(theta)]])
    in_world = np.array(corners) @ turn + (x, y)
    (x_min, y_min), (x_max, y_max) = in_world.min(axis=0), in_world.max(axis=0)
    return Extent(float(x_min), float(y_min), float(x_max), float(y_max))


def _blueprint(views: list[rrb.Spatial3DView], errors: list[str], lanes: list[str]) -> rrb.Blueprint:
    """The maps as a grid, below them the legend, the states and the errors of all runs."""
    columns = int(np.ceil(np.sqrt(len(views))))
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
    rows: list[rrb.Container | rrb.View] = [rrb.Grid(*views, grid_columns=columns), legend_view("map")]
    if below:
        rows.append(rrb.Horizontal(*below))
    return rrb.Blueprint(
        rrb.Vertical(*rows, row_shares=[12, 1.3, 4][: len(rows)]),
        rrb.TimePanel(state="collapsed", timeline=entities.TIMELINE),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
