# SPDX-License-Identifier: MIT
"""`testbed twin`."""

from __future__ import annotations

import math
from pathlib import Path

from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import announce_compilation, console, progress_line, results
from testbed.formats import open_log
from testbed.seeds import RunSeeds
from testbed.settings.estimator import ESTIMATOR, EstimatorOptions
from testbed.twin.reconstruction import Reconstruction, read_reconstruction, reconstruct
from testbed.twin.twin import Twin, make_twin, write_twin


def twin(
    log: Path,
    *,
    out: Path,
    laser_offset: float | None = None,
    range_max: float | None = None,
    estimator: EstimatorOptions = ESTIMATOR,
) -> None:
    """Make a world, a drive, a lidar and an odometry like those of a recorded log.

    Parameters
    ----------
    log
        Recorded log, as for `testbed slam`, which is mapped first; or the directory of a run of `testbed slam`, whose
        path and map are used; the options of the filter then have no effect.
    out
        Directory for the twin.
    laser_offset
        x of the laser in the robot's frame [m]; default: stated by the log.
    range_max
        Readings of at least this range are no returns [m]; default: stated or shown by the log.
    """
    if out.exists():
        raise ValueError(f"{out}: exists; choose another --out")
    source = _source(log, laser_offset, range_max, estimator)
    made = make_twin(source, source.log.path.name.split(".")[0])
    write_twin(made, out, source.log.path)
    for note in (*source.log.notes, *made.notes):
        console.print(f"note: {note}", soft_wrap=True)
    results.print(_described(made))
    results.print(f"drive it again: testbed run --config {out}/config.toml --seed 1")


def _source(
    log: Path, laser_offset: float | None, range_max: float | None, estimator: EstimatorOptions
) -> Reconstruction:
    """Read the run, or map the log."""
    if (log / "metrics.json").is_file():
        return read_reconstruction(log)
    AT_WORK.now_doing(f"reading {log}")
    recording = open_log(log, laser_offset=laser_offset, range_max=range_max)
    announce_compilation()
    with progress_line() as watcher:
        return reconstruct(
            recording,
            estimator.filter_config,
            RunSeeds.from_seed(estimator.seed),
            watcher,
            threads=estimator.threads,
        )


def _described(made: Twin) -> str:
    """Return what was estimated, in a few lines."""
    odometry, lidar, surface = made.odometry, made.lidar, made.surface
    slips = f"{odometry.slip_rate:.3f} slips per m of {100.0 * odometry.slip_distance:.1f} cm"
    recovery = f", of which {odometry.recovered_share:.0%} comes back within {odometry.recovery_length:g} m"
    backward = "; driving backward counts as forward" if odometry.unsigned else ""
    return (
        f"world: {len(made.world.walls)} outlines, drive of {made.duration:.0f} s\n"
        f"lidar: {lidar.beams} beams over {lidar.field_of_view_deg:g} degrees at {lidar.scan_rate:.2f} Hz, noise "
        f"{1000.0 * lidar.noise_floor:.1f} mm or {100.0 * lidar.noise_share:.2f} %; {lidar.short_return_rate:.4f} "
        f"readings per m in front of the walls, {lidar.dropout:.1%} lost\n"
        f"surfaces: rough by {100.0 * surface.roughness:.1f} cm; {surface.scatter_share:.1%} of the readings scatter "
        f"by {100.0 * surface.scatter:.1f} cm\n"
        f"odometry ({made.pieces} pieces): distance x {odometry.distance_scale:.4f}, turn x "
        f"{odometry.rotation_scale:.4f}, drift {math.degrees(odometry.drift):.3f} degrees per m; random "
        f"{odometry.random_translation:.4f} m and {math.degrees(odometry.random_rotation):.3f} degrees per root of m"
        f"{recovery if odometry.recovered_share else ''}; {slips}{backward}"
    )
