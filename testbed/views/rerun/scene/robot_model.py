# SPDX-License-Identifier: MIT
"""The robot's shape in a recording, as coloured outlines that hide no particle: from its URDF, or a plain disc."""

from __future__ import annotations

import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import rerun as rr

from testbed.views.view import Scene

HEIGHT = 0.1
"""Height of the plain disc [m]."""
OUTLINE_Z = 0.045
"""Height of the outline that is drawn close up [m]: above the paths, below the particles."""
OUTLINED = ("cylinder", "sphere", "box")
"""Elements of a URDF's geometry that are drawn as outlines; meshes stay as they are."""


def log_robot(rec: rr.RecordingStream, scene: Scene, robot: str, model: str, colour: tuple[int, int, int]) -> None:
    """Log the shape once: it moves with the entity `robot`. The URDF's entities go below `model`."""
    line = rr.Radius.ui_points(1.0)
    forward = rr.LineStrips3D([[[0, 0, 0.01], [1.5 * scene.robot_radius, 0, 0.01]]], radii=line, colors=colour)
    rec.log(f"{robot}/heading", forward, static=True)
    rec.log(f"{robot}/outline", footprint(scene.robot_radius, colour), static=True)
    if scene.robot_urdf is not None:
        log_urdf(rec, scene.robot_urdf, robot, model, colour)
        return
    disc = rr.Cylinders3D(
        lengths=[HEIGHT],
        radii=[scene.robot_radius],
        centers=[[0, 0, HEIGHT / 2]],
        colors=colour,
        line_radii=line,
        fill_mode="majorwireframe",
    )
    rec.log(f"{robot}/body", disc, static=True)


def footprint(radius: float, colour: tuple[int, int, int]) -> rr.LineStrips3D:
    """A circle about the robot's centre with a line to the front: drawn close up, where the shape would hide particles.

    radius [m]
    """
    angles = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(49, OUTLINE_Z)])
    front = np.array([[0.0, 0.0, OUTLINE_Z], [1.5 * radius, 0.0, OUTLINE_Z]])
    return rr.LineStrips3D([circle, front], radii=rr.Radius.ui_points(1.5), colors=colour)


def log_urdf(rec: rr.RecordingStream, urdf: str, robot: str, model: str, colour: tuple[int, int, int]) -> None:
    """Log the visuals of a URDF below the entity `model` and hang them on the entity `robot`."""
    root = ElementTree.fromstring(urdf)
    for link in root.iter("link"):
        for collision in link.findall("collision"):  # would be drawn on top of the visuals
            link.remove(collision)
    prefix = model.strip("/")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        ElementTree.ElementTree(root).write(path)
        tree = rr.urdf.UrdfTree.from_file_path(
            path, entity_path_prefix=prefix, frame_prefix=f"{prefix}/", static_transform_entity_path=f"{model}/joints"
        )
        tree.log_urdf_to_recording(rec)
    for link in root.iter("link"):
        shapes = [geometry[0].tag for geometry in link.iterfind("visual/geometry")]
        paths = tree.get_visual_geometry_paths(link.attrib["name"])
        for shape, entity in zip(shapes, paths, strict=True):
            if shape in OUTLINED:
                rec.log(entity, outline(shape, colour), static=True)
    # entities have frames of their own, named tf#/<path>: hang the model's root there
    rec.log(
        f"{model}/mount",
        rr.Transform3D(parent_frame=f"tf#{robot}", child_frame=f"{prefix}/{tree.root_link().name}"),
        static=True,
    )


def outline(shape: str, colour: tuple[int, int, int]) -> rr.AsComponents:
    """Style of a URDF's shape: coloured edges, no faces."""
    width = rr.Radius.ui_points(1.0)
    if shape == "cylinder":
        return rr.Cylinders3D.from_fields(colors=[colour], line_radii=width, fill_mode="majorwireframe")
    if shape == "sphere":
        return rr.Ellipsoids3D.from_fields(colors=[colour], line_radii=width, fill_mode="majorwireframe")
    return rr.Boxes3D.from_fields(colors=[colour], radii=width, fill_mode="majorwireframe")
