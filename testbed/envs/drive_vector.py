# SPDX-License-Identifier: MIT
"""`testbed/Drive-v0` for many robots in one process, as `gymnasium.make_vec` makes it."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.random import Generator
from numpy.typing import NDArray

from testbed.envs.drive import Observation
from testbed.envs.drive_task import DriveTask, StepOutcome
from testbed.envs.observation.rendering import MODES, Screen, check_render_mode
from testbed.envs.rewards import DriveReward
from testbed.envs.scenario.scenario import ResetOptions
from testbed.envs.settings import EnvironmentSettings

Flags = NDArray[np.bool_]
Stepped = tuple[Observation, NDArray[np.float64], Flags, Flags, dict[str, Any]]


class DriveVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """Many `testbed/Drive-v0` at once; steps, resets and infos equal those of a `SyncVectorEnv`, bit for bit."""

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        reward: DriveReward | None = None,
        **settings: Any,
    ) -> None:
        """settings: as in `EnvironmentSettings`, on the fast backend."""
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        check_render_mode(render_mode, allowed=(None, "rgb_array"))
        self.num_envs, self.render_mode = num_envs, render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": list(MODES), "render_fps": 10, "autoreset_mode": self.autoreset_mode}
        self._task = DriveTask(num_envs, EnvironmentSettings(**settings), reward or DriveReward())
        self.single_action_space = self._task.io.action_space
        self.single_observation_space = self._task.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._screens = [Screen(render_mode, self._task.io.setup) for _ in range(num_envs)]
        self._limit = max_episode_steps
        self._generators: list[tuple[Generator, int] | None] = [None] * num_envs
        self._elapsed = np.zeros(num_envs, np.int64)
        self._begun = np.zeros(num_envs, np.bool_)
        self._over = np.zeros(num_envs, np.bool_)
        self._observation: Observation = {}

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[Generator, ...]:  # type: ignore[override]
        """The generators of all environments."""
        return tuple(self._generator(robot)[0] for robot in range(self.num_envs))

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of all environments."""
        return tuple(self._generator(robot)[1] for robot in range(self.num_envs))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin episodes in all environments, or where the option `reset_mask` (num_envs,) is true.

        seed: of each environment, or a number n for n, n + 1, …;  options: further ones as in `DriveEnv.reset`
        """
        self._check_open()
        options = dict(options or {})
        mask = self._reset_mask(options.pop("reset_mask", None))
        parsed = self._task.scenario.parse_reset_options(options)
        seeded = [None if own is None else seeding.np_random(own) for own in self._seeds(seed)]
        for robot in np.flatnonzero(mask).tolist():
            self._generators[robot] = seeded[robot] or self._generators[robot]
        outcome = self._begin(mask, parsed)
        return self._observations(outcome, mask), self._infos(outcome, mask)

    def step(self, actions: NDArray[np.float32]) -> Stepped:
        """Drive all robots for one period; the autoreset mode decides what happens to episodes that are over."""
        self._check_open()
        if not self._begun.all():
            raise ResetNeeded("call reset() before step()")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._over.any():
            raise ResetNeeded(f"environments {np.flatnonzero(self._over).tolist()} are over: reset them by reset_mask")
        anew = self._over.copy()
        targets = self._task.io.targets(actions, self.num_envs, acting=~anew)
        self._place(anew, ResetOptions())
        outcome = self._task.step(targets)
        self._elapsed[~anew] += 1
        terminated = outcome.terminated & ~anew
        truncated = np.zeros_like(terminated) if self._limit is None else (self._elapsed >= self._limit) & ~anew
        reward = np.where(anew, 0.0, outcome.reward)
        self._over = terminated | truncated
        self._show(anew)
        everyone = np.ones(self.num_envs, np.bool_)
        observation, infos = self._observations(outcome, everyone), self._infos(outcome, everyone)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            observation, infos = self._reset_ended(outcome)
        return observation, reward, terminated, truncated, infos

    def _reset_ended(self, outcome: StepOutcome) -> tuple[Observation, dict[str, Any]]:
        """Begin new episodes in place of those that have just ended, whose last observations go into the infos."""
        ended = self._over.copy()
        infos = self._final_infos(outcome)
        begun = self._begin(ended, ResetOptions())
        mixed = outcome._replace(
            pose=np.where(ended[:, None], begun.pose, outcome.pose), terminated=outcome.terminated & ~ended
        )
        return self._observations(begun, ended), infos | self._infos(mixed, np.ones(self.num_envs, np.bool_))

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each world from above, (height, width, 3), for "rgb_array"; None otherwise."""
        if self.render_mode is None:
            return None
        return tuple(picture for screen in self._screens if (picture := screen.picture()) is not None)

    def close_extras(self) -> None:
        """End the task of the robots."""
        self._task.close()

    def _begin(self, which: Flags, options: ResetOptions) -> StepOutcome:
        """Begin episodes of some robots with the period in which they stand still."""
        self._place(which, options)
        outcome = self._task.step(np.zeros((self.num_envs, 2)), np.flatnonzero(which))
        self._over &= ~which
        self._show(which, only=which)
        return outcome

    def _place(self, which: Flags, options: ResetOptions) -> None:
        for robot in np.flatnonzero(which).tolist():
            self._task.place(robot, self._generator(robot)[0], options)
        self._elapsed[which] = 0
        self._begun |= which

    def _observations(self, outcome: StepOutcome, which: Flags) -> Observation:
        """Return the newest observations of all robots; only the rows of `which` have changed."""
        if which.all():
            self._observation = outcome.observation
        else:
            self._observation = {
                name: np.where(which[:, None], rows, self._observation.get(name, np.zeros_like(rows)))
                for name, rows in outcome.observation.items()
            }
        return {name: rows.copy() for name, rows in self._observation.items()}

    @staticmethod
    def _infos(outcome: StepOutcome, which: Flags) -> dict[str, Any]:
        """Return infos as gymnasium batches them: an array per key, and a mask of the environments that have it."""
        return {
            "pose": np.where(which[:, None], outcome.pose, 0.0),
            "_pose": which.copy(),
            "collided": outcome.terminated & which,
            "_collided": which.copy(),
        }

    def _final_infos(self, outcome: StepOutcome) -> dict[str, Any]:
        """Return the last observations and infos of the episodes that are over."""
        infos: dict[str, Any] = {}
        for robot in np.flatnonzero(self._over).tolist():
            last = {name: rows[robot].copy() for name, rows in outcome.observation.items()}
            final = {"final_obs": last, "final_info": self._task.info(outcome, robot)}
            infos = self._add_info(infos, final, robot)
        return infos

    def _reset_mask(self, mask: Any) -> Flags:
        if mask is None:
            return np.ones(self.num_envs, np.bool_)
        fits = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (self.num_envs,)
        if not fits or not mask.any():
            raise ValueError(f"reset_mask must be {self.num_envs} booleans as array, at least one true, got {mask!r}")
        return np.array(mask)

    def _seeds(self, seed: int | list[int | None] | None) -> list[int | None]:
        """Return the seed of each environment; None = the random numbers go on."""
        seeds = seed if isinstance(seed, list) else [None if seed is None else seed + k for k in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ValueError(f"expected {self.num_envs} seeds, one for each environment, got {len(seeds)}")
        return seeds

    def _generator(self, robot: int) -> tuple[Generator, int]:
        found = self._generators[robot]
        if found is None:
            found = self._generators[robot] = seeding.np_random()
        return found

    def _show(self, begun: Flags, only: Flags | None = None) -> None:
        if self.render_mode is None or self._task.readings is None:
            return
        for robot in range(self.num_envs):
            if only is not None and not only[robot]:
                continue
            world = self._task.worlds[robot]
            if begun[robot] and world is not None:
                self._screens[robot].begin(world, self._task.readings.truth[robot])
            self._screens[robot].show(self._task.readings, robot)

    def _check_open(self) -> None:
        if self.closed:
            raise ClosedEnvironmentError("the environment is closed")
