# SPDX-License-Identifier: MIT
"""`testbed perturb`."""

from __future__ import annotations

import shlex
from dataclasses import field, fields, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Group, Parameter

from eval.files.tum import read_tum
from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import console
from testbed.datasets.perturbed import write_changed_log
from testbed.datasets.simulated import DatasetFormat
from testbed.datasets.truth import attach_truth
from testbed.formats import Log
from testbed.inspect import Reading
from testbed.seeds import RunSeeds
from testbed.stress.table import PERTURBATIONS, Perturbation
from testbed.stress.table import perturb as perturbed

PERTURBATION_GROUP = Group("Perturbations", sort_key=5)


def _option(row: Perturbation) -> tuple[str, Any, Any]:
    """The field of a perturbation, whose option is its name."""
    shown = Parameter(name=f"--{row.name}", help=row.summary)
    return row.name.replace("-", "_"), Annotated[float | None, shown], field(default=None)


if TYPE_CHECKING:
    PerturbationOptions = Any
else:
    PerturbationOptions = Parameter(name="*", group=PERTURBATION_GROUP)(
        make_dataclass(
            "PerturbationOptions",
            map(_option, PERTURBATIONS.values()),
            frozen=True,
            kw_only=True,
            namespace={"__module__": __name__},
        )
    )
NO_PERTURBATION: Any = None if TYPE_CHECKING else PerturbationOptions()


def perturb(
    log: Path,
    out: Path,
    *,
    seed: int = 0,
    truth: Path | None = None,
    to: DatasetFormat | None = None,
    laser_offset: float | None = None,
    range_max: float | None = None,
    perturbations: PerturbationOptions = NO_PERTURBATION,
) -> None:
    """Make a recording harder: the same drive with faults of lidar, wheels, clocks and surroundings.

    Parameters
    ----------
    log
        A recorded log or dataset directory; its format is recognised from the content.
    out
        Directory to write: the recording, its truth where that is known, and config.toml with the command.
    seed
        Seed of what is drawn at random; the same seed gives the same bytes.
    truth
        True trajectory in the TUM format, with the clock of the log, where the log does not hold it.
    to
        Format of the recording in the directory, see `testbed convert`. Default: parquet for a Parquet table,
        rosbag2 for all others.
    laser_offset
        x of the laser in the robot's frame [m]; default: stated by the log.
    range_max
        Readings of at least this range are no returns [m]; default: stated or shown by the log.
    """
    names = {row.name.replace("-", "_"): row.name for row in PERTURBATIONS.values()}
    values = {names[part.name]: getattr(perturbations, part.name) for part in fields(perturbations)}
    chosen = {name: PERTURBATIONS[name].check(value) for name, value in values.items() if value is not None}
    if not chosen:
        raise ValueError(
            f"nothing to change, expected at least one perturbation such as --{next(iter(names.values()))}"
        )
    seeds = RunSeeds.from_seed(seed)
    if out.exists():  # complain before a large log is read
        raise ValueError(f"{out}: exists; choose another name")
    with AT_WORK.doing(f"reading {log}"):
        read = Reading(laser_offset=laser_offset, range_max=range_max).open(log)
    table = read.table if truth is None else attach_truth(read.table, read_tum(truth))
    frames = perturbed(table.frames(), chosen, seeds.perturbation)
    changed = Log.from_frames(
        frames, path=log, format=read.format, truth_map=read.truth_map, robot_urdf=read.robot_urdf
    )
    to = to or ("parquet" if read.format == "Parquet table" else "rosbag2")
    command = _command(log, out, seed, truth, to, laser_offset, range_max, chosen)
    with AT_WORK.doing(f"writing {out}"):
        write_changed_log(out, changed, log, {"perturbed": {"command": command, "seed": seed, "values": chosen}}, to)
    for note in read.notes:
        console.print(f"{log}: {note}", soft_wrap=True)
    words = ", ".join(f"{name} {value:g} {PERTURBATIONS[name].unit}" for name, value in chosen.items())
    console.print(
        f"{out}: {len(frames)} frames, {changed.scan_count} of {read.scan_count} scans: {words}", soft_wrap=True
    )


def _command(
    log: Path,
    out: Path,
    seed: int,
    truth: Path | None,
    to: str,
    laser_offset: float | None,
    range_max: float | None,
    chosen: dict[str, float],
) -> str:
    """The command that makes the same bytes again."""
    options = {"seed": seed, "to": to, "truth": truth, "laser-offset": laser_offset, "range-max": range_max, **chosen}
    words = ["testbed", "perturb", str(log), str(out)]
    for name, value in options.items():
        if value is not None:
            words += [f"--{name}", str(value)]
    return shlex.join(words)
