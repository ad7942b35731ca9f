# SPDX-License-Identifier: MIT
"""The pose graph: against another program's optimum, against known covariances, and with wrong loops in it."""

import gtsam
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import se2
from slam.loops.pose_graph import Edges, Marginals, join, optimise, optimise_robustly, squared_distances
from testbed.formats.g2o import write_g2o

SIGMA = np.array([0.05, 0.03, 0.01])


def circle(n, radius=8.0):
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    return np.column_stack([radius * np.sin(angle), radius * (1.0 - np.cos(angle)), se2.wrap_angle(angle)])


def measured(truth, first, second, rng, scale=1.0):
    """Edges with errors, seen from the second node."""
    exact = se2.between(truth[first], truth[second])
    noise = scale * SIGMA * rng.standard_normal((len(first), 3))
    return Edges(first, second, se2.compose(exact, noise), np.tile(np.diag(SIGMA**2), (len(first), 1, 1)))


def chain_of(truth, rng):
    k = np.arange(len(truth))
    return measured(truth, k[:-1], k[1:], rng)


def along(chain, first):
    """Poses by the chain alone."""
    poses = [first]
    for motion in chain.measured:
        poses.append(se2.compose(poses[-1], motion))
    return np.array(poses)


def test_optimum_is_that_of_gtsam(tmp_path):
    rng = np.random.default_rng(0)
    truth = circle(40)
    chain = chain_of(truth, rng)
    loops = measured(truth, np.array([0, 3, 10]), np.array([39, 36, 31]), rng)
    edges = join(chain, loops)
    start = along(chain, truth[0])
    ours = optimise(start, edges, np.ones(len(edges.first)))
    write_g2o(tmp_path / "graph.g2o", start, edges)
    graph, initial = gtsam.readG2o(str(tmp_path / "graph.g2o"), False)
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*truth[0]), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setMaxIterations(200)
    settings.setRelativeErrorTol(1e-15)
    settings.setAbsoluteErrorTol(1e-15)
    result = gtsam.LevenbergMarquardtOptimizer(graph, initial, settings).optimize()
    theirs = np.array([[p.x(), p.y(), p.theta()] for p in map(result.atPose2, range(len(truth)))])
    np.testing.assert_allclose(se2.between(ours, theirs), 0.0, atol=1e-6)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), wrong=st.integers(1, 4))
def test_wrong_loops_are_rejected(seed, wrong):
    rng = np.random.default_rng(seed)
    truth = circle(30)
    chain, right = (
        chain_of(truth, rng),
        measured(truth, np.array([0, 2, 4, 6, 8, 1]), np.array([29, 28, 27, 25, 23, 26]), rng),
    )
    first = rng.integers(0, 10, wrong)
    false = measured(truth, first, first + 12, rng)
    false = false._replace(measured=se2.compose(false.measured, rng.choice([-1, 1], (wrong, 3)) * (2.0, 2.0, 0.5)))
    poses, weights = optimise_robustly(along(chain, truth[0]), chain, join(right, false))
    assert not weights[6:].any()
    assert weights[:6].sum() >= 5  # one right measurement in a thousand is cut off
    alone = optimise(along(chain, truth[0]), join(chain, right), np.concatenate([np.ones(29), weights[:6]]))
    np.testing.assert_allclose(poses, alone, atol=1e-5)


def test_a_chain_has_the_covariances_of_its_edges():
    rng = np.random.default_rng(1)
    truth = circle(12)
    chain = chain_of(truth, rng)
    poses = along(chain, truth[0])
    k = np.arange(11)
    found = Marginals(poses, chain, np.ones(11)).relative(k, k + 1)
    turn = np.stack(
        [np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]]) for t in chain.measured[:, 2]]
    )
    np.testing.assert_allclose(found, turn @ chain.covariance @ turn.swapaxes(1, 2), atol=1e-12)


def test_relative_covariances_are_those_of_many_draws():
    truth = circle(10)
    first, second = np.array([0]), np.array([9])
    exact = join(
        measured(truth, np.arange(9), np.arange(1, 10), np.random.default_rng(0), 0.0),
        measured(truth, first, second, np.random.default_rng(0), 0.0),
    )
    claimed = Marginals(truth, exact, np.ones(10)).relative(np.array([2]), np.array([7]))[0]
    seen = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        drawn = join(chain_of(truth, rng), measured(truth, first, second, rng))
        poses = optimise(truth, drawn, np.ones(10))
        error = se2.between(poses[2], poses[7]) - se2.between(truth[2], truth[7])
        seen.append((*error[:2], se2.wrap_angle(error[2])))
    scatter = np.cov(np.array(seen).T)
    assert np.abs(np.linalg.eigvals(np.linalg.solve(claimed, scatter)).real - 1.0).max() < 0.35


def test_edges_that_fit_have_no_distance():
    truth = circle(6)
    edges = measured(truth, np.arange(5), np.arange(1, 6), np.random.default_rng(0), 0.0)
    np.testing.assert_allclose(squared_distances(truth, edges), 0.0, atol=1e-20)
