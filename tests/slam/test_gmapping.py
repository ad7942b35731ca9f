# SPDX-License-Identifier: MIT
"""The whole filter: variants, gates, reports, and what it makes of a drive through a room."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from slam import FilterConfig, GMapping, OccupancyGrid, se2
from slam.config import GateConfig, MapConfig, MatchConfig, MotionConfig, ProposalConfig, ResampleConfig
from tests.slam.rooms import MOUNT, WALLS, drive, scan_at

EVERY_SCAN = GateConfig(distance=0.0, angle=0.0)


def config(**changes):
    return FilterConfig(
        **(
            {
                "particles": 8,
                "motion": MotionConfig(failure_share=0.05),
                "map": MapConfig(cell=0.05, field_radius=0.4),
                "match": MatchConfig(hit_sigma=0.05, beam_weight=0.3, weight_share=0.5),
                "gate": EVERY_SCAN,
            }
            | changes
        )
    )


def noisy_drive(steps, seed=0):
    """True poses, odometry that drifts, and scans."""
    rng = np.random.default_rng(seed)
    truth = drive(steps, distance=0.2, turn=0.15)
    odometry = np.zeros_like(truth)
    for k, motion in enumerate(se2.between(truth[:-1], truth[1:])):
        odometry[k + 1] = se2.compose(odometry[k], motion + rng.normal(scale=(0.02, 0.01, 0.02)))
    return truth, odometry, [scan_at(pose, beams=90, noise=0.01, rng=rng) for pose in truth]


def run(settings, steps=15, seed=0):
    truth, odometry, scans = noisy_drive(steps, seed)
    mapper = GMapping(settings, seed=seed, threads=1)
    reports = [mapper.process(pose, scan) for pose, scan in zip(odometry, scans, strict=True)]
    return mapper, reports, truth, odometry


def wall_distance(points):
    """Distance [m] of points (n, 2) to the room's true walls."""
    start, along = WALLS[:, None, :2], WALLS[:, None, 2:] - WALLS[:, None, :2]
    share = np.clip(((points - start) * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    return np.linalg.norm(points - start - share[..., None] * along, axis=-1).min(axis=0)


SCHEMES = ["systematic", "stratified", "residual", "multinomial"]
POLICIES = [("never", "systematic"), *itertools.product(["ess", "always"], SCHEMES)]


@pytest.mark.parametrize("kind", ["improved", "scan-match"])
@pytest.mark.parametrize(("when", "scheme"), POLICIES)
def test_every_variant_follows_the_robot(kind, when, scheme):
    settings = config(proposal=ProposalConfig(kind=kind), resample=ResampleConfig(when=when, scheme=scheme))
    mapper, reports, truth, odometry = run(settings, steps=40)
    error = np.hypot(*(mapper.path() - truth)[:, :2].T)
    assert np.sqrt(np.mean(error**2)) < 0.07
    assert error.max() < 0.6 * np.hypot(*(odometry - truth)[:, :2].T).max()
    resampled = [report.resampled for report in reports[1:]]
    assert {"always": all(resampled), "never": not any(resampled), "ess": True}[when]


def test_motion_proposal_follows_the_robot_with_enough_particles():
    settings = config(particles=100, proposal=ProposalConfig(kind="motion"))
    mapper, _, truth, _ = run(settings)
    assert np.hypot(*(mapper.path() - truth)[:, :2].T).max() < 0.15


@pytest.mark.parametrize("threshold", [0.5, 0.9])
def test_resampling_by_effective_sample_size(threshold):
    settings = config(resample=ResampleConfig(when="ess", threshold=threshold), particles=10)
    _, reports, _, _ = run(settings)
    for report in reports:
        assert 1.0 - 1e-9 <= report.ess <= 10.0 + 1e-9
        assert report.resampled == (report.ess < threshold * 10)
    assert any(report.resampled for report in reports)


def test_walls_of_the_map_are_the_walls_of_the_room():
    mapper, _, _, _ = run(config(), steps=25)
    grid = mapper.map()
    assert isinstance(grid, OccupancyGrid)
    rows, columns = np.nonzero(grid.occupied)
    centres = np.array(grid.origin[:2]) + grid.resolution * (np.column_stack([columns, rows]) + 0.5)
    away = wall_distance(centres)
    assert len(centres) > 200
    assert np.mean(away < 0.08) > 0.95
    rows, columns = np.nonzero(grid.free)
    inside = np.array(grid.origin[:2]) + grid.resolution * (np.column_stack([columns, rows]) + 0.5)
    assert np.mean(wall_distance(inside) > 0.05) > 0.95


def test_report_of_a_step():
    mapper, reports, _, _ = run(config(particles=5, resample=ResampleConfig(when="never")), steps=3)
    last = reports[-1]
    assert last.updated
    np.testing.assert_array_equal(last.pose, mapper.poses[last.best])
    np.testing.assert_array_equal(last.pose, mapper.path()[-1])
    assert last.best == np.argmax(mapper.weights)
    assert last.ess == pytest.approx(1.0 / np.sum(mapper.weights**2))
    assert last.matched_share > 0.9
    assert last.match_failures == 0
    assert last.unique_ancestors == 5
    assert last.map_bytes == mapper.maps.bytes_in_use > 0
    assert set(last.seconds) == {"match", "map", "resample"}
    assert np.all(np.linalg.eigvalsh(last.covariance) > 0.0)
    assert np.isfinite(last.log_evidence)
    np.testing.assert_array_equal(last.proposed.pose, mapper.poses)


def test_gates():
    mapper = GMapping(config(gate=GateConfig(distance=0.5, angle=0.3, seconds=10.0)), threads=1)
    taken = []
    for odometry, stamp in [
        ((0.0, 0.0, 0.0), 0.0),  # the first
        ((0.2, 0.0, 0.0), 1.0),
        ((0.4, 0.0, 0.2), 2.0),
        ((0.51, 0.0, 0.0), 3.0),  # far enough
        ((0.6, 0.0, 0.31), 4.0),  # turned enough
        ((0.6, 0.0, 0.0), 13.0),  # turned back
        ((0.6, 0.0, 0.0), 22.9),
        ((0.6, 0.0, 0.0), 23.0),  # waited enough
    ]:
        report = mapper.process(odometry, scan_at(odometry, stamp=stamp))
        taken.append(report.updated)
        assert (report.proposed is not None) == (report.updated and len(taken) > 1)
    assert taken == [True, False, False, True, True, True, False, True]
    assert mapper.update_scans.tolist() == [0, 3, 4, 5, 7]
    assert len(mapper.path()) == 5


def test_between_updates_the_pose_moves_by_odometry():
    mapper = GMapping(config(gate=GateConfig(distance=1.0, angle=1.0)), threads=1)
    mapper.process((5.0, 5.0, np.pi / 2.0), scan_at(np.zeros(3)))
    report = mapper.process((5.0, 5.5, np.pi / 2.0 + 0.2), scan_at(np.zeros(3)))
    np.testing.assert_allclose(report.pose, (0.5, 0.0, 0.2), atol=1e-12)
    assert len(mapper.path()) == 1


def test_the_frame_of_the_odometry_does_not_matter():
    _, odometry, scans = noisy_drive(6)
    moved = se2.compose((30.0, -7.0, 2.0), odometry)
    paths = []
    for track in (odometry, moved):
        mapper = GMapping(config(), seed=1, threads=1)
        for pose, scan in zip(track, scans, strict=True):
            mapper.process(pose, scan)
        paths.append(mapper.path())
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-3)


def test_several_lidars_and_changing_beam_counts():
    truth, odometry, _ = noisy_drive(10)
    mapper = GMapping(config(), threads=1)
    for k, (pose, at) in enumerate(zip(odometry, truth, strict=True)):
        front, rear = scan_at(at, beams=30 + 7 * k, mount=MOUNT), scan_at(at, beams=50, mount=(-0.2, 0.0, 3.0))
        mapper.process(pose, [front, rear])
    assert np.hypot(*(mapper.path() - truth)[:, :2].T).max() < 0.1


def test_the_map_holds_what_each_of_several_lidars_saw():
    """One lidar looks ahead, the other back: whole scans and their two halves give the same counts."""
    truth, odometry, _ = noisy_drive(6)
    whole, halves = (GMapping(config(), seed=3, threads=1) for _ in range(2))
    for true, odom in zip(truth, odometry, strict=True):
        scan = scan_at(true, beams=90)
        ahead = np.abs(scan.angles) < 0.5 * np.pi
        parts = [replace(scan, ranges=scan.ranges[side], angles=scan.angles[side]) for side in (ahead, ~ahead)]
        whole.process(
            odom,
            replace(
                scan,
                ranges=np.concatenate([part.ranges for part in parts]),
                angles=np.concatenate([part.angles for part in parts]),
            ),
        )
        halves.process(odom, parts)
    assert halves.path().tobytes() == whole.path().tobytes()
    assert halves.map().probability.tobytes() == whole.map().probability.tobytes()


def test_deskewing_is_an_option():
    """A robot that turns fast while the lidar does: with the beams' times the room keeps its shape."""
    omega, period, beams = 1.5, 0.2, 180
    starts = np.arange(6) * 0.3

    def sweep(heading):
        offsets = np.linspace(0.0, period, beams)
        singles = [scan_at((0.0, 0.0, heading + omega * t), beams=beams) for t in offsets]
        ranges = np.array([single.ranges[k] for k, single in enumerate(singles)])
        return type(singles[0])(
            ranges=ranges, angles=singles[0].angles, range_max=20.0, mount=MOUNT, time_offsets=offsets
        )

    blur = {}
    for deskew in (True, False):
        mapper = GMapping(config(deskew=deskew), threads=1)
        for heading in starts:
            mapper.process((0.0, 0.0, heading), sweep(heading), twist=(0.0, 0.0, omega))
        grid = mapper.map()
        rows, columns = np.nonzero(grid.occupied)
        centres = np.array(grid.origin[:2]) + grid.resolution * (np.column_stack([columns, rows]) + 0.5)
        blur[deskew] = np.mean(wall_distance(centres) ** 2) ** 0.5
    assert blur[True] < 0.05
    assert blur[False] > 2.0 * blur[True]


def test_after_resampling_the_best_pose_is_of_the_likeliest_history():
    """The reported pose, the path's end and the map are of one particle, and it is not always number 0."""
    mapper = GMapping(config(particles=6, resample=ResampleConfig(when="always")), seed=3)
    truth, odometry, scans = noisy_drive(12)
    best = []
    for t in range(len(truth)):
        report = mapper.process(odometry[t], scans[t])
        np.testing.assert_array_equal(mapper.path()[-1], mapper.poses[mapper.best])
        assert np.ptp(mapper.weights) == 0.0
        best.append(mapper.best)
        assert report.best < 6
    assert any(number != 0 for number in best)


def test_neighbouring_poses_do_not_scatter_as_their_covariances_say():
    """What a particle errs by changes slowly: its path is smooth, although beams count by a small share."""
    settings = config(particles=20, match=MatchConfig(beam_weight=0.07))
    mapper, truth = GMapping(settings, seed=1, threads=1), drive(25, distance=0.1, turn=0.04)
    for pose in truth:
        mapper.process(pose, scan_at(pose, beams=180))
    away = np.array([mapper.path(i) for i in range(20)]) - truth
    said = np.sqrt(np.diagonal(mapper._particles.covariances.mean(axis=0)))
    scatter = np.std(np.diff(away[:, 5:], axis=1), axis=(0, 1))  # sqrt(2) times as much if they were independent
    assert np.all(scatter < 0.4 * said)
    assert np.all(np.std(away[:, -1], axis=0) > 0.2 * said)  # but particles differ
