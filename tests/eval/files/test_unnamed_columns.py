# SPDX-License-Identifier: MIT
"""Tables of poses without names are known by what stands in them, or refused."""

import numpy as np
import pytest

from eval.files.trajectory_file import TumError, read_trajectory

STAMPS = 1.7e9 + 0.1 * np.arange(20)
HEADINGS = np.linspace(-3.0, 3.0, 20)
POSES = np.column_stack(
    [np.cos(HEADINGS), np.sin(HEADINGS), np.zeros((20, 3)), np.sin(HEADINGS / 2), np.cos(HEADINGS / 2)]
)


def read(path, columns, separator=" "):
    path.write_text("".join(separator.join(map(str, row)) + "\n" for row in zip(*columns, strict=True)))
    return read_trajectory(path)


def assert_read(found, note, stamps=STAMPS):
    trajectory, notes = found
    np.testing.assert_allclose(trajectory.stamps, stamps, atol=1e-6)
    np.testing.assert_allclose(trajectory.poses, np.column_stack([POSES[:, :2], HEADINGS]), atol=1e-9)
    assert [sentence.partition(": ")[2] for sentence in notes] == ([note] if note else [])


@pytest.mark.parametrize("frames", [["odom"], ["odom", "base_link"], ["odom", ""]])
def test_what_ros2_topic_echo_writes_is_read(tmp_path, frames):
    """Stamp, frames, pose, and whatever comes behind, such as covariances."""
    stamp = [range(1_700_000_000, 1_700_000_020), [7] * 20]
    columns = [*stamp, *([frame] * 20 for frame in frames), *POSES.T.tolist(), *[[0.5] * 20] * 36]
    assert_read(read(tmp_path / "t.csv", columns, ","), None, 1.7e9 + np.arange(20))


@pytest.mark.parametrize("rate", [10.0, 1.0])
def test_seconds_and_nanoseconds_without_names(tmp_path, rate):
    """At 1 Hz the seconds count as the numbers of lines do."""
    stamps = 1.7e9 + np.arange(20) / rate
    nanoseconds = np.round(stamps % 1.0 * 1e9).astype(int) + 5 * np.arange(20) ** 2
    found = read(tmp_path / "t.txt", [np.floor(stamps).astype(int), nanoseconds, *POSES.T.tolist()])
    assert_read(found, "the first two columns are read as seconds and nanoseconds", stamps)


def test_numbers_behind_the_pose_are_left_out(tmp_path):
    found = read(tmp_path / "t.txt", [STAMPS, *POSES.T.tolist(), range(3, 43, 2)])
    assert_read(found, "the last column holds whole numbers and is left out")


def test_a_ninth_column_of_anything_is_refused(tmp_path):
    with pytest.raises(TumError, match="got 9"):
        read(tmp_path / "t.txt", [STAMPS, *POSES.T.tolist(), HEADINGS])


@pytest.mark.parametrize(("digits", "unit"), [(9, 1e9), (6, 1e6), (3, 1e3)])
def test_fractions_without_zeros_in_front(tmp_path, digits, unit):
    """As printf("%d.%d", sec, nsec) writes 5 s and 7 ns: 5.7."""
    stamps = 1.7e9 + 0.25 * np.arange(20) + 0.07
    texts = [f"{int(stamp)}.{round(stamp % 1.0 * unit)}" for stamp in stamps.tolist()]
    assert max(len(text.partition(".")[2]) for text in texts) == digits
    note = "digits behind the point of the stamps are read as counts: 5.7 as 5.000000007"
    assert_read(read(tmp_path / "t.txt", [texts, *POSES.T.tolist()]), note, stamps)


def test_stamps_that_step_back_anyway_stay_as_they_are(tmp_path):
    texts = [str(stamp) for stamp in (STAMPS[::-1]).tolist()]
    assert_read(read(tmp_path / "t.txt", [texts, *POSES.T.tolist()]), None, STAMPS[::-1])


def test_an_empty_cell_moves_no_columns(tmp_path):
    """Without it the row has eight numbers, of which the first is the number of the line."""
    columns = [range(20), STAMPS, *POSES[:, :2].T.tolist(), [""] * 20, *POSES[:, 3:].T.tolist()]
    with pytest.raises(TumError, match=r"t\.csv:1: expected numbers, got an empty cell"):
        read(tmp_path / "t.csv", columns, ",")


def test_empty_cells_at_the_end_do_no_harm(tmp_path):
    assert_read(read(tmp_path / "t.csv", [STAMPS, *POSES.T.tolist(), [""] * 20], ","), None)


@pytest.mark.parametrize("lost", [[np.nan] * 7, [0.0] * 7, [0.0] * 6 + [1.0]])
def test_poses_of_a_tracker_that_sees_nothing_are_left_out(tmp_path, lost):
    poses = POSES.copy()
    poses[8:11] = lost
    trajectory, notes = read(tmp_path / "t.txt", [STAMPS, *poses.T.tolist()])
    np.testing.assert_allclose(trajectory.stamps, np.delete(STAMPS, [8, 9, 10]))
    assert "3 of 20 lines hold no pose" in notes[0]


def test_a_robot_that_stands_at_the_origin_is_not_lost(tmp_path):
    poses = POSES - POSES[0]
    poses[:, 5:] = [0.0, 1.0]
    poses[:5] = poses[-5:] = [0.0] * 6 + [1.0]
    assert len(read(tmp_path / "t.txt", [STAMPS, *poses.T.tolist()])[0].stamps) == 20


def test_a_file_without_poses_is_refused(tmp_path):
    with pytest.raises(TumError, match="in 20 of 20 lines"):
        read(tmp_path / "t.txt", [STAMPS, *[[np.nan] * 20] * 7])
