# SPDX-License-Identifier: MIT
"""The tables of the experiment on the particle count."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from eval.sweep.results import read_sweep
from tests.eval.synthetic_sweep import COUNTS, write_sweep
from tools.measure.needed_count import level_table


def part(folder, loop: float, lidar: str, **options):
    """A part of an experiment: four drives with each count; one particle gets lost in the first place."""
    write_sweep(folder, outcome=lambda p, k, c, s: "lost" if (p, c) == (0, 0) else "ok", seeds=1, **options)
    table = pq.read_table(folder / "sweep.parquet")
    done = np.array([status == "done" for status in table["status"].to_pylist()])
    for name, value in (("features.largest_loop_m", loop), ("features.clutter_per_10_m2", 1.5)):
        table = table.append_column(name, pa.array(np.where(done, value, np.nan)))
    table = table.append_column("setting.lidar", pa.array([lidar] * len(done)))
    pq.write_table(table, folder / "sweep.parquet")
    return read_sweep(folder)


def test_levels_are_pooled_over_the_parts_and_need_all_counts(tmp_path):
    short = part(tmp_path / "short", 28.0, "a")
    long = part(tmp_path / "long", 790.0, "b", missing=frozenset({(1, 1, 2, 0)}))
    rows = {line.split(" | ")[0].removeprefix("| "): line for line in level_table([short, long]).splitlines()}
    assert rows["largest loop 0 to 30 m"] == "| largest loop 0 to 30 m | 50 % | 100 % | 100 % | 4 |"
    assert rows["largest loop over 500 m"] == "| largest loop over 500 m | 33 % | 100 % | 100 % | 3 |"
    assert rows["clutter"] == "| clutter | 43 % | 100 % | 100 % | 7 |"
    assert rows["lidar a"].endswith("| 4 |")
    assert rows["lidar b"].endswith("| 3 |")
    assert "no clutter" not in rows
    assert len(COUNTS) == 3
