# SPDX-License-Identifier: MIT
"""Checks that settings make when they are created."""

from __future__ import annotations

from typing import get_args, get_type_hints

SMALLEST, LARGEST = 1e-9, 1e9
"""Between these lies every length, time, angle and share that means something; squares of others overflow."""
MAX_DIGITS = 30
"""Largest number of characters of a number that a message quotes."""


def require_positive(owner: object, *names: str) -> None:
    """Raise ValueError where one of these fields of a settings object is not above 0, or is no size of anything."""
    for name in names:
        value = getattr(owner, name)
        if not value > 0:
            raise ValueError(f"{type(owner).__name__}.{name} must be positive, got {_shown(value)}")
        if not SMALLEST <= value <= LARGEST:
            raise ValueError(
                f"{type(owner).__name__}.{name} must be from {SMALLEST:g} to {LARGEST:g}, got {_shown(value)}"
            )


def require_at_least(owner: object, minimum: float, *names: str) -> None:
    """Raise ValueError where one of these fields is below the minimum."""
    for name in names:
        value = getattr(owner, name)
        if not value >= minimum:
            raise ValueError(f"{type(owner).__name__}.{name} must be at least {minimum:g}, got {_shown(value)}")


def require_at_most(owner: object, maximum: float, *names: str) -> None:
    """Raise ValueError where one of these fields is above the maximum."""
    for name in names:
        value = getattr(owner, name)
        if not value <= maximum:
            raise ValueError(f"{type(owner).__name__}.{name} must be at most {maximum:,.12g}, got {_shown(value)}")


def _shown(value: float) -> str:
    """A number as a message quotes it; whole ones may have any number of digits."""
    text = str(value) if isinstance(value, int) else f"{value:g}"
    return text if len(text) <= MAX_DIGITS else f"{text[:MAX_DIGITS]}… ({len(text)} digits)"


def require_one_of(owner: object, name: str) -> None:
    """Raise ValueError where a field is none of the values that its type lists."""
    known, value = get_args(get_type_hints(type(owner))[name]), getattr(owner, name)
    if value not in known:
        raise ValueError(f"{type(owner).__name__}.{name} must be one of {', '.join(known)}, got {value!r}")
