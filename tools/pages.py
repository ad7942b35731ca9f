# SPDX-License-Identifier: MIT
"""Tables in pages of the documentation: a script writes between two marks, a person writes the rest.

A table NAME begins after the line `<!-- NAME: written by SCRIPT -->` and ends before the line `<!-- /NAME -->`.
"""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"


def marked_tables(page: str) -> dict[str, str]:
    """Script (path in the repository) that writes each marked table of a page's text, by name of the table."""
    return dict(re.findall(r"^<!-- (\w+): written by (\S+) -->$", page, flags=re.MULTILINE))


def write_table(page: Path, name: str, table: str) -> None:
    """Replace the text between the marks of a table.

    Raises:
        ValueError: the page does not have both marks of the table exactly once.
    """
    text = page.read_text(encoding="utf-8")
    pattern = re.compile(rf"(^<!-- {name}: written by \S+ -->\n).*?(^<!-- /{name} -->$)", re.MULTILINE | re.DOTALL)
    replaced, count = pattern.subn(lambda marks: marks[1] + table.rstrip("\n") + "\n" + marks[2], text)
    if count != 1:
        raise ValueError(f"{page}: expected the marks of the table {name!r} once, found them {count} times")
    page.write_text(replaced, encoding="utf-8")
