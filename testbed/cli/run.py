# SPDX-License-Identifier: MIT
"""`testbed run`."""

from __future__ import annotations

from dataclasses import asdict

from eval.map.grids import grid_from_true_map
from testbed.cli.shared.finish import carry_out
from testbed.exploration import ExploreDriver
from testbed.run.execute import Job, drive_ended
from testbed.run.provenance import config_document, settings_as_markdown
from testbed.settings.estimator import ESTIMATOR, OUTPUT, EstimatorOptions, OutputOptions
from testbed.settings.simulator import SIMULATOR, SimulatorOptions
from testbed.simulation import Simulation, simulate
from testbed.simulation.physics.urdf import robot_urdf
from testbed.views import Scene
from worlds import true_map


def run(
    world: str,
    *,
    simulator: SimulatorOptions = SIMULATOR,
    estimator: EstimatorOptions = ESTIMATOR,
    output: OutputOptions = OUTPUT,
) -> int:
    """Simulate a robot in a world, map it with the particle filter, score map and trajectory against the truth.

    The results go into a directory: report.html, recording.rrd, maps, trajectories, metrics.json.

    Parameters
    ----------
    world
        Name from the catalogue (`testbed worlds list`), a TOML file, or a ROS map (`.yaml`).
        A world without a tour gets a tour of all the floor that the robot can reach.
    """
    config = simulator.simulation(estimator.seed)
    output.check_directory()
    filter_config = estimator.filter_config
    place = simulator.place(world)
    truth = grid_from_true_map(true_map(place, estimator.filter.map.cell, height=config.robot.lidar_mount.height))
    document = config_document({"world": world, **asdict(simulator), **estimator.settings()}, simulator.files(world))
    scene = Scene(
        title=f"{place.name}, seed {estimator.seed}",
        settings=settings_as_markdown(document),
        particles=filter_config.max_particles,
        true_map=truth,
        robot_urdf=robot_urdf(config.robot),
        robot_radius=config.robot.footprint_radius,
    )
    with simulator.steering(config) as driver, simulate(place, config, driver) as simulation:
        job = Job(
            frames=simulation,
            document=document,
            seed=estimator.seed,
            filter=filter_config,
            filter_seed=estimator.filter_seed,
            threads=estimator.threads,
            refine=estimator.refine,
            truth_map=truth,
            share_done=lambda: _share_done(simulation, simulator.duration),
            observe=driver.observe if isinstance(driver, ExploreDriver) else Job.observe,
            collided=lambda: simulation.collided,
            ended=lambda: drive_ended(simulation, simulator.duration),
        )
        return carry_out(job, output.directory(place.name), scene, output)


def _share_done(simulation: Simulation, duration: float | None) -> float:
    """Share of the drive that is behind the robot: of the tour, or of the time where that ends first."""
    of_time = 0.0 if duration is None else simulation.time / duration
    return min(max(simulation.driver.share or 0.0, of_time), 1.0)
