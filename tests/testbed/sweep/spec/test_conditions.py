# SPDX-License-Identifier: MIT
"""The conditions of a sweep in words."""

from pathlib import Path

from testbed.sweep.spec.conditions import conditions
from testbed.sweep.spec.spec import parse_spec


def words(**document):
    return conditions(parse_spec({"particles": [1]} | document, "test", Path()))


def test_settings_of_all_runs_are_named_and_others_are_various():
    settings = {"odometry": {"grade": "poor"}, "duration": 60, "filter": {"gate": {"distance": 0.4}}, "route": "fixed"}
    assert words(worlds=["office"], settings=settings, axes={"lidar": ["lds01", "utm30lx"]}) == (
        "robot create3, lidar various, odometry poor, backend fast, filter update every 0.4 m or 0.1 rad, "
        "at most 60 s of each drive"
    )


def test_logs_have_no_simulated_robot():
    assert words(logs=[{"log": "a.log"}]) == "filter update every 0.15 m or 0.1 rad"
