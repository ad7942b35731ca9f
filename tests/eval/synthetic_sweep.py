# SPDX-License-Identifier: MIT
"""Tables of a sweep as `testbed gather` writes them, with errors that a test chooses."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

PLACES, LINES, COUNTS = ("hall_a", "cave"), ("improved", "motion"), (1, 5, 20)
Choose = Callable[[int, int, int, int], float]
"""From indices of place, line, count and seed."""


def errors_of(p: int, k: int, c: int, s: int) -> float:
    """Errors [m] that fall with the count for `motion`, and hardly for `improved`; seeds spread by a few percent."""
    level = (0.02, 0.5 / COUNTS[c])[k] * (p + 1)
    return float(level * np.exp(0.05 * np.sin(1.0 + 7 * s + 3 * c + 11 * p + 5 * k)))


def write_sweep(
    folder: Path,
    error: Choose = errors_of,
    outcome: Callable[[int, int, int, int], str] = lambda p, k, c, s: "ok",
    *,
    seeds: int = 10,
    missing: frozenset[tuple[int, int, int, int]] = frozenset(),
    measure: str = "trajectory_filter.ate_rmse_m",
    families: tuple[str | None, ...] | None = None,
    route: str = "fixed",
    about: dict | None = None,
) -> Path:
    """Write the three tables into `folder`; families: of each place; about: further facts of the sweep."""
    folder.mkdir(exist_ok=True)
    rows, curves, timings = [], [], []
    for index in np.ndindex(len(PLACES), len(LINES), len(COUNTS), seeds):
        p, k, c, s = index
        key = "-".join(map(str, index))
        row = {"place": PLACES[p], "line": LINES[k], "particles": COUNTS[c], "seed": s, "key": key}
        row["family"] = None if families is None else families[p]
        absent = index in missing
        row["setting.route"] = route
        row |= {"status": "missing" if absent else "done", "reason": None}
        row |= {
            "outcome_filter": None if absent else outcome(*index),
            "outcome": None if absent else "ok",
            "refined": None if absent else COUNTS[c] in (COUNTS[0], COUNTS[-1]),
            measure: None if absent else error(*index),
            "trajectory.ate_rmse_m": None if absent else 0.2 * error(*index),
            "filter.updates": None if absent else 100,
            "duration_s": None if absent else 10.0 * (p + 1),
            "filter.consistency.inside_share": None if absent else 0.9 - 0.2 * k,
            "filter.consistency.nees_mean": None if absent else 4.0 + k,
        }
        rows.append(row)
        if not absent:
            shares = np.arange(1, 21) / 20
            curves += [
                {"key": key, "share": x, "ess": 1.0 - 0.3 * x, "unique_ancestors": 1.0 / (1 + 9 * x), "nees": None}
                for x in shares
            ]
            seconds = 0.1 * COUNTS[c] * (1.0 - 0.5 * k)
            timings.append(
                {"key": key, "filter_s": seconds, "cell_s": seconds + 0.5, "us_per_update_per_particle": 1.0}
            )
    facts = {"title": "", "measure": measure, "baseline": LINES[0], "code": "0123456789abcdef"} | (about or {})
    for name, table in (("sweep", rows), ("curves", curves), ("timings", timings)):
        arrow = pa.Table.from_pylist(table).replace_schema_metadata({"sweep": json.dumps(facts)})
        pq.write_table(arrow, folder / f"{name}.parquet")
    return folder
