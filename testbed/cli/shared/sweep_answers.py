# SPDX-License-Identifier: MIT
"""The answers of a sweep as lines, after each look at the results and at its end."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from eval.sweep.advice import advice
from eval.sweep.answers import answers
from eval.sweep.results import read_sweep
from eval.sweep.summary import summarise
from eval.sweep.systems_page import place_tables

MAX_LINES = 20
"""At most so many worlds and lines are named."""
MAX_DETAILED = 6
"""Up to so many answers have lines of their own for the parts of what is open."""


def say_answers(directory: Path, say: Callable[[str], None], *, is_end: bool = False) -> None:
    """Say the answer for each world, or kind of building, and line, from the tables of a sweep.

    is_end: nothing more is computed now, so what can be done next is said too, as on the page.
    """
    summary = summarise(read_sweep(directory).judged())
    lines = summary.table.lines
    found = [(line, answer) for line in lines for answer in answers(summary, line)]
    for line, answer in found[:MAX_LINES]:
        first, *others = answer.lines if len(found) <= MAX_DETAILED else [answer.sentence]
        say(f"  {'' if len(lines) == 1 else f'{line}, '}{first}")
        for other in others:
            say(f"  {other}")
    if len(found) > MAX_LINES:
        say("  … and more, on the page")
    for item in advice(summary, str(directory), os.cpu_count() or 1) if is_end else ():
        if item.command:
            say(f"{item.title}: {item.command}")
            say(f"  {item.text}")


def say_systems(directory: Path, say: Callable[[str], None]) -> None:
    """Say error, failures and cost of each SLAM system in each world or log."""
    for table in place_tables(summarise(read_sweep(directory).judged())):
        say(table.title)
        cells = [table.headings, *table.rows]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        for row in cells:
            say("  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
