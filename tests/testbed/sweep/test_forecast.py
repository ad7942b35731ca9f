# SPDX-License-Identifier: MIT
"""The forecast adds up what simulation, jobs and particles take, whichever clock measures them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.sweep import forecast
from testbed.sweep.forecast import REPORT_SECONDS, Pace, measure_pace, measured_times, probed_times
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.plan import Costs, plan
from testbed.sweep.spec.spec import parse_spec
from tests.testbed.sweep.room import room_file


def planned(folder: Path, **document):
    """Cells and costs of a sweep of the room, whose tour is 2.06 m long."""
    spec = parse_spec({"worlds": [str(room_file(folder))], **document}, "test", folder)
    return plan(spec, code_version(), {}), Costs.of(spec)


def test_each_drive_is_simulated_once_and_each_particle_counts(tmp_path, monkeypatch):
    settings = {"refine": False}
    cells, costs = planned(tmp_path, particles=[1, 4], seeds=3, settings=settings)
    pace = Pace(drive=7.0, job=0.5, simulation=100.0, fixed=10.0, particle=1.0, final_pass=1e6)
    monkeypatch.setattr(forecast, "measure_pace", lambda *_: {"": pace})
    times = probed_times(cells, costs, 1)
    per_seed = 100.0 + 2 * 10.0 + (1 + 4)
    seed = 7.0 + 2 * 0.5 + per_seed * costs.length(cells[0])
    assert times.total(cells, 1) - REPORT_SECONDS == pytest.approx(3 * seed)
    assert times.total(cells, 2) - REPORT_SECONDS == pytest.approx(1.5 * seed)


def test_jobs_that_are_done_say_what_the_others_take(tmp_path):
    cells, costs = planned(tmp_path, particles=[1, 4, 9], seeds=2)
    cell_s = np.full((1, 1, 3, 2), np.nan)
    cell_s[0, 0, 0], cell_s[0, 0, 1, 0] = [2.0, 4.0], 6.0
    columns = {"cell_s": cell_s, "status": np.full(cell_s.shape, "done", dtype=object)}
    table = SimpleNamespace(places=("room",), lines=("default",), counts=(1, 4, 9), cube=columns.__getitem__)
    times = measured_times(table, cells, costs)
    of = {cell.particles: times.seconds_of(cell) for cell in cells}
    assert (of[1], of[4]) == (3.0, 6.0)
    # as much per predicted work as the two that were measured
    work = {cell.particles: costs(cell) for cell in cells}
    assert of[9] == pytest.approx(work[9] * (3.0 + 6.0) / (work[1] + work[4]))
    columns["cell_s"] = np.full((1, 1, 3, 2), np.nan)
    assert measured_times(table, cells, costs) is None


def test_a_short_duration_shortens_the_drive(tmp_path):
    whole, costs = planned(tmp_path, particles=[1], seeds=1)
    cut, _ = planned(tmp_path, particles=[1], seeds=1, settings={"duration": 2.0, "driver.speed": 0.5})
    assert costs.length(whole[0]) == pytest.approx(2.06, abs=0.01)
    assert costs.length(cut[0]) == pytest.approx(1.0)


def test_the_pace_separates_what_it_measures(tmp_path, monkeypatch):
    cells, costs = planned(tmp_path, particles=[1, 3000], seeds=1, axes={"lidar": ["lds01", "rplidar_a1"]})
    clock = {"now": 0.0}
    simulated = set()

    def simulate(cell):
        """Costs 3 s once a drive, and 2 s a metre; the robot drives 0.25 m/s."""
        drive = cell.settings["lidar"], cell.settings["duration"]
        clock["now"] += (3.0 + 0.5 * cell.settings["duration"]) * (drive not in simulated)
        simulated.add(drive)

    def compute(cell):
        """Costs 1.5 s for the job; a metre costs 1 s, 0.05 s for each particle, and 2 s for the final pass."""
        simulate(cell)
        metres = 0.25 * cell.settings["duration"]
        clock["now"] += 1.5 + metres * (1.0 + 0.05 * cell.particles + 2.0 * cell.settings["refine"])
        return type("Result", (), {"metrics": {"trajectory": {"length_m": metres}}})

    monkeypatch.setattr(forecast, "compute", compute)
    monkeypatch.setattr(forecast, "drawn_recording", simulate)
    monkeypatch.setattr(forecast.time, "perf_counter", lambda: clock["now"])
    paces = measure_pace(cells, costs, 1)
    assert paces.keys() == {"lds01", "rplidar_a1"}
    for pace in paces.values():
        assert tuple(vars(pace).values()) == pytest.approx((3.0, 1.5, 2.0, 1.0, 0.05, 2.0))


def test_logs_and_small_sweeps_are_not_measured(tmp_path):
    cells, costs = planned(tmp_path, particles=[1], seeds=1)
    assert measure_pace(cells, costs, 1) is None
