# SPDX-License-Identifier: MIT
"""Comparison of settings as files hold them: nested tables of plain values, where None is left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple


class Change(NamedTuple):
    """A setting that differs."""

    key: str
    """Such as `odometry.grade`."""
    there: Any
    """The value that it has; None where it has none."""
    sentence: str
    """Names both values."""


def changed_settings(there: Mapping[str, Any], wanted: Mapping[str, Any]) -> Iterator[Change]:
    """Yield each setting that differs."""
    found, asked = dict(_flat(there)), dict(_flat(wanted))
    for key in dict.fromkeys([*asked, *found]):
        if found.get(key) != asked.get(key):
            sentence = f"has {_named(key, found)}, this command wants {_named(key, asked)}"
            yield Change(key, found.get(key), sentence)


def _flat(settings: Mapping[str, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{group}{key}.")
        else:
            yield f"{group}{key}", value


def _named(key: str, values: Mapping[str, Any]) -> str:
    return f"{key} {values[key]}" if key in values else f"no {key}"
