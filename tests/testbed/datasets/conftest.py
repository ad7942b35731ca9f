# SPDX-License-Identifier: MIT
"""A collection that the tests read, and never change."""

import pytest

from tests.testbed.datasets.small_collection import make_collection


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("made") / "data"
    make_collection(path)
    return path
