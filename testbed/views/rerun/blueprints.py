# SPDX-License-Identifier: MIT
"""Where the viewer puts what: tabs for the whole run, the particles, the proposal and the final pass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import rerun as rr
import rerun.blueprint as rrb

from testbed.views.rerun import entities
from testbed.views.rerun.drawing import Extent
from testbed.views.rerun.scene.scenery import Scenery
from testbed.views.rerun.scene.styles import UNSEEN

Layout = Literal["overview", "particles", "proposal", "final pass"]

HEIGHT_PER_METRE = 1.25
"""Height of the eye above a square of 1 m that shall fill the view (the viewer's eye opens 55 degrees, less margin)."""
LANDSCAPE = 1.35
"""A map view is about this much wider than high."""
FOLLOW_HEIGHT = 25.0
"""Height of the eye above the robot while the size of the place is unknown [m]."""
HALF_VIEW = 0.95
"""Two views side by side are about this much wider than high."""
AROUND_HEIGHT = 2.5
"""Height of the eye above the robot in the close view of the overview [m]."""
CLOSE_UP_HEIGHT, WIDER_HEIGHT = 0.4, 9.0
"""Heights of the eye above the robot in the views of the proposal [m]."""
WHOLE_RUN = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())


def blueprint(scenery: Scenery, front: Layout = "overview") -> rrb.Blueprint:
    """All layouts as tabs. Without an extent the eye follows the robot from above."""
    tabs: dict[Layout, rrb.Container] = {
        "overview": overview(scenery),
        "particles": compare_particles(scenery.extent),
        "proposal": proposal(),
    }
    if scenery.final_pass:
        tabs["final pass"] = final_pass(scenery.extent)
    return rrb.Blueprint(
        rrb.Tabs(*tabs.values(), active_tab=list(tabs).index(front)),
        rrb.TimePanel(state="collapsed", timeline=entities.TIMELINE, play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def overview(scenery: Scenery) -> rrb.Horizontal:
    """Lay out the map with everything on it, next to the plots, the event log and the settings."""
    errors = [
        plot(entities.POSITION_ERROR, "Position error", "m", scenery.max_error_m, first_alone=True),
        plot(entities.HEADING_ERROR, "Heading error", "deg", scenery.max_error_deg, first_alone=True),
        plot(entities.POSITION_ERROR, "Odometry's error", "m", scenery.max_odometry_error_m),
    ]
    # one particle has none
    spread = [plot(entities.SPREAD, "Spread of the particles", "cm", curves=1)] if scenery.particles > 1 else []
    return rrb.Horizontal(
        rrb.Vertical(
            map_view("Map", scenery.extent),
            rrb.TextDocumentView(origin=entities.NOW, name="Now"),
            legend_view("map"),
            rrb.StateTimelineView(origin=entities.STATE, name="State", time_view=rrb.TimeAxis(view_range=WHOLE_RUN)),
            row_shares=[11, 1.0, 1.3, 3.9],
        ),
        rrb.Vertical(
            close_view("Around the robot", AROUND_HEIGHT),
            *([rrb.Tabs(*errors, active_tab=0)] if scenery.truth else []),
            rrb.Tabs(
                plot(entities.ESS, "Effective sample size", "particles", scenery.particles),
                *spread,
                plot(entities.MATCHED, "Beams on known walls", "", 1.0, curves=1),
                plot(entities.STAGES, "Time per update", "ms"),
                active_tab=1,  # the spread, or the share of beams
            ),
            rrb.Tabs(
                rrb.TextLogView(
                    origin=entities.EVENTS,
                    name="Events",
                    columns=rrb.TextLogColumns(
                        timeline_columns=[entities.TIMELINE], text_log_columns=["loglevel", "body"]
                    ),
                ),
                rrb.TextDocumentView(origin=entities.SETTINGS, name="Settings"),
                active_tab=0,
            ),
            row_shares=[5, *([3] if scenery.truth else []), 3, 3],
        ),
        column_shares=[3, 2],
        name="Overview",
    )


def map_view(name: str, extent: Extent | None, follow: str = entities.ESTIMATED_ROBOT) -> rrb.Spatial3DView:
    """The world from above, x to the right, with everything that is known at the time."""
    return top_view(name, [f"+ {entities.WORLD}/**"], eye(extent, follow), origin=entities.WORLD)


def close_view(name: str, height: float) -> rrb.Spatial3DView:
    """The world close up, from a height [m] above the robot."""
    return top_view(name, [f"+ {entities.WORLD}/**"], eye_above((0.0, 0.0), height), origin=entities.AROUND)


def top_view(
    name: str, contents: Sequence[str], eye_controls: rrb.EyeControls3D, origin: str = "/"
) -> rrb.Spatial3DView:
    """A view from above on the grey of what was not seen, so that a map has no edge where its squares end."""
    return rrb.Spatial3DView(
        origin=origin,
        contents=list(contents),
        name=name,
        background=list(UNSEEN),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=eye_controls,
    )


def legend_view(name: str, root: str = "", title: str = "Legend") -> rrb.Spatial2DView:
    """The meaning of the colours; root: parent of all that belongs to one of several runs."""
    return rrb.Spatial2DView(origin=f"{root}{entities.LEGEND}/{name}", name=title, background=[245, 246, 248])


def compare_particles(extent: Extent | None) -> rrb.Vertical:
    """The maps of four particles side by side, above their weights."""
    names = ("Best particle", "Lightest particle", "Most different maps (1)", "Most different maps (2)")
    views = []
    for rank, name in zip(entities.RANKS, names, strict=True):
        base = f"{entities.COMPARE}/{rank}"
        contents = [f"+ {base}/**", f"+ {entities.TRUE_WALLS}"]
        if rank == "best":
            contents += [f"+ {entities.MAP}/**", f"+ {entities.PATH}/**"]
        views.append(top_view(name, contents, eye(extent, f"{base}/robot")))
    return rrb.Vertical(
        rrb.Grid(*views, grid_columns=2),
        rrb.BarChartView(origin=entities.WEIGHTS, name="Weights of all particles"),
        row_shares=[5, 1],
        name="Particles",
    )


def proposal() -> rrb.Vertical:
    """How the new pose of the best particle is found, close up."""
    contents = [
        f"+ {entities.PROPOSAL}/**",
        f"+ {entities.MAP}/**",
        f"+ {entities.TRUE_WALLS}",
        f"+ {entities.ESTIMATED_ROBOT}/heading",
    ]
    views = [
        top_view(name, contents, eye_above((0.0, 0.0), height), origin=entities.PROPOSAL_EYE)
        for name, height in (("Proposal, close up", CLOSE_UP_HEIGHT), ("Proposal and scan", WIDER_HEIGHT))
    ]
    return rrb.Vertical(rrb.Horizontal(*views), legend_view("proposal"), row_shares=[12, 1], name="Proposal")


def final_pass(extent: Extent | None) -> rrb.Vertical:
    """Map and path before and after the final pass: side by side, or as steps of a timeline."""
    both = []
    for step in entities.FINAL_STEPS:
        contents = [f"+ {entities.FINAL}/{step}/**", f"+ {entities.TRUE_WALLS}", f"+ {entities.FINAL_TRUTH}"]
        both.append(top_view(f"{step.capitalize()} the final pass", contents, eye(extent, entities.FINAL, HALF_VIEW)))
    contents = [f"+ {entities.FINAL}/step/**", f"+ {entities.TRUE_WALLS}", f"+ {entities.FINAL_TRUTH}"]
    switch = top_view("Choose the timeline final_pass, step 0 or 1", contents, eye(extent, entities.FINAL))
    tabs = rrb.Tabs(rrb.Horizontal(*both, name="Side by side"), rrb.Horizontal(switch, name="Switch"))
    return rrb.Vertical(tabs, legend_view("final"), row_shares=[12, 1], name="Final pass")


def eye(extent: Extent | None, follow: str | None, landscape: float = LANDSCAPE) -> rrb.EyeControls3D:
    """An eye above the middle of the extent that sees all of it, or one that follows an entity.

    landscape: width of the view divided by its height
    """
    if extent is None:
        return eye_above((0.0, 0.0), FOLLOW_HEIGHT, follow)
    side = max((extent.x_max - extent.x_min) / landscape, extent.y_max - extent.y_min)
    return eye_above(extent.centre, HEIGHT_PER_METRE * side)


def eye_above(place: tuple[float, float], height: float, follow: str | None = None) -> rrb.EyeControls3D:
    """An eye above a place, x to the right."""
    x, y = place
    # straight down the viewer does not know which way is up: a hair off the vertical it does
    return rrb.EyeControls3D(
        position=(x, y - 0.01, height), look_target=(x, y, 0), eye_up=(0, 1, 0), tracking_entity=follow
    )


def plot(
    origin: str, name: str, unit: str, largest: float | None = None, *, first_alone: bool = False, curves: int = 2
) -> rrb.TimeSeriesView:
    """A plot of all series below an entity; with its largest value the axis is fixed, and its name says the range.

    first_alone: hide the second curve, the odometry's, next to which the estimate's would be flat. curves: how many
    there are. A single curve has no legend: the viewer would draw it over the curve, and list hidden curves in it
    """
    units = f" [{unit}]" if unit else ""
    shown = rr.SeriesLines.from_fields(visible_series=[True, False])
    return rrb.TimeSeriesView(
        origin=origin,
        name=f"{name}{units}" if largest is None else f"{name}{units}, 0 to {largest:.3g}",
        axis_x=rrb.TimeAxis(view_range=WHOLE_RUN),
        axis_y=None if largest is None else rrb.ScalarAxis(range=(0.0, 1.05 * max(largest, 1e-3))),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=curves > 1 and not first_alone),
        overrides={origin: shown} if first_alone else None,
    )
