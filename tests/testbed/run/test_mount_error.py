# SPDX-License-Identifier: MIT
"""A lidar that sits elsewhere than its recording says is found by its own motion; a sound one is not doubted."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slam import se2
from testbed.formats import Log
from testbed.formats.write import write_log
from testbed.inspect import Reading
from testbed.run.mount_error import find_mount_error
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from tests.shell import assert_refused, call
from worlds import load

pytestmark = pytest.mark.usefixtures("without_pictures")
WRONG = np.array([0.05, -0.03, math.radians(2.0)])


def drive(turns, seed=1, odometry_noise=0.005, path_noise=0.002, drift=0.01, scale=1.02):
    """Odometry and true poses (n, 3) of a drive at 0.3 m/s whose turn rates [rad/s] change every 4 s."""
    rng = np.random.default_rng(seed)
    rates = np.repeat(turns, 40)
    steps = np.stack([np.full(rates.size, 0.03), 0.0 * rates, 0.1 * rates], axis=1)
    true, odometry = [np.zeros(3)], [np.zeros(3)]
    for step in steps:
        true.append(se2.compose(true[-1], step))
        error = odometry_noise * math.sqrt(0.03) * rng.standard_normal(3) * [1.0, 0.0, 1.0]
        odometry.append(se2.compose(odometry[-1], step * [scale, 1.0, 1.0] + error + [0.0, 0.0, 0.03 * drift]))
    path = np.array(true)
    return np.array(odometry), path, path_noise * rng.standard_normal(path.shape) * [1.0, 1.0, 0.3]


TURNING = np.array([0.0, 0.5, 0.0, -0.6, 0.0, 0.4, 0.3, 0.0, -0.5, 0.0] * 3)


@pytest.mark.parametrize("wrong", [WRONG, -WRONG, np.array([0.2, 0.1, 3.0]), np.zeros(3)])
def test_the_error_is_that_of_the_mount(wrong):
    odometry, true, noise = drive(TURNING)
    error = find_mount_error(odometry, se2.compose(true, wrong) + noise)
    np.testing.assert_array_less(np.abs(error.offset - wrong), 3.5 * error.deviations)
    np.testing.assert_array_less(np.abs(error.offset - wrong), [0.005, 0.005, math.radians(0.15)])
    assert error.scale == pytest.approx(1.02, abs=4.0 * error.scale_deviation)
    assert error.significant == tuple((np.abs(wrong) > 0.0).tolist())


def test_without_noise_it_is_exact():
    odometry, true, _ = drive(TURNING, odometry_noise=0.0, scale=1.0, drift=0.0)
    error = find_mount_error(odometry, se2.compose(true, WRONG))
    np.testing.assert_allclose(error.offset, WRONG, atol=1e-5)
    assert error.scale == pytest.approx(1.0, abs=1e-5)


def test_deviations_are_those_of_many_drives():
    drives = [drive(TURNING, seed=seed, odometry_noise=0.03, path_noise=0.01) for seed in range(40)]
    errors = [find_mount_error(odometry, se2.compose(true, WRONG) + noise) for odometry, true, noise in drives]
    apart = np.array([(error.offset - WRONG) / error.deviations for error in errors])
    assert (np.sqrt((apart**2).mean(axis=0)) < 1.3).all()
    assert (np.sqrt((apart**2).mean(axis=0)) > 0.3).all()


def test_driving_straight_on_shows_the_angle_but_no_place():
    odometry, true, noise = drive(np.zeros(20))
    error = find_mount_error(odometry, se2.compose(true, WRONG) + noise)
    assert error.offset[2] == pytest.approx(WRONG[2], abs=math.radians(0.15))
    assert error.deviations[1] > 0.1
    assert error.significant == (False, False, True)


def test_slips_do_not_count():
    odometry, true, noise = drive(TURNING)
    steps = se2.between(odometry[:-1], odometry[1:])
    steps[[200, 500, 800], 0] += 0.3  # a wheel spins
    slipped = [odometry[0]]
    for step in steps:
        slipped.append(se2.compose(slipped[-1], step))
    error = find_mount_error(np.array(slipped), se2.compose(true, WRONG) + noise)
    np.testing.assert_array_less(np.abs(error.offset - WRONG), [0.005, 0.005, math.radians(0.15)])


def test_a_short_drive_says_nothing():
    odometry, true, _ = drive(np.zeros(3))
    assert find_mount_error(odometry, true) is None


@pytest.fixture(scope="module")
def askew(tmp_path_factory):
    """A drive whose lidar sits at `WRONG` from where the recording says, and the sound one."""
    config = SimulationConfig(backend="fast", duration=25.0, seeds=RunSeeds.from_seed(4))
    log = Log.from_frames(list(simulate(load("office"), config)), path=Path("drive"), format="simulation")
    path = tmp_path_factory.mktemp("askew")
    stated = se2.compose(se2.inverse(WRONG), log.table.mounts)
    write_log(path / "sound", log, "parquet")
    write_log(path / "askew", replace(log, table=replace(log.table, mounts=stated)), "parquet")
    return path


def run_of(log, out, *options):
    assert call("slam", log, "--particles", "3", "--out", out, *options) == 0
    return json.loads((out / "metrics.json").read_text())


@pytest.mark.slow  # two whole runs; the estimate itself, and that a sound mount is not noted, are among the fast tests
def test_a_lidar_mounted_askew_is_noted_and_put_right(askew, tmp_path):
    metrics = run_of(askew / "askew", tmp_path / "askew")
    (note,) = (note for note in metrics["notes"] if note.startswith("mount: "))
    assert note in (tmp_path / "askew" / "report.html").read_text()
    assert re.search(r"further ahead, .* further right, turned by 2\.\d ± 0\.1 deg left than the recording says", note)
    mount = metrics["mount"]
    assert mount["x_m"] == pytest.approx(WRONG[0], abs=0.005)
    assert mount["y_m"] == pytest.approx(WRONG[1], abs=0.005)
    assert mount["angle_deg"] == pytest.approx(2.0, abs=0.1)
    option = re.search(r"--mount-correction (\S+)", note)[1]
    mended = run_of(askew / "askew", tmp_path / "mended", "--mount-correction", option)
    assert not any(note.startswith("mount: ") for note in mended["notes"])
    assert mended["trajectory"]["ate_rmse_m"] < 0.5 * metrics["trajectory"]["ate_rmse_m"]


def test_a_sound_mount_is_not_noted(askew, tmp_path):
    metrics = run_of(askew / "sound", tmp_path / "run")
    assert not any(note.startswith("mount: ") for note in metrics["notes"])
    assert metrics["mount"]["is_off"] is False
    assert abs(metrics["mount"]["angle_deg"]) < 0.15


def test_a_correction_is_composed_with_the_stated_mount(askew):
    stated, corrected = (
        Reading(mount_correction=text).open(askew / "sound").table.mounts for text in (None, "0.1,-0.02,90")
    )
    np.testing.assert_allclose(corrected[0], se2.compose([0.1, -0.02, math.pi / 2.0], stated[0]))


@pytest.mark.parametrize("text", ["0.1", "a,b,c", "1,2,3,4", "1e9,0,0", "nan,0,0"])
def test_a_correction_that_is_none_is_refused(askew, tmp_path, capsys, text):
    assert_refused(capsys, "expected X,Y,DEG", "slam", askew / "sound", "--mount-correction", text)
