# SPDX-License-Identifier: MIT
"""`testbed view` opens a run at the right moment."""

from __future__ import annotations

import importlib
import shlex
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import pytest

from eval.files.run_reader import read_run
from testbed.views import DEMO
from testbed.views.rerun.recorded import Event
from tests.eval.synthetic_run import write_run
from tests.shell import call

command = importlib.import_module("testbed.cli.view")


@pytest.fixture
def moments(monkeypatch: pytest.MonkeyPatch) -> list[float | None]:
    """Where the viewer was opened; no viewer is started."""
    opened: list[float | None] = []

    def open_run(run: Path, *, serve: bool, moment: float | None) -> SimpleNamespace:
        opened.append(moment)
        return SimpleNamespace(address=None, wait=lambda: None)

    monkeypatch.setattr(command, "open_run", open_run)
    return opened


class Moments(NamedTuple):
    """Draws moments of a run of 100 s."""

    png: Callable[[float, list[float]], bytes]
    end: float = 100.0


def test_of_a_run_that_goes_on_it_says_so(
    tmp_path: Path, moments: list[float | None], capsys: pytest.CaptureFixture
) -> None:
    run = write_run(tmp_path / "run")
    (run / "recording.rrd").touch()
    assert call("view", run) == 0
    assert "not finished" not in capsys.readouterr().err
    (run / "metrics.json").unlink()
    assert call("view", run) == 0
    assert "not finished; this is what was recorded so far" in capsys.readouterr().err
    begun = tmp_path / "begun"
    begun.mkdir()
    (begun / "config.toml").touch()
    assert call("view", begun) == 2
    assert "nothing is recorded yet; if this run has just begun, try again" in capsys.readouterr().err
    assert len(moments) == 2


def test_a_run_that_went_wrong_opens_at_its_moment(tmp_path: Path, moments: list[float | None]) -> None:
    for name in ("good", "broken"):
        run = write_run(tmp_path / name, broken=name == "broken")
        (run / "recording.rrd").touch()
        command.view([run])
    found, estimate = read_run(run).failure, read_run(run).estimate
    assert found is not None
    assert estimate is not None
    shown = estimate.stamps[found.failure.shown_scan]
    assert found.failure.stamp <= shown <= found.failure.stamp + 3.0
    assert moments[0] is None
    assert 0.0 <= moments[1] - (shown - estimate.stamps[0]) < 0.1  # never before the scan that shows it
    command.view([run], time="12.5")
    assert moments[-1] == 12.5


def test_a_moment_of_a_run_is_a_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The moment of the failure where no time is given; nothing is written where the recording is damaged."""
    run = write_run(tmp_path / "run", broken=True)
    (run / "recording.rrd").touch()
    with pytest.raises(ValueError, match=r"recording\.rrd: expected"):
        command.view([run], time="12.5", save=tmp_path / "damaged.png")
    assert not list(tmp_path.glob("*.png"))
    asked: list[float] = []
    monkeypatch.setattr(
        command, "moments_of", lambda path: Moments(lambda time, others: asked.append(time) or b"picture")
    )
    command.view([run], time="12.5", save=tmp_path / "one.png")
    command.view([run], save=tmp_path / "two.png")
    found, estimate = read_run(run).failure, read_run(run).estimate
    assert found is not None
    assert estimate is not None
    assert asked == [12.5, found.failure.time_to_watch(estimate.stamps)]
    assert (tmp_path / "one.png").read_bytes() == b"picture"
    with pytest.raises(ValueError, match="one run, comparison, dataset or log"):
        command.view([run, run], save=tmp_path / "three.png")


def test_several_times_are_a_picture_each_named_by_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = write_run(tmp_path / "run")
    (run / "recording.rrd").touch()
    compared: list[list[float]] = []

    def draw(time: float, others: list[float]) -> bytes:
        compared.append(others)
        return f"{time}".encode()

    monkeypatch.setattr(command, "moments_of", lambda path: Moments(draw))
    command.view([run], time="5,60,129.2,5", save=tmp_path / "m.png")
    drawn = {file.name: float(file.read_bytes()) for file in tmp_path.glob("*.png")}
    assert drawn == {"m-5s.png": 5.0, "m-60s.png": 60.0, "m-129.2s.png": 129.2}
    assert compared == 3 * [[5.0, 60.0, 129.2]]  # for one scale
    names = (("m-5s.png", "5"), ("m-60s.png", "60"), ("m-129.2s.png", "129.2"))
    said = [line for line in capsys.readouterr().err.splitlines() if "drawing" in line]
    assert said == [f"{tmp_path / name}: drawing {time} s …" for name, time in names]
    with pytest.raises(ValueError, match=r"m-60s\.png: exists"):
        command.view([run], time="7,60", save=tmp_path / "m.png")
    assert not (tmp_path / "m-7s.png").exists()
    with pytest.raises(ValueError, match="expected one time"):
        command.view([run], time="5,60")


def test_a_time_after_the_end_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = write_run(tmp_path / "run")
    (run / "recording.rrd").touch()
    monkeypatch.setattr(command, "moments_of", lambda path: Moments(lambda time, others: b"picture"))
    for time, said in (("100.1", False), ("500", True)):  # times are printed rounded up to a tenth
        command.view([run], time=time, save=tmp_path / f"{time}.png")
        assert ("the run ends at 100.0 s, before the time of" in capsys.readouterr().err) is said


def test_without_a_display_the_ready_commands_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = write_run(tmp_path / "a run")
    (run / "recording.rrd").touch()
    monkeypatch.setattr("testbed.views.live.programs.display_missing", lambda: True)
    with pytest.raises(ValueError, match="no display") as caught:
        command.view([run], time="12.5")
    picture, page = f"{caught.value}".split("; ")[1:]
    words = ["testbed", "view", str(run), "--time", "12.5"]
    assert shlex.split(picture.removeprefix("for a picture: ")) == [*words, "--save", "moment.png"]
    assert shlex.split(page.removeprefix("for a browser: ")) == [*words, "--serve"]


def test_of_a_collection_the_picture_of_all_is_named(tmp_path: Path) -> None:
    for name in ("loop-0000", "loop-0001"):
        (tmp_path / "data" / name).mkdir(parents=True)
        for file in ("config.toml", "world.toml"):
            (tmp_path / "data" / name / file).touch()
    sheet = tmp_path / "data" / "contact_sheet.png"
    for drawn in (False, True):
        if drawn:
            sheet.touch()
        for save in (tmp_path / "all.png", tmp_path / "all.rrd", None):
            with pytest.raises(ValueError, match=r"holds 2 datasets; name one, such as .*loop-0000") as caught:
                command.view([tmp_path / "data"], save=save)
            assert f"{caught.value}".endswith(f"; {sheet} is a picture of all") is drawn


def test_the_event_log_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    events = [Event(91.13, "INFO", "resampled: [11] of 30 died"), Event(282.6, "ERROR", "lost")]
    monkeypatch.setattr(command, "events_of", lambda path: events)
    command.view([tmp_path], events=True)
    lines = ["   91.2 s  INFO   resampled: [11] of 30 died", "  282.6 s  ERROR  lost"]
    assert capsys.readouterr().out.splitlines() == lines
    with pytest.raises(ValueError, match="--events: prints the whole event log"):
        command.view([tmp_path], events=True, time="5")


def test_the_demo_is_there_without_any_run(capsys: pytest.CaptureFixture[str]) -> None:
    assert DEMO.stat().st_size < 5_000_000  # everybody installs it
    assert call("view", "--demo", "--events") == 0
    events = capsys.readouterr().out.splitlines()
    assert any("old walls in view again" in line for line in events)
    assert any("particles died" in line for line in events)


def test_the_demo_is_shown_like_any_run(moments: list[float | None], monkeypatch: pytest.MonkeyPatch) -> None:
    command.view(demo=True, time="129.8")
    assert moments == [129.8]
    monkeypatch.undo()
    monkeypatch.setattr("testbed.views.live.programs.display_missing", lambda: True)
    with pytest.raises(ValueError, match="for a browser: testbed view --demo --serve"):
        command.view(demo=True)


def test_either_paths_or_the_demo_are_expected(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--demo shows one that is there"):
        command.view([])
    with pytest.raises(ValueError, match=r"expected no .* with it"):
        command.view([tmp_path], demo=True)


def test_only_a_run_has_an_event_log(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected one run with a recording"):
        command.view([tmp_path], events=True)


def test_a_web_page_and_a_file_say_where_to_move_the_cursor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = write_run(tmp_path / "run")
    (run / "recording.rrd").touch()
    opened = SimpleNamespace(address="http://127.0.0.1:9090", wait=lambda: None)
    monkeypatch.setattr(command, "open_run", lambda *paths, **options: opened)
    command.view([run], time="12.5", serve=True)
    command.view([run], time="12.5", save=tmp_path / "sent.rrd")
    page, file = capsys.readouterr().err.splitlines()
    assert page == "view: http://127.0.0.1:9090; there, move the time cursor to 12.5 s; served until Ctrl-C"
    assert file.endswith("opens it; there, move the time cursor to 12.5 s")
    assert f"rerun-sdk=={version('rerun-sdk')}" in file


def test_a_drive_is_titled_by_what_was_simulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = tmp_path / "loop-0004"
    assert call("simulate", "loop", "--seed", "4", "--duration", "0.5", "--lidar", "lds01", "--out", tmp_path) == 0
    copy = tmp_path / "copy"
    assert call("convert", dataset, copy, "--to", "rosbag2") == 0
    titles: list[str] = []
    monkeypatch.setattr(command, "record_frames", lambda recording, frames, scene: titles.append(scene.title))
    for path in (dataset, copy):
        command._recorded(path, tmp_path / "drive.rrd")
    assert titles == ["loop-0004: loop, lds01, seed 4", "copy"]


@pytest.mark.parametrize("time", ["-1", "5,-1", "5,", "soon", "nan", "5;6"])
def test_a_time_before_the_first_scan_is_refused(tmp_path: Path, time: str) -> None:
    with pytest.raises(ValueError, match="expected seconds since the first scan"):
        command.view([tmp_path], time=time)
