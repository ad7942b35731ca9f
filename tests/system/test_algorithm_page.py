# SPDX-License-Identifier: MIT
"""docs/algorithm.md says where in the code each step is: what it names must be there."""

import inspect
import re
from pathlib import Path

import pytest

from slam.gmapping import GMapping

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
    """The lines of the excerpt, without their comments, are lines of `GMapping._update`, in its order."""
    (excerpt,) = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)
    shown = [re.sub(r"\s+#.*", "", line).strip() for line in excerpt.splitlines()]
    code = [re.sub(r"\s+#.*", "", line).strip() for line in inspect.getsource(GMapping._update).splitlines()]
    places = [code.index(line) for line in shown if line != "..."]
    assert len(places) >= 4
    assert places == sorted(places)
