# SPDX-License-Identifier: MIT
"""Groups of settings: a changed setting must leave the others at the defaults that `--help` states."""

import dataclasses

import pytest

from slam.config import LocalizationConfig
from testbed.settings.estimator import EstimatorOptions
from testbed.settings.simulator import SimulatorOptions


def groups_of(settings, name):
    """Name and value of every nested dataclass, the outermost included."""
    yield name, settings
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if dataclasses.is_dataclass(value):
            yield from groups_of(value, f"{name}.{field.name}")


SETTINGS = {"estimator": EstimatorOptions(), "simulator": SimulatorOptions(), "localization": LocalizationConfig()}
GROUPS = [group for name, settings in SETTINGS.items() for group in groups_of(settings, name)]


@pytest.mark.parametrize("group", [value for _, value in GROUPS], ids=[name for name, _ in GROUPS])
def test_the_defaults_of_a_group_are_those_of_its_class(group):
    """The command line makes a group anew from its class where one of its settings is given."""
    assert group == type(group)()
