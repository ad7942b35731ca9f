# SPDX-License-Identifier: MIT
"""Floor plans: cells in, the same cells out; damaged files are refused in one line."""

import time

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import worlds
from worlds.format.floor_plan import edge_loops, import_map, read_pgm, world_from_grid


@given(hnp.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9))))
@settings(max_examples=150, deadline=None)
def test_edges_enclose_exactly_the_free_cells(occupied):
    """The even-odd rule over all loops gives each cell back."""
    loops = [shapely.Polygon(loop) for loop in edge_loops(occupied)]
    for row, col in np.ndindex(occupied.shape):
        middle = shapely.Point(col + 0.5, row + 0.5)
        assert (sum(loop.contains(middle) for loop in loops) % 2 == 1) == (not occupied[row, col])
    free = np.pad(~occupied, 1)
    edges = (free[1:] != free[:-1]).sum() + (free[:, 1:] != free[:, :-1]).sum()
    assert sum(loop.length for loop in loops) == pytest.approx(edges)


def room_plan():
    occupied = np.zeros((40, 60), bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[10:20, 30:33] = True
    return occupied


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-3.0, 1.0, 0.5)])
def test_a_plan_becomes_a_world_with_the_same_free_space(origin):
    world = world_from_grid(room_plan(), 0.1, origin=origin)
    worlds.check_world(world, footprint_radius=0.5)
    assert world.free_space().area == pytest.approx((~room_plan()).sum() * 0.01, rel=1e-4)
    inside = shapely.Point(
        origin[0] + 1.0 * np.cos(origin[2]) - 1.0 * np.sin(origin[2]),
        origin[1] + 1.0 * np.sin(origin[2]) + 1.0 * np.cos(origin[2]),
    )
    assert world.free_space().contains(inside)


def test_the_true_map_of_a_plan_is_the_plan():
    truth = worlds.true_map(world_from_grid(room_plan(), 0.1), 0.1)
    row, col = (round(-value / 0.1) for value in (truth.origin[1], truth.origin[0]))
    free = truth.free[row : row + 40, col : col + 60] | truth.occupied[row : row + 40, col : col + 60]
    # walls of a plan are surfaces without thickness, and so mark a cell on their upper or right side
    assert (free[1:-1, 1:-1] != ~room_plan()[1:-1, 1:-1]).mean() < 0.03


def write_map(folder, occupied, **changes):
    """A map_server map of boolean cells, row 0 at the bottom."""
    settings = {"image": "plan.pgm", "resolution": 0.05, "origin": [0.0, 0.0, 0.0], "negate": 0,
                "occupied_thresh": 0.65, "free_thresh": 0.25} | changes  # fmt: skip
    grey = np.where(np.flipud(occupied), 0, 254).astype(np.uint8)
    (folder / "plan.pgm").write_bytes(b"P5\n# made by a test\n%d %d\n255\n" % grey.shape[::-1] + grey.tobytes())
    (folder / "plan.yaml").write_text("\n".join(f"{key}: {value}" for key, value in settings.items()))
    return folder / "plan.yaml"


def test_map_server_maps_are_imported_the_right_way_up(tmp_path):
    world = import_map(write_map(tmp_path, room_plan()))
    assert world.name == "plan"
    free = world.free_space()
    assert free.area == pytest.approx((~room_plan()).sum() * 0.0025)
    assert not free.contains(shapely.Point(31.5 * 0.05, 15 * 0.05))  # the pillar, in the lower half
    assert free.contains(shapely.Point(31.5 * 0.05, 25 * 0.05))


def test_a_million_cells_are_imported_in_under_five_seconds(tmp_path):
    rng = np.random.default_rng(0)
    occupied = np.kron(rng.random((100, 100)) < 0.15, np.ones((10, 10), bool))
    occupied |= rng.random(occupied.shape) < 0.002
    begin = time.process_time()
    world = import_map(write_map(tmp_path, occupied))
    assert time.process_time() - begin < 5.0
    assert len(world.boundary_segments()) > 5000


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": "../plan.pgm"}, "outside of the map's folder"),
        ({"image": "/etc/passwd"}, "outside of the map's folder"),
        ({"image": "gone.pgm"}, "No such file"),
        ({"resolution": 0.0}, "resolution: Input should be greater than 0"),
        ({"resolution": ".nan"}, "resolution"),
        ({"origin": "[0, 0]"}, "origin"),
        ({"image": "[[["}, "not readable as YAML"),
        ({"image": "&a [x]"}, "anchors are not allowed"),
    ],
)
def test_bad_maps_are_explained_in_one_line(tmp_path, changes, message):
    path = write_map(tmp_path, room_plan(), **changes)
    with pytest.raises(worlds.WorldError, match=message) as caught:
        import_map(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a PGM image"),
        (b"P6\n2 2\n255\n" + b"\0" * 12, "not a PGM image"),
        (b"P5\n2 2\n255\n" + b"\0" * 3, "cut off or damaged"),
        (b"P5\n20000 20000\n255\n", "expected at most 100000000"),
        (b"P5\n0 2\n255\n", "expected positive sizes"),
        (b"P2\n2 2\n255\n1 2 x 4", "cut off or damaged"),
    ],
)
def test_bad_images_are_refused(tmp_path, content, message):
    path = tmp_path / "bad.pgm"
    path.write_bytes(content)
    with pytest.raises(worlds.WorldError, match=message):
        read_pgm(path)


def test_both_kinds_of_pgm_are_read(tmp_path):
    path = tmp_path / "a.pgm"
    path.write_bytes(b"P2 # text\n3 1 # size\n10\n0 5 10\n")
    np.testing.assert_allclose(read_pgm(path), [[0.0, 0.5, 1.0]])
    path.write_bytes(b"P5 2 1 1000\n" + np.array([0, 1000], ">u2").tobytes())
    np.testing.assert_allclose(read_pgm(path), [[0.0, 1.0]])


def test_full_and_empty_plans_are_refused():
    with pytest.raises(worlds.WorldError, match="without a free cell"):
        world_from_grid(np.ones((3, 3), bool), 0.1)
    with pytest.raises(worlds.WorldError, match="expected rows and columns"):
        world_from_grid(np.ones(3, bool), 0.1)


def test_plans_that_reach_too_far_are_refused_in_one_line():
    with pytest.raises(worlds.WorldError, match="less than or equal to 1000") as caught:
        world_from_grid(room_plan(), 50.0)
    assert "\n" not in str(caught.value)
