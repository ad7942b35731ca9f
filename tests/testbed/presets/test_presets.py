# SPDX-License-Identifier: MIT
"""Presets: every number has a source, and wrong files get one clear line."""

import math
import re

import numpy as np
import pytest

from testbed.presets import LidarPreset, PresetError, lidars, load_lidar, load_robot, robots
from testbed.seeds import RunSeeds
from testbed.simulation.physics.backend import STEP_RATE, AccelerationLimits
from testbed.simulation.robot.umbmark import umbmark
from tests.shell import call
from tests.testbed.simulation.small_worlds import room

ROBOT = """
name = "mine"
title = "My robot"
wheel_radius = 0.05
track = 0.3
length = 0.4
width = 0.35
height = 0.2
mass = 5.0
max_speed = 0.5
max_turn_rate = 2.0
max_acceleration = 0.5
max_turn_acceleration = 2.0
ticks_per_turn = 1000
lidar_mount = { x = 0.1, height = 0.3 }

[sources]
wheel_radius = "measured"
track = "measured"
length = "measured"
width = "measured"
height = "measured"
mass = "measured"
max_speed = "assumed"
max_turn_rate = "assumed"
max_acceleration = "assumed"
max_turn_acceleration = "assumed"
ticks_per_turn = "data sheet"
lidar_mount = "measured"
"""


def test_the_promised_devices_are_there():
    assert set(robots()) >= {"burger", "waffle_pi", "create3", "pioneer3dx", "dingo_d"}
    assert set(lidars()) >= {
        "lds01", "lds02", "rplidar_a1", "urg04lx", "utm30lx", "ust10lx", "lms200", "tim571"
    }  # fmt: skip


@pytest.mark.parametrize("name", lidars())
def test_lidars_have_sane_angles_and_times(name):
    lidar = load_lidar(name)
    angles = lidar.angles()
    assert lidar.name == name
    assert len(angles) == lidar.beams
    assert np.all(np.diff(angles) > 0)
    assert angles[0] == pytest.approx(-math.radians(lidar.field_of_view_deg) / 2)
    if lidar.field_of_view_deg < 360.0:
        assert angles[-1] == pytest.approx(-angles[0])
    assert lidar.sweep_time <= 1.0 / lidar.scan_rate


@pytest.mark.parametrize("name", robots())
def test_every_robot_drives_straight_and_turns_true_in_pybullet(name):
    pytest.importorskip("pybullet")
    module = pytest.importorskip("testbed.simulation.physics.pybullet")
    robot = load_robot(name)
    speed, turn_rate = 0.9 * robot.max_speed, min(0.5, robot.max_turn_rate)
    backend = module.PyBulletBackend(room(half=30.0), robot, AccelerationLimits(0.3, 2.0))
    straight = backend.drive(speed, 0.0, 10 * STEP_RATE).poses[-1]
    backend.drive(0.0, 0.0, 5 * STEP_RATE)
    backend.drive(0.0, turn_rate, 2 * STEP_RATE)
    turn = backend.drive(0.0, turn_rate, 5 * STEP_RATE).poses
    backend.close()
    assert straight[0] == pytest.approx(speed * 10.0 - 0.5 * speed**2 / 0.3, rel=0.01)
    assert abs(straight[1]) < 0.01 * straight[0]
    assert (turn[-1, 2] - turn[0, 2]) * STEP_RATE / (len(turn) - 1) == pytest.approx(turn_rate, rel=0.005)


@pytest.mark.parametrize("name", ["burger", "create3"])
def test_umbmark_errors_grow_with_the_grade(name):
    errors = {
        grade: umbmark(load_robot(name), grade, seeds=RunSeeds.from_seed(0), runs=15).return_error
        for grade in ("good", "typical", "poor")
    }
    assert errors["good"] < errors["typical"] < errors["poor"]
    assert 0.1 < errors["typical"] < 1.5


def test_a_users_own_file_works_the_same_way(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(ROBOT)
    assert load_robot(path).footprint_radius == pytest.approx(math.hypot(0.2, 0.175))


def test_one_source_serves_all_values(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    head = ROBOT.split("[sources]", maxsplit=1)[0].replace(
        'name = "mine"', 'name = "mine"\nsource = "measured by hand"'
    )
    path.write_text(head)
    assert load_robot(path).source_of == dict.fromkeys(load_robot(path).source_of, "measured by hand")
    assert {"track", "lidar_mount"} < load_robot(path).source_of.keys()
    path.write_text(head + '[sources]\ntrack = "data sheet"')
    assert load_robot(path).source_of["track"] == "data sheet"
    assert load_robot(path).source_of["mass"] == "measured by hand"
    assert call("presets", "show", path) == 0
    assert "measured by hand" in capsys.readouterr().out
    path.write_text(head.replace("measured by hand", " "))
    with pytest.raises(PresetError, match=r"sources lacks .*mass.*`source = "):
        load_robot(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('track = "measured"\n', "", "sources lacks track"),
        ("track = 0.3\n", "", "track is missing"),
        ("track = 0.3", "trakc = 0.3", "trakc is not known, expected 'track'"),
        ("track = 0.3", "track = -0.3", "track = -0.3: expected greater than 0"),
        ("track = 0.3", "track = inf", "track = inf"),
        ("[sources]", '[sources]\ncolour = "red"', "sources names colour"),
        ('name = "mine"', "name = ", "expected TOML"),
        ('name = "mine"', 'name = "../mine"', "name = '../mine': expected a name of 1 to 100 letters"),
    ],
)
def test_bad_files_are_explained_in_one_line(tmp_path, old, new, message):
    path = tmp_path / "mine.toml"
    path.write_text(ROBOT.replace(old, new, 1))
    with pytest.raises(PresetError) as caught:
        load_robot(path)
    assert message in str(caught.value)
    assert "mine.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("preset", [*map(load_lidar, lidars()), *map(load_robot, robots())], ids=lambda p: p.name)
def test_an_estimate_has_a_reason_and_says_what_it_changes(preset):
    """estimated: REASON; WHAT A WRONG VALUE WOULD CHANGE."""
    estimated = {key: source for key, source in preset.sources.items() if "estimated" in source or "assumed" in source}
    assert [
        key for key, source in estimated.items() if not re.match(r"estimated(:| from) .{10,}; .{20,}", source)
    ] == []


def test_unknown_names_get_the_nearest_ones(tmp_path):
    with pytest.raises(PresetError, match=r"unknown robot 'creat3'.*create3"):
        load_robot("creat3")
    with pytest.raises(PresetError, match=r"unknown lidar 'utm30'.*utm30lx"):
        load_lidar("utm30")
    with pytest.raises(PresetError, match="No such file"):
        load_lidar(tmp_path / "gone.toml")


def test_times_of_scans_that_do_not_increase_are_refused():
    document = load_lidar("lds01").model_dump(exclude_unset=True)
    sources = document["sources"] | {"scan_times": "a log"}
    LidarPreset.model_validate(document | {"scan_times": [0.0, 0.5, 0.6], "sources": sources})
    for times in ([0.5, 0.5], [0.5, 0.4], [0.0, math.inf]):
        with pytest.raises(ValueError, match="expected increasing times"):
            LidarPreset.model_validate(document | {"scan_times": times, "sources": sources})


@pytest.mark.parametrize("degrees", [360.0, 359.9999, 359.999998])
def test_a_full_turn_has_no_direction_twice(degrees):
    """Also where the number was rounded or measured, as `testbed twin` does."""
    lidar = load_lidar("lds01").model_copy(update={"field_of_view_deg": degrees})
    steps = np.diff(lidar.angles(), append=lidar.angles()[0] + 2.0 * math.pi)
    np.testing.assert_allclose(steps, 2.0 * math.pi / lidar.beams, atol=1e-5)
    assert not lidar.model_copy(update={"field_of_view_deg": 359.0}).is_full_turn
