# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""What carrying out a sweep costs beside its cells, and what a second worker brings. Needs a machine of its own.

python -m pytest -m benchmark tests/benchmarks/test_sweep.py -s
"""

import shutil
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from eval.sweep.report import write_sweep_report
from testbed.kernels import compile_kernels
from testbed.sweep.execute import execute, pending, prepare
from testbed.sweep.execution.compute import compute
from testbed.sweep.execution.local_pool import Event, run_locally
from testbed.sweep.execution.worker_process import Limits
from testbed.sweep.gather import gather
from testbed.sweep.result import CellResult
from testbed.sweep.spec.code_version import code_version
from testbed.sweep.spec.plan import Costs, input_digests, plan, seed_by_seed
from testbed.sweep.spec.spec import SweepSpec, parse_spec
from testbed.sweep.store import SweepDirectory
from tools.measure.sweep_overhead import measure

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1200)]


class Silent:
    """Watches nothing."""

    def event(self, event: Event) -> None:
        """Nothing is done."""


def spec_of(**document: object) -> SweepSpec:
    return parse_spec({"worlds": ["apartment"], "settings": {"refine": False}, **document}, "benchmark", Path())


def carried_out(spec: SweepSpec, out: Path, workers: int) -> tuple[float, float]:
    """Wall time of a sweep, and the sum of its cells' own times [s]."""
    shutil.rmtree(out, ignore_errors=True)
    start = time.perf_counter()
    directory, costs = prepare(out, spec)
    execute(
        directory,
        pending(directory, directory.manifest.cells(), costs, None),
        lambda cells: run_locally(cells, workers, Limits()),
        Silent(),
    )
    wall = time.perf_counter() - start
    gather(directory)
    return wall, sum(pq.read_table(out / "timings.parquet").column("cell_s").to_pylist())


def test_overhead_and_throughput(tmp_path):
    """Under 3 % beside the cells' own time on one worker; two workers at least 1.8 times as fast."""
    compile_kernels()
    spec = spec_of(particles=[50], seeds=24)
    one, own = carried_out(spec, tmp_path / "one", 1)
    two, own_of_two = carried_out(spec, tmp_path / "two", 2)
    print(f"\none worker: {one:.1f} s for {own:.1f} s of cells, overhead {100.0 * (one / own - 1.0):.1f} %")
    print(f"two workers: {two:.1f} s, {one / two:.2f} times as fast; their cells took {own_of_two:.1f} s")
    assert one < 1.03 * own
    assert one / two > 1.8


def test_share_of_the_filter_in_a_whole_sweep(tmp_path):
    """Many small jobs by the command: at most a tenth is forecast, simulation, scoring, worst runs and report."""
    compile_kernels()
    shares = measure(tmp_path / "sweep")
    print(f"\n{shares}")
    assert shares.overhead < 0.1


def test_ten_thousand_cells_are_planned_and_gathered(tmp_path):
    """Planned in under 5 s, gathered in under 30 s, report included."""
    spec = spec_of(
        worlds=["apartment", "office", "loop", "cave", "lab"],
        seeds=100,
        particles=list(range(1, 11)),
        axes={"odometry.grade": ["good", "poor"]},
    )
    start = time.perf_counter()
    costs = Costs.of(spec)
    cells = seed_by_seed(plan(spec, code_version(), input_digests(spec)), costs)
    planned = time.perf_counter() - start
    assert len({cell.key for cell in cells}) == 10_000

    (small,) = plan(spec_of(particles=[1], seeds=1), code_version(), {})
    result = compute(small)
    directory, _ = prepare(tmp_path / "sweep", spec)
    for number, cell in enumerate(cells):
        keep_like(directory, cell, result, number)
    start = time.perf_counter()
    assert gather(directory).complete
    write_sweep_report(directory.path)
    gathered = time.perf_counter() - start
    print(f"\n10,000 cells: planned in {planned:.2f} s, gathered in {gathered:.1f} s")
    assert planned < 5.0
    assert gathered < 30.0


def keep_like(directory: SweepDirectory, cell, result: CellResult, number: int) -> None:
    """The result of one cell as that of another, with another error."""
    error = result.metrics["trajectory_filter"] | {"ate_rmse_m": 0.01 + 1e-6 * number}
    directory.keep(cell, CellResult(result.metrics | {"trajectory_filter": error}, result.curves, result.timing))
