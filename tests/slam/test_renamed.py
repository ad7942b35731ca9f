# SPDX-License-Identifier: MIT
"""Settings by the names of the last release."""

from dataclasses import fields

import pytest

from slam.config import AdaptConfig, LocalizationConfig, RefineConfig
from slam.config.renamed import ESTIMATED, RENAMED, present_name, with_present_names

GROUPS = {"filter.adapt": AdaptConfig, "filter.refine": RefineConfig, "localization": LocalizationConfig}


@pytest.mark.parametrize("old", RENAMED)
def test_every_new_name_is_a_setting_and_no_old_one_is(old):
    group, _, name = old.rpartition(".")
    names = {field.name for field in fields(GROUPS[group])}
    assert RENAMED[old] in names
    assert name not in names
    assert present_name(old) == f"{group}.{RENAMED[old]}"


def test_nested_settings_keep_their_values_and_the_new_name_wins():
    given = {"filter": {"adapt": {"least": 3, "most": 9, "max_particles": 8}, "map": {"cell": 0.1}}, "seed": 1}
    expected = {"filter": {"adapt": {"min_particles": 3, "max_particles": 8}, "map": {"cell": 0.1}}, "seed": 1}
    assert with_present_names(given) == expected
    assert with_present_names(expected) == expected
    assert with_present_names(given["filter"], "filter.") == expected["filter"]


@pytest.mark.parametrize("gone", sorted(ESTIMATED))
def test_settings_that_are_estimated_now_are_read_and_left_out(gone):
    _, _, name = gone.split(".")
    assert with_present_names({"filter": {"refine": {name: 0.03, "rounds": 4}}}) == {
        "filter": {"refine": {"rounds": 4}}
    }
    assert with_present_names({"filter": {"match": {name: 0.03}}}) == {"filter": {"match": {name: 0.03}}}
