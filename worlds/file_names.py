# SPDX-License-Identifier: MIT
"""The rule for names that are read from files and become parts of file names, such as those of output directories."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator

MAX_LENGTH = 100
"""Largest number of characters of a name; with a date and an ending it fits into a file name of 255 bytes."""
ALLOWED = frozenset("-_. ")
"""Characters of a name apart from letters and digits."""


RULE = f"a name of 1 to {MAX_LENGTH} letters, digits, spaces, '-', '_' and '.', the first a letter or digit"
"""The rule in words, to follow after "expected"."""


def is_name(text: str) -> bool:
    """Return whether a text may become part of a file name.

    A name begins with a letter or digit, so that it is neither hidden, nor an option, nor a parent directory.
    """
    return 1 <= len(text) <= MAX_LENGTH and text[0].isalnum() and all(map(_is_allowed, text))


def to_name(text: str) -> str:
    """Return a valid name that is as near as possible to a text, such as the stem of a file."""
    name = "".join(character if _is_allowed(character) else "_" for character in text)[:MAX_LENGTH]
    return name if name and name[0].isalnum() else f"x{name}"[:MAX_LENGTH]


def readable(text: str) -> str:
    """Return a text that every file and terminal takes: bytes of a path that are no UTF-8 become \\x and two digits.

    Python stands surrogates for such bytes, and for all bytes above 127 under an ASCII locale.
    """
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def _checked(name: str) -> str:
    if not is_name(name):
        raise ValueError(f"expected {RULE}")
    return name


def _is_allowed(character: str) -> bool:
    return character.isalnum() or character in ALLOWED


Name = Annotated[str, AfterValidator(_checked)]
"""A name that may become part of a file name."""
