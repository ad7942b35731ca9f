# SPDX-License-Identifier: MIT
"""docs/algorithm.md says where in the code each step is: what it names must be there."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "algorithm.md"
TEXT = PAGE.read_text(encoding="utf-8")
LINKS = sorted(set(re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", TEXT)))
WORDS = {"office"}
"""Names of places, which are no code."""
SOURCES = "\n".join(path.read_text(encoding="utf-8") for path in (PAGE.parents[1] / "slam").rglob("*.py"))
NAMES = sorted(set(re.findall(r"`((?:[A-Za-z]\w*\.)?_?[a-z]\w+)`", TEXT)) - WORDS)


@pytest.mark.parametrize("target", LINKS)
def test_links_and_pictures_exist(target):
    assert (PAGE.parent / target).exists()


@pytest.mark.parametrize("name", NAMES)
def test_names_are_those_of_the_code(name):
    """Functions, attributes and settings; of `Class.member` both parts."""
    for part in name.split("."):
        assert re.search(rf"(def|class) {part}\b|\b{part}:|self\.{part}\b", SOURCES), f"{part} is not in slam/"


def test_the_excerpt_is_the_code():
    """Every line of the excerpt of Algorithm 1 stands in `GMapping._update`, but for the comments."""
    (excerpt,) = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)
    code = [re.sub(r"\s+# step.*", "", line).strip() for line in excerpt.splitlines()]
    code = [line for line in code if line != "..."]
    assert len(code) >= 4
    for line in code:
        assert line in SOURCES
