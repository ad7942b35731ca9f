# SPDX-License-Identifier: MIT
"""`testbed simulate`."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from typing import Any, Literal

from cyclopts import Parameter
from rich.progress import track

from eval.files.atomic_write import discard_unfinished
from testbed.cli.shared.console import announce_compilation, console, results
from testbed.cli.shared.variants import Variant, variants
from testbed.datasets.simulated import DatasetFormat, is_complete, write_dataset
from testbed.seeds import RunSeeds
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation import SimulationConfig
from testbed.simulation.drivers.driver import Command
from testbed.simulation.simulator import check_fits
from worlds import World
from worlds.file_names import RULE, is_name


@dataclass(frozen=True, kw_only=True)
class FastSimulatorOptions(SimulatorOptions):
    """The simulated robot and its sensors, with the fast backend by default."""

    backend: Literal["pybullet", "fast"] = "fast"
    """pybullet: physics and rays of PyBullet; fast: exact arcs and the testbed's own ray caster."""


FAST = FastSimulatorOptions()


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DatasetOptions:
    """The datasets to make."""

    out: Path
    """Directory that takes the datasets; those that are there already are kept."""
    seed: int = 0
    """Seed of the first dataset; each further one has the next."""
    count: int = 1
    """Number of datasets, of each variant."""
    workers: int = 1
    """Datasets that are made at the same time."""
    format: DatasetFormat = "rosbag2"
    """rosbag2: directory with an MCAP file that ROS 2 plays and Rerun shows; rosbag2-lean: without the point clouds
    that Rerun draws, in half the space; rosbag2-sqlite: with a .db3 file; rosbag1: a .bag file; carmen: packed CARMEN
    log; parquet: a table."""
    vary: tuple[str, ...] = ()
    """KEY=A,B,C: the same drives with each of these values of lidar, beams, noise, clutter, odometry.… or layers.…; may
    be repeated, for all combinations."""
    variant: str = ""
    """Part of the datasets' names; --vary sets it."""
    config: Path | None = None
    """TOML file with settings, such as the config.toml of a dataset; the command line wins."""

    def __post_init__(self) -> None:
        if self.count < 1 or self.workers < 1:
            raise ValueError(f"count and workers must be at least 1, got {self.count} and {self.workers}")
        if self.variant and not is_name(self.variant):
            raise ValueError(f"variant {self.variant!r}: expected {RULE}")
        if self.out.exists() and not self.out.is_dir():
            raise ValueError(f"{self.out}: is a file, expected a directory")


def simulate(world: str, *, datasets: DatasetOptions, simulator: SimulatorOptions = FAST) -> None:
    """Write synthetic datasets.

    Parameters
    ----------
    world
        Name from the catalogue (`testbed worlds list`), a TOML file, or a ROS map (`.yaml`).
        A world without a tour gets a tour of all the floor that the robot can reach.
    """
    if simulator.driver.kind in ("explore", "teleop"):
        raise ValueError(f"--driver {simulator.driver.kind} needs a mapper or a person: use testbed run")
    jobs = [job for variant in variants(simulator, datasets.vary) for job in _jobs(world, datasets, variant)]
    missing = [job for job in jobs if not is_complete(job.path)]
    for job in missing:
        if job.path.exists():
            raise ValueError(f"{job.path}: exists and is no dataset; choose another --out")
    announce_compilation()
    datasets.out.mkdir(parents=True, exist_ok=True)
    drives = _carry_out(missing, datasets)
    results.print(f"{datasets.out}: {_written(len(missing), len(jobs) - len(missing))}")
    for trouble in ("collided", "stuck"):
        if names := sorted(job.path.name for job, drive in drives.items() if drive[trouble]):
            results.print(f"{len(names)} {trouble}: {', '.join(names[:10])}{' and others' if names[10:] else ''}")


def _written(new: int, old: int) -> str:
    """The sentence that reports how many datasets were written and how many existed before."""
    existed = f"; {old} existed already and {'was' if old == 1 else 'were'} kept" if old else ""
    return f"wrote {new} dataset{'' if new == 1 else 's'}{existed}"


@dataclass(frozen=True, eq=False)
class _Job:
    """One dataset to make."""

    path: Path
    place: World
    config: SimulationConfig
    settings: dict[str, Any]
    commands: list[Command] | None


def _jobs(world: str, datasets: DatasetOptions, variant: Variant) -> Iterator[_Job]:
    """The datasets of one variant; complains about settings here, not in a worker."""
    simulator, name = variant.simulator, variant.name or datasets.variant
    first = RunSeeds.from_seed(datasets.seed)
    place, commands = simulator.load_world(world, first), simulator.recorded_commands()
    settings = {"world": world, "format": datasets.format, "variant": name, **asdict(simulator)}
    check_fits(place, simulator.simulation(first).robot)
    for seed in range(datasets.seed, datasets.seed + datasets.count):
        path = datasets.out / "-".join(part for part in (place.name, f"{seed:04d}", name) if part)
        seeds = RunSeeds.from_seed(seed)
        if simulator.route == "random":
            place = simulator.load_world(world, seeds)
        yield _Job(path, place, simulator.simulation(seeds), settings | {"seed": seed}, commands)


def _carry_out(jobs: list[_Job], datasets: DatasetOptions) -> dict[_Job, dict[str, Any]]:
    """Make all datasets; how each drive went."""
    context = get_context("spawn")  # not forked: PyBullet and numba keep threads
    pool = ProcessPoolExecutor(datasets.workers, mp_context=context, initializer=_end_with_parent)
    with pool, _ended_with_us(job.path for job in jobs):
        with _ctrl_c_blocked():  # workers inherit this for good: Ctrl-C is the parent's business
            futures = {pool.submit(_make, job, datasets.format): job for job in jobs}
        silent = not console.is_terminal
        done = track(as_completed(futures), "simulating", len(futures), console=console, transient=True, disable=silent)
        try:
            return {futures[future]: future.result() for future in done}
        except BrokenProcessPool:
            raise ValueError(
                "a worker was killed, perhaps for want of memory; the same command goes on with what is missing"
            ) from None


def _end_with_parent() -> None:
    """Make this worker exit when its parent process dies."""

    def watch() -> None:
        if (parent := parent_process()) is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _make(job: _Job, log_format: DatasetFormat) -> dict[str, Any]:
    """Make one dataset, in a worker; how the drive went."""
    return write_dataset(job.path, job.place, job.config, job.settings, log_format=log_format, commands=job.commands)


@contextmanager
def _ended_with_us(datasets: Iterable[Path]) -> Iterator[None]:
    """End the workers at once where the block ends early: the datasets at hand are made again by the next start."""
    try:
        yield
    except BaseException:
        for worker in active_children():
            worker.terminate()
            worker.join()
        for path in datasets:
            discard_unfinished(path)
        raise


@contextmanager
def _ctrl_c_blocked() -> Iterator[None]:
    """Ctrl-C takes effect at the end of the block; never in threads and processes that are started in it."""
    previous = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous)
