# SPDX-License-Identifier: MIT
"""Wrong arguments of `gymnasium.make` get one line with the name and what was expected."""

import gymnasium as gym
import numpy as np
import pytest

import testbed  # noqa: F401  # registers the environments

WRONG = [
    ({"beams": "180"}, r"beams must be a whole number from 1 to 10000, or None, got '180' of type str"),
    ({"beams": 7.5}, r"beams must be a whole number .* got '7.5' of type float"),
    ({"beams": True}, r"beams must be a whole number .* of type bool"),
    ({"world": 3}, r"world must be a name, a file, a World or GeneratedWorlds, got '3' of type int"),
    ({"robot": None}, r"robot must be a name, a file or a RobotPreset, got 'None'"),
    ({"lidar": ["lds01"]}, r"lidar must be a name, a file or a LidarPreset"),
    ({"odometry": "good"}, r"odometry must be an OdometryConfig or None, got 'good'"),
    ({"lidar_layers": False}, r"lidar_layers must be LidarLayers or None"),
    ({"reward": 1.0}, r"reward must be an? (Drive|Explore)Reward or None, got '1.0' of type float"),
]
WRONG_TO_EXPLORE = [
    ({"particles": "10"}, r"particles must be a whole number of at least 1, got '10' of type str"),
    ({"particles": 0}, r"particles must be at least 1"),
    ({"coverage": "all"}, r"coverage must be a number in \(0, 1\], got 'all'"),
    ({"filter": 30}, r"filter must be a FilterConfig or None"),
    ({"crop": 64}, r"crop must be a Crop or None"),
]


@pytest.mark.parametrize(("arguments", "message"), WRONG)
@pytest.mark.parametrize("name", ["Drive", "Explore"])
def test_wrong_arguments_are_named(name, arguments, message):
    with pytest.raises(ValueError, match=message) as caught:
        gym.make(f"testbed/{name}-v0", **arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("arguments", "message"), WRONG_TO_EXPLORE)
def test_wrong_arguments_of_the_filter_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        gym.make("testbed/Explore-v0", **arguments)


def test_numbers_of_numpy_are_numbers():
    env = gym.make("testbed/Drive-v0", beams=np.int64(20))
    assert env.observation_space["scan"].shape == (20,)
    env.close()
