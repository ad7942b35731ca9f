# SPDX-License-Identifier: MIT
"""Where the viewer puts what: a tab with everything at a glance, and one that compares four particles."""

from __future__ import annotations

from typing import Literal

import rerun as rr
import rerun.blueprint as rrb

from testbed.views.rerun import entities
from testbed.views.rerun.drawing import Extent
from testbed.views.rerun.scenery import Scenery

Layout = Literal["overview", "compare"]

PAPER = [236, 238, 242]
HEIGHT_PER_METRE = 1.25
"""Height of the eye above a square of 1 m that shall fill the view (the viewer's eye opens 55 degrees, less margin)."""
LANDSCAPE = 1.35
"""A map view is about this much wider than high."""
FOLLOW_HEIGHT = 25.0
"""Height of the eye above the robot while the size of the place is unknown [m]."""
WHOLE_RUN = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())


def blueprint(scenery: Scenery, front: Layout = "overview") -> rrb.Blueprint:
    """Both layouts as tabs. Without an extent the eye follows the robot from above."""
    return rrb.Blueprint(
        rrb.Tabs(overview(scenery), compare_particles(scenery.extent), active_tab=("overview", "compare").index(front)),
        rrb.TimePanel(state="collapsed", timeline=entities.TIMELINE, play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def overview(scenery: Scenery) -> rrb.Horizontal:
    """The map with everything on it, beside the plots, the event log and the settings."""
    errors = [
        plot(entities.POSITION_ERROR, "Position error [m]"),
        plot(entities.HEADING_ERROR, "Heading error [deg]"),
    ]
    return rrb.Horizontal(
        rrb.Vertical(
            map_view(scenery.extent),
            rrb.StateTimelineView(origin=entities.STATE, name="State", time_view=rrb.TimeAxis(view_range=WHOLE_RUN)),
            row_shares=[6, 1],
        ),
        rrb.Vertical(
            *(errors if scenery.truth else []),
            plot(entities.ESS, "Effective sample size", upper=1.05 * scenery.particles),
            rrb.Tabs(
                plot(entities.MATCHED, "Matched share", upper=1.05),
                plot(entities.STAGES, "Time per stage [ms]"),
                rrb.BarChartView(origin=entities.WEIGHTS, name="Weights"),
                active_tab=0,
            ),
            rrb.Tabs(
                rrb.TextLogView(origin=entities.EVENTS, name="Events"),
                rrb.TextDocumentView(origin=entities.SETTINGS, name="Settings"),
                active_tab=0,
            ),
        ),
        column_shares=[3, 2],
        name="Overview",
    )


def map_view(extent: Extent | None) -> rrb.Spatial3DView:
    """The world from above, x to the right. The true map is there to be switched on."""
    whole_history = rrb.VisibleTimeRanges(
        [
            rrb.VisibleTimeRange(
                entities.TIMELINE,
                start=rrb.TimeRangeBoundary.infinite(),
                end=rrb.TimeRangeBoundary.cursor_relative(),
            )
        ]
    )
    return rrb.Spatial3DView(
        origin=entities.WORLD,
        contents=[f"+ {entities.WORLD}/**", *(f"+ {root}/**" for root in entities.ROBOT_MODELS)],
        name="Map",
        background=PAPER,
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye(extent),
        overrides={
            entities.TRUE_MAP: rrb.EntityBehavior(visible=False),
            entities.TRUE_PATH: whole_history,
            entities.ODOMETRY_PATH: whole_history,
        },
    )


def compare_particles(extent: Extent | None) -> rrb.Grid:
    """The maps of four particles, from the heaviest to the lightest, side by side."""
    return rrb.Grid(
        *(
            rrb.Spatial3DView(
                origin="/",
                contents=[f"+ {entities.COMPARE}/{rank}/**"],
                name=f"Particle: {rank.replace('_', ' ')}",
                background=PAPER,
                line_grid=rrb.LineGrid3D(visible=False),
                eye_controls=eye(extent, follow=f"{entities.COMPARE}/{rank}/robot"),
            )
            for rank in entities.RANKS
        ),
        grid_columns=2,
        name="Compare particles",
    )


def eye(extent: Extent | None, follow: str = entities.ESTIMATED_ROBOT) -> rrb.EyeControls3D:
    """An eye above the middle of the extent that sees all of it, or one that follows an entity."""
    if extent is None:
        return rrb.EyeControls3D(
            position=(0, -0.01, FOLLOW_HEIGHT), look_target=(0, 0, 0), eye_up=(0, 1, 0), tracking_entity=follow
        )
    x, y = extent.centre
    side = max((extent.x_max - extent.x_min) / LANDSCAPE, extent.y_max - extent.y_min)
    # straight down the viewer does not know which way is up: a hair off the vertical it does
    return rrb.EyeControls3D(position=(x, y - 0.01, HEIGHT_PER_METRE * side), look_target=(x, y, 0), eye_up=(0, 1, 0))


def plot(origin: str, name: str, upper: float | None = None) -> rrb.TimeSeriesView:
    """A plot of all series below an entity; with `upper` its axis is fixed to [0, upper]."""
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(view_range=WHOLE_RUN),
        axis_y=None if upper is None else rrb.ScalarAxis(range=(0.0, upper)),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
    )
