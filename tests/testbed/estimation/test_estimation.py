# SPDX-License-Identifier: MIT
"""Several lidars on one robot: what the filter is given, and what it makes of it."""

import dataclasses
import math

import numpy as np
import pytest

from eval.trajectory.association import associate
from eval.trajectory.errors import absolute_error
from slam import se2
from slam.config import FilterConfig
from slam.scan import Scan
from testbed.estimation.estimation import Estimation
from testbed.frame import Frame
from testbed.presets import Mount, load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from worlds import load

FRONT, REAR = (0.2, 0.0, 0.0), (-0.2, 0.1, math.pi)


def scan(stamp: float, mount: tuple[float, float, float]) -> Scan:
    angles = np.linspace(-1.5, 1.5, 50)
    return Scan(ranges=2.0 + 0.3 * np.cos(3 * angles), angles=angles, range_max=9.0, stamp=stamp, mount=mount)


def test_the_newest_scan_of_the_other_lidar_is_processed_too(monkeypatch):
    estimation = Estimation(FilterConfig(particles=2), seed=0)
    given = []
    process = estimation.mapper.process
    monkeypatch.setattr(
        estimation.mapper, "process", lambda odometry, scans, **rest: given.append(scans) or process(odometry, scans)
    )
    updated = []
    for k in range(40):
        name, mount = (("front", FRONT), ("rear", REAR))[k % 2]
        odometry = np.array([0.05 * k, 0.02 * k, 0.03 * k])
        frame = Frame(stamp=0.1 * k, odometry=odometry, scan=scan(0.1 * k, mount), lidar=name)
        report = estimation.process(frame)
        assert given[-1][0] is frame.scan
        for other in given[-1][1:]:
            before = estimation.frames[-2]
            assert other.ranges is before.scan.ranges
            assert other.stamp == frame.stamp  # the place has been seen to
            there = se2.compose(before.odometry, before.scan.mount)
            np.testing.assert_allclose(se2.compose(odometry, other.mount), there, atol=1e-12)
        if report.updated:
            updated.append((k, len(given[-1])))
        elif updated[-1][0] < k - 1:
            assert len(given[-1]) == 2
        else:
            assert len(given[-1]) == 1  # the filter has just had the other
    assert len(updated) > 4
    assert all(count == 2 for _, count in updated[1:])


def ate(config: SimulationConfig) -> float:
    """Error of the estimate [m] of a drive through the apartment."""
    estimation = Estimation(FilterConfig(particles=8), seed=config.seeds.seed)
    with simulate(load("apartment"), config) as simulation:
        for frame in simulation:
            estimation.process(frame)
    estimate = estimation.refined(estimation.filtered()).at_scans
    return absolute_error(associate(estimate, estimation.trajectory_at_scans("truth"))).translation.rmse


@pytest.mark.slow
def test_two_half_lidars_map_as_well_as_one_full_lidar():
    robot, whole = load_robot("create3"), load_lidar("rplidar_a2").model_copy(update={"beams": 360})
    half = whole.model_copy(update={"beams": 180, "field_of_view_deg": 179.0})
    mounts = {
        "lidar_mount": Mount(x=0.05, height=0.19),
        "further_lidar_mounts": (Mount(name="rear_laser", x=-0.1, theta_deg=180.0, height=0.19),),
    }
    one, two = [], []
    for seed in range(3):
        config = SimulationConfig(robot=robot, lidar=whole, backend="fast", seeds=RunSeeds.from_seed(seed))
        one.append(ate(config))
        both = dataclasses.replace(config, robot=robot.model_copy(update=mounts), lidar=half, further_lidars=(half,))
        two.append(ate(both))
    assert np.mean(two) < 1.3 * np.mean(one) + 0.003
