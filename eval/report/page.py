# SPDX-License-Identifier: MIT
"""What all report pages share: pictures with their captions, and the templates that they go into."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from worlds.file_names import readable


@dataclass(frozen=True)
class Plot:
    """A picture with its title and caption."""

    title: str
    source: str
    """The picture as a `data:` address."""
    caption: str = ""
    pixelated: bool = False
    key: tuple[tuple[str, str], ...] = ()
    """Colours and what they mean."""


def render(template: str, **context: Any) -> str:
    """Fill in one of the templates of this package and return the page; all values are escaped."""
    environment = Environment(
        loader=PackageLoader("eval.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return readable(environment.get_template(template).render(**context))


def flat(document: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of nested tables with their dotted keys."""
    for key, value in document.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
