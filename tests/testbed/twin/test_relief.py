# SPDX-License-Identifier: MIT
"""The relief of walls: pieces of them go to where the beams of a log ended."""

import numpy as np
import pytest
import shapely

from testbed.formats import Log
from testbed.presets import load_lidar, load_robot
from testbed.seeds import RunSeeds
from testbed.simulation import OdometryConfig, SimulationConfig, simulate
from testbed.simulation.robot.lidar import LidarLayers
from testbed.twin.relief import MAX_MOVE, _moved, _moves, _pieces, with_relief
from testbed.twin.returns import ComparedScan
from testbed.twin.walls import CLEARED
from worlds import Start, Tour, Wall, World

STRAIGHT = [(0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)]
ROUGH = [
    *((0.0, 0.0), (2.0, 0.0), (2.05, 0.06), (2.65, 0.06), (2.7, 0.0)),  # a pilaster of 6 cm
    *((6.0, 0.0), (6.04, 4.03), (0.0, 4.03)),  # walls that stand farther off, and so do their corners
]


def room(points, *more):
    walls = [Wall(name="outline", points=points, closed=True), *more]
    tour = Tour(points=[(5.0, 1.0), (5.0, 3.0), (1.0, 3.0)])
    return World(name="room", description="A room", start=Start(x=1.0, y=1.0, theta=0.0), tour=tour, walls=walls)


def driven(world):
    """What a lidar without noise saw in a drive: the log's table, the path (m, 3) and the numbers of its scans."""
    lidar = load_lidar("lms200")
    config = SimulationConfig(
        robot=load_robot("create3"),
        lidar=lidar,
        backend="fast",
        odometry=OdometryConfig(),
        lidar_layers=LidarLayers.none(),
        seeds=RunSeeds.from_seed(1),
    )
    with simulate(world, config) as simulation:
        frames = [frame for frame in simulation if frame.scan is not None]
    path = np.array([frame.truth for frame in frames])
    return Log.from_frames(frames, path="drive.log", format="made").table, path, np.arange(len(frames))


@pytest.fixture(scope="module")
def drive():
    return driven(room(ROUGH))


def away_from(world, points):
    """Distances of points on the walls of a world from closed walls with those corners [m]."""
    own = shapely.multilinestrings(world.boundary_segments().reshape(-1, 2, 2))
    places = shapely.points(shapely.get_coordinates(shapely.segmentize(own, 0.01)))
    return shapely.distance(places, shapely.linearrings(points))


def test_walls_go_to_where_the_beams_ended(drive):
    """A tenth of them is more than 3 cm off before; only the slopes of a pilaster are narrower than a piece."""
    table, path, scans = drive
    made = with_relief(room(STRAIGHT), table, path, scans, path)
    away = away_from(made, ROUGH)
    assert np.percentile(away, 90) < 0.004
    assert away.max() < 0.03
    assert np.percentile(away_from(room(STRAIGHT), ROUGH), 90) > 0.03


def test_walls_that_stand_right_stay(drive):
    table, path, scans = drive
    assert away_from(with_relief(room(ROUGH), table, path, scans, path), ROUGH).max() < 0.004


def test_walls_that_no_beam_met_stay(drive):
    table, path, scans = drive
    closet = Wall(name="closet", points=[(8.0, 1.0), (9.0, 1.0), (9.0, 2.0), (8.0, 2.0)], closed=True)
    made = with_relief(room(STRAIGHT, closet), table, path, scans, path)
    assert shapely.equals(
        shapely.linearrings(made.walls[1].points).normalize().simplify(0.0),
        shapely.linearrings(closet.points).normalize(),
    )


def test_walls_do_not_close_the_way_of_the_robot(drive):
    """The way is said to pass within 21 cm of the wall on the right, which would otherwise stand nearer."""
    table, path, scans = drive
    wide = [(-0.08, 0.0), (6.0, 0.0), (6.0, 4.0), (-0.08, 4.0)]  # the wall on the left is 8 cm too far
    way = np.array([(0.16, 0.5, 0.0), (0.16, 3.5, 0.0)])
    free, kept = (with_relief(room(wide), table, path, scans, w) for w in (path, way))
    left = [min(x for x, y in made.walls[0].points if 1.0 < y < 3.0) for made in (free, kept)]
    assert left[0] == pytest.approx(0.0, abs=0.004)
    assert left[1] == pytest.approx(-0.08, abs=1e-4)
    assert 0.16 - left[1] > CLEARED


def test_walls_move_by_a_bounded_way(drive):
    table, path, scans = drive
    far = [(-0.2, 0.0), (6.0, 0.0), (6.0, 4.0), (-0.2, 4.0)]
    made = with_relief(room(far), table, path, scans, path)
    assert max(x for x, y in made.walls[0].points if x < 1.0 and 1.0 < y < 3.0) == pytest.approx(-0.2 + MAX_MOVE)


def test_a_corner_meets_both_of_its_walls_and_a_straight_wall_their_mean():
    x, y, none = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]]), np.array([np.nan])
    oblique = np.array([[np.cos(1.0), np.sin(1.0)]])
    one, other = np.array([0.03]), np.array([-0.02])
    corner = _moves(x, one, oblique, other)[0]
    assert corner @ x[0] == pytest.approx(0.03)
    assert corner @ oblique[0] == pytest.approx(-0.02)
    assert _moves(x, one, x, other)[0] == pytest.approx([0.005, 0.0])
    assert _moves(x, one, y, none)[0] == pytest.approx([0.03, 0.0])
    assert _moves(x, none, y, other)[0] == pytest.approx([0.0, -0.02])
    assert _moves(x, none, y, none)[0] == pytest.approx([0.0, 0.0])


def test_a_step_stands_where_it_stood():
    """Each point of a wall follows the readings of the halves of the pieces beside it, not those farther off."""
    start = [(0.0, 0.0), (1.0, 0.0)]
    ring = _pieces(np.array([*start, (1.0, 1.0), (0.0, 1.0)]))
    along = np.linspace(0.0025, 0.9975, 400)
    readings = np.where(along < 0.45, 2.0, 2.04)  # down onto the lower wall from many places, 4 cm deeper on the right
    scans = [
        ComparedScan(np.array([x, 2.0]), np.full(9, -np.pi / 2), np.full(9, r), np.full(9, 2.0))
        for x, r in zip(along, readings, strict=True)
    ]
    (moved,) = _moved([ring], scans)
    lower = moved[ring[:, 1] == 0.0]
    assert lower[:, 1] == pytest.approx(np.where(lower[:, 0] < 0.45, 0.0, -0.04), abs=1e-9)
