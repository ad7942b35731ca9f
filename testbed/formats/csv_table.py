# SPDX-License-Identifier: MIT
"""Tables of numbers as text (CSV) with a known first line."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

from testbed.formats.log import LogError

MAX_TABLE = 500_000_000
"""Bytes."""


def read_table(path: Path, columns: Sequence[str]) -> Iterator[tuple[int, list[float]]]:
    """Rows of a table with the numbers of their lines; empty lines are skipped.

    Raises LogError, naming the file and the line, where the first line does not name the columns, a row has more or
    fewer values, or a value is no number. `inf` and `nan` are numbers here.
    """
    try:
        size, file = path.stat().st_size, path.open(encoding="utf-8-sig", errors="replace", newline="")
    except OSError as error:
        raise LogError(f"{path}: {error.strerror}") from None
    with file:
        if size > MAX_TABLE:
            raise LogError(f"{path}: larger than {MAX_TABLE} bytes, expected a table {','.join(columns)}")
        lines = csv.reader(file)
        header = tuple(cell.strip() for cell in next(lines, []))
        if header != tuple(columns):
            got = " ".join(",".join(header).split())[:80]  # quoted cells may hold line breaks
            raise LogError(f"{path}:1: expected the columns {','.join(columns)}, got {got}")
        try:
            for cells in lines:
                if cells:
                    yield lines.line_num, _numbers(cells, len(columns))
        except (ValueError, csv.Error) as error:
            raise LogError(f"{path}:{lines.line_num}: {error}") from None


def _numbers(cells: list[str], count: int) -> list[float]:
    if len(cells) != count:
        raise ValueError(f"expected {count} values, got {len(cells)}")
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        raise ValueError(f"expected numbers, got {','.join(cells)[:80]}") from None
