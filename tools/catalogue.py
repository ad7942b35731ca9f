# SPDX-License-Identifier: MIT
"""Which script writes which table and picture of the documentation, read from the docstrings of the scripts."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Script:
    """A script and its results, as its docstring states them."""

    module: str
    """Name for `python -m`."""
    purpose: str
    """First line of the docstring."""
    writes: tuple[str, ...]
    """Pictures (paths, `*` allowed) and tables (page with the name of the table in brackets) that it writes."""
    prints: str
    """Figures that it prints; empty if it prints none."""


def scripts() -> list[Script]:
    """All scripts, in alphabetical order."""
    return [read_script(path) for path in sorted(Path(__file__).parent.glob("*/*.py"))]


def read_script(path: Path) -> Script:
    """Parse the docstring of a script: its first line, `Writes:` and `Prints:`."""
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    stated = dict(re.findall(r"^(Writes|Prints): (.+)$", docstring, flags=re.MULTILINE))
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    writes = tuple(stated["Writes"].split(", ")) if "Writes" in stated else ()
    return Script(module, docstring.splitlines()[0] if docstring else "", writes, stated.get("Prints", ""))
