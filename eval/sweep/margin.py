# SPDX-License-Identifier: MIT
"""The margin of an answer: how much larger an error may be than that of the largest count before it matters."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "": 1.0}
"""Units of the absolute part, as multiples of the unit of the measure (metres, or none)."""
_PART = re.compile(r"(\d{1,9}(?:\.\d{1,9})?)\s*(%|mm|cm|m|)")
_EXPECTED = "expected a share such as 10%, a length such as 2mm, or both as 10%,5mm (the larger one counts)"


@dataclass(frozen=True)
class Margin:
    """The difference between two particle counts below which it does not matter."""

    share: float = 0.1
    """Relative to the median error of the largest count; 0 = none."""
    floor: float = 0.005
    """Smallest margin, in the unit of the measure [m]: by default a tenth of a map cell."""

    def of(self, error: float) -> float:
        """Margin for an error of this size, in the unit of the measure."""
        return max(self.share * error, self.floor)

    def words(self, *, is_length: bool) -> str:
        """`5 mm (10 % where that is more)`, `10 %`, `2 mm`; is_length: the measure is in metres."""
        share = f"{100.0 * self.share:g} %"
        floor = f"{1e3 * self.floor:g} mm" if is_length else f"{self.floor:g}"
        if not self.floor:
            return share
        return f"{floor} ({share} where that is more)" if self.share else floor


MARGIN = Margin()


def share_words(margin: float, error: float) -> str:
    """A margin as a share of an error, in words: `23 %`; empty if the error is unknown or not positive."""
    if not (math.isfinite(margin) and error > 0.0):
        return ""
    share = 100.0 * margin / error
    return f"{share:.0f} %" if share >= 1.0 else f"{share:.2g} %"


def parse_margin(text: str) -> Margin:
    """Parse `10%`, `2mm`, `10%,5mm`, or a plain number in the unit of the measure; empty = `MARGIN`.

    Raises ValueError in one line for other text and for a margin of 0.
    """
    if not text:
        return MARGIN
    parts = [_PART.fullmatch(word.strip()) for word in text.split(",")]
    values = {("share" if part[2] == "%" else "floor"): part for part in parts if part is not None}
    if None in parts or len(values) < len(parts):
        raise ValueError(f"{text!r}: {_EXPECTED}")
    share = float(values["share"][1]) / 100.0 if "share" in values else 0.0
    floor = float(values["floor"][1]) * _LENGTHS[values["floor"][2]] if "floor" in values else 0.0
    if not (share or floor):
        raise ValueError(f"{text!r}: a margin of 0 cannot be shown to hold; {_EXPECTED}")
    return Margin(share, floor)
