# SPDX-License-Identifier: MIT
"""Paired variants: one drive, other sensors."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from testbed.cli.shared.variants import variants
from testbed.datasets.index import datasets_in
from testbed.formats import open_log
from testbed.seeds import RunSeeds
from testbed.settings.simulator import SimulatorOptions
from tests.shell import call

VARY = ["--vary", "lidar=rplidar_a2,lds01", "--vary", "clutter=0,2"]
NAMES = [f"office-0000-lidar-{lidar}-clutter-{clutter}" for lidar in ("lds01", "rplidar_a2") for clutter in "02"]


def simulate(*arguments: str) -> int:
    return call("simulate", *arguments)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("made")
    common = ("--route", "fixed", "--duration", "2.5", "--format", "rosbag2-lean")
    assert simulate("office", "--out", str(out), *common, *VARY) == 0
    return out


def test_variants_share_the_path_and_whatever_did_not_vary(made):
    assert [path.name for path in datasets_in(made)] == NAMES
    frames = [[f for f in open_log(made / name).frames if f.stamp < 2.2] for name in NAMES]
    first, *others = [{round(f.stamp, 3): (*f.truth, *f.odometry) for f in found} for found in frames]
    for other in others:
        common = sorted(first.keys() & other.keys())
        assert len(common) > 20
        np.testing.assert_allclose([other[t] for t in common], [first[t] for t in common], atol=1e-12)
    plain, cluttered = (next(f.scan for f in found if f.scan is not None) for found in frames[:2])
    same = plain.ranges == cluttered.ranges
    assert 0.2 < same.mean() < 0.98  # the same noise, where nothing new is in the way


def test_variants_that_are_there_are_kept(made, capsys):
    times = [(made / name / "config.toml").stat().st_mtime_ns for name in NAMES]
    common = ("--route", "fixed", "--duration", "2.5", "--format", "rosbag2-lean", "--workers", "2")
    assert simulate("office", "--out", str(made), *common, *VARY) == 0
    assert "wrote 0 datasets; 4 existed already and were kept" in capsys.readouterr().out
    assert times == [(made / name / "config.toml").stat().st_mtime_ns for name in NAMES]


def test_a_variant_is_made_again_from_config_and_commands(made, tmp_path):
    dataset = made / NAMES[1]
    again = ["--config", str(dataset / "config.toml"), "--out"]
    assert simulate(*again, str(tmp_path / "same")) == 0
    same = tmp_path / "same" / NAMES[1]
    for file in dataset.iterdir():
        assert file.read_bytes() == (same / file.name).read_bytes()
    recorded = ["--driver", "recorded", "--commands", str(dataset)]
    assert simulate(*again, str(tmp_path / "recorded"), *recorded) == 0
    same = tmp_path / "recorded" / NAMES[1]
    for file in dataset.iterdir():
        assert file.name == "config.toml" or file.read_bytes() == (same / file.name).read_bytes()
    drive = tomllib.loads((dataset / "config.toml").read_text())["drive"]
    expected = {"finished": False, "stuck": False, "collided": False, "recoveries": 0, "seconds": 2.5}
    assert drive.items() >= expected.items()


def test_settings_are_taken_over_with_their_types():
    made = variants(SimulatorOptions(), ["odometry.grade=good,poor", "layers.range-noise=false", "beams=90"])
    assert [variant.simulator.odometry.grade for variant in made] == ["good", "poor"]
    assert all(variant.simulator.layers.range_noise is False for variant in made)
    assert made[0].simulator.simulation(RunSeeds.from_seed(0)).lidar.beams == 90
    assert made[0].name == "odometry.grade-good-layers.range_noise-false-beams-90"
    assert [variant.name for variant in variants(SimulatorOptions(), [])] == [""]


@pytest.mark.parametrize(
    ("vary", "complaint"),
    [
        (["robot=burger"], "a key that keeps the path: lidar, beams"),
        (["lidar"], "expected lidar=A,B,C"),
        (["lidar=a,,b"], "expected lidar=A,B,C"),
        (["beams=many"], "--vary beams=many: Input should be a valid integer"),
        (["odometry.grade=fair"], "--vary odometry.grade=fair"),
        (["noise=1", "noise=2"], "names a key twice"),
        (["noise=1,1"], "the same name"),
        (["noise=-1"], "noise must not be negative"),
        (["beams=0"], "beams must be 1 to"),
    ],
)
def test_what_cannot_vary_is_explained(vary, complaint):
    with pytest.raises(ValueError, match=complaint):
        variants(SimulatorOptions(), vary)
