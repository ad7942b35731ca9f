# SPDX-License-Identifier: MIT
"""Weights of the rewards; the rewards are computed from the truth."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class DriveReward:
    """Weights of the reward of `testbed/Drive-v0`: driving ahead is good, turning and collisions are bad.

    The idea is that of Zamora et al. (2016), "Extending the OpenAI Gym for robotics", where a TurtleBot gets 5 for a
    step ahead, 1 for a turn and -200 for a collision.
    """

    ahead: float = 1.0
    """Reward per metre driven forward [1/m]; backward counts negative."""
    turn: float = 0.05
    """Cost per radian turned [1/rad]."""
    collision: float = 5.0
    """Cost of a collision, which ends the episode."""


@dataclass(frozen=True, kw_only=True)
class ExploreReward:
    """Weights of the reward of `testbed/Explore-v0`: area mapped correctly is good, time and collisions are bad."""

    area: float = 1.0
    """Reward per square metre of floor and walls newly mapped correctly [1/m²]; area that is lost counts negative."""
    collision: float = 20.0
    """Cost of a collision, which ends the episode."""
    time: float = 0.05
    """Cost of a second [1/s]."""
