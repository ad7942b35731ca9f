# SPDX-License-Identifier: MIT
"""`testbed slam`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Group, Parameter

from eval.files.map_server import read_map
from eval.files.true_walls import read_true_walls
from eval.files.tum import read_tum
from eval.scoring import Reference
from eval.trajectory.relations import read_relations
from slam.config import LocalizationConfig
from slam.occupancy import OccupancyGrid
from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import console
from testbed.cli.shared.finish import run_and_report
from testbed.cli.shared.output import OUTPUT, OutputOptions
from testbed.cli.shared.system_options import SYSTEMS, SystemOptions, compare_systems
from testbed.datasets.truth import attach_truth
from testbed.estimation.known_map import KnownMap
from testbed.frame_table import TableFrames
from testbed.inspect import AS_STATED, Reading, inspect_log, notes_of
from testbed.provenance import config_document, settings_as_markdown
from testbed.run.job import Job, RecordedFrames
from testbed.settings.estimator import ESTIMATOR, EstimatorOptions
from testbed.systems.execute import Recorded
from testbed.views import Scene

LOCALIZATION_GROUP = Group("Localisation (with --map)", sort_key=11)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MapOptions:
    """Map and start for a localisation."""

    map: Path | None = None
    """Finished map (map_server .yaml) to localise in; the map is not changed."""
    start: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Approximate start in the map's frame as X,Y,DEG [m, deg]; default: unknown."""
    localization: Annotated[LocalizationConfig, Parameter(group=LOCALIZATION_GROUP)] = field(
        default_factory=LocalizationConfig
    )
    """Settings of the localisation."""

    def __post_init__(self) -> None:
        if self.map is None and self.start is not None:
            raise ValueError(f"--start {self.start}: needs a map, expected --map FILE.yaml as well")

    def read(self, truth: OccupancyGrid | None) -> KnownMap | None:
        """Read and check the map and the start; None if no map is given."""
        return None if self.map is None else KnownMap.read(self.map, self.start, self.localization, truth)

    def settings(self) -> dict[str, Any]:
        """Return the settings for `config.toml`."""
        if self.map is None:
            return {}
        return {"map": self.map.resolve(), "start": self.start, "localization": asdict(self.localization)}

    @property
    def files(self) -> tuple[Path, ...]:
        """Files of the map."""
        return () if self.map is None else (self.map, self.map.with_suffix(".pgm"))


KNOWN_MAP = MapOptions()


def slam(
    log: Path,
    *,
    relations: Path | None = None,
    truth: Path | None = None,
    reading: Annotated[Reading, Parameter(name="*")] = AS_STATED,
    known_map: MapOptions = KNOWN_MAP,
    estimator: EstimatorOptions = ESTIMATOR,
    output: OutputOptions = OUTPUT,
    systems: SystemOptions = SYSTEMS,
) -> int:
    """Map a recorded log with the particle filter, or localise in a finished map; score it where truth is known.

    Parameters
    ----------
    log
        Recorded log: CARMEN (plain or gzip), ROS 1 or ROS 2 bag, or dataset directory.
    relations
        Hand-checked relations between poses, `t1 t2 x y z roll pitch yaw` (Kümmerle et al. 2009).
    truth
        True trajectory in the TUM format, `t x y z qx qy qz qw`, with the clock of the log.
    """
    output.check_directory()
    filter_config = estimator.filter_config  # raises before the log is read
    entrants = systems.entrants(estimator, known_map.settings())
    if entrants:
        if known_map.map is not None and not any("map" in entrant.facts()["settings"] for entrant in entrants):
            raise ValueError(
                "--map: none of the systems has a setting `map`, expected --system localization among them"
            )
        systems.check_other_options(output)
    with AT_WORK.doing(f"reading {log}"):
        recording = reading.open(log)
    truth_map = _truth_map(log)
    with AT_WORK.doing(f"reading {known_map.map}"):
        known = known_map.read(truth_map)
    known_relations = None if relations is None else read_relations(relations)
    table = recording.table if truth is None else attach_truth(recording.table, read_tum(truth))
    settings = {
        "log": log.resolve(),
        "relations": relations and relations.resolve(),
        "truth": truth and truth.resolve(),
        **asdict(reading),
        **known_map.settings(),
        **estimator.settings(),
        **systems.settings(),
    }
    with AT_WORK.doing(f"inspecting {log}"):
        findings = inspect_log(recording)
    inputs = [path for path in (log, relations, truth, *known_map.files) if path is not None and path.is_file()]
    document = config_document(settings, inputs)
    document["log"] = {"format": recording.format, "notes": list(recording.notes)}
    truth_walls = None if truth_map is None else read_true_walls(log, truth_map)
    name = log.name.split(".")[0]
    if entrants:
        for note in recording.notes:
            console.print(f"{log}: {note}", soft_wrap=True)
        reference = Reference(relations=known_relations, grid=truth_map, walls=truth_walls)
        return compare_systems(entrants, Recorded.of(table.frames(), estimator.seed, reference), document, name, output)
    job = Job(
        source=RecordedFrames(TableFrames(table)),
        document=document,
        seed=estimator.seed,
        system=estimator.system(known),
        relations=known_relations,
        truth_map=truth_map,
        truth_walls=truth_walls,
        notes=notes_of(findings),
    )
    scene = Scene(
        title=f"{name}, seed {estimator.seed}",
        settings=settings_as_markdown(document),
        particles=filter_config.max_particles,
        motion=filter_config.motion,
        true_map=truth_map,
        T_world_map=np.zeros(3) if known is not None and known.has_frame_of_truth else None,
    )
    for note in recording.notes:
        console.print(f"{log}: {note}", soft_wrap=True)
    for finding in findings:
        if finding.verdict == "doubtful":
            console.print(f"{log}: {finding.item}: {finding.found}; {finding.action}", soft_wrap=True)
    for note in known.notes if known is not None else ():
        console.print(note, soft_wrap=True)
    return run_and_report(job, output.directory(name), scene, output)


def _truth_map(log: Path) -> OccupancyGrid | None:
    """Return the true map of a dataset directory; None for other logs."""
    path = log / "truth_map.yaml"
    return read_map(path, inside=True) if path.is_file() else None
