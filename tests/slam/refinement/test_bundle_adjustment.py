# SPDX-License-Identifier: MIT
"""The equations of the final pass against dense ones and numerical derivatives, and what may pull a pose."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam._threads import Threads
from slam.config import RefineConfig
from slam.refinement._chain_kernels import add_odometry_steps
from slam.refinement._normal_equations_kernels import (
    SurfelObservations,
    collect,
    count_surfels,
    subtract_schur_complement,
)
from slam.refinement._surfel_match_kernels import SLOPE_PRECISION, Matches, match_points, weigh_points
from slam.refinement.bundle_adjustment import GAUGE, Adjustment
from slam.refinement.joint_equations import conjugate_gradients
from slam.refinement.noise import INITIAL, Noise
from slam.refinement.surfels import find_surfels, make_cells, make_cloud, transform_cloud
from tests.slam.refinement.test_chain import dense_matrix
from tests.slam.rooms import rays


def random_problem(seed, scans=4, surfels=5, hits=30):
    """Poses, points in the map's frame, first, and matches with weights, of walls that no scan saw alone."""
    rng = np.random.default_rng(seed)
    poses = rng.normal(size=(scans, 3))
    points = rng.normal(scale=3.0, size=(scans * hits, 2))
    angle = rng.uniform(-np.pi, np.pi, surfels)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    surfel = rng.integers(-1, surfels, scans * hits).astype(np.int32)
    across, along = 0.1 * rng.normal(size=scans * hits), rng.normal(size=scans * hits)
    weight = np.where(surfel >= 0, rng.uniform(50.0, 200.0, scans * hits), 0.0)
    for e in range(surfels):  # distances from the line, and from its middle, as `weigh_points` leaves them
        own = surfel == e
        w = weight[own]
        across[own] -= np.average(across[own], weights=w)
        along[own] -= np.average(along[own], weights=w)
        across[own] -= along[own] * (w @ (along[own] * across[own])) / (w @ along[own] ** 2)
    first = np.arange(scans + 1) * hits
    return poses, points, first, Matches(surfel, across, along, np.ones(len(surfel)), weight), normal


def precisions(matches, surfels):
    """Precisions of the offsets and of the slopes, (2 surfels,)."""
    own = matches.surfel >= 0
    e, w, s = matches.surfel[own], matches.weight[own], matches.along[own]
    return np.concatenate([np.bincount(e, w, surfels), SLOPE_PRECISION + np.bincount(e, w * s**2, surfels)])


def moved_cost(problem, delta):
    """The least cost over offsets and slopes after the poses have moved by a small delta (scans, 3), with the prior on
    the slopes."""
    poses, points, first, matches, normal = problem
    scan = np.repeat(np.arange(len(poses)), np.diff(first))
    arm = points - poses[scan, :2]
    moved = delta[scan, :2] + delta[scan, 2:] * np.stack([-arm[:, 1], arm[:, 0]], axis=-1)
    r = matches.across + np.sum(normal[matches.surfel] * moved, axis=1)
    total = 0.0
    for e in range(len(normal)):
        own = matches.surfel == e
        w, s = matches.weight[own], matches.along[own]
        design = np.stack([np.ones(len(s)), s], axis=1)
        prior = np.diag([0.0, SLOPE_PRECISION])
        line = np.linalg.solve(design.T @ (w[:, None] * design) + prior, design.T @ (w * r[own]))
        total += 0.5 * np.sum(w * (r[own] - design @ line) ** 2) + 0.5 * line @ prior @ line
    return total


@pytest.mark.parametrize("seed", range(5))
def test_equations_are_those_of_the_least_cost_over_all_lines(seed):
    problem = random_problem(seed)
    poses, points, first, matches, normal = problem
    scans = len(poses)
    diagonal, gradient, count = np.zeros((scans, 3, 3)), np.zeros((scans, 3)), np.empty(scans, np.int64)
    count_surfels(0, scans, first, matches.surfel, len(normal), count)
    begins = np.concatenate([[0], np.cumsum(2 * count)])
    observations = SurfelObservations(begins, np.full(begins[-1], -1, np.int32), *np.full((3, begins[-1]), np.nan))
    collect(0, scans, first, poses, points, matches, normal, diagonal, gradient, observations)
    normal = np.tile(normal, (2, 1))
    scan_of = np.repeat(np.arange(scans), np.diff(begins))
    pull = observations.residual[:, None] * normal[observations.surfel]
    np.testing.assert_allclose([pull[scan_of == i].sum(axis=0) for i in range(scans)], gradient[:, :2], atol=1e-8)
    for begin, end in pairwise(observations.first):  # one row for each offset and slope that a scan sees
        assert len(set(observations.surfel[begin:end])) == end - begin
    total = precisions(matches, len(normal) // 2)

    def product(x):
        out = np.einsum("nij,nj->ni", diagonal, x)
        subtract_schur_complement(observations, normal, total, x, out)
        return out

    zero = np.zeros((scans, 3))
    for k in range(3 * scans):
        unit = np.eye(3 * scans)[k].reshape(scans, 3)
        ahead, back = moved_cost(problem, unit), moved_cost(problem, -unit)
        assert 0.5 * (ahead - back) == pytest.approx(gradient.ravel()[k], abs=1e-7)  # the cost is a quadratic form
        assert ahead + back - 2.0 * moved_cost(problem, zero) == pytest.approx(product(unit).ravel()[k], abs=1e-6)
        for j in range(k):  # mixed derivatives
            other = np.eye(3 * scans)[j].reshape(scans, 3)
            mixed = moved_cost(problem, unit + other) - ahead - moved_cost(problem, other) + moved_cost(problem, zero)
            assert mixed == pytest.approx(product(unit).ravel()[j], abs=1e-6)


@given(st.integers(1, 8), st.integers(0, 10**6))
@settings(deadline=None)
def test_conjugate_gradients_equal_a_dense_solve(n, seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3 * n, 3 * n))
    H, right = root @ root.T + np.eye(3 * n), rng.normal(size=(n, 3))
    x = conjugate_gradients(
        lambda v: (H @ v.ravel()).reshape(n, 3), lambda v: (v.ravel() / np.diag(H)).reshape(n, 3), right
    )
    expected = np.linalg.solve(H, right.ravel()).reshape(n, 3)
    assert np.linalg.norm(x - expected) <= 1e-4 * np.linalg.norm(expected)
    np.testing.assert_array_equal(conjugate_gradients(lambda v: v, lambda v: v, np.zeros((n, 3))), 0.0)


def test_weights_fall_with_the_distance_and_leave_the_mean_where_most_points_are():
    across = np.concatenate([np.linspace(-0.01, 0.01, 40), [0.3, 0.31]])
    n = len(across)
    along = np.zeros(n)  # all at one place: there is no slope
    matches = Matches(np.zeros(n, np.int32), across.copy(), along, np.full(n, 0.01**2), np.empty(n))
    normal, total = np.array([[1.0, 0.0]]), np.empty(2)
    weigh_points(matches, np.array([0, n]), 1.0, 0.03, 0.0, -1.0, normal, total)
    assert abs(np.mean(matches.across[:40])) < 0.001  # a plain mean would be off by 15 mm
    assert total[0] == pytest.approx(matches.weight.sum())
    assert matches.weight[-1] < 0.02 * matches.weight[20]


@pytest.mark.parametrize("shared", [0.0, 0.004**2, 0.02**2])
def test_what_a_scan_shares_limits_what_its_mean_counts(shared):
    """Weighed means of two scans on one surfel, with 40 and 4 end points: each counts 1 / (shared + variance / n)."""
    counts, sigma = np.array([40, 4]), 0.02
    n, first = int(counts.sum()), np.array([0, 40, 44])
    across = np.repeat([0.001, -0.001], counts)
    matches = Matches(np.zeros(n, np.int32), across.copy(), np.zeros(n), np.full(n, sigma**2), np.empty(n))
    normal, total = np.array([[1.0, 0.0]]), np.empty(2)
    weigh_points(matches, first, 1.0, 10.0, shared, 0.0, normal, total)  # so wide a gate that the loss is a square
    expected = 1.0 / (shared + sigma**2 / counts)
    found = np.add.reduceat(matches.weight, first[:-1])
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert total[0] == pytest.approx(expected.sum(), rel=1e-6)
    assert matches.across @ matches.weight == pytest.approx(0.0, abs=1e-9)  # from the weighted mean


@given(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-np.pi, np.pi))
def test_normals_are_turned_to_the_line_through_the_end_points(angle, offset, direction):
    """End points that lie exactly on a line at an angle to the normal that they were matched with."""
    s = np.linspace(-0.2, 0.25, 40)
    across, along = offset + np.sin(angle) * s, np.cos(angle) * s
    matches = Matches(np.zeros(40, np.int32), across, along, np.full(40, 1e-6), np.empty(40))
    normal, total = np.array([[np.cos(direction), np.sin(direction)]]), np.empty(2)
    weigh_points(matches, np.array([0, 40]), 1.0, 10.0, 0.0, 0.0, normal, total)
    turned = np.arctan2(normal[0, 1], normal[0, 0]) - direction
    assert np.sin(turned + angle) == pytest.approx(0.0, abs=1e-4)  # a tangent that turns left takes its normal along
    np.testing.assert_allclose(matches.across, 0.0, atol=1e-4)
    np.testing.assert_allclose(matches.along, s - s.mean(), atol=1e-4)


def test_scans_count_less_where_a_surfel_is_no_straight_line():
    """Ten scans see a surfel of which every second end point is 4 cm behind the others, at one place."""
    across, first = np.tile([-0.02, 0.02], 50), np.arange(11) * 10
    sums = []
    for surplus in (0.0, -1.0):  # with -1 no scatter is more than the noise
        matches = Matches(np.zeros(100, np.int32), across.copy(), np.zeros(100), np.full(100, 1e-4), np.empty(100))
        total = np.empty(2)
        weigh_points(matches, first, 1.0, 10.0, 0.0, surplus, np.array([[1.0, 0.0]]), total)
        sums.append(total[0])
    assert sums[1] == pytest.approx(100 / 1e-4, rel=1e-4)
    assert sums[0] == pytest.approx(10 / (0.02**2 - 1e-4 + 1e-4 / 10), rel=1e-3)


EXACT = Noise(1e-6, 0.0, 0.0, 0.0)


def matched(parts, poses, gate, noise=INITIAL, found=EXACT):
    """Surfels and matches of scans given as `Rays`, taken at poses (scans, 3)."""
    config, threads = RefineConfig(), Threads(1)
    cloud = make_cloud(parts, config.max_points)
    there = transform_cloud(cloud, np.asarray(poses, dtype=np.float64), threads)
    cells, cell_of = make_cells(there.points, config.cell)
    surfels = find_surfels(there, cloud, cells, cell_of, config, (INITIAL, found), 0.6, threads)
    n = len(cloud.ends)
    matches = Matches(np.empty(n, np.int32), *np.empty((4, n)))
    match_points(0, n, there, cloud.ranges, cells, cell_of, surfels, noise, found, config.spacing, gate, matches)
    return surfels, matches


def test_variances_follow_range_and_angle_of_incidence():
    wall = np.stack([np.full(161, 2.0), np.linspace(-2.0, 2.0, 161)], axis=-1)
    noise = Noise(0.01**2, 0.02**2, 0.005**2, 0.0)
    _, matches = matched([rays(wall)] * 2, [(0.0, 0.0, 0.0)] * 2, 0.1, noise)
    squared, own = np.tile((wall**2).sum(axis=1), 2), matches.surfel >= 0
    expected = noise.floor + noise.along * 2.0**2 + noise.across * (squared - 2.0**2)  # 2 m from the wall
    assert own.mean() > 0.9
    np.testing.assert_allclose(matches.variance[own], expected[own], rtol=1e-3)


def test_readings_count_alike_whether_too_short_or_too_long():
    wall = np.stack([np.full(161, 2.0), np.linspace(-2.0, 2.0, 161)], axis=-1)
    share = np.array([0.99, 1.01])[np.arange(161) % 2, None]  # of the true range, in turns
    _, matches = matched([rays(wall), rays(wall * share)], [(0.0, 0.0, 0.0)] * 2, 0.1, Noise(1e-4, 4e-4, 1e-4, 0.0))
    own = (matches.surfel[:161] >= 0) & (matches.surfel[161:] >= 0)
    assert own.mean() > 0.8
    np.testing.assert_allclose(matches.variance[161:][own], matches.variance[:161][own], rtol=5e-3)


def test_end_points_belong_to_the_wall_that_they_lie_on():
    wall = np.stack([np.full(161, 2.0), np.linspace(-2.0, 2.0, 161)], axis=-1)
    surfels, matches = matched([rays(wall), rays(wall)], [(0.0, 0.0, 0.0), (0.02, 0.0, 0.0)], gate=0.1)
    assert np.mean(matches.surfel >= 0) > 0.98
    own = matches.surfel >= 0
    np.testing.assert_allclose(surfels.normal[matches.surfel[own]], [(-1.0, 0.0)] * own.sum(), atol=0.05)
    first = np.arange(len(own)) < 161
    np.testing.assert_allclose(matches.across[own & first], 0.01, atol=0.002)  # the surfels lie between both
    np.testing.assert_allclose(matches.across[own & ~first], -0.01, atol=0.002)


def test_the_side_of_a_box_before_a_wall_belongs_to_no_wall():
    wall = np.stack([np.full(161, 2.0), np.linspace(-2.0, 2.0, 161)], axis=-1)
    side = np.stack([np.linspace(1.6, 1.98, 30), np.full(30, 0.5)], axis=-1)  # of a box, at a right angle to the wall
    surfels, matches = matched([rays(np.concatenate([wall, side]))], [(0.0, 0.0, 0.0)], gate=0.2)
    taken = matches.surfel[161:]
    faces_the_robot = np.abs(surfels.normal[taken[taken >= 0], 1]) > 0.9
    assert faces_the_robot.all()


def test_end_points_go_to_the_nearest_centre_not_to_the_nearest_line():
    """Every second surfel was turned by 8 degrees: the lines of the others are nearest to all end points."""
    y = np.linspace(-2.0, 2.0, 161)
    wall = np.stack([np.full(161, 2.0), y], axis=-1)
    config, cloud = RefineConfig(), make_cloud([rays(wall)] * 2, 10**6)
    there = transform_cloud(cloud, np.zeros((2, 3)), Threads(1))
    cells, cell_of = make_cells(there.points, config.cell)
    surfels = find_surfels(there, cloud, cells, cell_of, config, (INITIAL, EXACT), 0.6, Threads(1))
    turn = np.pi + np.deg2rad(8.0) * (np.argsort(np.argsort(surfels.point[:, 1])) % 2)
    aslant = surfels._replace(normal=np.stack([np.cos(turn), np.sin(turn)], axis=-1))
    matches = Matches(np.empty(322, np.int32), *np.empty((4, 322)))
    match_points(0, 322, there, cloud.ranges, cells, cell_of, aslant, INITIAL, EXACT, config.spacing, 0.1, matches)
    own = matches.surfel[:161] >= 0
    assert own.mean() > 0.9
    apart = np.abs(y[:, None] - surfels.point[:, 1])
    taken = apart[np.arange(161), matches.surfel[:161]]
    assert np.all((taken <= apart.min(axis=1) + 0.01)[own])


@pytest.mark.parametrize("sigma", [0.0, 0.05, 0.1])
def test_near_a_corner_end_points_belong_to_no_wall(sigma):
    """Within two standard deviations of the noise, rounded to cells of 5 cm, and where windows of 15 cm see both."""
    y = np.linspace(-2.0, 0.0, 161)
    wall = np.stack([np.full(161, 2.0), y], axis=-1)
    other = np.stack([np.linspace(0.0, 1.99, 160), np.zeros(160)], axis=-1)
    seen = rays(np.concatenate([wall, other]) - (0.0, 1.0))  # both walls face the robot, which is 1 m away
    _, matches = matched([seen] * 2, [(0.0, 1.0, 0.0)] * 2, 0.1, found=Noise(sigma**2 + 1e-6, 0.0, 0.0, 0.0))
    own = matches.surfel[:161] >= 0
    assert own[(y < -2.0 * sigma - 0.25) & (y > -1.9)].all()
    assert not own[y > -2.0 * sigma].any()


def square_room():
    """Hits on the four walls of a room of 4 m by 4 m, about the robot."""
    y = np.linspace(-2.0, 2.0, 161)
    walls = np.concatenate([np.stack([np.full(161, x), y], axis=-1) for x in (2.0, -2.0)])
    return rays(np.concatenate([walls, walls[:, ::-1]]))


def dense_solutions(adjustment, poses, gate):
    """The step that solves the whole system, and the one with all walls held."""
    n = len(poses)
    diagonal, coupling, gradient = np.zeros((n, 3, 3)), np.zeros((n - 1, 3, 3)), np.zeros((n, 3))
    add_odometry_steps(adjustment.prior, poses, adjustment.calibration.motions(), diagonal, coupling, gradient)
    scans = adjustment.scan_equations(poses, gate)
    held = dense_matrix(diagonal + scans.diagonal, coupling)
    held[:3, :3] += GAUGE * np.eye(3)
    B = np.zeros((3 * n, len(scans.normal)))
    for scan, (begin, end) in enumerate(pairwise(scans.observations.first)):
        for k in range(begin, end):
            e = scans.observations.surfel[k]
            B[3 * scan : 3 * scan + 2, e] = scans.observations.weight[k] * scans.normal[e]
            B[3 * scan + 2, e] = scans.observations.heading_jacobian[k]
    seen = scans.total > 0.0
    right = -(gradient + scans.gradient).ravel()
    whole = np.linalg.solve(held - (B[:, seen] / scans.total[seen]) @ B[:, seen].T, right)
    return whole.reshape(n, 3), np.linalg.solve(held, right).reshape(n, 3)


def test_a_step_solves_the_whole_system_in_which_walls_follow():
    """Two rooms that share no wall, 4 cm farther apart by odometry than the poses have them: with its walls the second
    room moves to where odometry says; with walls held its scans would stay where they are."""
    n = 8
    second = np.where(np.arange(n) >= n // 2, 1.0, 0.0)
    odometry = np.stack([10.04 * second, np.zeros(n), np.zeros(n)], axis=-1)
    adjustment = Adjustment(odometry, make_cloud([square_room()] * n, 10**6), np.arange(n), RefineConfig(), Threads(1))
    poses = np.random.default_rng(0).normal(scale=(0.01, 0.01, 0.002), size=(n, 3))
    poses[:, 0] += 10.0 * second
    whole, held = dense_solutions(adjustment, poses, 0.1)
    step = adjustment.step(poses, 0.1)
    relative = step - step[0]  # nothing but the weak gauge holds the whole
    np.testing.assert_allclose(relative, whole - whole[0], atol=2e-4)
    apart = np.mean((poses + step)[n // 2 :, 0]) - np.mean((poses + step)[: n // 2, 0])
    assert apart == pytest.approx(10.04, abs=0.005)
    stayed = np.mean((poses + held)[n // 2 :, 0]) - np.mean((poses + held)[: n // 2, 0])
    assert stayed == pytest.approx(10.0, abs=0.01)


def test_one_scan_among_many_comes_into_step():
    poses = np.zeros((8, 3))
    adjustment = Adjustment(poses, make_cloud([square_room()] * 8, 10**6), np.arange(8), RefineConfig(), Threads(1))
    off = poses.copy()
    off[3] = 0.03, -0.02, 0.01
    for gate in (0.1, 0.05, 0.03):
        off += adjustment.step(off, gate)
    np.testing.assert_allclose(off - off.mean(axis=0), 0.0, atol=0.002)
