# SPDX-License-Identifier: MIT
"""What `testbed sweep --suggest` prints: how many particles to take for a world or log, and why."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eval.sweep.answer_words import particles
from eval.sweep.needed_count import MAX_RATIO, of_ten, shipped_model
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.sweep.errors import SweepError
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.suggest import (
    LOOK_PARTICLES,
    Reason,
    Suggestion,
    features_of_log,
    features_of_world,
    is_world,
    suggest,
)
from worlds import label

MOSTLY_HOLDS = 0.9
"""Where the largest count of the experiment holds less often, even more particles would probably help."""


def print_suggestion(name: str, settings: Mapping[str, Any]) -> int:
    """Print a particle count for a world or log, its interval, and what it depends on; return the exit status."""
    model = shipped_model()
    if is_world(name):
        console.print("driving through it once …")
        features, short = features_of_world(name, {"route": "random", **settings}), label(name)  # as sweeps drive
    else:
        if settings:
            raise SweepError(f"{name}: recorded logs are not simulated, expected no --set and no --route")
        announce_compilation()
        console.print(f"mapping it once with {LOOK_PARTICLES} particles, to see where the robot drove …")
        features, short = features_of_log(name), Path(name).name.split(".")[0]
    suggestion = suggest(short, features, model)
    for line in sentences(suggestion):
        results.print(line, soft_wrap=True, markup=False)
    results.print(origin(model.provenance, code_version()), soft_wrap=True)
    if is_world(name):
        results.print(f"To check it: {check_command(name, settings, suggestion)}", soft_wrap=True, markup=False)
        results.print("The same with --plan says first what that costs and what it can tell.", soft_wrap=True)
    return 0


def origin(experiment: Mapping[str, Any], version: str) -> str:
    """The runs that a suggestion rests on, and whether they are of this version of the code.

    experiment: provenance of the model; version: of the code that is running
    """
    earlier = "" if version in str(experiment["code"]).split(", ") else " of earlier versions of this filter"
    return f"From {experiment['runs']} runs in {experiment['worlds']} worlds{earlier} (docs/study.md)."


def check_command(name: str, settings: Mapping[str, Any], suggestion: Suggestion) -> str:
    """The sweep that checks a suggestion for a world by the same margin: half of the median count, it, the
    count to start with, and as many as it is compared with."""
    count = suggestion.needed or suggestion.largest
    counts = sorted({max(1, count // 2), count, suggestion.start, max(suggestion.largest, 2 * count)})
    words = ["testbed", "sweep", "--worlds", name, "--particles", ",".join(map(str, counts)), "--until", "decided"]
    words += ["--margin", f"{100.0 * (MAX_RATIO - 1.0):.0f}%"]
    for key, value in settings.items():
        words += ["--route", str(value)] if key == "route" else ["--set", f"{key}={value}"]
    return shlex.join(words)


def sentences(suggestion: Suggestion) -> list[str]:
    """The suggestion in words: the count, what it promises, the reasons, and what the experiment did not cover."""
    low, high = (_count_words(suggestion, end) for end in suggestion.interval)
    largest, start = particles(suggestion.largest), suggestion.start
    if suggestion.needed is None:
        lines = [
            f"{suggestion.name}: even with {largest} most runs end lost or with a broken loop "
            f"({100.0 * (1.0 - suggestion.largest_holds):.0f} % expected); more were not tested"
        ]
    else:
        lines = [
            f"{suggestion.name}: start with {particles(start)}, enough in {of_ten(suggestion.chance)} worlds like it.",
            f"The median world of this kind needs {suggestion.needed}; 95 % of them need between {low} and {high}.",
            f"Enough: an error at most 10 % above that with {suggestion.largest}, and at most 10 % more runs that end "
            f"lost or with a broken loop. (Expected to end neither lost nor so: {100.0 * suggestion.holds:.0f} % of "
            f"the runs with {start}, {100.0 * suggestion.largest_holds:.0f} % with {suggestion.largest}.)",
            "This is a forecast from other worlds"
            + (f": {suggestion.record}" if suggestion.record else "")
            + ". A sweep measures here and asks for proof, so it may want more, or leave open what is forecast; with "
            "its usual margin, the larger of 10 % and 5 mm, it may want less where errors are small.",
        ]
        if suggestion.largest_holds < MOSTLY_HOLDS:
            lines.append(f"More than {largest} were not tested and would probably help.")
    lines[:0] = [
        f"{suggestion.name} is outside of what was measured, so this is an extrapolation: {words}."
        for words in suggestion.outside
    ]
    lines.append(f"Why the median world needs {_count_words(suggestion, suggestion.needed)}:")
    return lines + [_why(suggestion, reason) for reason in suggestion.reasons]


def _why(suggestion: Suggestion, reason: Reason) -> str:
    """A reason with the count that the median world would need without it, or that the experiment does not show it."""
    usual = f"a world with {reason.usual}, the median of those tested,"
    if not reason.is_shown:
        return f"  {reason.words} (that this matters is not shown by the experiment)"
    if reason.needed_if_usual == suggestion.needed:
        return f"  {reason.words} ({usual} would need as many)"
    counts = [_count_words(suggestion, count) for count in (reason.needed_if_usual, suggestion.needed)]
    strange = "" if reason.is_as_expected else ": the other way than one would expect"
    return f"  {reason.words} ({usual} would need {counts[0]} instead of {counts[1]}{strange})"


def _count_words(suggestion: Suggestion, count: int | None) -> str:
    return f"more than {suggestion.largest}" if count is None else str(count)
