# SPDX-License-Identifier: MIT
"""The command line that repeats a sweep, for its page."""

from __future__ import annotations

import shlex
from itertools import groupby

from testbed.sweep.spec.settings import Value
from testbed.sweep.spec.spec import SweepSpec


def command_of(spec: SweepSpec) -> str:
    """The command that repeats a sweep; for logs and variants, which need a file, the one that reads `sweep.toml`."""
    if spec.logs or spec.variants:
        return "testbed sweep SPEC.toml  # with the table [spec] of sweep.toml as its content"
    words = ["testbed", "sweep", "--worlds", ",".join(grouped(spec.worlds))]
    words += ["--particles", ",".join(map(str, spec.particles)), "--seeds", _seeds(spec.seeds)]
    if spec.drawn_seeds is not None:
        words += ["--drawn-seeds", str(spec.drawn_seeds)]
    if spec.measure:
        words += ["--measure", spec.measure]
    if spec.margin:
        words += ["--margin", spec.margin]
    if not spec.names_route:
        words += ["--route", "fixed"]
    if spec.until:
        words += ["--until", spec.until]
    for name, values in spec.axes.items():
        words += ["--axis", f"{name}={','.join(map(_text, values))}"]
    for name, value in spec.settings.items():
        if name != "route":
            words += ["--set", f"{name}={_text(value)}"]
        elif value != "random":  # the default of the command line
            words += ["--route", str(value)]
    return shlex.join(words)


def grouped(worlds: tuple[str, ...]) -> list[str]:
    """Names of worlds, with `generated:KIND:0`, `generated:KIND:1`, … as `generated:KIND*N`."""
    words: list[str] = []
    for base, group in groupby(worlds, key=lambda name: name.rpartition(":")[0] or name):
        names = list(group)
        numbered = [f"{base}:{number}" for number in range(len(names))]
        words += [f"{base}*{len(names)}"] if names == numbered and len(names) > 1 else names
    return words


def _seeds(seeds: tuple[int, ...]) -> str:
    if seeds == tuple(range(len(seeds))):
        return str(len(seeds))
    if seeds == tuple(range(seeds[0], seeds[-1] + 1)) and len(seeds) > 1:
        return f"{seeds[0]}:{seeds[-1] + 1}"
    return ",".join(map(str, seeds)) + ("," if len(seeds) == 1 else "")


def _text(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
