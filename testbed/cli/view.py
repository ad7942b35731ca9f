# SPDX-License-Identifier: MIT
"""`testbed view`."""

from __future__ import annotations

import tempfile
from pathlib import Path

from eval.files.map_server import read_map
from testbed.cli.shared.console import console
from testbed.formats import open_log
from testbed.views import Scene, open_run, record_frames, recording_of


def view(paths: list[Path], /, *, serve: bool = False) -> None:
    """Open runs, datasets or recorded logs in the Rerun viewer.

    A dataset or log is shown as a drive: the robot and its scans, laid out by the truth and by the odometry.

    Parameters
    ----------
    paths
        Directories of runs, datasets, or recorded logs. Several open in one viewer, one below the other in its list of
        recordings.
    serve
        Serve the recordings to a web browser on this machine instead of opening a window.
    """
    with tempfile.TemporaryDirectory() as folder:
        recordings = [
            recording_of(path) or _recorded(path, Path(folder) / f"{number}.rrd") for number, path in enumerate(paths)
        ]
        viewer = open_run(*recordings, serve=serve)
        if viewer.address is not None:
            console.print(f"view: {viewer.address}", soft_wrap=True)
        viewer.wait()


def _recorded(path: Path, recording: Path) -> Path:
    """Write a dataset or log as a recording."""
    true_map = path / "truth_map.yaml"
    scene = Scene(title=path.name, true_map=read_map(true_map) if true_map.is_file() else None)
    record_frames(recording, open_log(path).frames, scene)
    return recording
