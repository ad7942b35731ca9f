# SPDX-License-Identifier: MIT
"""A recording feeds the filter as it is, and makes the final pass with all that the filter was told."""

from dataclasses import replace

import numpy as np
import pytest

from slam import FilterConfig, GMapping, Recording, refine, se2
from slam.motion.interpolation import interpolate_with_odometry
from tests.slam.rooms import drive, scan_at

CONFIG = FilterConfig(particles=3)
TWIST = (0.3, 0.0, 0.1)


def timed(pose, stamp):
    """A scan whose beams were measured one after another."""
    return replace(scan_at(pose, beams=90, stamp=stamp), time_offsets=np.linspace(0.0, 0.1, 90))


@pytest.fixture(scope="module")
def truth():
    return drive(8)


@pytest.fixture(scope="module")
def recording(truth):
    made = Recording(GMapping(CONFIG, threads=1))
    for k, pose in enumerate(truth):
        made.process(pose, timed(pose, 0.5 * k), twist=TWIST)
    return made


def test_the_filter_is_as_without_recording(truth, recording):
    mapper = GMapping(CONFIG, threads=1)
    for k, pose in enumerate(truth):
        mapper.process(pose, timed(pose, 0.5 * k), twist=TWIST)
    np.testing.assert_array_equal(recording.mapper.poses, mapper.poses)
    np.testing.assert_array_equal(recording.stamps, 0.5 * np.arange(len(truth)))


def test_the_final_pass_gets_times_and_velocities(truth, recording):
    stamps, twists = recording.stamps, [np.array(TWIST)] * len(truth)
    poses = interpolate_with_odometry(truth, recording.mapper.update_scans, recording.mapper.path())
    np.testing.assert_array_equal(recording.poses(), poses)
    expected = refine(truth, recording.scans, poses, CONFIG, twists=twists, stamps=stamps, threads=1)
    np.testing.assert_array_equal(recording.refine(threads=1).poses, expected.poses)


def test_times_of_beams_without_a_velocity_are_an_error_and_change_nothing(truth):
    recording = Recording(GMapping(CONFIG, threads=1))
    with pytest.raises(ValueError, match=r"time_offsets, but twist is missing: pass twist="):
        recording.process(truth[0], timed(truth[0], 0.0))
    assert recording.mapper.scans == len(recording.scans) == 0
    scans = [timed(pose, 0.5 * k) for k, pose in enumerate(truth)]
    with pytest.raises(ValueError, match=r"time_offsets, but twists are missing: .*Recording"):
        refine(truth, scans, truth, CONFIG, threads=1)


def test_two_lidars_have_a_pose_for_each_step(truth):
    recording = Recording(GMapping(CONFIG, threads=1))
    for k, pose in enumerate(truth):
        rear = scan_at(pose, beams=90, mount=(-0.2, 0.0, np.pi), stamp=0.5 * k)
        recording.process(pose, [scan_at(pose, beams=90, stamp=0.5 * k), rear])
    assert len(recording.scans) == 2 * len(truth)
    refined = recording.refine(threads=1)
    assert len(recording.poses()) == len(recording.stamps) == len(refined.covariances) == len(truth)
    assert np.hypot(*se2.between(truth, refined.poses)[:, :2].T).max() < 0.03


def test_a_filter_that_has_seen_scans_is_refused(recording):
    with pytest.raises(ValueError, match="has seen no scan"):
        Recording(recording.mapper)
