# SPDX-License-Identifier: MIT
"""Writing of TOML documents."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from worlds.file_names import readable


def dump_toml(document: Mapping[str, Any]) -> str:
    """Return a document as TOML text; values that are None are left out, because TOML has no null."""
    return tomli_w.dumps(without_none(document))


def without_none(value: Any) -> Any:
    """Return a value as it is read back from a file: without None, lists for tuples, text for paths."""
    if isinstance(value, Mapping):
        return {readable(str(key)): without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [without_none(item) for item in value]
    return readable(str(value)) if isinstance(value, Path | str) else value
