# SPDX-License-Identifier: MIT
"""Lists of worlds, robots and lidars in the pages are those of the package."""

import re
from pathlib import Path
from typing import get_args

import worlds
from testbed.datasets.simulated import DatasetFormat
from testbed.formats.write import LogFormat

DOCS = Path(__file__).parents[2] / "docs"
PRESETS = DOCS.parent / "testbed" / "presets"


def names_of(kind: str) -> set[str]:
    return {path.stem for path in (PRESETS / kind).glob("*.toml")}


def test_the_table_of_worlds_is_the_catalogue():
    text = (DOCS / "worlds.md").read_text(encoding="utf-8")
    named = re.findall(r"\| \[(\w+)\]\(worlds/\w+\.png\) \| (.*?) \|", text)
    assert named == [(name, worlds.load(name).description) for name in worlds.catalogue()]


def test_the_table_of_presets_names_all_robots_and_lidars():
    text = (DOCS / "simulator.md").read_text(encoding="utf-8")
    robots, lidars = re.findall(r"^\| robots \| lidars \|\n\|---\|---\|\n\| (.*?) \| (.*?) \|$", text, re.MULTILINE)[0]
    assert set(re.findall(r"`(\w+)`", robots)) == names_of("robots")
    assert set(re.findall(r"`(\w+)`", lidars)) == names_of("lidars")


def test_the_table_of_formats_says_which_command_writes_each():
    text = (DOCS / "formats.md").read_text(encoding="utf-8")
    table = text[text.index("| format | content | read |") :].split("\n\n")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    written = {name.strip("`"): (by_convert, by_simulate) for name, _, _, by_convert, by_simulate in rows}
    assert written == {
        name: ("yes", "yes" if name in get_args(DatasetFormat) else "no") for name in get_args(LogFormat)
    }
