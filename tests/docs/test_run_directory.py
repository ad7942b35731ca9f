# SPDX-License-Identifier: MIT
"""docs/run-directory.md and docs/metrics.md against a real run."""

import re
from pathlib import Path

from testbed.run.run_directory import RUN_FILES

DOCS = Path(__file__).parents[2] / "docs"


def part_of(page: str, heading: str) -> str:
    """Text below a heading, up to the next one."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.split(r"^#", text.split(f"{heading}\n", maxsplit=1)[1], maxsplit=1, flags=re.MULTILINE)[0]


def test_the_page_names_all_columns_of_the_step_table_in_order(finished_run):
    named = re.findall(r"`(\w+)`", part_of("run-directory.md", "## Columns of `steps.parquet`"))
    assert [name for name in named if name in set(finished_run.columns)] == finished_run.columns
    assert sorted(set(named) - set(finished_run.columns)) == []


def test_the_page_names_all_files_of_a_run(finished_run):
    table = part_of("run-directory.md", "# The run directory")
    named = {
        name for cell in re.findall(r"^\| (.*?) \|", table, flags=re.MULTILINE) for name in re.findall("`(.*?)`", cell)
    }
    assert named == set(RUN_FILES)
    assert {path.name for path in finished_run.directory.iterdir()} <= named


def test_every_group_of_measures_has_a_place_in_the_page(finished_run):
    text = (DOCS / "metrics.md").read_text(encoding="utf-8")
    groups = [key for key, value in finished_run.metrics.items() if isinstance(value, dict)]
    assert [key for key in groups if f"`{key}`" not in text and f"`{key}." not in text] == []
