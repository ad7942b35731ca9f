# SPDX-License-Identifier: MIT
"""The state of a filter from a file: what is just inside is taken, what is just outside is refused by its name."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from slam import FilterConfig, GMapping
from slam.checkpoint_check import check_field, check_state
from tests.slam.test_checkpoint import FIXED, drive


def state_of(mapper):
    """Arrays and plain values as they are read from a file."""
    arrays, values = mapper.state()
    return arrays, json.loads(json.dumps(values))


@pytest.fixture(scope="module")
def sound():
    """The state of six particles that have resampled, after 25 scans of which nine were used."""
    mapper = GMapping(FIXED, seed=5)
    drive(mapper, 0, 25)
    return state_of(mapper)


@pytest.fixture(scope="module")
def fresh():
    return GMapping(FIXED).state()


def with_item(array, place, value):
    """A copy with one item changed; place: an index into the items in their order."""
    changed = array.copy()
    changed.flat[place] = value
    return changed


def refuse(arrays, values, fresh, problem):
    with pytest.raises(ValueError) as caught:  # noqa: PT011  the message is compared as it is
        check_state(arrays, values, fresh)
    assert str(caught.value).startswith(problem)


def test_a_sound_state_is_taken(sound, fresh):
    check_state(*sound, fresh)


@pytest.mark.parametrize("scans", [0, 1, 5])
def test_a_single_particle_is_enough_and_so_are_few_scans(scans):
    config = FilterConfig(particles=1)
    mapper = GMapping(config)
    drive(mapper, 0, scans)
    check_state(*state_of(mapper), GMapping(config).state())


TAKEN = {
    "a history that cannot be": ("log_histories", 0, -np.inf),
    "the last founder": ("tree_founders", 0, 5),
    "the farthest pose": ("poses", 0, -1e8),
    "a pose that is certain": ("spread", 0, 0.0),
    "a map whose corner is elsewhere": ("map_corner", 0, -16),
}


@pytest.mark.parametrize("case", TAKEN)
def test_numbers_at_the_edge_are_taken(sound, fresh, case):
    (name, place, value), (arrays, values) = TAKEN[case], sound
    check_state(arrays | {name: with_item(arrays[name], place, value)}, values, fresh)


REFUSED = {
    "poses": (0, -np.inf, "poses: numbers that are not finite"),
    "spread": (0, np.nan, "spread: numbers that are not finite"),
    "tree_poses": (0, 1.1e8, "tree_poses: 1.1e+08, expected at most 1e+08"),
    "map_corner": (1, 1, "map_corner: not the corner of a tile of 16 cells"),
    "log_weights": (0, np.inf, "log_weights: numbers that are not finite"),
    "log_histories": (0, np.nan, "log_histories: numbers that are not finite"),
    "tree_founders": (0, 6, "tree_founders: not particles"),
    "tree_leaves": (0, 54, "tree_leaves: outside the tree"),
    "update_scans": (-1, 25, "update_scans: not in order, or beyond the last scan"),
    "map_scans": (0, 10, "(10, 9) scans in map and histories, expected 9"),
    "tree_generations": (0, 8, "(9, 8) scans in map and histories, expected 9"),
    "tree_parents": (7, 7, "tree_parents: not before their children"),
    "counts_references": (0, 2, "counts_references: not the number of owners"),
    "surface_references": (1, 2, "surface_references: not the number of owners"),
    "surface_free": (0, 1, "surface_free: not the tiles without an owner"),
    "field_data0": (0, 1, "field_data: the empty tile is not empty"),
    "counts_data1": (0, 1, "counts_data: the empty tile is not empty"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_one_number_beyond_the_edge_is_refused(sound, fresh, name):
    (place, value, problem), (arrays, values) = REFUSED[name], sound
    refuse(arrays | {name: with_item(arrays[name], place, value)}, values, fresh, problem)


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("tree_founders", -1, "tree_founders: not particles"),
        ("tree_leaves", -2, "tree_leaves: outside the tree"),
        ("tree_leaves", -1, "tree_leaves: histories not of 9 poses"),
        ("update_scans", -1, "update_scans: not in order, or beyond the last scan"),
        ("tree_parents", -2, "tree_parents: not before their children"),
        ("counts_table", -1, "counts_table: tiles that are not there"),
        ("surface_table", 461, "surface_table: tiles that are not there"),
        ("spread", -1e-9, "spread: negative variances"),
        ("poses", -1.1e8, "poses: 1.1e+08, expected at most 1e+08"),
        ("map_corner", 1 << 60, "map_corner: 1.15e+18, expected at most 1e+08"),
    ],
)
def test_numbers_below_the_edge_are_refused(sound, fresh, name, value, problem):
    arrays, values = sound
    refuse(arrays | {name: with_item(arrays[name], 0, value)}, values, fresh, problem)


def test_scans_are_used_once_and_in_order(sound, fresh):
    arrays, values = sound
    used = arrays["update_scans"]
    refuse(arrays | {"update_scans": with_item(used, 1, used[0])}, values, fresh, "update_scans: not in order")
    check_state(arrays | {"update_scans": with_item(used, -1, 24)}, values, fresh)
    check_state(arrays | {"update_scans": with_item(used, 1, used[0] + 1)}, values, fresh)


def test_a_filter_without_a_scan_knows_no_odometry(sound, fresh):
    arrays, values = state_of(GMapping(FIXED))
    refuse(arrays | {"odometry": np.zeros(3)}, values, fresh, "odometry: not that of the last used scan")
    arrays, values = sound
    refuse(arrays | {"odometry": np.zeros(0)}, values, fresh, "odometry: not that of the last used scan")


@pytest.mark.parametrize(
    ("name", "shape", "expected"),
    [("poses", (6, 2), "(n, 3)"), ("spread", (6, 3, 2), "(n, 3, 3)"), ("tree_poses", (54, 4), "(n, 3)"),
     ("errors", (6, 4), "(n, 3)"), ("counts_data0", (529, 255), "(n, 256)"), ("counts_data1", (529, 15), "(n, 16)")],
)  # fmt: skip
def test_rows_have_the_size_of_a_new_filters(sound, fresh, name, shape, expected):
    arrays, values = sound
    changed = arrays | {name: np.zeros(shape, arrays[name].dtype)}
    refuse(changed, values, fresh, f"{name}: shape {shape}, expected {expected}")


@pytest.mark.parametrize(
    "name", ["log_weights", "spread", "errors", "log_histories", "tree_leaves", "tree_founders", "field_table"]
)
def test_everything_is_there_once_for_each_particle(sound, fresh, name):
    arrays, values = sound
    refuse(arrays | {name: arrays[name][:5]}, values, fresh, f"{name}: 5 particles, expected 6")
    refuse(arrays | {name: np.concatenate([arrays[name]] * 2)}, values, fresh, f"{name}: 12 particles, expected 6")


def test_some_particle_is_there_and_has_a_weight(sound, fresh):
    arrays, values = sound
    refuse(arrays | {"poses": arrays["poses"][:0]}, values, fresh, "poses: no particle")
    nobody = np.full(6, -np.inf)
    refuse(arrays | {"log_weights": nobody}, values, fresh, "log_weights: weights with the sum 0, expected 1")
    check_state(arrays | {"log_weights": with_item(nobody, 0, 0.0)}, values, fresh)
    for off in (-2e-6, 2e-6, 800.0):
        refuse(arrays | {"log_weights": with_item(nobody, 0, off)}, values, fresh, "log_weights: weights with the sum")
    check_state(arrays | {"log_weights": with_item(nobody, 0, 5e-7)}, values, fresh)
    refuse(arrays | {"map_corner": np.zeros(3, int)}, values, fresh, "map_corner: expected two numbers")


def test_kinds_and_names_of_arrays_are_those_of_a_new_filter(sound, fresh):
    arrays, values = sound
    refuse({name: arrays[name] for name in arrays if name != "poses"}, values, fresh, "arrays ['poses'] missing or")
    refuse(arrays | {"more": np.zeros(1)}, values, fresh, "arrays ['more'] missing or unknown")
    kind = "float32 with 2 axes, expected float64 with 2"
    refuse(arrays | {"poses": arrays["poses"].astype(np.float32)}, values, fresh, f"poses: {kind}")
    refuse(arrays | {"poses": arrays["poses"].ravel()}, values, fresh, "poses: float64 with 1 axes, expected float64")


@pytest.mark.parametrize("name", ["tree_poses", "counts_data0", "counts_data1", "surface_data0", "field_data0"])
def test_each_node_and_each_tile_has_its_data(sound, fresh, name):
    arrays, values = sound
    problem = "tree_poses: not one for each node"
    if name != "tree_poses":
        problem = f"{name.partition('_')[0]}_references: not one for each tile"
    refuse(arrays | {name: arrays[name][:-1]}, values, fresh, problem)


def test_a_pool_has_at_least_its_empty_tile(sound, fresh):
    arrays, values = sound
    emptied = {name: arrays[name][:0] for name in ("field_references", "field_data0", "field_free")}
    refuse(arrays | emptied, values, fresh, "field_references: not one for each tile")


def cropped(arrays, pool):
    """A state in which one pool's tables have half of their rows; owners and free tiles fit."""
    table = arrays[f"{pool}_table"]
    table = table[:, : table.shape[1] // 2]
    references = np.bincount(table.ravel(), minlength=len(arrays[f"{pool}_references"]))
    references[0] = 1
    free = np.flatnonzero(references == 0)
    parts = {"table": table, "references": references, "free": free}
    return arrays | {f"{pool}_{part}": array.astype(arrays[f"{pool}_{part}"].dtype) for part, array in parts.items()}


@pytest.mark.parametrize("pool", ["counts", "surface", "field"])
def test_the_tables_of_all_pools_cover_the_same_cells(sound, fresh, pool):
    """Compiled code takes an index into one of them for the others too."""
    arrays, values = sound
    refuse(cropped(arrays, pool), values, fresh, "tables of counts, surface, field that cover [(")


def test_when_a_tile_was_touched_is_known_for_each(sound, fresh):
    arrays, values = sound
    touched = arrays["map_touched"]
    refuse(arrays | {"map_touched": touched[:-1]}, values, fresh, "map_touched: shape (9, 12), expected (10, 12)")


def test_words_of_the_field_are_those_of_its_table():
    field = np.array([[0, 7]], np.uint8)
    check_field({"field_data0": field}, 8)
    check_field({"field_data0": field[:0]}, 0)
    with pytest.raises(ValueError, match="field_data0: words from 7 on"):
        check_field({"field_data0": field}, 7)


LONG = "x" * 100


@pytest.mark.parametrize(
    ("keys", "value", "problem"),
    [
        (("scans",), -1, "scans: -1, expected a number of scans"),
        (("scans",), None, "scans: None, expected a number of scans"),
        (("scans",), LONG, f"scans: {'x' * 40}, expected a number of scans"),
        (("stamp",), LONG, f"stamp: {'x' * 40}, expected a number"),
        (("stamp",), True, "stamp: True, expected a number"),
        (("stamp",), float("nan"), "stamp: nan, expected a number"),
        (("stamp",), None, "stamp: None, expected a number"),
        (("rng", "bit_generator"), 12 * 10**50, f"bit_generator: 12{'0' * 38}, expected a str"),
        (("track", "poses"), LONG, f"poses: {'x' * 40}, expected a list"),
        (("track",), None, "track: expected ['jumps', 'poses', 'stamp']"),
        (("track", "jumps"), [1], "jumps: [1], expected a number"),
        (("track", "poses"), [[0.0, 1.0]], "track: poses of other than three finite numbers"),
        (("track", "poses"), [[0.0, 1.0, 2.0, 3.0]], "track: poses of other than three finite numbers"),
        (("track", "poses"), [[0.0, 1.0, float("inf")]], "track: poses of other than three finite numbers"),
        (("track", "poses"), [[0.0, 1.0, "2"]], "track: poses of other than three finite numbers"),
        (("track", "poses"), ["123"], "track: poses of other than three finite numbers"),
    ],
)  # fmt: skip
def test_plain_values_are_of_the_kind_of_a_new_filters(sound, fresh, keys, value, problem):
    arrays, values = sound
    changed = copy.deepcopy(values)
    inner = changed
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    refuse(arrays, changed, fresh, problem)


def test_unknown_and_missing_values_are_refused(sound, fresh):
    arrays, values = sound
    refuse(arrays, values | {"more": 1}, fresh, "values: expected [")
    refuse(arrays, {key: values[key] for key in values if key != "matched"}, fresh, "values: expected [")
