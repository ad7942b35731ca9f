# SPDX-License-Identifier: MIT
"""Compares the accuracy of a sweep with a stored baseline, given the noise of the seeds.

Errors of simulated runs vary by factors, so their logarithms are compared. The standard deviation over seeds is that of
the baseline, pooled over the groups of a line, since one group has too few seeds.
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
"""Probability that the check fails although nothing changed, over all comparisons together."""
MIN_DEVIATION = 0.02
"""Smallest assumed standard deviation of the logarithm of the errors; a line without randomness has none."""

Errors = dict[tuple[str, str, int], NDArray[np.float64]]
"""Error of each seed by place, line and particle count."""


class BaselineError(ValueError):
    """The baseline cannot be used. The message names the file and what was expected."""


@dataclass(frozen=True)
class Comparison:
    """Accuracy of one group, or of all groups of a line, relative to the baseline."""

    name: str
    factor: float
    """Geometric mean of the errors, as a multiple of the baseline's."""
    allowed: float
    """The largest factor that the noise of the seeds explains."""

    @property
    def worse(self) -> bool:
        """Whether accuracy is worse by more than the noise. A group with a run without a result counts as worse."""
        return not self.factor <= self.allowed

    @property
    def better(self) -> bool:
        """Whether accuracy is better by more than the noise: the baseline should be renewed."""
        return self.factor < 1.0 / self.allowed


def write_baseline(table: SweepTable, path: str | os.PathLike[str]) -> None:
    """Write the errors of a sweep as a baseline; raises BaselineError if a run has no result."""
    groups = _errors(table)
    for (place, line, count), errors in groups.items():
        if not np.isfinite(errors).all():
            raise BaselineError(
                f"{place}, {line}, {count} particles: a run has no result, expected results of all runs for a baseline"
            )
    document = {
        "measure": table.measure.key,
        "code": table.code,
        "groups": [
            {"place": place, "line": line, "particles": count, "errors": [round(e, 6) for e in errors.tolist()]}
            for (place, line, count), errors in groups.items()
        ],
    }
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


def compare_with_baseline(table: SweepTable, path: str | os.PathLike[str]) -> list[Comparison]:
    """Compare each group of a sweep, and each line as a whole, with the baseline in a file.

    Raises BaselineError if the file cannot be read or belongs to another sweep.
    """
    base, now = _read(Path(path), table.measure.key), _errors(table)
    if base.keys() != now.keys() or any(len(base[group]) != len(now[group]) for group in now):
        raise BaselineError(
            f"{path}: has other worlds, lines, particle counts or seeds than the sweep; renew it with --update-baseline"
        )
    comparisons = []
    bands = len(now) + len(table.lines)
    for line in table.lines:
        groups = [group for group in now if group[1] == line]
        spread, freedom = _pooled_deviation([np.log(base[group]) for group in groups])
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


def _pooled_deviation(groups: Sequence[NDArray[np.float64]]) -> tuple[float, int]:
    """Pooled standard deviation within groups, and its degrees of freedom; NaN for one seed per group."""
    freedom = sum(len(values) - 1 for values in groups)
    squares = sum(float(np.sum((values - values.mean()) ** 2)) for values in groups)
    return (max(math.sqrt(squares / freedom), MIN_DEVIATION) if freedom else math.nan), freedom


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
        raise BaselineError(f"{path}: measures {measured_by}, this sweep measures {measure}")
    if any(len(errors) < 2 or not (errors > 0.0).all() for errors in groups.values()):
        raise BaselineError(f"{path}: expected positive errors of at least two seeds in each group")
    return groups
