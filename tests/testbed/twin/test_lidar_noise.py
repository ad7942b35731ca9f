# SPDX-License-Identifier: MIT
"""Noise of a log's lidar: by what two scans at rest differ, where there are some, whatever the walls are like."""

import numpy as np
import pytest

from slam.scan import Scan
from testbed.frame import Frame
from testbed.frame_table import FrameTable
from testbed.twin.lidar import MIN_AT_REST, estimate_lidar

BEAMS, NOISE = 181, 0.01


def recording(scans, *, moving, rough, seed=0):
    """A recording of a wall about the robot, 2 to 8 m away, rough by so much [m]."""
    rng = np.random.default_rng(seed)
    angles = np.linspace(-np.pi / 2, np.pi / 2, BEAMS)
    wall = np.linspace(2.0, 8.0, BEAMS) + rough * rng.uniform(-1.0, 1.0, BEAMS)
    frames = []
    for k in range(scans):
        scan = Scan(ranges=wall + rng.normal(scale=NOISE, size=BEAMS), angles=angles, range_max=20.0, stamp=0.1 * k)
        frames.append(Frame(stamp=0.1 * k, odometry=np.array([0.1 * k * moving, 0.0, 0.0]), scan=scan))
    return FrameTable.from_frames(frames)


def test_scans_at_rest_show_the_noise_on_a_rough_wall():
    preset = estimate_lidar(recording(40, moving=False, rough=0.03)).preset
    assert preset.noise_floor == pytest.approx(NOISE, rel=0.1)
    assert preset.noise_share * 8.0 < 1.2 * NOISE


def test_on_the_way_a_rough_wall_counts_as_noise():
    preset = estimate_lidar(recording(40, moving=True, rough=0.03)).preset
    assert preset.noise_floor > 1.5 * NOISE


@pytest.mark.parametrize("enough", [True, False])
def test_so_many_pairs_at_rest_are_needed(enough):
    table = recording(MIN_AT_REST + enough, moving=False, rough=0.03)
    assert (estimate_lidar(table).preset.noise_floor < 1.1 * NOISE) == enough


def test_people_who_walk_by_are_no_noise():
    """In each scan another quarter of the beams ends on them."""
    table = recording(40, moving=False, rough=0.0)
    rng = np.random.default_rng(1)
    hidden = rng.random(table.ranges.size) < 0.25
    table.ranges[hidden] = rng.uniform(0.3, 2.0, hidden.sum())
    assert estimate_lidar(table).preset.noise_floor == pytest.approx(NOISE, rel=0.15)
