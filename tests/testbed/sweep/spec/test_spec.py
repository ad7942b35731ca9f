# SPDX-License-Identifier: MIT
"""Specifications: what they expand to, and what is said of wrong ones."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from testbed.sweep.errors import SweepError
from testbed.sweep.spec.plan import Costs, Shard, by_recording, input_digests, plan, seed_by_seed
from testbed.sweep.spec.settings import RunSettings, checked, known
from testbed.sweep.spec.spec import parse_spec, parsed_axes, presets, read_document, read_preset
from testbed.sweep.store import Manifest, check_extends
from tests.testbed.sweep.room import room_cell, room_file


def spec_of(document: dict, folder: Path = Path()):
    return parse_spec(document, "x.toml", folder)


@pytest.mark.parametrize(("installed", "backend"), [(True, "pybullet"), (False, "fast")])
def test_jobs_of_a_sweep_share_a_backend_that_is_decided(monkeypatch, installed, backend):
    monkeypatch.setattr("testbed.simulation.config.is_installed", lambda: installed)
    assert checked("backend", "auto", recorded=False) == backend
    spec = spec_of({"worlds": ["office"], "settings": {"backend": "auto"}})
    assert [line.settings["backend"] for line in spec.lines()] == [backend]
    assert RunSettings().simulator.backend == "fast"


def test_lines_are_all_combinations_of_variants_and_axes():
    spec = spec_of(
        {
            "worlds": ["office"],
            "settings": {"refine": False},
            "variants": {"plain": {}, "few": {"filter": {"proposal": {"samples": 5}}}},
            "axes": {"odometry.grade": ["good", "poor"], "layers.motion": [True, False]},
        }
    )
    names = [line.name for line in spec.lines()]
    assert len(names) == len(set(names)) == 8
    assert names[0] == "plain, good, motion true"
    assert spec.lines()[-1].settings == {
        "refine": False,
        "filter.proposal.samples": 5,
        "odometry.grade": "poor",
        "layers.motion": False,
    }


def test_every_option_of_filter_and_simulator_can_be_an_axis():
    names = set(known())
    assert {"robot", "lidar", "duration", "odometry.grade", "layers.dropout", "filter.match.hit_sigma"} <= names
    settings = RunSettings.of({"lidar": "lds01", "odometry.slip_rate": 0.5, "filter.resample.scheme": "residual"})
    assert settings.simulator.lidar == "lds01"
    assert settings.simulator.odometry == replace(RunSettings().simulator.odometry, slip_rate=0.5)
    assert settings.filter.resample.scheme == "residual"


@pytest.mark.parametrize(
    ("more", "refined"),
    [
        ({}, (1, 9)),
        ({"measure": "online"}, (1, 9)),
        ({"measure": "map_filter.wall_thickness_m"}, (1, 9)),
        ({"measure": "refined"}, (1, 3, 9)),
        ({"measure": "map.wall_thickness_m"}, (1, 3, 9)),
        ({"settings": {"refine": True}}, (1, 3, 9)),
        ({"settings": {"refine": False}}, ()),
    ],
)
def test_the_final_pass_is_made_for_the_smallest_and_largest_count(more, refined):
    spec = spec_of({"worlds": ["office"], "seeds": 2, "particles": [1, 3, 9], **more})
    made = {cell.particles: cell.settings["refine"] for cell in plan(spec, "code", {})}
    assert tuple(count for count, is_refined in made.items() if is_refined) == refined


@pytest.mark.parametrize(
    ("measure", "of_worlds", "of_logs"),
    [
        ("online", "trajectory_online.ate_rmse_m", "relations_online.trans_mean_m"),
        ("filter", "trajectory_filter.ate_rmse_m", "relations_filter.trans_mean_m"),
        ("refined", "trajectory.ate_rmse_m", "relations.trans_mean_m"),
        ("", "trajectory_filter.ate_rmse_m", "relations_filter.trans_mean_m"),
        ("map_filter.log_loss", "map_filter.log_loss", "map_filter.log_loss"),
    ],
)
def test_a_word_stands_for_the_main_measure_of_an_estimate(measure, of_worlds, of_logs):
    assert spec_of({"worlds": ["office"], "measure": measure}).key_measure == of_worlds
    assert spec_of({"logs": [{"log": "a.log"}], "measure": measure}).key_measure == of_logs
    assert spec_of({"logs": [{"log": "a.log", "truth": "a.tum"}], "measure": measure}).key_measure == of_worlds


def test_worlds_and_seeds_are_lists_texts_or_numbers():
    spec = spec_of({"worlds": ["office", "generated:rooms*2"], "seeds": "2:4", "particles": [1]})
    assert [(cell.place, cell.source["world"], cell.seed) for cell in plan(spec, "code", {})] == [
        (place, world, seed)
        for place, world in (
            ("office", "office"),
            ("rooms-0", "generated:rooms:0"),
            ("rooms-1", "generated:rooms:1"),
        )
        for seed in (2, 3)
    ]
    assert spec_of(spec.document()) == spec
    assert spec_of({"worlds": "office, loop"}).worlds == ("office", "loop")


def test_drawn_worlds_can_have_fewer_seeds():
    """A single generated world is no sample of its kind, so it has all of them."""
    worlds = ["office", "generated:rooms*2", "generated:cave:4"]
    spec = spec_of({"worlds": worlds, "seeds": "2:5", "drawn_seeds": 1, "particles": [1, 3]})
    cells = plan(spec, "code", {})
    seeds = {place: sorted({cell.seed for cell in cells if cell.place == place}) for place in ("office", "rooms-1")}
    assert seeds == {"office": [2, 3, 4], "rooms-1": [2]}
    assert len([cell for cell in cells if cell.place == "cave-4"]) == 6
    assert spec.size == len(cells) == 2 * (3 + 1 + 1 + 3)
    assert len(plan(spec.model_copy(update={"drawn_seeds": None}), "code", {})) == 2 * 4 * 3


def test_a_sweep_grows_by_seeds_of_its_drawn_worlds(tmp_path):
    def extends(there: int | None, requested: int | None) -> None:
        kind = {"worlds": ["generated:rooms*2"]}
        specs = [spec_of(kind if number is None else kind | {"drawn_seeds": number}) for number in (there, requested)]
        check_extends(tmp_path, *(Manifest(spec, "code", {}, "commit") for spec in specs))

    for there, requested in ((1, 1), (1, 2), (1, None), (None, None)):
        extends(there, requested)
    for there, requested in ((2, 1), (None, 1)):
        with pytest.raises(SweepError, match=r"drawn_seeds is .* there, 1 requested"):
            extends(there, requested)


def test_values_take_the_type_of_their_setting():
    assert repr(checked("filter.match.hit_sigma", 1, recorded=False)) == "1.0"
    assert checked("filter.proposal.samples", 7, recorded=True) == 7


@pytest.mark.parametrize(
    ("document", "complaint"),
    [
        ({}, "x.toml: expected either worlds or logs"),
        ({"worlds": ["office"], "logs": [{"log": "a.log"}]}, "either worlds or logs"),
        ({"worlds": ["office"], "partcles": [1]}, "partcles: unknown key, expected one of title, worlds"),
        ({"worlds": ["office"], "particles": [0]}, "particles.0: expected greater than or equal to 1"),
        ({"worlds": ["office"], "particles": []}, "particles: is empty"),
        ({"worlds": ["office"], "seeds": []}, "seeds: is empty"),
        ({"worlds": ["office"], "seeds": 0}, "seeds: is empty"),
        ({"worlds": ["office"], "seeds": [3, 3]}, "seeds: names the same thing twice"),
        ({"worlds": ["office", "office"]}, "worlds: names the same thing twice"),
        (
            {"worlds": ["office"], "axes": {"odometry.grad": ["good"]}},
            "odometry.grad: unknown setting, expected such as",
        ),
        ({"worlds": ["office"], "axes": {"odometry.grade": []}}, "axis odometry.grade: is empty"),
        ({"worlds": ["office"], "axes": {"odometry.grade": ["fair"]}}, "expected 'good', 'typical' or 'poor'"),
        ({"worlds": ["office"], "axes": {"odometry.grade": "good"}}, "axes.odometry.grade: expected"),
        ({"worlds": ["office"], "axes": {"refine": [True, True]}}, "line 'refine true': occurs twice"),
        ({"worlds": ["office"], "settings": {"filter.particles": 3}}, "is given as 'particles'"),
        ({"worlds": ["office"], "settings": {"filter.match.hit_sigma": -1}}, "hit_sigma must be positive"),
        ({"worlds": ["office"], "settings": {"refine": 1}}, "refine = 1: expected a valid boolean"),
        ({"worlds": ["office"], "settings": {"refine": True}, "axes": {"refine": [False]}}, "refine: is set twice"),
        ({"worlds": ["office"], "baseline": "best"}, "baseline 'best': no such line, expected one of default"),
        ({"logs": [{"log": "a.log"}], "axes": {"lidar": ["lds01"]}}, "recorded logs are not simulated"),
        ({"worlds": ["office"], "seeds": 100_000_000}, "seeds: 100000000 seeds, expected 1 to 10000"),
        ({"worlds": ["office"], "seeds": "0:100000000"}, "seeds: 0:100000000: more than 10000 seeds"),
        ({"worlds": ["office"], "seeds": list(range(20_000))}, "seeds: "),
        ({"worlds": ["generated:rooms*3", "office"], "seeds": 10_000}, "280000 jobs, expected at most 100000"),
        ({"worlds": ["generated:rooms*1000000000"]}, "expected a number of worlds from 1 to 1000"),
        ({"worlds": ["office"], "until": "decided", "drawn_seeds": 1}, "drawn_seeds: expected without --until, "),
        ({"worlds": ["generated:castle*3"]}, "unknown kind of world 'castle'"),
        ({"worlds": ["office"], "measure": "accuracy"}, "measure 'accuracy': expected one of online, filter, refined"),
        ({"worlds": ["office"], "measure": "trajectory"}, "measure 'trajectory': expected one of"),
        ({"worlds": ["office"], "settings": {"route": "round"}}, "expected 'fixed', 'random' or 'stops'"),
        ({"logs": [{"log": "a.log"}], "settings": {"route": "random"}}, "recorded logs are not simulated"),
    ],
)
def test_a_wrong_specification_is_named_by_key_and_expectation(document, complaint):
    with pytest.raises(SweepError) as refused:
        spec_of(document)
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


def test_axes_on_the_command_line_are_toml_values_or_words():
    axes = parsed_axes(["odometry.grade=good, poor", "filter.match.hit_sigma=0.02,0.05", "refine=true,false"])
    assert axes == {
        "odometry.grade": ["good", "poor"],
        "filter.match.hit_sigma": [0.02, 0.05],
        "refine": [True, False],
    }
    with pytest.raises(SweepError, match="NAME=VALUE"):
        parsed_axes(["odometry.grade"])


def test_shipped_presets_are_valid():
    assert {"gate", "particles"} <= set(presets())
    specs = {name: parse_spec(read_preset(name), name, Path()) for name in presets()}
    study = specs["particles"]
    assert (len(study.worlds), len(study.seeds), study.particles) == (23, 8, (1, 2, 5, 10, 20, 40, 80))
    assert (len(study.drawn_worlds), study.drawn_seeds) == (20, 1)  # the unit of both kinds is the world
    assert [line.name for line in study.lines()] == ["improved", "scan-match", "motion"]


def test_the_examples_of_the_documentation_are_valid():
    text = (Path(__file__).parents[4] / "docs" / "sweep.md").read_text(encoding="utf-8")
    first, second = (tomllib.loads(block) for block in re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL))
    assert len(spec_of(first).lines()) == 4
    assert spec_of(second).key_measure == "relations_filter.trans_mean_m"


def test_only_tours_can_be_shared_by_all_cells():
    with pytest.raises(SweepError, match="share one drive"):
        checked("driver.kind", "explore", recorded=False)


def test_a_file_that_is_no_specification_is_named(tmp_path):
    with pytest.raises(SweepError, match=r"nowhere\.toml: no such file"):
        read_document(tmp_path / "nowhere.toml")
    (tmp_path / "bad.toml").write_text("worlds = [")
    with pytest.raises(SweepError, match=r"bad\.toml: .*expected TOML"):
        read_document(tmp_path / "bad.toml")


def test_relative_files_are_found_and_enter_the_key(tmp_path):
    room_file(tmp_path)
    document = {"worlds": ["room.toml"], "seeds": 1, "particles": [1]}
    spec = spec_of(document, tmp_path)
    assert spec.worlds == (str(tmp_path / "room.toml"),)
    (before,) = plan(spec, "code", input_digests(spec))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    room_file(elsewhere)
    moved = spec_of(document, elsewhere)
    assert plan(moved, "code", input_digests(moved))[0].key == before.key  # the content counts, not the place
    room_file(tmp_path, width=6.0)
    (after,) = plan(spec, "code", input_digests(spec))
    assert after.key != before.key


def test_keys_change_with_what_decides_a_result_only(tmp_path):
    cell = room_cell(room_file(tmp_path))
    changes = {
        "particles": 3,
        "seed": 1,
        "settings": {"refine": True},
        "source": {"world": "office"},
        "code": "0123456789abcdef",
    }
    keys = {replace(cell, **{name: value}).key for name, value in changes.items()} | {cell.key}
    assert len(keys) == 1 + len(changes)
    assert replace(cell, place="other", line="other").key == cell.key


@pytest.mark.parametrize("count", [1, 2, 3, 7, 100])
def test_shards_deal_out_every_cell_once_and_the_work_evenly(count):
    spec = spec_of({"worlds": ["office"], "seeds": 5, "particles": [1, 10, 100]})
    costs = Costs.of(spec)
    cells = seed_by_seed(plan(spec, "code", {}), costs)
    shards = [Shard(k, count).of(cells, costs) for k in range(count)]
    assert sorted(cell.key for shard in shards for cell in shard) == sorted(cell.key for cell in cells)
    work = [sum(map(costs, shard)) for shard in shards]
    fair = sum(map(costs, cells)) / count
    assert max(abs(w - fair) for w in work) <= max(map(costs, cells)) + 1e-9
    simulated = sum(len(by_recording(shard)) for shard in shards)
    assert simulated <= len(by_recording(cells)) + count - 1


@pytest.mark.parametrize("text", ["", "1", "a/b", "3/3", "-1/3", "0/0", "1/3/5"])
def test_a_wrong_shard_is_refused(text):
    with pytest.raises(SweepError, match="shard"):
        Shard.parse(text)


def test_seeds_come_one_after_another_over_all_worlds():
    spec = spec_of({"worlds": ["apartment", "warehouse"], "seeds": "3:5", "particles": [1, 100]})
    order = [(c.seed, c.place, c.particles) for c in seed_by_seed(plan(spec, "code", {}), Costs.of(spec))]
    assert [seed for seed, _, _ in order] == [3] * 4 + [4] * 4
    assert order[0] == (3, "warehouse", 100)  # of one seed the longest first
    assert order[3] == (3, "apartment", 1)
