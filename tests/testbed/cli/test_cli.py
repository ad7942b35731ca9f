# SPDX-License-Identifier: MIT
"""The command line: bad input is one line and exit status 2, and leaves nothing that looks finished."""

import errno
import gzip
import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

import testbed.presets
import worlds
from slam.scan import Scan
from testbed.cli.shared.help_texts import HELP
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.run.run_directory import RUN_FILES, RunDirectory
from testbed.settings.simulator import SimulatorOptions
from tests.cheaper import undrawn
from tests.shell import TESTBED, assert_refused, call
from tests.testbed.recordings import write_frames
from worlds import catalogue, load

pytestmark = pytest.mark.usefixtures("without_pictures")


def room_log(path: Path, scans: int = 5) -> Path:
    """A robot that drives 0.2 m a scan through a square room of 8 m."""
    angles = np.linspace(-np.pi, np.pi, 180, endpoint=False)
    frames = []
    for k in range(scans):
        x = 0.2 * k - 2.0
        with np.errstate(divide="ignore"):
            to_x = (np.where(np.cos(angles) > 0, 4.0, -4.0) - x) / np.cos(angles)
            to_y = np.where(np.sin(angles) > 0, 4.0, -4.0) / np.sin(angles)
        scan = Scan(ranges=np.minimum(to_x, to_y), angles=angles, range_max=20.0)
        pose = np.array([x, 0.0, 0.0])
        frames.append(Frame(stamp=float(k), odometry=pose, scan=scan, truth=pose))
    write_frames(path, frames)
    return path


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["rn", "office"], 'Did you mean "run"'),
        (["run"], "run: expected WORLD, as in: testbed run office"),
        (["simulate", "office"], "simulate: expected --out, as in: testbed simulate office --out data"),
        (["worlds", "import", "map.yaml"], "expected --out, as in: testbed worlds import MAP.yaml --out floor.toml"),
        (["run", "ofice"], "office"),
        (["run", "office", "--particles", "0"], "particles must be at least 1"),
        (["run", "office", "--particles", "-3"], "particles must be at least 1"),
        (["run", "office", "--particles", "many"], "many"),
        (["run", "office", "--odometry", "good"], "--odometry.grade"),
        (["run", "office", "--driver", "explor"], 'Did you mean "explore"'),
        (["run", "office", "--driver", "recorded"], "--commands FILE belong together"),
        (["run", "office", "--commands", "c.csv"], "--commands FILE belong together"),
        (["run", "office", "--off-wall", "o.csv"], "--off-wall FILE is of a recorded drive"),
        (["run", "office", "--driver", "recorded", "--commands", "nowhere.csv"], "nowhere.csv: no such file"),
        (["run", "office", "--driver", "teleop"], "needs a terminal"),
        (["run", "office", "--lidar", "lds01,lds02"], "carries 1 lidar, not 2: expected dingo_d or pioneer3dx"),
        (["run", "office", "--filter.match", "3"], "--filter.match.hit-sigma"),
        (["run", "nowhere.yaml"], "nowhere.yaml: No such file"),
        (["simulate", "loop", "--variant", "../x", "--out", "datasets"], "variant '../x': expected a name"),
        (["simulate", "loop", "--seed", "-4", "--out", "datasets"], "seed must not be negative"),
        (["worlds", "generate", "maze", "--out", "nowhere/maze.toml"], "nowhere: no such directory"),
        (["run", "office", "--robot", "creat3"], "create3"),
        (["run", "office", "--lidar", "rplidar_b2"], "rplidar_a2"),
        (["run", "office", "--seed", "-1"], "seed must not be negative"),
        (["run", "office", "--duration", "0"], "duration must be above 0"),
        (["run", "office", "--filter.match.hit-sigm", "1"], "Did you mean --filter.match.hit-sigma"),
        (["run", "office", "--filter.match.hit-sigma", "-1"], "must be positive"),
        (["run", "office", "--filter.resample.scheme", "best"], "systematic"),
        (["run", "office", "--fail-if", "ate too large"], "expected KEY COMPARISON VALUE"),
        (["run", "office", "--config", "nowhere.toml"], "nowhere.toml: no such file"),
        (["run", "--config", "."], "no such file"),
        (["slam", "nowhere.log"], "nowhere.log: no such file"),
        (["worlds", "show", "ofice"], "office"),
        (["report", "."], "."),
        (["view", "."], "not a log that can be read"),
        (["view", "a", "b", "--save", "c.rrd"], "a: "),
        (["view", ".", "--save", "c.mp4"], "c.mp4: expected a name that ends in .rrd"),
        (["convert", "nowhere.log", "out.log", "--to", "carmen"], "nowhere.log: no such file"),
    ],
)
def test_bad_usage_is_one_line_and_leaves_no_directory(here, capsys, arguments, complaint):
    assert_refused(capsys, complaint, *arguments)
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "..", "-x"])
@pytest.mark.parametrize("command", ["run evil.toml", "simulate evil.toml --out datasets", "worlds show evil.toml"])
def test_a_world_cannot_name_a_path(here, capsys, command, name):
    text = Path(worlds.__file__).with_name("catalogue").joinpath("loop.toml").read_text()
    Path("evil.toml").write_text(text.replace('name = "loop"', f'name = "{name}"'))
    assert_refused(capsys, f"name = {name!r}, expected a name of", *command.split())
    assert [path.name for path in here.iterdir()] == ["evil.toml"]


GOOD_SCAN = "FLASER 180 " + "1.00 " * 180 + "0 0 0 0 0 0 1.0 host 1.0\n"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"ODOM 0 0 0 0 0 0 1.0 host 1.0\n", "no scans"),
        (gzip.compress(os.urandom(3000) + GOOD_SCAN.encode() * 50)[:-50], "truncated"),
        (GOOD_SCAN.replace("FLASER 180", "FLASER 181").encode(), ":1: FLASER with 181 beams"),
        (GOOD_SCAN.replace("0 0 0 1.0", "0 nan 0 1.0").encode(), ":1: odometry pose must be finite"),
        (b"some notes\n", "not a log that can be read"),
    ],
)
def test_bad_log_is_one_line_and_leaves_no_directory(here, capsys, content, complaint):
    Path("bad.log").write_bytes(content)
    assert_refused(capsys, complaint, "slam", "bad.log", "--out", "run")
    assert [path.name for path in here.iterdir()] == ["bad.log"]


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("nam = 'x'\n", "name"),
        ("name = \n", "line"),
        ("name = 'x'\n[start]\ntheta = 90.0\n", "theta"),
    ],
)
def test_bad_world_file_is_one_line(here, capsys, line, complaint):
    Path("world.toml").write_text(line)
    assert_refused(capsys, complaint, "run", "world.toml", "--out", "run")
    assert not Path("run").exists()


def test_without_pybullet_one_line_says_what_to_do(here, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)  # as where it has no wheel
    assert_refused(capsys, "'pip install pybullet", "run", "office", "--backend", "pybullet", "--out", "run")
    assert_refused(capsys, "'pip install pybullet", "simulate", "office", "--backend", "pybullet", "--out", "run")
    assert not Path("run").exists()


@pytest.mark.parametrize("installed", [True, False])
def test_the_backend_is_decided_before_it_is_written(here, capsys, monkeypatch, installed):
    monkeypatch.setattr("testbed.simulation.config.is_installed", lambda: installed)
    if installed:
        pytest.importorskip("pybullet")
    assert call("run", "loop", "--duration", "0.5", "--particles", "1", "--no-refine", "--out", "run") == 0
    backend = tomllib.loads(Path("run/config.toml").read_text())["settings"]["backend"]
    assert backend == ("pybullet" if installed else "fast")
    lines = [line for line in capsys.readouterr().err.splitlines() if "PyBullet" in line]
    assert len(lines) == (0 if installed else 1)
    assert call("run", "--config", "run/config.toml", "--out", "again") == 0
    assert "PyBullet" not in capsys.readouterr().err  # it is named now


def test_datasets_are_made_by_the_fast_backend(here, capsys):
    assert call("simulate", "loop", "--duration", "0.5", "--format", "parquet", "--out", "data") == 0
    assert tomllib.loads(Path("data/loop-0000/config.toml").read_text())["settings"]["backend"] == "fast"
    assert "PyBullet" not in capsys.readouterr().err


def test_a_directory_with_other_work_is_left_alone(here, capsys):
    room_log(here / "room.log")
    (here / "run").mkdir()
    (here / "run" / "thesis.tex").write_text("years of work")
    assert_refused(capsys, "run: is not empty", "slam", "room.log", "--out", "run")
    assert [path.name for path in (here / "run").iterdir()] == ["thesis.tex"]


def test_settings_and_output_are_checked_before_the_log_is_read(here, capsys):
    """A log of many megabytes takes a while, and its notes would be more than the one line."""
    Path("room.log").write_text("no log at all")
    Path("full").mkdir()
    Path("full", "notes.txt").write_text("mine")
    assert_refused(capsys, "particles must be at least 1, got 0", "slam", "room.log", "--particles", "0")
    assert_refused(capsys, "full: is not empty", "slam", "room.log", "--out", "full")


@pytest.mark.parametrize("kind", ["lidar", "robot", "config"])
def test_a_complaint_quotes_little_of_a_long_value(here, capsys, kind):
    key, text = "particles", "[settings.filter]\nparticles = 3\n"
    if kind != "config":
        key, name = {"lidar": ("range_max", "lds01"), "robot": ("max_speed", "burger")}[kind]
        text = (Path(testbed.presets.__file__).parent / f"{kind}s" / f"{name}.toml").read_text()
    for value in ("y" * 5000, "y " * 2500):
        Path("x.toml").write_text(re.sub(rf"^{key} = .*", f'{key} = "{value}"', text, count=1, flags=re.MULTILINE))
        assert call("run", "loop", f"--{kind}", "x.toml", "--out", "run") == 2
        complaint = capsys.readouterr().err
        assert key in complaint
        assert len(complaint) < 2100


def test_unknown_key_in_a_settings_file_is_named(here, capsys):
    Path("settings.toml").write_text("[settings]\nseed = 3\n[settings.filter.match]\nhit_sigm = 0.1\n")
    assert_refused(capsys, "hit_sigm", "run", "office", "--config", "settings.toml")


def test_a_full_disk_is_one_line_and_no_run_looks_finished(here, capsys, monkeypatch):
    room_log(here / "room.log")

    def full(self: RunDirectory, name: str, *_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(self.path / name))

    monkeypatch.setattr(RunDirectory, "write_map", full)
    assert call("slam", "room.log", "--out", "run") == 2
    assert "map: no space left on the disk" in capsys.readouterr().err
    assert json.loads(Path("run/metrics.json").read_text())["outcome"] == "failed"


@pytest.fixture(scope="module")
def mapped(tmp_path_factory) -> Path:
    """A folder with room.log and the run `a` that `testbed slam` made of it."""
    folder = tmp_path_factory.mktemp("mapped")
    room_log(folder / "room.log")
    with undrawn():
        assert call("slam", folder / "room.log", "--particles", "3", "--seed", "7", "--out", folder / "a") == 0
    return folder


KILLED_WHILE_THE_REPORT_IS_WRITTEN = """
import os, pathlib, sys
write = pathlib.Path.write_text
def write_half(self, text, **settings):
    if "report.html" in self.name:
        write(self, text[:1000], **settings)
        os.kill(os.getpid(), 9)
    return write(self, text, **settings)
pathlib.Path.write_text = write_half
from testbed.cli import main
main(["slam", "room.log", "--particles", "3", "--out", "run"])
"""


@pytest.mark.slow
def test_a_run_killed_during_its_report_gets_it_later(here, capsys):
    room_log(here / "room.log")
    killed = subprocess.run(
        [sys.executable, "-c", KILLED_WHILE_THE_REPORT_IS_WRITTEN], capture_output=True, check=False
    )
    assert killed.returncode == -signal.SIGKILL
    assert not Path("run/report.html").exists()
    assert len(list(Path("run").glob(".report.html.*"))) == 1
    assert call("report", "run") == 0
    assert "run had no report" in capsys.readouterr().err
    assert "</html>" in Path("run/report.html").read_text()
    assert not list(Path("run").glob(".report.html.*"))
    assert call("report", "run") == 0
    assert "had no report" not in capsys.readouterr().err


def metrics_of(run: Path) -> dict:
    return json.loads((run / "metrics.json").read_text())


def test_slam_writes_a_whole_run(mapped):
    metrics = metrics_of(mapped / "a")
    assert (metrics["outcome"], metrics["seed"], metrics["particles"], metrics["scans"]) == ("ok", 7, 3, 5)
    assert metrics["trajectory"]["ate_rmse_m"] < 0.02
    absent = {"truth_map.pgm", "truth_map.yaml", "commands.csv"}  # nobody knows them of a log
    absent.add("finding.json")  # less than a metre of path: no stretch to judge
    absent.add("program.log")  # no program was run
    assert {path.name for path in (mapped / "a").iterdir()} == set(RUN_FILES) - absent


def test_the_config_of_a_run_repeats_it_bit_by_bit(here, mapped, capsys):
    assert call("slam", "--config", mapped / "a" / "config.toml", "--out", "b") == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"report: {here / 'b' / 'report.html'}"
    assert metrics_of(here / "b")["result_hash"] == metrics_of(mapped / "a")["result_hash"]


def test_the_classic_settings_have_a_name_and_what_is_typed_wins(here, mapped):
    assert (
        call("slam", room_log(here / "room.clf"), "--config", "gmapping", "--particles", "3", "--out", "classic") == 0
    )
    settings = tomllib.loads(Path("classic/config.toml").read_text())["settings"]
    assert settings["filter"]["proposal"]["kind"] == "scan-match"
    assert settings["filter"]["motion"]["translation_from_rotation"] == 0.2
    assert settings["filter"]["particles"] == 3
    assert not Path("classic/filter.tum").exists()  # no final pass


def test_options_win_over_the_config_file(here, mapped):
    lines = (mapped / "room.log").read_text().splitlines()
    bare = [line for line in lines if not line.startswith("TRUEPOS") and "SHA-256" not in line]
    Path("bare.log").write_text("\n".join(bare))
    given = ["--truth", mapped / "a" / "truth.tum", "--seed", "8", "--log", "bare.log"]
    assert call("slam", "--config", mapped / "a" / "config.toml", *given, "--out", "c") == 0
    other, own = metrics_of(here / "c"), metrics_of(mapped / "a")
    assert other["seed"] == 8
    assert other["result_hash"] != own["result_hash"]
    assert other["trajectory"]["poses"] == own["trajectory"]["poses"] == 5


def test_score_gives_a_run_its_own_figures(here, mapped):
    assert call("score", mapped / "a", "--trajectory", mapped / "a" / "estimate.tum", "--out", "scored") == 0
    scored, own = metrics_of(here / "scored"), metrics_of(mapped / "a")
    assert scored["trajectory"]["ate_rmse_m"] == pytest.approx(own["trajectory"]["ate_rmse_m"])


def test_a_broken_limit_is_exit_status_1(mapped, capsys):
    score = ["score", mapped / "a", "--trajectory", mapped / "a" / "estimate.tum", "--fail-if"]
    assert call(*score, "trajectory.ate_rmse_m > 1") == 0
    assert call(*score, "trajectory.ate_rmse_m > 0") == 1
    assert "trajectory.ate_rmse_m > 0" in capsys.readouterr().err


def test_convert_keeps_the_frames(here):
    room_log(here / "room.log")
    assert call("convert", "room.log", "again.log.gz", "--to", "carmen") == 0
    assert gzip.decompress(Path("again.log.gz").read_bytes()) == Path("room.log").read_bytes()


def test_convert_to_a_bag_and_back_keeps_odometry_and_stamps(here):
    frames = open_log(room_log(here / "room.log")).frames
    assert call("convert", "room.log", "bag", "--to", "rosbag2") == 0
    assert call("convert", "bag", "again.log", "--to", "carmen") == 0
    again = open_log(here / "again.log").frames
    assert [frame.stamp for frame in again] == [frame.stamp for frame in frames]
    for got, put in zip(again, frames, strict=True):
        np.testing.assert_allclose(got.odometry, put.odometry, atol=1e-12)
        np.testing.assert_allclose(got.scan.ranges, put.scan.ranges, rtol=1e-7)  # float32 in the bag


def test_worlds_list_names_the_catalogue(here, capsys):
    assert call("worlds", "list") == 0
    out = capsys.readouterr().out
    assert all(name in out for name in catalogue())


def test_worlds_show_draws_a_picture(here, capsys):
    assert call("worlds", "show", "office", "--out", "office.png") == 0
    assert Path("office.png").read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert_refused(capsys, "exists", "worlds", "show", "office", "--out", "office.png")


def test_a_generated_world_can_be_driven(here, capsys):
    assert call("worlds", "generate", "maze", "--size", "10", "8", "--seed", "7", "--out", "maze.toml") == 0
    assert call("simulate", "maze.toml", "--duration", "1", "--out", "datasets") == 0
    assert open_log(here / "datasets" / "maze-0000").scan_count > 5
    capsys.readouterr()
    assert_refused(capsys, "exists", "worlds", "generate", "maze", "--out", "maze.toml")
    assert_refused(capsys, 'Choose from: "rooms"', "worlds", "generate", "moon", "--out", "moon.toml")


def test_a_floor_plan_becomes_a_world_that_can_be_driven(here):
    assert call("simulate", "loop", "--duration", "0.5", "--out", "datasets") == 0
    assert call("worlds", "import", here / "datasets" / "loop-0000" / "truth_map.yaml", "--out", "plan.toml") == 0
    assert load("plan.toml").boundary_segments().shape[0] > 10
    plan = here / "datasets" / "loop-0000" / "truth_map.yaml"  # without a step between, too
    assert call("simulate", plan, "--duration", "1", "--out", "driven") == 0
    assert open_log(here / "driven" / "truth_map-0000").scan_count > 5


# --- as a program of its own ------------------------------------------------------------------------------------------

HEAVY = ("numpy", "numba", "pybullet", "rerun", "matplotlib", "pydantic", "pyarrow", "scipy")


def test_help_loads_nothing_heavy(here):
    """What makes `testbed --help` answer in under 0.5 s."""
    code = (
        "import sys, testbed.cli\n"
        "try: testbed.cli.main(['--help'])\n"
        f"finally: print([name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "run" in done.stdout


@pytest.mark.parametrize("command", ["run", "slam", "simulate", "twin", "sweep", "stress"])
def test_the_whole_help_has_every_setting_and_the_short_one_says_how_many_more(command, capsys):
    """Options in groups, such as --filter.match.hit-sigma, and those of clusters and publishers are what few touch."""
    call(command, "--help")
    short = capsys.readouterr().out
    call(command, "--help-all")
    whole = capsys.readouterr().out
    more = re.findall(r"--help-all +Shows (?:the )?(\d+) (?:more )?settings", short)
    assert more
    assert "--help-all" not in whole
    # a setting begins in the first column of a panel; its --no- form and its parts continue there, indented
    option = re.compile(r"^│ (?:   )?(--[a-z.-]+)", flags=re.MULTILINE)
    settings = option.findall(whole)
    shown = [name for name in option.findall(short) if name != "--help-all"]
    assert len(settings) - len(shown) == sum(map(int, more))
    assert len(short.splitlines()) <= 90


def test_the_help_has_the_names_that_users_type_and_ends_with_no_other_command(capsys):
    """The first steps stand below the list of commands only; `simulate` offers no driver that it refuses."""
    call("simulate", "--help")
    simulate = capsys.readouterr().out
    call("run", "--help")
    run = capsys.readouterr().out
    call("--help")
    commands = capsys.readouterr().out
    assert "--driver CHOICE" in run
    assert "--driver.kind" not in run
    assert "teleop" in run
    assert "teleop" not in simulate
    assert ["--demo" in text for text in (run, simulate, commands)] == [False, False, True]
    assert "[default: ()]" not in simulate + run


def test_the_settings_of_the_final_pass_are_told_from_those_of_the_filter():
    wide = os.environ | {"COLUMNS": "200"}  # read once in a process
    done = subprocess.run([*TESTBED, "slam", "--help-all"], capture_output=True, text=True, env=wide, check=True)
    helped = " ".join(done.stdout.split())
    assert "--filter.motion.floor-rotation FLOAT Error of heading" in helped
    assert "--filter.refine.motion.floor-rotation FLOAT Final pass: error of heading" in helped
    assert helped.count("Final pass: ") == helped.count("--filter.refine.motion.")


def test_the_help_of_view_shows_how_to_do_without_a_display(capsys):
    """The page of `run` leaves it out, as what few need."""
    for command, shown in (("view", True), ("run", False)):
        call(command, "--help")
        assert (" --serve " in capsys.readouterr().out) is shown


@pytest.mark.parametrize("command", HELP)
def test_each_help_begins_with_what_a_person_wants_and_an_example(command, capsys):
    """On a terminal of 80 columns the example is among the first lines."""
    call(command, "--help")
    usage, _, summary, *rest = capsys.readouterr().out.splitlines()
    assert usage.startswith(f"Usage: testbed {command}")
    assert re.match("[A-Z][a-z]+[ ,]", summary)
    assert any(line.startswith(" testbed ") for line in rest[:6])


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_a_signal_ends_a_run_soon_and_keeps_what_was_there(here, number):
    run = subprocess.Popen([*TESTBED, "run", "office", "--out", "run"], stderr=subprocess.PIPE, text=True)
    recording = here / "run" / "recording.rrd"
    deadline = time.monotonic() + 120
    while not (recording.exists() and recording.stat().st_size > 300_000):  # some seconds of driving
        assert time.monotonic() < deadline
        assert run.poll() is None
        time.sleep(0.05)
    run.send_signal(number)
    _, errors = run.communicate(timeout=15)  # 2 s on a machine at rest; the run would take 40
    assert run.returncode == 130
    assert "Traceback" not in errors
    assert json.loads((here / "run" / "metrics.json").read_text())["outcome"] == "interrupted"
    for name in ("config.toml", "estimate.tum", "map.pgm", "steps.parquet"):
        assert (here / "run" / name).stat().st_size > 0


def test_an_imported_maps_image_is_hashed_too(tmp_path):
    rows = ["P2", "4 3", "255", *(" ".join(["254"] * 4) for _ in range(3))]
    (tmp_path / "floor.pgm").write_text("\n".join(rows))
    (tmp_path / "floor.yaml").write_text("image: floor.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    named = SimulatorOptions().files(str(tmp_path / "floor.yaml"))
    assert [path.name for path in named] == ["floor.yaml", "floor.pgm"]
    assert SimulatorOptions().files("office") == []


def test_presets_are_listed_shown_and_driven_round_the_square(capsys):
    assert call("presets", "list") == 0
    listed = capsys.readouterr().out
    assert "create3" in listed
    assert "rplidar_a2" in listed
    assert call("presets", "show", "lds01") == 0
    assert "ROBOTIS e-Manual" in capsys.readouterr().out
    assert call("presets", "umbmark", "burger", "--runs", "3") == 0
    good, typical, poor = map(float, capsys.readouterr().out.split()[-3:])
    assert good < typical < poor
    assert call("presets", "umbmark", "burger", "--runs", "0") == 2


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(b"dr\xc3\xbcben", marks=pytest.mark.slow, id="umlaut"),
        pytest.param(b"x\xffy", marks=pytest.mark.slow, id="no UTF-8"),
    ],
)
def test_any_file_name_works_under_an_ascii_locale(tmp_path, name):
    folder = tmp_path / os.fsdecode(name)
    folder.mkdir()
    room_log(folder / "room.log")
    ascii_locale = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    words = ["slam", folder / "room.log", "--particles", "2", "--out", folder / "run"]
    done = subprocess.run([*TESTBED, *words], capture_output=True, env=os.environ | ascii_locale, check=False)
    assert done.returncode == 0, done.stderr
    assert tomllib.loads((folder / "run" / "config.toml").read_text(encoding="utf-8"))
    assert json.loads((folder / "run" / "metrics.json").read_text(encoding="utf-8"))["outcome"] == "ok"
