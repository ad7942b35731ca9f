# SPDX-License-Identifier: MIT
"""Frames as arrays: there and back, in parts, and with few copies."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.frame_table import BLOCK_FRAMES, FrameTable
from tests.testbed.equal_frames import assert_equal_frames
from tests.testbed.recordings import two_lidar_drive


def test_frames_come_back_from_the_arrays():
    frames = two_lidar_drive().frames
    frames[2] = replace(frames[2], truth=None, command=None)
    frames[3] = replace(frames[3], twist=None)
    assert_equal_frames(FrameTable.from_frames(frames).frames(), frames)


@pytest.mark.parametrize(("begin", "end"), [(0, 12), (0, 1), (1, 8), (5, 5), (11, 12)])
def test_rows_of_a_table_are_those_frames(begin, end):
    frames = two_lidar_drive().frames
    part = FrameTable.from_frames(frames).rows(begin, end)
    assert_equal_frames(part.frames(), frames[begin:end])
    assert part.first == begin


def test_blocks_cover_all_frames_once():
    frame = two_lidar_drive().frames[1]
    frames = [replace(frame, stamp=float(k)) for k in range(2 * BLOCK_FRAMES + 3)]
    blocks = list(FrameTable.from_frames(frames).blocks())
    assert [len(block) for block in blocks] == [BLOCK_FRAMES, BLOCK_FRAMES, 3]
    assert [block.first for block in blocks] == [0, BLOCK_FRAMES, 2 * BLOCK_FRAMES]
    np.testing.assert_array_equal(np.concatenate([block.stamps for block in blocks]), np.arange(len(frames)))


def test_scans_with_equal_beams_share_a_pattern():
    log = two_lidar_drive()
    assert len(log.table.patterns) == 1
    first, second, *_ = [frame.scan for frame in log.frames if frame.scan is not None]
    assert first.angles is second.angles


def test_a_log_is_one_line_in_a_notebook():
    text = repr(two_lidar_drive())
    assert len(text) < 150
    assert "12 frames, 6 scans (laser, rear_laser), 1.4 s" in text
