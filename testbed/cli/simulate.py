# SPDX-License-Identifier: MIT
"""`testbed simulate`."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, replace
from multiprocessing import active_children, get_context
from pathlib import Path

from rich.progress import track

from testbed.cli.console import announce_compilation, console, results
from testbed.cli.simulator_options import SIMULATOR, SimulatorOptions
from testbed.dataset import Format, discard_unfinished, is_complete, write_dataset

FAST = replace(SIMULATOR, backend="fast")


def simulate(
    world: str,
    *,
    out: Path,
    seed: int = 0,
    count: int = 1,
    workers: int = 1,
    format: Format = "rosbag2",
    config: Path | None = None,
    simulator: SimulatorOptions = FAST,
) -> None:
    """Write synthetic datasets.

    Parameters
    ----------
    world
        Name from the catalogue (`testbed worlds list`), a TOML file, or a ROS map (`.yaml`).
        A world without a tour gets a tour of all the floor that the robot can reach.
    out
        Directory that takes the datasets; those that are there already are kept.
    seed
        Seed of the first dataset; each further one has the next.
    count
        Number of datasets.
    workers
        Datasets that are made at the same time.
    format
        rosbag2: directory with an MCAP file that ROS 2 plays and Rerun shows; rosbag2-lean: without the point clouds
        that Rerun draws, in half the space; carmen: packed CARMEN log.
    config
        TOML file with settings, such as the config.toml of a dataset; the command line wins.
    """
    if count < 1 or workers < 1:
        raise ValueError(f"count and workers must be at least 1, got {count} and {workers}")
    place = simulator.place(world)
    settings = {"world": world, "format": format, **asdict(simulator)}
    if simulator.driver.kind in ("explore", "teleop"):
        raise ValueError(f"--driver {simulator.driver.kind} needs a mapper or a person: use testbed run")
    simulator.simulation(seed)  # complain before the first dataset, not in a worker
    jobs = {out / f"{place.name}-{number:04d}": number for number in range(seed, seed + count)}
    missing = {path: number for path, number in jobs.items() if not is_complete(path)}
    for path in missing:
        if path.exists():
            raise ValueError(f"{path}: exists and is no dataset; choose another --out")
    if out.exists() and not out.is_dir():
        raise ValueError(f"{out}: is a file, expected a directory")
    announce_compilation()
    out.mkdir(parents=True, exist_ok=True)
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"))  # not forked: PyBullet and numba keep threads
    with pool, _ended_with_us(missing):
        with _ctrl_c_blocked():  # workers inherit this for good: Ctrl-C is the parent's business
            futures = [
                pool.submit(
                    write_dataset, path, place, simulator.simulation(number), settings | {"seed": number}, form=format
                )
                for path, number in missing.items()
            ]
        silent = not console.is_terminal
        done = track(as_completed(futures), "simulating", len(futures), console=console, transient=True, disable=silent)
        for future in done:
            future.result()
    results.print(f"{out}: {len(missing)} datasets written, {len(jobs) - len(missing)} were there already")


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
