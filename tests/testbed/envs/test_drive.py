# SPDX-License-Identifier: MIT
"""`testbed/Drive-v0`: gymnasium's own checks, complete seeding, and the errors that users meet."""

import resource
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, Error, InvalidAction, ResetNeeded, UnsupportedMode
from gymnasium.utils.env_checker import check_env

import testbed  # noqa: F401  # registers the environments
from slam.se2 import between
from testbed.envs import DriveReward, GeneratedWorlds
from testbed.envs.drive import DriveEnv
from testbed.simulation import LidarLayers
from tests.testbed.simulation.small_worlds import PERFECT_ODOMETRY, room

BACKENDS = ["fast", pytest.param("pybullet", marks=pytest.mark.slow)]


def make(**settings):
    return gym.make("testbed/Drive-v0", **{"world": room(), "beams": 36} | settings)


def episode(env, seed, steps=60):
    """Everything that comes back in one episode of seeded actions."""
    actions = np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, 2)).astype(np.float32)
    returned = [env.reset(seed=seed)]
    for action in actions:
        returned.append(env.step(action))
        if returned[-1][2] or returned[-1][3]:
            break
    return returned


@pytest.mark.parametrize("backend", BACKENDS)
def test_gymnasium_finds_nothing_to_complain_of(backend):
    if backend == "pybullet":
        pytest.importorskip("pybullet")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make("testbed/Drive-v0", backend=backend, render_mode="rgb_array")
        check_env(env.unwrapped)
        env.close()


def test_the_same_seed_gives_the_same_episode_bit_for_bit():
    worlds = GeneratedWorlds(kinds=("rooms", "cave"), count=20)
    first, again, other = (episode(make(world=worlds), seed) for seed in (5, 5, 6))
    assert gym.utils.env_checker.data_equivalence(first, again, exact=True)
    assert not gym.utils.env_checker.data_equivalence(first, other, exact=True)


def test_a_reset_without_a_seed_goes_on_with_the_random_numbers():
    env = make()
    env.reset(seed=3)
    second = env.reset()[0]
    env.reset(seed=3)
    assert gym.utils.env_checker.data_equivalence(second, env.reset()[0], exact=True)
    assert not np.array_equal(second["scan"], env.reset()[0]["scan"])


def test_observations_are_what_a_robot_in_the_room_sees():
    env = make(odometry=PERFECT_ODOMETRY, lidar_layers=LidarLayers.none(), beams=4)
    observation, _ = env.reset(options={"start": (1.0, 0.0, 0.0)})
    mount = env.unwrapped._task.io.setup.robot.lidar_mount.x
    np.testing.assert_allclose(observation["scan"], [6.0 + mount, 5.0, 4.0 - mount, 5.0], atol=1e-5)
    poses, steps = [np.array([1.0, 0.0, 0.0])], []
    for _ in range(15):
        observation, _, _, _, info = env.step(np.array([0.8, 0.3], np.float32))
        poses.append(info["pose"])
        steps.append(observation["odometry"])
    np.testing.assert_allclose(steps, between(np.array(poses[:-1]), np.array(poses[1:])), atol=1e-4)


def test_reward_counts_metres_ahead_turns_and_collisions():
    reward = DriveReward(ahead=2.0, turn=0.5, collision=7.0)
    env = make(reward=reward)
    env.reset(seed=0, options={"start": (4.0, 0.0, 0.0)})
    begin, total = np.array([4.0, 0.0, 0.0]), 0.0
    for _ in range(100):
        _, gain, terminated, truncated, info = env.step(np.array([0.5, 0.0], np.float32))
        total += gain
        if terminated:
            break
    assert terminated
    assert not truncated
    assert info["collided"]
    assert total == pytest.approx(2.0 * (info["pose"][0] - begin[0]) - 7.0)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2, np.float32))


def test_turning_on_the_spot_costs_what_was_turned():
    env = make(reward=DriveReward(turn=0.5))
    before = env.reset(seed=0)[1]["pose"]
    _, reward, _, _, info = env.step(np.array([0.0, 1.0], np.float32))
    assert reward == pytest.approx(-0.5 * (info["pose"][2] - before[2]))
    assert reward < 0.0


@pytest.mark.parametrize(
    "action",
    [np.zeros(3), np.zeros((1, 2)), np.array([np.nan, 0.0]), np.array([0, 1.01]), np.full(2, np.inf), 0.5, "go", None],
)  # fmt: skip
def test_bad_actions_are_refused_and_nothing_moves(action):
    env = make().unwrapped
    env.reset(seed=1)
    with pytest.raises(InvalidAction, match="action must"):
        env.step(action)
    untouched = env.step(np.array([0.5, 0.0], np.float32))
    env.reset(seed=1)
    assert gym.utils.env_checker.data_equivalence(untouched, env.step(np.array([0.5, 0.0], np.float32)), exact=True)


def test_steps_before_reset_and_after_close_are_refused():
    env = make().unwrapped
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2, np.float32))
    env.reset()
    env.close()
    env.close()
    for call in (lambda: env.step(np.zeros(2, np.float32)), env.reset):
        with pytest.raises(ClosedEnvironmentError):
            call()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"world": "atlantis"}, "atlantis"), ({"world": 3}, "option world"), ({"wrold": "loop"}, "wrold"),
        ({"start": (0.0, 0.0)}, "three finite numbers"), ({"start": (np.nan, 0.0, 0.0)}, "three finite numbers"),
        ({"start": "here"}, "three finite numbers"),
        ({"start": (4.95, 0.0, 0.0)}, "option start"), ({"start": (50.0, 0.0, 0.0)}, "option start"),
    ],
)  # fmt: skip
def test_bad_options_are_refused_and_the_episode_goes_on(options, message):
    env = make()
    env.reset(seed=2)
    state = env.unwrapped.np_random.bit_generator.state
    with pytest.raises(Error, match=message):
        env.reset(seed=9, options=options)
    assert env.unwrapped.np_random.bit_generator.state == state
    env.step(np.zeros(2, np.float32))


def test_options_choose_world_and_start_of_one_episode():
    env = make(world=GeneratedWorlds(kinds=("loops",), split="test"))
    env.reset(seed=0, options={"world": 4})
    assert env.unwrapped._task.worlds[0].terrain.world.name == "loops test 4"
    _, info = env.reset(options={"world": "loop", "start": (2.0, 1.0, 0.1)})
    np.testing.assert_allclose(info["pose"], (2.0, 1.0, 0.1))
    env.reset()
    assert env.unwrapped._task.worlds[0].terrain.world.name.startswith("loops test")


def test_start_of_the_world_or_anywhere_with_room():
    fixed = [make(start="world").reset(seed=seed)[1]["pose"] for seed in range(3)]
    assert np.array_equal(fixed, np.zeros((3, 3)))
    env = make()
    poses = np.array([env.reset(seed=seed)[1]["pose"] for seed in range(50)])
    room_left = 5.0 - np.abs(poses[:, :2]).max()
    assert env.unwrapped._task.io.setup.robot.footprint_radius < room_left < 1.0
    assert np.ptp(poses[:, 2]) > 4.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"start": "here"}, "start"), ({"backend": "gazebo"}, "backend"), ({"beams": 0}, "beams"),
        ({"world": "atlantis"}, "atlantis"), ({"robot": "r2d2"}, "r2d2"),
    ],
)  # fmt: skip
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        make(**settings)


def test_unknown_render_modes_are_refused():
    with pytest.raises(UnsupportedMode, match="ascii"):
        DriveEnv(render_mode="ascii")


def test_train_and_test_worlds_differ_and_numbers_repeat():
    train, test = GeneratedWorlds(), GeneratedWorlds(split="test")
    assert train.world(7) == train.world(7)
    assert train.world(7).polygons != test.world(7).polygons
    rng = np.random.default_rng(0)
    assert {GeneratedWorlds(count=3).draw(rng) for _ in range(50)} == {0, 1, 2}
    for bad in ({"kinds": ("castle",)}, {"kinds": ()}, {"count": 0}, {"split": "exam"}, {"size": (1.0, 1.0)}):
        with pytest.raises(ValueError, match=next(iter(bad)).rstrip("s")):
            GeneratedWorlds(**bad)
    with pytest.raises(ValueError, match="world number"):
        GeneratedWorlds(count=3).world(3)


def test_pictures_show_walls_robot_and_trail():
    env = make(render_mode="rgb_array")
    env.reset(seed=0, options={"start": (-2.0, 1.0, 0.0)})
    before = env.render()
    for _ in range(20):
        env.step(np.array([1.0, 0.0], np.float32))
    after = env.render()
    assert before.dtype == np.uint8
    assert before.shape == after.shape
    blue = np.argwhere((after == (30, 90, 180)).all(axis=-1)).mean(axis=0)
    pose = env.step(np.zeros(2, np.float32))[4]["pose"]
    height = after.shape[0]  # 10 m and 0.5 m border on each side, cells of 0.05 m
    np.testing.assert_allclose(blue, (height - (pose[1] + 5.5) / 0.05, (pose[0] + 5.5) / 0.05), atol=3.0)
    assert (after == (150, 190, 240)).all(axis=-1).any()
    assert make().unwrapped.render() is None


@pytest.mark.parametrize(("backend", "resets"), [("fast", 1000), pytest.param("pybullet", 300, marks=pytest.mark.slow)])
def test_memory_is_flat_over_many_resets(backend, resets):
    if backend == "pybullet":
        pytest.importorskip("pybullet")
    env, before = make(backend=backend), 0
    for number in range(resets + 50):
        if number == 50:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        env.reset(seed=number)
        env.step(np.zeros(2, np.float32))
    env.close()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # KiB


@pytest.mark.slow
def test_pybullet_episodes_do_not_depend_on_those_before():
    pytest.importorskip("pybullet")
    env = make(backend="pybullet")
    first = episode(env, seed=5, steps=8)
    for seed in range(6, 12):
        episode(env, seed, steps=2)
    assert gym.utils.env_checker.data_equivalence(first, episode(env, seed=5, steps=8), exact=True)
    env.close()


@pytest.mark.slow
def test_pybullet_environments_work_in_processes_of_their_own():
    pytest.importorskip("pybullet")
    envs = gym.make_vec(
        "testbed:testbed/Drive-v0", num_envs=2, vectorization_mode="async", backend="pybullet", world=room(), beams=36
    )
    observation, _ = envs.reset(seed=0)
    assert observation["scan"].shape == (2, 36)
    for _ in range(5):
        observation, *_ = envs.step(np.full((2, 2), 0.5, np.float32))
    envs.close()
    alone = make(backend="pybullet")
    alone.reset(seed=1)
    for _ in range(5):
        expected, *_ = alone.step(np.full(2, 0.5, np.float32))
    alone.close()
    assert np.array_equal(observation["scan"][1], expected["scan"])
