# SPDX-License-Identifier: MIT
"""Draw the pictures of a run in the Rerun viewer, for README.md and docs/views.md.

    python -m tools.docs.make_pictures               # three runs: the office, a large loop, one that ends lost
    python -m tools.docs.make_pictures --only lost

Writes: docs/pictures/office.png, docs/pictures/office.gif, docs/pictures/moment.png, docs/pictures/lost.png

The native viewer draws them without a display or a graphics card (Debian: apt-get install mesa-vulkan-drivers).
"""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from eval.files.failure_json import read_failure
from eval.files.run_reader import read_run
from eval.files.tum import read_tum
from eval.report.verdict import verdict
from testbed.views import moments_of
from tools.headless_viewer import HeadlessViewer, headless_viewer

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
FRAMES = 48
FRAME_MS = 120
LAST_FRAME_MS = 2500
LOOP_RUN = "run loop --backend fast --lidar lds01 --odometry.grade poor --particles 30 --no-refine"
"""The example of docs/views.md of a loop: the particles spread by 20 cm before it closes."""
LOST_RUN = (
    "run office --backend fast --lidar lds01 --odometry.grade poor --odometry.slip-rate 0.5 "
    "--odometry.slip-distance 0.5 --particles 1 --no-refine"
)
"""The example of docs/views.md of a run that ends lost."""
AFTER_S = 3.0
"""Its picture is taken so long after the moment that its report names [s]."""


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("office", "loop", "lost"), help="make the pictures of one run only")
    only = parser.parse_args().only
    PICTURES.mkdir(exist_ok=True)
    for name, draw in (("office", draw_office), ("loop", draw_loop), ("lost", draw_lost)):
        if only in (None, name):  # in a viewer of its own: the layout of the one before would stay
            with tempfile.TemporaryDirectory() as folder, headless_viewer() as viewer:
                draw(viewer, Path(folder) / name)


def draw_office(viewer: HeadlessViewer, run: Path) -> None:
    """Run the office into a directory, and draw it as a picture and as an animation."""
    testbed("run office", run)
    end = viewer.open(run / "recording.rrd")
    (PICTURES / "office.png").write_bytes(viewer.picture(0.72 * end, largest=1400))
    save_animation(viewer, end, PICTURES / "office.gif")


def draw_loop(viewer: HeadlessViewer, run: Path) -> None:
    """Run a large loop into a directory, and draw the moment by which its report names it."""
    testbed(LOOP_RUN, run)
    moment, moments = verdict(read_run(run)).loop.time, moments_of(run)
    if moment is None or moments is None:
        raise RuntimeError(f"testbed {LOOP_RUN}: it closes no loop any more, or has no recording")
    (PICTURES / "moment.png").write_bytes(moments.png(moment))


def draw_lost(viewer: HeadlessViewer, run: Path) -> None:
    """Run what ends lost into a directory, and draw it where it goes wrong."""
    testbed(LOST_RUN, run)
    failure = read_failure(run / "finding.json").failure
    if not failure.bad:
        raise RuntimeError(f"testbed {LOST_RUN}: it does not end lost any more; choose another example")
    viewer.open(run / "recording.rrd")
    moment = failure.stamp - float(read_tum(run / "estimate.tum").stamps[0])
    (PICTURES / "lost.png").write_bytes(viewer.picture(moment + AFTER_S, largest=1400))


def testbed(command: str, out: Path | None) -> None:
    """Run a command of the testbed, into a directory if it is one that takes it as `--out`."""
    program = Path(sys.executable).with_name("testbed")
    subprocess.run([program, *command.split(), *([] if out is None else ["--out", str(out)])], check=True)


def save_animation(viewer: HeadlessViewer, end: float, path: Path) -> None:
    """Write an animation of the map view from the first scan to the time `end` [s] of the recording."""
    viewer.picture(0.0, "Map")  # the first picture is slow; draw it before the timed ones
    shots = [viewer.picture(end * k / (FRAMES - 1), "Map", settle=0.3, largest=640) for k in range(FRAMES)]
    images = [Image.open(io.BytesIO(png)).convert("RGB") for png in shots]
    palette = images[-1].quantize(64)  # one palette for all frames, or colours flicker
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [FRAME_MS] * (FRAMES - 1) + [LAST_FRAME_MS]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations, loop=0, optimize=True)


if __name__ == "__main__":
    main()
