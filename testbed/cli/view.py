# SPDX-License-Identifier: MIT
"""`testbed view`."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from eval.files.atomic_write import atomic_write
from eval.files.map_server import read_map
from testbed.cli.shared.console import console
from testbed.formats import open_log
from testbed.views import Scene, open_run, record_frames, recording_of


def view(paths: list[Path], /, *, serve: bool = False, save: Path | None = None) -> None:
    """Open runs, datasets or recorded logs in the Rerun viewer.

    A dataset or log is shown as a drive: the robot and its scans, laid out by the truth and by the odometry.

    Parameters
    ----------
    paths
        Directories of runs, datasets, or recorded logs. Several open in one viewer, one below the other in its list of
        recordings.
    serve
        Serve the recordings to a web browser on this machine instead of opening a window.
    save
        Write one recording to this file (`.rrd`) instead of showing it, to send it: `rerun FILE` opens it.
    """
    if save is not None:
        _save(paths, save)
        return
    with tempfile.TemporaryDirectory() as folder:
        recordings = [
            recording_of(path) or _recorded(path, Path(folder) / f"{number}.rrd") for number, path in enumerate(paths)
        ]
        viewer = open_run(*recordings, serve=serve)
        if viewer.address is not None:
            console.print(f"view: {viewer.address}", soft_wrap=True)
        viewer.wait()


def _save(paths: list[Path], save: Path) -> None:
    """Write the recording of one run, dataset or log to a file that must not exist."""
    if len(paths) != 1:
        raise ValueError(f"--save writes one recording, got {len(paths)}")
    if save.suffix != ".rrd" or save.exists():
        raise ValueError(f"{save}: {'exists' if save.exists() else 'expected a name that ends in .rrd'}")
    recording = recording_of(paths[0])
    with atomic_write(save) as temporary:
        if recording is not None:
            shutil.copyfile(recording, temporary)
        else:
            _recorded(paths[0], temporary)
    console.print(f"{save}: `rerun {save}` opens it", soft_wrap=True)


def _recorded(path: Path, recording: Path) -> Path:
    """Write a dataset or log as a recording."""
    true_map = path / "truth_map.yaml"
    scene = Scene(title=path.name, true_map=read_map(true_map) if true_map.is_file() else None)
    record_frames(recording, open_log(path).frames, scene)
    return recording
