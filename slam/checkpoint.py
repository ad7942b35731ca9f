# SPDX-License-Identifier: MIT
"""A whole filter in one file: a resumed run equals the uninterrupted one bit for bit.

The file is a numpy archive (`.npz`) of plain arrays; no pickle. Settings, the state of the random number generator and
the other plain values are JSON in one of the arrays.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO, get_type_hints

import numpy as np
from numpy.typing import NDArray

from slam.checkpoint_check import check_field, check_state
from slam.config import FilterConfig
from slam.config.renamed import with_present_names
from slam.gmapping import GMapping

VERSION = 8
MAX_QUOTED = 200
"""Largest number of characters that a complaint quotes of a file."""


class CheckpointError(ValueError):
    """A file that is not a checkpoint of this version; the message names the file and what is wrong."""


def save_checkpoint(mapper: GMapping, path: str | os.PathLike[str]) -> None:
    """Write the whole filter to `path`: under a temporary name first, then renamed. OSError names `path`."""
    arrays, values = mapper.state()
    header = {"version": VERSION, "config": asdict(mapper.config), "values": values}
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            members: dict[str, Any] = {"header": np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays}
            np.savez(file, **members)
        temporary.replace(target)
    except OSError as error:
        error.filename = str(target)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def load_checkpoint(path: str | os.PathLike[str], *, threads: int | None = None) -> GMapping:
    """Read a filter that `save_checkpoint` wrote.

    Raises:
        CheckpointError: the file is damaged, no checkpoint, or one of another version.
        OSError: the file cannot be read.
    """
    with Path(path).open("rb") as file:
        try:
            mapper = _load(file, threads)
        except Exception as error:  # zip, JSON and numpy raise many types over a damaged file, OSError among them
            reason = " ".join(str(error).split())[:MAX_QUOTED]
            raise CheckpointError(f"{path}: not a checkpoint of the filter, or a damaged one ({reason})") from error
    return mapper


def _load(file: BinaryIO, threads: int | None) -> GMapping:
    """Read a filter; whatever is wrong with the file is an exception of any type."""
    with np.load(file, allow_pickle=False) as archive:
        header = json.loads(archive["header"].tobytes().decode())
        if header["version"] != VERSION:
            raise ValueError(f"version {header['version']}, expected {VERSION}")
        arrays: dict[str, NDArray[Any]] = {name: archive[name] for name in archive.files if name != "header"}
    config = with_present_names(header["config"], "filter.")
    mapper = GMapping(_dataclass_from(FilterConfig, config), threads=threads)
    check_state(arrays, header["values"], mapper.state())
    mapper.restore(arrays, header["values"])
    check_field(arrays, len(mapper.maps.grids.offset))
    return mapper


def _dataclass_from(kind: type[Any], values: dict[str, Any]) -> Any:
    """A dataclass, nested ones included, from what `asdict` made of it."""
    hints = get_type_hints(kind)
    arguments = {
        f.name: _dataclass_from(hints[f.name], values[f.name]) if is_dataclass(hints[f.name]) else values[f.name]
        for f in fields(kind)
    }
    return kind(**arguments)
