# SPDX-License-Identifier: MIT
"""An exploring robot touches nothing, in ten worlds and on both backends."""

import pytest

from tools.measure.measure_collisions import WORLDS, explore

SEEDS = 10


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("backend", ["fast", "pybullet"])
@pytest.mark.parametrize("world", WORLDS)
def test_two_hundred_explorations_touch_nothing(world, backend):
    touched = [seed for seed in range(SEEDS) if explore(world, seed, backend, 200.0).collided]
    assert touched == []
