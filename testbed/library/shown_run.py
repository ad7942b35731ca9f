# SPDX-License-Identifier: MIT
"""A run in a notebook: outcome, map and paths, and the viewer with its recording."""

from __future__ import annotations

import atexit
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from eval.files.run_reader import RunFiles, read_run
from eval.report import plots
from eval.report.map_images import draw_map, frame_around
from slam import se2
from testbed.library import html
from testbed.library.drive import AnyPath
from testbed.views import OpenedRun, open_run, recording_of

VIEWER_HEIGHT = 620
"""Height of the viewer in a page [px]."""


@dataclass(frozen=True, eq=False, repr=False)
class ShownRun:
    """A run that shows itself, and the web page that has its recording as long as this Python runs."""

    path: Path
    files: RunFiles | None
    """The run; None where the path is a recording only."""
    viewer: OpenedRun | None
    """The server of the page; None where none was asked for."""

    def close(self) -> None:
        """End the server of the page; may be called twice."""
        if self.viewer is not None:
            self.viewer.process.terminate()
            self.viewer.process.wait()

    def __repr__(self) -> str:
        """One line: the outcome, and where the viewer is."""
        words = [] if self.files is None else [str(self.files.metrics["outcome"])]
        error = None if self.files is None else self.files.metric("trajectory.ate_rmse_m")
        words += [] if error is None else [f"error {error:.3f} m"]
        words += [] if self.viewer is None else [f"viewer at {self.viewer.address}"]
        return f"<Run {self.path.resolve().name}: {', '.join(words)}>"

    def _repr_html_(self) -> str:
        shown = html.line(repr(self)) + ("" if self.files is None else _picture_of(self.files))
        if self.viewer is None:
            return shown
        style = f"width:100%; height:{VIEWER_HEIGHT}px; border:0"
        return f'{shown}<iframe src="{escape(str(self.viewer.address))}" style="{style}"></iframe>'


def show(run: AnyPath, *, viewer: bool = True) -> ShownRun:
    """Show a run in a notebook.

    run: a run directory, or a recording (.rrd); viewer: whether to embed the Rerun viewer, which a server on this
    machine gives to the browser

    Raises ValueError where there is no finished run, or no recording.
    """
    path = Path(run)
    files = read_run(path) if path.is_dir() else None
    opened = None
    if viewer and (files is None or recording_of(path) is not None):
        opened = open_run(path, serve=True)
    found = ShownRun(path, files, opened)
    atexit.register(found.close)
    return found


def _picture_of(run: RunFiles) -> str:
    """The map of a run with its paths, as the truth sees them where it is known; nothing where there is no map."""
    T = run.metric("trajectory.T_truth_estimate")
    T_frame_map = np.zeros(3) if T is None else np.asarray(T, dtype=np.float64)
    curves: list[plots.Series] = [] if run.truth is None else [("truth", run.truth.poses[:, :2], plots.TRUTH)]
    if run.estimate is not None:
        curves.append(("estimate", se2.compose(T_frame_map, run.estimate.poses)[:, :2], plots.ESTIMATE))
    if run.grid is None or not run.grid.known.any():
        return ""
    background = draw_map(run.grid, frame_around(run.grid, T_frame_map, [], 0.5), T_frame_map)
    return html.picture(plots.paths(curves, background=background))
