# SPDX-License-Identifier: MIT
"""Whether accuracy has got worse since a baseline was written, by more than other seeds would make it.

Errors of simulated runs spread by factors, so all is done with their logarithms. The spread of the seeds is taken from
the baseline, pooled over the groups of a line: a few seeds alone would not tell it.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from eval.files.atomic_write import atomic_write
from eval.sweep.results import SweepTable

FALSE_ALARMS = 0.01
"""Chance that nothing has changed and the gate fails all the same, over all comparisons together."""
LEAST_SPREAD = 0.02
"""Standard deviation of the logarithm of the errors that is assumed at least: a line without chance has none."""

Errors = dict[tuple[str, str, int], NDArray[np.float64]]
"""Error of each seed by place, line and particle count."""


class BaselineError(ValueError):
    """A baseline cannot be used; the message names the file and what was expected."""


@dataclass(frozen=True)
class Comparison:
    """Accuracy of one group, or of all groups of a line, beside that of the baseline."""

    name: str
    factor: float
    """Geometric mean of the errors, as a multiple of the baseline's."""
    allowed: float
    """The largest factor that the seeds' noise explains."""

    @property
    def worse(self) -> bool:
        """Whether accuracy has left the band; so does a group in which a run has no result."""
        return not self.factor <= self.allowed

    @property
    def better(self) -> bool:
        """Whether it has left the band on the other side: time for a new baseline."""
        return self.factor < 1.0 / self.allowed


def write_baseline(table: SweepTable, path: str | os.PathLike[str]) -> None:
    """Keep the errors of a sweep as the baseline of later ones; BaselineError where a run has no result."""
    groups = _errors(table)
    for (place, line, count), errors in groups.items():
        if not np.isfinite(errors).all():
            raise BaselineError(f"{place}, {line}, {count} particles: a run has no result, so this is no baseline")
    document = {
        "measure": table.measure,
        "code": table.code,
        "groups": [
            {"place": place, "line": line, "particles": count, "errors": [round(e, 6) for e in errors.tolist()]}
            for (place, line, count), errors in groups.items()
        ],
    }
    with atomic_write(path) as aside:
        aside.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def compare_with_baseline(table: SweepTable, path: str | os.PathLike[str]) -> list[Comparison]:
    """Each group of a sweep, and each line as a whole, beside the baseline in a file.

    Raises BaselineError where the file cannot be read or is of another sweep.
    """
    base, now = _read(Path(path), table.measure), _errors(table)
    if base.keys() != now.keys() or any(len(base[group]) != len(now[group]) for group in now):
        raise BaselineError(f"{path}: is of other places, lines, particle counts or seeds; renew it")
    comparisons = []
    bands = len(now) + len(table.lines)
    for line in table.lines:
        groups = [group for group in now if group[1] == line]
        spread, freedom = _pooled_spread([np.log(base[group]) for group in groups])
        t = float(stdtrit(freedom, 1.0 - FALSE_ALARMS / bands))  # Bonferroni: over all bands together
        moved = {group: float(np.mean(np.log(now[group]) - np.log(base[group]))) for group in groups}
        error_of_one = {group: spread * math.sqrt(2.0 / len(now[group])) for group in groups}
        for place, _, count in groups:
            group = place, line, count
            name = f"{place}, {line}, {count} particles"
            comparisons.append(Comparison(name, math.exp(moved[group]), math.exp(t * error_of_one[group])))
        together = math.sqrt(sum(e * e for e in error_of_one.values())) / len(groups)
        mean = float(np.mean(list(moved.values())))
        comparisons.append(Comparison(f"{line}, all together", math.exp(mean), math.exp(t * together)))
    return comparisons


def _errors(table: SweepTable) -> Errors:
    return {
        (place, line, count): table.error[p, k, c]
        for p, place in enumerate(table.places)
        for k, line in enumerate(table.lines)
        for c, count in enumerate(table.counts)
    }


def _pooled_spread(groups: Sequence[NDArray[np.float64]]) -> tuple[float, int]:
    """Standard deviation within groups of equal variance, and its degrees of freedom; NaN for one seed each."""
    freedom = sum(len(values) - 1 for values in groups)
    squares = sum(float(np.sum((values - values.mean()) ** 2)) for values in groups)
    return (max(math.sqrt(squares / freedom), LEAST_SPREAD) if freedom else math.nan), freedom


def _read(path: Path, measure: str) -> Errors:
    try:
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        groups: Errors = {
            (str(g["place"]), str(g["line"]), int(g["particles"])): np.array(g["errors"], dtype=np.float64)
            for g in document["groups"]
        }
        measured_by = document["measure"]
    except FileNotFoundError:
        raise BaselineError(f"{path}: no such file; --update-baseline writes it") from None
    except (ValueError, KeyError, TypeError) as error:
        raise BaselineError(f"{path}: {error}: expected a baseline that --update-baseline wrote") from None
    if measured_by != measure:
        raise BaselineError(f"{path}: is of {measured_by}, this sweep of {measure}")
    if any(len(errors) < 2 or not (errors > 0.0).all() for errors in groups.values()):
        raise BaselineError(f"{path}: expected positive errors of at least two seeds in each group")
    return groups
