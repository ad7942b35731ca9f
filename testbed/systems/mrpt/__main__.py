# SPDX-License-Identifier: MIT
"""Run a SLAM program of MRPT on a recording, as `--system-command` asks for it.

    python -m testbed.systems.mrpt icp-slam|rbpf-slam DATASET OUT [SEED]

Its settings are those of an example of MRPT, in the .ini file of its name next to this one. The trajectory holds the
pose that the program reports at each scan: MRPT says of no later one which scan it belongs to.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from eval.files.map_server import write_map
from eval.files.tum import write_tum
from eval.trajectory.trajectory import Trajectory
from slam.occupancy import OccupancyGrid
from testbed.formats import open_log
from testbed.systems.mrpt.rawlog import write_rawlog

UNKNOWN = 127
"""Grey of the cells that MRPT never saw."""
COLUMNS = {"icp-slam": (1, 2, 3), "rbpf-slam": (1, 2, 4)}
"""Columns of x, y and heading in its `log_estimated_path.txt`."""


def main(program: str, dataset: str, out: str, seed: str = "0") -> None:
    """Write the recording as MRPT reads it, run the program, and convert what it leaves to `out`."""
    frames = list(open_log(Path(dataset)).frames)
    with tempfile.TemporaryDirectory(prefix="mrpt-") as name:
        folder = Path(name)
        rows = write_rawlog(folder / "drive.rawlog", frames)
        settings = Path(__file__).with_name(f"{program}.ini").read_text(encoding="utf-8")
        settings = settings.replace("= OUT", f"= {folder / 'out'}").replace("= SEED", f"= {seed}")
        (folder / "settings.ini").write_text(settings, encoding="utf-8")
        ran = subprocess.run(
            [program, folder / "settings.ini", folder / "drive.rawlog"], stdin=subprocess.DEVNULL, check=False
        )
        if ran.returncode:
            sys.exit(f"{program}: ended with exit status {ran.returncode}, expected 0")
        path = np.loadtxt(folder / "out" / "log_estimated_path.txt", usecols=COLUMNS[program], comments="%", ndmin=2)
        if len(path) != len(rows):
            sys.exit(f"{program}: {len(path)} poses, expected one for each of {len(rows)} scans")
        write_tum(Path(out) / "trajectory.tum", Trajectory(np.array([frames[row].stamp for row in rows]), path))
        write_map(Path(out) / "map.yaml", read_grid(folder / "out"))


def read_grid(folder: Path) -> OccupancyGrid:
    """Read the grid map that MRPT saves at the end: a picture, its first row at the largest y, and its limits [m]."""
    (picture,) = folder.glob("*COccupancyGridMap2D_00.png")
    x_min, x_max, y_min, _ = np.loadtxt(picture.with_name(f"{picture.stem}_limits.txt"), comments="%").tolist()
    grey = np.flipud(np.asarray(Image.open(picture).convert("L")))
    probability = np.where(grey == UNKNOWN, np.nan, 1.0 - grey / 255.0).astype(np.float32)
    return OccupancyGrid(
        probability=probability, resolution=(x_max - x_min) / grey.shape[1], origin=(x_min, y_min, 0.0)
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
