# SPDX-License-Identifier: MIT
"""The shortest list of commands that makes a collection again, for its card."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from worlds import expand_names

WITHOUT_EFFECT = {"--workers": 2, "--scheduler": 2, "--shard": 2, "--title": 2, "--author": 2, "--url": 2, "--plan": 1}
"""Options of `testbed simulate` that do not change the datasets, with their number of words."""


class _Command(NamedTuple):
    """A command `testbed simulate`, and what it makes."""

    text: str
    settings: tuple[str, ...]
    """All words that say how the datasets are made, not which."""
    drives: frozenset[tuple[str, int]]
    """Worlds and seeds; empty where the command does not state them."""

    def makes_all_of(self, other: _Command) -> bool:
        """Tell whether the other command makes nothing that this one does not make."""
        return self.text == other.text or (self.settings == other.settings and self.drives >= other.drives)


def shortest_commands(commands: Sequence[str], directory: str, chosen: Mapping[str, str]) -> list[str]:
    """Return the commands without those that make nothing further, and the one that chooses the splits.

    Options that do not change the datasets, such as `--workers`, are left out, and all commands write to `directory`.

    commands: `testbed simulate …`, the oldest first
    directory: name of the collection's directory
    chosen: split of the worlds that were chosen by hand
    """
    kept: list[_Command] = []
    for command in (_parse(text, directory) for text in commands):
        if command.text.startswith("testbed datasets index "):
            continue  # of an earlier card, where another choice may have been made
        if not any(earlier.makes_all_of(command) for earlier in kept):
            kept = [earlier for earlier in kept if not command.makes_all_of(earlier)] + [command]
    return [command.text for command in kept] + _index_command(directory, chosen)


def _parse(text: str, directory: str) -> _Command:
    """Read a command; its text comes back in its shortest form. What is no such command stays as it is."""
    try:
        words = _words(text, directory)
        return _Command(shlex.join(words), *_drives(words))
    except (ValueError, IndexError):  # the owner of the card may have edited it
        return _Command(text, (text,), frozenset())


def _drives(words: list[str]) -> tuple[tuple[str, ...], frozenset[tuple[str, int]]]:
    """Separate the words of a command into those that say how drives are made, and the worlds and seeds."""
    if words[:2] != ["testbed", "simulate"] or len(words) < 3 or words[2].startswith("-") or "--config" in words:
        return tuple(words), frozenset()  # worlds and seeds may come from a file
    first, count, rest = 0, 1, []
    position = 3
    while position < len(words):
        if words[position] in ("--seed", "--count"):
            number = int(words[position + 1])
            first, count = (number, count) if words[position] == "--seed" else (first, number)
            position += 2
        else:
            rest.append(words[position])
            position += 1
    seeds = range(first, first + count)
    return tuple(rest), frozenset((world, seed) for world in expand_names(words[2]) for seed in seeds)


def _words(text: str, directory: str) -> list[str]:
    """The words of a command without options that have no effect, and with --out `directory`; `--key=value` is two."""
    words = []
    for word in shlex.split(text):
        key, equals, value = word.partition("=")
        words += [key, value] if equals and key.startswith("--") else [word]
    kept, position = [], 0
    while position < len(words):
        skipped = WITHOUT_EFFECT.get(words[position], 0)
        if words[position] == "--out":
            kept += ["--out", directory]
            skipped = 2
        elif not skipped:
            kept.append(words[position])
        position += max(skipped, 1)
    return kept


def _index_command(directory: str, chosen: Mapping[str, str]) -> list[str]:
    """The command that chooses the splits; none where a hash of the worlds' names decides."""
    if not chosen:
        return []
    words = ["testbed", "datasets", "index", directory]
    for split in ("test", "validation"):
        if worlds := sorted(world for world, name in chosen.items() if name == split):
            words += [f"--{split}", ",".join(worlds)]
    return [shlex.join(words)]
