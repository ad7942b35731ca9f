# SPDX-License-Identifier: MIT
"""`testbed view`."""

from __future__ import annotations

import math
import shlex
import shutil
import tempfile
from importlib.metadata import version
from pathlib import Path

from eval.files.atomic_write import atomic_write
from eval.files.failure_json import read_failure
from eval.files.map_server import read_map
from eval.files.tum import read_tum
from eval.wording import at_time, up_to_a_tenth
from testbed.cli.shared.console import console, results
from testbed.datasets import open_dataset
from testbed.datasets.index import datasets_in
from testbed.formats import open_log
from testbed.formats.checksums import CONFIG
from testbed.views import (
    DEMO,
    NoDisplayError,
    Scene,
    events_of,
    moments_of,
    open_run,
    record_frames,
    record_side_by_side,
    recording_of,
)
from testbed.views.opening import RECORDING

TENTH = 0.1
"""Times are printed rounded up to a tenth [s]: one so little after the end is the end."""


def view(
    paths: list[Path] | None = None,
    /,
    *,
    demo: bool = False,
    time: str | None = None,
    serve: bool = False,
    save: Path | None = None,
    events: bool = False,
) -> None:
    """Open runs, datasets, recorded logs, or the worst runs of a sweep in the Rerun viewer.

    A dataset or log is shown as a drive: the robot and its scans, laid out by the truth and by the odometry. Several
    paths, or the runs in the folder `worst` of a sweep, are shown side by side under one time cursor, each from its
    first scan on. A run that went wrong opens where its report names the moment. Without a display: --serve, --events,
    or pictures of moments: `testbed view RUN --time 5,60 --save moment.png`. docs/views.md says what they show.

    Parameters
    ----------
    paths
        Directories of runs or sweeps, datasets, or recorded logs.
    demo
        Show a finished run of the world `office` that comes with the package.
    time
        Open the window at this time, in seconds since the first scan. With --save x.png this moment is drawn; several
        times, separated by commas, give several pictures. A saved recording opens at its start and a web page at its
        end; the time to go to is printed.
    serve
        Serve the recordings to a web browser on this machine instead of opening a window.
    save
        Write to this file instead of showing it, to send it: a recording (`.rrd`), which `rerun FILE` opens, or a
        picture (`.png`). The picture of a run shows the map, the particles and the proposal at --time, that of a
        comparison each system, that of one dataset or log the map, the paths and one scan. Several times give
        x-5s.png, x-60s.png and so on.
    events
        Print the event log of a run instead of showing it: time since the first scan, level, what happened.
    """
    paths = _chosen(paths or [], demo)
    times = [] if time is None else _times(time)
    for path in paths:
        _say_unfinished(path)
        _refuse_collection(path)
    if events:
        if times or serve or save is not None:
            raise ValueError("--events: prints the whole event log; expected no other option with it")
        _print_events(paths)
        return
    if save is not None and save.suffix not in (".rrd", ".png"):
        raise ValueError(f"{save}: expected a name that ends in .rrd or .png")
    if save is not None and save.suffix == ".png":
        _draw(paths, save, times)
        return
    if save is not None and save.exists():
        raise ValueError(f"{save}: exists")
    if len(times) > 1:
        raise ValueError(f"--time {time}: expected one time; several are for pictures, --save x.png")
    moment = times[0] if times else _moment_of_failure(paths[0]) if len(paths) == 1 else None
    with tempfile.TemporaryDirectory() as folder:
        shown = _one_recording(paths, Path(folder))
        if save is not None:
            with atomic_write(save) as temporary:
                shutil.copyfile(shown, temporary)
            package, then = f"rerun-sdk=={version('rerun-sdk')}", _then_move(moment)
            console.print(f"{save}: with `pip install {package}`, `rerun {save}` opens it{then}", soft_wrap=True)
            return
        try:
            viewer = open_run(shown, serve=serve, moment=moment)
        except NoDisplayError as error:
            raise ValueError(f"{error}; {_without_display(paths, moment)}") from None
        if viewer.address is not None:
            console.print(f"view: {viewer.address}{_then_move(moment)}; served until Ctrl-C", soft_wrap=True)
        viewer.wait()


def _chosen(paths: list[Path], demo: bool) -> list[Path]:
    """What is to be shown: the paths, or the recording that comes with the package."""
    if demo and paths:
        raise ValueError(f"--demo: shows the run that comes with the package, expected no {paths[0]} with it")
    if not demo and not paths:
        raise ValueError("expected a run, dataset or log, as in testbed view runs/NAME; --demo shows one that is there")
    return [DEMO] if demo else paths


def _say_unfinished(path: Path) -> None:
    """Say of a run that is still going on, or was killed, that only its beginning is shown.

    Raises ValueError where it has recorded nothing yet.
    """
    if not path.is_dir() or (path / "metrics.json").is_file():
        return
    names = {file.name for file in path.iterdir()}
    if {"config.toml", RECORDING} <= names:
        console.print(f"{path}: not finished; this is what was recorded so far", soft_wrap=True)
    elif names == {"config.toml"}:
        raise ValueError(
            f"{path}: nothing is recorded yet; if this run has just begun, try again in a moment, or begin it with "
            "--view to watch it live"
        )


def _refuse_collection(path: Path) -> None:
    """Raise ValueError for several datasets, and name the picture of all of them where it is there."""
    if (path / "sweep.toml").is_file() or (path / CONFIG).is_file() or len(there := datasets_in(path)) < 2:
        return
    from testbed.datasets.card import SHEET  # here, for a window to open without what draws it

    sheet = f"; {path / SHEET} is a picture of all" if (path / SHEET).is_file() else ""
    raise ValueError(
        f"{path}: holds {len(there)} datasets; name one, such as {there[0]}, or several to see them side by side{sheet}"
    )


def _times(text: str) -> list[float]:
    """Read times, separated by commas, in seconds since the first scan; a time that is repeated counts once."""
    try:
        times = [float(part) for part in text.split(",")]
    except ValueError:
        times = [math.nan]
    if not all(math.isfinite(time) and time >= 0.0 for time in times):
        raise ValueError(f"--time {text}: expected seconds since the first scan, or several, such as 5,60")
    return list(dict.fromkeys(times))


def _print_events(paths: list[Path]) -> None:
    """Print the event log of one run."""
    found = events_of(paths[0]) if len(paths) == 1 else None
    if found is None:
        raise ValueError(f"{paths[0]}: expected one run with a recording, whose event log is to be printed")
    for event in found:
        results.print(f"{up_to_a_tenth(event.time):7.1f} s  {event.level:5}  {event.text}", markup=False)


def _draw(paths: list[Path], picture: Path, times: list[float]) -> None:
    """Draw moments of one run, or one dataset or log; several times give several pictures."""
    from testbed.datasets.picture import draw_drive  # here, for a window to open without matplotlib

    if len(paths) != 1 or (paths[0] / "sweep.toml").is_file():
        raise ValueError(f"{picture}: a picture is made of one run, comparison, dataset or log")
    moments = moments_of(paths[0])
    drive = open_dataset(paths[0]) if moments is None else None  # refuses a collection before anything is drawn
    if moments is not None and not times:
        moment = _moment_of_failure(paths[0])
        times = [] if moment is None else [moment]
    pictures: dict[Path, float | None] = {picture: times[0] if times else None}
    if len(times) > 1:
        pictures = {_named(picture, time): time for time in times}
    for file in pictures:
        if file.exists():
            raise ValueError(f"{file}: exists")
    for file, time in pictures.items():
        console.print(f"{file}: drawing {'the end' if time is None else f'{time:g} s'} …", soft_wrap=True)
        if drive is None:
            assert moments is not None
            if time is not None and time > moments.end + TENTH:
                console.print(
                    f"{file}: the run ends at {at_time(moments.end)}, before the time of {time:g} s; its end is drawn",
                    soft_wrap=True,
                )
            with atomic_write(file) as temporary:
                temporary.write_bytes(moments.png(math.inf if time is None else time, times))
        else:
            draw_drive(drive, file, _title_of_drive(paths[0]), time)
    console.print(f"{', '.join(f'{file}' for file in pictures)}: written", soft_wrap=True)


def _named(picture: Path, time: float) -> Path:
    """The name of one of several pictures: moment-129.2s.png."""
    return picture.with_name(f"{picture.stem}-{time:g}s{picture.suffix}")


def _without_display(paths: list[Path], time: float | None) -> str:
    """Commands that show the same without a display: as a web page; a single path also as a picture at a time [s]."""
    shown = "--demo" if paths == [DEMO] else shlex.join(map(str, paths))
    at = "" if time is None else f" --time {time:g}"
    page = f"for a browser: testbed view {shown}{at} --serve"
    if len(paths) > 1 or (paths[0] / "sweep.toml").is_file():
        return page
    return f"for a picture: testbed view {shown}{at} --save moment.png; {page}"


def _then_move(time: float | None) -> str:
    """What is left to do where the viewer cannot begin at a time [s]: on a web page, or with a saved recording."""
    return "" if time is None else f"; there, move the time cursor to {time:.1f} s"


def _one_recording(paths: list[Path], folder: Path) -> Path:
    """The recording of a run, or one made in the folder from a log or from several paths."""
    recordings = [
        (path.name, recording_of(path) or _recorded(path, folder / f"{number}.rrd"))
        for number, path in enumerate(single for path in paths for single in _runs_of(path))
    ]
    if len(recordings) == 1:
        return recordings[0][1]
    together = folder / "side_by_side.rrd"
    record_side_by_side(together, recordings)
    return together


def _moment_of_failure(run: Path) -> float | None:
    """Time at which it can be seen that a run went wrong, in seconds since its first scan; None if it did not, or for
    anything else."""
    finding, estimate = run / "finding.json", run / "estimate.tum"
    if not (finding.is_file() and estimate.is_file()):
        return None
    failure, stamps = read_failure(finding).failure, read_tum(estimate).stamps
    return failure.time_to_watch(stamps) if failure.bad else None


def _runs_of(path: Path) -> list[Path]:
    """The recorded worst runs of a sweep, the worst first in the order of their names; else the path itself.

    Raises ValueError for a sweep without any.
    """
    if not (path / "sweep.toml").is_file():
        return [path]
    runs = sorted(run for run in (path / "worst").glob("*") if recording_of(run) is not None)
    if not runs:
        raise ValueError(f"{path}: no run of this sweep was recorded; expected some in {path / 'worst'}")
    return runs


def _title_of_drive(path: Path) -> str:
    """Name of a dataset, with its world, lidar and seed; of another log, its own name."""
    settings = open_dataset(path).settings
    named = [str(settings[key]) for key in ("world", "lidar") if settings.get(key)]
    named += [f"seed {settings['seed']}"] if "seed" in settings else []
    return path.resolve().name + (f": {', '.join(named)}" if named else "")


def _recorded(path: Path, recording: Path) -> Path:
    """Write a dataset or log as a recording."""
    log, true_map = open_log(path), path / "truth_map.yaml"
    console.print(f"{path}: drawing {log.scan_count} scans …", soft_wrap=True)
    scene = Scene(title=_title_of_drive(path), true_map=read_map(true_map) if true_map.is_file() else None)
    record_frames(recording, log.frames, scene)
    return recording
