# SPDX-License-Identifier: MIT
"""A standard algorithm of a library that people use learns something in a few thousand steps."""

import gymnasium as gym
import numpy as np
import pytest

import testbed  # noqa: F401  # registers the environments
from testbed.envs import DriveReward, GeneratedWorlds

WORLDS = {
    split: GeneratedWorlds(kinds=("rooms",), size=(10.0, 8.0), clutter=0.0, split=split) for split in ("train", "test")
}


def make(split):
    env = gym.make(
        "testbed/Drive-v0", world=WORLDS[split], beams=16, max_episode_steps=150, reward=DriveReward(collision=2.0)
    )
    return gym.wrappers.FlattenObservation(env)


def mean_return(policy, episodes=12):
    """Of deterministic episodes in worlds that were not trained in."""
    env, returns = make("test"), []
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, _ = env.step(policy(observation))
            total, over = total + reward, terminated or truncated
        returns.append(total)
    return float(np.mean(returns))


@pytest.mark.slow
def test_ppo_learns_to_drive_in_worlds_that_it_has_never_seen():
    ppo = pytest.importorskip("stable_baselines3", reason="the extra rl is not installed").PPO
    torch = pytest.importorskip("torch")
    torch.set_num_threads(1)
    from stable_baselines3.common.env_util import make_vec_env

    envs = make_vec_env(lambda: make("train"), n_envs=4, seed=0)
    model = ppo("MlpPolicy", envs, n_steps=256, batch_size=128, learning_rate=1e-3, gamma=0.97, seed=0, device="cpu")

    def policy(observation):
        return model.predict(observation, deterministic=True)[0]

    before = mean_return(policy)
    model.learn(10_000)
    after = mean_return(policy)
    assert after > before + 0.5
