# SPDX-License-Identifier: MIT
"""Results of several systems on one drive, next to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eval.report import plots
from eval.report.comparison import MEASURES
from eval.report.comparison_plots import colour_of, part_around
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

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each result: its system, with what was done to the drive where that differs."""
        changes = [result.drive.change for result in self.results]
        if len(set(changes)) == 1:
            return tuple(result.system for result in self.results)
        return tuple(
            f"{result.system}, {change or 'as driven'}" for result, change in zip(self.results, changes, strict=True)
        )

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
        for number, (name, result) in enumerate(zip(self.names, self.results, strict=True)):
            path = se2.compose(result.T_frame_map, result.trajectory.poses)[:, :2]
            curves.append((name, path, colour_of(number)))
        background = None
        if reference.grid is not None:
            background = part_around(reference.grid, np.zeros(3), [path for _, path, _ in curves])
        return html.table(("", *self.names), rows) + html.picture(plots.paths(curves, background=background))


def compare(results: Sequence[Result]) -> Comparison:
    """Put results next to each other: of one drive, or of a drive and what `perturb` made of it.

    Raises ValueError where they are of different drives, or there are none.
    """
    drives = {result.drive.origin for result in results}
    if len(drives) != 1:
        several = "; ".join(f'"{name}"' for name in sorted(drives)) or "nothing"
        raise ValueError(
            f"results of {several}: expected those of one drive, or of a drive and what perturb made of it; results of "
            "several drives are what sweep is for"
        )
    return Comparison(tuple(results))
