# SPDX-License-Identifier: MIT
"""A filter that was saved and read again goes on as if nothing had happened."""

from __future__ import annotations

import numpy as np
import pytest

from slam import FilterConfig, GMapping, Scan, load_checkpoint, save_checkpoint
from slam.checkpoint import CheckpointError
from slam.config import AdaptConfig

ANGLES = np.linspace(-np.pi, np.pi, 90, endpoint=False)


def scan_at(pose: np.ndarray, rng: np.random.Generator) -> Scan:
    """Ranges in a room of 8 x 6 m, with noise."""
    directions = ANGLES + pose[2]
    with np.errstate(divide="ignore"):
        x = np.where(np.cos(directions) > 0, 5.0 - pose[0], -3.0 - pose[0]) / np.cos(directions)
        y = np.where(np.sin(directions) > 0, 3.0 - pose[1], -3.0 - pose[1]) / np.sin(directions)
    return Scan(ranges=np.minimum(x, y) + rng.normal(0, 0.02, len(ANGLES)), angles=ANGLES, range_max=20.0)


def drive(mapper: GMapping, start: int, stop: int) -> None:
    for k in range(start, stop):
        odometry = np.array([0.05 * k, 0.3 * np.sin(0.1 * k), 0.2 * np.sin(0.05 * k)])
        mapper.process(odometry, scan_at(odometry, np.random.default_rng(k)))


FIXED = FilterConfig(particles=6)
ADAPTIVE = FilterConfig(
    adapt=AdaptConfig(count="kld", min_particles=3, position=0.02, heading=0.02, error=1.0, resize_factor=1.1)
)
"""With bins so small that the count changes before and after the filter is saved."""


@pytest.mark.parametrize("config", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
@pytest.mark.parametrize("when", [0, 1, 17, 30])
def test_a_resumed_filter_equals_the_uninterrupted_one_bit_for_bit(tmp_path, when, config):
    whole, first = GMapping(config, seed=5), GMapping(config, seed=5)
    drive(whole, 0, 40)
    drive(first, 0, when)
    save_checkpoint(first, tmp_path / "half.npz")
    resumed = load_checkpoint(tmp_path / "half.npz", threads=1)
    drive(resumed, when, 40)
    for i in range(len(whole.poses)):
        assert resumed.path(i).tobytes() == whole.path(i).tobytes()
        assert resumed.map(i).probability.tobytes() == whole.map(i).probability.tobytes()
    assert resumed.weights.tobytes() == whole.weights.tobytes()
    assert resumed.update_scans.tolist() == whole.update_scans.tolist()


def test_saving_changes_nothing_and_leaves_no_other_file(tmp_path):
    mapper, twin = GMapping(FilterConfig(particles=3), seed=1), GMapping(FilterConfig(particles=3), seed=1)
    for k in range(10):
        drive(mapper, k, k + 1)
        drive(twin, k, k + 1)
        save_checkpoint(mapper, tmp_path / "state.npz")
    assert mapper.path().tobytes() == twin.path().tobytes()
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


def test_damaged_files_are_named(tmp_path):
    mapper = GMapping(FilterConfig(particles=2))
    drive(mapper, 0, 5)
    save_checkpoint(mapper, tmp_path / "good.npz")
    data = (tmp_path / "good.npz").read_bytes()
    for name, content in (("cut", data[: len(data) // 2]), ("empty", b""), ("text", b"hello")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CheckpointError, match=name):
            load_checkpoint(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        load_checkpoint(tmp_path / "absent")
