# SPDX-License-Identifier: MIT
"""Make the recording that `testbed view --demo` shows, and the picture of it in docs/first-steps.md.

    python -m tools.docs.make_demo

Writes: testbed/views/demo.rrd, docs/pictures/demo.png

Nearly half of a recording are the scans: a drive through the office is mapped with three scans a second instead of ten,
which the filter does not mind. The native viewer draws the picture without a display or a graphics card.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from testbed.views import DEMO
from tools.docs.make_pictures import PICTURES, testbed
from tools.headless_viewer import headless_viewer

SCAN_PERIOD = 0.3
"""Time between two scans [s]."""
MAX_BYTES = 5_000_000
"""It is part of the package that everybody installs."""
SHOWN = 0.6
"""Part of the run after which the picture is taken."""


def main() -> None:
    """Make the recording, then the picture."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        drive, thinned, run = (Path(folder) / name for name in ("drive", "demo", "run"))
        testbed("simulate office --route fixed", drive)
        testbed(f"perturb {drive / 'office-0000'} {thinned} --scan-period {SCAN_PERIOD}", None)
        testbed(f"slam {thinned}", run)
        recording = run / "recording.rrd"
        if recording.stat().st_size > MAX_BYTES:
            raise RuntimeError(f"the recording has {recording.stat().st_size} bytes, more than {MAX_BYTES}")
        shutil.copyfile(recording, DEMO)
    with headless_viewer() as viewer:
        end = viewer.open(DEMO)
        (PICTURES / "demo.png").write_bytes(viewer.picture(SHOWN * end, largest=1400))


if __name__ == "__main__":
    main()
