# SPDX-License-Identifier: MIT
"""Figures that stand in several pages agree: README with docs/accuracy.md, tables with the scripts that write them."""

import re
from collections import Counter
from pathlib import Path

import worlds
from tools.measure.check_outcomes import BREAKS, PEERS, RECORDED, SIMULATED
from tools.measure.measure_worlds import LARGE, OPEN

ROOT = Path(__file__).parents[2]
README = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
ACCURACY = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
METRICS = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
WORLD_ROWS = re.findall(
    r"^\| (\w+)(?: \(open\))? \| (\d+) \| [\d.]+ cm \| [\d.]+ cm \| (\d+) \|", ACCURACY, re.MULTILINE
)
WORDS = {11: "eleven", 3: "three"}


def runs_and_failures(names) -> tuple[int, int]:
    rows = [(int(runs), int(failures)) for name, runs, failures in WORLD_ROWS if name in names]
    return sum(runs for runs, _ in rows), sum(failures for _, failures in rows)


def row_of(label: str) -> list[str]:
    """Cells of the row of a table in docs/accuracy.md or the README that begins with this text."""
    for text in (ACCURACY, (ROOT / "README.md").read_text(encoding="utf-8")):
        for line in text.splitlines():
            if line.startswith(f"| {label}"):
                return [cell.strip().strip("*") for cell in line.strip("|").split("|")]
    raise AssertionError(f"no row {label!r}")


def test_the_table_of_accuracy_has_every_world():
    assert sorted([*(name for name, _, _ in WORLD_ROWS), *LARGE]) == sorted(worlds.catalogue())


def test_failures_in_the_readme_are_those_of_the_table():
    closed = set(worlds.catalogue()) - set(OPEN) - set(LARGE)
    runs, failures = runs_and_failures(closed)
    assert failures == 0
    assert (
        f"In the {WORDS[len(closed)]} closed worlds the [outcome](docs/metrics.md#outcome) of all {runs} runs is `ok`"
        in README
    )
    open_runs, open_failures = runs_and_failures(OPEN)
    assert f"In the {WORDS[len(OPEN)]} open worlds" in README
    assert f"{open_failures} of {open_runs} runs are not `ok`" in README
    assert f"{open_failures} of {open_runs} runs are not `ok`" in ACCURACY


def test_errors_in_the_readme_are_those_of_the_table():
    own, final = row_of("**filter's own path**"), row_of("**after the final pass**")
    for log, column in (("Intel log", 1), ("FR079 log", 2)):
        for cell, stated in zip(row_of(log)[1:], (own[column], final[column]), strict=True):
            metres, degrees = re.fullmatch(r"([\d.]+) m / ([\d.]+)°", stated).groups()
            assert cell == f"{100.0 * float(metres):.1f} cm, {degrees}°"
    assert row_of("closed simulated worlds")[2].startswith(row_of("**all of these**")[2])


def test_the_table_of_outcomes_has_every_labelled_case():
    labels = Counter(run.label for run in (*SIMULATED, *RECORDED))
    labels.update(label for label, _, _ in PEERS)
    labels.update({label: 4 * count for label, count in Counter(label for label, _, _ in BREAKS).items()})
    rows = re.findall(r"^\| (ok|drift|broken loop|lost) \|([ \d|]+)\|$", METRICS, flags=re.MULTILINE)
    assert {label: sum(map(int, re.findall(r"\d+", cells))) for label, cells in rows} == labels
