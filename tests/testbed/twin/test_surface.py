# SPDX-License-Identifier: MIT
"""How rough surfaces are is found in a drive where it is known."""

import numpy as np
import pytest
import shapely

from slam import se2
from testbed.formats import Log
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import LidarLayers, SimulationConfig, SurfaceConfig, simulate
from testbed.twin.returns import compare_scans
from testbed.twin.surface import _mixture, _pairs, estimate_surface
from worlds import load

WORLD = load("apartment")
LIDAR = load_lidar("lms200").model_copy(update={"scan_rate": 10.0})
NOISE = (LIDAR.noise_floor, LIDAR.noise_share, LIDAR.range_step)


def pieces_of(world):
    """The walls in pieces of a decimetre, as those of twins are, (n, 4)."""
    lines = shapely.linestrings(world.boundary_segments().reshape(-1, 2, 2))
    ends = [shapely.get_coordinates(line) for line in shapely.segmentize(lines, 0.1)]
    return np.concatenate([np.column_stack([points[:-1], points[1:]]) for points in ends])


def found(surface, *, seed=1, scans=None, off_path=lambda n: np.zeros((n, 3))):
    """What is estimated from a drive with that surface, and with the noise of the range alone."""
    layers = LidarLayers(**{**vars(LidarLayers.none()), "range_noise": True, "rounding": True})
    config = SimulationConfig(
        robot=load_robot("create3"),
        lidar=LIDAR,
        backend="fast",
        lidar_layers=layers,
        surface=surface,
        seeds=RunSeeds.from_seed(seed),
    )
    with simulate(WORLD, config) as simulation:
        frames = [frame for block in simulation.blocks(512) for frame in block.frames() if frame.scan is not None]
    table = Log.from_frames(frames, path="drive.log", format="made").table
    path = se2.compose(np.array([frame.truth for frame in frames]), off_path(len(frames)))
    compared = compare_scans(WORLD, table, path, np.arange(len(frames))[:scans])
    return estimate_surface(compared, pieces_of(WORLD), NOISE)


def test_roughness_and_scatter_are_told_apart():
    """A drive shares the waves of one field, so that its roughness is that of the field to a fifth."""
    estimate = found(SurfaceConfig(roughness=0.015, scatter=0.04, scatter_share=0.1))
    assert estimate.roughness == pytest.approx(0.015, rel=0.2)
    assert estimate.scatter == pytest.approx(0.04, rel=0.25)
    assert estimate.scatter**2 * estimate.scatter_share == pytest.approx(0.04**2 * 0.1, rel=0.25)


def test_errors_of_the_path_are_nothing_rough():
    def off_path(scans):
        """A centimetre and a third of a degree, of another sign every 40 scans, so that neighbours share them."""
        return np.where(np.arange(scans) // 40 % 2, 1.0, -1.0)[:, None] * [0.01, 0.01, 0.006]

    estimate = found(SurfaceConfig(roughness=0.01), off_path=off_path)
    assert estimate.roughness == pytest.approx(0.01, rel=0.25)


def test_smooth_walls_are_found_smooth():
    estimate = found(SurfaceConfig())
    assert estimate.roughness < 0.003
    assert estimate.scatter**2 * estimate.scatter_share < 0.003**2


def test_of_too_few_scans_nothing_is_said():
    assert found(SurfaceConfig(roughness=0.05), scans=3) == SurfaceConfig()
    assert estimate_surface([], pieces_of(WORLD), NOISE) == SurfaceConfig()


def test_size_and_share_come_from_the_moments():
    """N(0, own), a tenth of them N(0, own + s^2): differences of two, divided by sqrt(2)."""
    rng = np.random.default_rng(3)
    values = 0.005 * rng.standard_normal((2, 400_000))
    values += np.where(rng.random(values.shape) < 0.1, 0.04, 0.0) * rng.standard_normal(values.shape)
    apart = (values[0] - values[1]) / np.sqrt(2.0)
    size, share = _mixture(np.mean(apart**2), np.mean(apart**4), 0.005**2)
    assert size == pytest.approx(0.04, rel=0.03)
    assert share == pytest.approx(0.1, rel=0.06)
    assert _mixture(1e-5, 3e-10, 2e-5) == (0.0, 0.0)


def test_pairs_are_of_one_place_one_view_and_two_scans():
    """Columns: how far off, place x, y, direction, length, scan."""
    first = [0.01, 1.0, 1.0, 0.5, 3.0, 0.0]
    others = {
        "same": [0.02, 1.005, 1.005, 0.51, 3.1, 1.0],
        "place": [0.02, 1.1, 1.0, 0.51, 3.1, 1.0],
        "direction": [0.02, 1.005, 1.005, 0.6, 3.1, 1.0],
        "length": [0.02, 1.005, 1.005, 0.51, 3.5, 1.0],
        "scan": [0.02, 1.005, 1.005, 0.51, 3.1, 0.0],
    }
    paired = {name: len(_pairs(np.array([first, other]))[0]) for name, other in others.items()}
    assert paired == {"same": 1, "place": 0, "direction": 0, "length": 0, "scan": 0}
    one, other, lengths = _pairs(np.array([first, others["same"]]))
    assert (one.item(), other.item(), lengths.item()) == (0.01, 0.02, 3.0)
