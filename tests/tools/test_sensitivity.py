# SPDX-License-Identifier: MIT
"""Settings that are halved and doubled, one at a time."""

import json
from dataclasses import asdict

import pytest

from slam.config import FilterConfig
from tools.measure import sensitivity
from tools.measure.sensitivity import changed, names_of_settings, rows


def flat(config):
    return {
        f"{part}.{name}": value
        for part, inner in asdict(config).items()
        if isinstance(inner, dict)
        for name, value in inner.items()
    }


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("setting", ["match.hit_sigma", "proposal.samples", "gate.distance"])
def test_one_setting_is_changed_and_no_other(setting, factor):
    before, after = flat(FilterConfig()), flat(changed(setting, factor, particles=30))
    assert {name for name in before if before[name] != after[name]} == {setting}
    assert after[setting] == pytest.approx(factor * before[setting])
    assert type(after[setting]) is type(before[setting])


def test_numbers_that_are_not_zero_are_varied():
    names = names_of_settings()
    assert "motion.jump_share" in names
    assert "match.iterations" in names
    assert not {"gate.seconds", "map.free_range", "proposal.kind"} & set(names)  # 0, 0, a word


def test_the_table_has_the_worst_of_the_seeds_and_says_what_was_refused(tmp_path, monkeypatch):
    def errors_of(place, config, seed):
        return config.match.hit_sigma + 0.01 * seed, 0.02

    monkeypatch.setattr(sensitivity, "errors_of", errors_of)
    lines = list(rows(tmp_path, ["aces"], ["match.hit_sigma", "map.field_radius"], 5, range(2)))
    assert lines[2:5] == [
        "| defaults |  | 4.0 cm | 2.0 cm |",
        "| `match.hit_sigma` | x 0.5 | 2.5 cm | 2.0 cm |",
        "| `match.hit_sigma` | x 2 | 7.0 cm | 2.0 cm |",
    ]
    (tmp_path / "aces-default-5-0.json").write_text(json.dumps([1.0, 0.5]))
    assert next(line for line in rows(tmp_path, ["aces"], [], 5, [0]) if "defaults" in line).endswith("50.0 cm |")
    assert list(rows(tmp_path, ["aces"], ["motion.failure_share"], 5, [0]))[-1].count("cm") == 2
    monkeypatch.setattr(sensitivity, "changed", refuse)
    assert list(rows(tmp_path, ["aces"], [], 5, [0]))[-1] == "| defaults |  | refused | refused |"


def refuse(setting, factor, particles):
    raise ValueError(setting)
