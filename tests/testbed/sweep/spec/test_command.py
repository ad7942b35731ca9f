# SPDX-License-Identifier: MIT
"""The command on a sweep's page gives the same sweep again."""

import shlex
from pathlib import Path

import pytest

from testbed.cli.shared.sweep_options import SweepOptions
from testbed.sweep.spec.command import command_of
from testbed.sweep.spec.spec import parse_spec


@pytest.mark.parametrize(
    "document",
    [
        {"worlds": ["office", "loop"], "seeds": 3, "particles": [1, 5]},
        {"worlds": "generated:rooms*4,office,generated:loops:size=30x20:3", "seeds": "4:9", "measure": "online"},
        {"worlds": ["office", "generated:cave*3"], "seeds": 8, "drawn_seeds": 2},
        {"worlds": "generated:cave:5", "seeds": [7], "settings": {"refine": False, "route": "random"}},
        {
            "worlds": ["a b.toml"],
            "seeds": [1, 5],
            "axes": {"odometry.grade": ["good", "poor"], "layers.motion": [True]},
        },
        {"worlds": ["office"], "axes": {"route": ["fixed", "random"]}, "margin": "5%,2mm"},
        {"worlds": ["office"], "settings": {"filter.gate.distance": 0.3}, "until": "decided", "seeds": 40},
        {"worlds": ["office", "loop"], "until": "decided", "seeds": 40, "give_up": ["loop"]},
    ],
)
def test_the_command_gives_the_same_specification(document):
    spec = parse_spec(document, "x.toml", Path())
    program, command, *words = shlex.split(command_of(spec))
    assert (program, command) == ("testbed", "sweep")
    options: dict = {}
    for name, value in zip(words[::2], words[1::2], strict=True):
        key = name.removeprefix("--").replace("-", "_")
        if key == "drawn_seeds":
            options[key] = int(value)
        else:
            options[key] = (*options.get(key, ()), value) if key in ("axis", "set") else value
    expected = spec.document()
    expected.pop("give_up", None)  # what was given up here is computed to the end there
    if "route" not in document.get("axes", {}):  # the command is exact where the specification leaves the default
        expected["settings"] = {"route": "fixed"} | expected.get("settings", {})
    assert SweepOptions(**options).specification(None, None).document() == expected


def test_each_seed_has_a_route_of_its_own_unless_something_else_is_said(tmp_path):
    def route(file: str = "", **flags):
        (tmp_path / "spec.toml").write_text(file)
        spec = SweepOptions(**flags).specification(tmp_path / "spec.toml" if file else None, None)
        return spec.settings.get("route")

    assert route(worlds="office") == "random"
    assert route(worlds="office", route="fixed") == "fixed"
    assert route('worlds = ["office"]') == "random"
    assert route('worlds = ["office"]\nsettings.route = "fixed"') == "fixed"
    assert route('worlds = ["office"]\naxes.route = ["fixed", "random"]') is None
    assert route('[[logs]]\nlog = "a.log"') is None
    assert route(preset="gate") == "fixed"


def test_the_route_of_a_sweep_that_is_there_stays(tmp_path):
    manifest = 'code = "0"\n[spec]\nworlds = ["office"]\nseeds = [0]\nparticles = [1]\n'
    (tmp_path / "sweep.toml").write_text(manifest)
    assert SweepOptions(seeds="3").specification(None, tmp_path).settings == {}


def test_a_sweep_that_needs_a_file_names_it():
    spec = parse_spec({"logs": [{"log": "a.log"}]}, "x.toml", Path())
    assert "sweep.toml" in command_of(spec)
