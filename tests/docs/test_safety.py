# SPDX-License-Identifier: MIT
"""Each statement of docs/safety.md names tests that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
NAMED = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)


@pytest.mark.parametrize(("file", "name"), NAMED)
def test_a_named_test_is_there(file, name):
    assert f"\ndef {name}(" in (ROOT / file).read_text(encoding="utf-8")


def test_each_statement_has_its_test():
    rows = [line for line in PAGE.splitlines() if line.startswith("| **")]
    assert len(rows) >= 6
    assert all("::" in row.rsplit("|", 2)[-2] for row in rows)
