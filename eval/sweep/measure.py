# SPDX-License-Identifier: MIT
"""What a sweep measures: which of the three estimates of a run, in which words, and in which unit it is shown."""

from __future__ import annotations

from dataclasses import dataclass

_NAMES = {"ate_rmse_m": "trajectory error", "trans_mean_m": "relation error", "wall_thickness_m": "wall thickness"}
"""Words for common measures."""
_DEFINITIONS = {"ate_rmse_m": " (ATE: root mean square of the distances after rigid alignment)"}
_ESTIMATES = {
    "_online": ("online", "the pose reported at each scan"),
    "_filter": ("filter", "the best particle's path at the end"),
    "": ("final", "the path that the run gives out"),
}
"""Suffix of keys in `metrics.json`: name of the estimate, and what it is."""
_FINAL = ("trajectory", "map", "relations")
"""Groups of `metrics.json` that describe the estimate that the final pass refines."""
METRES_FROM = 2.0
"""Lengths are shown in metres if the largest of them is at least this long [m]."""


@dataclass(frozen=True)
class Unit:
    """How numbers are shown."""

    name: str
    """Empty for numbers without a unit."""
    factor: float
    """Multiplies values before they are shown."""

    def text(self, value: float) -> str:
        """A value with two or three significant digits, without the unit."""
        shown = abs(self.factor * value)
        digits = 2 if shown < 1.0 else 1 if shown < 100.0 else 0
        return f"{self.factor * value:.{digits}f}"


@dataclass(frozen=True)
class Measure:
    """A key of `metrics.json` of which smaller values are better."""

    key: str

    @property
    def _head(self) -> str:
        return self.key.partition(".")[0]

    @property
    def _suffix(self) -> str:
        return next((s for s in ("_online", "_filter") if self._head.endswith(s)), "")

    @property
    def estimate(self) -> str:
        """Which estimate is measured: `online`, `filter` or `final`."""
        return _ESTIMATES[self._suffix][0]

    @property
    def estimate_is(self) -> str:
        """What that estimate is, in words."""
        return _ESTIMATES[self._suffix][1]

    @property
    def needs_final_pass(self) -> bool:
        """Whether only runs with the final pass have this measure; the others hold the filter's value in its place."""
        return self._head in _FINAL

    @property
    def outcome(self) -> str:
        """The column that holds the outcome of this estimate."""
        return f"outcome{self._suffix}"

    @property
    def refined_key(self) -> str | None:
        """The same measure of the refined estimate; None if this is it, or if there is none."""
        head, dot, rest = self.key.partition(".")
        return f"{head.removesuffix('_filter')}{dot}{rest}" if head.endswith("_filter") else None

    @property
    def online_key(self) -> str | None:
        """The same measure of the poses while driving, where the path that a run gives out is measured; else None."""
        head, dot, rest = self.key.partition(".")
        return f"{head}_online{dot}{rest}" if head in ("trajectory", "relations") else None

    @property
    def words(self) -> str:
        """What is measured, without estimate and unit."""
        rest = self.key.partition(".")[2]
        plain = rest.removesuffix("_m").removesuffix("_deg").replace(".", " ").replace("_", " ")
        return _NAMES.get(rest, f"{self._head.removesuffix(self._suffix)} {plain}")

    @property
    def definition(self) -> str:
        """How the measure is defined, for the caption of a table; empty for those that docs/metrics.md defines."""
        return _DEFINITIONS.get(self.key.partition(".")[2], "")

    def unit(self, largest: float) -> Unit:
        """The unit that fits values up to `largest`: cm or m for lengths, deg for angles, none for other numbers."""
        if self.key.endswith("_m"):
            return Unit("m", 1.0) if largest >= METRES_FROM else Unit("cm", 100.0)
        return Unit("deg", 1.0) if self.key.endswith("_deg") else Unit("", 1.0)
