# SPDX-License-Identifier: MIT
"""Laws that every perturbation of the table keeps, and the known effect of each that lasts for the whole drive."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from slam import se2
from slam.scan import Scan
from testbed.frame import Frame
from testbed.frame_table import FrameTable
from testbed.inspect.time_offset import shifted
from testbed.seeds import RunSeeds
from testbed.stress.table import PERIOD, PERTURBATIONS, find, parse_perturbations, perturb, text_of
from testbed.stress.wheels import SLIP_DISTANCE, TRACK
from tests.testbed.equal_frames import assert_equal_frames

NAMES = list(PERTURBATIONS)
MOVES_THE_TRUTH = ("push", "time-offset")


def drive(seconds: float = 60.0, beams: int = 72, wall: float = 6.0) -> list[Frame]:
    """A robot on a circle within a round wall: frames at 10 Hz, a scan with each second one."""
    return list(_driven(seconds, beams, wall))


@cache
def _driven(seconds: float, beams: int, wall: float) -> tuple[Frame, ...]:
    angles = np.linspace(-np.pi, np.pi, beams, endpoint=False)
    frames, pose = [], np.array([1.0, 0.0, 0.5 * np.pi])
    for k in range(round(10.0 * seconds)):
        along = pose[0] * np.cos(angles + pose[2]) + pose[1] * np.sin(angles + pose[2])
        ranges = -along + np.sqrt(along**2 - pose[0] ** 2 - pose[1] ** 2 + wall**2)
        scan = Scan(ranges=ranges, angles=angles, range_max=20.0, stamp=0.1 * k)
        twist = np.array([0.5, 0.0, 0.5])
        frames.append(Frame(stamp=0.1 * k, odometry=pose, truth=pose, twist=twist, scan=scan if k % 2 == 0 else None))
        pose = se2.compose(pose, (0.05, 0.0, 0.05))
    return tuple(frames)


def changed(frames: list[Frame], name: str, value: float, seed: int = 0) -> list[Frame]:
    return perturb(frames, {name: value}, RunSeeds.from_seed(seed).perturbation)


def ranges_of(frames: list[Frame]) -> np.ndarray:
    return np.array([frame.scan.ranges for frame in frames if frame.scan is not None])


def content(frames: list[Frame]) -> list[bytes]:
    table = FrameTable.from_frames(frames)
    angles = [pattern.angles.tobytes() for pattern in table.patterns]
    return [table.stamps.tobytes(), table.odometry.tobytes(), table.ranges.tobytes(), table.mounts.tobytes(), *angles]


@pytest.mark.parametrize("name", NAMES)
def test_the_neutral_value_changes_nothing_bit_for_bit(name: str) -> None:
    frames = drive(5.0)
    same = changed(frames, name, PERTURBATIONS[name].neutral)
    assert len(same) == len(frames)
    assert all(a is b for a, b in zip(same, frames, strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_a_value_next_to_the_neutral_one_changes_hardly_anything(name: str) -> None:
    frames = drive(5.0)
    out = changed(frames, name, 1e-9 if PERTURBATIONS[name].neutral == 0.0 else 1e9)
    if name == "time-offset":  # scans become frames of their own
        out, frames = ([frame for frame in some if frame.scan is not None] for some in (out, frames))
    assert len(out) == len(frames)
    for a, b in zip(out, frames, strict=True):
        np.testing.assert_allclose(a.odometry, b.odometry, atol=1e-6)
        assert (a.scan is None) == (b.scan is None)
        if a.scan is not None:
            np.testing.assert_allclose(a.scan.ranges, b.scan.ranges, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_same_bits_and_the_ends_of_the_range_differ(name: str) -> None:
    frames, row = drive(70.0), PERTURBATIONS[name]
    strong = changed(frames, name, row.hopeless)
    assert content(strong) == content(changed(frames, name, row.hopeless))
    assert content(strong) != content(changed(frames, name, row.harmless))
    assert content(strong) != content(frames)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in MOVES_THE_TRUTH])
def test_stamps_and_truth_stay_and_the_given_frames_too(name: str) -> None:
    frames = drive(30.0)
    before = content(frames)
    out = changed(frames, name, PERTURBATIONS[name].hopeless)
    assert content(frames) == before
    assert [frame.stamp for frame in out] == [frame.stamp for frame in frames]
    assert all(a.truth is b.truth for a, b in zip(out, frames, strict=True))


def test_each_draws_its_own_numbers_whatever_else_is_applied() -> None:
    frames = drive(20.0)
    seeds = RunSeeds.from_seed(3).perturbation
    alone = perturb(frames, {"drop-scans": 0.5}, seeds)
    both = perturb(frames, {"range-noise": 0.1, "drop-scans": 0.5, "slip": 1.0}, seeds)
    assert [f.scan is None for f in alone] == [f.scan is None for f in both]


def test_a_share_of_the_scans_is_lost_and_more_at_a_larger_share() -> None:
    frames = drive(200.0)
    few, many = ({f.stamp for f in changed(frames, "drop-scans", share) if f.scan} for share in (0.3, 0.6))
    assert len(few) == pytest.approx(700, abs=50)
    assert many < few


def test_beams_are_lost_at_random_and_carry_no_information() -> None:
    ranges = ranges_of(changed(drive(), "dropout", 0.25))
    assert np.isnan(ranges).mean() == pytest.approx(0.25, abs=0.01)


def test_ranges_get_normal_errors_of_the_stated_size() -> None:
    frames = drive()
    errors = ranges_of(changed(frames, "range-noise", 0.2)) - ranges_of(frames)
    assert errors.std() == pytest.approx(0.2, rel=0.02)
    assert abs(errors.mean()) < 0.01


def test_what_is_left_of_the_view_lies_ahead() -> None:
    scan = next(f.scan for f in changed(drive(2.0), "field-of-view", 90.0) if f.scan)
    np.testing.assert_array_equal(np.isfinite(scan.ranges), np.abs(scan.angles) <= math.radians(45.0))


def test_no_more_beams_than_stated_evenly_spread() -> None:
    for beams in (1, 5, 20, 72):
        scan = next(f.scan for f in changed(drive(1.0), "beams", beams) if f.scan)
        assert 0.5 * beams < len(scan.ranges) <= beams
        assert np.ptp(np.diff(scan.angles)) < 1e-9 if beams > 2 else True


def test_the_stated_mount_is_turned() -> None:
    scan = next(f.scan for f in changed(drive(1.0), "askew", 10.0) if f.scan)
    assert scan.mount == pytest.approx((0.0, 0.0, math.radians(10.0)))


def test_a_wall_of_glass_is_one_at_each_visit_and_a_share_of_all() -> None:
    frames = drive(120.0, beams=360, wall=30.0)
    frames = [replace(f, scan=replace(f.scan, range_max=99.0)) if f.scan else f for f in frames]
    out = changed(frames, "glass", 0.3)
    gone: dict[int, list[bool]] = {}
    for before, after in zip(frames, out, strict=True):
        if before.scan is not None and after.scan is not None:
            pose = before.truth
            x = pose[0] + before.scan.ranges * np.cos(pose[2] + before.scan.angles)
            y = pose[1] + before.scan.ranges * np.sin(pose[2] + before.scan.angles)
            for place, lost in zip((np.arctan2(y, x) * 300).astype(int), after.scan.no_return, strict=True):
                gone.setdefault(int(place), []).append(bool(lost))
    shares = np.array([np.mean(seen) for seen in gone.values()])
    assert shares.mean() == pytest.approx(0.3, abs=0.1)
    assert np.mean((shares < 0.02) | (shares > 0.98)) > 0.8


def test_glass_needs_a_truth_and_people_do_not() -> None:
    frames = [replace(frame, truth=None) for frame in drive(5.0)]
    with pytest.raises(ValueError, match="glass: the scan at 0 s has no true pose"):
        changed(frames, "glass", 0.5)
    assert (ranges_of(changed(frames, "people", 100.0)) < ranges_of(frames)).any()


def test_people_hide_walls_as_often_as_their_number_says() -> None:
    frames = drive(120.0, beams=36, wall=6.0)
    density, radius = 5.0, 0.2
    before = ranges_of(frames)
    after = np.array([ranges_of(changed(frames, "people", density, seed)) for seed in range(8)])
    assert (after <= before).all()
    # a beam of length r meets nobody with the probability exp(-density 2 radius r); nobody stands within 0.7 m, and a
    # circle is met before its centre, on average by pi/4 of the radius
    expected = 1.0 - np.exp(-0.01 * density * 2.0 * radius * (before - 0.7 + 0.25 * np.pi * radius))
    assert (after < before).mean() == pytest.approx(expected.mean(), rel=0.1)


def test_errors_of_the_wheels_are_as_large_as_stated() -> None:
    straight = [replace(f, odometry=np.array([0.05 * k, 0.0, 0.0])) for k, f in enumerate(drive(60.0, beams=4))]
    ends = np.array([changed(straight, "odometry-noise", 0.5, seed)[-1].odometry for seed in range(100)])
    path = 0.05 * (len(straight) - 1)
    # the scale is 2 % off when typical; the heading walks by 0.5 degrees on the root of a metre
    assert np.std(ends[:, 2]) == pytest.approx(0.5 * math.radians(0.5) * math.sqrt(path), rel=0.2)
    lengths = np.hypot(ends[:, 0], ends[:, 1])
    assert np.std(lengths) == pytest.approx(0.5 * 0.02 * path, rel=0.3)


def test_slips_come_as_often_as_stated_and_turn_as_far() -> None:
    frames = drive(400.0, beams=4)
    turned, ahead = [], []
    for seed in range(10):
        out = changed(frames, "slip", 0.5, seed)
        before, after = (np.array([frame.odometry for frame in some]) for some in (frames, out))
        steps = se2.between(se2.between(before[:-1], before[1:]), se2.between(after[:-1], after[1:]))
        turned.append(np.abs(np.sum(steps, axis=0)[2]))
        ahead.append(np.linalg.norm(steps[:, :2], axis=1).sum())
    slips = 0.5 * 0.05 * len(frames)
    assert np.mean(ahead) == pytest.approx(0.5 * SLIP_DISTANCE * slips, rel=0.15)
    # left and right cancel: the root of the sum of E[d^2] = 2 SLIP_DISTANCE^2
    assert np.sqrt(np.mean(np.square(turned))) == pytest.approx(SLIP_DISTANCE / TRACK * math.sqrt(2.0 * slips), rel=0.6)
    twists = np.array([f.twist for f in out])
    assert (twists[:, 0] > 0.5 + 1e-9).mean() == pytest.approx(slips * 5 / len(frames), rel=0.4)


def test_a_time_offset_is_what_the_reader_takes_back() -> None:
    frames = drive(20.0)
    late = changed(frames, "time-offset", 0.53)
    again, lost = shifted(FrameTable.from_frames(late), 0.53)
    assert lost == 0
    with_scan = {round(f.stamp, 3): f for f in frames if f.scan}
    back = [f for f in again.frames() if f.scan]
    assert len(back) > 0.9 * len(with_scan)
    for frame in back:
        original = with_scan[round(frame.stamp, 3)]
        np.testing.assert_allclose(frame.truth, original.truth, atol=1e-4)
        np.testing.assert_array_equal(frame.scan.ranges, original.scan.ranges)


def test_odometry_keeps_its_order_where_scans_are_late_and_stamps_step_back() -> None:
    frames = drive(10.0)
    frames[40] = replace(frames[40], stamp=frames[40].stamp - 0.5)
    late = changed(frames, "time-offset", 0.27)
    wheels = [f for f in late if f.scan is None]
    assert [f.stamp for f in wheels] == [f.stamp for f in frames]
    assert all(a.odometry is b.odometry for a, b in zip(wheels, frames, strict=True))
    steps = [np.linalg.norm(se2.between(a.odometry, b.odometry)[:2]) for a, b in pairwise(late)]
    assert max(steps) <= 0.05 + 1e-9
    on_time = {round(f.stamp, 6): f.truth for f in frames[41:]}
    for frame in late:
        if frame.scan is not None and round(frame.stamp - 0.07, 6) in on_time:  # 0.7 of the way to the next frame
            assert 0.0 < np.linalg.norm(frame.truth[:2] - on_time[round(frame.stamp - 0.07, 6)][:2]) < 0.05


def test_pushes_leave_the_same_time_between_them() -> None:
    frames = drive(120.0, beams=4)
    out = changed(frames, "push", 5.0)
    jumps = [b.stamp for a, b in pairwise(out) if np.linalg.norm(se2.between(a.truth, b.truth)[:2]) > 0.2]
    np.testing.assert_allclose(np.diff(jumps), PERIOD, atol=0.11)
    assert_equal_frames(out[:190], frames[:190])


@pytest.mark.parametrize("name", NAMES)
def test_values_grow_from_harmless_to_hopeless(name: str) -> None:
    row = PERTURBATIONS[name]
    values = [row.value_at(severity) for severity in np.linspace(0.0, 1.0, 33)]
    assert values[0] == pytest.approx(row.harmless)
    assert values[-1] == pytest.approx(row.hopeless)
    towards_hopeless = np.diff(values) * np.sign(row.hopeless - row.harmless)
    assert (towards_hopeless > 0.0).all()
    assert all(row.check(value) == value for value in values)


def test_texts_are_read_as_they_are_written() -> None:
    chosen = {"drop-scans": 0.3, "askew": 5.0, "reach": math.inf}
    assert parse_perturbations(text_of(chosen)) == chosen
    assert parse_perturbations("") == {}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("drop-scan=0.3", "drop-scan: no such perturbation, expected such as drop-scans"),
        ("drop-scans", "'drop-scans': expected NAME=VALUE"),
        ("drop-scans=x", "expected NAME=VALUE"),
        ("drop-scans=1", "drop-scans = 1: expected 0 to less than 1"),
        ("askew=-1", r"askew = -1: expected 0 to 180 \(degrees\)"),
        ("reach=0", "reach = 0: expected more than 0"),
        ("range-noise=inf", "expected 0 or more"),
        ("askew=nan", "askew = nan"),
        ("askew=1+askew=2", "askew: is given twice"),
    ],
)
def test_wrong_texts_are_refused_with_what_was_expected(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_perturbations(text)


def test_no_frames_are_no_frames() -> None:
    assert perturb([], {"askew": 1.0}, RunSeeds.from_seed(0).perturbation) == []
    assert find("askew").name == "askew"
