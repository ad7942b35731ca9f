# SPDX-License-Identifier: MIT
"""Results of several systems on one drive, next to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eval.report import plots
from eval.report.comparison import MEASURES
from eval.report.comparison_plots import colour_of
from eval.report.map_images import draw_map, frame_around
from slam import se2
from testbed.library import html
from testbed.library.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Results that show themselves as one table and one picture."""

    results: tuple[Result, ...]

    def __repr__(self) -> str:
        """A line for each result."""
        return "\n".join(map(repr, self.results))

    def _repr_html_(self) -> str:
        rows = [("outcome", *(result.metrics["outcome"] for result in self.results))]
        for measure in MEASURES:
            values = [result.metric(measure.key) for result in self.results]
            if any(value is not None for value in values):
                texts = ("–" if v is None else measure.number_format.format(measure.factor * v) for v in values)
                rows.append((measure.label, *texts))
        reference = self.results[0].drive.recorded.reference
        truth = reference.trajectory
        curves: list[plots.Series] = [] if truth is None else [("truth", truth.poses[:, :2], plots.TRUTH)]
        for number, result in enumerate(self.results):
            path = se2.compose(result.T_frame_map, result.trajectory.poses)[:, :2]
            curves.append((result.system, path, colour_of(number)))
        background = None
        if reference.grid is not None:
            frame = frame_around(reference.grid, np.zeros(3), [], 0.5)
            background = draw_map(reference.grid, frame, np.zeros(3))
        names = ("", *(result.system for result in self.results))
        return html.table(names, rows) + html.picture(plots.paths(curves, background=background))


def compare(results: Sequence[Result]) -> Comparison:
    """Put results next to each other. Raises ValueError where they are of different drives, or there are none."""
    names = {result.drive.name for result in results}
    if len(names) != 1:
        raise ValueError(f"results of {', '.join(sorted(names)) or 'nothing'}, expected those of one drive")
    return Comparison(tuple(results))
