# SPDX-License-Identifier: MIT
"""Many robots in one process: the same as single environments, whatever the autoreset mode."""

import copy
import time

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import testbed  # noqa: F401  # registers the environments
from testbed.envs import GeneratedWorlds
from tests.testbed.simulation.small_worlds import room

SETTINGS = {"world": room(half=1.2), "beams": 24}
ENVS = 3


def make(mode=AutoresetMode.NEXT_STEP, envs=ENVS, **settings):
    return gym.make_vec("testbed/Drive-v0", num_envs=envs, autoreset_mode=mode, **SETTINGS | settings)


def make_sync(mode, envs=ENVS, max_episode_steps=1000, **settings):
    return gym.make_vec(
        "testbed/Drive-v0", num_envs=envs, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode},
        max_episode_steps=max_episode_steps, **SETTINGS | settings,
    )  # fmt: skip


def actions(steps, envs=ENVS):
    return np.random.default_rng(1).uniform((0.2, -0.5), 1.0, (steps, envs, 2)).astype(np.float32)


def plain(returned):
    """The same with object arrays as lists, which compare."""
    if isinstance(returned, dict):
        return {key: plain(value) for key, value in returned.items()}
    if isinstance(returned, tuple | list):
        return [plain(value) for value in returned]
    if isinstance(returned, np.ndarray) and returned.dtype == object:
        return [plain(value) for value in returned]
    return returned


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("limit", [9, 1000])
def test_resets_steps_and_infos_are_those_of_single_environments(mode, limit):
    ours, theirs = make(mode, max_episode_steps=limit), make_sync(mode, max_episode_steps=limit)
    assert data_equivalence(plain(ours.reset(seed=4)), plain(theirs.reset(seed=4)), exact=True)
    ended = 0
    for chosen in actions(80):
        a, b = ours.step(chosen), theirs.step(chosen)
        assert data_equivalence(plain(a), plain(b), exact=True)
        over = a[2] | a[3]
        ended += int(over.sum())
        if mode is AutoresetMode.DISABLED and over.any():
            # the synchronous one takes the mask out of the options
            a, b = (envs.reset(options={"reset_mask": over.copy()}) for envs in (ours, theirs))
            assert data_equivalence(plain(a), plain(b), exact=True)
    assert ended >= 5


def test_seeds_by_list_and_generated_worlds():
    settings = {"world": GeneratedWorlds(kinds=("maze", "rooms"), size=(8.0, 8.0)), "envs": 2}
    ours, theirs = make(**settings), make_sync(AutoresetMode.NEXT_STEP, **settings)
    assert data_equivalence(ours.reset(seed=[7, 3]), theirs.reset(seed=[7, 3]), exact=True)
    for chosen in actions(40, 2):
        assert data_equivalence(ours.step(chosen), theirs.step(chosen), exact=True)
    assert ours.np_random_seed == theirs.np_random_seed == (7, 3)
    with pytest.raises(ValueError, match="expected 2 seeds"):
        ours.reset(seed=[1])


def test_what_is_returned_is_never_changed_later():
    envs = make()
    kept = [envs.reset(seed=0)]
    copies = [copy.deepcopy(kept[0])]
    for chosen in actions(30):
        kept.append(envs.step(chosen))
        copies.append(copy.deepcopy(kept[-1]))
    assert data_equivalence(kept, copies, exact=True)
    kept[-1][0]["scan"][:] = -1.0
    assert envs.step(actions(1)[0])[0]["scan"].min() >= 0.0


def test_bad_calls_are_refused_and_nothing_moves():
    envs = make()
    with pytest.raises(ResetNeeded):
        envs.step(actions(1)[0])
    envs.reset(seed=0)
    for bad in (np.zeros((2, 2)), np.full((ENVS, 2), np.nan), np.full((ENVS, 2), 1.5)):
        with pytest.raises(InvalidAction):
            envs.step(bad)
    after = envs.step(actions(1)[0])
    envs.reset(seed=0)
    assert data_equivalence(after, envs.step(actions(1)[0]), exact=True)
    for mask in ([True] * ENVS, np.ones(ENVS), np.ones(2, bool), np.zeros(ENVS, bool)):
        with pytest.raises(ValueError, match="reset_mask"):
            envs.reset(options={"reset_mask": mask})
    envs.close()
    with pytest.raises(ClosedEnvironmentError):
        envs.reset()
    with pytest.raises(ValueError, match="fast backend"):
        make(backend="pybullet")
    with pytest.raises(ValueError, match="num_envs"):
        make(envs=0)


def test_without_autoreset_ended_episodes_must_be_reset():
    envs = make(AutoresetMode.DISABLED, max_episode_steps=2)
    envs.reset(seed=0)
    for _ in range(2):
        envs.step(np.zeros((ENVS, 2), np.float32))
    with pytest.raises(ResetNeeded, match=r"\[0, 1, 2\]"):
        envs.step(np.zeros((ENVS, 2), np.float32))


def test_pictures_of_all_worlds():
    envs = make(render_mode="rgb_array")
    envs.reset(seed=0)
    envs.step(actions(1)[0])
    pictures = envs.render()
    assert len(pictures) == ENVS
    assert not np.array_equal(pictures[0], pictures[1])


@pytest.mark.benchmark
def test_twenty_thousand_steps_a_second_on_one_core():
    envs = gym.make_vec("testbed/Drive-v0", num_envs=64)  # 180 beams, office
    envs.reset(seed=0)
    chosen = np.random.default_rng(0).uniform(-0.2, 0.6, (300, 64, 2)).astype(np.float32)
    envs.step(chosen[0])
    begin = time.process_time()
    for step in chosen:
        envs.step(step)
    assert chosen.shape[0] * 64 / (time.process_time() - begin) > 20_000
