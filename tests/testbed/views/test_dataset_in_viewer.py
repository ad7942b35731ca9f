# SPDX-License-Identifier: MIT
"""A dataset opened in Rerun as it is: what the viewer's importer makes of the bag, and what it draws."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from scipy.ndimage import binary_dilation

from eval.files.tum import read_tum
from slam import se2
from testbed.datasets.simulated import write_dataset
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig
from testbed.views.live import programs
from tests.viewer import near, pixels, viewer_or_skip
from worlds import load

TIMELINE = "message_log_time"
SECONDS = 2.0
UNKNOWN = (112, 137, 134)
"""Of RViz's map palette, as the viewer draws it."""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("datasets") / "office"
    config = SimulationConfig(
        robot=load_robot("create3"),
        lidar=load_lidar("rplidar_a2"),
        backend="fast",
        duration=SECONDS,
        seeds=RunSeeds.from_seed(3),
    )
    write_dataset(path, load("office"), config, {})
    return path


@pytest.fixture(scope="module")
def imported(dataset: Path) -> Path:
    """The bag as the viewer reads it."""
    path = dataset.parent / "imported.rrd"
    command = [programs.viewer_binary(), "mcap", "convert", str(dataset / "office.mcap"), "-o", str(path)]
    subprocess.run(command, check=True, capture_output=True)
    return path


def rows(path: Path, entity: str, *columns: str) -> Iterator[tuple[float, ...]]:
    """(time [s], value of each column) of the rows that have all of them."""
    for chunk in rr.chunk.RrdReader(path).stream().filter(content=entity, is_static=False):
        batch = chunk.to_record_batch()
        if set(columns) <= set(batch.schema.names):
            times = batch.column(TIMELINE).cast("int64").to_numpy() / 1e9
            yield from zip(times.tolist(), *(batch.column(name).to_pylist() for name in columns), strict=True)


def transforms(path: Path, entity: str) -> dict[float, dict[tuple[str, str], np.ndarray]]:
    """By time and (parent, child): the pose (3,) in the plane."""
    found: dict[float, dict[tuple[str, str], np.ndarray]] = {}
    names = ("parent_frame", "child_frame", "translation", "quaternion")
    row: Any
    for row in rows(path, entity, *(f"Transform3D:{name}" for name in names)):
        stamp, (parent,), (child,), ((x, y, _),), ((_, _, z, w),) = row
        found.setdefault(stamp, {})[parent, child] = np.array([x, y, 2.0 * np.arctan2(z, w)])
    return found


def robot_and_points(imported: Path) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """For each scan: its time [s], `T_map_robot` (3,) and the points (n, 2) in the map's frame."""
    in_map, in_odom = transforms(imported, "/ground_truth/tf"), transforms(imported, "/tf")
    ((_, static),) = transforms(imported, "/tf_static").items()
    cloud: Any
    for stamp, cloud in rows(imported, "/scan_cloud", "Points3D:positions"):
        robot = se2.compose(in_map[stamp]["map", "odom"], in_odom[stamp]["odom", "base_link"])
        lidar = se2.compose(robot, static["base_link", "laser"])
        yield stamp, robot, se2.transform_points(lidar, np.array(cloud)[:, :2])


def test_the_robot_stands_where_it_truly_was(dataset: Path, imported: Path) -> None:
    truth = read_tum(dataset / "truth.tum")
    found = sorted((stamp, *robot) for stamp, robot, _ in robot_and_points(imported))
    np.testing.assert_allclose([row[0] for row in found], truth.stamps, atol=1e-9)
    deviation = se2.between(truth.poses, np.array([row[1:] for row in found]))
    np.testing.assert_allclose(deviation, 0.0, atol=1e-5)  # the viewer's transforms are float32


def test_scan_points_lie_on_the_walls_of_the_map(imported: Path) -> None:
    names = ("data", "format", "cell_size", "translation")
    row: Any = next(rows(imported, "/ground_truth/map", *(f"GridMap:{name}" for name in names)))
    _, (data,), (size,), (cell,), ((x, y, _),) = row
    from_top = np.frombuffer(bytes(data), np.uint8).reshape(size["height"], size["width"])
    walls = binary_dilation(from_top == 100, iterations=1)
    points = np.concatenate([points for _, _, points in robot_and_points(imported)])
    col, row_up = np.floor((points - (x, y)) / cell).astype(int).T
    assert walls[len(walls) - 1 - row_up, col].mean() > 0.95
    assert walls[row_up, col].mean() < 0.6  # upside down it would be another place


def test_the_robots_shape_is_there_and_hangs_on_its_frames(imported: Path) -> None:
    frames = set()
    for chunk in rr.chunk.RrdReader(imported).stream().filter(content="/create3/visual_geometries/**", is_static=True):
        batch = chunk.to_record_batch()
        if "CoordinateFrame:frame" in batch.schema.names:
            frames |= {frame for (frame,) in batch.column("CoordinateFrame:frame").to_pylist()}
    ((_, static),) = transforms(imported, "/tf_static").items()
    assert frames == {"base_link", "left_wheel", "right_wheel", "caster"}
    assert {child for _, child in static} == frames - {"base_link"} | {"laser"}


def test_the_viewer_draws_map_scan_and_robot_without_complaint(dataset: Path) -> None:
    with viewer_or_skip(TIMELINE) as viewer:
        assert viewer.open(dataset / "office.mcap") == pytest.approx(SECONDS, abs=0.15)
        picture = pixels(viewer.picture(SECONDS, "/")).astype(int)
        assert viewer.complaints() == []
    red, green, blue = np.moveaxis(picture, -1, 0)
    assert near(picture, (255, 255, 255), 20).sum() > 50_000  # floor
    assert near(picture, UNKNOWN, 12).sum() > 20_000
    assert ((green - red > 30) & (green - blue > 30)).sum() > 300  # points, by their height
    assert ((blue - red > 40) & (blue > 150)).sum() > 20  # robot
