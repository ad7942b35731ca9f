# SPDX-License-Identifier: MIT
"""The particles of a system that has some are kept as they were at each scan, and drawn in its layer."""

from pathlib import Path

import numpy as np
import pytest

from eval.scoring import Reference
from slam.config import FilterConfig
from testbed.run.run_directory import RunDirectory
from testbed.systems.entrant import ClassSystem
from testbed.systems.errors import SystemFailedError
from testbed.systems.execute import Recorded, execute_system
from testbed.systems.feeding import feed
from testbed.systems.finding import make_system
from testbed.systems.layers import layers_of
from testbed.systems.particles import MAX_PARTICLES, KeptParticles
from tests.testbed.systems.room import Wheels, frames


class Cloud(Wheels):
    """Three particles ahead of the robot, in an array that it uses again and again."""

    count = 3

    def start(self, lidars, seed):
        super().start(lidars, seed)
        self.poses = np.zeros((self.count, 3))

    def particles(self):
        self.poses[:] = self.seen[-1].odometry
        self.poses[:, 0] += np.arange(self.count)
        return self.poses, np.arange(self.count)


def test_particles_are_kept_as_they_were_at_each_scan():
    drive = frames(5)
    found, _ = feed(Cloud(), "c", drive, seed=0)
    with_scans = [frame for frame in drive if frame.scan is not None]
    assert sorted(found.particles.by_scan) == [0, 1, 2, 3, 4]
    for scan, (poses, weights) in found.particles.by_scan.items():
        expected = with_scans[scan].odometry + np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
        np.testing.assert_array_equal(poses, expected)
        np.testing.assert_array_equal(weights, [0.0, 1.0, 2.0])


def test_of_very_many_particles_every_kth_is_kept():
    class Crowd(Cloud):
        count = 2 * MAX_PARTICLES + 1

    found, _ = feed(Crowd(), "c", frames(1), seed=0)
    poses, weights = found.particles.by_scan[0]
    assert len(poses) <= MAX_PARTICLES
    np.testing.assert_array_equal(weights, np.arange(0, Crowd.count, 3))


class Numbered(Wheels):
    particles = 30


class Undecided(Wheels):
    def particles(self):
        return None


@pytest.mark.parametrize("system", [Wheels(), Numbered(), Undecided(), make_system("odometry")])
def test_a_system_without_particles_has_none(system):
    found, _ = feed(system, "w", frames(3), seed=0)
    assert found.particles.by_scan == {}


def with_particles(value):
    class Wrong(Wheels):
        def particles(self):
            return value() if callable(value) else value

    return Wrong()


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        (3, "particles returned a int, expected"),
        ((np.zeros((4, 2)), np.ones(4)), r"particles returned arrays of shapes \(4, 2\) and \(4,\), expected"),
        ((np.zeros((4, 3)), np.ones(3)), r"particles returned arrays of shapes \(4, 3\) and \(3,\), expected"),
        ((np.full((4, 3), np.nan), np.ones(4)), "particles returned numbers that are not finite"),
        ((np.zeros((4, 3)), -np.ones(4)), "particles returned numbers that are not finite, or below zero"),
        (lambda: 1 / 0, "particles raised ZeroDivisionError: division by zero, expected"),
    ],
)
def test_what_is_no_particles_is_one_line_that_names_the_scan(given, complaint):
    with pytest.raises(SystemFailedError, match=rf"^w: scan 0 \(0.000 s\): {complaint}"):
        feed(with_particles(given), "w", frames(3), seed=0)


def test_the_filters_of_the_package_show_theirs():
    drive = frames(3)
    found, _ = feed(make_system("gmapping", {"filter": FilterConfig(particles=4), "refine": False}), "g", drive, seed=0)
    assert {len(weights) for _, weights in found.particles.by_scan.values()} == {4}
    single, _ = feed(make_system("scan-matching"), "s", drive, seed=0)
    assert single.particles.by_scan == {}  # one particle is no cloud


def test_a_layer_has_its_particles_in_the_frame_of_its_path(tmp_path: Path):
    """The first particle is where the system says that it is, and the path is moved to the frame of the truth."""
    drive = frames(12)
    recorded = Recorded.of(drive, 0, Reference())
    _, found = execute_system(ClassSystem(Cloud), recorded, RunDirectory.create(tmp_path / "c"), {"settings": {}})
    (layer,) = layers_of([tmp_path / "c"], drive, {"c": found.particles})
    assert np.abs(layer.poses - found.dense[found.at_scans].poses).max() > 0.1
    assert sorted(layer.particles) == layer.rows.tolist()
    for scan, (poses, weights) in layer.particles.items():
        np.testing.assert_allclose(poses[0], layer.poses[scan], atol=1e-6)  # of a file with so many digits
        assert np.hypot(*(poses[2] - poses[0])[:2]) == pytest.approx(2.0)
        np.testing.assert_array_equal(weights, found.particles.by_scan[scan][1])
    (without,) = layers_of([tmp_path / "c"], drive, {"another": KeptParticles()})
    assert without.particles == {}
