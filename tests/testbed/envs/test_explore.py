# SPDX-License-Identifier: MIT
"""`testbed/Explore-v0`: gymnasium's checks, the estimate in the observation, the truth in the reward alone."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, Error, InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence

import testbed  # noqa: F401  # registers the environments
from eval.map.grids import grid_from_true_map
from slam.occupancy import OccupancyGrid
from slam.se2 import compose, inverse
from testbed.envs import Crop, ExploreReward, GeneratedWorlds
from testbed.envs.observation.map_score import MapScore
from testbed.exploration import make_explorer
from testbed.simulation import DriverConfig, LidarLayers
from tests.testbed.exploration.hand_drawn_maps import grid_of
from tests.testbed.simulation.small_worlds import PERFECT_ODOMETRY, room
from worlds import Box, true_map

PLACE = room(half=3.0, boxes=[Box(x=1.0, y=1.5, width=0.4, depth=3.0)])


def make(**settings):
    return gym.make("testbed/Explore-v0", **{"world": PLACE, "beams": 120, "particles": 4} | settings)


def drive(env, steps, action=(0.6, 0.3)):
    return [env.step(np.array(action, np.float32)) for _ in range(steps)]


@pytest.mark.parametrize("backend", ["fast", pytest.param("pybullet", marks=pytest.mark.slow)])
def test_gymnasium_finds_nothing_to_complain_of(backend):
    if backend == "pybullet":
        pytest.importorskip("pybullet")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make("testbed/Explore-v0", world=PLACE, beams=60, particles=2, backend=backend)
        check_env(env.unwrapped, skip_render_check=True)
        env.close()


def test_the_same_seed_gives_the_same_episode_bit_for_bit():
    episodes = []
    for seed in (3, 3, 4):
        env = make(world=GeneratedWorlds(kinds=("cave", "rooms"), size=(10.0, 8.0)))
        episodes.append([env.reset(seed=seed), *drive(env, 15)])
    assert data_equivalence(episodes[0], episodes[1], exact=True)
    assert not data_equivalence(episodes[0], episodes[2], exact=True)


def test_observations_tell_the_estimate_and_not_the_truth():
    """Odometry and scan of a world that was moved and turned as a whole: the policy cannot tell."""
    settings = {"odometry": PERFECT_ODOMETRY, "lidar_layers": LidarLayers.none()}
    square = room(half=3.0)
    seen = []
    for start in ((1.0, 0.5, 0.2), (-0.5, 1.0, 0.2 + np.pi / 2.0)):  # the same, turned by a quarter
        env = make(world=square, coverage=1.0, **settings)
        env.reset(seed=0, options={"start": start})
        seen.append(drive(env, 20)[-1][0])
    for name, values in seen[0].items():
        np.testing.assert_allclose(values, seen[1][name], atol=0.02 if name != "map" else 1.0)
    assert np.mean(seen[0]["map"] != seen[1]["map"]) < 0.02


def test_the_observed_map_is_egocentric():
    picture = grid_of("?????\n?...#\n?...#\n?...#\n?????", 20)  # characters of 1 m; the wall from x = 4 m on
    crop = Crop(cells=20, cell=0.1)
    ahead = crop.cut(picture, np.array([3.5, 2.5, 0.0]))
    assert np.all(ahead[0, :, 15:] > 0.9)  # 0.5 m ahead
    assert np.all(ahead[0, :, :15] < 0.2)
    left = crop.cut(picture, np.array([3.5, 2.5, -np.pi / 2.0]))  # looks down: the wall is to the left
    assert np.all(left[0, 15:, :] > 0.9)
    assert np.all(left[0, :15, :] < 0.2)
    outside = crop.cut(picture, np.array([0.5, 2.5, np.pi]))
    assert np.all(outside[1, :, 6:] == 0.0)
    assert np.all(outside[0, :, 6:] == 0.5)
    assert np.all(outside[1, :, :5] == 1.0)


def test_thin_walls_do_not_fall_between_the_cells_of_the_crop():
    cells = np.full((80, 80), 0.1, dtype=np.float32)
    cells[:, 53] = 0.9
    grid = OccupancyGrid(probability=cells, resolution=0.05, origin=(0.0, 0.0, 0.0))
    crop = Crop(cells=32, cell=0.1).cut(grid, np.array([2.0, 2.0, 0.0]))
    assert np.all((crop[0] > 0.8).sum(axis=1) == 1)


def test_a_perfect_map_covers_all_and_a_shifted_one_less():
    truth = true_map(PLACE)
    grid = grid_from_true_map(truth)
    score = MapScore(truth)
    whole = score.mapped(grid, np.zeros(3))
    assert whole.coverage == pytest.approx(1.0)
    assert whole.floor == pytest.approx(36.0 - 1.2, rel=0.05)
    assert whole.walls == pytest.approx(truth.occupied.sum() * 0.05**2)
    turned = score.mapped(grid, np.array([0.0, 0.0, 0.3]))
    assert turned.coverage < 0.95
    assert turned.walls < 0.5 * whole.walls
    T_map_world = np.array([0.7, -0.4, 1.0])  # the same map in another frame, moved back
    moved = OccupancyGrid(
        probability=grid.probability, resolution=0.05, origin=tuple(compose(T_map_world, grid.origin).tolist())
    )
    assert score.mapped(moved, inverse(T_map_world)).coverage == pytest.approx(1.0, abs=0.01)


def test_reward_is_area_mapped_minus_time_and_collisions():
    reward = ExploreReward(area=2.0, time=0.5, collision=11.0)
    env = make(reward=reward, world=room(half=3.0), coverage=1.0)
    _, info = env.reset(seed=0, options={"start": (1.5, 0.0, 0.0)})
    area, total, count = info["mapped_area"], 0.0, 0
    assert area > 5.0
    while True:
        _, gain, terminated, _, info = env.step(np.array([0.5, 0.0], np.float32))
        total, count = total + gain, count + 1
        if terminated:
            break
    assert info["collided"]
    assert total == pytest.approx(2.0 * (info["mapped_area"] - area) - 0.5 * 0.1 * count - 11.0)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2, np.float32))


@pytest.mark.parametrize("strategy", ["information", "nearest"])
def test_explorers_of_the_command_line_solve_the_environment(strategy):
    env = make(coverage=0.95, particles=6)
    env.reset(seed=1)
    inner = env.unwrapped
    explorer = make_explorer(
        inner.robot_setup.robot, inner.robot_setup.lidar, DriverConfig(strategy=strategy), np.random.default_rng(0)
    )
    for _ in range(900):
        _, _, terminated, _, info = env.step(inner.action(*explorer.command(inner.belief)))
        if terminated:
            break
    assert terminated
    assert not info["collided"]
    assert info["coverage"] >= 0.95


def test_bad_calls_are_refused():
    env = make().unwrapped
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2, np.float32))
    with pytest.raises(ResetNeeded):
        _ = env.belief
    env.reset(seed=0)
    for action in (np.zeros(3), np.array([np.nan, 0.0]), np.array([2.0, 0.0])):
        with pytest.raises(InvalidAction):
            env.step(action)
    with pytest.raises(Error, match="atlantis"):
        env.reset(options={"world": "atlantis"})
    env.step(np.zeros(2, np.float32))
    env.close()
    with pytest.raises(ClosedEnvironmentError):
        env.reset()
    for settings in ({"coverage": 0.0}, {"particles": 0}, {"crop": None, "beams": 0}):
        with pytest.raises(ValueError, match=next(iter(settings.keys() - {"crop"}))):
            make(**settings)
    with pytest.raises(ValueError, match="cells"):
        Crop(cells=0)


def test_pictures_show_the_estimated_map_and_keep_their_size():
    env = make(render_mode="rgb_array")
    env.reset(seed=0, options={"start": (-2.0, 0.0, 0.0)})
    before = env.render()
    drive(env, 40, (0.9, 0.0))
    after = env.render()
    assert before.shape == after.shape
    white = [(picture == 255).all(axis=-1).sum() for picture in (before, after)]
    assert white[1] > 1.05 * white[0]  # more floor is known
