# SPDX-License-Identifier: MIT
"""Seeds are added only where the answer is open, and looking several times gives no more wrong answers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from eval.sweep.decision import decide
from eval.sweep.results import read_sweep
from eval.sweep.summary import summarise
from testbed.sweep import looks
from testbed.sweep.errors import SweepError
from testbed.sweep.gather import gather
from testbed.sweep.looks import is_hopeless, look_at, needed_cells, planned, statuses
from testbed.sweep.result import CellResult
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.spec import parse_spec
from testbed.sweep.store import Manifest, SweepDirectory


def directory_of(folder: Path, worlds, seeds=24, **options):
    usual = {"particles": [1, 5], "until": "decided", "settings": {"refine": False}}
    spec = parse_spec(
        {"worlds": worlds, "seeds": seeds} | usual | options,
        "x.toml",
        Path(),
    )
    return SweepDirectory.prepare(folder / "sweep", Manifest(spec, code_version(), {}))


def store(directory, cells, error):
    """Store a result for each cell; error(place, particles, seed) [m]."""
    for cell in cells:
        metrics = {
            "outcome_filter": "ok",
            "trajectory_filter": {"ate_rmse_m": error(cell.place, cell.particles, cell.seed)},
            "filter": {"updates": 1},
        }
        curves = {name: [0.5] for name in ("share", "ess", "unique_ancestors", "nees")}
        directory.keep(cell, CellResult(metrics, curves, {"filter_s": 1.0, "cell_s": 1.0}))


def carried_out(directory, error) -> dict[str, int]:
    """Compute what is needed until nothing is; number of seeds of each place."""
    while todo := [cell for cell in needed_cells(directory) if not directory.is_done(cell.key)]:
        store(directory, todo, error)
    cells = [cell for cell in directory.manifest.cells() if directory.is_done(cell.key)]
    return {place: len({c.seed for c in cells if c.place == place}) for place in dict.fromkeys(c.place for c in cells)}


def clear(place, particles, seed):
    """In office both counts are equal, in loop the difference is a little below the limit of 5 mm and noisy."""
    if place == "office":
        return 0.02
    return 0.02 if particles == 5 else 0.023 + 0.004 * ((5 * seed) % 8 - 3.5) / 3.5


def at_the_limit(place, particles, seed):
    """The difference is exactly at the limit in loop: no number of seeds will show on which side it lies."""
    return 0.02 if place == "office" or particles == 5 else 0.025 + 0.004 * (-1) ** seed


def test_only_open_answers_get_more_seeds(tmp_path):
    directory = directory_of(tmp_path, ["office", "loop"])
    assert directory.manifest.spec.looks == (8, 16, 24)
    first = needed_cells(directory)
    assert {cell.seed for cell in first} == set(range(8))
    assert len(first) == 2 * 2 * 8
    assert carried_out(directory, clear) == {"office": 8, "loop": 24}
    gathered = gather(directory, statuses(directory))
    assert (gathered.done, gathered.complete) == (2 * 8 + 2 * 24, True)


def smaller(place, particles, seed):
    """15 are as good as 30; 5 are too, which more than 8 seeds show; 1 is worse."""
    noise = 0.004 * ((5 * seed) % 8 - 3.5) / 3.5
    return {1: 0.08, 5: 0.023 + noise, 15: 0.02, 30: 0.02}[particles]


def test_a_world_with_an_answer_goes_on_to_smaller_counts_where_that_is_asked(tmp_path):
    """In the directory of a sweep that ended with its first answer; the answer that was given stays."""
    directory = directory_of(tmp_path, ["loop"], seeds=40, particles=[1, 5, 15, 30])
    assert carried_out(directory, smaller) == {"loop": 8}
    assert decision_of(directory).count == 15
    further = parse_spec(directory.manifest.spec.document() | {"until": "smallest"}, "x.toml", Path())
    directory = SweepDirectory.prepare(directory.path, Manifest(further, code_version(), {}))
    assert {cell.seed for cell in needed_cells(directory)} == set(range(16))
    seeds = carried_out(directory, smaller)["loop"]
    assert 16 <= seeds < 40
    found = decision_of(directory)
    assert (found.count, found.states, found.largest_open) == (5, ("worse", "good", "good"), None)
    assert found.differences[2].count == 8
    assert {states_of(directory, "status")[seed] for seed in range(seeds, 40)} == {"not needed"}


def decision_of(directory):
    look_at(directory)  # writes the tables
    return summarise(read_sweep(directory.path).judged()).decision("loop", "default")


def test_a_world_that_cannot_be_decided_gets_no_more_seeds(tmp_path):
    directory = directory_of(tmp_path, ["office", "loop"])
    assert carried_out(directory, at_the_limit) == {"office": 8, "loop": 16}
    states = statuses(directory)
    words = {cell.place: states[cell.key] for cell in directory.manifest.cells() if cell.seed == 20}
    assert words == {"office": "not needed", "loop": "given up"}
    assert look_at(directory).given_up == {("loop", "default")}


def late(place, particles, seed):
    """Office is decided by 16 seeds, not by 8; of loop 40 seeds may tell, 16 hardly."""
    if place == "loop":
        return 0.02 if particles == 5 else 0.0236 + 0.004 * (-1) ** seed
    return 0.02 + (0.02 if particles == 1 and seed < 1 else 0.0)


def test_a_low_limit_gives_no_world_up(tmp_path):
    """It is a matter of time, and may be raised: what is hopeless with 16 seeds need not be with 40."""
    directory = directory_of(tmp_path, ["office", "loop"], seeds=16)
    assert carried_out(directory, late) == {"office": 16, "loop": 16}


def test_a_world_that_has_its_answer_gets_no_more_seeds_while_another_one_is_behind(tmp_path):
    """Loop was given up after the first look, and is taken up again after the last one of office."""
    directory = directory_of(tmp_path, ["office", "loop"], seeds=40)
    store(directory, needed_cells(directory), late)
    document = directory.manifest.spec.document()
    left = parse_spec(document | {"give_up": ["loop"]}, "x.toml", Path())
    directory = SweepDirectory.prepare(directory.path, Manifest(left, code_version(), {}))
    assert carried_out(directory, late) == {"office": 16, "loop": 8}
    spec = parse_spec(document, "x.toml", Path())
    plan = planned(directory.path, spec, replace(read_sweep(directory.path), level=spec.level))
    assert {cell.place for cell in plan.possible} == {"loop"}
    assert (len(plan.needed), len(plan.possible), plan.next_look) == (2 * 8, 2 * 32, 16)


@pytest.mark.slow
def test_giving_up_takes_hardly_any_answers_away():
    """Of sweeps that all seeds would decide, few are given up at a look before."""
    rng = np.random.default_rng(1)
    spec = parse_spec({"worlds": ["office"], "seeds": 40, "until": "decided"}, "x.toml", Path())
    decided = lost = 0
    for _ in range(300):
        gain = rng.normal(0.0, 0.01)
        errors = 0.1 + np.array([[gain], [0.0]]) + 0.008 * rng.normal(size=(2, 40))
        looks = [decide((1, 5), errors[:, :n], np.zeros((2, n)), level=spec.level) for n in spec.looks]
        answers = [look.kind != "undecided" for look in looks]
        if any(answers):
            decided += 1
            lost += any(is_hopeless(look, 40) for look in looks[: answers.index(True)])
    assert decided > 150
    assert lost / decided < 0.05


def test_a_plan_counts_the_jobs_to_the_next_look_and_in_all(tmp_path):
    directory = directory_of(tmp_path, ["office", "loop"])
    spec = directory.manifest.spec
    plan = planned(None, spec, None)
    assert (len(plan.needed), len(plan.possible), plan.next_look) == (2 * 2 * 8, 2 * 2 * 24, 8)
    store(directory, needed_cells(directory), clear)
    needed_cells(directory)  # writes the tables
    plan = planned(directory.path, spec, read_sweep(directory.path))
    assert (len(plan.needed), len(plan.possible), plan.next_look) == (2 * 8, 2 * 16, 16)  # loop alone
    assert {cell.place for cell in plan.possible} == {"loop"}


def test_an_interrupted_look_is_completed_first(tmp_path):
    directory = directory_of(tmp_path, ["office"])
    first = needed_cells(directory)
    store(directory, first[:5], clear)
    assert needed_cells(directory) == first


def test_rows_say_whether_the_report_rests_on_them_and_what_is_to_come(tmp_path):
    """Before the first look as after it; a seed that lacks a count is left out."""
    directory = directory_of(tmp_path, ["loop"])
    first = needed_cells(directory)
    assert states_of(directory, "status") == ["missing"] * 8 + ["later"] * 16
    store(directory, first, clear)
    second = [cell for cell in needed_cells(directory) if cell.seed >= 8]
    store(directory, second[:5], clear)
    needed_cells(directory)
    assert states_of(directory, "in_report") == [True] * 8 + [False] * 16
    assert states_of(directory, "status") == ["done"] * 13 + ["missing"] * 3 + ["later"] * 8
    assert read_sweep(directory.path).judged().ran[0, 0, 0].tolist() == states_of(directory, "in_report")


def states_of(directory, column):
    """A column of the tables for one particle."""
    rows = pq.read_table(directory.path / "sweep.parquet").to_pylist()
    return [row[column] for row in rows if row["particles"] == 1]


def test_a_world_that_is_left_gets_no_more_seeds_and_keeps_its_own(tmp_path):
    directory = directory_of(tmp_path, ["loop", "office"])
    store(directory, needed_cells(directory), lambda *what: clear("loop", *what[1:]))  # both are open after 8 seeds
    assert {cell.place for cell in needed_cells(directory) if cell.seed >= 8} == {"loop", "office"}
    document = directory.manifest.spec.document() | {"give_up": ["loop"]}
    spec = parse_spec(document, "x.toml", Path())
    directory = SweepDirectory.prepare(directory.path, Manifest(spec, code_version(), {}))
    assert {cell.place for cell in needed_cells(directory) if cell.seed >= 8} == {"office"}
    states = statuses(directory)
    assert {states[cell.key] for cell in directory.manifest.cells() if cell.place == "loop"} == {"given up"}
    assert read_sweep(directory.path).judged().ran[0].sum() == 2 * 8
    both = parse_spec(document | {"give_up": ["loop", "office"]}, "x.toml", Path())
    directory = SweepDirectory.prepare(directory.path, Manifest(both, code_version(), {}))
    assert needed_cells(directory) == []  # that ends the sweep, with the runs that there are
    assert read_sweep(directory.path).judged().ran.sum(axis=(1, 2, 3)).tolist() == [16, 16]
    for wrong in ({"give_up": ["cave"]}, {"give_up": ["loop"], "until": ""}):
        with pytest.raises(SweepError, match="give_up"):
            parse_spec(document | wrong, "x.toml", Path())


def test_the_plan_of_a_new_sweep_leaves_out_what_is_given_up(tmp_path):
    document = directory_of(tmp_path, ["loop", "office"]).manifest.spec.document()
    specs = [parse_spec(document | {"give_up": names}, "x.toml", Path()) for names in ([], ["loop"])]
    both, one = (planned(None, spec, None) for spec in specs)
    assert len(both.needed) == 2 * len(one.needed)
    assert len(both.possible) == 2 * len(one.possible)
    assert {cell.place for cell in one.possible} == {"office"}
    assert one.next_look == both.next_look == 8


def test_jobs_without_a_result_do_not_stop_the_looks(tmp_path):
    directory = directory_of(tmp_path, ["loop"])
    first = needed_cells(directory)
    store(directory, first[1:], clear)
    directory.keep_failure(first[0], "time limit")
    assert {cell.seed for cell in needed_cells(directory)} == set(range(16))


def test_without_until_all_cells_are_needed(tmp_path):
    spec = parse_spec({"worlds": ["office"], "seeds": 20}, "x.toml", Path())
    directory = SweepDirectory.prepare(tmp_path / "sweep", Manifest(spec, code_version(), {}))
    assert needed_cells(directory) == directory.manifest.cells()
    assert spec.level == pytest.approx(0.95)


def test_worlds_of_one_kind_are_decided_together(tmp_path):
    directory = directory_of(tmp_path, ["generated:rooms*9", "loop"], seeds=16)
    assert carried_out(directory, lambda *what: clear("office" if what[0] != "loop" else "loop", *what[1:])) == {
        **{f"rooms-{number}": 8 for number in range(9)},
        "loop": 16,
    }


@pytest.mark.slow
def test_looking_several_times_keeps_the_error_rate():
    """The smaller count is worse by exactly the limit: each look may find it enough by chance, all together rarely."""
    spec = parse_spec({"worlds": ["office"], "seeds": 40, "until": "decided"}, "x.toml", Path())
    rng = np.random.default_rng(0)
    wrong = {spec.level: 0, 0.95: 0}
    for _ in range(300):
        errors = 0.1 * (1.0 + np.array([[0.1], [0.0]]) + 0.1 * rng.normal(size=(2, 40)))
        errors[1] = 0.1
        for level in wrong:
            found = [decide((1, 5), errors[:, :n], np.zeros((2, n)), level=level).kind == "enough" for n in spec.looks]
            wrong[level] += any(found)
    assert wrong[spec.level] / 300 < 0.05
    assert wrong[0.95] > wrong[spec.level]


@pytest.mark.slow
def test_going_on_to_smaller_counts_keeps_the_error_rate():
    """5 is worse than 30 by exactly the limit, 15 as good: 5 is found enough by chance at any look, but rarely."""
    spec = parse_spec({"worlds": ["office"], "seeds": 40, "until": "smallest"}, "x.toml", Path())
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(300):
        errors = 0.1 * (1.0 + np.array([[0.1], [0.0], [0.0]]) + 0.1 * rng.normal(size=(3, 40)))
        errors[2] = 0.1
        found = decide((5, 15, 30), errors, np.zeros((3, 40)), level=spec.level, looks=spec.looks)
        wrong += found.kind == "enough" and found.count == 5
    assert wrong / 300 < 0.05


def test_two_processes_that_extend_a_sweep_leave_the_larger_one(tmp_path, monkeypatch):
    """The other one writes 20 seeds after this one, which asks for 15, has read 10."""
    sizes = {"until": "", "worlds": ["office"]}
    directory_of(tmp_path, seeds=10, **sizes)
    locked = SweepDirectory.locked

    def after_the_other(self, shard):
        monkeypatch.setattr(SweepDirectory, "locked", locked)
        directory_of(tmp_path, seeds=20, **sizes)
        return locked(self, shard)

    monkeypatch.setattr(SweepDirectory, "locked", after_the_other)
    with pytest.raises(SweepError, match="holds another sweep"):
        directory_of(tmp_path, seeds=15, **sizes)
    assert len(SweepDirectory.open(tmp_path / "sweep").manifest.spec.seeds) == 20


def test_a_look_goes_through_the_cells_once(tmp_path, monkeypatch):
    """Not once for each world and line, which for a large sweep takes longer than its runs."""
    directory = directory_of(tmp_path, ["office", "loop", "hall"], seeds=8)
    cells, asked = directory.cells(), []
    monkeypatch.setattr(looks, "_group", lambda cell: asked.append(cell) or (cell.place, cell.line))
    look = looks.look_of(directory.manifest.spec, cells, None, lambda cell: False)
    assert len(look.needed) == len(cells)
    assert len(asked) <= 2 * len(cells)
