# SPDX-License-Identifier: MIT
"""People and doors: collision-free with the robot, seeded, seen by the lidar, absent from the true map."""

import dataclasses
import math

import numpy as np
import pytest
import shapely

import worlds
from testbed.seeds import RunSeeds
from testbed.simulation import simulate
from testbed.simulation.movers._mover_kernels import nearest_mover
from testbed.simulation.movers.movers import Movers
from testbed.simulation.physics.backend import Hits
from tests.testbed.simulation.small_worlds import perfect, room
from worlds import PERSON_RADIUS, Box, Door, Person, WorldError

CROSSING = room(
    start=(-4.0, 0.0, 0.0),
    tour=[(4.0, 0.0), (-4.0, 0.0)],
    people=[
        Person(name="across", points=[(0.0, -3.0), (0.0, 3.0)], pause=1.0),
        Person(name="along", points=[(-2.0, -2.5), (-2.0, 0.0), (2.0, 0.0), (2.0, 2.5)], speed=0.8, pause=1.0),
    ],
)
DOORWAY = room(
    start=(-4.5, 0.0, 0.0),
    tour=[(4.5, 0.0), (-4.5, 0.0)],
    boxes=[Box(x=0.0, y=2.8, width=0.1, depth=4.4), Box(x=0.0, y=-2.8, width=0.1, depth=4.4)],
    doors=[Door(name="door", x=0.0, y=0.6, width=1.2, closed=-math.pi / 2, swing=math.pi / 2, stay=0.5)],
)


@pytest.mark.parametrize("seed", range(8))
def test_people_and_robot_never_touch_and_the_tour_is_finished(seed):
    config = perfect(backend="fast", seeds=RunSeeds.from_seed(seed), duration=200.0)
    robot_radius = config.robot.footprint_radius
    met = []
    with simulate(CROSSING, config) as simulation:
        for frame in simulation:
            met.append(np.hypot(*(simulation.movers.people() - frame.truth[:2]).T).min())
    assert simulation.finished
    assert min(met) > robot_radius + PERSON_RADIUS
    assert min(met) < robot_radius + 2.5  # they did meet


@pytest.mark.parametrize("seed", range(8))
def test_a_swinging_door_never_touches_the_robot(seed):
    config = perfect(backend="fast", seeds=RunSeeds.from_seed(seed), duration=200.0)
    angles = []
    with simulate(DOORWAY, config) as simulation:
        for frame in simulation:
            x0, y0, x1, y1 = simulation.movers.segments()[0]
            leaf = shapely.LineString([(x0, y0), (x1, y1)])
            assert leaf.distance(shapely.Point(frame.truth[:2])) > config.robot.footprint_radius
            angles.append(math.atan2(y1 - y0, x1 - x0))
    assert simulation.finished
    assert max(angles) == pytest.approx(0.0, abs=1e-9)
    assert min(angles) < -0.5


def test_the_lidar_sees_legs_and_doors_where_they_are():
    circles = np.array([[[2.0, 0.0, 0.1]], [[4.0, 0.0, 0.1]]])
    segments = np.array([[[-3.0, -1.0, -3.0, 1.0]], [[-3.0, -1.0, -3.0, 1.0]]])
    origins, positions = np.zeros((4, 2)), np.array([0.0, 1.0, 0.5, 0.0])
    directions = np.array([0.0, 0.0, np.pi, np.pi / 2])
    distances, cos_incidence = nearest_mover(circles, segments, positions, origins, directions)
    np.testing.assert_allclose(distances, [1.9, 3.9, 3.0, np.inf])
    np.testing.assert_allclose(cos_incidence[:3], 1.0, atol=1e-12)
    grazing = math.asin(0.1 / 2.0) * 0.99
    beam = nearest_mover(circles, segments, np.zeros(1), np.zeros((1, 2)), np.array([grazing]))
    assert beam[0][0] == pytest.approx(2.0, abs=0.02)
    assert beam[1][0] < 0.2


def test_movers_hide_walls_only_where_they_are_nearer():
    world = room(people=[Person(points=[(2.0, -2.0), (2.0, 2.0)])])
    movers = Movers(world, 0.2, 0.05, RunSeeds.from_seed(0).movers)
    directions = np.linspace(-np.pi, np.pi, 3600, endpoint=False)
    near, far = (
        movers.before(
            Hits(np.full(3600, wall), np.full(3600, 1.0)),
            np.zeros((3600, 2)),
            directions,
            np.zeros(3600),
            np.ones(3600, np.int64),
        ).distances
        for wall in (1.0, 50.0)
    )
    assert np.all(near == 1.0)
    assert 0 < (far < 50.0).sum() < 200


def test_movers_are_seeded_and_leave_other_streams_alone():
    config = perfect(backend="fast", duration=10.0)
    config = dataclasses.replace(config, odometry=dataclasses.replace(config.odometry, random=True))

    def run(world, seed):
        with simulate(world, dataclasses.replace(config, seeds=RunSeeds.from_seed(seed))) as simulation:
            frames = list(simulation)
            return simulation.movers.people(), frames

    (first, frames), (again, _), (other, _) = run(CROSSING, 0), run(CROSSING, 0), run(CROSSING, 1)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    empty = run(CROSSING.model_copy(update={"people": []}), 0)[1]
    assert np.array_equal([f.odometry for f in frames][:20], [f.odometry for f in empty][:20])


def test_the_true_map_holds_no_movers():
    still = CROSSING.model_copy(update={"people": []})
    assert np.array_equal(worlds.true_map(CROSSING).occupied, worlds.true_map(still).occupied)


@pytest.mark.parametrize(
    ("movers", "message"),
    [
        ({"people": [Person(name="Ann", points=[(0, -4.9), (0, 4)])]}, "people.0. 'Ann' passes 0.10 m from a wall"),
        ({"people": [Person(name="Bob", points=[(0, -3), (0, 0.5)])]}, r"'Bob' stops at \(0, 0.5\) m, 0.50 m from"),
        (
            {"doors": [Door(name="front", x=0, y=1, closed=0, swing=-math.pi / 2)]},
            "'front' stands 0.10 m from the tour",
        ),
    ],
)
def test_movers_that_would_block_the_tour_are_refused(movers, message):
    with pytest.raises(WorldError, match=message):
        worlds.check_world(CROSSING.model_copy(update=movers), footprint_radius=0.2)
