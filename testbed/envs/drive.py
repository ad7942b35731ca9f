# SPDX-License-Identifier: MIT
"""`testbed/Drive-v0`: one robot with a lidar drives without a map."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from numpy.typing import NDArray

from testbed.envs.drive_task import DriveTask, StepOutcome
from testbed.envs.observation.rendering import MODES, Screen, check_render_mode
from testbed.envs.rewards import DriveReward
from testbed.envs.settings import EnvironmentSettings

Observation = dict[str, NDArray[np.float32]]


class DriveEnv(gym.Env[Observation, NDArray[np.float32]]):
    """The environment `testbed/Drive-v0`, described in docs/gymnasium.md."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(MODES), "render_fps": 10}  # type: ignore[misc]

    def __init__(self, *, render_mode: str | None = None, reward: DriveReward | None = None, **settings: Any) -> None:
        """settings: as in `EnvironmentSettings`."""
        check_render_mode(render_mode)
        self.render_mode = render_mode
        self._task = DriveTask(1, EnvironmentSettings(**settings), reward or DriveReward())
        self.action_space = self._task.io.action_space
        self.observation_space = self._task.observation_space  # type: ignore[assignment]
        self._screen = Screen(render_mode, self._task.io.setup)
        self._running, self._closed = False, False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; the options `world` and `start` (`Scenario.parse_reset_options`) hold for this one."""
        if self._closed:
            raise ClosedEnvironmentError("the environment is closed")
        parsed = self._task.scenario.parse_reset_options(options)
        super().reset(seed=seed)
        self._task.place(0, self.np_random, parsed)
        outcome = self._task.step(np.zeros((1, 2)))
        self._running = True
        world = self._task.worlds[0]
        assert world is not None
        self._screen.begin(world, outcome.pose[0])
        self._show()
        return self._observation(outcome), self._task.info(outcome, 0)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one period, the duration of a scan."""
        if self._closed:
            raise ClosedEnvironmentError("the environment is closed")
        if not self._running:
            raise ResetNeeded("call reset() before step(), and after an episode has ended")
        outcome = self._task.step(self._task.io.target(action))
        terminated = bool(outcome.terminated[0])
        self._running = not terminated
        self._show()
        info = self._task.info(outcome, 0)
        return self._observation(outcome), float(outcome.reward[0]), terminated, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the world from above, (height, width, 3), for "rgb_array"; None otherwise."""
        return self._screen.picture()

    def close(self) -> None:
        """Free the physics client and complete the live view; may be called twice."""
        if not self._closed:
            self._task.close()
            self._screen.close()
        self._closed, self._running = True, False

    def _show(self) -> None:
        assert self._task.readings is not None
        self._screen.show(self._task.readings, robot=0)

    @staticmethod
    def _observation(outcome: StepOutcome) -> Observation:
        return {name: rows[0] for name, rows in outcome.observation.items()}
