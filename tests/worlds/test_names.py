# SPDX-License-Identifier: MIT
"""Names and lists of worlds."""

import pytest

import worlds
from worlds import WorldError, expand_names, family, label


def test_a_list_names_catalogue_files_and_generated_worlds():
    names = expand_names(" office, my.world.toml,generated:rooms*3 ,generated:cave:7")
    assert names == [
        "office",
        "my.world.toml",
        "generated:rooms:0",
        "generated:rooms:1",
        "generated:rooms:2",
        "generated:cave:7",
    ]
    assert expand_names(names) == names
    assert [label(name) for name in names] == ["office", "my.world", "rooms-0", "rooms-1", "rooms-2", "cave-7"]
    assert [family(name) for name in names] == [None, None, "rooms", "rooms", "rooms", "cave"]


def test_a_generated_name_loads_the_world_of_the_generator():
    world = worlds.load("generated:loops:size=30x20:clutter=0.5:loops=4:7")
    made = worlds.generate("loops", size=(30.0, 20.0), clutter=0.5, loops=4, seed=7)
    assert world.name == "loops-size30x20-clutter0.5-loops4-7"
    assert world.model_copy(update={"name": made.name}) == made
    assert worlds.load("generated:maze") == worlds.load("generated:maze:0").model_copy(update={"name": "maze-0"})
    assert worlds.load("generated:maze:1").tour != worlds.load("generated:maze:2").tour


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (" , ", "the list of worlds is empty"),
        ("generated:castle", "unknown kind of world 'castle'"),
        ("generated:castle*3", "unknown kind of world 'castle'"),
        ("generated:rooms*0", "number of worlds from 1 to 1000"),
        ("generated:rooms*1000000000", "number of worlds from 1 to 1000"),
        ("generated:rooms*many", "number of worlds from 1 to 1000"),
        ("generated:rooms:3*5", "has a seed and a number of worlds"),
        ("generated:rooms*600,generated:cave*600", "1200 worlds, expected at most 1000"),
    ],
)
def test_bad_lists_are_refused_in_one_line(text, complaint):
    with pytest.raises(WorldError, match=complaint) as refused:
        expand_names(text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("generated:rooms:-1", "'-1', expected generated:KIND"),
        ("generated:rooms:colour=red:1", "'colour=red', expected"),
        ("generated:rooms:loops=2:loops=3:1", "'loops=3', expected"),
        ("generated:rooms:7:loops=2", "'7', expected"),
        ("generated:rooms:loops=many", "loops=many: expected a whole number"),
        ("generated:rooms:size=30", "size=: expected a number"),
        ("generated:rooms:size=3000x20", "size 3000 x 20 m, expected sides of"),
        ("generated:rooms:clutter=nan", "clutter nan"),
    ],
)
def test_bad_generated_names_are_refused(name, complaint):
    with pytest.raises(WorldError, match=complaint):
        worlds.load(name)
