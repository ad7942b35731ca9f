# SPDX-License-Identifier: MIT
"""ROS maps as people bring them: the right cells for every use, or one line that names file and key."""

import numpy as np
import pytest
from PIL import Image

import worlds
from eval.files.map_server import read_map
from tests.worlds.format.plans import FLOOR, FREE, UNKNOWN, WALL, p2, p5, plan, write
from worlds.errors import MapFileError
from worlds.format.files import parse
from worlds.format.map_file import map_image, read_map_file

PLAN = plan()
CELLS = {"occupied": (PLAN == WALL).sum(), "free": (PLAN == FREE).sum(), "unknown": (PLAN == UNKNOWN).sum()}
AS_RAW = np.select([PLAN == WALL, PLAN == FREE], [100, 0], 255).astype(np.uint8)
ALPHA = Image.fromarray(np.where(PLAN == UNKNOWN, 0, 255).astype(np.uint8))


def check(path, notes=0):
    """The map has the cells of the plan, and becomes a world with its floor; returns its notes."""
    file, grid = read_map_file(path), read_map(path)
    found = {"occupied": grid.occupied.sum(), "free": grid.free.sum(), "unknown": (~grid.known).sum()}
    assert found == CELLS
    world, world_notes = worlds.import_map_with_notes(path)
    worlds.check_world(world, footprint_radius=0.3)
    assert world.free_space().area == pytest.approx(FLOOR)
    assert len(file.notes) == notes
    assert world_notes[:notes] == file.notes
    return file.notes


@pytest.mark.parametrize("mode", [None, "trinary", "Trinary", "TRINARY", "scale", "Scale"])
def test_every_mode_of_shades_reads_the_plan(tmp_path, mode):
    notes = check(write(tmp_path, p5(PLAN), mode=mode), notes=1 if mode and mode.lower() == "scale" else 0)
    assert all("grey 205 is read as unknown" in note for note in notes)


@pytest.mark.parametrize("mode", ["raw", "Raw"])
def test_raw_percents_are_not_read_inside_out(tmp_path, mode):
    check(write(tmp_path, p5(AS_RAW), mode=mode))


@pytest.mark.parametrize(
    ("picture", "name"),
    [
        (p2(PLAN), "map.pgm"),
        (p2(PLAN).replace(b"\n", b" # row\n"), "map.pgm"),
        (p5(PLAN, "# CREATOR: map_saver 0.050 m/pix\n"), "map.pgm"),
        (Image.fromarray(PLAN), "map.png"),
        (Image.fromarray(PLAN).convert("P"), "map.png"),
        (Image.fromarray(PLAN).convert("RGBA"), "map.png"),
        (Image.merge("LA", (Image.fromarray(PLAN), ALPHA)), "map.png"),
        (Image.merge("LA", (Image.fromarray(np.where(PLAN == UNKNOWN, 0, PLAN).astype(np.uint8)), ALPHA)), "map.png"),
        (Image.fromarray(PLAN), "map.bmp"),
    ],
)
def test_every_picture_of_the_plan_gives_its_cells(tmp_path, picture, name):
    check(write(tmp_path, picture, name))


@pytest.mark.parametrize("negate", [1, True, "1"])
def test_a_negated_picture_is_read(tmp_path, negate):
    check(write(tmp_path, p5(255 - PLAN), negate=negate))


@pytest.mark.parametrize("name", ["/home/robot/maps/map.pgm", r"C:\maps\map.pgm", "../maps/map.pgm", "gone/map.pgm"])
def test_a_picture_of_that_name_in_the_folder_of_the_map_is_read(tmp_path, name):
    (note,) = check(write(tmp_path, p5(PLAN), image=name), notes=1)
    assert f"{name} does not exist here" in note
    assert map_image(tmp_path / "map.yaml") == tmp_path / "map.pgm"


def test_a_picture_elsewhere_is_read_only_for_ones_own_maps(tmp_path):
    path = write(tmp_path, p5(PLAN))
    (tmp_path / "inside").mkdir()
    inner = write(tmp_path / "inside", p5(PLAN), "other.pgm", image="../map.pgm")
    check(inner)
    with pytest.raises(MapFileError, match=r"image: \.\./map\.pgm lies outside of the map's folder"):
        read_map_file(inner, inside=True)
    assert read_map_file(path, inside=True).notes == ()
    (tmp_path / "inside" / "other.pgm").unlink()
    (tmp_path / "inside" / "map.pgm").symlink_to(path.parent / "map.pgm")
    with pytest.raises(MapFileError, match="outside"):
        read_map_file(inner, inside=True)


@pytest.mark.parametrize("grey", [205, 127, 128])
def test_the_grey_of_unknown_cells_overrules_the_thresholds(tmp_path, grey):
    """nav2's free_thresh of 0.25 makes 205 free; other programs mark unknown cells with the middle grey."""
    picture = np.where(PLAN == UNKNOWN, grey, PLAN)
    (note,) = check(write(tmp_path, p5(picture), free_thresh=0.6, occupied_thresh=0.65), notes=1)
    assert f"grey {grey} is read as unknown" in note


def test_a_grey_among_others_is_a_probability_and_no_mark(tmp_path):
    shades = np.tile(np.arange(196, 256, dtype=np.uint8), (40, 1))
    file = read_map_file(write(tmp_path, p5(shades), free_thresh=0.25))
    assert file.notes == ()
    assert file.probability[0, 205 - 196] == 0.0


def test_a_plan_without_another_free_grey_keeps_its_floor(tmp_path):
    only = np.where(PLAN == WALL, 0, 205)
    file = read_map_file(write(tmp_path, p5(only), free_thresh=0.25))
    assert (file.probability == 0.0).sum() == (only == 205).sum()


def test_an_origin_in_utm_is_kept_as_an_offset(tmp_path):
    path = write(tmp_path, p5(PLAN), origin=[480000.5, 5640000.2, 0.0])
    assert read_map(path).origin == (480000.5, 5640000.2, 0.0)
    world, (note,) = worlds.import_map_with_notes(path)
    assert world.offset == (480000.5, 5640000.2)
    assert "map.yaml: origin: (480000.50, 5640000.20) m is kept as offset" in note
    assert world.free_space().bounds == pytest.approx((0.6, 0.6, 8.4, 6.4))
    assert parse(worlds.dumps(world), "test") == world


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"origin": [3.5, -4.5, 90]}, "origin: expected a yaw in radians, got 90, which looks like degrees"),
        ({"origin": [3.5, -4.5, -180.0]}, "origin: expected a yaw in radians"),
        ({"origin": [0.0]}, "origin: expected"),
        ({"origin": "here"}, "origin: expected"),
        ({"origin": [0, ".nan", 0]}, "origin: expected a number"),
        ({"resolution": None}, "resolution: missing, expected a map_server .yaml"),
        ({"resolution": 0.0}, "resolution: expected metres per pixel above 0"),
        ({"resolution": True}, "resolution: expected a number, got True"),
        ({"resolution": int("1" * 400)}, "resolution: expected a number, got 1111"),
        ({"resolution": 500.0}, "resolution: expected metres per pixel above 0 and up to 100"),
        ({"resolution": "wide"}, "resolution: expected a number"),
        ({"image": None}, "image: missing, expected a map_server .yaml"),
        ({"image": ["a"]}, "image: expected the name of a picture"),
        ({"image": "gone.pgm"}, r"image: gone\.pgm does not exist"),
        ({"mode": "fancy"}, "mode: expected one of trinary, scale, raw, got 'fancy'"),
        ({"negate": 2}, "negate: expected 0 or 1"),
        ({"free_thresh": 0.9}, r"free_thresh <= occupied_thresh <= 1, got free_thresh 0\.9 and occupied_thresh 0\.65"),
        ({"occupied_thresh": "high"}, "occupied_thresh: expected a number"),
    ],
)
def test_wrong_keys_are_named_for_every_use(tmp_path, keys, message):
    path = write(tmp_path, p5(PLAN), **keys)
    for reader in (read_map, worlds.import_map):
        with pytest.raises(MapFileError, match=rf"map\.yaml: .*{message}") as caught:
            reader(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["a: [", "- 1", "", "image: [[[", "a: &a [x, x]\nimage: [*a, *a]", "\0", "? [1]: 2", "!!python/none x"]
)
def test_what_is_no_map_file_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(MapFileError, match=r"map\.yaml: .*expected") as caught:
        read_map_file(tmp_path / "map.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["image: *a", "a: &a [x]\nimage: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nb: *a", "a: &a {b: *a}"]
)
def test_aliases_are_refused_whatever_they_stand_for(tmp_path, text):
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(MapFileError, match=r"an alias"):
        read_map_file(tmp_path / "map.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image: a.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nresolution: 0.1\n", "the key resolution stands twice"),
        ("image: a.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n---\nimage: b.pgm\n", "2 documents"),
        ("map_server:\n  image: a.pgm\n", "image: missing, .* there is: map_server$"),
        ("header: 1\ninfo: {width: 2}\ndata: [0, 100]\n---\n", "there is: header, info, data; .* with map_saver$"),
    ],
)
def test_keys_in_doubt_are_refused_with_those_that_are_there(tmp_path, text, message):
    path = tmp_path / "map.yaml"
    path.write_text(text)
    with pytest.raises(MapFileError, match=message):
        read_map_file(path)


def test_a_picture_whose_name_differs_in_capitals_is_read(tmp_path):
    path = write(tmp_path, p5(PLAN), "Map.PGM", image="map.pgm")
    (note,) = check(path, notes=1)
    assert "image: map.pgm does not exist here" in note


def test_a_byte_order_mark_and_a_last_separator_change_nothing(tmp_path):
    path = write(tmp_path, p5(PLAN))
    path.write_bytes(b"\xef\xbb\xbf---\n" + path.read_bytes() + b"---\n")
    check(path)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"origin": [-4.5, -3.5, 5]}, "a yaw of 5 turns the map by 286 degrees"),
        ({"resolution": 5}, "cells of 5 m, is this in metres"),
    ],
)
def test_numbers_that_are_hardly_meant_add_a_note_for_every_use(tmp_path, keys, message):
    (note,) = read_map_file(write(tmp_path, p5(PLAN), **keys)).notes
    assert message in note


def test_messages_quote_little_of_a_long_file(tmp_path):
    lists = "[" * 30 + "x" * 10**5 + "]" * 30
    for text in (
        f"image: {lists}\nresolution: 0.05\norigin: [0, 0, 0]",
        f"resolution: {'q' * 10**5}",
        "a" * 10**5 + ": [",
    ):
        (tmp_path / "map.yaml").write_text(text)
        with pytest.raises(MapFileError) as caught:
            read_map_file(tmp_path / "map.yaml")
        assert len(str(caught.value)) < len(str(tmp_path)) + 350


def test_a_missing_and_a_huge_file_are_refused(tmp_path):
    with pytest.raises(MapFileError, match=r"map\.yaml: No such file"):
        read_map_file(tmp_path / "map.yaml")
    (tmp_path / "map.yaml").write_text("#" * 2_000_000)
    with pytest.raises(MapFileError, match="2000000 bytes"):
        read_map_file(tmp_path / "map.yaml")


def test_a_picture_of_bad_values_names_the_picture(tmp_path):
    negative = np.where(PLAN == UNKNOWN, -1, PLAN.astype(int))
    with pytest.raises(MapFileError, match=r"map\.pgm: .*negative: -1"):
        read_map_file(write(tmp_path, p2(negative)))
    with pytest.raises(MapFileError, match=r"map\.pgm: .*too large.*70000"):
        read_map_file(write(tmp_path, p2(np.where(PLAN == FREE, 70000, PLAN.astype(int)))))
