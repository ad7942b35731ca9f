# SPDX-License-Identifier: MIT
"""World files: what is read, and one clear line for everything that is wrong."""

import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

import worlds
from worlds.format.files import parse

GOOD = """
name = "room"
start = { x = 1.0, y = 1.0 }

[[walls]]
name = "outline"
points = [[0, 0], [6, 0], [6, 4], [0, 4]]
closed = true
thickness = 0.2

[[boxes]]
name = "desk"
x = 3.0
y = 3.0
width = 1.2
depth = 0.6
rotation = 0.1

[tour]
points = [[5, 1]]
"""


def load_text(tmp_path, text, **options):
    path = tmp_path / "room.toml"
    path.write_text(text)
    return worlds.load(path, **options)


def test_a_good_file_is_read(tmp_path):
    world = load_text(tmp_path, GOOD, footprint_radius=0.3)
    assert (world.name, len(world.elements), world.boxes[0].rotation) == ("room", 2, 0.1)


@pytest.mark.parametrize("name", worlds.catalogue())
def test_every_catalogue_world_can_be_driven_by_a_robot_of_40_cm(name):
    world = worlds.load(name, footprint_radius=0.25)
    assert world.name == name
    assert world.description
    assert world.tour is not None


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("rotation = 0.1", "rotaton = 0.1", ["room.toml", "line 17", "boxes[0].rotaton", "expected 'rotation'"]),
        ("width = 1.2", "widht = 1.2", ["line 15", "boxes[0].widht is not known", "expected 'width'"]),
        ("rotation = 0.1", "rotation = 90", ["line 17", "boxes[0].rotation = 90", "radians"]),
        ("x = 3.0", "x = 3000.0", ["line 13", "boxes[0].x = 3000.0", "metres"]),
        ("x = 3.0", 'x = "3 m"', ["line 13", "boxes[0].x = '3 m'", "a valid number"]),
        ("x = 3.0", 'x = "3"', ["line 13", "boxes[0].x = '3'", "a valid number"]),
        ("x = 3.0", "x = true", ["boxes[0].x = True", "a valid number"]),
        ("width = 1.2\n", "", ["boxes[0].width is missing"]),
        ("width = 1.2", "width = -1.2", ["boxes[0].width = -1.2", "greater than 0"]),
        ("width = 1.2", "width = nan", ["boxes[0].width = nan"]),
        ("[tour]", "[tuor]", ["line 19", "tuor is not known", "expected 'tour'"]),
        ("closed = true", "closed = false", ["outline about start", "not closed"]),
        ("x = 1.0, y = 1.0", "x = 3.0, y = 3.0", ["start (3, 3) m", "box 'desk'", "expected a free place"]),
        ("x = 1.0, y = 1.0", "x = 9.0, y = 1.0", ["not closed"]),
        ("points = [[5, 1]]", "points = [[5, 3.5]]", ["tour from (1, 1) to (5, 3.5)", "'desk'", "footprint"]),
        ("points = [[5, 1]]", "points = [[8, 1]]", ["tour from (1, 1) to (8, 1)", "'outline'"]),
        ("points = [[5, 1]]", "points = [[5, 1]]\nlaps = 2", ["laps = 2 needs closed = true"]),
        (
            "[tour]",
            "[[polygons]]\nname = 'bow tie'\npoints = [[4, 1], [5, 2], [5, 1], [4, 2]]\n[tour]",
            ["polygons[0] 'bow tie'", "expected an outline that does not cross itself"],
        ),
        ('name = "room"', 'name = "room', ["room.toml", "line 2", "expected TOML"]),
    ],
)  # fmt: skip
def test_bad_files_are_explained_in_one_line(tmp_path, old, new, parts):
    assert old in GOOD
    with pytest.raises(worlds.WorldError) as caught:
        load_text(tmp_path, GOOD.replace(old, new, 1), footprint_radius=0.2)
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_unknown_names_get_the_nearest_ones():
    with pytest.raises(worlds.WorldError, match=r"unknown world 'ofice'.*office"):
        worlds.load("ofice")


def test_missing_and_huge_files_are_refused(tmp_path):
    with pytest.raises(worlds.WorldError, match=r"gone\.toml: No such file"):
        worlds.load(tmp_path / "gone.toml")
    huge = tmp_path / "huge.toml"
    huge.write_bytes(b"#" * 8_000_001)
    with pytest.raises(worlds.WorldError, match="expected at most 8000000"):
        worlds.load(huge)


def test_a_long_value_is_shortened_and_what_was_expected_is_said():
    table = {"name": "s", "start": {"x": 0.0, "y": 0.0}, "walls": [{"points": [[0.0, 0.0], [1.0, 0.0]]}]}
    table["tour"] = {"points": [[0.001 * k, 0.0] for k in range(2000)], "closed": True, "laps": 1000}
    with pytest.raises(worlds.WorldError, match=r"\.\.\.\]\}: 1000 laps of 2000 way points are") as raised:
        parse(tomli_w.dumps(table), "long.toml")
    assert len(str(raised.value)) < 400


def test_deep_nesting_is_refused():
    with pytest.raises(worlds.WorldError):
        parse("walls = " + "[" * 100_000, "bomb")
    with pytest.raises(worlds.WorldError):
        parse("a." * 5_000 + "b = 1", "bomb")


@given(st.text(max_size=200), st.integers(0, len(GOOD) - 1))
@settings(deadline=None)
def test_any_damage_is_a_world_error_or_a_world(garbage, at):
    message = ""
    try:
        assert parse(GOOD[:at] + garbage + GOOD[at + len(garbage) :], "damaged").name
    except worlds.WorldError as error:
        message = str(error)
    assert "\n" not in message
