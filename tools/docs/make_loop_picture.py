# SPDX-License-Identifier: MIT
"""Draw the map of a filter that left its loops open, and the map after the final pass has closed them.

    python -m tools.docs.make_loop_picture

Writes: docs/pictures/loops.png

A drive through `nested_loops` whose wheels slip often, with one particle. About two minutes.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

from eval.files.run_reader import read_run
from eval.report.map_images import MAX_SIDE, draw_map, frame_around
from slam.occupancy import OccupancyGrid

CALL = "from testbed.cli import main; main()"
PICTURE = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "loops.png"
DRIVE = ["nested_loops", "--seed", "1", "--backend", "fast", "--robot", "pioneer3dx", "--lidar", "lms200"]
SLIPS = ["--odometry.grade", "poor", "--odometry.slip-rate", "0.2", "--odometry.slip-distance", "0.15"]


def main() -> None:
    """Map the drive without and with the final pass and draw both maps side by side."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        pictures = []
        for name, options in (("filter", ["--no-refine"]), ("final", [])):
            out = Path(folder) / name
            command = [
                sys.executable,
                "-c",
                CALL,
                "run",
                *DRIVE,
                *SLIPS,
                "--particles",
                "1",
                *options,
                "--out",
                str(out),
            ]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            error = json.loads((out / "metrics.json").read_text())["trajectory"]["ate_rmse_m"]
            print(f"{name}: trajectory error {100.0 * error:.1f} cm")  # noqa: T201
            pictures.append(_drawn(read_run(out).grid))
    height = max(len(pixels) for pixels in pictures)
    padded = [np.pad(p, ((0, height - len(p)), (20, 20), (0, 0)), constant_values=211) for p in pictures]
    imsave(PICTURE, np.hstack(padded))


def _drawn(grid: OccupancyGrid | None) -> np.ndarray:
    """Pixels of a map, at about half of the size of a report's."""
    assert grid is not None
    pixels = draw_map(grid, frame_around(grid, np.zeros(3), [], 0.5), np.zeros(3)).pixels
    every = max(1, -(-max(pixels.shape) * 2 // MAX_SIDE))
    return pixels[::every, ::every]


if __name__ == "__main__":
    main()
