# SPDX-License-Identifier: MIT
"""The wheels' speed: counters that fail for a while leave their trace, robots that stop and go leave none."""

import json

import numpy as np
import pytest

from slam.diagnosis.wheel_speed import MAX_ACCELERATION, MAX_SECONDS, WheelSpeed, wheel_news

PERIOD = 0.2
"""Time between two scans [s]."""
FAST = 0.45
"""Speed of the robot [m/s]."""


def drive(speed_at, seconds=20.0, *, noise=0.0):
    """Stamps (n,) [s] and odometry (n, 3) at the scans of a drive along a line with a speed that depends on time."""
    fine = np.arange(0.0, seconds, 0.001)
    way = np.concatenate([[0.0], np.cumsum([speed_at(time) for time in fine]) * 0.001])[:: round(PERIOD * 1000)]
    way += noise * np.random.default_rng(0).standard_normal(len(way))
    angle = 0.7
    odometry = np.stack([3.0 + np.cos(angle) * way, np.sin(angle) * way, np.full(len(way), angle)], axis=-1)
    return 100.0 + PERIOD * np.arange(len(way)), odometry


def news_of(stamps, odometry, every=1):
    return wheel_news(stamps, odometry, np.arange(0, len(stamps), every))


def stages(found):
    return {news.stage for news in found}


def fault(time, begin=5.0, seconds=3.0, speed=0.0):
    """Speed of wheels that count another speed for some seconds [m/s]."""
    return speed if begin <= time < begin + seconds else FAST


def stop_and_go(time, acceleration=MAX_ACCELERATION):
    """Speed of a robot that stands still from 5 to 8 s, and brakes and starts with its acceleration [m/s]."""
    return min(FAST, max(0.0, FAST - acceleration * (time - 5.0), acceleration * (time - 8.0)))


def test_an_even_drive_is_steady():
    assert stages(news_of(*drive(lambda time: FAST, noise=0.002))) == {"steady"}


@pytest.mark.parametrize("begin", [5.0, 5.05, 5.1, 5.17])
@pytest.mark.parametrize(("speed", "missing"), [(0.0, 3.0 * FAST), (-FAST, 6.0 * FAST)])
def test_counters_that_fail_for_a_while_are_noticed(begin, speed, missing):
    """Whether or not the fault begins at a scan; what they missed is known."""
    found = news_of(*drive(lambda time: fault(time, begin=begin, speed=speed)), every=4)
    assert [news.stage for news in found if news.stage == "back"] == ["back"]
    assert sum(news.missing for news in found) == pytest.approx(missing, abs=0.03)
    assert sum(news.missing for news in found if news.stage != "steady") == pytest.approx(missing, abs=0.03)


@pytest.mark.parametrize("acceleration", [0.3, 0.6, 1.0])
def test_a_robot_that_stops_and_goes_on_is_steady(acceleration):
    found = news_of(*drive(lambda time: stop_and_go(time, acceleration), noise=0.002))
    assert stages(found) == {"steady"}


def test_a_robot_that_stops_at_once_needs_time_to_start():
    found = news_of(*drive(lambda time: FAST if time < 5.0 else stop_and_go(max(time, 7.0))))
    assert stages(found) == {"steady", "changed", "kept"}


def test_a_speed_that_lasts_is_the_robots():
    """The wheels stand still for longer than a fault lasts, and start again at once."""
    found = news_of(*drive(lambda time: fault(time, seconds=MAX_SECONDS + 5.0), seconds=40.0))
    assert stages(found) == {"steady", "changed", "kept"}


def test_scans_far_apart_say_nothing():
    stamps, odometry = drive(fault)
    assert stages(news_of(stamps[::6], odometry[::6])) == {"steady"}


def test_a_watch_resumed_from_json_goes_on_alike():
    stamps, odometry = drive(lambda time: fault(time, speed=-FAST))
    whole = WheelSpeed()
    for k in range(len(stamps)):
        resumed = WheelSpeed()
        resumed.restore(json.loads(json.dumps(whole.state())))
        for wheels in (whole, resumed):
            wheels.update(stamps[k], odometry[k])
        assert resumed.news == whole.news
        assert json.loads(json.dumps(resumed.state())) == json.loads(json.dumps(whole.state()))
        if k % 5 == 0:
            whole.begin_step()
