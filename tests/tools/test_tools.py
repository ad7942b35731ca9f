# SPDX-License-Identifier: MIT
"""The scripts of `tools/` start, and the documentation names the script of each table and picture."""

import importlib
import sys
from fnmatch import fnmatch

import pytest

from tools.catalogue import ROOT, scripts
from tools.pages import DOCS, marked_tables, write_table

SCRIPTS = scripts()
PAGE = "before\n<!-- a: written by tools/a.py -->\nold\n<!-- /a -->\nafter\n"


@pytest.mark.parametrize("module", ["tools.__main__", *(script.module for script in SCRIPTS)])
def test_every_script_explains_itself(module, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [module, "--help"])
    with pytest.raises(SystemExit) as ended:
        importlib.import_module(module).main()
    assert ended.value.code == 0
    if module != "tools.__main__":
        assert f"python -m {module}" in capsys.readouterr().out


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.module)
def test_every_script_states_its_results(script):
    assert script.purpose.endswith(".")
    assert script.writes or script.prints
    for page in (word.strip(",") for word in script.prints.split() if word.startswith("docs/")):
        assert (ROOT / page).is_file()


def test_every_picture_of_the_docs_has_one_script():
    patterns = [target for script in SCRIPTS for target in script.writes if "(" not in target]
    pictures = [str(path.relative_to(ROOT)) for path in DOCS.rglob("*") if path.suffix in (".png", ".gif", ".svg")]
    writers = {picture: [p for p in patterns if fnmatch(picture, p)] for picture in pictures}
    assert [picture for picture, found in writers.items() if len(found) != 1] == []
    assert [pattern for pattern in patterns if not list(ROOT.glob(pattern))] == []


def test_marks_in_pages_name_the_script_that_writes_the_table():
    stated = {(target, f"{s.module.replace('.', '/')}.py") for s in SCRIPTS for target in s.writes if "(" in target}
    marked = {
        (f"docs/{path.relative_to(DOCS)} ({name})", writer)
        for path in DOCS.rglob("*.md")
        for name, writer in marked_tables(path.read_text(encoding="utf-8")).items()
    }
    assert marked == stated


def test_a_table_replaces_the_text_between_its_marks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    write_table(page, "a", "new\\1 \\n")
    assert page.read_text() == PAGE.replace("old", "new\\1 \\n")


@pytest.mark.parametrize("text", ["no marks\n", PAGE.replace("<!-- /a -->", ""), PAGE + PAGE])
def test_a_page_without_the_marks_is_refused_and_kept(text, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(ValueError, match=r"page\.md: expected the marks of the table 'a' once"):
        write_table(page, "a", "new")
    assert page.read_text() == text
