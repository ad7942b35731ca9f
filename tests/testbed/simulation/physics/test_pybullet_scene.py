# SPDX-License-Identifier: MIT
"""Scenes of PyBullet are used again: as good as new, and memory stays where it is."""

import types
from pathlib import Path

import numpy as np
import pytest

from slam.se2 import between
from testbed.presets import load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from testbed.simulation.physics import pybullet_scene
from testbed.simulation.physics.backend import STEP_RATE, AccelerationLimits
from testbed.simulation.physics.pybullet import PyBulletBackend
from tests.testbed.simulation.small_worlds import room
from worlds import Box, load

pytest.importorskip("pybullet")
LIMITS = AccelerationLimits(0.5, 3.0)


@pytest.fixture(autouse=True)
def _no_scenes_of_others(monkeypatch):
    monkeypatch.setattr(pybullet_scene, "_idle", [])


def drive(backend: PyBulletBackend) -> list[np.ndarray]:
    """Into a wall and back off."""
    legs = [backend.drive(*command, 2 * STEP_RATE) for command in ((0.4, 0.3), (0.5, 0.0), (-0.2, -1.0))]
    assert any(leg.contact for leg in legs)
    return [array for leg in legs for array in (leg.poses, leg.wheels)]


def test_a_scene_that_was_used_gives_the_same_bits_as_a_new_one():
    world, robot = room(boxes=[Box(x=0.7, y=0.1, width=0.2, depth=1.0)]), load_robot("create3")
    runs, clients = [], []
    for _ in range(3):
        backend = PyBulletBackend(world, robot, LIMITS)
        clients.append(backend._scene)
        runs.append(drive(backend))
        backend.close()
    assert clients[0] is clients[1] is clients[2]
    new = PyBulletBackend(world, robot, LIMITS)
    second = PyBulletBackend(world, robot, LIMITS)  # the first is in use
    assert new._scene is clients[0]
    assert second._scene is not new._scene
    runs.append(drive(second))
    for run in runs[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(run, runs[0], strict=True))


def test_rays_in_lists_are_the_same_bits_as_in_arrays():
    """Wheels that were built without numpy take lists only."""
    backend = PyBulletBackend(load("office"), load_robot("create3"), LIMITS)
    arguments = np.tile([3.0, 5.5], (360, 1)), np.linspace(-np.pi, np.pi, 360), 12.0, 0.2
    in_arrays = backend.cast(*arguments)
    backend._scene._takes_arrays = False
    seen = []
    rays = backend._scene._p.rayTestBatch
    backend._scene._p = types.SimpleNamespace(rayTestBatch=lambda *ends, **o: seen.append(ends) or rays(*ends, **o))
    in_lists = backend.cast(*arguments)
    assert all(isinstance(end, list) for ends in seen for end in ends)
    for first, second in zip(in_arrays, in_lists, strict=True):
        np.testing.assert_array_equal(first, second)


def test_few_scenes_are_kept_one_per_world_and_robot():
    robots = [load_robot(name) for name in ("create3", "burger")]
    scenes = []
    for world in (room(), room(half=4.0), room(half=6.0)):
        for robot in robots:
            backend = PyBulletBackend(world, robot, LIMITS)
            scenes.append(backend._scene)
            backend.close()
            backend.close()
    assert len(set(map(id, scenes))) == 6
    assert pybullet_scene._idle == scenes[-4:]


def test_another_start_reuses_the_scene():
    robot, scenes, relative = load_robot("create3"), [], []
    for start in ((0.0, 0.0, 0.0), (-2.0, 1.0, 2.5)):
        backend = PyBulletBackend(room(start=start), robot, LIMITS)
        scenes.append(backend._scene)
        poses = np.concatenate([backend.drive(0.0, 0.0, 1).poses, backend.drive(0.3, 0.4, 2 * STEP_RATE).poses])
        np.testing.assert_allclose(poses[0], start, atol=1e-3)
        relative.append(between(poses[0], poses))
        backend.close()
    assert scenes[0] is scenes[1]
    np.testing.assert_allclose(relative[0], relative[1], atol=2e-3)


def resident_memory() -> float:
    """[MB]"""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no /proc to read the memory from")
@pytest.mark.parametrize("backend", ["pybullet", "fast"])
def test_memory_is_flat_over_many_simulations_in_one_process(backend):
    """Each mesh of the office that leaked would take 1.3 MB."""
    office, before = load("office"), 0.0
    for seed in range(80):
        with simulate(
            office, SimulationConfig(backend=backend, duration=0.2, seeds=RunSeeds.from_seed(seed))
        ) as simulation:
            assert sum(1 for _ in simulation) > 2
        if seed == 19:
            before = resident_memory()
    assert resident_memory() - before < 10.0
