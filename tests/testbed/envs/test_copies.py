# SPDX-License-Identifier: MIT
"""A pickled or copied environment has the same future as the original, bit for bit."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import testbed  # noqa: F401  # registers the environments
from testbed.envs import GeneratedWorlds
from tests.testbed.simulation.small_worlds import room
from worlds import Box

PLACE = room(half=3.0, boxes=[Box(x=1.0, y=1.5, width=0.4, depth=3.0)])
COPIES = {"pickle": lambda env: pickle.loads(pickle.dumps(env)), "deepcopy": copy.deepcopy}
ACTIONS = np.random.default_rng(0).uniform([-0.2, -1.0], [1.0, 1.0], (30, 2)).astype(np.float32)


def make(name, backend, world=PLACE):
    if backend == "pybullet":
        pytest.importorskip("pybullet")
    settings = {"particles": 3} if name == "Explore" else {}
    return gym.make(f"testbed/{name}-v0", world=world, beams=40, backend=backend, **settings)


def drive(env, actions):
    steps = []
    for action in actions:
        steps.append(env.step(action))
        if steps[-1][2]:
            steps.append(env.reset())
    return steps


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("backend", ["fast", "pybullet"])
@pytest.mark.parametrize("name", ["Drive", "Explore"])
def test_a_copy_in_mid_episode_has_the_same_future(name, backend, how):
    env = make(name, backend)
    env.reset(seed=3)
    drive(env, ACTIONS[:12])
    twin = COPIES[how](env)
    expected = [*drive(env, ACTIONS[12:]), env.reset(seed=4), *drive(env, ACTIONS[:5])]
    found = [*drive(twin, ACTIONS[12:]), twin.reset(seed=4), *drive(twin, ACTIONS[:5])]
    assert data_equivalence(expected, found, exact=True)
    env.close()
    twin.close()


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("backend", ["fast", "pybullet"])
@pytest.mark.parametrize("name", ["Drive", "Explore"])
def test_a_copy_before_the_first_episode_works_as_well(name, backend, how):
    worlds = GeneratedWorlds(size=(8.0, 8.0), clutter=0.0)
    env = make(name, backend, worlds)
    twin = COPIES[how](env)
    assert data_equivalence(env.reset(seed=5), twin.reset(seed=5), exact=True)
    assert data_equivalence(drive(env, ACTIONS[:5]), drive(twin, ACTIONS[:5]), exact=True)
    env.close()
    twin.close()


@pytest.mark.parametrize("how", COPIES)
def test_a_copy_of_many_robots_has_the_same_future(how):
    envs = gym.make_vec("testbed/Drive-v0", num_envs=3, world=PLACE, beams=40)
    envs.reset(seed=1)
    for action in ACTIONS[:6]:
        envs.step(np.tile(action, (3, 1)))
    twin = COPIES[how](envs)
    for action in ACTIONS[6:]:
        assert data_equivalence(envs.step(np.tile(action, (3, 1))), twin.step(np.tile(action, (3, 1))), exact=True)


def test_a_copy_does_not_touch_the_original():
    env = make("Drive", "fast")
    env.reset(seed=3)
    alone = copy.deepcopy(env)
    drive(alone, ACTIONS)
    alone.close()
    fresh = make("Drive", "fast")
    fresh.reset(seed=3)
    assert data_equivalence(drive(env, ACTIONS[:5]), drive(fresh, ACTIONS[:5]), exact=True)


def test_a_closed_environment_stays_closed_in_its_copies():
    env = make("Drive", "pybullet")
    env.reset(seed=3)
    env.close()
    with pytest.raises(gym.error.ClosedEnvironmentError):
        copy.deepcopy(env).reset()
