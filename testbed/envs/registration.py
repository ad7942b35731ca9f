# SPDX-License-Identifier: MIT
"""The names under which `gymnasium.make` finds the environments; what they are made of is imported by `make`."""

from __future__ import annotations

import gymnasium

DRIVE, EXPLORE = "testbed/Drive-v0", "testbed/Explore-v0"


def register_environments() -> None:
    """Tell gymnasium of all environments; may be called twice."""
    if DRIVE in gymnasium.registry:
        return
    gymnasium.register(
        DRIVE,
        entry_point="testbed.envs.drive:DriveEnv",
        vector_entry_point="testbed.envs.drive_vector:DriveVectorEnv",
        max_episode_steps=1000,
    )
