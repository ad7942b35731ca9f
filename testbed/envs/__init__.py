# SPDX-License-Identifier: MIT
"""Gymnasium environments; `import testbed` registers them. Here is what `gymnasium.make` takes as arguments."""

from testbed.envs.drive_task import DriveReward
from testbed.envs.explore import ExploreReward
from testbed.envs.observation.egocentric import Crop
from testbed.envs.scenario.generated_worlds import GeneratedWorlds

__all__ = ["Crop", "DriveReward", "ExploreReward", "GeneratedWorlds"]
