# SPDX-License-Identifier: MIT
"""What never changes in a recording: colours, widths, names, the true walls, the robots' shapes.

Rerun lets a component that is logged once for all hide the same component logged later: style is logged here only.
"""

from __future__ import annotations

import rerun as rr

from testbed.views.rerun import drawing, entities
from testbed.views.rerun.archetypes import strips
from testbed.views.rerun.layers import events
from testbed.views.rerun.scene.legend import Entry, legend_image
from testbed.views.rerun.scene.robot_model import log_robot
from testbed.views.view import Scene

TRUTH, ODOMETRY, ESTIMATE = (30, 150, 70), (235, 130, 10), (40, 90, 210)
SCAN, COVARIANCE, PROPOSAL, FAN = (220, 40, 140), (120, 40, 200), (0, 150, 160), (120, 140, 190)
FREE, WALL, UNSEEN = (255, 255, 255), (0, 0, 0), (205, 205, 205)
RED, GREY = (210, 50, 50), (150, 160, 170)
DEAD = (95, 95, 95)
"""Of histories that ended: no shade of the weights, so that nobody takes them for heavy particles."""
LABEL = (70, 130, 235)
"""Of labels: it can be read on the dark ground of the native viewer and on the light one of the web page."""
Z_TRUE_WALLS, Z_TRUTH, Z_ODOMETRY, Z_FAN, Z_ESTIMATE, Z_ELLIPSE, Z_TOP = 0.01, 0.02, 0.03, 0.035, 0.04, 0.05, 0.06
"""Heights at which things are drawn [m], so that they do not fight for the same pixels."""
STATES = {
    entities.ESTIMATE_STATE: {events.GOOD: TRUTH, events.DRIFTED: ODOMETRY, events.LOST: RED},
    entities.SELF_CHECK_STATE: {events.PLAUSIBLE: GREY, events.DOUBTFUL: ODOMETRY, events.CALLED_LOST: RED},
    entities.LOCALIZATION_STATE: {events.SEARCHING: RED, events.AMBIGUOUS: ODOMETRY, events.FOUND: TRUTH},
    entities.MATCHING_STATE: {events.MATCHED: GREY, events.POORLY_MATCHED: ODOMETRY, events.MATCH_FAILED: RED},
    entities.ROBOT_STATE: {events.DRIVING: GREY, events.COLLIDED: RED},
}
LINES = {
    entities.PARTICLE_PATHS: (FAN, 0.5),
    entities.DEAD_BRANCHES: (DEAD, 1.5),
}
"""Colour and half the width in points of the screen."""
PATHS = {
    entities.TRUE_PATH: (TRUTH, 2.6, Z_TRUTH),
    entities.ODOMETRY_PATH: (ODOMETRY, 1.2, Z_ODOMETRY),
    entities.PATH: (ESTIMATE, 1.2, Z_ESTIMATE),
    **{f"{entities.COMPARE}/{rank}/path": (ESTIMATE, 1.2, Z_ESTIMATE) for rank in entities.RANKS},
}
"""Colour, half the width in points of the screen, and height [m] of the paths that are sent in blocks."""
FINAL_LOOPS = dict(zip(entities.FINAL_LOOPS, (PROPOSAL, COVARIANCE, RED), strict=True))
"""Colours of the loops that the final pass found, by their kind."""
SERIES = {
    entities.POSITION_ERROR: (["estimate", "odometry"], [ESTIMATE, ODOMETRY]),
    entities.HEADING_ERROR: (["estimate", "odometry"], [ESTIMATE, ODOMETRY]),
    entities.ESS_VALUE: (["effective sample size"], [ESTIMATE]),
    entities.SPREAD: (["spread of the particles"], [COVARIANCE]),
    entities.MATCHED: (["matched share"], [ESTIMATE]),
    entities.STAGES: (["match", "map", "resample"], [ESTIMATE, TRUTH, ODOMETRY]),
}
"""Names and colours of the curves."""


def legend(truth: bool, particles: int) -> tuple[tuple[Entry, ...], ...]:
    """The rows of the legend, with the colours of the truth where it is known, and of what the particles have: a single
    one has no histories that end, and no other can become the best.

    The footprint of a robot has the colour of its path.
    """
    known: tuple[Entry, ...] = (("band", (TRUTH,), "truth: path, robot, thin walls"),) if truth else ()
    on_all: tuple[Entry, ...] = (
        *known,
        ("line", (ESTIMATE,), "estimate: path, robot"),
        ("line", (ODOMETRY,), "odometry alone"),
        ("dot", (SCAN, SCAN, SCAN), "scan, from the estimated pose"),
        ("square", (FREE, WALL, UNSEEN), "map: free, wall, not seen"),
    )
    ellipse: Entry = ("ellipse", (COVARIANCE,), "95 % by the filter's own covariance")
    if particles == 1:
        return (on_all, (("arrow", (drawing.HEAVY,), "particle"), ellipse))
    of_particles: tuple[Entry, ...] = (
        ("arrow", (drawing.LIGHT, drawing.HEAVY), "particles, light to heavy"),
        ("thin", (FAN,), "their histories"),
        ("band", (DEAD,), "histories that ended at the last resampling"),
        ellipse,
    )
    jumps: tuple[Entry, ...] = (("diamond", (PROPOSAL,), "another became the best"),) if truth else ()
    return (on_all, (*of_particles, *jumps))


def legend_of_final_pass(truth: bool) -> tuple[tuple[Entry, ...], ...]:
    """The rows of the legend of the final pass."""
    known: tuple[Entry, ...] = (("band", (TRUTH,), "truth"),) if truth else ()
    closed, left_open, rejected = FINAL_LOOPS.values()
    return (
        (
            *known,
            ("line", (ESTIMATE,), "estimated path"),
            ("band", (closed,), "loop that the filter had closed"),
            ("band", (left_open,), "loop that it had left open"),
            ("band", (rejected,), "rejected loop"),
        ),
    )


PROPOSAL_LEGEND: tuple[tuple[Entry, ...], ...] = (
    (
        ("ellipse", (ODOMETRY,), "prior: odometry's prediction, 95 %"),
        ("dot", (drawing.LIGHT, drawing.HEAVY), "samples about the optimum, by weight"),
        ("ellipse", (PROPOSAL,), "Gaussian fitted to them, 95 %"),
        ("dot", (SCAN, SCAN, SCAN), "scan, from the Gaussian's mean"),
    ),
)


def log_scene(rec: rr.RecordingStream, scene: Scene) -> None:
    """Log everything that is known before the first scan."""
    rec.log(entities.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if scene.settings:
        rec.log(entities.SETTINGS, rr.TextDocument(scene.settings, media_type=rr.MediaType.MARKDOWN), static=True)
    if scene.true_map is not None:
        log_true_walls(rec, scene)
        log_robot(rec, entities.TRUE_ROBOT, scene.robot_radius, TRUTH)
    log_robot(rec, entities.ESTIMATED_ROBOT, scene.robot_radius, ESTIMATE)
    log_shapes(rec, scene.particles)
    log_plots(rec)
    truth = scene.true_map is not None
    legends = (
        ("map", legend(truth, scene.particles)),
        ("proposal", PROPOSAL_LEGEND),
        ("final", legend_of_final_pass(truth)),
    )
    for name, rows in legends:
        image = rr.EncodedImage(contents=legend_image(rows), media_type="image/png")
        rec.log(f"{entities.LEGEND}/{name}", image, static=True)


def log_true_walls(rec: rr.RecordingStream, scene: Scene) -> None:
    """Draw the true walls as thin lines: over black walls of the map where it is right, alone where it is not."""
    assert scene.true_map is not None
    lines = drawing.wall_lines(scene.true_map)
    if lines:
        walls = rr.LineStrips3D.from_fields(
            strips=strips(lines, Z_TRUE_WALLS), colors=[TRUTH], radii=rr.Radius.ui_points(0.4)
        )
        rec.log(entities.TRUE_WALLS, walls, static=True)


def line_style(colour: tuple[int, int, int], width: float) -> rr.LineStrips3D:
    """Style of lines: colour, and half the width in points of the screen."""
    return rr.LineStrips3D.from_fields(colors=[colour], radii=rr.Radius.ui_points(width))


def log_shapes(rec: rr.RecordingStream, particles: int) -> None:
    """Log colours and widths of what is on the map; a single particle is drawn larger: the line of its ellipse, which
    is small, would cover it."""
    for entity, (colour, width) in LINES.items():
        rec.log(entity, line_style(colour, width), static=True)
    for entity in (entities.PATH, entities.TRUE_PATH, entities.ODOMETRY_PATH):
        rec.log(f"{entity}/newest", line_style(*PATHS[entity][:2]), static=True)
    for entity in (entities.SCAN, entities.PROPOSAL_SCAN):
        rec.log(entity, rr.Points3D.from_fields(colors=[SCAN], radii=rr.Radius.ui_points(1.5)), static=True)
    for entity, size in ((entities.PARTICLE_DOTS, 4.5 if particles == 1 else 2.5), (entities.PROPOSAL_SAMPLES, 3.5)):
        rec.log(entity, rr.Points3D.from_fields(radii=rr.Radius.ui_points(size)), static=True)
    for rank in entities.RANKS:
        mark = rr.Points3D([[0, 0, Z_TOP]], colors=LABEL, radii=rr.Radius.ui_points(4.0))
        rec.log(f"{entities.COMPARE}/{rank}/robot/label", mark, static=True)
    rec.log(entities.PARTICLES, rr.Arrows3D.from_fields(radii=rr.Radius.ui_points(1.0)), static=True)
    for entity, colour in (
        (entities.COVARIANCE, COVARIANCE),
        (entities.PROPOSAL_PRIOR, ODOMETRY),
        (entities.PROPOSAL_GAUSSIAN, PROPOSAL),
    ):
        style = rr.Ellipsoids3D.from_fields(
            colors=[colour], fill_mode="majorwireframe", line_radii=rr.Radius.ui_points(1.2)
        )
        rec.log(entity, style, static=True)


def log_plots(rec: rr.RecordingStream) -> None:
    """Log names and colours of curves and states."""
    for entity, (names, colours) in SERIES.items():
        rec.log(entity, rr.SeriesLines(names=names, colors=colours, widths=[1.5]), static=True)
    marks = rr.SeriesPoints(names="resampled", colors=ODOMETRY, markers="diamond", marker_sizes=4.0)
    rec.log(entities.ESS_RESAMPLED, marks, static=True)
    marks = rr.SeriesPoints(
        names="another particle became the best", colors=PROPOSAL, markers="diamond", marker_sizes=3.0
    )
    rec.log(entities.ANOTHER_BEST, marks, static=True)
    for lane, states in STATES.items():
        rec.log(lane, rr.StateConfiguration(values=list(states), colors=list(states.values())), static=True)
