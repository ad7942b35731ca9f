# SPDX-License-Identifier: MIT
"""Options of `testbed sweep`: what is computed, how it is executed, and what it is compared with."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from eval.sweep.look_schedule import MAX_SEEDS_UNTIL_DECIDED
from testbed.cli.shared.output import FLAG
from testbed.presets import filter_settings, filters
from testbed.sweep.errors import SweepError
from testbed.sweep.execute import Executor
from testbed.sweep.execution.dask_cluster import run_on_cluster
from testbed.sweep.execution.local_pool import run_locally
from testbed.sweep.execution.worker_process import Limits
from testbed.sweep.spec.plan import Shard
from testbed.sweep.spec.spec import BASELINE, SweepSpec, parse_spec, parsed_axes, read_document, read_preset
from testbed.sweep.store import MANIFEST, SweepDirectory
from testbed.systems.program import DatasetFormat
from worlds import expand_names

MAX_WORKERS_PER_CORE = 4
"""More worker processes would only take memory from each other."""


SYSTEMS_PARTICLES = 30
"""Particle count of a sweep over SLAM systems that names none."""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SweepOptions:
    """What is to be computed: a preset or flags. Flags override a file and a preset."""

    preset: str | None = None
    """Specification in the package: particles, experiment, experiment-long, experiment-test, gate."""
    worlds: str | None = None
    """Worlds, separated by commas; generated:rooms*20 stands for 20 generated worlds. No default: worlds, --preset, a
    file, or the --out of a sweep is needed."""
    particles: str | None = None
    """Particle counts, separated by commas. Default: 1,2,5,10,20,50,100."""
    seeds: str | None = None
    """Number of seeds, from 0 on; or a list such as 0,1,2 or a range such as 0:10. Default: 10; with --until: 40."""
    drawn_seeds: int | None = None
    """With how many of the seeds each world of generated:KIND*N is driven, since there each world counts once.
    Default: all of them."""
    route: Literal["fixed", "random"] | None = None
    """fixed: all seeds drive the tour of the world; random: each seed drives it in another order, from another start.
    Default: random, unless a file or preset says otherwise."""
    measure: str | None = None
    """What accuracy is measured by: online (poses while driving), filter (the best particle's path at the end), refined
    (the final estimate, after the final pass), or a key of metrics.json of which less is better. Default: filter."""
    margin: str | None = None
    """By how much an error may exceed that of the largest count before it matters: a share, a length, or both, of which
    the larger counts. Default: 10%,5mm."""
    refine: Literal["ends", "all", "none"] | None = None
    """Which runs end with the final pass: those with the smallest and the largest count, all, or none. Default: ends;
    all if --measure is one of the final pass."""
    until: Literal["decided", "smallest"] | None = None
    """decided: evaluate after every 8 seeds, and add seeds (up to --seeds, default 40) only for worlds without an
    answer. smallest: go on until the smallest count that is enough is known. All evaluations together are right with
    95 % confidence."""
    give_up: str | None = None
    """Worlds or logs that get no more seeds with --until, separated by commas; none: all get them again. What
    is computed stays, and no answer becomes wrong by it."""
    filter: str | None = None
    """Filter presets, such as paper or gmapping, separated by commas: each adds a curve to the plots, next to that of
    the default settings."""
    system: str | None = None
    """SLAM systems (`testbed systems list`) or FILE.py:CLASS, separated by commas: each adds a curve to the plots. All
    see the same data, and each is compared with the first: name the baseline first, as in odometry,FILE.py:CLASS.
    --particles is then one count, which only the filter of this package takes. Default: 30."""
    system_command: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    """A program as a system, such as 'my_slam {dataset} {out}', see docs/systems.md. May be repeated."""
    system_format: DatasetFormat | None = None
    """Format of the recording that programs get. Default: rosbag2."""
    axis: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    """NAME=VALUE,VALUE: a setting with several values; each adds a curve to the plots. May be repeated."""
    set: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    """NAME=VALUE: a setting of all runs. May be repeated."""

    @property
    def systems(self) -> list[str]:
        """The SLAM systems of --system and --system-command."""
        return [*(_words(self.system) if self.system is not None else ()), *self.system_command]

    def document(self) -> dict[str, Any]:
        """The given flags as the document of a specification."""
        flags: dict[str, Any] = {}
        if self.worlds is not None:
            flags["worlds"] = expand_names(self.worlds)
        if self.particles is not None:
            flags["particles"] = _counts(self.particles)
        if self.seeds is not None:
            flags["seeds"] = self.seeds
        if self.drawn_seeds is not None:
            flags["drawn_seeds"] = self.drawn_seeds
        if self.measure is not None:
            flags["measure"] = self.measure
        if self.margin is not None:
            flags["margin"] = self.margin
        if self.until is not None:
            flags |= {"until": self.until, "seeds": self.seeds or MAX_SEEDS_UNTIL_DECIDED}
        if self.give_up is not None:
            flags["give_up"] = [] if self.give_up == "none" else _words(self.give_up)
        if self.filter is not None:
            flags["variants"] = {"default": {}} | {name: _filter_preset(name) for name in _words(self.filter)}
        if self.axis:
            flags["axes"] = parsed_axes(self.axis)
        if self.systems:
            flags["axes"] = {"system": self.systems} | flags.get("axes", {})
            flags.setdefault("particles", [SYSTEMS_PARTICLES])
        return flags

    def specification(self, file: Path | None, out: Path | None) -> SweepSpec:
        """The specification of a file, a preset or flags; without file and preset, flags change that of the sweep in
        `out`, if there is one."""
        if file is not None and self.preset is not None:
            raise SweepError(f"{file} and --preset {self.preset}: expected one of the two")
        if file is not None:
            return self._with_flags(read_document(file), str(file), file.parent)
        if self.preset is not None:
            return self._with_flags(read_preset(self.preset), f"preset {self.preset}", Path())
        if out is not None and (self == SweepOptions() or (out / MANIFEST).is_file()):
            document = SweepDirectory.open(out).manifest.spec.document()
            return self._with_flags(document, str(out / MANIFEST), Path(), is_new=False)
        if self.worlds is None:
            wanted = "expected --worlds, a file, --preset, or --out with the directory of a sweep"
            raise SweepError(wanted if out is None else f"{wanted}; {out} is none")
        return self._with_flags({}, "command line", Path())

    def own_settings(self) -> dict[str, Any]:
        """The settings of --set, --route and --system-format."""
        settings = {name: values[0] for name, values in parsed_axes(self.set).items() if values}
        if self.system_format is not None:
            settings["system_format"] = self.system_format
        return settings if self.route is None else settings | {"route": self.route}

    def _with_flags(self, document: dict[str, Any], source: str, folder: Path, *, is_new: bool = True) -> SweepSpec:
        """The document with the flags; is_new: where it says nothing about routes, each seed gets one of its own."""
        spec = parse_spec(document | self.document(), source, folder)
        settings = self.own_settings()
        if is_new and spec.worlds and not spec.names_route:
            settings = {"route": "random"} | settings
        if self.refine in ("all", "none"):
            settings["refine"] = self.refine == "all"
        shared = {name: value for name, value in spec.settings.items() if name != "refine" or self.refine != "ends"}
        if shared | settings == spec.settings:
            return spec
        return parse_spec(spec.document() | {"settings": shared | settings}, source, folder)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Execution:
    """How the jobs are executed; the results do not depend on it."""

    workers: int | None = None
    """Worker processes. Default: one per core."""
    shard: str | None = None
    """i/n: compute only shard i of n (from 0); `testbed gather` combines the shards."""
    scheduler: str | None = None
    """Address of a dask.distributed scheduler, such as tcp://host:8786, whose workers compute the jobs."""
    time_limit: float = 3600.0
    """Time limit of one job [s]; a job that takes longer counts as failed."""
    memory_limit: float | None = None
    """Memory limit of one worker [MB]. Default: nine tenths of the memory, divided by the workers."""

    def __post_init__(self) -> None:
        most = MAX_WORKERS_PER_CORE * (os.cpu_count() or 1)
        if self.workers is not None and not 1 <= self.workers <= most:
            raise SweepError(f"workers: {self.workers}, expected 1 to {most}, {MAX_WORKERS_PER_CORE} for each core")
        _ = self.limits, self.part

    @property
    def limits(self) -> Limits:
        """Limits of one job."""
        return Limits(seconds=self.time_limit, megabytes=self.memory_limit)

    @property
    def part(self) -> Shard | None:
        """The requested shard; None for all jobs."""
        return None if self.shard is None else Shard.parse(self.shard)

    @property
    def worker_count(self) -> int:
        """Worker processes on this machine."""
        return self.workers or os.cpu_count() or 1

    @property
    def executor(self) -> Executor:
        """Computes the jobs as requested."""
        if self.scheduler is not None:
            return partial(run_on_cluster, address=self.scheduler, limits=self.limits)
        return partial(run_locally, workers=self.worker_count, limits=self.limits)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RegressionOptions:
    """Comparison with a baseline. Without another sweep the preset `gate` is run."""

    check: Annotated[bool, FLAG] = False
    """Exit with 1 if accuracy is worse than the baseline by more than the noise of the seeds."""
    update_baseline: Annotated[bool, FLAG] = False
    """Write a new baseline."""
    baseline: Annotated[Path, Parameter(show_default=False)] = BASELINE
    """File of the baseline. Default: that of the preset `gate`."""

    @property
    def is_requested(self) -> bool:
        """Whether a baseline is read or written."""
        return self.check or self.update_baseline


REQUEST = SweepOptions()
REGRESSION = RegressionOptions()
EXECUTION = Execution()


def _filter_preset(name: str) -> dict[str, Any]:
    """The filter settings of a preset; how many particles and whether the final pass is made is up to the sweep."""
    if name not in filters():
        raise SweepError(f"--filter {name}: unknown, expected one of {', '.join(filters())}")
    document = tomllib.loads(filter_settings(name).read_text(encoding="utf-8"))
    return {"filter": document["settings"]["filter"]}


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _counts(text: str) -> list[int]:
    words = _words(text)
    if not all(word.isdecimal() for word in words):
        raise SweepError(f"--particles {text}: expected whole numbers such as 1,5,30")
    return list(map(int, words))
