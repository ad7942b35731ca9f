# SPDX-License-Identifier: MIT
"""The twin of a recording: all of its parts, and the files that `testbed simulate` and `testbed run` drive again."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_directory
from slam import se2
from testbed.formats.commands import write_commands
from testbed.formats.off_wall import write_off_wall
from testbed.presets import LidarPreset, Mount, RobotPreset
from testbed.provenance import versions
from testbed.simulation import OdometryConfig, SurfaceConfig
from testbed.simulation.config import CONTROL_PERIOD
from testbed.simulation.physics.backend import AccelerationLimits
from testbed.simulation.robot.off_wall import OffWallBeams
from testbed.toml import dump_toml
from testbed.twin.lidar import estimate_lidar
from testbed.twin.odometry import estimate_odometry, find_lead
from testbed.twin.reconstruction import Reconstruction
from testbed.twin.relief import with_relief
from testbed.twin.returns import compare_scans, measure_returns, thinned
from testbed.twin.route import Route, fastest, follow
from testbed.twin.surface import estimate_surface
from testbed.twin.walls import world_of
from worlds import World, dumps
from worlds.file_names import to_name

MIN_OFFSET = 0.02
"""Smaller errors of the lidar's place are not mentioned [m]."""
WIDTH = 0.26
"""Diameter and track of the robot [m]; the log does not state them, and with these it passes wherever the path goes."""
LIMITS = AccelerationLimits(acceleration=4.0, turn_acceleration=20.0)
"""Largest accelerations; the drive of the log decides, not these."""
ROUGHNESS_SCANS = 3000
"""The roughness of surfaces is taken from about so many scans, spread over the log."""
HEADROOM = 1.5
"""The robot's largest speeds, in terms of those on the path."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Twin:
    """Everything that drives a recording again."""

    world: World
    robot: RobotPreset
    lidar: LidarPreset
    sweeps: bool
    """Whether beams are measured one after the other."""
    odometry: OdometryConfig
    surface: SurfaceConfig
    """How rough the surfaces are that it sees."""
    route: Route
    off_wall: OffWallBeams
    """What the lidar of the log saw that is no wall of the world."""
    pieces: int
    """Pieces of the path that the odometry was compared on."""
    notes: tuple[str, ...]
    """What the twin does not have of the log, each a sentence."""

    @property
    def duration(self) -> float:
        """Length of the drive [s]."""
        return len(self.route.commands) * CONTROL_PERIOD


def make_twin(source: Reconstruction, name: str) -> Twin:
    """Make the twin of a recording. Raises ValueError where the map has no floor or the scans no field of view."""
    lidar = estimate_lidar(source.log.table)
    # Odometry and estimate state poses of a point that may lie ahead of the axle, by different distances where the log
    # states a wrong place of the lidar. The twin's robot has its centre at the axle.
    odometry_lead, lead = find_lead(source.odometry), find_lead(source.path)
    back, odometry_back = np.array([-lead, 0.0, 0.0]), np.array([-odometry_lead, 0.0, 0.0])
    path = se2.compose(source.dense_path, back)
    odometry, pieces = estimate_odometry(
        se2.compose(source.odometry, odometry_back), se2.compose(source.path, back), track=WIDTH
    )
    mount = lidar.mount.model_copy(update={"x": lidar.mount.x + odometry_lead, "offset_x": lead - odometry_lead})
    straight, notes = world_of(source.grid, path, to_name(name))
    world = with_relief(straight, source.log.table, source.path, lidar.scans, path)
    robot = _robot(mount, *fastest(source.stamps, path))
    route = follow(world, robot, LIMITS, source.stamps, path)
    table, duration = source.log.table, len(route.commands) * CONTROL_PERIOD
    compared = compare_scans(world, table, source.path, lidar.scans)
    recorded = table.stamps[table.scan_rows[lidar.scans]] - source.stamps[0]
    off_wall, returns = measure_returns(compared, recorded, _scan_times(lidar.preset, duration))
    noise = (lidar.preset.noise_floor, lidar.preset.noise_share, lidar.preset.range_step)
    seen = compare_scans(world, table, source.path, thinned(lidar.scans, ROUGHNESS_SCANS))
    surface = estimate_surface(seen, world.boundary_segments(), noise)
    preset = lidar.preset.model_copy(
        update={
            "short_return_rate": returns.short_rate,
            "dropout": returns.lost,
            "sources": lidar.preset.sources | {"short_return_rate": "estimated from the log"},
        }
    )
    return Twin(
        world=world,
        robot=robot,
        lidar=preset,
        sweeps=lidar.sweeps,
        odometry=odometry,
        surface=surface,
        route=route,
        off_wall=off_wall,
        pieces=pieces,
        notes=(*lidar.notes, *_lead_notes(lead - odometry_lead), *notes, *_differences(route)),
    )


def _scan_times(lidar: LidarPreset, duration: float) -> NDArray[np.float64]:
    """Return the times of the scans of a drive of that duration [s], (k,)."""
    if lidar.scan_times is not None:
        return np.array(lidar.scan_times)
    return np.arange(0.0, duration, 1.0 / lidar.scan_rate)


def _lead_notes(offset: float) -> list[str]:
    """Return a sentence on a lidar that sits elsewhere than the log says."""
    if abs(offset) < MIN_OFFSET:
        return []
    where = "ahead of" if offset > 0.0 else "behind"
    return [f"the lidar sits {100.0 * abs(offset):.0f} cm {where} where the log says, and so does the twin's"]


def _differences(route: Route) -> list[str]:
    """Return sentences on where the drive differs from the path of the log."""
    far, most = np.percentile(100.0 * route.away, [99.0, 100.0])
    notes = [f"the drive is within {far:.0f} cm of the smoothed path for 99 % of the time, {most:.0f} cm at most"]
    if route.contacts:
        notes.append(f"the robot touches a wall for {route.contacts * CONTROL_PERIOD:.1f} s")
    return notes


def write_twin(twin: Twin, out: Path, log: Path) -> None:
    """Write world.toml, robot.toml, lidar.toml, commands.csv, off_wall.csv and config.toml to a new directory, whole or
    not at all.

    log: the recording, for the record
    """
    with atomic_directory(out) as folder:
        folder.mkdir()
        (folder / "world.toml").write_text(dumps(twin.world), encoding="utf-8")
        for preset, file in ((twin.robot, "robot.toml"), (twin.lidar, "lidar.toml")):
            document = preset.model_dump(mode="json", exclude_unset=True)
            (folder / file).write_text(dump_toml(document), encoding="utf-8")
        write_commands(folder / "commands.csv", twin.route.commands)
        write_off_wall(folder / "off_wall.csv", twin.off_wall)
        (folder / "config.toml").write_text(dump_toml(_config(twin, out.resolve(), log)), encoding="utf-8")


def _config(twin: Twin, out: Path, log: Path) -> dict[str, Any]:
    """Return the settings that drive the twin again, with absolute names of its files."""
    settings = {
        "world": out / "world.toml",
        "robot": out / "robot.toml",
        "lidar": out / "lidar.toml",
        "commands": out / "commands.csv",
        "off_wall": out / "off_wall.csv",
        "backend": "fast",
        "duration": twin.duration,
        "driver": {"kind": "recorded", **LIMITS._asdict()},
        "odometry": asdict(twin.odometry),
        "surface": asdict(twin.surface),
        # What these layers draw for each beam on its own is in off_wall.csv as it was.
        "layers": {"motion": twin.sweeps, "short_returns": False, "dropout": False},
    }
    facts = {"log": log.resolve(), "pieces": twin.pieces, "notes": list(twin.notes)}
    return {"settings": settings, "twin": facts, "versions": versions()}


def _robot(mount: Mount, speed: float, turn_rate: float) -> RobotPreset:
    """Return a small round robot with that lidar that drives as fast as the path asks for."""
    known: dict[str, Any] = {
        "max_speed": max(HEADROOM * speed, 0.5),
        "max_turn_rate": max(HEADROOM * turn_rate, 1.0),
        "lidar_mount": mount.model_dump(),
    }
    assumed: dict[str, Any] = {
        "wheel_radius": 0.05,
        "track": WIDTH,
        "length": WIDTH,
        "width": WIDTH,
        "height": 0.15,
        "mass": 5.0,
        "max_acceleration": LIMITS.acceleration,
        "max_turn_acceleration": LIMITS.turn_acceleration,
        "ticks_per_turn": 10_000.0,
        "round": True,
    }
    sources = dict.fromkeys(known, "estimated from the log") | dict.fromkeys(assumed, "assumed: the log does not say")
    return RobotPreset(name="twin_robot", title="Robot of a log", sources=sources, **known, **assumed)
