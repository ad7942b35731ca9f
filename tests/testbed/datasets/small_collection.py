# SPDX-License-Identifier: MIT
"""A small collection, and the values that it draws."""

from tests.shell import call

DRAWS = ("--draw", "lidar=lds01,rplidar_a2", "--draw", "noise=0.5..2")


def make_collection(path):
    """Write three short drives in each of three worlds."""
    common = ("--duration", "6", "--format", "parquet", "--out", path)
    assert call("simulate", "office,loop,generated:maze:1", "--count", "3", *DRAWS, *common) == 0
