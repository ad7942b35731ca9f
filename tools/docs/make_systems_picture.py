# SPDX-License-Identifier: MIT
"""Draw the comparison of four systems in the office: trajectories and errors, and the recording in the viewer.

    python -m tools.docs.make_systems_picture

Writes: docs/pictures/systems.png, docs/pictures/systems_recording.png

The second needs a Vulkan driver, see `tools.headless_viewer`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from eval.files.run_reader import RunFiles, read_run
from eval.report.comparison_plots import colour_of
from eval.report.plots import STYLE, TRUTH
from eval.report.report_context import positions_in
from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from tools.headless_viewer import headless_viewer

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "pictures"
SHOWN = 0.7
"""The recording is shown at this share of the drive."""
SYSTEMS = ("examples/my_slam.py:MySlam", "odometry", "scan-matching", "gmapping")
COMMAND = ("run", "office", "--backend", "fast", "--particles", "10", "--system", ",".join(SYSTEMS))


def draw(runs: list[RunFiles]) -> Figure:
    """Draw the paths over the true map on the left, the errors over time on the right."""
    with rc_context(STYLE):
        figure = Figure(figsize=(11.0, 4.2))
        left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
        grid, truth = runs[0].truth_grid, runs[0].truth
        assert grid is not None
        assert truth is not None
        rows, cols = grid.probability.shape
        x, y, _ = grid.origin
        extent = (x, x + cols * grid.resolution, y, y + rows * grid.resolution)
        grey = np.where(grid.known, 1.0 - 0.5 * np.nan_to_num(grid.probability), 0.93)
        left.imshow(grey, extent=extent, origin="lower", cmap="gray", vmin=0.0, vmax=1.0, interpolation="nearest")
        left.plot(*truth.poses[:, :2].T, color=TRUTH, lw=2.4, label="truth")
        for number, run in enumerate(runs):
            assert run.estimate is not None
            matched = associate(run.estimate, truth)
            errors = absolute_error(matched, "se2")
            path = positions_in(errors.alignment.T_reference_estimate, run.estimate)
            name = f"{run.metric('system.name')}, {100.0 * errors.translation.rmse:.1f} cm"
            left.plot(*path.T, color=colour_of(number), lw=1.1, label=name)
            time = matched.estimate.stamps - truth.stamps[0]
            right.plot(time, 100.0 * errors.translation_errors, color=colour_of(number), lw=1.2)
        left.set(xlabel="x [m]", ylabel="y [m]")
        left.grid(False)
        right.set(xlabel="time [s]", ylabel="position error [cm]")
        right.set_ylim(bottom=0.0)
        figure.legend(loc="outside upper center", ncols=len(runs) + 1)
        return figure


def main() -> None:
    """Run the systems and draw the picture."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        testbed = str(Path(sys.executable).with_name("testbed"))
        subprocess.run([testbed, *COMMAND, "--out", f"{folder}/runs"], check=True, cwd=ROOT)
        names = [text.rpartition(":")[2] for text in SYSTEMS]
        figure = draw([read_run(Path(folder) / "runs" / name) for name in names])
        figure.savefig(PICTURES / "systems.png", dpi=110)
        with headless_viewer() as viewer:
            end = viewer.open(Path(folder) / "runs" / "recording.rrd")
            picture = viewer.picture(SHOWN * end, largest=1200)
        (PICTURES / "systems_recording.png").write_bytes(picture)


if __name__ == "__main__":
    main()
