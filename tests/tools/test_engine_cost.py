# SPDX-License-Identifier: MIT
"""The cost of an update is that of the updates of the run, per particle, and its stages make up most of it."""

from testbed.frame import Frame
from tests.slam.rooms import drive, scan_at
from tools.measure.engine_cost import CPP_US, Cost, cost_of, row


def test_costs_are_per_update_and_particle():
    frames = [Frame(stamp=0.0, odometry=pose, scan=scan_at(pose, beams=60)) for pose in drive(6)]
    cost_of(frames, 2, 1)  # kernels are loaded
    few, many = (cost_of(frames, particles, 1) for particles in (4, 40))
    assert few.updates == many.updates == len(frames)
    assert few.beams == 60
    assert many.us < few.us  # what is the same for all particles is shared by more
    assert 0.3 < sum(many.stages.values()) < 1.0


def test_a_line_of_the_table_compares_with_the_other_program():
    one = Cost(
        updates=10, beams=180, us=200.0, wall=3.0, stages={"match": 0.5, "map": 0.2, "resample": 0.1}, map_mb=0.9
    )
    two = Cost(updates=10, beams=180, us=210.0, wall=2.0, stages=one.stages, map_mb=0.9)
    cells = [cell.strip() for cell in row("intel", one, two).split("|")[1:-1]]
    assert cells[:8] == ["intel", "180", "10", "200", "50%", "20%", "10%", "20%"]
    assert cells[8:10] == ["1.50", "0.90"]
    assert cells[10] == f"{CPP_US['intel']}, 20 times"
    assert row("office", one, two).count("|") == row("intel", one, two).count("|")
