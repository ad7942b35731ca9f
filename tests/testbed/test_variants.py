# SPDX-License-Identifier: MIT
"""Paired variants: one drive, other sensors."""

import tomllib

import numpy as np
import pytest

from testbed.cli import main
from testbed.cli.simulator_options import SimulatorOptions
from testbed.cli.variants import variants
from testbed.formats import open_log


def simulate(out, *options: str) -> int:
    with pytest.raises(SystemExit) as end:
        main(["simulate", "office", "--out", str(out), "--duration", "3", *options])
    return end.value.code


def test_variants_share_the_path_and_whatever_did_not_vary(tmp_path, capsys):
    vary = ["--vary", "lidar=rplidar_a2,lds01", "--vary", "clutter=0,2"]
    assert simulate(tmp_path, *vary) == 0
    assert simulate(tmp_path, *vary, "--count", "2") == 0  # goes on where it was
    assert "4 datasets written, 4 were there already" in capsys.readouterr().out
    names = [
        f"office-{seed:04d}-lidar-{lidar}-clutter-{c}"
        for seed in (0, 1)
        for lidar in ("lds01", "rplidar_a2")
        for c in "02"
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    frames = {name: [f for f in open_log(tmp_path / name).frames if f.stamp < 2.7] for name in names[:4]}
    poses = {name: {round(f.stamp, 3): (*f.truth, *f.odometry) for f in found} for name, found in frames.items()}
    first = poses[names[0]]
    for other in poses.values():
        common = sorted(first.keys() & other.keys())
        assert len(common) > 20
        np.testing.assert_allclose([other[t] for t in common], [first[t] for t in common], atol=1e-12)
    plain, cluttered = (
        next(f.scan for f in frames[f"office-0000-lidar-lds01-clutter-{c}"] if f.scan is not None) for c in "02"
    )
    same = plain.ranges == cluttered.ranges
    assert 0.2 < same.mean() < 0.98  # the same noise, where nothing new is in the way


def test_a_variant_is_made_again_from_its_config(tmp_path):
    assert simulate(tmp_path / "a", "--vary", "noise=0.5", "--format", "rosbag2-lean") == 0
    name = "office-0000-noise-0.5"
    with pytest.raises(SystemExit) as end:
        main(["simulate", "--config", str(tmp_path / "a" / name / "config.toml"), "--out", str(tmp_path / "b")])
    assert end.value.code == 0
    for file in (tmp_path / "a" / name).iterdir():
        assert file.read_bytes() == (tmp_path / "b" / name / file.name).read_bytes()


def test_recorded_commands_of_a_dataset_repeat_it(tmp_path):
    assert simulate(tmp_path / "a", "--format", "parquet") == 0
    dataset = tmp_path / "a" / "office-0000"
    again = ["--driver", "recorded", "--commands", str(dataset), "--format", "parquet"]
    assert simulate(tmp_path / "b", *again) == 0
    for file in ("frames.parquet", "truth.tum", "truth_map.pgm"):
        assert (dataset / file).read_bytes() == (tmp_path / "b" / "office-0000" / file).read_bytes()
    drive = tomllib.loads((dataset / "config.toml").read_text())["drive"]
    assert drive == {"finished": False, "stuck": False, "collided": False, "recoveries": 0, "seconds": 3.0}


def test_settings_are_taken_over_with_their_types():
    made = variants(SimulatorOptions(), ["odometry.grade=good,poor", "layers.range-noise=false", "beams=90"])
    assert [variant.simulator.odometry.grade for variant in made] == ["good", "poor"]
    assert all(variant.simulator.layers.range_noise is False for variant in made)
    assert made[0].simulator.simulation(0).lidar.beams == 90
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
