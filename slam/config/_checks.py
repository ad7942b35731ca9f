# SPDX-License-Identifier: MIT
"""Checks that settings make when they are created."""

from __future__ import annotations

from typing import get_args, get_type_hints


def require_positive(owner: object, *names: str) -> None:
    """Raise ValueError where one of these fields of a settings object is not above 0."""
    for name in names:
        value = getattr(owner, name)
        if not value > 0:
            raise ValueError(f"{type(owner).__name__}.{name} must be positive, got {value}")


def require_at_least(owner: object, minimum: float, *names: str) -> None:
    """Raise ValueError where one of these fields is below the minimum."""
    for name in names:
        value = getattr(owner, name)
        if not value >= minimum:
            raise ValueError(f"{type(owner).__name__}.{name} must be at least {minimum:g}, got {value}")


def require_at_most(owner: object, maximum: float, *names: str) -> None:
    """Raise ValueError where one of these fields is above the maximum."""
    for name in names:
        value = getattr(owner, name)
        if not value <= maximum:
            raise ValueError(f"{type(owner).__name__}.{name} must be at most {maximum:,.12g}, got {value:g}")


def require_one_of(owner: object, name: str) -> None:
    """Raise ValueError where a field is none of the values that its type lists."""
    known, value = get_args(get_type_hints(type(owner))[name]), getattr(owner, name)
    if value not in known:
        raise ValueError(f"{type(owner).__name__}.{name} must be one of {', '.join(known)}, got {value!r}")
