# SPDX-License-Identifier: MIT
"""Messages of the console: a long job is not silent, a short one is."""

import worlds
from testbed.cli.shared.console import SlowProgress, announce_world


def test_a_long_job_prints_its_share_and_a_short_one_nothing(capsys):
    slow, quick = SlowProgress("planning a tour", every=0.0), SlowProgress("planning a tour", every=60.0)
    for share in (0.25, 1.0):
        slow(share)
        quick(share)
    assert capsys.readouterr().err.splitlines() == ["planning a tour: 25%", "planning a tour: 100%"]


def test_a_world_in_centimetres_is_questioned(capsys):
    wall = worlds.Wall(points=[(0.0, 0.0), (800.0, 0.0), (800.0, 600.0), (0.0, 600.0)], closed=True, thickness=10.0)
    announce_world(worlds.World(name="hall", start=worlds.Start(x=400.0, y=300.0), walls=[wall]))
    announce_world(worlds.load("office"))
    (line,) = capsys.readouterr().err.splitlines()
    assert "is it in centimetres?" in line
