# SPDX-License-Identifier: MIT
"""The map that is shown is the filter's best map of that time, however fast the run is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from slam.config import FilterConfig
from slam.gmapping import GMapping
from slam.localization import Localization
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.estimation.snapshot import take_snapshot
from testbed.exploration import ExploreDriver, make_explorer
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.presets import load_lidar
from testbed.simulation import DriverConfig, SimulationConfig, simulate
from testbed.views import Snapshot, open_view
from testbed.views.another_best import MIN_JUMP_M
from testbed.views.another_best import moved_by_another_best as moved_by
from testbed.views.map_cells import grey_levels
from testbed.views.rerun import entities, rerun_view
from testbed.views.rerun.layers.comparison import COARSE, most_different
from tests.testbed.views.shown_map import UNSEEN, ShownMap, ShownPath, coarse_kinds, kinds, rows
from tests.testbed.views.synthetic import scene, snapshots, true_map, truth_at
from worlds import Box, Start, Wall, World

INTEL = Path(__file__).parents[4] / "shared/datasets/intel/intel-910.clf.gz"


def fast() -> Iterator[Snapshot]:
    """A simulated run, as fast as the filter can."""
    return snapshots(30.0)


def sparse() -> Iterator[Snapshot]:
    """A robot whose lidar takes one scan in two seconds."""
    return snapshots(120.0, particles=5, period=2.0)


def log() -> Iterator[Snapshot]:
    """The beginning of a recorded log with a scan every three seconds."""
    if not INTEL.is_file():
        pytest.skip("the Intel log is not there")
    mapper = GMapping(FilterConfig(particles=8))
    for k, frame in enumerate(open_log(INTEL).frames):
        if k == 120:
            return
        assert frame.scan is not None
        yield take_snapshot(frame, mapper.process(frame.odometry, frame.scan), mapper)


def explore() -> Iterator[Snapshot]:
    """A robot that explores a box of a room by its own estimate."""
    world = World(
        name="a room and a box",
        start=Start(x=1.0, y=1.0),
        walls=[Wall(name="outline", points=[(0, 0), (8, 0), (8, 6), (0, 6)], closed=True)],
        boxes=[Box(name="box", x=5.0, y=3.0, width=1.0, depth=2.0)],
    )
    lidar = load_lidar("rplidar_a2").model_copy(update={"beams": 180})
    driver = DriverConfig(kind="explore")
    config = SimulationConfig(lidar=lidar, duration=60.0, backend="fast", driver=driver)
    explorer = ExploreDriver(make_explorer(config.robot, lidar, driver, np.random.default_rng(0)))
    mapper = GMapping(FilterConfig(particles=5))
    with simulate(world, config, explorer) as frames:
        for frame in frames:
            if frame.scan is not None:
                step = mapper.process(frame.odometry, frame.scan, twist=frame.twist)
                explorer.observe(frame, step, mapper.map)
                yield take_snapshot(frame, step, mapper)


def localization(start: tuple[float, float, float] | None) -> Iterator[Snapshot]:
    """A robot that finds itself in a room whose map it has; start: where it is, about, None = unknown."""
    mapper = Localization(true_map(), start=start, seed=0)
    for snapshot in islice(snapshots(40.0, particles=2), 0, None, 4):
        assert snapshot.scan is not None
        assert snapshot.truth is not None
        frame = Frame(stamp=snapshot.stamp, odometry=snapshot.odometry, scan=snapshot.scan, truth=snapshot.truth)
        yield take_snapshot(frame, mapper.process(frame.odometry, snapshot.scan), mapper)


def found() -> Iterator[Snapshot]:
    """A localisation from a known start."""
    x, y, theta = truth_at(0.0).tolist()
    return localization((x, y, theta))


def searching() -> Iterator[Snapshot]:
    """A localisation that has to find out where it is."""
    return localization(None)


@dataclass(frozen=True)
class Shown:
    """A recording, and what the filter held at each scan."""

    path: Path
    stamps: NDArray[np.float64]
    held: list[Held]
    grows: bool
    """Whether the robot seeks what its map lacks."""

    def recent(self, scan: int) -> list[Held]:
        """What the filter held at a scan (the last of the list), and at those that are at most 1 s and 0.5 m older."""
        now = self.held[scan]
        return [
            held
            for held, stamp in zip(self.held[: scan + 1], self.stamps, strict=False)
            if held is now or (self.stamps[scan] - stamp <= 1.0 and now.travelled - held.travelled <= 0.5)
        ]

    def random_scans(self) -> Iterator[tuple[float, int]]:
        """Ten random times, from the first scan on, with the number of the scan before each."""
        for at in np.random.default_rng(0).uniform(self.stamps[0], self.stamps[-1], 10):
            yield float(at - self.stamps[0]), int(np.searchsorted(self.stamps, at, side="right")) - 1


class Held(NamedTuple):
    """What the filter held at a scan."""

    grid: OccupancyGrid
    path: Pose
    poses: Pose | None
    travelled: float


@pytest.fixture(scope="module", params=[fast, sparse, log, explore, found, searching])
def shown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Shown:
    path, stamps, held = tmp_path_factory.mktemp("fresh") / "recording.rrd", [], []
    travelled, before = 0.0, None
    with (
        pytest.MonkeyPatch.context() as monkeypatch,
        open_view(path, replace(scene(), true_map=None, T_world_map=np.zeros(3))) as view,
    ):
        monkeypatch.setattr(
            rerun_view.time, "monotonic", lambda: 0.0
        )  # what is shown does not depend on the wall clock
        for snapshot in request.param():
            view.show(snapshot)
            assert snapshot.map is not None
            assert snapshot.path is not None
            travelled += 0.0 if before is None else float(np.hypot(*(snapshot.odometry - before)[:2]))
            before = snapshot.odometry
            stamps.append(snapshot.stamp)
            held.append(Held(snapshot.map(None), snapshot.path(None), snapshot.poses, travelled))
    return Shown(path, np.array(stamps), held, grows=request.param is explore)


def share_shown(squares: ShownMap, time: float, grid: OccupancyGrid) -> float:
    """Share of the known cells of a map that are shown at a time [s]."""
    held, seen = kinds(grid), squares.at(time, grid)
    known = held != UNSEEN
    return float(np.mean(seen[known] == held[known]))


def test_the_map_that_is_shown_is_the_filters(shown: Shown) -> None:
    squares, whole = ShownMap(shown.path), rows(shown.path, entities.MAP, "GridMap:data")
    for at, k in shown.random_scans():
        grid = shown.held[k].grid
        if whole:  # a map that never changes
            (time, data), image = whole[0], grey_levels(grid.probability)[::-1]
            assert (len(whole), time, bytes(data[0])) == (1, 0.0, image.tobytes())
            continue
        shares = [share_shown(squares, at, held.grid) for held in shown.recent(k)]
        assert max(shares) >= 0.98, f"at {at:.1f} s"
        # an explorer drives to where its map grows most: half a metre may show more than 2 % of it
        assert shares[-1] >= (0.95 if shown.grows else 0.98), f"at {at:.1f} s"
    if not whole:
        last = shown.held[-1].grid
        np.testing.assert_array_equal(squares.at(shown.stamps[-1] - shown.stamps[0], last), kinds(last))


def test_path_and_particles_that_are_shown_are_the_filters(shown: Shown) -> None:
    path = ShownPath(shown.path)
    particles = rows(shown.path, entities.PARTICLES, "Arrows3D:origins")
    for at, k in shown.random_scans():
        recent, seen = shown.recent(k), path.at(at)
        assert any(np.array_equal(held.path[:, :2].astype(np.float32), seen) for held in recent), f"path at {at:.1f} s"
        (dots,) = [np.array(value)[:, :2] for time, value in particles if time <= at + 1e-6][-1:]
        assert any(np.array_equal(held.poses[:, :2].astype(np.float32), dots) for held in recent), f"at {at:.1f} s"


def test_the_map_is_new_after_each_resampling_and_loop_closure(tmp_path: Path) -> None:
    path, events = tmp_path / "recording.rrd", []
    with open_view(path, scene()) as view:
        for snapshot in snapshots(20.0):
            view.show(snapshot)
            if snapshot.step is not None and (snapshot.step.resampled or snapshot.step.loop_closed):
                assert snapshot.map is not None
                events.append((snapshot.stamp, snapshot.map(None)))
    assert len(events) > 3
    shown = ShownMap(path)
    for stamp, grid in events:
        held, seen = kinds(grid), shown.at(stamp, grid)
        assert np.mean(seen[held != UNSEEN] == held[held != UNSEEN]) >= 0.99


def test_the_map_is_that_of_the_particle_that_has_become_the_best(tmp_path: Path) -> None:
    """Particles that disagree: the scans of a robot whose wheels slip."""
    path, changes, before = tmp_path / "recording.rrd", [], None
    with open_view(path, replace(scene(), true_map=None, T_world_map=np.zeros(3))) as view:
        for snapshot in snapshots(40.0, particles=6):
            view.show(snapshot)
            step = snapshot.step
            assert step is not None
            if not step.updated:
                continue
            plain = not step.resampled and not step.loop_closed  # else the map is new anyway
            if before is not None and before != snapshot.best and plain:
                assert snapshot.map is not None
                assert snapshot.path is not None
                changes.append((snapshot.stamp, snapshot.map(None), snapshot.path(None), moved_by(before, step)))
            before = snapshot.best
    assert len(changes) > 3
    shown, paths = ShownMap(path), ShownPath(path)
    for stamp, grid, held_path, moved in changes:
        held, seen = kinds(grid), shown.at(stamp, grid)
        share = np.mean(seen[held != UNSEEN] == held[held != UNSEEN])
        assert share == 1.0 if moved > MIN_JUMP_M else share >= 0.99
        np.testing.assert_array_equal(paths.at(stamp), held_path[:, :2].astype(np.float32))


def test_compared_particles_have_their_own_maps(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with open_view(path, scene()) as view:
        for snapshot in snapshots(12.0):
            view.show(snapshot)
    assert snapshot.map is not None
    assert snapshot.weights is not None
    assert snapshot.cells is not None
    different = most_different(snapshot.cells(snapshot.best), snapshot.best)
    for rank, particle in zip(entities.RANKS[1:], (np.argmin(snapshot.weights), *different), strict=True):
        grid, held = coarse_kinds(snapshot.map(int(particle)), COARSE)
        seen = ShownMap(path, f"{entities.COMPARE}/{rank}/map").at(snapshot.stamp, grid)
        assert np.mean(seen[held != UNSEEN] == held[held != UNSEEN]) >= 0.99
