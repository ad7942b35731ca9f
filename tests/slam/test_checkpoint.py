# SPDX-License-Identifier: MIT
"""A filter that was saved and read again goes on as if nothing had happened."""

from __future__ import annotations

import json

import numpy as np
import pytest

from slam import FilterConfig, GMapping, Scan, load_checkpoint, save_checkpoint
from slam.checkpoint import CheckpointError
from slam.config import AdaptConfig

ANGLES = np.linspace(-np.pi, np.pi, 90, endpoint=False)


def scan_at(pose: np.ndarray, rng: np.random.Generator) -> Scan:
    """Ranges in a room of 8 x 6 m, with noise."""
    directions = ANGLES + pose[2]
    with np.errstate(divide="ignore"):
        x = np.where(np.cos(directions) > 0, 5.0 - pose[0], -3.0 - pose[0]) / np.cos(directions)
        y = np.where(np.sin(directions) > 0, 3.0 - pose[1], -3.0 - pose[1]) / np.sin(directions)
    return Scan(ranges=np.minimum(x, y) + rng.normal(0, 0.02, len(ANGLES)), angles=ANGLES, range_max=20.0)


def drive(mapper: GMapping, start: int, stop: int) -> None:
    for k in range(start, stop):
        odometry = np.array([0.05 * k, 0.3 * np.sin(0.1 * k), 0.2 * np.sin(0.05 * k)])
        mapper.process(odometry, scan_at(odometry, np.random.default_rng(k)))


def assert_same_state(mapper: GMapping, other: GMapping) -> None:
    """All that a filter remembers; which tile of a pool holds what may differ."""
    (arrays, values), (expected_arrays, expected_values) = mapper.state(), other.state()
    assert json.dumps(values) == json.dumps(expected_values)
    for name, array in arrays.items():
        if not name.startswith(("counts_", "surface_", "field_", "tree_parents", "tree_poses", "tree_leaves")):
            assert array.tobytes() == expected_arrays[name].tobytes(), name


FIXED = FilterConfig(particles=6)
ADAPTIVE = FilterConfig(
    adapt=AdaptConfig(count="kld", min_particles=3, position=0.02, heading=0.02, error=1.0, resize_factor=1.1)
)
"""With bins so small that the count changes before and after the filter is saved."""


def digest(arrays: dict[str, np.ndarray]) -> dict[str, bytes]:
    return {name: array.tobytes() for name, array in arrays.items()}


def test_a_state_is_a_snapshot_that_no_filter_shares():
    """It stays as it is while its filter, or one of two that were made from it, goes on."""
    origin = GMapping(FIXED, seed=5, threads=1)
    drive(origin, 0, 6)
    arrays, values = origin.state()
    before = digest(arrays)
    first, second = GMapping(FIXED, threads=1), GMapping(FIXED, threads=1)
    for mapper in (first, second):
        mapper.restore(arrays, values)
    for mapper in (origin, first):
        mine = [name for name, array in mapper.state()[0].items() if np.shares_memory(array, arrays[name])]
        assert mine == []
        drive(mapper, 6, 12)
        assert digest(arrays) == before
        assert digest(second.state()[0]) == before


@pytest.mark.parametrize("config", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
@pytest.mark.parametrize("when", [0, 1, 17, 30])
def test_a_resumed_filter_equals_the_uninterrupted_one_bit_for_bit(tmp_path, when, config):
    whole, first = GMapping(config, seed=5), GMapping(config, seed=5)
    drive(whole, 0, 40)
    drive(first, 0, when)
    save_checkpoint(first, tmp_path / "half.npz")
    resumed = load_checkpoint(tmp_path / "half.npz", threads=1)
    assert_same_state(resumed, first)
    drive(resumed, when, 40)
    for i in range(len(whole.poses)):
        assert resumed.path(i).tobytes() == whole.path(i).tobytes()
        assert resumed.map(i).probability.tobytes() == whole.map(i).probability.tobytes()
    assert resumed.weights.tobytes() == whole.weights.tobytes()
    assert resumed.update_scans.tolist() == whole.update_scans.tolist()
    assert_same_state(resumed, whole)


def test_saving_changes_nothing_and_leaves_no_other_file(tmp_path):
    mapper, twin = GMapping(FilterConfig(particles=3), seed=1), GMapping(FilterConfig(particles=3), seed=1)
    for k in range(10):
        drive(mapper, k, k + 1)
        drive(twin, k, k + 1)
        save_checkpoint(mapper, tmp_path / "state.npz")
    assert mapper.path().tobytes() == twin.path().tobytes()
    assert [p.name for p in tmp_path.iterdir()] == ["state.npz"]


def test_damaged_files_are_named(tmp_path):
    mapper = GMapping(FilterConfig(particles=2))
    drive(mapper, 0, 5)
    save_checkpoint(mapper, tmp_path / "good.npz")
    data = (tmp_path / "good.npz").read_bytes()
    for name, content in (("cut", data[: len(data) // 2]), ("empty", b""), ("text", b"hello")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CheckpointError, match=name):
            load_checkpoint(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        load_checkpoint(tmp_path / "absent")


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """A checkpoint of a filter that has resampled: its arrays, with the header as plain values."""
    path = tmp_path_factory.mktemp("checkpoint") / "good.npz"
    mapper = GMapping(FIXED, seed=5)
    drive(mapper, 0, 25)
    save_checkpoint(mapper, path)
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return arrays, json.loads(arrays.pop("header").tobytes())


def load_changed(tmp_path, arrays, header) -> GMapping:
    path = tmp_path / "changed.npz"
    np.savez(path, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)
    return load_checkpoint(path)


def test_what_was_not_changed_is_read(tmp_path, good):
    arrays, header = good
    drive(load_changed(tmp_path, arrays, header), 25, 30)


ARRAYS = [
    "poses", "log_weights", "spread", "log_histories", "odometry", "update_scans", "map_corner", "tree_parents",
    "tree_poses", "tree_leaves", "tree_founders", "counts_table", "counts_references", "counts_data0", "counts_data1",
    "surface_table", "surface_references", "surface_data0", "field_table", "field_references", "field_data0",
]  # fmt: skip


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_of_half_its_length_is_refused(tmp_path, good, name):
    arrays, header = good
    with pytest.raises(CheckpointError, match=r"changed\.npz: .*damaged") as caught:
        load_changed(tmp_path, arrays | {name: arrays[name][: len(arrays[name]) // 2]}, header)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_of_another_type_is_refused(tmp_path, good, name):
    arrays, header = good
    with pytest.raises(CheckpointError, match=name):
        load_changed(tmp_path, arrays | {name: arrays[name].astype(np.complex64)}, header)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("counts_table", 10**6), ("surface_table", -1), ("field_table", 2), ("field_references", 7),
        ("tree_parents", 10**6), ("tree_leaves", -2), ("tree_founders", 99), ("update_scans", 10**6),
        ("poses", np.nan), ("log_weights", np.nan), ("field_data0", 255), ("counts_free", 1),
    ],
)  # fmt: skip
def test_numbers_that_point_outside_are_refused(tmp_path, good, name, value):
    arrays, header = good
    changed = arrays[name].copy()
    changed = np.append(changed, value).astype(changed.dtype) if changed.size == 0 else changed
    changed.flat[-1] = value
    with pytest.raises(CheckpointError, match="damaged"):
        load_changed(tmp_path, arrays | {name: changed}, header)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("stamp", None),
        ("track", {"stamp": 0.0, "jumps": 0, "poses": [None, [0.0, 1.0], None]}),
        ("scans", -1),
        ("scans", "25"),
        ("track", None),
        ("rng", {}),
        ("revisits", []),
        ("matched", "x"),
    ],
)
def test_plain_values_of_another_kind_are_refused(tmp_path, good, key, value):
    arrays, header = good
    with pytest.raises(CheckpointError, match="damaged"):
        load_changed(tmp_path, arrays, header | {"values": header["values"] | {key: value}})


class Planted:
    """What runs a command where a pickle of it is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


def test_a_pickle_in_a_checkpoint_is_not_read(tmp_path, good):
    arrays, header = good
    with pytest.raises(CheckpointError, match="damaged"):
        load_changed(tmp_path, arrays | {"poses": np.array([Planted(tmp_path / "planted")], object)}, header)
    assert not (tmp_path / "planted").exists()


def test_a_complaint_quotes_at_most_200_characters(tmp_path, good):
    arrays, header = good
    with pytest.raises(CheckpointError) as caught:
        load_changed(tmp_path, arrays | {"x" * 1000: np.zeros(1)}, header)
    assert len(str(caught.value).partition("damaged one (")[2].removesuffix(")")) == 200


def test_another_version_is_named(tmp_path, good):
    arrays, header = good
    with pytest.raises(CheckpointError, match=f"version 7, expected {header['version']}"):
        load_changed(tmp_path, arrays, header | {"version": 7})
