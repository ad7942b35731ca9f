# SPDX-License-Identifier: MIT
"""Check a score against limits, for continuous integration.

A limit is a condition that must NOT hold: `trajectory.ate_rmse_m > 0.05`, `map.iou < 0.5`, `outcome != ok`. On the left
is a key of `metrics.json`, with dots between the levels; then one of < <= > >= == !=; on the right a number or a word.
"""

from __future__ import annotations

import difflib
import math
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

_OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
_FORM = re.compile(r"\s*([\w.-]+)\s*(<=|>=|==|!=|<|>)\s*(\S(?:.*\S)?)\s*")


class LimitError(ValueError):
    """A limit that cannot be read, or names a key that the score does not have."""


@dataclass(frozen=True)
class Limit:
    """One limit; the score breaks it where the comparison holds."""

    text: str
    key: str
    comparison: str
    bound: float | str

    @classmethod
    def parse(cls, text: str) -> Limit:
        """Read a limit such as `map.iou < 0.5`; raises LimitError, with an example, where it is none."""
        form = _FORM.fullmatch(text)
        if form is None:
            raise LimitError(f"--fail-if {text!r}: expected KEY COMPARISON VALUE, as in 'trajectory.ate_rmse_m > 0.05'")
        key, comparison, value = form.groups()
        word = value.strip("'\"")
        try:
            bound: float | str = float(value)
        except ValueError:
            if comparison not in ("==", "!="):
                raise LimitError(f"--fail-if {text!r}: expected a number after {comparison}, got {value}") from None
            bound = word
        if isinstance(bound, float) and math.isnan(bound):
            raise LimitError(f"--fail-if {text!r}: nothing can be compared with NaN")
        return cls(text.strip(), key, comparison, bound)

    def broken_by(self, metrics: Mapping[str, Any]) -> str | None:
        """Return a sentence if the score breaks this limit, else None.

        A measure that could not be computed breaks every limit on it, and so does one of a trajectory that is too short
        to be judged. Raises LimitError if there is no such key, or numbers are compared with words.
        """
        value = _find(metrics, self.key)
        if value is None:
            return f"{self.text}: {self.key} could not be measured"
        if metrics.get("outcome") == "unjudged" and self.key.startswith("trajectory"):
            return f"{self.text}: the trajectory is unjudged: {metrics.get('outcome_reason', 'no reason is given')}"
        if isinstance(value, str) != isinstance(self.bound, str) or not isinstance(value, str | int | float):
            raise LimitError(f"--fail-if {self.text!r}: {self.key} is {_kind(value)}, not {_kind(self.bound)}")
        if not _OPERATORS[self.comparison](value, self.bound):
            return None
        return f"{self.text}: {self.key} is {value if isinstance(value, str) else format(value, '.6g')}"


def check(metrics: Mapping[str, Any], limits: Iterable[Limit]) -> list[str]:
    """Return one sentence for each limit that the score (`metrics.json`) breaks; raises as `Limit.broken_by` does."""
    return [sentence for limit in limits if (sentence := limit.broken_by(metrics)) is not None]


_GROUPS = ("trajectory", "map", "relations", "filter", "localization", "self")
"""Groups of measures that a score has or not; estimates of a run add a suffix, as in `map_filter`."""
_PIECES = re.compile(r"(.*\.)?rpe\.\d+(\.\d+)?[ms]\.(trans_\w+_m|rot_\w+_deg|pieces)")
"""Relative errors over pieces, which a short path does not have."""


def _find(metrics: Mapping[str, Any], key: str) -> Any:
    """Return a measure; None where it could not be computed. Raises LimitError for a key that does not exist."""
    value: Any = metrics
    for part in key.split("."):
        if value is None:
            return None
        if not isinstance(value, Mapping) or part not in value:
            if (value is metrics and part.split("_")[0] in _GROUPS and "." in key) or _PIECES.fullmatch(key):
                return None
            near = difflib.get_close_matches(key, list(_keys(metrics)), n=3, cutoff=0.4)
            hint = f"; near: {', '.join(near)}" if near else ""
            raise LimitError(f"--fail-if: the score has no {key}{hint}")
        value = value[part]
    return value


def _keys(metrics: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in metrics.items():
        if isinstance(value, Mapping):
            yield from _keys(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


def _kind(value: Any) -> str:
    if isinstance(value, str):
        return "a word"
    return "a number" if isinstance(value, int | float) else "a group of numbers"
