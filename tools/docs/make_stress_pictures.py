# SPDX-License-Identifier: MIT
"""Write the table of perturbations.

    python -m tools.docs.make_stress_pictures

Writes: docs/stress.md (perturbations)
"""

from __future__ import annotations

import argparse
import math

from testbed.stress.table import PERTURBATIONS, Perturbation
from tools.pages import DOCS, write_table


def perturbation_table() -> str:
    """The table of perturbations as Markdown."""
    lines = ["| option | what it does | unit | searched from | to |", "|---|---|---|---|---|"]
    return "\n".join([*lines, *map(_row, PERTURBATIONS.values())])


def _row(row: Perturbation) -> str:
    nothing = " (inf: all)" if row.neutral == math.inf else ""
    return f"| `--{row.name} N` | {row.summary} | {row.unit}{nothing} | {row.harmless:g} | {row.hopeless:g} |"


def main() -> None:
    """Write the table."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    write_table(DOCS / "stress.md", "perturbations", perturbation_table())


if __name__ == "__main__":
    main()
