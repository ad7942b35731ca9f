# SPDX-License-Identifier: MIT
"""`testbed simulate`."""

from __future__ import annotations

import math
import os
import shlex
import signal
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from eval.files.atomic_write import discard_unfinished
from testbed.cli.shared.backend import announce_backend
from testbed.cli.shared.console import (
    SlowProgress,
    announce_compilation,
    announce_world,
    console,
    counted_seconds,
    results,
)
from testbed.cli.shared.dataset_plan import (
    Kind,
    Measured,
    free_space,
    lasting,
    measure_some,
    plan_lines,
    share_lines,
    split_lines,
    worlds_by_split,
)
from testbed.cli.shared.dataset_progress import DatasetProgress, dataset_progress
from testbed.cli.shared.draws import Draw, drawn, draws_of_config, parse_draws, with_each_choice
from testbed.cli.shared.repeated_options import WantedDrive, advice
from testbed.cli.shared.variants import variants
from testbed.datasets.card import CARD, Publication
from testbed.datasets.description import describe
from testbed.datasets.index import chosen_splits, datasets_in, indexed_datasets, seconds_of, settings_of, world_in
from testbed.datasets.simulated import DatasetFormat, is_complete, write_dataset
from testbed.seeds import RunSeeds
from testbed.settings.comparison import changed_settings
from testbed.settings.simulator import FAST_SIMULATOR, FastSimulatorOptions, SimulatorOptions
from testbed.simulation import OdometryConfig
from testbed.simulation.simulator import check_fits
from testbed.toml import without_none
from worlds import expand_names, label
from worlds.file_names import RULE, is_name

MAX_TOURS = 100
"""Worlds whose tours are looked at for a plan."""
MAX_CHANGES = 4
"""Settings that are named where a dataset was made with others."""
MAX_COUNT = 100_000
"""Largest number of datasets of one world."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DatasetOptions:
    """The datasets to make."""

    out: Path
    """Directory that takes the datasets; those that are there already are kept."""
    seed: int = 0
    """Seed of the first dataset; each further one has the next."""
    count: int = 1
    """Number of datasets of each world and variant."""
    workers: int = 1
    """Datasets that are made at the same time."""
    format: DatasetFormat = "rosbag2"
    """rosbag2: MCAP file that ROS 2 plays and Rerun shows; rosbag2-lean: without point clouds, in half the space;
    rosbag2-sqlite: .db3 file; rosbag1: .bag file; carmen: packed CARMEN log; parquet: a table."""
    compress: Annotated[bool, Parameter(negative=())] = False
    """Pack the chunks of rosbag2 with zstd, those of rosbag1 with LZ4. The other formats do not change."""
    vary: tuple[str, ...] = ()
    """KEY=A,B,C: the same drives with each of these values of lidar, beams, noise, clutter, odometry.…, layers.… or
    surface.…; may be repeated, for all combinations."""
    draw: tuple[str, ...] = ()
    """KEY=A,B: each dataset gets one of these values; in each world (with one drive per world: over all worlds of a
    kind) all occur equally often. KEY=LOW..HIGH: a random number from this range. Keys as for --vary, and robot; may be
    repeated."""
    shard: str | None = None
    """i/n: make only shard i of n (from 0); `testbed datasets index` combines the shards."""
    scheduler: str | None = None
    """Address of a dask.distributed scheduler, such as tcp://host:8786, whose workers make the datasets; --out must be
    a directory that they share."""
    plan: Annotated[bool, Parameter(negative=())] = False
    """Make nothing; print what the job will take in time and on disk, measured on some of its drives."""
    title: str | None = None
    """Title of the card (README.md); default: that of the card that is there, at first the name of --out."""
    author: str | None = None
    """Who publishes the data, for the sentence to cite in the card; default: as in the card that is there."""
    url: str | None = None
    """Address at which the data are published, for the same sentence; default: as in the card that is there."""
    variant: Annotated[str, Parameter(show=False)] = ""
    """Part of the datasets' names; --vary sets it."""
    config: Path | None = None
    """TOML file with settings, such as the config.toml of a dataset; the command line wins."""

    def __post_init__(self) -> None:
        if self.count < 1 or self.workers < 1:
            raise ValueError(f"count and workers must be at least 1, got {self.count} and {self.workers}")
        if self.count > MAX_COUNT:
            raise ValueError(f"count must be at most {MAX_COUNT:,} datasets of each world, got {self.count:,}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, got {self.seed}")
        if self.variant and not is_name(self.variant):
            raise ValueError(f"variant {self.variant!r}: expected {RULE}")
        if self.out.exists() and not self.out.is_dir():
            raise ValueError(f"{self.out}: is a file, expected a directory")


def simulate(world: str, *, datasets: DatasetOptions, simulator: FastSimulatorOptions = FAST_SIMULATOR) -> None:
    """Write synthetic datasets.

    Parameters
    ----------
    world
        Name from the catalogue (`testbed worlds list`), a TOML file, a ROS map (`.yaml`), or `generated:KIND:SEED`;
        several are separated by commas, and `generated:KIND*N` stands for N generated worlds.
    """
    if simulator.driver.kind in ("explore", "teleop"):
        raise ValueError(f"--driver {simulator.driver.kind} needs a mapper or a person: use testbed run")
    jobs = all_jobs = _jobs(world, datasets, simulator.settled())
    announce_backend(simulator)
    if datasets.shard is not None:
        from testbed.sweep.spec.plan import Shard  # here, since a plain job does without the sweep

        shard = Shard.parse(datasets.shard)
        jobs = jobs[shard.index :: shard.count]
    missing = [job for job in jobs if not _is_kept(job)]
    if datasets.plan:
        _print_plan(jobs, missing, datasets, _split_lines(all_jobs, datasets.out))
        return
    if missing and not all(_by_split(all_jobs, datasets.out).values()):
        console.print("\n".join(_split_lines(all_jobs, datasets.out)), soft_wrap=True)
    announce_compilation()
    datasets.out.mkdir(parents=True, exist_ok=True)
    if missing and len(missing) < len(jobs):
        console.print(f"{len(jobs) - len(missing)} of {len(jobs)} datasets exist already; the others are made")
    with dataset_progress(len(missing)) as progress:
        drives = _make_all(missing, datasets, progress)
        summary = ""
        if len(datasets_in(datasets.out)) > 1:
            progress.stage("writing index, card and contact sheet")
            publication = Publication(datasets.title, datasets.author, datasets.url)
            summary = describe(datasets.out, command=_command_for_card(jobs, datasets.out), publication=publication)
    results.print(f"{datasets.out}: {_written(len(missing), len(jobs) - len(missing))}")
    for trouble in ("collided", "stuck"):
        if names := sorted(job.path.name for job, drive in drives.items() if drive[trouble]):
            results.print(f"{len(names)} {trouble}: {', '.join(names[:10])}{' and others' if names[10:] else ''}")
    if summary:
        results.print(summary)


def _command_for_card(jobs: list[_Job], out: Path) -> str | None:
    """Return this command, for the card; None where the card knows all of its datasets already."""
    known = indexed_datasets(out) if (out / CARD).is_file() else set()
    return None if {job.path.name for job in jobs} <= known else "testbed " + shlex.join(sys.argv[1:])


def _print_plan(jobs: list[_Job], missing: list[_Job], options: DatasetOptions, splits: list[str]) -> None:
    """Print the splits and what the missing datasets will take; first what is known without a measurement."""
    there = f"; {len(jobs) - len(missing)} exist already" if len(missing) < len(jobs) else ""
    results.print(f"{options.out}: {len(missing)} dataset{'' if len(missing) == 1 else 's'} to make{there}")
    for line in splits:
        results.print(line)
    results.print(f"free on this disk: {free_space(options.out) / 1e9:.1f} GB")
    if not missing:
        return
    announce_compilation()
    expected = _expected_seconds(missing)
    with TemporaryDirectory(prefix="testbed-plan-") as directory:

        def make(number: int) -> Measured:
            job = replace(missing[number], path=Path(directory) / str(number))
            begun = time.monotonic()
            drive = _make(job)
            cost = time.monotonic() - begun
            return Measured(cost, drive["seconds"], drive["metres"], drive["bytes"], expected[number])

        kinds = [Kind(_kind_of_world(job.world), job.simulator.lidar) for job in missing]
        with counted_seconds() as say:
            measured = measure_some(kinds, make, say=say)
    drives = list(zip(kinds, expected, strict=True))
    for line in plan_lines(measured, drives, options.workers, options.out):
        results.print(line)
    if splits:
        names = [job.name for job in missing]
        seconds = _seconds_of_worlds(options.out, zip(names, lasting(measured, drives), strict=True))
        for line in share_lines(seconds, chosen_splits(options.out), options.out):
            results.print(line)


def _seconds_of_worlds(out: Path, planned: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Driving time of each world [s]: of the datasets that are there, and of the planned ones."""
    there = ((world_in(path), seconds_of(path)) for path in datasets_in(out))
    seconds: defaultdict[str, float] = defaultdict(float)
    for world, lasts in (*there, *planned):
        seconds[world] += lasts
    return seconds


def _by_split(jobs: list[_Job], out: Path) -> dict[str, list[str]]:
    """Which worlds are for training, validation and testing once the datasets are there; empty for one dataset."""
    world_of = {path.name: world_in(path) for path in datasets_in(out)} | {job.path.name: job.name for job in jobs}
    return worlds_by_split(world_of.values(), chosen_splits(out)) if len(world_of) > 1 else {}


def _split_lines(jobs: list[_Job], out: Path) -> list[str]:
    """The same as a line or two; none for one dataset."""
    by_split = _by_split(jobs, out)
    return split_lines(by_split, were_chosen=bool(chosen_splits(out))) if by_split else []


def _expected_seconds(jobs: list[_Job]) -> list[float]:
    """About how long each drive lasts [s], by the tour of its world.

    Of more than `MAX_TOURS` worlds only a part is looked at; the others count as the mean of their kind.
    """
    of_world = {job.world: job.simulator for job in jobs}
    chosen = list(of_world)[:: -(-len(of_world) // MAX_TOURS)]
    seconds = {world: _tour_seconds(world, of_world[world]) for world in chosen}
    by_kind: dict[str, list[float]] = {}
    for world in chosen:
        by_kind.setdefault(_kind_of_world(world), []).append(seconds[world])
    mean = {kind: sum(values) / len(values) for kind, values in by_kind.items()}
    everything = sum(seconds.values()) / len(seconds)
    return [seconds.get(job.world) or mean.get(_kind_of_world(job.world), everything) for job in jobs]


def _tour_seconds(world: str, simulator: SimulatorOptions) -> float:
    """How long a drive along the tour of a world takes without a stop [s]; 1 for drivers that follow no tour."""
    if simulator.driver.kind != "tour":
        return 1.0
    tour = replace(simulator, route="fixed", clutter=0.0).load_world(world, RunSeeds.from_seed(0)).path()
    length = float(np.hypot(*np.diff(tour, axis=0).T).sum())
    return min(length / simulator.driver.speed, simulator.duration or math.inf)


def _kind_of_world(world: str) -> str:
    """Return what drives of like length have in common: the world, or the kind of a generated one."""
    return world.rpartition(":")[0] if world.startswith("generated:") else world


def _written(new: int, old: int) -> str:
    """Return the sentence that reports how many datasets were written and how many existed before."""
    existed = f"; {old} existed already and {'was' if old == 1 else 'were'} kept" if old else ""
    return f"wrote {new} dataset{'' if new == 1 else 's'}{existed}"


@dataclass(frozen=True, eq=False)
class _Job:
    """One dataset to make."""

    path: Path
    world: str
    """Name or file of the world."""
    name: str
    """Name of the world, as the index has it."""
    simulator: SimulatorOptions
    seed: int
    variant: str
    draws: dict[str, Any]
    """Values that were drawn, by setting."""
    log_format: DatasetFormat
    compress: bool


def _settings(job: _Job) -> dict[str, Any]:
    """The settings that make a dataset, as its config.toml holds them."""
    packed = {"compress": True} if job.compress else {}
    settings = {"world": job.world, "format": job.log_format, **packed, "variant": job.variant}
    return settings | asdict(job.simulator) | {"seed": job.seed}


def _is_kept(job: _Job) -> bool:
    """Tell whether the dataset is there already; ValueError where another thing, or a dataset of other settings, is."""
    if not is_complete(job.path):
        if job.path.exists():
            raise ValueError(f"{job.path}: exists and is no dataset; choose another --out")
        return False
    there, wanted = settings_of(job.path), without_none(_settings(job))
    # A dataset of an earlier version was made without the settings that came later, as by their defaults.
    there = {**there, "odometry": asdict(OdometryConfig()) | there.get("odometry", {})}
    # The world is in the dataset's name: relative and absolute names of one file are the same.
    if changes := [change for change in changed_settings(there, wanted) if change.key != "world"]:
        found = ", ".join(change.sentence for change in changes[:MAX_CHANGES])
        more = f", and {len(changes) - MAX_CHANGES} further settings differ" if changes[MAX_CHANGES:] else ""
        drive = WantedDrive(job.world, job.seed, job.simulator, job.draws)
        what_to_do = advice(job.path, drive, {change.key: change.there for change in changes})
        raise ValueError(f"{job.path}: {found}{more}; {what_to_do}")
    return True


def _jobs(worlds: str, options: DatasetOptions, simulator: SimulatorOptions) -> list[_Job]:
    """Return all datasets to make. Raises ValueError for invalid settings, before any worker starts."""
    draws = parse_draws(options.draw, simulator)
    if twice := {draw.key for draw in draws} & {text.partition("=")[0].strip() for text in options.vary}:
        raise ValueError(f"{', '.join(sorted(twice))}: given to --vary and --draw, expected one of them")
    chosen = variants(simulator, options.vary)
    jobs, out = [], options.out if options.scheduler is None else options.out.resolve()
    for world in expand_names(worlds):
        for variant in chosen:
            name, variant_name = _checked_name(world, variant.simulator, draws), variant.name or options.variant
            for seed in range(options.seed, options.seed + options.count):
                path = out / "-".join(part for part in (name, f"{seed:04d}", variant_name) if part)
                job = _job(path, world, seed, draws, variant.simulator, variant_name, options)
                jobs.append(replace(job, name=name))
    if len({job.path for job in jobs}) < len(jobs):
        raise ValueError(f"{worlds}: two worlds have the same name, expected different ones")
    return jobs


def _job(
    path: Path,
    world: str,
    seed: int,
    draws: list[Draw],
    simulator: SimulatorOptions,
    variant: str,
    options: DatasetOptions,
) -> _Job:
    settings, values = drawn(simulator, draws, world, seed)
    values = draws_of_config(options.config, settings, seed) | values
    return _Job(path, world, label(world), settings, seed, variant, values, options.format, options.compress)


def _checked_name(world: str, simulator: SimulatorOptions, draws: list[Draw]) -> str:
    """Return the name of a world for its datasets, after a check that all robots fit into it.

    Generated worlds are made by the workers: there may be a thousand of them.
    """
    if world.startswith("generated:"):
        return label(world)
    seeds = RunSeeds.from_seed(0)
    tour = replace(simulator, route="fixed")  # routes keep as far from walls as the tour
    loaded = tour.load_world(world, seeds, SlowProgress("planning a tour"))
    announce_world(loaded)
    for possible in with_each_choice(simulator, draws, "robot"):
        check_fits(loaded, possible.simulation(seeds).robot)
    simulator.recorded_commands()
    return loaded.name


def _make(job: _Job) -> dict[str, Any]:
    """Make one dataset, in a worker; return how the drive went, and the bytes written."""
    seeds, simulator = RunSeeds.from_seed(job.seed), job.simulator
    drive = write_dataset(
        job.path,
        simulator.load_world(job.world, seeds),
        simulator.simulation(seeds),
        _settings(job),
        log_format=job.log_format,
        commands=simulator.recorded_commands(),
        draws=job.draws,
        compressed=job.compress,
    )
    return drive | {"bytes": sum(file.stat().st_size for file in job.path.iterdir())}


def _make_all(jobs: list[_Job], options: DatasetOptions, progress: DatasetProgress) -> dict[_Job, dict[str, Any]]:
    """Make all datasets; return how each drive went."""
    drives: dict[_Job, dict[str, Any]] = {}
    try:
        for job, drive in _made(jobs, options, progress):
            drives[job] = drive
            progress.done(job.path.name, drive["seconds"], drive["bytes"])
    except KeyboardInterrupt:
        progress.stage("interrupted")
        console.print(f"{len(drives)} of {len(jobs)} datasets were made; the same command continues with the others")
        raise
    return drives


def _made(
    jobs: list[_Job], options: DatasetOptions, progress: DatasetProgress
) -> Iterator[tuple[_Job, dict[str, Any]]]:
    """Make datasets in this process, in a pool, or on a cluster; yield each as it is finished."""
    if options.scheduler is not None:
        from testbed.sweep.execution.dask_cluster import compute_on_cluster

        yield from compute_on_cluster(_make, jobs, options.scheduler)
    elif options.workers == 1 or len(jobs) <= 1:
        for job in jobs:
            yield job, _make(job)
    else:
        progress.stage(f"starting {min(options.workers, len(jobs))} workers")
        yield from _made_by_pool(jobs, options.workers)


def _made_by_pool(jobs: list[_Job], workers: int) -> Iterator[tuple[_Job, dict[str, Any]]]:
    context = get_context("spawn")  # not forked: PyBullet and numba keep threads
    pool = ProcessPoolExecutor(min(workers, len(jobs)), mp_context=context, initializer=_end_with_parent)
    with pool, _workers_end_with_block([job.path for job in jobs]):
        with _ctrl_c_blocked():  # workers inherit this for good: Ctrl-C is the parent's business
            futures = {pool.submit(_make, job): job for job in jobs}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool:
            raise ValueError(
                "a worker was killed, perhaps because memory ran out; the same command continues with what is missing"
            ) from None


def _end_with_parent() -> None:
    """Make this worker exit when its parent process dies."""

    def watch() -> None:
        if (parent := parent_process()) is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _workers_end_with_block(paths: list[Path]) -> Iterator[None]:
    """End the workers at once where the block ends early: the datasets at hand are made again by the next start."""
    try:
        yield
    except BaseException:
        for worker in active_children():
            worker.terminate()
            worker.join()
        for path in paths:
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
