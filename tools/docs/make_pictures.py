# SPDX-License-Identifier: MIT
"""Draw the pictures of a run in the Rerun viewer, for README.md and docs/views.md.

    python -m tools.docs.make_pictures            # runs `testbed run office`, then draws it
    python -m tools.docs.make_pictures RUN        # draws RUN/recording.rrd

Writes: docs/pictures/office.png, docs/pictures/office.gif

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

from tools.headless_viewer import HeadlessViewer, headless_viewer

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
FRAMES = 48
FRAME_MS = 120
LAST_FRAME_MS = 2500


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, nargs="?", help="directory of a run (default: a new one of the office)")
    run = parser.parse_args().run
    with tempfile.TemporaryDirectory() as folder:
        if run is None:
            run = Path(folder) / "office"
            subprocess.run([Path(sys.executable).with_name("testbed"), "run", "office", "--out", str(run)], check=True)
        with headless_viewer() as viewer:
            end = viewer.open(run / "recording.rrd")
            PICTURES.mkdir(exist_ok=True)
            (PICTURES / "office.png").write_bytes(viewer.picture(0.72 * end, largest=1400))
            save_animation(viewer, end, PICTURES / "office.gif")


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
