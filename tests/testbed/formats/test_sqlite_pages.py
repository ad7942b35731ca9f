# SPDX-License-Identifier: MIT
"""Rows of an SQLite file read page by page, against SQLite itself."""

import sqlite3

import numpy as np
import pytest

from testbed.formats.ros.sqlite_pages import message_rows


@pytest.mark.parametrize("page", [512, 4096, 65536])
def test_rows_are_those_of_sqlite(tmp_path, page):
    """Messages of all sizes, over several pages too, and numbers of all lengths."""
    rng = np.random.default_rng(0)
    sizes = rng.integers(0, 3 * page, 60).tolist()
    times = [
        int(sign) << int(bits) for sign, bits in zip(rng.choice([-1, 1], 60), rng.integers(0, 62, 60), strict=True)
    ]
    rows = [(k + 1, k % 5, times[k], rng.bytes(size)) for k, size in enumerate(sizes)]
    base = sqlite3.connect(tmp_path / "whole.db3")
    base.execute(f"PRAGMA page_size = {page}")
    base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, more TEXT)")
    base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    base.execute("INSERT INTO topics VALUES (1, 'scan', 'LaserScan', '')")
    base.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
    base.commit()
    base.close()
    assert [tuple(row) for row in message_rows(tmp_path / "whole.db3")] == rows
    content = (tmp_path / "whole.db3").read_bytes()
    (tmp_path / "cut.db3").write_bytes(content[: len(content) * 2 // 3])
    begin = [tuple(row) for row in message_rows(tmp_path / "cut.db3")]
    assert len(rows) // 3 < len(begin) < len(rows)
    assert set(begin) <= set(rows)
