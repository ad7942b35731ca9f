# SPDX-License-Identifier: MIT
"""map_server files: probabilities come back, foreign files are read by map_server's rules, broken ones are refused."""

import errno
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from eval.files.map_server import MapFileError, read_map, write_map
from slam.occupancy import OccupancyGrid
from tests.worlds.format.plans import p5, write

probabilities = hnp.arrays(
    np.float32,
    hnp.array_shapes(min_dims=2, max_dims=2, max_side=12),
    elements=st.one_of(st.floats(0.0, 1.0, width=32), st.just(np.float32(np.nan))),
)


@given(probabilities, st.floats(-3.0, 3.0))
@example(np.array([[0.49609375, 0.5]], dtype=np.float32), 0.0)  # on both sides of the grey that means unknown
@settings(deadline=None)
def test_what_is_written_is_read_back_to_one_grey_level(tmp_path_factory, probability, yaw):
    folder = tmp_path_factory.mktemp("map")
    grid = OccupancyGrid(probability=probability, resolution=0.05, origin=(-1.25, 3.5, yaw))
    write_map(folder / "map.yaml", grid)
    back = read_map(folder / "map.yaml")
    np.testing.assert_array_equal(back.known, grid.known)
    np.testing.assert_allclose(back.probability[back.known], probability[grid.known], atol=1.0 / 255.0)
    assert (back.resolution, back.origin) == (grid.resolution, grid.origin)
    assert sorted(p.name for p in folder.iterdir()) == ["map.pgm", "map.yaml"]


@given(probabilities)
@settings(deadline=None)
def test_a_map_server_reads_the_same_cells(tmp_path_factory, probability):
    """nav2's trinary rule on the written pixels; only at a threshold may grey levels round."""
    folder = tmp_path_factory.mktemp("map")
    grid = OccupancyGrid(probability=probability, resolution=0.05, origin=(0.0, 0.0, 0.0))
    write_map(folder / "map.yaml", grid)
    document = yaml.safe_load((folder / "map.yaml").read_text())
    shade = 1.0 - np.flipud(np.asarray(Image.open(folder / "map.pgm"))) / 255.0
    back = np.select([shade > document["occupied_thresh"], shade < document["free_thresh"]], [1.0, 0.0], np.nan)
    sure = ~((np.abs(probability - 0.65) < 0.005) | (np.abs(probability - 0.25) < 0.005))
    np.testing.assert_array_equal((back == 1.0)[sure], grid.occupied[sure])
    np.testing.assert_array_equal((back == 0.0)[sure], grid.free[sure])
    assert np.isnan(back[~grid.known]).all()


def test_a_map_saver_file_has_its_top_row_at_the_highest_y(tmp_path):
    path = write(tmp_path, p5(np.array([[0, 254, 205], [205, 205, 254]])))
    np.testing.assert_array_equal(read_map(path).probability, [[np.nan, np.nan, 0.0], [1.0, 0.0, np.nan]])


def test_negate_scale_and_raw(tmp_path):
    grey = p5(np.array([[0, 128, 255]]))
    np.testing.assert_array_equal(read_map(write(tmp_path, grey, negate=1)).probability, [[0.0, np.nan, 1.0]])
    shades = np.array([[0, 100, 255]])
    scale = read_map(write(tmp_path, p5(shades), mode="scale")).probability
    np.testing.assert_allclose(scale, [[1.0, 155.0 / 255.0, 0.0]], atol=1e-6)
    raw = read_map(write(tmp_path, p5(np.array([[0, 50, 100, 255]])), mode="raw")).probability
    np.testing.assert_allclose(raw, [[0.0, 0.5, 1.0, np.nan]], atol=1e-6)


def test_too_large_and_misnamed_maps_are_not_written(tmp_path):
    large = np.broadcast_to(np.float32(0.0), (20_000, 20_000))
    with pytest.raises(MapFileError, match="20000 x 20000 cells, expected 1 to 100,000,000"):
        write_map(tmp_path / "m.yaml", OccupancyGrid(probability=large, resolution=0.05, origin=(0.0, 0.0, 0.0)))
    small = OccupancyGrid(probability=large[:2, :2], resolution=0.05, origin=(0.0, 0.0, 0.0))
    with pytest.raises(MapFileError, match=r"m\.png: expected a name that ends in \.yaml"):
        write_map(tmp_path / "m.png", small)
    assert list(tmp_path.iterdir()) == []


def test_the_written_picture_is_a_binary_pgm(tmp_path):
    grid = OccupancyGrid(probability=np.array([[0.0, 1.0]], np.float32), resolution=0.05, origin=(0.0, 0.0, 0.0))
    write_map(tmp_path / "m.yaml", grid)
    assert (tmp_path / "m.pgm").read_bytes() == b"P5\n2 1\n255\n\xff\x00"


def test_a_yaml_never_names_a_picture_that_could_not_be_written(tmp_path, monkeypatch):
    """The picture comes first: where it fails, the map that was there before is whole, with its old origin."""
    old = OccupancyGrid(probability=np.array([[0.0, 1.0]], np.float32), resolution=0.05, origin=(0.0, 0.0, 0.0))
    write_map(tmp_path / "m.yaml", old)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    replace = Path.replace

    def full_at_the_picture(self, target):
        if Path(target).suffix == ".pgm":
            raise OSError(errno.ENOSPC, "No space left on device")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", full_at_the_picture)
    new = OccupancyGrid(probability=old.probability, resolution=0.05, origin=(7.0, 0.0, 0.0))
    with pytest.raises(OSError, match="No space left"):
        write_map(tmp_path / "m.yaml", new)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
