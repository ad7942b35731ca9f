# SPDX-License-Identifier: MIT
"""Draw the maps of the recorded logs: runs `testbed slam` on each with default settings, 30 particles and seed 0.

    python -m tools.docs.make_log_pictures [--keep DIR]

Writes: docs/pictures/map_*.png

The logs are read from $TESTBED_DATASETS, by default ../shared/datasets.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.image
import numpy as np

from eval.files.map_server import read_map

HERE = Path(__file__).resolve().parents[2] / "docs"
ROOT = Path(os.environ.get("TESTBED_DATASETS", HERE.parents[1] / "shared" / "datasets"))
LOGS = {
    "intel": ["intel/intel-merged.clf.gz", "--relations", "intel/intel-resolved.relations"],
    "fr079": ["fr079/fr079-merged.clf.gz", "--relations", "fr079/fr079.relations"],
    "aces": ["aces/aces-merged.clf.gz"],
}


def picture_of(run: Path, target: Path) -> None:
    """Draw a run's map: walls black, free space white, unknown grey."""
    grid = read_map(run / "map.yaml")
    grey = np.where(grid.known, 1.0 - grid.probability, 0.6)[::-1]
    rows, columns = (n // 2 * 2 for n in grey.shape)
    blocks = grey[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2)
    darkest = blocks.min(axis=(1, 3))  # the mean would lose thin walls
    matplotlib.image.imsave(target, darkest, cmap="gray", vmin=0.0, vmax=1.0)


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, help="directory for the runs (default: a temporary one)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        for name, (log, *options) in LOGS.items():
            run = (args.keep or Path(temporary)) / name
            paths = [o if o.startswith("--") else str(ROOT / o) for o in options]
            command = [str(Path(sys.executable).with_name("testbed")), "slam", str(ROOT / log), *paths]
            subprocess.run([*command, "--out", str(run), "--overwrite"], check=True)
            picture_of(run, HERE / "pictures" / f"map_{name}.png")


if __name__ == "__main__":
    main()
