# SPDX-License-Identifier: MIT
"""`testbed presets`."""

from __future__ import annotations

from cyclopts import App
from rich.table import Table

from testbed.cli.shared.console import results
from testbed.presets import lidars, load_lidar, load_robot, robots
from testbed.presets.models import LidarPreset, RobotPreset
from testbed.seeds import RunSeeds
from testbed.simulation.robot.odometry import GRADES
from testbed.simulation.robot.umbmark import umbmark as drive_squares

app = App(name="presets", help="List robots and lidars, and measure their odometry.", help_epilogue="")


@app.command(name="list")
def list_presets() -> None:
    """List the names and main parameters of all robots and lidars.

    Example: `testbed presets list`
    """
    table = _table("robot", "device", "speed", "track", "lidars")
    for name in robots():
        robot = load_robot(name)
        room = str(len(robot.lidar_mounts))
        table.add_row(name, robot.title, f"{robot.max_speed:g} m/s", f"{robot.track:g} m", room)
    results.print(table)
    table = _table("lidar", "device", "beams", "view", "rate", "range", "noise")
    for name in lidars():
        lidar = load_lidar(name)
        noise = f"{1e3 * lidar.noise_floor:g} mm" + (f", {lidar.noise_share:.2%}" if lidar.noise_share else "")
        view, rate = f"{lidar.field_of_view_deg:g} deg", f"{lidar.scan_rate:g} Hz"
        table.add_row(name, lidar.title, str(lidar.beams), view, rate, f"{lidar.range_max:g} m", noise)
    results.print(table)


@app.command
def show(name: str) -> None:
    """Show all parameters of a robot or lidar, each with its source.

    Example: `testbed presets show create3`

    Parameters
    ----------
    name
        Name of a robot or lidar, or the TOML file of a robot.
    """
    preset: RobotPreset | LidarPreset = load_lidar(name) if name in lidars() else load_robot(name)
    results.print(f"{preset.name}: {preset.title}")
    table = _table("key", "value", "source")
    for key, source in preset.source_of.items():
        table.add_row(key, str(preset.model_dump()[key]), source)
    results.print(table)


@app.command(usage="Usage: testbed presets umbmark [OPTIONS] [ROBOT...]")
def umbmark(*robot: str, runs: int = 20, seed: int = 0) -> None:
    """Measure the error of odometry after a square of 4 m in both directions (Borenstein's UMBmark).

    The table shows the root mean square over runs with newly drawn errors, for each grade of odometry.
    Example: `testbed presets umbmark burger create3`

    Parameters
    ----------
    robot
        Names or TOML files of robots; default: all robots of the package.
    runs
        Number of squares in each direction.
    seed
        Random seed.
    """
    if runs < 1:
        raise ValueError(f"runs must be at least 1, got {runs}")
    seeds = RunSeeds.from_seed(seed)
    table = _table("robot", *(f"{grade}, m" for grade in GRADES))
    for name in robot or robots():
        preset = load_robot(name)
        errors = [
            drive_squares(preset, grade, runs=runs, seeds=seeds).return_error for grade in ("good", "typical", "poor")
        ]
        table.add_row(preset.name, *(f"{error:.3f}" for error in errors))
    results.print(table)


def _table(*headings: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for heading in headings:
        table.add_column(heading)
    return table
