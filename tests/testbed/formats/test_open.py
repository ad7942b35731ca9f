# SPDX-License-Identifier: MIT
"""What a person may point at: a recording, its file, or the folder around it."""

import shutil

import pytest

from testbed.formats import LogError, open_log
from testbed.formats.write import write_log
from tests.testbed.recordings import assert_same, two_lidar_drive


def test_a_folder_with_one_recording_stands_for_it(tmp_path):
    write_log(tmp_path / "data" / "drive-0005", two_lidar_drive(), "rosbag2-lean")
    log = open_log(tmp_path / "data")
    assert_same(log, two_lidar_drive(), ("rosbag2-lean",))
    assert log.notes[0] == f"read drive-0005, the only recording in {tmp_path / 'data'}"


def test_a_folder_with_several_recordings_lists_them(tmp_path):
    for number in range(8):
        write_log(tmp_path / f"drive-{number}", two_lidar_drive(), "parquet")
    with pytest.raises(LogError, match=r"holds 8 recordings; name one, such as .*drive-0$"):
        open_log(tmp_path)


def test_a_folder_without_recordings_is_no_log(tmp_path):
    with pytest.raises(LogError, match="not a log that can be read"):
        open_log(tmp_path)


def test_the_metadata_of_a_bag_stand_for_it(tmp_path):
    write_log(tmp_path / "bag", two_lidar_drive(), "rosbag2-lean")
    assert_same(open_log(tmp_path / "bag" / "metadata.yaml"), two_lidar_drive(), ("rosbag2-lean",))


@pytest.mark.parametrize("packing", ["zip", "tar", "gztar"])
def test_archives_are_named(tmp_path, packing):
    write_log(tmp_path / "bag", two_lidar_drive(), "rosbag2-lean")
    with pytest.raises(LogError, match="an archive, unpack it first"):
        open_log(shutil.make_archive(str(tmp_path / "packed"), packing, tmp_path / "bag"))
