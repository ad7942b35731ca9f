# SPDX-License-Identifier: MIT
"""CARMEN logs: what is written comes back, real logs read as their notes say, damage is never silent."""

import gzip
import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.scan import Scan
from testbed.formats import Log, LogError, open_log
from testbed.formats.carmen.reader import no_return_from, read_carmen
from testbed.frame import Frame
from tests.testbed.recordings import write_frames

DATASETS = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).parents[4] / "shared" / "datasets"))

coordinate = st.floats(-1e3, 1e3)
heading = st.floats(-math.pi, math.pi, exclude_max=True)
poses = st.tuples(coordinate, coordinate, heading).map(np.array)
reading = st.one_of(st.floats(-1.0, 40.0), st.sampled_from([math.nan, math.inf, 0.0]))


@st.composite
def scans(draw):
    count = draw(st.integers(1, 12))
    start, step = draw(st.floats(-3.0, 0.0)), draw(st.floats(0.001, 0.1))
    return Scan(
        ranges=np.array(draw(st.lists(reading, min_size=count, max_size=count))),
        angles=start + step * np.arange(count),
        range_max=draw(st.floats(0.5, 50.0)),
        mount=draw(st.tuples(st.floats(-1, 1), st.floats(-1, 1), heading)),
    )


@st.composite
def recordings(draw):
    frames = []
    for scan in draw(st.lists(st.one_of(scans(), st.none()), min_size=1, max_size=6)):
        frames.append(
            Frame(
                stamp=draw(st.floats(0.0, 2e9)),
                odometry=draw(poses),
                scan=scan,
                twist=draw(st.one_of(st.none(), st.tuples(coordinate, st.just(0.0), coordinate).map(np.array))),
                truth=draw(st.one_of(st.none(), poses)),
            )
        )
    return [*frames, Frame(stamp=0.0, odometry=np.zeros(3), scan=draw(scans()))]


def assert_same_scan(read: Scan, written: Scan) -> None:
    np.testing.assert_array_equal(read.hit, written.hit)
    np.testing.assert_array_equal(read.no_return, written.no_return)
    np.testing.assert_array_equal(read.ranges[read.hit], written.ranges[written.hit])
    np.testing.assert_allclose(read.angles, written.angles, atol=1e-9)
    assert read.range_max == written.range_max


@settings(deadline=None)
@given(frames=recordings(), suffix=st.sampled_from([".log", ".log.gz"]))
def test_a_robotlaser_round_trip_loses_nothing(tmp_path_factory, frames, suffix):
    path = tmp_path_factory.mktemp("carmen") / f"log{suffix}"
    write_frames(path, frames)
    read = open_log(path).frames
    assert len(read) == len(frames)
    for got, put in zip(read, frames, strict=True):
        assert got.stamp == put.stamp
        np.testing.assert_array_equal(got.odometry, put.odometry)
        assert (got.scan is None) == (put.scan is None)
        if put.truth is not None:
            np.testing.assert_array_equal(got.truth, put.truth)
        assert (got.twist is None) == (put.twist is None)
        if put.twist is not None:
            np.testing.assert_array_equal(got.twist, put.twist)
        if put.scan is not None:
            assert_same_scan(got.scan, put.scan)
            difference = se2.between(got.scan.mount, put.scan.mount)
            np.testing.assert_allclose(difference, 0.0, atol=1e-9)


@pytest.mark.parametrize(("count", "first", "step"), [(180, -90, 1), (181, -90, 1), (360, -90, 0.5), (361, -90, 0.5)])
def test_flaser_implies_its_angles(tmp_path, count, first, step):
    angles = np.deg2rad(first + step * np.arange(count))
    rng = np.random.default_rng(count)
    frames = [
        Frame(
            stamp=float(i),
            odometry=rng.normal(size=3),
            scan=Scan(ranges=rng.uniform(0.1, 9.0, count), angles=angles, range_max=8.0, mount=(-0.04, 0.0, 0.0)),
        )
        for i in range(3)
    ]
    write_frames(tmp_path / "log", frames, "carmen-flaser")
    read = open_log(tmp_path / "log").frames
    for got, put in zip(read, frames, strict=True):
        assert_same_scan(got.scan, put.scan)
        assert got.scan.mount == put.scan.mount
        np.testing.assert_array_equal(got.odometry, put.odometry)


def test_equal_frames_give_equal_bytes(tmp_path):
    frames = [
        Frame(stamp=1.0, odometry=np.zeros(3), scan=Scan(ranges=np.ones(3), angles=np.arange(3.0), range_max=9.0))
    ]
    write_frames(tmp_path / "a.log.gz", frames)
    write_frames(tmp_path / "b.log.gz", frames)
    assert (tmp_path / "a.log.gz").read_bytes() == (tmp_path / "b.log.gz").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.log.gz", "b.log.gz"]


@pytest.mark.parametrize("log_format", ["carmen", "carmen-flaser"])
def test_uneven_angles_are_refused_and_leave_no_file(tmp_path, log_format):
    scan = Scan(ranges=np.ones(3), angles=np.array([0.0, 0.1, 0.5]), range_max=9.0)
    with pytest.raises(LogError, match="frame 0"):
        write_frames(tmp_path / "log", [Frame(stamp=0.0, odometry=np.zeros(3), scan=scan)], log_format)
    assert list(tmp_path.iterdir()) == []


# --- bad input -------------------------------------------------------------------------------------------------------

RANGES = " ".join(f"{1 + 0.01 * i:.2f}" for i in range(180))
GOOD = f"FLASER 180 {RANGES} 0.1 0.2 0.3 0.1 0.2 0.3 5.5 host 5.5"


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        (GOOD.replace("FLASER 180", "FLASER 181"), r":2: FLASER with 181 beams: expected 9 values after its ranges"),
        (GOOD.replace("FLASER 180", "FLASER 400"), r":2: FLASER announces 400 beams, but only 189 values follow"),
        (GOOD.replace("0.1 0.2 0.3 5.5", "0.1 nan 0.3 5.5"), r":2: odometry pose must be finite"),
        (GOOD.replace("0.1 0.2 0.3 5.5", "0.1 inf 0.3 5.5"), r":2: odometry pose must be finite"),
        (GOOD.replace("5.5 host", "nan host"), r":2: ipc time must be finite"),
        (GOOD.replace("5.5 host", "1e12 host"), r":2: a stamp of 1e\+12, expected seconds, or nanoseconds in all"),
        (GOOD.replace("5.5 host", "5500000000123456789 host"), r":2: a stamp of 5.5\d*e\+18, expected seconds"),
        (GOOD.replace("1.50", "1.x0"), r":2: beam: expected a number, got '1.x0'"),
        (GOOD.replace("1.50", "1_50"), r":2: beam: expected a number, got '1_50'"),
        ("FLASER 3 1 1 1 0 0 0 0 0 0 5.5 host 5.5", r":2: FLASER with 3 beams: it holds no angles"),
        ("ODOM 0 0 0 0 0 0 1.0 host", r":2: ODOM: expected 9 values, got 8"),
        ("FLASER", r":2: FLASER: expected the number of beams"),
        ("ROBOTLASER1 0 1 2", r":2: ROBOTLASER1 ends after 3 values"),
        ("ROBOTLASER1 0 nan 3 0.1 80 0 0 1 1.0 0 0 0 0 0 0 0 0 0 0 0 0 1.0 h 1.0", r":2: ROBOTLASER1 needs finite"),
    ],
)
def test_bad_line_is_named(tmp_path, line, complaint):
    path = tmp_path / "bad.log"
    path.write_text(f"{GOOD}\n{line}\n")
    with pytest.raises(LogError, match=complaint) as error:
        open_log(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "not a log that can be read"),
        (b"\x00\x01\x02" * 50, "not a log that can be read"),
        (b"# only a comment\n", "not a log that can be read"),
        (b"ODOM 0 0 0 0 0 0 1.0 host 1.0\n", "no scans in this CARMEN log"),
        (gzip.compress(f"{GOOD}\n".encode() * 200)[:-400], "truncated"),
        (b"\x1f\x8bnonsense that is not gzip at all", "gzip"),
        (GOOD.replace(RANGES, " ".join(["1234"] * 180)).encode(), "expected metres"),
        (GOOD.encode() + b" " * 2_000_000, "line longer than"),
    ],
)
def test_bad_file_is_named(tmp_path, content, complaint):
    path = tmp_path / "bad"
    path.write_bytes(content)
    with pytest.raises(LogError, match=complaint) as error:
        open_log(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_stamps_in_nanoseconds_are_read_as_seconds(tmp_path):
    path = tmp_path / "nano.log"
    start = 1_600_000_000_000_000_000
    path.write_text("".join(f"{GOOD.replace('5.5 host', f'{start + k * 10**8} host')}\n" for k in range(3)))
    log = open_log(path)
    assert np.diff([frame.stamp for frame in log.frames]) == pytest.approx([0.1, 0.1], abs=1e-6)
    assert log.frames[0].stamp == pytest.approx(1.6e9)
    assert "stamps are in nanoseconds; they are read as seconds" in log.notes


def test_missing_file_is_named(tmp_path):
    with pytest.raises(LogError, match=r"nowhere\.log: no such file"):
        open_log(tmp_path / "nowhere.log")


def test_unknown_messages_are_counted_and_reported(tmp_path):
    path = tmp_path / "log"
    path.write_text(f"SYNC start 1 h 1\n{GOOD}\nNMEAGGA 1 2 3\nNMEAGGA 1 2 3\n")
    log = open_log(path)
    assert log.scan_count == 1
    assert "messages left out: 2 NMEAGGA, 1 SYNC" in log.notes


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_damaged_byte_is_an_error_or_harmless(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("damage")
    scan = Scan(ranges=np.linspace(1, 9, 7), angles=0.1 * np.arange(7), range_max=8.0)
    frames = [Frame(stamp=float(i), odometry=np.ones(3), scan=scan if i % 2 else None) for i in range(6)]
    path = folder / data.draw(st.sampled_from(["log", "log.gz"]))
    write_frames(path, frames)
    whole = path.read_bytes()
    at, cut = data.draw(st.integers(0, len(whole) - 1)), data.draw(st.booleans())
    path.write_bytes(whole[:at] if cut else whole[:at] + bytes([data.draw(st.integers(0, 255))]) + whole[at + 1 :])
    log = read_or_complaint(path)
    if log is None:
        return
    for frame in log.frames:
        assert np.all(np.isfinite(frame.odometry))
        assert math.isfinite(frame.stamp)
    if path.suffix == ".gz":  # its check sum leaves no doubt
        assert [frame.stamp for frame in log.frames] == [frame.stamp for frame in frames]
    elif not cut:  # one byte can hide one line behind a "#", and any other lost line is reported
        assert len(log.frames) >= len(frames) - 1 or log.notes
    assert len(log.frames) <= len(frames)


def read_or_complaint(path: Path) -> Log | None:
    """The log, or None where its reader complained as it should: one line with the name of the file."""
    try:
        return open_log(path)
    except LogError as error:
        complaint = str(error)
    assert str(path) in complaint
    assert "\n" not in complaint
    return None


# --- what the log tells about the sensor -----------------------------------------------------------------------------


def test_no_return_is_a_cluster_at_the_far_end():
    rng = np.random.default_rng(0)
    walls = np.round(rng.uniform(0.5, 49.9, 20_000), 2)
    assert no_return_from(np.concatenate([walls, np.full(200, 50.0)])) == 50.0
    assert no_return_from(walls) is None
    assert no_return_from(np.round(rng.normal(9.0, 0.01, 20_000), 2)) is None
    codes = np.repeat([50.0, 51.14, 51.15, 51.16], [200, 900, 3000, 40])
    far = np.round(rng.uniform(45.0, 50.5, 20), 2)
    assert no_return_from(np.concatenate([walls, far, codes])) == 50.0
    assert no_return_from(np.full(5, math.nan)) is None


@pytest.mark.parametrize(
    "header", ["PARAM robot_frontlaser_offset 0.08 nohost 0", "# with robot_frontlaser_offset 0.08 m"]
)
def test_laser_offset_is_taken_from_the_log_unless_given(tmp_path, header):
    path = tmp_path / "log"
    path.write_text(f"{header}\n{GOOD}\n")
    assert read_carmen(path).frames[0].scan.mount == (0.08, 0.0, 0.0)
    assert read_carmen(path, laser_offset=-0.1).frames[0].scan.mount == (-0.1, 0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "frames", "scans", "no_return", "offset", "beams"),
    [
        ("intel/intel-merged.clf.gz", 18150, 4519, 81.83, 0.0, 180),
        ("fr079/fr079-merged.clf.gz", 9725, 4791, 81.91, -0.04, 360),
        ("aces/aces-merged.clf.gz", 7814, 440, 50.0, 0.0, 180),
    ],
)
def test_real_logs_match_their_description(name, frames, scans, no_return, offset, beams):
    path = DATASETS / name
    if not path.exists():
        pytest.skip(f"{path} is absent: set TESTBED_DATASETS")
    log = open_log(path)
    assert (len(log.frames), log.scan_count) == (frames, scans)
    scan = next(frame.scan for frame in log.frames if frame.scan is not None)
    assert (scan.range_max, scan.mount, scan.angles.size) == (no_return, (offset, 0.0, 0.0), beams)
    assert scan.angles[0] == -np.pi / 2


RAW_SCAN = "RAWLASER1 0 -1.57 3.14 0.785 80 0.01 0 5 1.0 2.0 3.0 2.0 1.0 0 {stamp} host {stamp}"
ODOM_LINE = "ODOM {x} 0 0 0.5 0 0 {stamp} host {stamp}"


def test_scans_without_a_pose_get_that_of_odometry(tmp_path):
    path = tmp_path / "a.log"
    lines = [ODOM_LINE.format(x=k, stamp=2.0 * k) for k in range(3)]
    lines += [RAW_SCAN.format(stamp=stamp) for stamp in (-9.0, 1.0, 2.5, 4.1)]
    path.write_text("\n".join(["PARAM robot_frontlaser_offset 0.2", *lines]))
    log = open_log(path)
    table = log.table
    np.testing.assert_allclose(table.odometry[table.scan_rows, 0], [0.5, 1.25, 2.0])
    np.testing.assert_allclose(table.mounts, [[0.2, 0.0, 0.0]] * 3)
    np.testing.assert_allclose(table.twist[table.scan_rows, 0], 0.5)
    np.testing.assert_allclose(table.patterns[0].angles, -1.57 + 0.785 * np.arange(5))
    assert log.notes[0].startswith("scans without a pose (RAWLASER) have that of the ODOM messages")
    assert log.notes[1].startswith("1 of 4 scans lie outside")


def test_scans_without_a_pose_are_left_out_where_they_come_with_one_too(tmp_path):
    path, plain = tmp_path / "a.log", tmp_path / "plain.log"
    scan = "ROBOTLASER1 0 -1.57 3.14 0.785 80 0.01 0 5 1 2 3 2 1 0 0 0 0 0 0 0 0 0 0 0 0 1.0 host 1.0"
    lines = [ODOM_LINE.format(x=0, stamp=0.5), scan]
    plain.write_text("\n".join(lines))
    path.write_text("\n".join([*lines, RAW_SCAN.format(stamp=1.0)]))
    assert open_log(path).scan_count == open_log(plain).scan_count == 1
    assert "1 scans of RAWLASER1 are left out" in open_log(path).notes[0]


def test_scans_without_any_pose_are_refused(tmp_path):
    path = tmp_path / "a.log"
    path.write_text(RAW_SCAN.format(stamp=1.0))
    with pytest.raises(LogError, match="RAWLASER1 messages have no pose, and there are no ODOM messages"):
        open_log(path)


def test_the_rear_laser_without_a_pose_faces_backwards(tmp_path):
    path = tmp_path / "a.log"
    lines = [ODOM_LINE.format(x=0, stamp=1.0), RAW_SCAN.format(stamp=1.0).replace("RAWLASER1", "RAWLASER2")]
    path.write_text("\n".join(["PARAM robot_rearlaser_offset -0.3", *lines]))
    table = open_log(path).table
    np.testing.assert_allclose(table.mounts, [[-0.3, 0.0, math.pi]])
    assert table.lidars == ("rear_laser",)


def test_a_last_line_that_was_cut_is_left_out(tmp_path):
    path = tmp_path / "a.log"
    lines = [ODOM_LINE.format(x=0, stamp=0.5), ODOM_LINE.format(x=1, stamp=1.0)]
    whole = "\r\n".join([*lines, ""])
    cut = whole[: len(lines[0]) + len(lines[1]) // 2].encode()
    path.write_bytes(cut)
    log = open_log(path, scans_needed=False)
    assert len(log.table) == 1
    assert log.notes[-1].startswith("line 2, the last one, ends early and is left out: ODOM")
    path.write_bytes(cut + b"\r\n")
    with pytest.raises(LogError, match=r"a\.log:2: ODOM"):
        open_log(path, scans_needed=False)


@pytest.mark.parametrize(("start", "step"), [("-90", "45.0"), ("-1.57", "0.0"), ("-1.57", "-3.0")])
def test_angles_of_more_than_a_turn_or_of_none_are_refused(tmp_path, start, step):
    """Degrees, or a resolution that nobody filled in."""
    path = tmp_path / "a.log"
    path.write_text(f"ROBOTLASER1 0 {start} 180 {step} 80 0.01 0 5 1 2 3 2 1 0 0 0 0 0 0 0 0 0 0 0 0 1.0 host 1.0\n")
    with pytest.raises(
        LogError, match=r"a\.log:1: ROBOTLASER1: an angular_resolution of .* and 5 beams make a view of"
    ):
        open_log(path)
