# SPDX-License-Identifier: MIT
"""Gymnasium environments, registered by `import testbed`, and the arguments of `gymnasium.make`."""

from testbed.envs.observation.egocentric import Crop
from testbed.envs.rewards import DriveReward, ExploreReward
from testbed.envs.scenario.generated_worlds import GeneratedWorlds

__all__ = ["Crop", "DriveReward", "ExploreReward", "GeneratedWorlds"]
