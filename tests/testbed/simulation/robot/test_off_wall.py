# SPDX-License-Identifier: MIT
"""Beams of a recorded drive are seen again: from the same place exactly, from beside it where their ends are."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from testbed.simulation import simulate
from testbed.simulation.drivers.driver import Command
from testbed.simulation.drivers.recorded import RecordedDriver
from testbed.simulation.physics.backend import Hits
from testbed.simulation.robot.off_wall import OffWallBeams
from tests.testbed.simulation.small_worlds import perfect, room

STEP = np.radians(1.0)
DIRECTIONS = STEP * np.arange(-90, 91)


def beams(rows):
    """Beams of rows (stamp, x, y, direction, range)."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return OffWallBeams(stamps=table[:, 0], origins=table[:, 1:3], directions=table[:, 3], ranges=table[:, 4])


def seen(recorded, stamp=1.0, x=0.0, y=0.0):
    """What is seen of them from (x, y) where the walls are 10 m away: distances [m], (181,)."""
    walls = Hits(np.full(DIRECTIONS.size, 10.0), np.full(DIRECTIONS.size, 0.5))
    found = recorded.over(walls, stamp, np.tile([x, y], (DIRECTIONS.size, 1)), DIRECTIONS)
    assert (walls.distances == 10.0).all()
    assert (found.cos_incidence == np.where(found.distances == 10.0, 0.5, 1.0)).all()
    return found.distances


@given(
    st.lists(
        st.tuples(st.integers(0, 180), st.sampled_from([0.5, 3.0, 12.0, np.inf, np.nan])), unique_by=lambda t: t[0]
    )
)
def test_from_the_same_place_each_beam_ends_where_it_did(rows):
    expected = np.full(DIRECTIONS.size, 10.0)
    for number, distance in rows:
        expected[number] = distance
    found = seen(beams([(1.0, 0.0, 0.0, DIRECTIONS[number], distance) for number, distance in rows]))
    assert np.allclose(found, expected, rtol=0, atol=1e-12, equal_nan=True)


def test_from_beside_it_the_same_point_is_seen_in_another_beam():
    """A point 2 m ahead is 1 m to the left of a lidar that stands 1 m to the right: at 26.6 degrees, 2.24 m away."""
    found = seen(beams([(1.0, 0.0, 0.0, 0.0, 2.0)]), y=-1.0)
    assert np.flatnonzero(found != 10.0).tolist() == [90 + 27]
    assert found[117] == pytest.approx(np.sqrt(5.0))


def test_a_beam_without_an_end_keeps_its_direction():
    found = seen(beams([(1.0, 0.0, 0.0, 0.0, np.inf), (1.0, 0.0, 0.0, STEP, np.nan)]), y=-1.0)
    assert np.isinf(found[90])
    assert np.isnan(found[91])


@pytest.mark.parametrize("order", [(2.0, 5.0, np.inf, np.nan), (np.nan, np.inf, 5.0, 2.0)])
def test_the_nearest_of_several_in_one_beam_is_seen(order):
    assert seen(beams([(1.0, 0.0, 0.0, 0.0, distance) for distance in order]))[90] == 2.0


def test_scans_of_other_times_and_beams_out_of_view_are_as_they_were():
    recorded = beams([(1.0, 0.0, 0.0, 0.0, 2.0), (1.0, 0.0, 0.0, np.pi, 2.0)])
    assert np.count_nonzero(seen(recorded) != 10.0) == 1
    assert (seen(recorded, stamp=1.1) == 10.0).all()


def test_the_main_lidar_of_a_drive_sees_them():
    """A point 2 m ahead of a robot that stands, in the scan of 1 s only; the walls are 5 m away."""
    config = perfect(backend="fast")
    config = dataclasses.replace(config, lidar=config.lidar.model_copy(update={"beams": 360, "scan_rate": 10.0}))
    lidar_x = config.robot.lidar_mount.x
    recorded = beams([(1.0, lidar_x, 0.0, 0.0, 2.0)])
    driver = [Command(0.0, 0.0, 0.0), Command(1.5, 0.0, 0.0)]

    def scans(off_wall):
        with simulate(room(), dataclasses.replace(config, off_wall=off_wall), RecordedDriver(driver, 0.05)) as drive:
            return {round(frame.stamp, 3): frame.scan for frame in drive if frame.scan is not None}

    without, with_it = scans(None), scans(recorded)
    assert list(without) == list(with_it)
    changed = {stamp for stamp in without if not np.array_equal(without[stamp].ranges, with_it[stamp].ranges)}
    assert changed == {1.0}
    (beam,) = np.flatnonzero(without[1.0].ranges != with_it[1.0].ranges)
    assert with_it[1.0].angles[beam] == pytest.approx(0.0, abs=1e-9)
    assert with_it[1.0].ranges[beam] == pytest.approx(2.0, abs=1e-3)
