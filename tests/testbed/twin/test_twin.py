# SPDX-License-Identifier: MIT
"""A twin of a simulated drive has the walls, the drive and the sensors that were simulated, and is driven again."""

import dataclasses
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapely

from slam import se2
from slam.config import FilterConfig
from testbed.cli import main
from testbed.datasets import open_dataset
from testbed.formats import Log
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import OdometryConfig, SimulationConfig, SurfaceConfig, simulate
from testbed.twin.reconstruction import reconstruct
from testbed.twin.twin import make_twin, write_twin
from worlds import load

WORLD = load("apartment")
LIDAR = load_lidar("rplidar_a2").model_copy(update={"beams": 180, "scan_rate": 5.0})
ODOMETRY = OdometryConfig(
    systematic=False,
    ticks=False,
    random_translation=0.02,
    random_rotation=math.radians(0.8),
    distance_scale=1.03,
    rotation_scale=0.96,
)


class NoProgress:
    """Shows nothing."""

    def stage(self, text):
        pass

    def step(self, stamp, share, error):
        pass

    def share(self, done):
        pass


@pytest.fixture(scope="module")
def source():
    """The reconstruction of a drive, and the frames of that drive."""
    config = SimulationConfig(
        robot=load_robot("create3"), lidar=LIDAR, backend="fast", odometry=ODOMETRY, seeds=RunSeeds.from_seed(1)
    )
    with simulate(WORLD, config) as simulation:
        frames = list(simulation)
    log = Log.from_frames(frames, path=Path("drive.log"), format="made")
    return reconstruct(log, FilterConfig(particles=8), RunSeeds.from_seed(0), NoProgress(), threads=1), frames


@pytest.fixture(scope="module")
def made(source):
    return make_twin(source[0], "drive")


@pytest.fixture(scope="module")
def written(made, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("twin") / "drive"
    write_twin(made, out, Path("drive.log"))
    return out


def T_world_twin(source):
    """Pose of the twin's frame in the world that was driven, (3,)."""
    reconstruction, frames = source
    return se2.compose(frames[0].truth, se2.inverse(reconstruction.path[0]))


def test_walls_are_those_of_the_world(made, source):
    """Half of all points on the twin's walls are within 4 cm of a true wall, 90 % within 10 cm; the floor is as large
    to 5 %."""
    walls = shapely.multilinestrings(made.world.boundary_segments().reshape(-1, 2, 2))
    points = se2.transform_points(T_world_twin(source), shapely.get_coordinates(shapely.segmentize(walls, 0.02)))
    true = shapely.multilinestrings(WORLD.boundary_segments().reshape(-1, 2, 2))
    away = shapely.distance(shapely.points(points), true)
    assert np.percentile(away, 50) < 0.04
    assert np.percentile(away, 90) < 0.10
    assert made.world.free_space().area == pytest.approx(WORLD.free_space().area, rel=0.05)


def test_the_drive_is_the_one_that_was_recorded(made, source):
    frames = source[1]
    stamps = np.array([frame.stamp for frame in frames])
    times = stamps[0] + 0.05 * np.arange(len(made.route.driven))
    truth = np.array([frame.truth[:2] for frame in frames])
    expected = np.stack([np.interp(times, stamps, column) for column in truth.T], axis=1)
    driven = se2.compose(T_world_twin(source), made.route.driven)[:, :2]
    assert np.sqrt(np.mean(np.sum((driven - expected) ** 2, axis=1))) < 0.1
    assert made.route.contacts == 0


def test_sensors_are_those_that_were_simulated(made):
    assert made.lidar.beams == LIDAR.beams
    assert made.lidar.field_of_view_deg == 360.0
    assert made.lidar.scan_rate == pytest.approx(LIDAR.scan_rate, rel=1e-3)
    assert made.lidar.range_max == LIDAR.range_max
    assert made.lidar.noise_share == pytest.approx(LIDAR.noise_share, rel=0.3)
    assert made.lidar.dropout == pytest.approx(LIDAR.dropout, abs=0.01)
    assert made.robot.lidar_mount.x == pytest.approx(load_robot("create3").lidar_mount.x)
    assert made.robot.lidar_mount.theta_deg == pytest.approx(0.0, abs=1e-6)
    assert made.odometry.distance_scale == pytest.approx(ODOMETRY.distance_scale, abs=0.01)
    assert made.odometry.rotation_scale == pytest.approx(ODOMETRY.rotation_scale, abs=0.01)
    assert made.odometry.random_translation == pytest.approx(ODOMETRY.random_translation, rel=0.5)
    assert made.odometry.random_rotation == pytest.approx(ODOMETRY.random_rotation, rel=0.5)


def test_its_surfaces_are_those_that_were_estimated(made, written):
    settings = tomllib.loads((written / "config.toml").read_text())["settings"]
    assert settings["surface"] == dataclasses.asdict(made.surface)
    assert made.surface != SurfaceConfig()  # mixed readings and grazing beams scatter


def test_each_seed_drives_it_again_with_other_noise(made, written, tmp_path):
    """The drive is the same to the last bit, the odometry is not."""
    arguments = ["simulate", "--config", str(written / "config.toml"), "--count", "2", "--format", "parquet"]
    with pytest.raises(SystemExit) as exit_:
        main([*arguments, "--duration", "10", "--out", str(tmp_path / "data")])
    assert exit_.value.code == 0
    first, second = (open_dataset(tmp_path / "data" / f"drive-{seed:04d}") for seed in (0, 1))
    assert np.array_equal(first.truth, second.truth)
    assert not np.array_equal(first.odometry, second.odometry)
    expected = made.route.driven[np.rint(first.stamps / 0.05).astype(int)]
    assert np.abs(first.truth - expected)[:, :2].max() < 0.02  # the drive begins a 240th of a second later


def test_the_world_can_be_toured_too(written):
    world = load(written / "world.toml", footprint_radius=0.18)
    assert world.tour is not None


@pytest.mark.parametrize("kind", ["existing", "run"])
def test_what_is_no_log_is_refused_in_one_line(kind, tmp_path, capsys):
    run = tmp_path / "run"
    run.mkdir()
    (run / "metrics.json").write_text("{}")
    (run / "config.toml").write_text("[settings]\nworld = 'office'\n")
    out = run if kind == "existing" else tmp_path / "twin"
    with pytest.raises(SystemExit) as exit_:
        main(["twin", str(run), "--out", str(out)])
    assert exit_.value.code == 2
    assert ("exists" if kind == "existing" else "names no log") in capsys.readouterr().err
    assert not (tmp_path / "twin").exists()
