# SPDX-License-Identifier: MIT
"""The legend as a picture: the viewer itself has none for its map views."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Literal

from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]
Mark = Literal["thin", "line", "band", "dot", "square", "ellipse", "arrow", "diamond"]
Entry = tuple[Mark, tuple[Colour, ...], str]
"""What is drawn, in which colours from left to right, and what it means."""

HEIGHT, MARGIN, MARK, FONT = 34, 14, 34, 20
"""Height of a row, space between entries, width of a mark, size of the letters [px]."""
LINE_WIDTHS = {"thin": 2, "line": 4, "band": 9}
"""Widths of marks that are lines [px]."""
INK, PAPER = (40, 44, 48), (245, 246, 248)


def legend_image(rows: Sequence[Sequence[Entry]]) -> bytes:
    """A PNG of the entries, row by row."""
    font = ImageFont.load_default(size=FONT)
    lengths = [sum(_width(entry, font) for entry in row) + MARGIN for row in rows]
    image = Image.new("RGB", (max(lengths), HEIGHT * len(rows) + 8), PAPER)
    draw = ImageDraw.Draw(image)
    for number, row in enumerate(rows):
        x, y = MARGIN, HEIGHT * number + 4 + HEIGHT // 2
        for entry in row:
            mark, colours, text = entry
            _draw_mark(draw, mark, colours, x, y)
            draw.text((x + MARK + 8, y), text, font=font, fill=INK, anchor="lm")
            x += _width(entry, font)
    out = io.BytesIO()
    image.save(out, "png")
    return out.getvalue()


def _width(entry: Entry, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> int:
    return MARK + 8 + int(font.getlength(entry[2])) + MARGIN


def _draw_mark(draw: ImageDraw.ImageDraw, mark: Mark, colours: Sequence[Colour], x: int, y: int) -> None:
    """Draw a mark of the width `MARK` from x on, about the height y."""
    step = MARK / len(colours)
    for number, colour in enumerate(colours):
        left, right = x + step * number, x + step * (number + 1)
        if mark in LINE_WIDTHS:
            draw.line([(left, y), (right, y)], fill=colour, width=LINE_WIDTHS[mark])
        elif mark == "dot":
            middle = (left + right) / 2
            draw.ellipse([middle - 4, y - 4, middle + 4, y + 4], fill=colour)
        elif mark == "square":
            draw.rectangle([left, y - 9, right - 1, y + 9], fill=colour, outline=INK)
        elif mark == "ellipse":
            draw.ellipse([left + 1, y - 9, right - 1, y + 9], outline=colour, width=3)
        elif mark == "diamond":
            middle = (left + right) / 2
            draw.polygon([(middle - 8, y), (middle, y - 8), (middle + 8, y), (middle, y + 8)], fill=colour)
        else:
            draw.line([(left + 2, y), (right - 2, y)], fill=colour, width=3)
            draw.polygon([(right, y), (right - 8, y - 6), (right - 8, y + 6)], fill=colour)
