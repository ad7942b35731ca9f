# SPDX-License-Identifier: MIT
"""Options of `run` and `slam` that name SLAM systems, and what happens with them: all run on the same frames."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Group, Parameter
from rich.table import Table

from eval.limits import check
from eval.report.comparison import write_comparison
from eval.report.run_report import write_report
from eval.wording import up_to_a_tenth
from testbed.cli.shared.console import announce_compilation, console, progress_line, results
from testbed.cli.shared.output import OutputOptions
from testbed.cli.shared.status import GATE_FAILED, USAGE_ERROR
from testbed.frame import Frame
from testbed.run.run_directory import RunDirectory
from testbed.settings.estimator import EstimatorOptions
from testbed.systems.entrant import Entrant, PythonSystem, built_in_program, filter_settings
from testbed.systems.errors import SystemFailedError, SystemsError
from testbed.systems.execute import Recorded, execute_system
from testbed.systems.feeding import Estimated
from testbed.systems.finding import BUILT_IN_PROGRAMS, check_names, make_system, settings_of
from testbed.systems.layers import layers_of
from testbed.systems.particles import KeptParticles
from testbed.systems.program import DatasetFormat, Program
from testbed.views import Scene, SystemLayer, record_systems
from testbed.views.opening import RECORDING

SYSTEM_GROUP = Group("SLAM systems (instead of the filter of this package)", sort_key=12)


@Parameter(name="*", group=SYSTEM_GROUP)
@dataclass(frozen=True, kw_only=True)
class SystemOptions:
    """Which systems process the frames; none = the filter of this package, in a directory without subdirectories."""

    system: str | None = None
    """Names (`testbed systems list`) or FILE.py:CLASS, separated by commas. All see the same frames; each is written
    to a subdirectory, and comparison.html shows them side by side."""
    system_set: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    """NAME.FIELD=VALUE: a setting of one of the systems. May be repeated."""
    system_command: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    """A program as a system, such as 'my_slam {dataset} {out}': it reads the recording and leaves trajectory.tum and,
    if it has one, map.yaml. {seed} is the seed. May be repeated."""
    system_format: DatasetFormat = "rosbag2"
    """Format of the recording that programs get."""
    system_time_limit: float = 3600.0
    """Time limit of a program, or of one call of a class [s]."""
    system_memory_limit: float | None = None
    """Limit of the memory of a program with all its processes [MB]."""

    @property
    def texts(self) -> list[str]:
        """The systems that are named."""
        return [text.strip() for text in (self.system or "").split(",") if text.strip()]

    @property
    def requested(self) -> bool:
        """Whether systems are named."""
        return self.system is not None or bool(self.system_command)

    def __post_init__(self) -> None:
        if self.system_set and not self.requested:
            raise ValueError(f"--system-set {self.system_set[0]}: expected --system as well")
        if not self.system_time_limit > 0.0:
            raise ValueError(f"--system-time-limit {self.system_time_limit:g}: expected a positive time [s]")
        if self.system is not None and not self.texts:
            raise ValueError(f"--system {self.system!r}: expected names, separated by commas")

    def entrants(self, estimator: EstimatorOptions, shared: Mapping[str, object] | None = None) -> list[Entrant]:
        """Make the systems once, so that mistakes show before anything takes time.

        shared: further settings, which go to the systems that have them. Raises SystemsError.
        """
        classes = [
            PythonSystem(text, _own_settings(text, estimator, shared or {}))
            for text in self.texts
            if text not in BUILT_IN_PROGRAMS
        ]
        classes = [replace(e, seconds=self.system_time_limit) for e in _with_values(classes, self.system_set)]
        made: dict[str, Entrant] = {entrant.text: entrant for entrant in classes}
        made |= {text: self._limited(built_in_program(text)) for text in self.texts if text in BUILT_IN_PROGRAMS}
        found = [made[text] for text in self.texts]
        found += [
            self._limited(Program(command=command, log_format=self.system_format)) for command in self.system_command
        ]
        check_names(entrant.name for entrant in found)
        for entrant in found:
            entrant.facts()
        return found

    def _limited(self, program: Program) -> Program:
        return replace(program, seconds=self.system_time_limit, megabytes=self.system_memory_limit)

    def check_other_options(self, output: OutputOptions, *, explores: bool = False) -> None:
        """Raise ValueError for options that look into the filter of this package."""
        for option in ("view", "serve", "connect"):
            if getattr(output, option):
                raise ValueError(f"--{option}: shows the filter of this package, expected it without --system")
        if explores:
            raise ValueError("--driver explore: drives by the filter of this package, expected another with --system")

    def settings(self) -> dict[str, Any]:
        """Return the options for `config.toml`."""
        given = {key: value for key, value in asdict(self).items() if value != getattr(SystemOptions, key)}
        return given if self.requested else {}


SYSTEMS = SystemOptions()


def _own_settings(text: str, estimator: EstimatorOptions, shared: Mapping[str, object]) -> dict[str, object]:
    """Settings of the filter from the command line, for the systems that are made of it."""
    known = settings_of(make_system(text))
    given = {key: value for key, value in shared.items() if key in known}
    of_filter = filter_settings(text, estimator.filter_config, refine=estimator.refine, threads=estimator.threads)
    return given | of_filter


def _with_values(entrants: list[PythonSystem], texts: tuple[str, ...]) -> list[PythonSystem]:
    """Give each `NAME.FIELD=VALUE` to its system."""
    values: dict[str, dict[str, object]] = {entrant.name: {} for entrant in entrants}
    for text in texts:
        key, equals, value = text.partition("=")
        owner = next((name for name in values if key.startswith(f"{name}.")), None)
        if not equals or owner is None:
            names = ", ".join(values)
            raise SystemsError(f"--system-set {text}: expected NAME.FIELD=VALUE with NAME one of {names}")
        values[owner][key.removeprefix(f"{owner}.")] = value.strip()
    return [PythonSystem(e.text, {**e.settings, **values[e.name]}) for e in entrants]


def compare_systems(
    entrants: list[Entrant], recorded: Recorded, document: Mapping[str, Any], name: str, output: OutputOptions
) -> int:
    """Run the systems on one recording, each into its own directory, and write a comparison; returns the exit status.

    name: of the directory, if the user names none. A system that fails is named with its reason; the others go on.
    """
    announce_compilation()
    root = output.out or output.default_path(name)
    found: dict[str, dict[str, Any]] = {}
    particles: dict[str, KeptParticles] = {}
    failed: dict[str, str] = {}
    for entrant in entrants:
        try:
            found[entrant.name], estimated = _run_one(entrant, recorded, document, root, output)
            particles[entrant.name] = estimated.particles
        except (SystemFailedError, SystemsError) as error:
            if os.environ.get("TESTBED_DEBUG"):
                raise
            failed[entrant.name] = " ".join(str(error).split())
            console.print(f"testbed: {failed[entrant.name]}", soft_wrap=True, markup=False)
    results.print(comparison_table(found, failed))
    broken = [(system, text) for system, metrics in found.items() for text in check(metrics, output.limits)]
    for system, sentence in broken:
        console.print(f"limit broken: {system}: {sentence}", soft_wrap=True)
    for system, metrics in found.items():
        for note in metrics["notes"]:
            console.print(f"note: {system}: {note}", soft_wrap=True, markup=False)
    _record(particles, recorded, document, root)
    if found and len(entrants) > 1:
        shown = [root / entrant.name for entrant in entrants]
        results.print(f"comparison: {write_comparison(shown, root / 'comparison.html').resolve()}")
    for system in found:
        results.print(f"report: {(root / system / 'report.html').resolve()}")
    return USAGE_ERROR if failed else GATE_FAILED if broken else 0


def _record(found: Mapping[str, KeptParticles], recorded: Recorded, document: Mapping[str, Any], root: Path) -> None:
    """Write what all systems made of the drive as one recording, and say where; nothing where none has a path.

    found: particles of the systems that have a result, by name
    """
    layers = layers_of([root / system for system in found], recorded.frames, found)
    if not layers:
        return
    settings = document["settings"]
    title = f"{Path(str(settings.get('world', settings.get('log', root)))).name}: {', '.join(found)}"
    with progress_line() as line:
        line.stage("recording")
        scene = Scene(title=title, true_map=recorded.reference.grid)
        record_systems(root / RECORDING, recorded.frames, layers, scene)
    results.print(f"recording: {(root / RECORDING).resolve()}")
    if words := _farthest_off(layers, recorded.frames, root):
        results.print(words)


def _farthest_off(layers: Sequence[SystemLayer], frames: Sequence[Frame], root: Path) -> str:
    """The command that draws the moment at which a system is farthest from the truth; empty where that is unknown."""
    stamps = np.array([frame.stamp for frame in frames if frame.scan is not None])
    known = [(layer, layer.errors) for layer in layers if layer.errors is not None and np.isfinite(layer.errors).any()]
    if not known:
        return ""
    worst, errors = max(known, key=lambda pair: float(np.nanmax(pair[1])))
    at = stamps[worst.rows[int(np.nanargmax(errors))]] - stamps[0]
    command = f"testbed view {shlex.quote(str(root))} --time {up_to_a_tenth(float(at)):.1f} --save moment.png"
    return f"moment: {command} (where {worst.name} is farthest off)"


def _run_one(
    entrant: Entrant, recorded: Recorded, document: Mapping[str, Any], root: Path, output: OutputOptions
) -> tuple[dict[str, Any], Estimated]:
    directory = RunDirectory.create(root / entrant.name, overwrite=output.overwrite)
    if isinstance(entrant, Program):
        entrant = replace(entrant, keep_log=directory.path)
    total = len(recorded.frames)
    rows = {id(frame): row for row, frame in enumerate(recorded.frames)}
    with progress_line() as line:
        line.stage(entrant.name)
        if isinstance(entrant, Program) and not console.is_terminal:  # it tells nothing until it ends
            console.print(f"{entrant.name} runs, and is not heard of until it ends …", soft_wrap=True)

        def step(frame: Frame) -> None:
            line.step(frame.stamp, (rows[id(frame)] + 1) / total, None)

        metrics, estimated = execute_system(entrant, recorded, directory, document, step)
        line.stage("report")
        with directory.marked(metrics):
            write_report(directory.path)
    return metrics, estimated


COLUMNS = (
    ("trajectory.ate_rmse_m", "ATE", "{:.3f} m"),
    ("trajectory_online.ate_rmse_m", "while driving", "{:.3f} m"),
    ("relations.trans_mean_m", "relations", "{:.3f} m"),
    ("relations.rot_mean_deg", "", "{:.2f} deg"),
    ("map.f1_1_cells", "map, F1", "{:.3f}"),
    ("system.ms_per_scan", "ms a scan", "{:.2f}"),
    ("system.memory_mb", "memory", "{:.0f} MB"),
)
"""Key in metrics.json, heading, format."""


def comparison_table(found: Mapping[str, Mapping[str, Any]], failed: Mapping[str, str]) -> Table:
    """Make a table with a row for each system; columns that no system has are left out."""
    shown = [column for column in COLUMNS if any(_value(metrics, column[0]) is not None for metrics in found.values())]
    table = Table(box=None, pad_edge=False)
    table.add_column("system", no_wrap=True)
    table.add_column("outcome", no_wrap=True)
    for _, heading, _ in shown:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, metrics in found.items():
        values = [(_value(metrics, key), text) for key, _, text in shown]
        table.add_row(name, metrics["outcome"], *("–" if v is None else text.format(v) for v, text in values))
    for name in failed:
        table.add_row(name, "failed", *["–"] * len(shown))
    return table


def _value(metrics: Mapping[str, Any], key: str) -> Any:
    value: Any = metrics
    for part in key.split("."):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value
