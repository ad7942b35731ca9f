# SPDX-License-Identifier: MIT
"""`testbed run`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass

import numpy as np

from eval.map.grids import grid_from_true_map
from eval.scoring import Reference
from slam.occupancy import OccupancyGrid
from slam.step.step_report import StepReport
from testbed.cli.shared.backend import announce_backend
from testbed.cli.shared.console import SlowProgress, announce_world, console, progress_line
from testbed.cli.shared.finish import run_and_report
from testbed.cli.shared.output import OUTPUT, OutputOptions
from testbed.cli.shared.system_options import SYSTEMS, SystemOptions, compare_systems
from testbed.exploration import ExploreDriver, make_explorer
from testbed.frame import Frame
from testbed.provenance import config_document, settings_as_markdown
from testbed.run.job import Job
from testbed.seeds import RunSeeds
from testbed.settings.estimator import ESTIMATOR, EstimatorOptions
from testbed.settings.simulator import SIMULATOR, SimulatorOptions
from testbed.simulation import Simulation, SimulationConfig, simulate
from testbed.simulation.config import CONTROL_PERIOD
from testbed.simulation.drivers.driver import Driver
from testbed.simulation.drivers.recorded import RecordedDriver
from testbed.systems.execute import Recorded
from testbed.views import Scene
from worlds import true_map


def run(
    world: str,
    *,
    simulator: SimulatorOptions = SIMULATOR,
    estimator: EstimatorOptions = ESTIMATOR,
    output: OutputOptions = OUTPUT,
    systems: SystemOptions = SYSTEMS,
) -> int:
    """Simulate a robot in a world, map it with the particle filter, score map and trajectory against the truth.

    The results are written to a directory: report.html, recording.rrd, maps, trajectories, metrics.json.

    Parameters
    ----------
    world
        Name from the catalogue (`testbed worlds list`), a TOML file, or a ROS map (`.yaml`).
        A world without a tour gets a tour of all the floor that the robot can reach.
    """
    seeds = RunSeeds.from_seed(estimator.seed)
    config = simulator.simulation(seeds)
    output.check_directory()
    filter_config = estimator.filter_config  # raises before anything takes time
    entrants = systems.entrants(estimator)
    if entrants:
        systems.check_other_options(output, explores=simulator.driver.kind == "explore")
    loaded = simulator.load_world(world, seeds, SlowProgress("planning a tour"))
    announce_world(loaded)
    exact = true_map(loaded, estimator.filter.map.cell, height=config.robot.lidar_mount.height)
    truth = grid_from_true_map(exact)
    settings = {"world": world, **asdict(simulator.settled()), **estimator.settings(), **systems.settings()}
    document = config_document(settings, simulator.files(world))
    if entrants:
        with _driver(simulator, config) as driver, simulate(loaded, config, driver) as simulation:
            announce_backend(simulator)
            frames = drive(simulation, simulator.duration)
            ended = simulation.ended(simulator.duration)
        reference = Reference(grid=truth, walls=exact.walls)
        recorded = Recorded.of(frames, estimator.seed, reference, ended)
        return compare_systems(entrants, recorded, document, loaded.name, output)
    scene = Scene(
        title=f"{loaded.name}, seed {estimator.seed}",
        settings=settings_as_markdown(document),
        particles=filter_config.max_particles,
        motion=filter_config.motion,
        true_map=truth,
        robot_radius=config.robot.footprint_radius,
    )
    with _driver(simulator, config) as driver, simulate(loaded, config, driver) as simulation:
        announce_backend(simulator)
        job = Job(
            source=SimulatedFrames(simulation, simulator.duration),
            document=document,
            seed=estimator.seed,
            system=estimator.system(),
            truth_map=truth,
            truth_walls=exact.walls,
        )
        return run_and_report(job, output.directory(loaded.name), scene, output)


def drive(simulation: Simulation, duration: float | None) -> list[Frame]:
    """Return all frames of a drive, with a progress line."""
    source = SimulatedFrames(simulation, duration)
    frames = []
    with progress_line() as line:
        line.stage("driving")
        for frame in source:
            frames.append(frame)
            if frame.scan is not None:
                line.step(frame.stamp, source.share_done, None)
    return frames


@dataclass(frozen=True)
class SimulatedFrames:
    """Frames of a robot that drives while they are processed."""

    simulation: Simulation
    duration: float | None
    """The time after which the drive is meant to end [s]; None = at the end of the tour."""

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames while the robot drives."""
        return self.simulation

    @property
    def share_done(self) -> float:
        """Share of the drive that is done: of the tour, or of the time where that ends first."""
        of_time = 0.0 if self.duration is None else self.simulation.time / self.duration
        return min(max(self.simulation.driver.share or 0.0, of_time), 1.0)

    @property
    def collided(self) -> bool:
        """Whether the robot has touched something so far."""
        return self.simulation.collided

    @property
    def ended(self) -> str | None:
        """Why the drive did not end as planned; None = it did."""
        return self.simulation.ended(self.duration)

    def observe(self, frame: Frame, report: StepReport, make_map: Callable[[], OccupancyGrid]) -> None:
        """Give the estimate to a driver that steers by it."""
        if isinstance(self.simulation.driver, ExploreDriver):
            self.simulation.driver.observe(frame, report, make_map)


@contextmanager
def _driver(simulator: SimulatorOptions, config: SimulationConfig) -> Iterator[Driver | None]:
    """Make the driver that the options name, for the duration of the block; None = the one that follows the tour."""
    if simulator.driver.kind == "explore":
        rng = np.random.default_rng(config.seeds.driver)
        yield ExploreDriver(make_explorer(config.robot, config.lidar, config.driver, rng))
    elif simulator.driver.kind == "teleop":
        from testbed.simulation.drivers.teleop import HELP, TeleopDriver

        with TeleopDriver(config.robot, config.driver) as driver:
            console.print(HELP)
            yield driver
    else:
        commands = simulator.recorded_commands()
        yield None if commands is None else RecordedDriver(commands, CONTROL_PERIOD)
