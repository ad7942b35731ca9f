# SPDX-License-Identifier: MIT
"""One seed, several independent streams of random numbers: changing one part leaves the noise of the others alone."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.random import SeedSequence


@dataclass(frozen=True, kw_only=True)
class Streams:
    """Seeds of the parts of a run, made by `streams`. Pass each to `numpy.random.default_rng` in its part alone."""

    world: SeedSequence
    """Generated worlds."""
    start: SeedSequence
    """Start poses."""
    odometry: SeedSequence
    """Wheel encoders and odometry errors."""
    lidar: SeedSequence
    """Lidar noise."""
    movers: SeedSequence
    """People and doors."""
    filter: SeedSequence
    """The particle filter."""
    driver: SeedSequence
    """Drivers that act at random."""


def streams(seed: int) -> Streams:
    """The streams of `seed` (not negative). New streams may only be added at the end: the order decides the bits."""
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    world, start, odometry, lidar, movers, filter_, driver = SeedSequence(seed).spawn(7)
    return Streams(
        world=world, start=start, odometry=odometry, lidar=lidar, movers=movers, filter=filter_, driver=driver
    )
