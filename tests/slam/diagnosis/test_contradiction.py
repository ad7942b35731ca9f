# SPDX-License-Identifier: MIT
"""The sum of contradictions against its formula, and the verdicts that follow from it."""

import json

import numpy as np
import pytest

from slam.diagnosis.beam_check import BeamEvidence
from slam.diagnosis.contradiction import (
    ALLOWANCE,
    DOUBTFUL_SUM,
    LOST_SUM,
    PLAUSIBLE,
    ContradictionMonitor,
    ScanEvidence,
    is_jump,
    is_needless,
)
from slam.diagnosis.unheld_directions import Hold
from slam.diagnosis.wheel_speed import WheelNews

HELD = Hold((40.0, 0.0, 40.0), (0.0, 0.0), 4e-4, 0.0, WheelNews())
"""A scan that holds the estimate in all directions, and wheels that are right."""


def scan(contradicting, of=100, unknown=0, jump=None, hold=HELD):
    """Evidence of a scan of which so many beams contradict the map."""
    beams = BeamEvidence(of - contradicting, contradicting // 2, contradicting - contradicting // 2, unknown)
    return ScanEvidence(beams, None if jump is None else np.array(jump), hold)


def monitor_of(*scans):
    monitor = ContradictionMonitor()
    for k, evidence in enumerate(scans):
        monitor.update(10.0 + k, np.array([float(k), 0.0, 0.0]), evidence)
    return monitor


def test_the_sum_is_that_of_its_formula():
    rng = np.random.default_rng(0)
    scans = [
        scan(int(n), unknown=int(u)) for n, u in zip(rng.integers(0, 40, 50), rng.integers(0, 60, 50), strict=True)
    ]
    monitor, total, largest = ContradictionMonitor(), 0.0, 0.0
    for evidence in scans:
        beams = evidence.beams
        total = max(0.0, total + (beams.contradicting - ALLOWANCE * beams.judged) / (beams.judged + beams.unknown))
        largest = max(largest, total)
        monitor.update(0.0, np.zeros(3), evidence)
        assert monitor.total == pytest.approx(total, abs=1e-12)
        assert monitor.max_total == pytest.approx(largest, abs=1e-12)


def test_a_lively_place_adds_up_to_nothing():
    monitor = monitor_of(*[scan(10)] * 1000)
    assert monitor.overall == PLAUSIBLE
    assert monitor.max_total == 0.0


def test_few_wrong_beams_for_long_count_like_many_at_once():
    assert monitor_of(scan(72)).total == pytest.approx(monitor_of(*[scan(18)] * 10).total)


def test_a_scan_of_a_handful_of_beams_counts_for_less():
    assert monitor_of(scan(4, of=4)).total == pytest.approx(4 * (1.0 - ALLOWANCE) / 20)


def test_the_verdict_names_beginning_place_and_numbers():
    monitor = monitor_of(*[scan(0)] * 5, scan(30), scan(60), scan(0), *[scan(0)] * 20)
    assert monitor.overall.verdict == "lost"
    assert monitor.overall.stamp == 15.0
    assert monitor.overall.place == (5.0, 0.0, 0.0)
    assert monitor.overall.reason.startswith(
        "in 2 scans 45% of the beams contradict the map: 45 cross known walls, 45 "
    )


@pytest.mark.parametrize(("total", "verdict"), [(0.19, "plausible"), (0.21, "doubtful"), (0.51, "lost")])
def test_the_verdict_follows_from_the_sum(total, verdict):
    assert DOUBTFUL_SUM == 0.2
    assert LOST_SUM == 0.5
    assert monitor_of(scan(round(100 * (total + ALLOWANCE)))).overall.verdict == verdict


def one_sided(through, short):
    return ScanEvidence(BeamEvidence(100 - through - short, through, short, 0), None, HELD)


@pytest.mark.parametrize(("through", "short"), [(70, 0), (0, 70), (68, 2)])
def test_beams_that_contradict_in_one_way_only_may_be_a_changed_place(through, short):
    found = monitor_of(one_sided(through, short)).overall
    assert found.verdict == "doubtful"
    assert found.reason.endswith("nearly all of one kind, as where the place has changed")
    assert monitor_of(one_sided(60, 10)).overall.verdict == "lost"
    assert monitor_of(*[one_sided(through, short)] * 9).overall.verdict == "lost"  # a sum of more than 5


def test_a_loss_is_named_before_a_changed_place():
    quiet = [scan(0)] * 30
    monitor = monitor_of(*[one_sided(70, 0)] * 3, *quiet, scan(70), *quiet)
    assert monitor.overall.verdict == "lost"
    assert monitor.overall.stamp == 43.0
    assert monitor.max_total > 1.5


def test_the_present_verdict_comes_back_to_doubtful_and_no_further():
    verdicts = []
    monitor = ContradictionMonitor()
    for n in [0, 80, 0, 0, *[0] * 20]:
        monitor.update(0.0, np.zeros(3), scan(n))
        verdicts.append(monitor.present.verdict)
    assert verdicts[:3] == ["plausible", "lost", "lost"]
    assert set(verdicts[-10:]) == {"doubtful"}
    assert monitor.overall.verdict == "lost"


def test_a_needless_jump_makes_an_estimate_doubtful():
    monitor = monitor_of(scan(0), scan(0, jump=(1.2, 0.5, 0.1)), scan(0, jump=(9.0, 0.0, 0.0)))
    assert monitor.overall.verdict == "doubtful"
    assert monitor.overall.stamp == 11.0
    assert "jumps by 1.30 m and 6 degrees" in monitor.overall.reason


def test_a_lost_stretch_is_the_reason_before_a_jump():
    monitor = monitor_of(scan(0, jump=(1.0, 0.0, 0.0)), scan(80))
    assert monitor.overall.verdict == "lost"
    assert monitor.overall.stamp == 11.0


def test_a_drive_without_sight_rests_on_the_wheels():
    """One metre per scan: scans 3 to 7 see three beams each."""
    monitor = monitor_of(scan(0), scan(0), scan(0), *[scan(0, of=3, unknown=80)] * 5, scan(0))
    assert monitor.overall.verdict == "doubtful"
    assert (monitor.overall.stamp, monitor.overall.place) == (13.0, (3.0, 0.0, 0.0))
    assert "over 5.0 m fewer than 10 beams" in monitor.overall.reason


def test_a_short_time_without_sight_is_none():
    monitor = monitor_of(scan(0), *[scan(0, of=3), scan(0, of=3), scan(0, of=60, unknown=30)] * 20)
    assert monitor.overall == PLAUSIBLE


def along_a_wall(missing=0.0, stage="steady"):
    """A scan that one wall holds across the way, and wheels of which so many metres may be missing."""
    return scan(0, hold=HELD._replace(normals=(0.1, 0.0, 40.0), news=WheelNews(stage, missing)))


def test_a_long_way_by_the_wheels_alone_is_doubtful():
    """One metre per scan: scans 2 to 301 see one wall along the way; the wheels err by 2 cm in each."""
    assert monitor_of(scan(0), scan(0), *[along_a_wall()] * 100).overall == PLAUSIBLE
    found = monitor_of(scan(0), scan(0), *[along_a_wall()] * 300, scan(0)).overall
    assert (found.verdict, found.stamp, found.place) == ("doubtful", 11.0, (1.0, 0.0, 0.0))
    assert found.reason == (
        "for 300.0 s nothing but the wheels told how far the robot drove in one direction, 300.0 m of way: "
        "up to 0.6 m may be missing"
    )


def test_a_missing_way_is_lost_until_the_walls_are_met_again():
    steps = [scan(0), along_a_wall(2.0, "changed"), along_a_wall(2.0, "back"), along_a_wall()]
    monitor = monitor_of(*steps)
    assert monitor.overall.verdict == monitor.present.verdict == "lost"
    assert (monitor.overall.stamp, monitor.overall.place) == (10.0, (0.0, 0.0, 0.0))
    assert monitor.overall.reason.startswith("for 2.0 s the wheels counted less or backward at once")
    assert monitor.overall.reason.endswith("4.0 m are missing")
    monitor = monitor_of(*steps, scan(0))
    assert (monitor.overall.verdict, monitor.present.verdict) == ("lost", "doubtful")


def test_a_loss_is_named_before_what_is_doubtful():
    jump = scan(0, jump=(1.0, 0.0, 0.0))
    found = monitor_of(jump, along_a_wall(2.0, "changed"), along_a_wall(2.0, "back")).overall
    assert (found.verdict, found.stamp) == ("lost", 10.0)


def test_what_a_jump_is():
    assert not is_jump(np.array([0.3, 0.2, -0.1]))
    assert is_jump(np.array([0.4, -0.4, 0.0]))
    assert is_jump(np.array([0.0, 0.0, -0.4]))


def test_a_jump_is_needless_where_the_map_did_not_contradict():
    assert is_needless(BeamEvidence(10, 0, 2, 88))
    assert not is_needless(BeamEvidence(50, 30, 20, 0))


def test_a_monitor_resumed_from_json_goes_on_alike():
    scans = [scan(0, of=2), *(scan(n) for n in (0, 30)), scan(0, of=2), *(scan(n) for n in (40, 0, 50, 0))]
    scans += [scan(0, jump=(1.0, 0.0, 0.0)), along_a_wall(), along_a_wall(2.0, "back")]
    whole, resumed = monitor_of(*scans), ContradictionMonitor()
    resumed.restore(json.loads(json.dumps(monitor_of(*scans[:4]).state())))
    for k, evidence in enumerate(scans[4:], start=4):
        resumed.update(10.0 + k, np.array([float(k), 0.0, 0.0]), evidence)
    assert resumed.overall == whole.overall
    assert resumed.present == whole.present
    assert resumed.state() == whole.state()
