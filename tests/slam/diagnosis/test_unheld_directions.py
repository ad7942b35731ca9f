# SPDX-License-Identifier: MIT
"""Directions that no wall holds: a bare corridor has one, a room none; there the possible error grows as wheels err."""

import json
from dataclasses import replace

import numpy as np
import pytest

from slam import FilterConfig, GMapping, se2
from slam.diagnosis.beam_check import check_scan
from slam.diagnosis.path_check import check_path
from slam.diagnosis.unheld_directions import MAX_ERROR_M, MODEL_STEPS, Hold, UnheldDirections
from slam.diagnosis.wheel_speed import WheelNews, wheel_news
from slam.sensor.rays import make_rays
from tests.slam.rooms import WALLS, empty_maps, scan_at

ANGLE = 0.4
ALONG, ACROSS = np.array([np.cos(ANGLE), np.sin(ANGLE)]), np.array([-np.sin(ANGLE), np.cos(ANGLE)])
CORRIDOR = np.array([[*(-60.0 * ALONG + side * ACROSS), *(60.0 * ALONG + side * ACROSS)] for side in (1.0, -1.0)])
"""Two bare walls 2 m apart, parallel to no axis, far longer than the lidar reaches."""
SIGMA = 0.02
"""Standard deviation of the wheels in a step by the motion model [m]."""
STEADY = WheelNews()
NOTHING, EVERYWHERE = (0.0, 0.0, 0.0), (40.0, 0.0, 40.0)


def wall(normal):
    """What 40 beams to a wall of this normal hold."""
    x, y = normal.tolist()
    return 40.0 * x * x, 40.0 * x * y, 40.0 * y * y


ONE_WALL = wall(ACROSS)


def scans_along(poses, walls):
    rng = np.random.default_rng(5)
    return [make_rays([scan_at(pose, beams=180, noise=0.01, rng=rng, walls=walls)], usable_range=8.0) for pose in poses]


def hold(normals, innovation=(0.0, 0.0), news=STEADY):
    return Hold(normals, tuple(innovation), SIGMA**2, ANGLE, news)


def directions_of(*steps, metres=0.2):
    """After steps of so many metres along the corridor, one in each half second from 10 s on."""
    found = UnheldDirections()
    for k, step in enumerate(steps):
        found.update(10.0 + 0.5 * k, (k * metres * ALONG[0], k * metres * ALONG[1], ANGLE), step)
    return found


def test_the_normals_of_a_scan_are_those_of_its_walls():
    """Between two bare walls nothing holds the robot along them; in a room every direction is held."""
    poses = np.array([[*(way * ALONG), ANGLE] for way in np.arange(0.0, 2.0, 0.2)])
    for walls, held in ((CORRIDOR, False), (WALLS, True)):
        maps = empty_maps()
        scans = scans_along(poses * (0.2, 0.2, 1.0) if held else poses, walls)
        for pose, scan in zip(poses * (0.2, 0.2, 1.0) if held else poses, scans, strict=True):
            maps.integrate_scan(pose[None], scan)
        beams, normals = check_scan(maps, 0, poses[0], scans[0])
        values, axes = np.linalg.eigh([normals[:2], normals[1:]])
        assert beams.met > 60
        assert (values[0] > 10.0) == held
        if not held:
            assert values[0] < 1.0
            assert abs(axes[:, 0] @ ALONG) > 0.995


def stuck_wheels(stamps):
    """Odometry (n, 3) along the corridor at 0.5 m/s, but for three seconds from 10 s on, in which it stands still."""
    way = 0.5 * stamps - 0.5 * np.clip(stamps - 10.0, 0.0, 3.0)
    return np.stack([way * ALONG[0], way * ALONG[1], np.full(len(way), ANGLE)], axis=-1)


def test_the_filter_says_so_while_it_drives():
    """Live, and also one that goes on from the state of another in the middle of the fault."""
    stamps, rng, verdicts = np.arange(0.0, 20.0, 0.2), np.random.default_rng(5), []
    odometry = stuck_wheels(stamps)
    mapper = GMapping(FilterConfig(particles=3), seed=0, threads=1)
    for k, (stamp, pose) in enumerate(zip(stamps, odometry, strict=True)):
        if k == 58:
            state = mapper.state()
            mapper = GMapping(FilterConfig(particles=3), seed=0, threads=1)
            mapper.restore(*state)
        scan = scan_at(pose, beams=360, stamp=stamp, noise=0.01, rng=rng, walls=CORRIDOR)
        verdicts.append(mapper.process(pose, replace(scan, range_max=4.0)).self_check.verdict)
    assert set(verdicts[:64]) == {"plausible"}
    assert set(verdicts[70:]) == {"lost"}
    assert mapper.self_check.stamp == pytest.approx(9.8, abs=0.3)
    assert mapper.self_check.reason.endswith("1.5 m are missing")


@pytest.mark.parametrize("fault", [True, False])
def test_a_path_along_a_bare_corridor_whose_wheels_stand_still_lacks_a_way(fault):
    """The robot drives on at 0.5 m/s, the wheels stand still for three seconds, and all scans agree with them."""
    stamps = np.arange(0.0, 30.0, 0.2)
    poses = stuck_wheels(stamps) if fault else se2.compose((0.0, 0.0, ANGLE), np.outer(stamps, (0.5, 0.0, 0.0)))
    scans = scans_along(poses, CORRIDOR)
    news = wheel_news(stamps, poses, np.arange(len(stamps)))
    monitor = check_path(stamps, poses, poses, scans, news, FilterConfig())
    assert monitor.max_total < 0.1
    if not fault:
        assert monitor.overall.verdict == "plausible"
        return
    assert monitor.overall.verdict == "lost"
    assert monitor.overall.stamp == pytest.approx(9.8, abs=0.3)
    assert monitor.overall.reason.endswith("1.5 m are missing")
    np.testing.assert_allclose(monitor.overall.place[:2], 5.0 * ALONG, atol=0.2)


@pytest.mark.parametrize("factor", [0.2, 1.0, 4.0])
def test_the_possible_error_is_that_of_the_wheels_as_the_run_has_shown_it(factor):
    """400 held steps with innovations of known size, then 100 steps without a hold along the corridor.

    The wheels' true deviations there stay below the possible error in about 95 % of all drives; good wheels' in more,
    since the motion model goes on to count.
    """
    rng, errors, possible = np.random.default_rng(1), [], []
    for _ in range(100):
        shown = [hold(EVERYWHERE, step) for step in rng.normal(scale=factor * SIGMA, size=(400, 2))]
        stretch, error = directions_of(*shown, *[hold(ONE_WALL)] * 100).worst
        assert stretch.metres == pytest.approx(20.0)
        assert stretch.seconds == pytest.approx(50.0)
        errors.append(abs(rng.normal(scale=factor * SIGMA, size=100).sum()))
        possible.append(error)
    prior = MODEL_STEPS / (400.0 + MODEL_STEPS)
    expected = 2.0 * 10.0 * SIGMA * np.sqrt(prior + factor**2 * (1.0 - prior))
    assert np.mean(possible) == pytest.approx(expected, rel=0.03)
    covered = np.mean(np.array(errors) < possible)
    assert covered >= 0.88
    assert covered <= 0.99 or factor < 1.0


def test_the_possible_error_grows_with_the_square_root_of_the_steps():
    sigmas = [np.sqrt(directions_of(*[hold(ONE_WALL)] * count).worst[0].variance) for count in (25, 100, 400)]
    np.testing.assert_allclose(sigmas, SIGMA * np.array([5.0, 10.0, 20.0]), rtol=1e-9)


def test_what_is_met_again_is_held_again():
    held, free = hold(EVERYWHERE), hold(ONE_WALL)
    assert directions_of(*[held] * 50).worst is None
    assert directions_of(*[free] * 30, held, *[free] * 50, held, *[free] * 20).worst[0].variance == pytest.approx(
        50 * SIGMA**2
    )


def test_a_wall_across_holds_what_a_wall_along_does_not():
    """The two walls are met by turns: neither direction goes without a hold for long."""
    along, across = hold(ONE_WALL), hold(wall(ALONG))
    assert directions_of(*[along, across] * 50).worst[0].variance == pytest.approx(SIGMA**2)
    assert directions_of(*[hold(NOTHING)] * 50).worst[0].variance == pytest.approx(50 * SIGMA**2)


def test_good_wheels_may_drive_on_where_bad_ones_are_doubted():
    stretch = [hold(ONE_WALL)] * 100
    good = directions_of(*[hold(EVERYWHERE, 0.2 * SIGMA * ALONG)] * 100, *stretch).worst[1]
    bad = directions_of(*[hold(EVERYWHERE, 10.0 * SIGMA * ALONG)] * 5, *stretch).worst[1]
    assert good < MAX_ERROR_M < bad


def test_an_estimate_that_leaves_the_wheels_was_held_by_something():
    """Also where no wall with a direction was met: such a step shows how far the wheels err, a small one does not."""
    assert directions_of(*[hold(ONE_WALL, 2.9 * SIGMA * ALONG)] * 10).rate == pytest.approx(1.0)
    rate = directions_of(*[hold(ONE_WALL, 5.0 * SIGMA * ALONG)] * 10).rate
    assert rate == pytest.approx((MODEL_STEPS + 250.0) / (MODEL_STEPS + 10.0))
    assert directions_of(*[hold(EVERYWHERE, 5.0 * SIGMA * ACROSS)] * 10).rate < 1.0


def changed(normals, missing, innovation=(0.0, 0.0), stage="changed"):
    return hold(normals, innovation, WheelNews(stage, missing))


def test_a_way_is_missing_only_in_a_direction_that_is_not_held():
    free = [changed(ONE_WALL, 0.4), changed(ONE_WALL, 0.4), changed(ONE_WALL, 0.4, stage="back")]
    found = directions_of(hold(EVERYWHERE), *free)
    assert found.missing.metres == pytest.approx(1.2)
    assert found.missing.seconds == pytest.approx(1.5)
    assert found.still_missing
    assert directions_of(*free, hold(EVERYWHERE)).missing == directions_of(*free).missing
    assert not directions_of(*free, hold(EVERYWHERE)).still_missing
    assert directions_of(*free[:2], changed(EVERYWHERE, 0.4, stage="back")).missing is None
    across = wall(ALONG)
    assert directions_of(*[changed(across, 0.4)] * 2, changed(across, 0.4, stage="back")).missing is None


def test_what_the_estimate_made_up_for_is_not_missing():
    steps = [changed(ONE_WALL, 0.4, 0.3 * ALONG)] * 4
    assert directions_of(*steps, changed(ONE_WALL, 0.0, stage="back")).missing is None
    assert directions_of(*steps, *steps, changed(ONE_WALL, 0.0, stage="back")).missing.metres == pytest.approx(0.8)


@pytest.mark.parametrize("stage", ["changed", "kept"])
def test_a_change_that_does_not_end_at_once_is_the_robots(stage):
    assert directions_of(changed(ONE_WALL, 0.6), changed(ONE_WALL, 0.6, stage=stage)).missing is None


def test_a_robot_that_was_seen_to_drive_so_is_believed():
    """It stops and starts at once where the walls hold it, and the scans agree with the wheels."""
    seen = [changed(EVERYWHERE, 0.6), changed(EVERYWHERE, 0.6, stage="back")]
    caught = [changed(EVERYWHERE, 0.6, 0.6 * ALONG), changed(EVERYWHERE, 0.6, 0.6 * ALONG, stage="back")]
    free = [changed(ONE_WALL, 0.6), changed(ONE_WALL, 0.6, stage="back")]
    assert directions_of(*seen, *free).missing is None
    assert directions_of(*free, *seen).missing is None
    assert directions_of(*caught, *free).missing.metres == pytest.approx(1.2)
    hardly = [step._replace(normals=(5.0, 0.0, 5.0)) for step in seen]
    assert directions_of(*hardly, *free).missing.metres == pytest.approx(1.2)


def test_one_resumed_from_json_goes_on_alike():
    steps = [hold(EVERYWHERE, 0.05 * ALONG), hold(ONE_WALL), changed(ONE_WALL, 0.6), changed(ONE_WALL, 0.6)]
    steps += [changed(ONE_WALL, 0.6, stage="back"), hold(ONE_WALL), changed(EVERYWHERE, 0.5), hold(EVERYWHERE)]
    whole = UnheldDirections()
    for k, step in enumerate(steps):
        resumed = UnheldDirections()
        resumed.restore(json.loads(json.dumps(whole.state())))
        for found in (whole, resumed):
            found.update(float(k), tuple(se2.compose((k * 0.2, 0.0, 0.0), (0.0, 0.0, ANGLE)).tolist()), step)
        assert resumed.state() == whole.state()
        assert (resumed.worst, resumed.missing, resumed.rate) == (whole.worst, whole.missing, whole.rate)
