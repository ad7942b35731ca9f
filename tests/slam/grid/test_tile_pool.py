# SPDX-License-Identifier: MIT
"""Tiles shared copy-on-write: nobody can tell them from copies, and none is lost."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from slam._threads import Threads
from slam.grid._tile_kernels import FINE_SIDE, SIDE
from slam.grid.tile_pool import TilePool
from slam.sensor.rays import Rays
from tests.slam.rooms import counts_of, empty_maps


def assert_accounts_balance(pool):
    """Every tile is either in use, with as many references as table entries, or in the free list, once."""
    named = np.bincount(pool.table.ravel(), minlength=len(pool.references))
    np.testing.assert_array_equal(pool.references[1:], named[1:])
    free = pool._free[: pool._free_count]
    assert len(np.unique(free)) == len(free)
    assert set(free.tolist()) == set(np.flatnonzero(pool.references == 0).tolist())
    assert pool.tiles_in_use == np.count_nonzero(named[1:])
    assert not any(array[0].any() for array in pool.data)  # the empty tile stays empty
    assert not pool.request.seen.any()
    assert not pool.request.count.any()


class NaiveCopies(RuleBasedStateMachine):
    """The pool beside particles that own plain arrays and copy them whole."""

    PARTICLES = 3
    MOST = 5
    SIDES = st.integers(0, 1)

    @initialize(rows=st.integers(1, 3), columns=st.integers(1, 3))
    def begin(self, rows, columns):
        self.threads = Threads(1)
        self.pool = TilePool(self.PARTICLES, [(np.int32, SIDE * SIDE), (np.int16, SIDE * SIDE)])
        self.pool.extend(rows, 0, columns, 0)
        self.copies = np.zeros((self.PARTICLES, rows, columns, SIDE * SIDE), np.int32)
        self.value = 0

    @rule(data=st.data())
    def write(self, data):
        """Each particle writes a new value into some cells, after it has asked for their tiles."""
        rows, columns = self.copies.shape[1:3]
        places = st.sets(st.integers(0, rows * columns - 1), max_size=4)
        wanted = [sorted(data.draw(places)) for _ in self.copies]
        request = self.pool.request
        for particle, tiles in enumerate(wanted):
            request.tiles[particle, : len(tiles)] = tiles
            request.count[particle] = len(tiles)
            request.seen[particle, tiles] = 1
        self.pool.copy_on_write(self.threads)
        writers = [self.pool.table[p].ravel()[place] for p, tiles in enumerate(wanted) for place in tiles]
        assert len(set(writers)) == len(writers)  # no tile has two writers
        for particle, tiles in enumerate(wanted):
            for place in tiles:
                self.value += 1
                cell = self.value * 37 % (SIDE * SIDE)
                for array in self.pool.data:
                    array[self.pool.table[particle].ravel()[place], cell] = self.value
                self.copies[particle, place // columns, place % columns, cell] = self.value

    @rule(data=st.data())
    def resample(self, data):
        """To as many particles as before, to more or to fewer."""
        ancestor = st.integers(0, len(self.copies) - 1)
        ancestors = data.draw(st.lists(ancestor, min_size=1, max_size=self.MOST))
        self.pool.inherit(np.array(ancestors))
        self.copies = self.copies[ancestors]

    @rule(below=SIDES, above=SIDES, left=SIDES, right=SIDES)
    def grow(self, below, above, left, right):
        if self.copies.shape[1] + below + above <= 6 and self.copies.shape[2] + left + right <= 6:
            self.pool.extend(below, above, left, right)
            self.copies = np.pad(self.copies, ((0, 0), (below, above), (left, right), (0, 0)))

    @invariant()
    def same_content(self):
        for array in self.pool.data:
            np.testing.assert_array_equal(array[self.pool.table], self.copies)

    @invariant()
    def nothing_is_lost(self):
        assert_accounts_balance(self.pool)


TestNaiveCopies = NaiveCopies.TestCase
TestNaiveCopies.settings = settings(deadline=None, max_examples=20, stateful_step_count=15)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=15)
def test_maps_of_particles_equal_maps_kept_apart(seed):
    """After any scans and resampling each particle's map is the one that its own history draws."""
    rng = np.random.default_rng(seed)
    particles = 4
    maps = empty_maps(particles, cell=0.1)
    histories = [[] for _ in range(particles)]
    for _ in range(8):
        poses = rng.normal(scale=(1.0, 1.0, 1.0), size=(particles, 3))
        n = int(rng.integers(1, 12))
        rays = Rays(np.zeros((n, 2)), rng.uniform(-4.0, 4.0, (n, 2)), rng.random(n) < 0.7)
        maps.integrate_scan(poses, rays)
        histories = [[*history, (pose, rays)] for history, pose in zip(histories, poses, strict=True)]
        if rng.random() < 0.5:
            ancestors = np.sort(rng.integers(0, particles, particles))
            maps.inherit(ancestors)
            histories = [histories[a] for a in ancestors]
        for pool in maps._pools:
            assert_accounts_balance(pool)
    for particle, history in enumerate(histories):
        alone = empty_maps(1, cell=0.1)
        for pose, rays in history:
            alone.integrate_scan(pose[None], rays)
        together, apart = maps.occupancy(particle), alone.occupancy(0)
        np.testing.assert_array_equal(together.probability, apart.probability)
        np.testing.assert_allclose(together.origin, apart.origin)
        assert counts_of(maps, particle)[1].sum() == counts_of(alone)[1].sum()


def test_resampling_copies_no_tile_and_frees_those_of_the_dead():
    maps = empty_maps(4, cell=0.1)
    ends = np.random.default_rng(0).uniform(-5.0, 5.0, (50, 2))
    rays = Rays(np.zeros((50, 2)), ends, np.ones(50, bool))
    maps.integrate_scan(np.zeros((4, 3)), rays)
    one = empty_maps(1, cell=0.1)
    one.integrate_scan(np.zeros((1, 3)), rays)
    assert maps._counts.tiles_in_use == 4 * one._counts.tiles_in_use
    maps.inherit(np.array([2, 2, 2, 2]))
    assert maps._counts.tiles_in_use == one._counts.tiles_in_use
    assert maps._field.tiles_in_use == one._field.tiles_in_use
    sizes = []
    for _ in range(20):  # freed tiles are used again; the pool has room for one scan of all particles to spare
        maps.integrate_scan(np.zeros((4, 3)), rays)
        maps.inherit(np.array([0, 0, 0, 0]))
        sizes.append(len(maps._counts.references))
    assert sizes[-1] == sizes[1]


def test_memory_is_that_of_the_tiles_in_use_and_the_tables():
    maps = empty_maps(3, cell=0.1)
    assert maps.bytes_in_use == 0
    maps.integrate_scan(np.zeros((3, 3)), Rays(np.zeros((1, 2)), np.array([[0.55, 0.05]]), np.ones(1, bool)))
    rows, columns = maps.grids.table.shape[1:]
    tables = 3 * (1 + 4 + 1) * rows * columns * 4  # the surface has four fine tiles where the others have one
    counts, surface, field = (pool.tiles_in_use for pool in maps._pools)
    assert counts == surface == 3
    words = SIDE * SIDE * (counts * 2 + field) + FINE_SIDE * FINE_SIDE * surface * 4
    assert maps.bytes_in_use == tables + words + SIDE * counts * 2
