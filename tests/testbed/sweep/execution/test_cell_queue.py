# SPDX-License-Identifier: MIT
"""Workers take the cells of one recording together."""

from dataclasses import replace
from itertools import groupby

import pytest

from testbed.sweep.execution import recordings
from testbed.sweep.execution.cell_queue import CellQueue
from testbed.sweep.execution.dask_cluster import MAX_BATCH, batches
from testbed.sweep.execution.recordings import recording_of
from testbed.sweep.spec.cell import recording_key
from tests.testbed.sweep.room import room_cell, room_file


@pytest.fixture
def cells(tmp_path):
    """Three seeds of one world with four counts each, the most work first."""
    cell = room_cell(room_file(tmp_path))
    return [replace(cell, particles=n, seed=seed) for n in (8, 4, 2, 1) for seed in (0, 1, 2)]


def taken_by_turns(cells, workers):
    """Which cells each worker takes if all take one after the other."""
    waiting, keys, taken = CellQueue(cells, recording_key), [None] * workers, [[] for _ in range(workers)]
    for turn in range(len(cells)):
        worker = turn % workers
        keys[worker], cell = waiting.take(keys[worker])
        taken[worker].append(cell)
    assert waiting.take(None) is None
    return taken


def test_one_worker_takes_one_recording_after_the_other(cells):
    (taken,) = taken_by_turns(cells, 1)
    assert [seed for seed, _ in groupby(taken, key=lambda cell: cell.seed)] == [0, 1, 2]
    assert [cell.particles for cell in taken] == [8, 4, 2, 1] * 3


def test_workers_share_a_recording_only_when_no_other_is_left(cells):
    taken = taken_by_turns(cells, 2)
    assert [cell.seed for cell in taken[0]] == [0] * 4 + [2] * 2
    assert [cell.seed for cell in taken[1]] == [1] * 4 + [2] * 2
    assert sorted(cell.key for part in taken for cell in part) == sorted(cell.key for cell in cells)


def test_a_cleared_queue_gives_nothing(cells):
    waiting = CellQueue(cells, recording_key)
    waiting.clear()
    assert waiting.take(None) is None


def test_cells_of_one_recording_are_simulated_once(cells, monkeypatch):
    simulated = []
    original = recordings.simulate
    monkeypatch.setattr(recordings, "simulate", lambda *what: simulated.append(what) or original(*what))
    recordings._driven.cache_clear()
    (taken,) = taken_by_turns(cells, 1)
    for cell in taken:
        recording_of(cell)
    assert len(simulated) == 3


def test_the_recording_depends_on_simulator_and_seed_only(cells):
    key = recording_key(cells[0])
    filtered = replace(cells[0], settings={"refine": True, "filter.proposal.kind": "motion"}, particles=99)
    assert recording_key(filtered) == key
    assert recording_key(replace(cells[0], settings={"lidar": "lds01"})) != key
    assert recording_key(replace(cells[0], seed=9)) != key


@pytest.mark.parametrize(("threads", "sizes"), [(1, [4, 4, 4]), (2, [3, 1] * 3), (100, [1] * 12)])
def test_batches_for_a_cluster_hold_one_recording_each(cells, threads, sizes):
    parts = batches(cells, threads)
    assert [len(part) for part in parts] == sizes
    assert all(len({recording_key(cell) for cell in part}) == 1 for part in parts)
    assert sorted(cell.key for part in parts for cell in part) == sorted(cell.key for cell in cells)


def test_batches_are_bounded(cells):
    many = [replace(cells[0], particles=n) for n in range(1, 2 * MAX_BATCH + 2)]
    assert [len(part) for part in batches(many, 1)] == [MAX_BATCH, MAX_BATCH, 1]
