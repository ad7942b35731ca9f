# SPDX-License-Identifier: MIT
"""Write the table of perturbations, and draw what three systems survive of eight of them.

    python -m tools.docs.make_stress_pictures [--run DIR]

Writes: docs/pictures/stress.png, docs/stress.md (perturbations), docs/stress.md (survival)

DIR is a directory with the stress test; where there is none, it is run there (half an hour).
"""

from __future__ import annotations

import argparse
import math
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from eval.survival.page import survival_bars
from eval.survival.results import TABLE, Scale, read_runs, thresholds
from testbed.stress.table import PERTURBATIONS, Perturbation
from tools.pages import DOCS, write_table

COMMAND = (
    "stress odometry,scan-matching,gmapping --particles 5 --worlds office,loop --seeds 4 --duration 60 "
    "--perturbations drop-scans,scan-period,range-noise,beams,people,odometry-noise,slip,askew"
)


def perturbation_table() -> str:
    """The table of perturbations as Markdown."""
    lines = ["| option | what it does | unit | searched from | to |", "|---|---|---|---|---|"]
    return "\n".join([*lines, *map(_row, PERTURBATIONS.values())])


def _row(row: Perturbation) -> str:
    nothing = " (inf: all)" if row.neutral == math.inf else ""
    return f"| `--{row.name} N` | {row.summary} | {row.unit}{nothing} | {row.harmless:g} | {row.hopeless:g} |"


def draw_bars(folder: Path) -> None:
    """Draw what the systems of a stress test survive."""
    runs = read_runs(folder)
    found = thresholds(runs)
    rows = [row for row in PERTURBATIONS.values() if any(name == row.name for _, name in found)]
    systems = dict.fromkeys(run.system for run in runs)
    scales = {row.name: Scale(row.unit, row.summary, row.value_at) for row in rows}
    survival_bars(dict.fromkeys(systems, found), scales).savefig(DOCS / "pictures" / "stress.png", dpi=110)


def main() -> None:
    """Write the tables and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path)
    options = parser.parse_args()
    write_table(DOCS / "stress.md", "perturbations", perturbation_table())
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.run or Path(temporary) / "stress"
        if not (folder / TABLE).is_file():
            testbed = str(Path(sys.executable).with_name("testbed"))
            subprocess.run([testbed, *shlex.split(COMMAND), "--out", str(folder)], check=True)
        write_table(DOCS / "stress.md", "survival", (folder / "table.md").read_text(encoding="utf-8"))
        draw_bars(folder)


if __name__ == "__main__":
    main()
