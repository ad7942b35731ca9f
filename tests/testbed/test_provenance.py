# SPDX-License-Identifier: MIT
"""What config.toml says of the versions that a result depends on."""

import pytest

from testbed import provenance


@pytest.mark.parametrize(
    ("installed", "said"),
    [
        ({"pybullet": "3.2.7"}, "3.2.7"),
        ({"pybullet-arm64": "3.2.8"}, "3.2.8 (pybullet-arm64)"),
        ({}, "not installed"),
    ],
)
def test_the_fork_of_pybullet_is_named(monkeypatch, installed, said):
    monkeypatch.setattr(provenance, "_version", lambda package: installed.get(package, provenance.MISSING))
    assert provenance.versions()["pybullet"] == said
