# SPDX-License-Identifier: MIT
"""The frame that a scan is seen from in the final pass."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import FilterConfig, Scan, refine, se2
from slam.refinement import scan_frames
from slam.refinement.scan_frames import ScanLayout, middle_frames
from tests.slam.rooms import scan_at

SWEEP = 0.1  # seconds


def scan_of(stamp, seconds=SWEEP):
    """A scan of five beams within so many seconds."""
    return Scan(
        ranges=np.ones(5), angles=np.zeros(5), range_max=5.0, stamp=stamp, time_offsets=np.linspace(0.0, seconds, 5)
    )


def test_the_frame_in_the_middle_of_the_sweep_is_taken():
    stamps = np.arange(7) * 0.05
    scans = [scan_of(t) if k % 2 == 0 else None for k, t in enumerate(stamps)]
    assert middle_frames(stamps, scans) == {0: 1, 2: 3, 4: 5, 6: 6}  # nothing follows the last


def test_scans_without_times_and_frames_all_with_scans_stay():
    stamps = np.arange(4) * 0.05
    instantaneous = Scan(ranges=np.ones(3), angles=np.zeros(3), range_max=5.0)
    assert middle_frames(stamps, [instantaneous, None, instantaneous, None]) == {0: 0, 2: 2}
    assert middle_frames(stamps, [scan_of(t) for t in stamps]) == {0: 0, 1: 1, 2: 2, 3: 3}


@given(st.lists(st.booleans(), min_size=1, max_size=30), st.floats(0.0, 0.4), st.integers(0, 1000))
@settings(deadline=None)
def test_no_frame_serves_two_scans_and_none_is_farther_than_the_own(with_scan, sweep, seed):
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.uniform(0.001, 0.1, len(with_scan)))
    scans = [scan_of(t, sweep) if scan else None for t, scan in zip(stamps, with_scan, strict=True)]
    chosen = middle_frames(stamps, scans)
    assert list(chosen) == np.flatnonzero(with_scan).tolist()
    assert len(set(chosen.values())) == len(chosen)
    for own, frame in chosen.items():
        middle = stamps[own] + 0.5 * sweep
        assert abs(stamps[frame] - middle) <= abs(stamps[own] - middle)
        assert frame == own or scans[frame] is None


def test_rays_are_kept_as_far_as_there_is_room(monkeypatch):
    """Three scans of five beams: two of them fit into room for fourteen."""
    monkeypatch.setattr(scan_frames, "KEPT_BEAMS", 14)
    layout = ScanLayout([scan_of(0.0), None, scan_of(0.1), scan_of(0.2)], None, None, FilterConfig())
    assert list(layout) == [0, 2, 3]
    assert [layout[frame] is layout[frame] for frame in layout] == [True, True, False]
    assert all(len(rays.hit) == 5 for rays in layout.values())


def test_an_error_of_the_turn_rate_does_not_turn_the_poses():
    """A robot at rest whose odometry says that it turned during each sweep: scans laid out about their beginning seem
    turned by half of that, about their middle not at all."""
    rng = np.random.default_rng(5)
    frames = 40
    stamps = np.arange(frames) * 0.5 * SWEEP
    scans, twists = [], []
    for k in range(frames):
        scan = scan_at(np.zeros(3), beams=180)
        offsets = np.linspace(0.0, SWEEP, 180)
        timed = Scan(
            ranges=scan.ranges, angles=scan.angles, range_max=scan.range_max, stamp=stamps[k], time_offsets=offsets
        )
        scans.append(timed if k % 2 == 0 else None)
        twists.append(np.array([0.0, 0.0, rng.normal(scale=0.2)]))
    odometry = np.zeros((frames, 3))
    odometry[:, 2] = rng.normal(scale=0.01, size=frames)  # as coarse encoders: white, not a walk
    odometry[:, 2] -= odometry[0, 2]
    about_middle, about_stamp = (
        refine(odometry, scans, np.zeros((frames, 3)), FilterConfig(), twists=twists, stamps=times, threads=1)
        for times in (stamps, None)
    )
    middle, beginning = about_middle.poses[1:-1:2, 2], about_stamp.poses[0:-1:2, 2]
    assert np.std(se2.wrap_angle(middle)) < 0.5 * np.std(se2.wrap_angle(beginning))
