# SPDX-License-Identifier: MIT
"""The wide search: a robot that jumped is found again, and nothing likelier is left out where the search is narrow."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from slam import FilterConfig, GMapping, se2
from slam.config import GateConfig, MapConfig, MatchConfig, MotionConfig
from slam.matching._likelihood_kernels import end_points, scan_costs, walls_of
from slam.matching.likelihood import ScanAndPrior, make_beam_model
from slam.matching.scan_matching import empty_matches, make_match_settings, match_scan
from slam.matching.wide_search import make_lattice, wide_starts
from slam.motion._odometry_model_kernels import motion_cost
from slam.motion.odometry_model import motion_prior
from slam.sensor.rays import make_rays
from tests.slam.rooms import drive, empty_maps, rays, scan_at

STEP = (0.3, 0.0, 0.12)
CONFIG = FilterConfig()
BEAMS = make_beam_model(MatchConfig(), MapConfig())
PRIOR = motion_prior(STEP, MotionConfig())
JUMPS = st.tuples(st.floats(-0.7, 0.7), st.floats(-0.5, 0.5), st.floats(-1.1, 1.1))


def map_of_the_room(particles=1):
    maps = empty_maps(particles)
    for pose in drive(4):
        maps.integrate_scan(np.tile(pose, (particles, 1)), make_rays([scan_at(pose, beams=180)], usable_range=80.0))
    return maps


MAPS = map_of_the_room()


def hits_at(pose, beams=181):
    return np.ascontiguousarray(make_rays([scan_at(pose, beams=beams)], usable_range=80.0).ends)


def cost_of(evidence, predicted, pose):
    hits, beams, prior = evidence
    cost = np.empty(1)
    scan_costs(walls_of(MAPS.grids, 0), np.array([pose]), end_points(hits), beams, cost)
    return cost[0] + motion_cost(prior, predicted, *pose)


def matches_of(evidence, predicted, u=0.5, maps=MAPS):
    n = len(predicted)
    out, search = empty_matches(n), make_match_settings(np.array(STEP), evidence.hits, CONFIG)
    match_scan(maps, predicted, evidence, search, weights=np.full(n, 1.0 / n), u=np.broadcast_to(u, n), out=out)
    return out


@given(JUMPS)
@example((0.10132476415411074, 0.0, 0.10132476415411074))
@settings(max_examples=30, deadline=None)
def test_a_jump_of_which_the_odometry_says_nothing_is_found(jump):
    predicted = drive(4)[4]
    truth = se2.compose(predicted, jump)
    evidence = ScanAndPrior(hits_at(truth), BEAMS, PRIOR)
    found = matches_of(evidence, predicted[None]).optimum[0]
    away = se2.between(truth, found)
    is_near = math.hypot(away[0], away[1]) < 0.02 and abs(away[2]) < 0.02
    # the odometry draws a small jump back, by up to half a cell: then that pose must be likelier than the true one
    assert is_near or cost_of(evidence, predicted, found) <= cost_of(evidence, predicted, truth)
    assert math.hypot(away[0], away[1]) < 0.025


def test_without_jumps_in_the_model_the_search_stays_narrow():
    """The same jump is lost then: it is the wide search that finds it."""
    predicted = drive(4)[4]
    truth = se2.compose(predicted, (0.2, -0.3, 1.0))
    prior = motion_prior(STEP, MotionConfig(jump_share=0.0))
    found = matches_of(ScanAndPrior(hits_at(truth), BEAMS, prior), predicted[None]).optimum[0]
    assert abs(se2.between(truth, found)[2]) > 0.3


@given(JUMPS, st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_no_pose_far_away_is_likelier_where_the_search_is_narrow(jump, seed):
    """The bound `gain_of_jump`, against thousands of poses drawn from the jump's own density."""
    predicted = drive(4)[4]
    truth = se2.compose(predicted, 0.05 * np.array(jump))
    evidence = ScanAndPrior(hits_at(truth), BEAMS, PRIOR)
    matches = matches_of(evidence, predicted[None])
    if matches.jump_gain[0] > 0.0:
        return
    rng = np.random.default_rng(seed)
    poses = se2.compose(predicted, rng.normal(scale=PRIOR.precision[2] ** -0.5, size=(2000, 3)))
    assert min(cost_of(evidence, predicted, pose) for pose in poses) > matches.cost[0] - 1.0


def test_the_bound_cuts_off_no_start_that_leads_to_the_optimum():
    predicted = drive(4)[4]
    jump = np.array((0.33, -0.27, 0.71))
    evidence = ScanAndPrior(hits_at(se2.compose(predicted, jump)), BEAMS, PRIOR)
    lowest = cost_of(evidence, predicted, se2.compose(predicted, jump))
    bounded = wide_starts(MAPS, 0, predicted, evidence, max_cost=lowest + 20.0)
    every = wide_starts(MAPS, 0, predicted, evidence, max_cost=1e9)
    np.testing.assert_array_equal(bounded[0], every[0])
    np.testing.assert_array_less(np.abs(bounded[0] - jump), (0.15, 0.15, 0.1))
    assert len(wide_starts(MAPS, 0, predicted, evidence, max_cost=-1e9)) == 0


@given(st.floats(0.5, 60.0))
def test_steps_of_the_lattice_follow_the_range(reach):
    """No end point moves by more than a step from one heading to the next, until the headings get too many."""
    hits = np.column_stack([np.full(10, reach), np.zeros(10)])
    lattice = make_lattice(PRIOR, hits, 0.2)
    if len(lattice.turn) < 790:
        assert np.diff(lattice.turn).max() * reach <= 0.2 + 1e-9
    assert lattice.turn[-1] >= 2.5 * 0.5 - 1e-9
    np.testing.assert_allclose(lattice.turn, -lattice.turn[::-1])
    assert lattice.turn_cost.min() == lattice.along_cost.min() == lattice.across_cost.min() == 0.0


def square_room(side=4.0):
    """A map of a square room about the origin, and the end points of a scan from its middle."""
    maps, edge = empty_maps(2), np.arange(-0.5 * side, 0.5 * side, 0.02)
    across = np.full(len(edge), 0.5 * side + 0.017)
    walls = np.concatenate(
        [np.column_stack(pair) for pair in ((edge, across), (edge, -across), (across, edge), (-across, edge))]
    )
    for x in (-0.5, 0.0, 0.5):
        maps.integrate_scan(np.tile((x, 0.0, 0.0), (2, 1)), rays(walls - (x, 0.0)))
    return maps, np.ascontiguousarray(walls[::7])


def test_of_two_optima_of_like_value_each_is_drawn_with_its_share():
    """A square room seen from its middle, by a robot that turned by 45 degrees: to the left or to the right?"""
    maps, hits = square_room()
    prior = motion_prior((0.0, 0.0, 0.0), MotionConfig(jump_share=0.2, jump_rotation=0.5))
    predicted = np.tile((0.0, 0.0, 0.25 * math.pi), (2, 1))
    evidence = ScanAndPrior(hits, BEAMS, prior)
    left = matches_of(evidence, predicted, u=0.01, maps=maps)
    right = matches_of(evidence, predicted, u=0.99, maps=maps)
    turned = np.sort([left.optimum[0, 2], right.optimum[0, 2]])
    np.testing.assert_allclose(turned, (0.0, 0.5 * math.pi), atol=0.01)
    assert left.probability[0] == pytest.approx(0.5, abs=0.05)
    assert left.probability[0] + right.probability[0] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("threads", [1, 3])
def test_a_filter_survives_a_jump_the_same_with_any_number_of_threads(threads):
    odometry = drive(5)
    after = se2.compose(odometry[3], (0.1, 0.25, -0.9))  # pushed between the fourth scan and the fifth
    truth = [*odometry[:4], se2.compose(after, STEP), se2.compose(se2.compose(after, STEP), STEP)]
    config = FilterConfig(particles=5, gate=GateConfig(distance=0.0, angle=0.0))
    mapper, rng = GMapping(config, seed=1, threads=threads), np.random.default_rng(0)
    for reported, pose in zip(odometry, truth, strict=True):
        report = mapper.process(reported, scan_at(pose, beams=180, noise=0.01, rng=rng))
    away = se2.between(truth[-1], report.pose)
    assert math.hypot(away[0], away[1]) < 0.06  # a cell; 0.4 m where the jump was missed
    assert abs(away[2]) < 0.02
