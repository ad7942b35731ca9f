# SPDX-License-Identifier: MIT
"""The table of a stress test is read as it was written, and the page says what it says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eval.survival.page import survival_bars, survival_rows, write_stress_page
from eval.survival.results import UNPERTURBED, Run, Scale, read_runs, thresholds, write_runs

SCALES = {"askew": Scale("degrees", "turned", lambda severity: 100.0 * severity)}


def run(turn: int, severity: float | None = None, outcome: str = "ok", system: str = "mine") -> Run:
    name = UNPERTURBED if severity is None else "askew"
    value = None if severity is None else 100.0 * severity
    return Run(
        system=system, perturbation=name, severity=severity, value=value, place="office", seed=turn, turn=turn,
        outcome=outcome, reason=f"because of {outcome}", key=f"{system}{turn}{severity}",
    )  # fmt: skip


RUNS = [
    *(run(k, outcome="lost" if k == 0 else "ok") for k in range(4)),
    *(run(k, severity, "lost" if severity > 0.4 else "drift") for k, severity in enumerate(np.linspace(0, 1, 21))),
    *(run(k, severity, "ok", "other") for k, severity in enumerate(np.linspace(0, 1, 21))),
]


def test_runs_are_read_as_they_were_written_and_equal_runs_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_runs(tmp_path / name, RUNS, {"command": "testbed stress"})
    assert read_runs(tmp_path / "a") == RUNS
    assert (tmp_path / "a" / "stress.parquet").read_bytes() == (tmp_path / "b" / "stress.parquet").read_bytes()


@pytest.mark.parametrize(
    ("outcome", "failed"),
    [("ok", False), ("drift", False), ("lost", True), ("broken loop", True), ("failed", True), ("unjudged", True)],
)
def test_runs_fail_by_the_outcomes_of_sweeps(outcome: str, failed: bool) -> None:
    assert run(0, 0.5, outcome).has_failed is failed


def test_thresholds_are_of_each_system_and_perturbation() -> None:
    found = thresholds(RUNS)
    assert set(found) == {("mine", "askew"), ("other", "askew")}
    assert found["mine", "askew"].value == pytest.approx(0.42, abs=0.05)
    assert found["other", "askew"].value > 1.0


def test_rows_state_values_with_intervals_and_what_lies_beyond() -> None:
    plain, askew = survival_rows(RUNS, SCALES)
    assert plain == ("nothing", "failed runs", "1 of 4 (5% to 70%)", "0 of 0")
    assert askew[:2] == ("askew", "degrees")
    value, low, high = (float(word.strip("()")) for word in askew[2].replace("to ", "").split())
    assert low < 41 < high
    assert value == pytest.approx(42, abs=5)
    assert askew[3].startswith("beyond 100 (")


def test_a_system_that_fails_on_every_drive_as_it_is_survives_nothing(tmp_path: Path) -> None:
    """It passes only where so few scans are left that it does not come to fail."""
    runs = [*RUNS, run(0, outcome="failed", system="broken"), run(0, 0.9, "ok", "broken")]
    assert set(thresholds(runs)) == set(thresholds(RUNS))
    assert survival_rows(runs, SCALES)[1][4] == "fails as they are"
    page = write_stress_page(tmp_path, runs, SCALES, about="On office.", command="testbed stress mine").read_text()
    assert "What broken survives" not in page


def test_the_page_holds_table_bars_and_an_example_of_a_failure(tmp_path: Path) -> None:
    page = write_stress_page(tmp_path, RUNS, SCALES, about="On office.", command="testbed stress mine").read_text()
    for text in ("On office.", "testbed stress mine", "because of lost", "What mine survives", "beyond 100"):
        assert text in page
    assert (tmp_path / "table.md").read_text().count("\n") == 4
    bars = [bar.get_width() for bar in survival_bars({"mine": thresholds(RUNS)}, SCALES).axes[0].patches]
    assert bars == [pytest.approx(0.42, abs=0.05)]


def test_a_page_of_no_perturbed_run_is_a_page(tmp_path: Path) -> None:
    assert write_stress_page(tmp_path, RUNS[:4], SCALES, about="a", command="c").is_file()
