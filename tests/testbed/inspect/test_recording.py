# SPDX-License-Identifier: MIT
"""What is found in a recording: nothing in a sound one, and each fault in one that has it."""

import json
import math
import os
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from testbed.formats import Log, open_log
from testbed.formats.write import write_log
from testbed.frame_table import BeamPattern
from testbed.inspect import Reading, inspect_log, lidars, notes_of, time_offset
from testbed.inspect.time_offset import shifted, without_time_offset
from testbed.inspect.turns import compare_turns
from testbed.presets import load_lidar
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from tests.shell import assert_refused, call
from worlds import load

DATASETS = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).parents[4] / "shared" / "datasets"))
INTEL = DATASETS / "intel" / "intel-merged.clf.gz"


@lru_cache(maxsize=4)
def drive(world="office", seconds=40.0, seed=4, lidar="rplidar_a2"):
    seeds = RunSeeds.from_seed(seed)
    config = SimulationConfig(backend="fast", duration=seconds, seeds=seeds, lidar=load_lidar(lidar))
    return Log.from_frames(list(simulate(load(world), config)), path=Path("drive"), format="simulation")


@pytest.fixture(scope="module")
def log():
    return drive()


def with_table(log, **changes):
    return replace(log, table=replace(log.table, **changes))


def doubts(log):
    return {finding.item: finding for finding in inspect_log(log) if finding.verdict == "doubtful"}


@pytest.mark.parametrize(("world", "lidar"), [("office", "lds01"), ("loop", "rplidar_a2"), ("apartment", "tim571")])
def test_a_sound_recording_is_not_doubted(world, lidar):
    log = drive(world, lidar=lidar)
    assert doubts(log) == {}
    assert notes_of(inspect_log(log)) == []


@pytest.mark.parametrize(("limits", "words"), [((0.2, 2.0), "farther than the largest"), ((1.5, 12.0), "nearer than")])
def test_readings_beyond_the_limits_are_doubted(log, limits, words):
    """A lidar whose limits are stated wrongly: half of what it measures would be left out without a word."""
    table = log.table
    stated = with_table(log, range_limits=np.tile(limits, (len(table.scan_rows), 1)))
    (doubt,) = doubts(stated).values()
    assert doubt.item.startswith("limits of ")
    assert words in doubt.found


@pytest.mark.parametrize(("change", "words"), [(1000.0, "e+03 m for each m"), (0.0, "0 m for each m")])
def test_truth_that_goes_another_way_than_the_robot_is_doubted(log, change, words):
    """In millimetres, or of an object that stands."""
    (doubt,) = doubts(with_table(log, truth=log.table.truth * [change, change, 1.0])).values()
    assert doubt.item == "truth"
    assert words in doubt.found


def test_one_value_beyond_the_limits_is_a_drivers_way_to_say_nothing(log):
    ranges = np.where(np.isfinite(log.table.ranges) & (log.table.ranges < 3.0), log.table.ranges, 16.383)
    limits = np.tile((0.2, 3.0), (len(log.table.scan_rows), 1))
    assert doubts(with_table(log, ranges=ranges, range_limits=limits)) == {}


def test_numbers_are_those_of_the_recording(log):
    found = {finding.item: finding.found for finding in inspect_log(log)}
    assert found["frames"] == "800, 400 of them with a scan, over 40.0 s"
    assert found["rate of laser"] == "400 scans, 10.00 Hz"
    assert found["mount of laser"].startswith("(-0.040, +0.000) m, +0.0 deg")
    assert "800 beams over 360 deg, every 0.45 deg, taken within 0.100 s; hits from 0.2 m to 12 m" in found.values()
    length = np.hypot(*np.diff(log.table.odometry[:, :2], axis=0).T).sum()
    assert found["odometry"].startswith(f"{length:.1f} m")


def test_a_gap_in_which_the_robot_moves(log):
    table = log.table
    kept = (table.stamps < 10.0) | (table.stamps > 14.0)
    gap = replace(log, table=without_rows(table, kept))
    assert "1 gap without scans, the longest 4.2 s" in doubts(gap)["gaps of laser"].found
    still = se2.compose(table.odometry, np.zeros(3))
    still[:] = still[0]
    assert "gaps of laser" not in doubts(with_table(gap, odometry=still[kept]))


def without_rows(table, kept):
    scans = np.flatnonzero(kept[table.scan_rows])
    readings = [np.arange(table.scan_starts[k], table.scan_starts[k + 1]) for k in scans]
    return replace(
        table,
        **{name: getattr(table, name)[kept] for name in ("stamps", "odometry", "twist", "command", "truth")},
        **{name: getattr(table, name)[scans] for name in ("scan_lidars", "scan_patterns", "range_limits", "mounts")},
        scan_rows=(np.cumsum(kept) - 1)[table.scan_rows[scans]],
        scan_starts=np.concatenate([[0], np.cumsum(table.readings[scans])]),
        ranges=table.ranges[np.concatenate(readings)],
    )


def test_scans_that_repeat_while_the_robot_moves(log):
    ranges = log.table.ranges.copy().reshape(400, 800)
    ranges[200:300] = ranges[200]
    assert "repeat the one before" in doubts(with_table(log, ranges=ranges.reshape(-1)))["scans of laser"].found


def test_a_value_for_no_return_that_counts_as_a_hit(log):
    ranges = log.table.ranges.copy()
    ranges[::10] = 11.9
    found = doubts(with_table(log, ranges=ranges))["no return of laser"]
    assert "11.9 m" in found.found
    assert found.action.endswith("--range-max 11.9 makes them no returns")


@pytest.mark.parametrize(
    ("chosen", "words"), [(slice(350, 450), "a view of less than"), (slice(0, 800, 40), "fewer than")]
)
def test_a_sensor_that_sees_too_little(log, chosen, words):
    pattern = log.table.patterns[0]
    few = BeamPattern(angles=pattern.angles[chosen], time_offsets=None)
    ranges = log.table.ranges.reshape(400, 800)[:, chosen]
    starts = ranges.shape[1] * np.arange(401)
    small = with_table(log, patterns=(few,), ranges=ranges.reshape(-1), scan_starts=starts)
    assert words in doubts(small)["beams of laser"].found


def test_odometry_that_stands_still_or_jumps(log):
    still = np.zeros_like(log.table.odometry)
    assert doubts(with_table(log, odometry=still))["odometry"].found == "the pose never changes"
    jumping = log.table.odometry.copy()
    jumping[400:, 0] += 3.0
    (note,) = (note for note in notes_of(inspect_log(with_table(log, odometry=jumping))) if "jumps" in note)
    assert "1 jumps that no robot can make, the first at 20.0 s" in note


def test_odometry_of_two_programs_goes_to_and_fro(log):
    poses = log.table.odometry.copy()
    poses[1::2, 0] += 0.1
    assert "odometry's path" in doubts(with_table(log, odometry=poses))


def test_two_lidars_under_one_name_take_turns(log):
    table = log.table
    ranges = table.ranges.copy()
    for k in range(1, len(table.scan_rows), 2):
        seen = slice(table.scan_starts[k], table.scan_starts[k + 1])
        ranges[seen] = np.roll(ranges[seen], len(ranges[seen]) // 2)
    assert "views of laser" in doubts(with_table(log, ranges=ranges))


def test_a_recording_over_decades_takes_no_more_memory(log):
    stamps = log.table.stamps.copy()
    stamps[log.table.scan_rows[-1] :] = 2.0**31
    found = {finding.item: finding for finding in inspect_log(with_table(log, stamps=stamps))}
    assert float(found["odometry"].found.split()[-4]) < 0.6
    assert found["gaps of laser"].verdict == "ok"


def test_a_lidar_that_is_mirrored(log):
    pattern = log.table.patterns[0]
    mirrored = replace(pattern, angles=-pattern.angles)
    found = doubts(with_table(log, patterns=(mirrored,)))["turns"]
    assert found.found.startswith("scans turn -")
    assert "upside down" in found.action


@pytest.mark.parametrize("seed", [4, 5])
@pytest.mark.parametrize("late", [-0.3, 0.1, 0.15, 0.6])
def test_an_offset_of_the_clocks_is_estimated(late, seed):
    table = drive(seed=seed).table
    moved, _ = shifted(table, -late)
    clock = compare_turns(moved)
    assert abs(clock.offset - late) < 3.0 * clock.uncertainty
    assert clock.is_off
    assert not compare_turns(table).is_off


def test_sectors_of_a_scan_are_compared_by_their_own_times():
    """In 40 s without an offset; whole scans, by their mean time, are off by 2 to 5 ms here."""
    offsets = [compare_turns(drive(seed=seed).table).offset for seed in (4, 5, 6)]
    assert np.abs(offsets).max() < 0.0015


@pytest.mark.parametrize("world", ["museum", "symmetric"])
def test_scans_some_time_apart_show_the_clock(world):
    """Scans 0.1 s apart, whose turns hardly change with the clock, show offsets of 12 and 3 ms here."""
    assert abs(compare_turns(drive(world).table).offset) < 0.0025


def test_turns_that_do_not_follow_the_odometry_show_no_clock():
    """A drive straight ahead: the odometry turns by noise alone, and some offset fits that best."""
    clock = compare_turns(drive("nested_loops", seed=70).table)
    assert clock is None or not math.isfinite(clock.uncertainty)


def test_the_offset_is_estimated_again_where_it_is_off(log, monkeypatch):
    """The second estimate compares scans by the motion of their own time."""
    estimates = iter([0.2, 0.01])
    clock = compare_turns(log.table)
    monkeypatch.setattr(time_offset, "compare_turns", lambda table: clock._replace(offset=next(estimates)))
    assert "+0.210 ± " in without_time_offset(log, None).notes[-1]


def test_readings_that_were_looked_at_are_let_go_of(log, monkeypatch):
    forgotten = []
    monkeypatch.setattr(lidars, "forget_pages", lambda ranges: forgotten.append(ranges is log.table.ranges))
    assert doubts(log) == {}
    assert forgotten == [True] * (400 // lidars.LET_GO + lidars.TRIPLES)


@pytest.mark.skipif(not INTEL.is_file(), reason="needs the recorded log intel-merged")
def test_odometry_that_is_as_rare_as_scans_is_not_smoothed():
    """As in logs of CARMEN: a mean over two scans would hide a part of the turns between them (scale 0.92)."""
    clock = compare_turns(open_log(INTEL).table)
    assert not clock.is_off
    assert abs(clock.offset) < 0.01
    assert math.isclose(clock.scale, 0.99, abs_tol=0.02)


def test_a_shift_and_back_is_the_same_recording(log):
    there, lost = shifted(log.table, -0.15)
    again, _ = shifted(there, 0.15)
    assert lost == 1
    before = log.table.scan_rows[: len(again.scan_rows)]
    np.testing.assert_allclose(again.stamps[again.scan_rows], log.table.stamps[before], atol=1e-9)
    np.testing.assert_array_equal(again.ranges, log.table.ranges[: len(again.ranges)])
    for column in (again.odometry, again.truth):
        original = log.table.odometry if column is again.odometry else log.table.truth
        np.testing.assert_allclose(column[again.scan_rows], original[before], atol=1e-9)


def test_a_wrong_wheel_track_is_seen(log):
    odometry = log.table.odometry.copy()
    odometry[:, 2] = 1.4 * np.unwrap(odometry[:, 2])
    assert "times as far as odometry" in doubts(with_table(log, odometry=odometry))["turns"].found
    assert math.isclose(compare_turns(with_table(log, odometry=odometry).table).scale, 0.95 / 1.4, abs_tol=0.05)


def test_the_command_prints_a_table_and_json(log, tmp_path, capsys):
    write_log(tmp_path / "bag", log, "rosbag2-sqlite")
    assert call("inspect", tmp_path / "bag") == 0
    table = capsys.readouterr().out
    assert "topic /scan" in table
    assert "rate of laser" in table
    assert call("inspect", tmp_path / "bag", "--json") == 0
    findings = json.loads(capsys.readouterr().out)
    assert {"item": "format", "found": "ROS bag", "verdict": "ok", "action": "used as it is"} in findings
    assert_refused(capsys, "no such file", "inspect", tmp_path / "nothing")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"time_offset": "soon"}, "expected auto, or seconds"),
        ({"slice": "1"}, "LOW,HIGH"),
        ({"slice": "2,1"}, "LOW,HIGH"),
    ],
)
def test_bad_ways_of_reading_are_refused(options, complaint):
    with pytest.raises(ValueError, match=complaint):
        Reading(**options)
