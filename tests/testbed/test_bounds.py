# SPDX-License-Identifier: MIT
"""Numbers that would take gigabytes or days are refused where they enter, with the number and the limit."""

from dataclasses import replace

import pytest

from slam.config import FilterConfig, LocalizationConfig, MotionConfig
from slam.config.filter import AdaptConfig, MapConfig, MatchConfig, ProposalConfig
from slam.config.refinement import RefineConfig
from testbed.cli import main
from testbed.formats import Log, LogError, open_log
from testbed.formats.write import write_log
from testbed.frame_table import FrameTable
from testbed.presets import load_lidar, load_robot
from testbed.presets.models import LidarPreset, RobotPreset
from testbed.simulation import SimulationConfig
from tests.testbed.recordings import SUFFIX, two_lidar_drive
from worlds.world import Tour


@pytest.mark.parametrize(
    ("kind", "name", "value", "limit"),
    [
        (FilterConfig, "particles", 10**9, "1,000,000"),
        (AdaptConfig, "max_particles", 10**9, "1,000,000"),
        (ProposalConfig, "samples", 10**9, "100,000"),
        (MatchConfig, "iterations", 10**9, "100,000"),
        (MatchConfig, "coarse_beams", 10**9, "100,000"),
        (MatchConfig, "search_step", 1e-8, "100,000 steps"),
        (MatchConfig, "search_reach", 1e12, "100,000 steps"),
        (MatchConfig, "hit_sigma", 1e-300, "1e-09"),
        (MatchConfig, "beam_weight", 1e308, "1e+09"),
        (MatchConfig, "weight_share", float("inf"), "1,000,000,000"),
        (MapConfig, "field_radius", float("inf"), "1e+09"),
        (MapConfig, "occupied_share", 1.0, "below 1"),
        (MotionConfig, "jump_along", 1e-300, "1e-09"),
        (LocalizationConfig, "max_search_poses", 10**9, "10,000,000"),
        (LocalizationConfig, "max_candidates", 10**9, "10,000,000"),
        (RefineConfig, "rounds", 10**9, "1,000"),
        (RefineConfig, "max_points", 10**9, "100,000,000"),
        (SimulationConfig, "duration", 1e300, "10,000,000 s"),
        (SimulationConfig, "duration", float("inf"), "10,000,000 s"),
    ],
)
def test_a_setting_has_a_largest_value(kind, name, value, limit):
    with pytest.raises(ValueError, match=name) as raised:
        kind(**{name: value})
    message = str(raised.value)
    assert limit in message
    assert any(text in message for text in (f"{value:g}", f"{value}"))
    assert "\n" not in message


def test_a_number_of_400_digits_is_refused_with_its_first_ones():
    with pytest.raises(ValueError, match=r"particles must be at most 1,000,000, got 10{29}… \(401 digits\)$"):
        FilterConfig(particles=10**400)


def test_walls_may_be_used_at_any_range():
    assert MapConfig(usable_range=float("inf")).usable_range > 0.0
    with pytest.raises(ValueError, match="usable_range must be positive"):
        MapConfig(usable_range=0.0)


@pytest.mark.parametrize("name", ["odometry", "truth"])
@pytest.mark.parametrize("column", range(3))
def test_a_pose_is_on_earth(tmp_path, name, column):
    log = two_lidar_drive()
    poses = getattr(log.table, name).copy()
    poses[2, column] = -1e300
    write_log(tmp_path / "drive", replace(log, table=replace(log.table, **{name: poses})), "parquet")
    with pytest.raises(LogError, match=rf"drive: frame 3: {name} .*-1e\+300.*expected numbers of at most 1e\+08"):
        open_log(tmp_path / "drive")


def test_a_tour_is_bounded_with_all_its_laps():
    points = [(0.001 * k, 0.0) for k in range(99_000)]
    Tour(points=points, closed=True)
    with pytest.raises(ValueError, match=r"1000 laps of 99000 way points are 99,000,000, expected at most 100,000"):
        Tour(points=points, closed=True, laps=1000)


@pytest.mark.parametrize(
    ("preset", "key", "limit"),
    [
        (load_robot("create3"), "length", "100"),
        (load_robot("create3"), "wheel_radius", "100"),
        (load_lidar("rplidar_a2"), "range_max", "100000"),
        (load_lidar("rplidar_a2"), "scan_rate", "10000"),
        (load_lidar("rplidar_a2"), "beams", "100000"),
    ],
)
def test_a_device_has_the_size_of_a_device(preset, key, limit):
    model: type[RobotPreset | LidarPreset] = type(preset)
    value = 10**9 if key == "beams" else 1e9
    with pytest.raises(ValueError, match=f"(?s){key}.*less than or equal to {limit}"):
        model.model_validate(preset.model_dump(exclude_unset=True) | {key: value})


def test_a_number_of_datasets_is_bounded(capsys, tmp_path):
    with pytest.raises(SystemExit) as ended:
        main(["simulate", "loop", "--count", "1000000000", "--out", str(tmp_path / "out")])
    assert ended.value.code == 2
    assert "at most 100,000 datasets of each world, got 1,000,000,000" in capsys.readouterr().err


@pytest.mark.parametrize("log_format", ["rosbag2-lean", "rosbag2-sqlite", "rosbag1", "parquet"])
def test_a_lidar_far_from_the_robot_is_refused(tmp_path, log_format):
    path = tmp_path / f"far{SUFFIX.get(log_format, '')}"
    write_log(path, far_lidar(two_lidar_drive(), 1e6), log_format)
    with pytest.raises(LogError, match=r"mounted at 1e\+06, 0 m, expected within 100 m of the robot") as raised:
        open_log(path)
    assert str(raised.value).startswith(str(path))


def test_a_laser_far_away_in_a_carmen_log_is_refused_by_its_line(tmp_path):
    write_log(tmp_path / "drive.log", far_lidar(two_lidar_drive(), 1e6), "carmen")
    with pytest.raises(LogError, match=r"drive\.log:\d+: .*laser 1e\+06, \S+ m from the robot, expected within 100 m"):
        open_log(tmp_path / "drive.log")


def test_a_laser_offset_is_bounded_too(tmp_path):
    log = tmp_path / "drive.log"
    log.write_text(f"FLASER 181 {'1.5 ' * 181}0 0 0 0 0 0 0.5 host 0.5\n")
    assert open_log(log, laser_offset=0.1).scan_count == 1
    with pytest.raises(LogError, match=r"drive\.log: laser 1e\+06 m along x from the robot, expected within 100 m"):
        open_log(log, laser_offset=1e6)


def far_lidar(log: Log, distance: float) -> Log:
    table: FrameTable = log.table
    mounts = table.mounts.copy()
    mounts[:, 0], mounts[:, 1] = distance, 0.0
    return replace(log, table=replace(table, mounts=mounts))
