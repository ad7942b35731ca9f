# SPDX-License-Identifier: MIT
"""Opening a view of a run that begins, and of one that is over."""

from __future__ import annotations

import logging
import os
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from testbed.frame import Frame
from testbed.views.live import programs
from testbed.views.view import NullView, Scene, SystemLayer, View, ViewOptions

if TYPE_CHECKING:
    from testbed.views.rerun.moment_picture import MomentPictures
    from testbed.views.rerun.recorded import Event
    from testbed.views.rerun.systems_picture import SystemsPictures

logger = logging.getLogger(__name__)

RECORDING = "recording.rrd"
DEMO = Path(__file__).with_name("demo.rrd")
"""A recording that comes with the package, made by `tools/docs/make_demo.py`."""


def open_view(recording: Path | None, scene: Scene, options: ViewOptions | None = None) -> View:
    """A view that writes the recording to a file, and shows it live as the options ask.

    recording: the file to write;  None = the run is not to be watched at all
    """
    if recording is None:
        return NullView()
    # read by Rerun when it is imported: errors of its file writer are raised, so its log need not repeat them
    os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk=off")
    from testbed.views.rerun.rerun_view import RerunView

    return RerunView(recording, scene, options or ViewOptions())


class NoDisplayError(ValueError):
    """There is nowhere to open a window."""


@dataclass(frozen=True)
class OpenedRun:
    """The viewer that shows a run."""

    process: subprocess.Popen[bytes]
    address: str | None
    """Address of the web page, where one is served."""

    def wait(self) -> None:
        """Until the window is closed, or Ctrl-C."""
        try:
            self.process.wait()
        except KeyboardInterrupt:
            logger.info("viewer closed")
        finally:
            self.process.terminate()
            self.process.wait()


def recording_of(path: Path) -> Path | None:
    """Return the recording of a run directory, or the path itself if it is one; None for anything else."""
    recording = path / RECORDING if path.is_dir() else path
    return recording if recording.is_file() and recording.suffix == ".rrd" else None


def record_frames(recording: Path, frames: Iterable[Frame], scene: Scene) -> None:
    """Write a drive without an estimate as a recording, see `testbed.views.rerun.frames_recording`."""
    from testbed.views.rerun.frames_recording import write_frames

    write_frames(recording, frames, scene)


def record_systems(recording: Path, frames: Iterable[Frame], layers: Sequence[SystemLayer], scene: Scene) -> None:
    """Write what several systems made of a drive as one recording, see `testbed.views.rerun.systems_recording`."""
    from testbed.views.rerun.systems_recording import write_systems

    write_systems(recording, frames, layers, scene)


def record_side_by_side(recording: Path, runs: Sequence[tuple[str, Path]]) -> None:
    """Write several recordings, each with a title, as one, see `testbed.views.rerun.side_by_side`."""
    from testbed.views.rerun.side_by_side import write_side_by_side

    write_side_by_side(recording, runs)


def events_of(run: Path) -> list[Event] | None:
    """The event log of a run and its changes of state, in the order of time; None where it has no recording.

    run: a directory, or a recording

    Raises ValueError where the recording is damaged.
    """
    recording = recording_of(run)
    if recording is None:
        return None
    from testbed.views.rerun.recorded import Recorded

    recorded = Recorded(recording)
    return sorted([*recorded.events(), *recorded.states()], key=lambda event: event.time)


def moments_of(run: Path) -> MomentPictures | SystemsPictures | None:
    """Return what draws the moments of a run, or of a comparison of systems; None where it has no recording.

    run: a directory, or a recording

    Raises ValueError where the recording is damaged, or none of a run.
    """
    recording = recording_of(run)
    if recording is None:
        return None
    from testbed.views.rerun.moment_picture import MomentPictures
    from testbed.views.rerun.recorded import Recorded
    from testbed.views.rerun.systems_picture import SystemsPictures, systems_in

    recorded = Recorded(recording)
    return SystemsPictures(recorded) if systems_in(recorded) else MomentPictures(recorded)


def moments_for_report(run: Path) -> MomentPictures | None:
    """The pictures of a run's moments; None where it has no recording, or one that cannot be read: a report does
    without them."""
    from testbed.views.rerun.moment_picture import MomentPictures

    try:
        found = moments_of(run)
    except ValueError as error:
        logger.warning("the report has no pictures of moments: %s", error)
        return None
    return found if isinstance(found, MomentPictures) else None


def open_run(run: Path, *more: Path, serve: bool = False, moment: float | None = None) -> OpenedRun:
    """Show the recordings of runs: in the native viewer, or on a web page of this machine.

    run, more: run directories, or recordings;  moment: seconds since the first scan at which the native viewer pauses;
    the web page begins at the end

    Raises:
        ValueError: there is no recording.
        NoDisplayError: there is no display for a window.
    """
    recordings = []
    for path in (run, *more):
        recording = recording_of(path)
        if recording is None:
            raise ValueError(f"{path}: no recording; expected a run directory with {RECORDING}, or an .rrd file")
        recordings.append(str(recording))
    if serve:
        port, web_port = programs.free_port(), programs.free_port()
        command = [*programs.server_command(port, web_port), *recordings]
        address = programs.web_address(port, web_port)
    else:
        if programs.display_missing():
            raise NoDisplayError("no display to open the viewer on")
        port = programs.free_port()
        command = [*programs.window_command(port), *recordings]
        address = None
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    if moment is not None and not serve:
        from testbed.views.live.moment import show_moment

        show_moment(process, port, moment)
    return OpenedRun(process, address)
