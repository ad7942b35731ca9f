# SPDX-License-Identifier: MIT
"""Lists of worlds, robots and lidars in the pages are those of the package."""

import re
from pathlib import Path

import worlds

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
