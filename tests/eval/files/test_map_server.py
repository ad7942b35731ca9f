# SPDX-License-Identifier: MIT
"""map_server files: probabilities come back, foreign files are read by map_server's rules, broken ones are refused."""

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eval.files.map_server import MapFileError, read_map, write_map
from slam.occupancy import OccupancyGrid

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
def test_a_map_server_reads_the_same_cells_as_occupied_free_and_unknown(tmp_path_factory, probability):
    """nav2's trinary rule on the written pixels, without the extra key; only at a threshold may grey levels round."""
    folder = tmp_path_factory.mktemp("map")
    grid = OccupancyGrid(probability=probability, resolution=0.05, origin=(0.0, 0.0, 0.0))
    write_map(folder / "map.yaml", grid)
    document = yaml.safe_load((folder / "map.yaml").read_text())
    del document["unknown_pixel"]
    (folder / "map.yaml").write_text(yaml.safe_dump(document))
    back = read_map(folder / "map.yaml").probability
    sure = ~((np.abs(probability - 0.65) < 0.005) | (np.abs(probability - 0.25) < 0.005))
    np.testing.assert_array_equal((back == 1.0)[sure], grid.occupied[sure])
    np.testing.assert_array_equal((back == 0.0)[sure], grid.free[sure])
    assert np.isnan(back[~grid.known]).all()


def foreign(folder, pixels, kind="P5", **keys):
    pixels = np.asarray(pixels, dtype=np.uint8)
    head = f"{kind}\n# CREATOR: map_saver 0.050 m/pix\n{pixels.shape[1]} {pixels.shape[0]}\n255\n".encode()
    body = pixels.tobytes() if kind == "P5" else " ".join(map(str, pixels.ravel())).encode()
    (folder / "m.pgm").write_bytes(head + body)
    document = {
        "image": "m.pgm",
        "resolution": 0.05,
        "origin": [1.0, 2.0, 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    document.update(keys)
    (folder / "m.yaml").write_text(yaml.safe_dump({k: v for k, v in document.items() if v is not None}))
    return folder / "m.yaml"


@pytest.mark.parametrize("kind", ["P5", "P2"])
def test_a_map_saver_file_has_its_top_row_at_the_highest_y(tmp_path, kind):
    path = foreign(tmp_path, [[0, 254, 205], [205, 205, 254]], kind)
    np.testing.assert_array_equal(read_map(path).probability, [[np.nan, np.nan, 0.0], [1.0, 0.0, np.nan]])


def test_negate_scale_and_raw(tmp_path):
    grey = [[0, 128, 255]]
    np.testing.assert_array_equal(read_map(foreign(tmp_path, grey, negate=1)).probability, [[0.0, np.nan, 1.0]])
    scale = read_map(foreign(tmp_path, grey, mode="scale")).probability
    np.testing.assert_allclose(scale, [[1.0, 127.0 / 255.0, 0.0]], atol=1e-6)
    raw = read_map(foreign(tmp_path, [[0, 50, 100, 255]], mode="raw")).probability
    np.testing.assert_allclose(raw, [[0.0, 0.5, 1.0, np.nan]], atol=1e-6)


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({"resolution": None}, "resolution: expected a number"),
        ({"resolution": 0.0}, "above 0"),
        ({"resolution": "wide"}, "resolution: expected a number"),
        ({"origin": [0.0]}, "origin: expected"),
        ({"origin": [0.0, 0.0, 90.0]}, "degrees"),
        ({"image": None}, "image: expected the name"),
        ({"mode": "fancy"}, "mode: expected one of"),
        ({"free_thresh": 0.9}, "free_thresh <= occupied_thresh"),
    ],
)
def test_wrong_keys_are_named(tmp_path, keys, expected):
    with pytest.raises(MapFileError, match=r"m\.yaml: ") as caught:
        read_map(foreign(tmp_path, [[0]], **keys))
    assert expected in str(caught.value)


def test_a_picture_that_is_cut_off_is_none_or_is_too_large_is_refused(tmp_path):
    path = foreign(tmp_path, [[0, 0], [0, 0]])
    with pytest.raises(MapFileError, match="limit of 3 pixels"):
        read_map(path, max_pixels=3)
    image = tmp_path / "m.pgm"
    image.write_bytes(image.read_bytes()[:-1])
    with pytest.raises(MapFileError, match=r"expected 2 x 2 pixels, the file ends after 3"):
        read_map(path)
    image.write_bytes(b"P5\n100000 100000\n255\n")
    with pytest.raises(MapFileError, match="limit of 100,000,000 pixels"):
        read_map(path)
    image.write_bytes(b"\x89PNG\r\n")
    with pytest.raises(MapFileError, match="expected a PGM"):
        read_map(path)
    path.write_text("a: [")
    with pytest.raises(MapFileError, match="expected a map_server"):
        read_map(path)
