# SPDX-License-Identifier: MIT
"""The measurement of the self-check: what it holds out, how it counts, and how the score ranks other systems."""

import numpy as np
import pytest
from scipy.stats import spearmanr

from eval.files.tum import read_tum
from eval.trajectory.relations import read_relations, relation_error
from eval.trajectory.trajectory import Trajectory
from testbed.formats import open_log
from tests.eval.helpers import datasets
from tools.measure.self_check import FILTERS, WORLDS, cases, is_right, score_of, table


def test_no_world_and_no_seed_is_both_trained_on_and_held_out():
    assert not set(WORLDS["training"]) & set(WORLDS["held-out"])
    training, held_out = cases("training", 400), cases("held-out", 400)
    assert not {case.seed for case in training} & {case.seed for case in held_out}
    known = {*WORLDS["training"], *WORLDS["held-out"]}
    before = {case.seed for case in (*training, *held_out)}
    for split in ("fresh", "unseen"):
        seeds = {case.seed for case in cases(split, 400)}
        generated = {world for world in WORLDS[split] if world.startswith("generated:")}
        assert not before & seeds
        assert len(generated) == 8
        assert not generated & known
        before, known = before | seeds, known | generated


def test_fewer_runs_are_the_first_of_more():
    assert cases("held-out", 20) == cases("held-out", 100)[:20]
    assert {case.filter for case in cases("held-out", 100)} == set(FILTERS)


def test_a_path_is_right_if_it_is_near_the_truth_over_the_metre_that_begins_before_a_stamp():
    stamps, poses = np.arange(40.0), np.zeros((40, 3))
    poses[:, 0] = 0.2 * stamps
    truth = Trajectory(stamps, poses)
    off = poses.copy()
    off[20:, 1] = 0.6
    assert not is_right(Trajectory(stamps, off), truth, 16.0)  # from 15 to 20: a metre
    assert is_right(Trajectory(stamps, off), truth, 15.0)
    off[20:, 1:] = 0.4, 0.4
    assert not is_right(Trajectory(stamps, off), truth, 20.0)
    off[20:, 2] = 0.3
    assert is_right(Trajectory(stamps, off), truth, 20.0)


def row(truth, verdict, driving="plausible"):
    return {"final": {"truth": truth}, "self_check": {"verdict": verdict, "while_driving": {"verdict": driving}}}


def test_the_table_counts_verdicts_by_truth():
    rows = (
        [row("lost", "lost")] * 19 + [row("lost", "doubtful")] + [row("good", "plausible")] * 50 + [row("blip", "lost")]
    )
    text = table(rows, "final", "")
    assert "| lost | 0 | 1 | 19 |\n| blip | 0 | 0 | 1 |\n| good | 50 | 0 | 0 |" in text
    assert "lost runs named lost: 19 of 20 (76% to 99%); lost or doubtful: 20 of 20" in text  # Wilson, 95 %
    assert "good runs called lost: 0 of 50 (0% to 7%)" in text
    silent = [row("lost", "plausible") | {"told": False}] * 3
    assert "those whose data tell of the fault: 19 of 20 (76% to 99%)" in table(rows + silent, "final", "")
    assert "| lost | 20 | 0 | 0 |" in table(rows, "final", "while_driving")


@pytest.mark.slow
def test_the_score_ranks_other_systems_as_hand_checked_relations_do():
    """The best and the worst in the same order; those between differ by 2 mm."""
    folder = datasets()
    paths = {path.stem: read_tum(path) for path in sorted((folder.parent / "peers").glob("intel_*.tum"))}
    if not paths:
        pytest.skip(f"estimates of other systems not found in {folder.parent / 'peers'}")
    frames = list(open_log(folder / "intel" / "intel-merged.clf.gz").frames)
    relations = read_relations(folder / "intel" / "intel-resolved.relations")
    errors = {name: relation_error(path, relations).all.translation.mean for name, path in paths.items()}
    scores = {name: score_of(path, frames) for name, path in paths.items()}
    assert max(scores, key=scores.get) == min(errors, key=errors.get) == "intel_karto"
    assert min(scores, key=scores.get) == max(errors, key=errors.get) == "intel_gmapping_5_seed1"
    assert spearmanr(list(scores.values()), list(errors.values()))[0] <= -0.9 + 1e-9
