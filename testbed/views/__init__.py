# SPDX-License-Identifier: MIT
"""Live and recorded views of a run, always optional; Rerun is loaded only when a view is opened."""

from testbed.views.opening import (
    DEMO,
    NoDisplayError,
    OpenedRun,
    events_of,
    moments_for_report,
    moments_of,
    open_run,
    open_view,
    record_frames,
    record_side_by_side,
    record_systems,
    recording_of,
)
from testbed.views.view import FinalLoop, NullView, Proposal, Scene, Snapshot, SystemLayer, View, ViewOptions

__all__ = [
    "DEMO",
    "FinalLoop",
    "NoDisplayError",
    "NullView",
    "OpenedRun",
    "Proposal",
    "Scene",
    "Snapshot",
    "SystemLayer",
    "View",
    "ViewOptions",
    "events_of",
    "moments_for_report",
    "moments_of",
    "open_run",
    "open_view",
    "record_frames",
    "record_side_by_side",
    "record_systems",
    "recording_of",
]
