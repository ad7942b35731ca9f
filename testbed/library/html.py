# SPDX-License-Identifier: MIT
"""Pieces of HTML by which results show themselves in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

from eval.report.page import flat


def line(text: str) -> str:
    """A line of text."""
    return f"<p>{escape(text)}</p>"


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of texts."""
    head = "".join(f"<th>{escape(heading)}</th>" for heading in headings)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def picture(source: str, width: int = 700) -> str:
    """A picture from a `data:` address, at most so wide [px]."""
    return f'<img src="{source}" style="max-width:{width}px; width:100%">'


class Table(dict[str, Any]):
    """Nested figures by name that show themselves as a table in a notebook, a row for each dotted name."""

    def _repr_html_(self) -> str:
        rows = [(key, f"{value:.6g}" if isinstance(value, float) else str(value)) for key, value in flat(self)]
        return table(("figure", "value"), rows)


def frame(page: str, height: int = 700) -> str:
    """A whole page in a frame of its own, so high [px]."""
    return f'<iframe srcdoc="{escape(page, quote=True)}" style="width:100%; height:{height}px; border:0"></iframe>'
