# SPDX-License-Identifier: MIT
"""Names from files never lead out of the directory that they name something in."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from worlds import World, WorldError, load
from worlds.file_names import MAX_LENGTH, is_name, to_name

BAD = ["", ".", "..", "../x", "/tmp/x", "a/b", "a\\b", "-x", ".x", " x", "a\nb", "a\0b", "a:b", "x" * (MAX_LENGTH + 1)]
GOOD = ["office", "long_corridor", "rooms train 7", "a.b-c_d", "7", "Küche", "x" * MAX_LENGTH]


@pytest.mark.parametrize("name", GOOD)
def test_names_of_letters_and_digits_are_names(name):
    assert is_name(name)
    assert to_name(name) == name
    assert World(name=name).name == name


@pytest.mark.parametrize("name", BAD)
def test_anything_else_is_refused(name, tmp_path):
    assert not is_name(name)
    with pytest.raises(ValueError, match="expected a name of 1 to 100 letters"):
        World(name=name)


def test_the_message_names_file_line_and_rule(tmp_path):
    file = tmp_path / "evil.toml"
    file.write_text('name = "../../x"\n')
    with pytest.raises(WorldError) as caught:
        load(file)
    assert str(caught.value) == (
        f"{file}: line 1: name = '../../x', expected a name of 1 to 100 letters, digits, spaces, '-', '_' and '.', "
        "the first a letter or digit"
    )


@given(st.text(max_size=300))
def test_every_text_has_a_name_that_stays_in_its_directory(text):
    name = to_name(text)
    assert is_name(name)
    assert to_name(name) == name
    assert (Path("/base") / name).parent == Path("/base")
    assert ".." not in Path(name).parts
