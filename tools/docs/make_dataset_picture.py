# SPDX-License-Identifier: MIT
"""Draw the contact sheet of a small collection, for docs/datasets.md.

    python -m tools.docs.make_dataset_picture

Writes: docs/pictures/datasets.png
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from tools.docs.make_pictures import PICTURES, testbed

COMMAND = "simulate office,apartment,lab --count 2 --draw lidar=lds01,rplidar_a2"


def main() -> None:
    """Make the collection and keep its contact sheet."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        testbed(COMMAND, Path(folder) / "data")
        shutil.copyfile(Path(folder) / "data" / "contact_sheet.png", PICTURES / "datasets.png")


if __name__ == "__main__":
    main()
