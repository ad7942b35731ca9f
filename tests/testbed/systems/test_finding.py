# SPDX-License-Identifier: MIT
"""Systems by name, by entry point and by file; their settings; what is said where that fails."""

from importlib.metadata import EntryPoint

import pytest

from slam.config import FilterConfig
from testbed.systems import finding
from testbed.systems.errors import SystemsError
from testbed.systems.finding import (
    BUILT_IN,
    BUILT_IN_PROGRAMS,
    BuiltIn,
    file_of,
    find_system,
    listed,
    make_system,
    settings_of,
    short_name,
)

SOURCE = """
from dataclasses import dataclass
import helper

@dataclass(frozen=True)
class Settings:
    gain: float = helper.GAIN
    mode: str = "fast"

class Mine:
    name, version = "mine", "3"
    def __init__(self, settings=None):
        self.settings = settings or Settings()
    def start(self, lidars, seed): pass
    def process(self, frame): return None
    def finish(self): return None, None

class Plain(Mine):
    def __init__(self): pass

class Half:
    name, version = "half", "1"
    def start(self, lidars, seed): pass

class Stillborn(Mine):
    def __init__(self): raise RuntimeError("no licence")

value = 3
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "helper.py").write_text("GAIN = 0.5\n")
    (tmp_path / "mine.py").write_text(SOURCE)
    return tmp_path / "mine.py"


def test_a_class_in_a_file_is_found_with_its_neighbours(file):
    system = make_system(f"{file}:Mine")
    assert (system.name, system.version) == ("mine", "3")
    assert settings_of(system) == {"gain": 0.5, "mode": "fast"}
    assert short_name(f"{file}:Mine") == "Mine"
    assert file_of(f"{file}:Mine") == file
    assert file_of("gmapping") is None


def test_settings_are_converted_and_checked(file):
    assert settings_of(make_system(f"{file}:Mine", {"gain": "0.25"})) == {"gain": 0.25, "mode": "fast"}
    with pytest.raises(SystemsError, match=r"Mine.gain = much: Input should be a valid number"):
        make_system(f"{file}:Mine", {"gain": "much"})
    with pytest.raises(SystemsError, match=r"Mine.gian: no such setting, expected one of gain, mode"):
        make_system(f"{file}:Mine", {"gian": "1"})
    with pytest.raises(SystemsError, match=r"Plain: has no settings, expected no gain"):
        make_system(f"{file}:Plain", {"gain": "1"})


def test_settings_within_settings_have_dotted_names():
    system = make_system("gmapping", {"filter.match.hit_sigma": "0.07", "refine": "false"})
    assert system.settings.filter.match.hit_sigma == 0.07
    assert system.settings.refine is False
    with pytest.raises(SystemsError, match=r"gmapping.filter.particles = 0: FilterConfig.particles must be at least 1"):
        make_system("gmapping", {"filter.particles": "0"})
    with pytest.raises(SystemsError, match=r"refine holds no further settings"):
        make_system("gmapping", {"refine.more": "1"})


def test_a_plain_scan_matcher_has_one_particle_whatever_is_set():
    config = make_system("scan-matching", {"filter": FilterConfig(particles=50)}).settings.filter
    assert (config.particles, config.proposal.kind, config.adapt.count) == (1, "scan-match", "fixed")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("gmaping", "system 'gmaping': unknown, expected one of gmapping, .* or FILE.py:CLASS"),
        ("nowhere.py:Mine", "no such file nowhere.py"),
        ("{file}:Yours", "no such class"),
        ("{file}:value", "no such class"),
        ("{file}:Half", "lacks process, finish: expected the protocol"),
        ("{file}:Stillborn", r"cannot be made: RuntimeError: no licence \(mine.py:26\)"),
    ],
)
def test_what_cannot_be_found_or_made_is_named(file, text, complaint):
    with pytest.raises(SystemsError, match=complaint):
        make_system(text.format(file=file))


def test_a_file_that_cannot_be_imported_is_named_with_its_line(tmp_path):
    (tmp_path / "broken.py").write_text("x = 1\ny = x + z\n")
    with pytest.raises(SystemsError, match=r"cannot be imported: NameError: .*\(broken.py:2\)"):
        find_system(f"{tmp_path}/broken.py:Mine")


def test_a_file_that_exits_when_it_is_imported_is_named(tmp_path):
    (tmp_path / "script.py").write_text("import sys\nsys.exit(2)\n")
    with pytest.raises(SystemsError, match=r"cannot be imported: SystemExit: 2 \(script.py:2\)"):
        find_system(f"{tmp_path}/script.py:Mine")


def test_systems_of_other_packages_are_found_by_entry_point(monkeypatch):
    points = [
        EntryPoint("theirs", "testbed.systems.odometry:OdometrySystem", finding.GROUP),
        EntryPoint("gone", "nowhere_at_all:Gone", finding.GROUP),
    ]
    monkeypatch.setattr(finding, "entry_points", lambda group: points if group == finding.GROUP else [])
    assert make_system("theirs").name == "odometry"
    assert [system.name for system in listed()] == [*BUILT_IN, *BUILT_IN_PROGRAMS, "theirs", "gone"]
    with pytest.raises(SystemsError, match="gone: cannot be loaded: ModuleNotFoundError"):
        find_system("gone")


def test_a_system_whose_package_is_missing_says_how_to_get_it(monkeypatch):
    entry = BuiltIn("testbed.systems.absent:Absent", "x", modules=("nowhere_at_all",), extra="absent")
    monkeypatch.setitem(BUILT_IN, "absent", entry)
    with pytest.raises(SystemsError, match=r"absent: needs nowhere_at_all: pip install 'slam-testbed\[absent\]'"):
        find_system("absent")
    assert next(s.missing for s in listed() if s.name == "absent") == "pip install 'slam-testbed[absent]'"


def test_a_command_in_the_place_of_a_class_says_where_it_belongs():
    with pytest.raises(SystemsError, match="is a command, which has no class: expected it after --system-command"):
        find_system("./prog.sh {dataset} {out}")
