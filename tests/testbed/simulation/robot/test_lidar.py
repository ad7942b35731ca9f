# SPDX-License-Identifier: MIT
"""Each layer of the lidar alone, by its statistics."""

import dataclasses
import math

import numpy as np
import pytest

from testbed.presets import LidarPreset, Mount
from testbed.simulation.physics.backend import Hits
from testbed.simulation.robot.lidar import Lidar, LidarLayers

NUMBERS = {
    "beams": 1000, "field_of_view_deg": 360.0, "scan_rate": 10.0, "range_min": 0.2, "range_max": 10.0,
    "noise_floor": 0.01, "noise_share": 0.01, "bias_floor": 0.02, "bias_share": 0.01, "angle_noise_deg": 0.1,
    "range_step": 0.25, "dropout": 0.1, "grazing_deg": 10.0, "short_return_rate": 0.05, "spot_deg": 0.18,
    "beam_jitter": 0.05,
}  # fmt: skip
PRESET = LidarPreset(name="test", title="test", sources=dict.fromkeys(NUMBERS, "assumed"), **NUMBERS)


def ranges(layer, distances, incidence=math.pi / 2, scans=20, seed=0):
    """Readings (scans, beams) with one layer on, of beams that meet surfaces at `distances`."""
    layers = dataclasses.replace(LidarLayers.none(), **({layer: True} if layer else {}))
    lidar = Lidar(PRESET, Mount(), layers, np.random.default_rng(seed))
    distances = np.broadcast_to(np.asarray(distances, dtype=float), (1000,))
    return np.stack([scan(lidar, distances, incidence) for _ in range(scans)])


def scan(lidar, distances, incidence=math.pi / 2):
    """Readings (beams,) of the lidar's next scan."""
    lidar.sweep()
    return lidar.ranges(Hits(distances, np.full(len(distances), math.sin(incidence))))


def test_without_layers_readings_are_exact_and_limits_half_open():
    assert np.all(ranges(None, 3.3) == 3.3)
    assert np.all(ranges(None, 0.2) == 0.2)
    assert np.all(ranges(None, 0.199) == -np.inf)
    assert np.all(ranges(None, 10.0) == np.inf)
    assert np.all(ranges(None, np.inf) == np.inf)


@pytest.mark.parametrize(("distance", "sigma"), [(0.5, 0.01), (1.0, 0.01), (4.0, 0.04)])
def test_range_noise_is_the_larger_of_floor_and_share(distance, sigma):
    errors = ranges("range_noise", distance) - distance
    assert np.std(errors) == pytest.approx(sigma, rel=0.03)
    assert abs(np.mean(errors)) < 4 * sigma / math.sqrt(errors.size)


def test_bias_stays_for_a_run_and_is_drawn_evenly():
    assert np.all(ranges("bias", 5.0) == ranges("bias", 5.0)[0, 0])
    errors = np.array([ranges("bias", 5.0, scans=1, seed=seed)[0, 0] - 5.0 for seed in range(500)])
    assert np.abs(errors).max() <= 0.02 + 0.01 * 5.0
    assert np.std(errors) == pytest.approx(math.hypot(0.02, 0.05) / math.sqrt(3.0), rel=0.1)


def test_rounding_dropout_grazing():
    assert np.all(ranges("rounding", 3.3) == 3.25)
    assert np.isnan(ranges("dropout", 3.0)).mean() == pytest.approx(0.1, abs=0.01)
    assert np.all(ranges("grazing", 3.0, incidence=math.radians(9.0)) == np.inf)
    assert np.all(ranges("grazing", 3.0, incidence=math.radians(11.0)) == 3.0)


def test_short_returns_come_from_anywhere_along_the_beam():
    readings = ranges("short_returns", 8.0, scans=50)
    short = readings[readings != 8.0]
    assert short.size / readings.size == pytest.approx(-math.expm1(-0.05 * 8.0), rel=0.05)
    valid = short[np.isfinite(short)]
    assert valid.max() < 8.0
    assert np.mean(valid) == pytest.approx((8.0 + 0.2) / 2, rel=0.05)
    nothing_there = ranges("short_returns", np.inf)
    assert np.isfinite(nothing_there).mean() == pytest.approx(-math.expm1(-0.05 * 10.0), rel=0.1)


def test_short_returns_lie_in_front_of_the_surface():
    both = dataclasses.replace(LidarLayers.none(), grazing=True, short_returns=True)
    lidar = Lidar(PRESET, Mount(), both, np.random.default_rng(0))
    readings = np.concatenate([scan(lidar, np.full(1000, 3.0), math.radians(1.0)) for _ in range(20)])
    short = readings[np.isfinite(readings)]
    assert short.size > 1000
    assert short.max() < 3.0


def test_mixed_pixels_lie_between_both_surfaces_of_an_edge():
    stairs = np.where(np.arange(1000) % 10 < 5, 2.0, 4.0)
    readings = ranges("mixed_pixels", stairs, scans=100)
    moved = readings != stairs
    assert np.all(moved.any(axis=0) == (stairs != np.roll(stairs, -1)))
    assert np.all((readings[moved] > 2.0) & (readings[moved] < 4.0))
    assert moved[:, 4].mean() == pytest.approx(0.5 * 0.18 / 0.36, abs=0.1)  # half a spot of a step of 0.36 degrees
    assert np.all(ranges("mixed_pixels", np.linspace(2.0, 3.0, 1000))[:, :-1] == np.linspace(2.0, 3.0, 1000)[:-1])


def test_angle_noise_moves_beams_but_not_reported_angles():
    lidar = Lidar(PRESET, Mount(), dataclasses.replace(LidarLayers.none(), angle_noise=True), np.random.default_rng(0))
    sweeps = [lidar.sweep() for _ in range(20)]
    noise = np.concatenate([sweep.true_angles - sweep.angles for sweep in sweeps])
    assert np.std(noise) == pytest.approx(math.radians(0.1), rel=0.03)
    assert np.array_equal(sweeps[0].angles, PRESET.angles())


def test_beam_count_varies_about_the_nominal_one():
    lidar = Lidar(PRESET, Mount(), dataclasses.replace(LidarLayers.none(), beam_count=True), np.random.default_rng(0))
    counts = [len(lidar.sweep().angles) for _ in range(300)]
    assert np.mean(counts) == pytest.approx(1000, abs=12)
    assert np.std(counts) == pytest.approx(50, rel=0.15)


def test_a_full_turn_takes_the_scan_time():
    lidar = Lidar(PRESET, Mount(), LidarLayers(beam_count=False), np.random.default_rng(0))
    sweep = lidar.sweep()
    assert sweep.time_offsets[0] == 0.0
    assert sweep.time_offsets[-1] == pytest.approx(0.1 * 999 / 1000)
    assert sweep.angles[-1] + math.radians(0.36) == pytest.approx(math.pi)


def test_layers_do_not_change_each_others_numbers():
    """Dropout on top of noise loses beams, and leaves the others as they were."""
    lone = dataclasses.replace(LidarLayers.none(), range_noise=True)
    both = dataclasses.replace(lone, dropout=True)
    a, b = (
        scan(Lidar(PRESET, Mount(), layers, np.random.default_rng(3)), np.full(1000, 5.0), 1.0)
        for layers in (lone, both)
    )
    kept = ~np.isnan(b)
    assert 0.8 < kept.mean() < 1.0
    assert np.array_equal(a[kept], b[kept])


def test_mount_error_is_drawn_once_and_not_reported():
    mount = Mount(x=0.1, y=0.2, theta_deg=90.0, error=0.01, error_deg=1.0)
    layers = dataclasses.replace(LidarLayers.none(), mounting=True)
    lidars = [Lidar(PRESET, mount, layers, np.random.default_rng(seed)) for seed in range(400)]
    assert all(lidar.mount == (0.1, 0.2, math.pi / 2) for lidar in lidars)
    errors = np.array([lidar.true_mount for lidar in lidars]) - lidars[0].mount
    np.testing.assert_allclose(errors.std(axis=0), [0.01, 0.01, math.radians(1.0)], rtol=0.12)
    exact = Lidar(PRESET, mount, LidarLayers.none(), np.random.default_rng(0))
    assert tuple(exact.true_mount) == exact.mount


def test_a_lidar_ahead_of_its_stated_place_is_not_reported():
    mount = Mount(x=0.1, offset_x=0.09)
    lidar = Lidar(PRESET, mount, dataclasses.replace(LidarLayers.none(), mounting=True), np.random.default_rng(0))
    assert lidar.mount == (0.1, 0.0, 0.0)
    assert lidar.true_mount == pytest.approx([0.19, 0.0, 0.0])
