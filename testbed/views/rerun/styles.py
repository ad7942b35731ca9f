# SPDX-License-Identifier: MIT
"""What never changes in a recording: colours, widths, names, the true map, the robots' shapes.

Rerun lets a component that is logged once for all hide the same component logged later: style is logged here only.
"""

from __future__ import annotations

import rerun as rr

from testbed.views.rerun import entities
from testbed.views.rerun.archetypes import grid_map
from testbed.views.rerun.robot_model import log_robot
from testbed.views.view import Scene

TRUTH, ODOMETRY, ESTIMATE = (60, 160, 80), (240, 150, 30), (40, 90, 210)
SCAN, COVARIANCE, PROPOSAL, FAN = (220, 40, 140), (120, 40, 200), (0, 150, 160), (110, 140, 190)
MAPPING, RESAMPLED, LOOP_CLOSED, MATCH_FAILED = "mapping", "resampled", "loop closed", "match failed"
DRIVING, COLLIDED = "driving", "collided"
RED = (210, 50, 50)
STATES = {
    entities.FILTER_STATE: {
        MAPPING: (90, 160, 90),
        RESAMPLED: (230, 170, 40),
        LOOP_CLOSED: (50, 100, 220),
        MATCH_FAILED: RED,
    },
    entities.ROBOT_STATE: {DRIVING: (150, 160, 170), COLLIDED: RED},
}
LINES = {
    entities.TRUE_PATH: (TRUTH, 2.5),
    entities.ODOMETRY_PATH: (ODOMETRY, 1.2),
    entities.PATH: (ESTIMATE, 1.2),
    entities.PARTICLE_PATHS: (FAN, 0.5),
    **{f"{entities.COMPARE}/{rank}/path": (ESTIMATE, 1.2) for rank in entities.RANKS},
}
"""Colour and half the width in points of the screen."""
SERIES = {
    entities.POSITION_ERROR: (["estimate", "odometry"], [ESTIMATE, ODOMETRY]),
    entities.HEADING_ERROR: (["estimate", "odometry"], [ESTIMATE, ODOMETRY]),
    entities.ESS_VALUE: (["effective sample size"], [ESTIMATE]),
    entities.MATCHED: (["matched share"], [ESTIMATE]),
    entities.STAGES: (["match", "map", "resample"], [ESTIMATE, TRUTH, ODOMETRY]),
}
"""Names and colours of the curves."""


def log_scene(rec: rr.RecordingStream, scene: Scene) -> None:
    """Log all of it."""
    rec.log(entities.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if scene.settings:
        rec.log(entities.SETTINGS, rr.TextDocument(scene.settings, media_type=rr.MediaType.MARKDOWN), static=True)
    if scene.true_map is not None:
        rec.log(entities.TRUE_MAP, grid_map(scene.true_map, z=0.01, opacity=0.4), static=True)
        log_robot(rec, scene, entities.TRUE_ROBOT, entities.TRUE_MODEL, TRUTH)
    log_robot(rec, scene, entities.ESTIMATED_ROBOT, entities.ESTIMATED_MODEL, ESTIMATE)
    log_shapes(rec)
    log_plots(rec)


def log_shapes(rec: rr.RecordingStream) -> None:
    """Colours and widths of what is on the map."""
    for entity, (colour, width) in LINES.items():
        style = rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(width))
        rec.log(entity, style, static=True)
    for entity, colour, size in ((entities.SCAN, SCAN, 1.5), (entities.PROPOSAL_SAMPLES, PROPOSAL, 2.0)):
        rec.log(entity, rr.Points3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(size)), static=True)
    rec.log(entities.PARTICLES, rr.Arrows3D.from_fields(radii=rr.Radius.ui_points(1.0)), static=True)
    for entity, colour in ((entities.COVARIANCE, COVARIANCE), (entities.PROPOSAL_GAUSSIAN, PROPOSAL)):
        rec.log(entity, rr.Ellipsoids3D.from_fields(colors=[colour], fill_mode="majorwireframe"), static=True)


def log_plots(rec: rr.RecordingStream) -> None:
    """Names and colours of curves and states."""
    for entity, (names, colours) in SERIES.items():
        rec.log(entity, rr.SeriesLines(names=names, colors=colours, widths=[1.5]), static=True)
    marks = rr.SeriesPoints(names="resampled", colors=RED, markers="diamond", marker_sizes=4.0)
    rec.log(entities.ESS_RESAMPLED, marks, static=True)
    for lane, states in STATES.items():
        rec.log(lane, rr.StateConfiguration(values=list(states), colors=list(states.values())), static=True)
