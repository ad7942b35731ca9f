# SPDX-License-Identifier: MIT
"""Features of drives of known shape."""

import numpy as np
import pytest

from slam.scan import Scan
from testbed.frame import Frame
from testbed.sweep.execution.drive_features import drive_features, longest_unknown, observability

ANGLES = np.linspace(-np.pi, np.pi, 720, endpoint=False)


def scan_in_a_box(width: float, depth: float, range_max: float = 12.0, noise: float = 0.0) -> Scan:
    """The scan from the middle of a rectangular room."""
    with np.errstate(divide="ignore"):
        ranges = np.minimum(0.5 * width / np.abs(np.cos(ANGLES)), 0.5 * depth / np.abs(np.sin(ANGLES)))
    ranges = ranges + noise * np.random.default_rng(0).standard_normal(len(ranges))
    return Scan(ranges=np.minimum(ranges, range_max), angles=ANGLES, range_max=range_max)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_square_room_determines_the_position_in_all_directions(noise):
    assert observability(scan_in_a_box(4.0, 4.0, noise=noise)) == pytest.approx(1.0, abs=0.06)


def test_a_corridor_without_an_end_in_sight_does_not():
    assert observability(scan_in_a_box(100.0, 2.0)) == pytest.approx(0.0, abs=1e-9)
    assert observability(scan_in_a_box(100.0, 2.0, noise=0.01)) < 0.05


def test_ends_in_sight_count_by_their_share_of_the_beams():
    # the ends of a room of 6 m x 2 m fill 2 atan(1/3) of each half turn; pairs across a corner lie askew
    assert observability(scan_in_a_box(6.0, 2.0)) == pytest.approx(2.0 * 2.0 * np.arctan(1 / 3) / np.pi, abs=0.06)


def test_nothing_in_sight_determines_nothing():
    assert observability(scan_in_a_box(100.0, 100.0)) == 0.0


def drive(heading_drift: float, scan: Scan) -> tuple[list[Frame], np.ndarray]:
    """20 m straight on, a scan every 0.1 m; the odometry turns by so much per metre [rad/m]."""
    s = np.arange(0.0, 20.0 + 1e-9, 0.1)
    path = np.stack([s, np.zeros_like(s), np.zeros_like(s)], axis=-1)
    odometry = np.stack([np.sin(heading_drift * s), np.zeros_like(s), heading_drift * s], axis=-1)
    return [Frame(stamp=float(k), odometry=pose, scan=scan) for k, pose in enumerate(odometry)], path


def test_the_error_of_the_odometry_is_that_of_a_metre():
    frames, path = drive(np.radians(2.0), scan_in_a_box(4.0, 4.0))
    features = drive_features(frames, path)
    assert features["odometry_deg_per_m"] == pytest.approx(2.0)
    assert features["longest_unknown_m"] == pytest.approx(20.0, abs=0.5)
    assert features["scan_determined_share"] == 1.0
    assert drive_features(drive(0.0, scan_in_a_box(100.0, 2.0))[0], path)["scan_determined_share"] == 0.0


def test_frames_between_scans_do_not_count():
    frames, path = drive(0.0, scan_in_a_box(4.0, 4.0))
    between = [Frame(stamp=0.5, odometry=np.array([9.0, 9.0, 1.0]))]
    assert drive_features([*frames[:5], *between, *frames[5:]], path) == drive_features(frames, path)


def test_a_second_lap_is_known():
    angle = np.arange(0.0, 4.0 * np.pi, 0.05)  # two laps of radius 10 m, steps of 0.5 m
    lap = 10.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    assert longest_unknown(lap) == pytest.approx(2.0 * np.pi * 10.0 - 2.0, abs=1.0)
