# SPDX-License-Identifier: MIT
"""`testbed/Explore-v0`: one robot maps a world it has never seen, with the particle filter in the loop."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from numpy.typing import NDArray

from slam.config import FilterConfig
from slam.gmapping import GMapping
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose, between, compose
from slam.sensor.possible_motion import possible_twist
from slam.step.step_report import StepReport
from testbed.envs.drive import Observation
from testbed.envs.observation.egocentric import Crop
from testbed.envs.observation.map_score import Mapped, MapScore
from testbed.envs.observation.rendering import MODES, Screen, check_render_mode, scan_of
from testbed.envs.rewards import ExploreReward
from testbed.envs.scenario.robot_io import RobotIO
from testbed.envs.settings import EnvironmentSettings, check_type
from testbed.estimation.snapshot import take_snapshot
from testbed.exploration.belief import Belief
from testbed.frame import Frame
from testbed.seeds import RunSeeds
from testbed.simulation.fleet.robot_group import Readings, RobotSetup
from worlds import TrueMap

_MAX_DEVIATION = np.array([10.0, 10.0, np.pi])
"""Largest standard deviations that an observation states [m, m, rad]."""


class ExploreEnv(gym.Env[Observation, NDArray[np.float32]]):
    """The environment `testbed/Explore-v0`, described in docs/gymnasium.md."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(MODES), "render_fps": 10}  # type: ignore[misc]

    def __init__(
        self,
        *,
        particles: int = 10,
        filter: FilterConfig | None = None,
        crop: Crop | None = None,
        coverage: float = 0.95,
        reward: ExploreReward | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        """particles: number of particles of the filter, whose other settings are `filter`;  crop: the square of the map
        that is observed;  coverage: share of the floor whose mapping ends the episode;  settings: those of
        `EnvironmentSettings`"""
        check_render_mode(render_mode)
        check_type("particles", particles, (int, np.integer), "a whole number of at least 1")
        check_type("filter", filter, (FilterConfig, type(None)), "a FilterConfig or None")
        check_type("crop", crop, (Crop, type(None)), "a Crop or None")
        check_type("coverage", coverage, (int, float, np.number), "a number in (0, 1]")
        check_type("reward", reward, (ExploreReward, type(None)), "an ExploreReward or None")
        if not 0.0 < coverage <= 1.0:
            raise ValueError(f"coverage must be in (0, 1], got {coverage}")
        self.render_mode = render_mode
        self._settings = EnvironmentSettings(**settings)
        self._setup = self._settings.robot_setup()
        self._scenario = self._settings.scenario(self._setup)
        self._group = self._settings.group(1, self._setup)
        self._filter = replace(filter or FilterConfig(), particles=particles)
        self._crop, self._target, self._reward = crop or Crop(), coverage, reward or ExploreReward()
        self.io = RobotIO(self._setup)
        """Converts actions to velocities and readings to observations."""
        self.action_space = self.io.action_space
        limit = _MAX_DEVIATION.astype(np.float32)
        self.observation_space = spaces.Dict(  # type: ignore[assignment]
            {
                **self.io.observation_spaces,
                "map": self._crop.space,
                "spread": spaces.Box(np.zeros(3, np.float32), limit, dtype=np.float32),
                "ess": spaces.Box(0.0, 1.0, (1,), np.float32),
            }
        )
        self._screen = Screen(render_mode, self._setup)
        self._running, self._closed = False, False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with an empty map; options: see `Scenario.parse_reset_options`."""
        if self._closed:
            raise ClosedEnvironmentError("the environment is closed")
        parsed = self._scenario.parse_reset_options(options)
        super().reset(seed=seed)
        world, start = self._scenario.draw(self.np_random, parsed)
        self._group.place(0, world.terrain, start, RunSeeds.from_seed(int(self.np_random.integers(2**63))))
        self._mapper = GMapping(self._filter, seed=int(self.np_random.integers(2**63)), threads=1)
        self._world, self._score, self._T_world_map = world, MapScore(world.true_map), start
        self._odometry, self._stamp = np.zeros((1, 3)), 0.0
        self._mapped = Mapped(0.0, 0.0, 0.0)
        self._screen.begin(world, start)
        observation, readings = self._period(np.zeros((1, 2)))
        self._running = True
        return observation, self._info(readings)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one period, the duration of a scan, and process the scan with the filter."""
        if self._closed:
            raise ClosedEnvironmentError("the environment is closed")
        if not self._running:
            raise ResetNeeded("call reset() before step(), and after an episode has ended")
        target, before = self.io.target(action), self._mapped
        observation, readings = self._period(target)
        gain = self._mapped.floor + self._mapped.walls - before.floor - before.walls
        collided = bool(readings.contact[0])
        weights = self._reward
        reward = weights.area * gain - weights.time * self._setup.period - weights.collision * collided
        terminated = collided or self._mapped.coverage >= self._target
        self._running = not terminated
        return observation, float(reward), terminated, False, self._info(readings)

    @property
    def belief(self) -> Belief:
        """The estimate, by which an explorer of `testbed.exploration` steers."""
        if not self._running:
            raise ResetNeeded("call reset() first")
        return Belief(stamp=self._stamp, pose=self._pose, scans=(self._scan,), twist=self._twist, map=lambda: self._map)

    def action(self, speed: float, turn_rate: float) -> NDArray[np.float32]:
        """Return the action for a speed [m/s] and a turn rate [rad/s], clipped to the robot's limits."""
        shares = np.array([speed, turn_rate]) / self.io.max_velocity
        action: NDArray[np.float32] = np.clip(shares, -1.0, 1.0).astype(np.float32)
        return action

    @property
    def estimated_map(self) -> OccupancyGrid:
        """The filter's most likely map, in the frame of the episode's first pose."""
        return self._map

    @property
    def T_world_map(self) -> Pose:
        """True pose of the map's frame, (3,): for scores, not for policies."""
        return self._T_world_map.copy()

    @property
    def true_map(self) -> TrueMap:
        """The true map of this episode: for scores, not for policies."""
        return self._world.true_map

    @property
    def robot_setup(self) -> RobotSetup:
        """The robot and its sensors."""
        return self._setup

    @property
    def outfit(self) -> RobotSetup:
        """Old name of `robot_setup`, kept for one release."""
        return self._setup

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the estimated map, (height, width, 3), for "rgb_array"; None otherwise."""
        return self._screen.picture(self._map if self.render_mode == "rgb_array" else None, self._T_world_map)

    def close(self) -> None:
        """Free the physics client and complete the live view; may be called twice."""
        if not self._closed:
            self._group.close()
            self._screen.close()
        self._closed, self._running = True, False

    def _period(self, targets: NDArray[np.float64]) -> tuple[Observation, Readings]:
        """Drive for one period, update the filter, return the observation and the readings."""
        before = self._odometry[0]
        readings = self._group.step(targets)
        observation = {name: rows[0] for name, rows in self.io.observe(readings, self._odometry).items()}
        self._odometry = readings.odometry
        motion = between(before, readings.odometry[0])
        self._scan = scan_of(self._setup, readings.ranges[0], self._stamp)
        self._stamp += self._setup.period
        self._twist = possible_twist(motion / self._setup.period)
        report = self._mapper.process(before, self._scan, twist=self._twist)
        self._pose = compose(report.pose, motion)
        if report.updated:
            self._map = self._mapper.map()
            self._mapped = self._score.mapped(self._map, self._T_world_map)
        self._screen.show(readings, 0, lambda scan: self._snapshot(scan, before, report, readings))
        spread = np.sqrt(np.maximum(np.diag(report.covariance), 0.0))
        observation["map"] = self._crop.cut(self._map, self._pose)
        observation["spread"] = np.minimum(spread, _MAX_DEVIATION).astype(np.float32)
        observation["ess"] = np.array([min(report.ess / report.particles, 1.0)], np.float32)
        return observation, readings

    def _snapshot(self, scan: Scan, odometry: Pose, report: StepReport, readings: Readings) -> Any:
        frame = Frame(stamp=scan.stamp, odometry=odometry, scan=scan, truth=readings.truth[0])
        return take_snapshot(frame, report, self._mapper, collided=bool(readings.contact[0]))

    def _info(self, readings: Readings) -> dict[str, Any]:
        return {
            "pose": readings.truth[0].copy(),
            "collided": bool(readings.contact[0]),
            "coverage": self._mapped.coverage,
            "mapped_area": self._mapped.floor + self._mapped.walls,
        }
