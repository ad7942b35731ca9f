# SPDX-License-Identifier: MIT
"""Localisation in the map of a room: known and unknown starts, a room that looks the same turned round, kidnapping, the
map of another room; any map frame; bad input."""

import dataclasses

import numpy as np
import pytest

from slam import OccupancyGrid, Scan, se2
from slam._threads import Threads
from slam.config import FilterConfig, LocalizationConfig, MapConfig
from slam.localization import Localization
from slam.localization.fixed_map import FixedMap, wall_faces
from tests.slam import rooms
from tests.slam.localization.free_cells import free_cells

RECTANGLE = np.array([(-2.0, -1.5), (4.0, -1.5), (4.0, 1.5), (-2.0, 1.5)])
HALF_TURN = (2.0, 0.0, np.pi)  # what carries the rectangle over into itself


def walls_of(corners):
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def map_of(walls, *, cell=0.05, thickness=0.1, margin=0.5):
    """Map of a room with walls (n, 4) behind its outline: occupied up to `thickness` outside of it, free inside."""
    points = walls.reshape(-1, 2)
    low = np.floor((points.min(axis=0) - margin) / cell) * cell
    columns, rows = np.ceil((points.max(axis=0) + margin - low) / cell).astype(int)
    x, y = np.meshgrid(low[0] + (np.arange(columns) + 0.5) * cell, low[1] + (np.arange(rows) + 0.5) * cell)
    inside, distance = np.zeros(x.shape, bool), np.full(x.shape, np.inf)
    for x0, y0, x1, y1 in walls:
        crosses = ((y0 > y) != (y1 > y)) & (x < (x1 - x0) * (y - y0) / np.where(y1 == y0, 1.0, y1 - y0) + x0)
        inside ^= crosses
        share = np.clip(((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2), 0.0, 1.0)
        distance = np.minimum(distance, np.hypot(x - x0 - share * (x1 - x0), y - y0 - share * (y1 - y0)))
    probability = np.where(inside, 0.0, np.where(distance < thickness, 1.0, np.nan)).astype(np.float32)
    return OccupancyGrid(probability=probability, resolution=cell, origin=(*low.tolist(), 0.0))


L_ROOM = map_of(rooms.WALLS)


def drive(steps=25):
    """True poses in the room and odometry in a frame of its own, which drifts."""
    rng = np.random.default_rng(0)
    truth, odometry = rooms.drive(steps, distance=0.2, turn=0.25), np.zeros((steps + 1, 3))  # circles of 0.8 m
    odometry[0] = (5.0, -3.0, 2.0)
    for k in range(steps):
        motion = se2.between(truth[k], truth[k + 1]) + rng.normal(scale=(0.01, 0.01, 0.01))
        odometry[k + 1] = se2.compose(odometry[k], motion)
    return truth, odometry


def run(localization, truth, odometry, *, seed=0):
    """Reports of a drive past the walls of `rooms.WALLS`."""
    rng = np.random.default_rng(seed)
    scans = [rooms.scan_at(pose, beams=120, stamp=float(k), noise=0.01, rng=rng) for k, pose in enumerate(truth)]
    return [localization.process(*both) for both in zip(odometry, scans, strict=True)]


def errors(localization, truth):
    """Distances [m] and turns [rad] of the path from the truth at the same scans."""
    miss = se2.between(truth[localization.update_scans], localization.path())
    return np.hypot(miss[:, 0], miss[:, 1]), np.abs(miss[:, 2])


def test_the_frozen_map_has_one_hit_at_the_centre_of_every_face_and_shares_its_tiles():
    probability = np.full((60, 80), np.nan, np.float32)
    probability[5:55, 5:75] = 0.0
    probability[20:30, 40:50] = 1.0  # a solid block
    grid = OccupancyGrid(probability=probability, resolution=0.05, origin=(3.0, 4.0, 0.5))
    fixed = FixedMap(grid, MapConfig(), Threads(1))
    hits, visits, walls = rooms.counts_of(fixed.maps, particle=17)
    assert len(wall_faces(grid)) == 4 * 10 - 4
    assert walls.sum() == hits.sum() == visits.sum() == 36
    corner = fixed.maps.grids.corner
    rows, columns = np.nonzero(walls)
    assert {(r + corner[1], c + corner[0]) for r, c in zip(rows, columns, strict=True)} == {
        (r, c) for r in range(20, 30) for c in range(40, 50) if r in (20, 29) or c in (40, 49)
    }
    word = rooms.word_at(fixed.maps, "surface", (40.5 * 0.05, 25.5 * 0.05), particle=3)
    np.testing.assert_allclose((float(word >> 20), float((word >> 8) & 0xFFF)), 2048.0, atol=1.0)  # of 4096: the middle
    assert (np.unique(fixed.maps.grids.table, axis=0).shape[0]) == 1


@pytest.mark.parametrize("seed", range(3))
def test_a_start_that_is_roughly_known_is_tracked_to_centimetres(seed):
    truth, odometry = drive()
    start = truth[0] + np.random.default_rng(seed).normal(scale=(0.2, 0.2, 0.1))
    localization = Localization(L_ROOM, start=start, seed=seed, threads=1)
    reports = run(localization, truth, odometry, seed=seed)
    distance, turn = errors(localization, truth)
    assert np.median(distance) < 0.02
    assert distance.max() < 0.05
    assert turn.max() < np.radians(1.5)
    assert localization.status.state == "found"
    assert localization.status.explained_share > 0.95
    np.testing.assert_array_equal(reports[-1].pose, localization.path()[-1])
    assert all(report.particles == 30 for report in reports)


@pytest.mark.parametrize("seed", range(3))
def test_an_unknown_start_is_found_with_many_particles_which_become_few(seed):
    truth, odometry = drive()
    localization = Localization(L_ROOM, seed=seed, threads=1)
    reports = run(localization, truth, odometry, seed=seed)
    found = localization.status
    assert (found.state, found.clusters, found.lost_at) == ("found", 1, ())
    assert found.found_at[0] < 15  # 4.5 m
    distance, _ = errors(localization, truth)
    assert np.median(distance) < 0.02
    assert reports[0].particles > 1000
    assert reports[-1].particles == 30
    deviation = [np.sqrt(np.trace(report.covariance[:2, :2])) for report in reports]
    assert deviation[0] > 0.1
    assert deviation[-1] < 0.05


def test_a_search_that_begins_has_no_particles_and_no_weights():
    localization = Localization(map_of(walls_of(RECTANGLE)), seed=0, threads=1)
    assert len(localization.poses) == len(localization.weights) == 0


def test_a_room_that_looks_the_same_turned_round_is_ambiguous(monkeypatch):
    monkeypatch.setattr(rooms, "WALLS", walls_of(RECTANGLE))
    truth, odometry = drive()
    localization = Localization(map_of(rooms.WALLS), seed=1, threads=1)
    run(localization, truth, odometry)
    found = localization.status
    assert (found.state, found.clusters, found.found_at) == ("ambiguous", 2, ())
    other = se2.compose(HALF_TURN, truth[-1])
    for place in (truth[-1], other):
        miss = se2.between(place, localization.poses)
        here = (np.hypot(miss[:, 0], miss[:, 1]) < 0.1) & (np.abs(miss[:, 2]) < 0.1)
        assert localization.weights[here].sum() > 0.05


def test_a_robot_that_is_carried_away_is_noticed_and_found_again():
    truth, odometry = drive(60)
    elsewhere = se2.compose((0.0, 0.0, 0.3), (2.8, -0.6, 0.3))  # at the other end of the room
    carried = np.concatenate([truth[:25], se2.compose(elsewhere, se2.between(truth[25], truth[25:]))])
    localization = Localization(L_ROOM, start=truth[0], seed=0, threads=1)
    run(localization, carried, odometry)
    found = localization.status
    assert len(found.lost_at) >= 1
    assert 25 < found.lost_at[0] < 55
    assert found.state == "found"
    assert found.found_at[-1] > found.lost_at[-1]
    last = se2.between(carried[-1], localization.path()[-1])
    assert np.hypot(last[0], last[1]) < 0.05
    assert np.all(np.diff(localization.update_scans) > 0)
    assert len(localization.path()) == len(localization.update_scans)


@pytest.mark.parametrize("start", [None, (0.0, 0.0, 0.0)])
def test_the_map_of_another_room_is_never_a_silent_success(start):
    big = map_of(walls_of(np.array([(-6.0, -5.0), (9.0, -5.0), (9.0, 6.0), (2.0, 6.0), (2.0, 3.0), (-6.0, 3.0)])))
    truth, odometry = drive(15)
    localization = Localization(big, start=start, seed=0, threads=1)
    run(localization, truth, odometry)
    found = localization.status
    assert found.state != "found"
    assert found.found_at == ()
    assert len(found.lost_at) > 0


@pytest.mark.parametrize("origin", [(-12.345, 7.89, 0.0), (3.0, -4.0, 0.7), (0.013, 0.0, -2.5)])
@pytest.mark.parametrize("known", [True, False])
def test_another_frame_of_the_map_moves_all_poses_and_changes_nothing_else(origin, known):
    truth, odometry = drive(10)
    moved = dataclasses.replace(L_ROOM, origin=origin)
    T_new_old = se2.compose(origin, se2.inverse(L_ROOM.origin))
    start = truth[0] if known else None
    a = Localization(L_ROOM, start=start, seed=4, threads=1)
    b = Localization(moved, start=None if start is None else se2.compose(T_new_old, start), seed=4, threads=1)
    first, second = run(a, truth, odometry), run(b, truth, odometry)
    np.testing.assert_allclose(se2.compose(T_new_old, a.path()), b.path(), atol=1e-7)
    np.testing.assert_array_equal(a.update_scans, b.update_scans)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_allclose(se2.compose(T_new_old, one.pose), other.pose, atol=1e-7)
        np.testing.assert_allclose(np.linalg.eigvalsh(one.covariance), np.linalg.eigvalsh(other.covariance), atol=1e-7)


@pytest.mark.parametrize("known", [True, False])
def test_same_seed_same_bits_with_any_number_of_threads(known):
    truth, odometry = drive(10)
    paths = []
    for threads in (1, 2):
        localization = Localization(L_ROOM, start=truth[0] if known else None, seed=5, threads=threads)
        run(localization, truth, odometry)
        paths.append(localization.path())
    np.testing.assert_array_equal(*paths)


def test_coarse_maps_and_maps_with_walls_alone_at_the_faces_serve_too():
    truth, odometry = drive()
    coarse = map_of(rooms.WALLS, cell=0.1, thickness=0.15)
    thin = map_of(rooms.WALLS, cell=0.05, thickness=0.04)
    for grid, limit in ((coarse, 0.05), (thin, 0.02)):
        localization = Localization(grid, start=truth[0], threads=1)
        run(localization, truth, odometry)
        assert np.median(errors(localization, truth)[0]) < limit


def test_before_the_first_hit_the_pose_is_the_start_or_anywhere():
    blind = Scan(ranges=np.full(10, np.inf), angles=np.linspace(-1, 1, 10), range_max=10.0)
    tracked = Localization(L_ROOM, start=(0.5, 0.2, 0.1), threads=1)
    report = tracked.process((0.0, 0.0, 0.0), blind)
    assert not report.updated
    np.testing.assert_allclose(report.pose, (0.5, 0.2, 0.1), atol=1e-12)
    assert tracked.status.explained_share is None
    np.testing.assert_allclose(np.diag(report.covariance) ** 0.5, (0.3, 0.3, 0.15), atol=1e-12)
    lost = Localization(L_ROOM, threads=1)
    report = lost.process((0.0, 0.0, 0.0), blind)
    free = free_cells(L_ROOM) + L_ROOM.origin[:2]
    np.testing.assert_allclose(report.pose[:2], free.mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(report.covariance[:2, :2], np.cov(free.T, ddof=0), atol=1e-9)
    assert lost.status.state == "searching"
    assert len(lost.path()) == len(lost.update_scans) == 1


def test_bad_maps_and_starts_are_refused_in_one_line():
    bare = dataclasses.replace(L_ROOM, probability=np.zeros((20, 20), np.float32))
    full = dataclasses.replace(L_ROOM, probability=np.ones((20, 20), np.float32))
    with pytest.raises(ValueError, match="the map has no walls"):
        Localization(bare)
    with pytest.raises(ValueError, match="the map has no free space"):
        Localization(full)
    with pytest.raises(ValueError, match=r"start \(50, 0\) m lies .* outside of the map's free space"):
        Localization(L_ROOM, start=(50.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="three finite numbers"):
        Localization(L_ROOM, start=(0.0, np.nan, 0.0))
    with pytest.raises(ValueError, match="min_explained_share must be in"):
        LocalizationConfig(min_explained_share=1.5)
    localization = Localization(L_ROOM, FilterConfig(particles=4))
    with pytest.raises(ValueError, match="odometry must be three finite numbers"):
        localization.process((0.0, np.inf, 0.0), rooms.scan_at((0.0, 0.0, 0.0)))
