# SPDX-License-Identifier: MIT
"""What cannot be used is refused or passed over; nothing ever becomes NaN."""

import math

import numpy as np
import pytest

from slam import FilterConfig, GMapping, Scan
from slam.config import (
    GateConfig,
    MapConfig,
    MatchConfig,
    MotionConfig,
    ProposalConfig,
    ResampleConfig,
)
from tests.slam.rooms import counts_of, drive, scan_at

KINDS = ["improved", "scan-match", "motion"]


def config(kind="improved", **changes):
    return FilterConfig(
        **(
            {
                "particles": 4,
                "map": MapConfig(cell=0.05, field_radius=0.4),
                "match": MatchConfig(weight_share=1.0),
                "proposal": ProposalConfig(kind=kind),
                "gate": GateConfig(distance=0.1, angle=0.1),
            }
            | changes
        )
    )


def blind(**changes):
    """A scan of which no reading can be used."""
    ranges = np.array([math.nan, math.inf, -1.0, 0.0, 30.0, -math.inf])
    return Scan(**({"ranges": ranges, "angles": np.linspace(-1.0, 1.0, 6), "range_max": 20.0} | changes))


def assert_sound(mapper, *reports):
    """Weights are weights, poses and covariances are numbers, and walls are where they can be."""
    assert mapper.weights.sum() == pytest.approx(1.0)
    assert np.all(np.isfinite(mapper.poses))
    assert np.all(np.isfinite(mapper.path()))
    assert len(mapper.path()) == len(mapper.update_scans)
    for report in reports:
        assert np.all(np.isfinite(report.pose))
        assert np.all(np.isfinite(report.covariance))
        assert 1.0 - 1e-9 <= report.ess <= mapper.config.particles + 1e-9
        assert 0.0 <= report.matched_share <= 1.0
        assert not math.isnan(report.log_evidence)


def started(settings, steps=3):
    mapper = GMapping(settings, threads=1)
    for pose in drive(steps):
        mapper.process(pose, scan_at(pose))
    return mapper


@pytest.mark.parametrize("kind", KINDS)
def test_a_scan_that_saw_nothing_is_passed_over(kind):
    mapper = started(config(kind))
    before = mapper.path()
    ahead = drive(4)[4]
    report = mapper.process(ahead, blind())
    assert not report.updated
    np.testing.assert_array_equal(mapper.path(), before)
    after = mapper.process(ahead, scan_at(ahead))
    assert after.updated
    np.testing.assert_allclose(after.pose, ahead, atol=0.1)
    assert_sound(mapper, report, after)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scan", [blind(), Scan(ranges=np.empty(0), angles=np.empty(0), range_max=20.0)])
def test_a_first_scan_that_saw_nothing_starts_an_empty_map(kind, scan):
    mapper = GMapping(config(kind), threads=1)
    first = mapper.process(np.zeros(3), scan)
    assert first.updated
    with pytest.raises(ValueError, match="the map is empty"):
        mapper.map()
    reports = [mapper.process(pose, scan_at(pose)) for pose in drive(3)[1:]]
    assert reports[0].match_failures == (0 if kind == "motion" else 4)
    assert_sound(mapper, first, *reports)
    assert mapper.map().occupied.sum() > 20


def test_clearing_beams_alone_are_passed_over_too():
    """Free space without a hit would update the map, but from poses that nothing corrects."""
    mapper = started(config(map=MapConfig(cell=0.05, field_radius=0.4, free_range=5.0)))
    assert not mapper.process((2.0, 0.0, 0.0), blind()).updated


@pytest.mark.parametrize("kind", KINDS)
def test_a_jump_of_ten_metres(kind):
    mapper = started(config(kind))
    here = drive(3)[-1]
    jumped = here + np.array([[10.0 + 0.2 * k, 0.0, 0.0] for k in range(4)])
    reports = [mapper.process(odometry, scan_at(here)) for odometry in jumped]
    assert_sound(mapper, *reports)
    assert mapper.map().probability.size < 2000 * 2000


@pytest.mark.parametrize("jump", [1e5, 1e9, 1e19, 1e300])
def test_a_jump_beyond_all_maps_is_refused_and_leaves_the_filter_as_it_was(jump):
    mapper = started(config())
    path, weights, poses = mapper.path(), mapper.weights, mapper.poses
    visits = counts_of(mapper.maps)[1]
    with pytest.raises(ValueError, match=r"the map would span .* is there a jump in the odometry"):
        mapper.process((jump, 0.0, 0.0), scan_at(np.zeros(3)))
    np.testing.assert_array_equal(mapper.path(), path)
    np.testing.assert_array_equal(mapper.weights, weights)
    np.testing.assert_array_equal(mapper.poses, poses)
    np.testing.assert_array_equal(counts_of(mapper.maps)[1], visits)
    ahead = drive(4)[4]
    report = mapper.process(ahead, scan_at(ahead))
    np.testing.assert_allclose(report.pose, ahead, atol=0.1)
    assert_sound(mapper, report)


@pytest.mark.parametrize("reading", [1e6, 1e18, 1e300])
def test_a_reading_beyond_all_maps_is_refused(reading):
    settings = config(map=MapConfig(cell=0.05, field_radius=0.4, usable_range=math.inf))
    mapper = GMapping(settings, threads=1)
    scan = Scan(ranges=np.array([1.0, reading]), angles=np.array([0.0, 1.0]), range_max=math.inf)
    with pytest.raises(ValueError, match="a reading beyond all range"):
        mapper.process(np.zeros(3), scan)
    assert mapper.process(np.zeros(3), scan_at(np.zeros(3))).updated


@pytest.mark.parametrize(
    "odometry", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0, -math.inf), (0.0, 0.0), ((0.0, 0.0, 0.0),)]
)
def test_odometry_that_is_no_pose_is_refused(odometry):
    mapper = started(config())
    with pytest.raises(ValueError, match="odometry must be three finite numbers"):
        mapper.process(odometry, scan_at(np.zeros(3)))
    assert_sound(mapper)


def test_velocity_that_is_no_number_is_refused():
    scan = scan_at(np.zeros(3))
    timed = Scan(ranges=scan.ranges, angles=scan.angles, range_max=20.0, time_offsets=np.linspace(0.0, 0.1, 60))
    with pytest.raises(ValueError, match="twist must be three finite numbers"):
        started(config()).process((2.0, 0.0, 0.0), timed, twist=(math.nan, 0.0, 0.0))


def test_beams_of_unknown_time_are_left_out():
    here = drive(4)[4]
    scan, offsets = scan_at(here), np.linspace(0.0, 0.1, 60)
    offsets[7:20] = math.nan
    timed = Scan(ranges=scan.ranges, angles=scan.angles, range_max=20.0, mount=scan.mount, time_offsets=offsets)
    mapper = started(config())
    report = mapper.process(here, timed, twist=(0.0, 0.0, 0.0))
    assert_sound(mapper, report)
    np.testing.assert_allclose(report.pose, here, atol=0.1)


@pytest.mark.parametrize("kind", KINDS)
def test_weights_that_underflow(kind):
    """A likelihood so sharp that every factor is far below the smallest float."""
    sharp = MatchConfig(hit_sigma=0.002, beam_weight=5.0, outlier_distance=0.3, weight_share=1.0)
    mapper = GMapping(config(kind, match=sharp, resample=ResampleConfig(when="never")), threads=1)
    reports = []
    for k, pose in enumerate(drive(10)):
        scan = scan_at(pose, noise=0.1, rng=np.random.default_rng(k))
        reports.append(mapper.process(pose, scan))
    assert min(report.log_evidence for report in reports) < -800.0  # exp of it is 0
    assert_sound(mapper, *reports)


@pytest.mark.parametrize("kind", ["improved", "scan-match"])
def test_all_particles_fail_to_match(kind):
    """Another room at every scan: the motion model goes on alone, and its spread grows."""
    settings = config(kind, particles=20, match=MatchConfig(min_matched_share=1.0, weight_share=0.0))
    mapper = GMapping(settings, threads=1)
    reports = []
    for k in range(8):
        ranges = np.random.default_rng(k).uniform(1.0, 6.0, 60)
        scan = Scan(ranges=ranges, angles=np.linspace(-3.0, 3.0, 60), range_max=20.0)
        reports.append(mapper.process((0.3 * k, 0.0, 0.0), scan))
    assert all(report.match_failures == 20 for report in reports[1:])
    assert_sound(mapper, *reports)
    assert np.trace(reports[-1].covariance) > np.trace(reports[1].covariance)


def stand_still(seconds, settings, period=0.036):
    mapper = GMapping(settings, threads=1)
    scan = scan_at(np.zeros(3))
    updates = 0
    for k in range(round(seconds / period)):
        stamped = Scan(ranges=scan.ranges, angles=scan.angles, range_max=20.0, mount=scan.mount, stamp=period * k)
        report = mapper.process(np.zeros(3), stamped)
        updates += report.updated
    return mapper, report, updates


@pytest.mark.parametrize("seconds", [36.0, pytest.param(3600.0, marks=pytest.mark.slow)])
def test_standing_still_below_the_gates_changes_nothing(seconds):
    mapper, report, updates = stand_still(seconds, config())
    assert updates == 1
    np.testing.assert_array_equal(report.pose, np.zeros(3))
    assert len(mapper.path()) == 1
    assert counts_of(mapper.maps)[1].max() <= 60
    assert_sound(mapper, report)


@pytest.mark.parametrize("seconds", [1200.0, pytest.param(3600.0, marks=pytest.mark.slow)])
def test_standing_still_with_updates_by_time(seconds):
    """Counts are halved where they are full, the map holds the pose to two cells or three, and does not grow."""
    gate = GateConfig(distance=0.1, angle=0.1, seconds=1.0)
    mapper, report, updates = stand_still(seconds, config(particles=2, gate=gate), period=1.0)
    assert updates == round(seconds)
    assert_sound(mapper, report)
    np.testing.assert_allclose(report.pose, np.zeros(3), atol=0.15)
    hits, visits, walls = counts_of(mapper.maps)
    assert np.all(hits <= visits)
    assert walls.sum() > 20
    assert mapper.maps.bytes_in_use < 2_000_000


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: FilterConfig(particles=0), "particles must be at least 1, got 0"),
        (lambda: MotionConfig(translation_from_translation=-0.1), "translation_from_translation"),
        (lambda: MotionConfig(floor_rotation=0.0), "floor_rotation must be positive"),
        (lambda: MotionConfig(failure_share=1.0), "failure_share"),
        (lambda: MapConfig(cell=-0.05), "cell must be positive"),
        (lambda: MapConfig(cell=math.nan), "cell must be positive"),
        (lambda: MatchConfig(hit_sigma=0.0), "hit_sigma must be positive"),
        (lambda: MatchConfig(iterations=0), "iterations must be at least 1"),
        (lambda: ProposalConfig(samples=0), "samples must be at least 1"),
        (lambda: ProposalConfig(kind="best"), "improved, scan-match, motion, got 'best'"),
        (lambda: ResampleConfig(when="sometimes"), "ess, always, never, got 'sometimes'"),
        (lambda: ResampleConfig(scheme="fair"), "systematic, stratified, residual, multinomial, got 'fair'"),
        (lambda: GateConfig(seconds=-1.0), "seconds must be at least 0"),
        (lambda: GMapping(FilterConfig(map=MapConfig(cell=0.05, field_radius=4.0))), "field_radius must be 1 to 63"),
        (lambda: GMapping(FilterConfig(map=MapConfig(cell=0.05, field_radius=0.02))), "field_radius must be 1 to 63"),
        (lambda: GMapping(threads=0), "threads must be at least 1, got 0"),
    ],
)
def test_settings_that_cannot_be_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
