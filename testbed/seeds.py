# SPDX-License-Identifier: MIT
"""The seed of a run, split once into independent streams of random numbers, one for each part of the run.

A change of one part does not change the random numbers of the others. Seeds are split in this module only.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from numpy.random import SeedSequence

Stream = SeedSequence
"""Seed of one part of a run; `numpy.random.default_rng` makes its generator."""


@dataclass(frozen=True, kw_only=True)
class RunSeeds:
    """The streams of one run, made by `from_seed`."""

    seed: int
    """The number that the user gave, not negative."""
    world: Stream = field(compare=False, repr=False)
    """Reserved for generated worlds; nothing reads it yet."""
    start: Stream = field(compare=False, repr=False)
    """Reserved for start poses; nothing reads it yet."""
    odometry: Stream = field(compare=False, repr=False)
    """Wheel encoders and odometry errors."""
    lidar: Stream = field(compare=False, repr=False)
    """Lidar noise; further lidars use children of it."""
    movers: Stream = field(compare=False, repr=False)
    """People and doors."""
    filter: Stream = field(compare=False, repr=False)
    """The particle filter."""
    driver: Stream = field(compare=False, repr=False)
    """Drivers that act at random."""
    route: Stream = field(compare=False, repr=False)
    """The route through the world, where it is random."""
    perturbation: Stream = field(compare=False, repr=False)
    """Perturbations of the recording (`testbed.stress.table`)."""
    surface: Stream = field(compare=False, repr=False)
    """Roughness of surfaces."""

    @classmethod
    def from_seed(cls, seed: int) -> RunSeeds:
        """Split a seed. New streams may only be added at the end, because their order decides the numbers.

        Raises ValueError for a negative seed.
        """
        if seed < 0:
            raise ValueError(f"seed must not be negative, got {seed}")
        streams = children(SeedSequence(seed), 10)
        world, start, odometry, lidar, movers, filter_, driver, route, perturbation, surface = streams
        return cls(
            seed=seed,
            world=world,
            start=start,
            odometry=odometry,
            lidar=lidar,
            movers=movers,
            filter=filter_,
            driver=driver,
            route=route,
            perturbation=perturbation,
            surface=surface,
        )


def children(stream: Stream, count: int) -> list[Stream]:
    """Return the first `count` children of a stream, the same ones at every call.

    They equal those of the first call of `SeedSequence.spawn`, but the stream is not changed and can be used again.
    """
    return [SeedSequence(stream.entropy, spawn_key=(*stream.spawn_key, number)) for number in range(count)]


def world_stream(number: int, split: int) -> Stream:
    """Return the stream that draws world `number` of one split of a collection of generated worlds."""
    return SeedSequence((number, split))
