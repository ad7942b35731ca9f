# SPDX-License-Identifier: MIT
"""What several systems made of one drive as one recording: a layer for each, side by side and over each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from testbed.frame import Frame
from testbed.views.rerun import drawing, entities
from testbed.views.rerun.archetypes import grid_map
from testbed.views.rerun.blueprints import WHOLE_RUN, eye, legend_view, top_view
from testbed.views.rerun.columns import Columns, line_columns, numbers, poses, scans
from testbed.views.rerun.columns import dots as weighted_dots
from testbed.views.rerun.drawing import Extent
from testbed.views.rerun.layers.path_blocks import GrowingPath
from testbed.views.rerun.recording_file import RecordingFile
from testbed.views.rerun.scene import styles
from testbed.views.rerun.scene.legend import Entry, legend_image
from testbed.views.rerun.scene.robot_model import log_robot
from testbed.views.schedule import shown_scans
from testbed.views.view import Scene, SystemLayer

MAX_POINTS = 120
"""Beams of a scan that are drawn, for each system."""
PATH_EVERY = 10
"""Paths grow after so many of them."""
MARGIN = 0.5
"""About the paths, where no map says how large the place is [m]."""


def write_systems(recording: Path, frames: Iterable[Frame], layers: Sequence[SystemLayer], scene: Scene) -> None:
    """Write the layers of a drive as a recording; scene: its title, true map and robot.

    Raises ValueError where there is no layer.
    """
    if not layers:
        raise ValueError(f"{scene.title}: no system has a path, expected at least one")
    with_scans = [frame for frame in frames if frame.scan is not None]
    rec = rr.RecordingStream(entities.APPLICATION)
    rec.set_log_time_enabled(False)
    with closing(RecordingFile(recording, rec, _blueprint(layers, scene))) as file:
        rec.send_recording_name(scene.title)
        _log_static(rec, layers, scene, truth=any(frame.truth is not None for frame in with_scans))
        _add_moments(rec, with_scans, layers, file)


def _log_static(rec: rr.RecordingStream, layers: Sequence[SystemLayer], scene: Scene, truth: bool) -> None:
    """Log what never changes: maps, robots, styles, the legend."""
    rec.log(entities.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if scene.true_map is not None:
        styles.log_true_walls(rec, scene)
    if truth:
        log_robot(rec, entities.TRUE_ROBOT, scene.robot_radius, styles.TRUTH)
    for layer in layers:
        root = _root(layer)
        if layer.grid is not None:
            rec.log(f"{root}/map", grid_map(layer.grid), static=True)
        log_robot(rec, f"{root}/robot", scene.robot_radius, layer.colour)
        dots = rr.Points3D.from_fields(colors=[layer.colour], radii=rr.Radius.ui_points(1.5))
        rec.log(f"{root}/robot/scan", dots, static=True)
        rec.log(f"{root}/particles", rr.Points3D.from_fields(radii=rr.Radius.ui_points(2.5)), static=True)
        curve = rr.SeriesLines(names=layer.name, colors=layer.colour, widths=1.8)
        rec.log(_error(layer), curve, static=True)
    known: tuple[Entry, ...] = (("band", (styles.TRUTH,), "truth: path, robot, thin walls"),) if truth else ()
    entries = [*known, *(("line", (layer.colour,), f"{layer.name}: path, robot, scan") for layer in layers)]
    if any(layer.particles for layer in layers):
        entries.append(("dot", (drawing.LIGHT, drawing.HEAVY), "particles by weight, red: the heaviest"))
    image = rr.EncodedImage(contents=legend_image([entries]), media_type="image/png")
    rec.log(f"{entities.LEGEND}/map", image, static=True)


def _add_moments(
    rec: rr.RecordingStream, frames: Sequence[Frame], layers: Sequence[SystemLayer], file: RecordingFile
) -> None:
    """Add the robots, scans, paths and errors at some of the scans, and at the last one."""
    columns = Columns(rec)
    grown = {entities.TRUE_PATH: GrowingPath(), **{f"{_root(layer)}/path": GrowingPath() for layer in layers}}
    colours = {f"{_root(layer)}/path": layer.colour for layer in layers} | {entities.TRUE_PATH: styles.TRUTH}
    shown = shown_scans(len(frames)).tolist()
    places = [dict(zip(layer.rows.tolist(), range(len(layer.rows)), strict=True)) for layer in layers]
    for count, row in enumerate(shown):
        frame = frames[row]
        assert frame.scan is not None
        columns.time = (frame.stamp - frames[0].stamp, row)
        hits = drawing.thinned_hits(frame.scan, MAX_POINTS)
        if frame.truth is not None:
            columns.add(entities.TRUE_ROBOT, frame.truth, build=poses)
            grown[entities.TRUE_PATH].append(frame.truth)
        for layer, place in zip(layers, places, strict=True):
            root, at = _root(layer), place.get(row)
            if row in layer.particles:
                columns.add(f"{root}/particles", *layer.particles[row], build=weighted_dots)
            if at is None:
                continue
            columns.add(f"{root}/robot", layer.poses[at], build=poses)
            columns.add(f"{root}/robot/scan", *hits, build=scans)
            grown[f"{root}/path"].append(layer.poses[at])
            if layer.errors is not None and np.isfinite(layer.errors[at]):
                columns.add(_error(layer), float(layer.errors[at]), build=numbers)
        if count % PATH_EVERY == 0 or row == shown[-1]:
            for path, whole in grown.items():
                _add_blocks(rec, columns, path, whole, colours[path])
        if count % 500 == 499:
            columns.send()
            file.check()
    columns.send()


def _add_blocks(
    rec: rr.RecordingStream, columns: Columns, path: str, grown: GrowingPath, colour: tuple[int, int, int]
) -> None:
    """Add what a path has grown by."""
    width, z = (2.6, styles.Z_TRUTH) if path == entities.TRUE_PATH else (1.2, styles.Z_ESTIMATE)
    for number, part in grown.changes():
        name = entities.block(path, number)
        if name not in columns.build:
            rec.log(name, styles.line_style(colour, width), static=True)
        columns.add(name, part, build=line_columns(z))


def _root(layer: SystemLayer) -> str:
    return entities.system(entities.SYSTEMS, layer.name)


def _error(layer: SystemLayer) -> str:
    return entities.system(entities.POSITION_ERROR, layer.name)


def _extent(layers: Sequence[SystemLayer], scene: Scene) -> Extent:
    """The rectangle about the true map, else about all maps and paths."""
    if scene.true_map is not None:
        return drawing.extent_of(scene.true_map, np.zeros(3))
    found = [drawing.extent_of(layer.grid, np.zeros(3)) for layer in layers if layer.grid is not None]
    for layer in layers:
        low, high = layer.poses[:, :2].min(axis=0) - MARGIN, layer.poses[:, :2].max(axis=0) + MARGIN
        found.append(Extent(*low.tolist(), *high.tolist()))
    return Extent(
        min(one.x_min for one in found),
        min(one.y_min for one in found),
        max(one.x_max for one in found),
        max(one.y_max for one in found),
    )


def _blueprint(layers: Sequence[SystemLayer], scene: Scene) -> rrb.Blueprint:
    """Tabs: each system in a view of its own, and all paths in one. Below: the legend, and the errors over time."""
    extent, on_all = _extent(layers, scene), f"+ {entities.WORLD}/truth/**"
    views = [
        top_view(layer.name, [f"+ {_root(layer)}/**", on_all], eye(extent, _root(layer)), origin=entities.WORLD)
        for layer in layers
    ]
    contents = [f"+ {entities.WORLD}/**", *(f"- {_root(layer)}/map" for layer in layers)]
    together = top_view("All paths", contents, eye(extent, entities.WORLD), origin=entities.WORLD)
    grid = rrb.Grid(*views, grid_columns=int(np.ceil(np.sqrt(len(views)))), name="Side by side")
    rows: list[rrb.Container | rrb.View] = [
        rrb.Tabs(grid, rrb.Horizontal(together, name="Over each other")),
        legend_view("map"),
    ]
    if any(layer.errors is not None for layer in layers):
        errors = rrb.TimeSeriesView(
            origin=entities.POSITION_ERROR,
            name="Position error [m]",
            axis_x=rrb.TimeAxis(view_range=WHOLE_RUN),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        )
        rows.append(errors)
    return rrb.Blueprint(
        rrb.Vertical(*rows, row_shares=[12, 1, 4][: len(rows)]),
        rrb.TimePanel(state="collapsed", timeline=entities.TIMELINE),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
