# SPDX-License-Identifier: MIT
"""Read and write world files, and name in one line what is wrong with a file."""

from __future__ import annotations

import difflib
import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from worlds.check import check_world
from worlds.elements import MAX_COORDINATE, Block, Box, Disc, Model, Opening, Wall
from worlds.errors import WorldError, shown
from worlds.format.map_file import is_map
from worlds.movers import Door, Person
from worlds.regular_file import refuse_devices
from worlds.world import Difficulty, Start, Tour, World

MAX_FILE_BYTES = 8_000_000
"""Largest size of a world file [bytes]."""

_MODEL_OF_KEY: dict[str, type[Model]] = {
    "walls": Wall,
    "boxes": Box,
    "discs": Disc,
    "polygons": Block,
    "openings": Opening,
    "start": Start,
    "tour": Tour,
    "people": Person,
    "doors": Door,
    "difficulty": Difficulty,
}


def catalogue() -> list[str]:
    """Return the names of the worlds that come with the package, sorted."""
    folder = resources.files("worlds") / "catalogue"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load(name_or_path: str | Path, *, footprint_radius: float = 0.0) -> World:
    """Load the world of a catalogue name, a TOML file or a ROS map (`.yaml`, no tour), checked by `worlds.check_world`.

    footprint_radius: outer radius of the robot that will drive the tour [m].
    Raises `WorldError`: unknown name (with the nearest names), unreadable file, misspelt key (with the nearest key),
    wrong type or unit, start inside a wall, open outline, tour too narrow.
    """
    if is_map(name_or_path):
        from worlds.format.floor_plan import import_map  # here: it needs scipy.ndimage, whose import is slow

        world, source = import_map(name_or_path), str(name_or_path)
    else:
        text, source = _read(name_or_path)
        world = parse(text, source)
    check_world(world, footprint_radius=footprint_radius, source=source)
    return world


def dumps(world: World) -> str:
    """Return the text of a file (TOML) that `load` reads back to an equal world."""
    return tomli_w.dumps(world.model_dump(mode="json", exclude_defaults=True))


def parse(text: str, source: str) -> World:
    """Parse a world from `text` (TOML) without `check_world`; `source` begins the error messages."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise WorldError(f"{source}: {error}, expected TOML") from None
    except RecursionError:
        raise WorldError(f"{source}: nested too deeply, expected a world file") from None
    try:
        return World.model_validate(table)
    except ValidationError as error:
        raise WorldError(_first_problem(error, text, source)) from None


def _read(name_or_path: str | Path) -> tuple[str, str]:
    """Read the text of a world file, and its name for messages."""
    name = str(name_or_path)
    if name in catalogue():
        return (resources.files("worlds") / "catalogue" / f"{name}.toml").read_text(encoding="utf-8"), f"world {name!r}"
    path = Path(name)
    if path.suffix != ".toml" and not path.exists():
        near = difflib.get_close_matches(name, catalogue(), n=3, cutoff=0.4) or catalogue()
        raise WorldError(
            f"unknown world {name!r}, expected a TOML file, a ROS map (.yaml) or a name such as {', '.join(near)}"
        )
    try:
        refuse_devices(path)
        if path.stat().st_size > MAX_FILE_BYTES:
            raise WorldError(f"{path}: {path.stat().st_size} bytes, expected at most {MAX_FILE_BYTES}")
        return path.read_text(encoding="utf-8"), str(path)
    except OSError as error:
        raise WorldError(f"{path}: {error.strerror}, expected a world file") from None
    except UnicodeDecodeError as error:
        raise WorldError(f"{path}: byte {error.start} is not UTF-8, expected a TOML text file") from None


def _first_problem(error: ValidationError, text: str, source: str) -> str:
    """Describe the first problem that pydantic found in one line."""
    problems = error.errors(include_url=False)
    # a misspelt key is unknown under its own name and missing under the right one: report the former
    problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    loc = problem["loc"]
    line = _line_of(text, loc)
    where = f"{source}: {f'line {line}: ' if line else ''}{_key(loc)}".removesuffix(": ")
    if problem["type"] == "extra_forbidden":
        known = _known_keys(loc)
        near = difflib.get_close_matches(str(loc[-1]), known, n=1, cutoff=0.5)
        hint = f"expected {near[0]!r}" if near else f"expected one of {', '.join(known)}"
        return f"{where} is not known, {hint}"
    if problem["type"] == "missing":
        return f"{where} is missing"
    expectation = _expectation(problem, loc)
    joint = ": " if ", expected " in expectation else ", expected "
    return f"{where} = {shown(problem['input'])}{joint}{expectation}"[:500]


def _expectation(problem: Any, loc: tuple[int | str, ...]) -> str:
    if problem["type"] in {"greater_than_equal", "less_than_equal", "greater_than", "finite_number"}:
        if loc[-1] in {"rotation", "theta", "closed", "swing"}:
            return "an angle in radians between -6.283 and 6.283"
        if abs(problem["input"]) > MAX_COORDINATE:
            return f"metres, at most {MAX_COORDINATE:g}"
    message: str = problem["msg"]
    return message.removeprefix("Input should be ").removeprefix("Value error, ").removeprefix("expected ")


def _key(loc: tuple[int | str, ...]) -> str:
    """Format `("boxes", 3, "rotation")` as `boxes[3].rotation`."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc).removeprefix(".")


def _known_keys(loc: tuple[int | str, ...]) -> list[str]:
    """Return the keys that are allowed where the unknown key at `loc` stands."""
    owner = next((part for part in reversed(loc[:-1]) if isinstance(part, str)), None)
    model: type[Model] = World if owner is None else _MODEL_OF_KEY[owner]
    return list(model.model_fields)


def _line_of(text: str, loc: tuple[int | str, ...]) -> int | None:
    """Return the line of the table, array item or key at `loc`; None if it is not found.

    tomllib keeps no positions, so this looks for `[[boxes]]` headers, for items of `boxes = [{...}, ...]` written one
    a line, and for `key =`.
    """
    lines = text.splitlines()
    group, rest = str(loc[0]), loc[1:] if loc else ()
    index = rest[0] if rest and isinstance(rest[0], int) else 0
    array = _find(lines, rf"\s*{re.escape(group)}\s*=\s*\[", 0)
    if array is not None and rest:
        items = [k for k in range(array, len(lines)) if "{" in lines[k]]
        return items[index] + 1 if index < len(items) else None
    headers = [k for k, line in enumerate(lines) if re.match(rf"\s*\[+\s*{re.escape(group)}\s*\]", line)]
    if not headers:
        at = _find(lines, rf"\s*{re.escape(group)}\s*=", 0)
        return None if at is None else at + 1
    if index >= len(headers):
        return None
    key = next((str(part) for part in rest if isinstance(part, str)), None)
    at = None if key is None else _find(lines, rf"\s*{re.escape(key)}\s*=", headers[index])
    return (headers[index] if at is None else at) + 1


def _find(lines: list[str], pattern: str, begin: int) -> int | None:
    return next((k for k in range(begin, len(lines)) if re.match(pattern, lines[k])), None)
