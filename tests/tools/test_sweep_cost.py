# SPDX-License-Identifier: MIT
"""The cost of a sweep is estimated from a sample of its jobs without bias."""

from pathlib import Path

import numpy as np
import pytest

from testbed.sweep.spec.plan import Costs, plan
from testbed.sweep.spec.spec import parse_spec
from tools.measure.sweep_cost import draw, estimated_total, specification


def grid():
    spec = parse_spec({"worlds": ["apartment", "loop"], "seeds": 3, "particles": [1, 10, 100]}, "x", Path())
    return plan(spec, "code", {}), Costs.of(spec)


def test_exact_predictions_give_the_total_without_error():
    cells, costs = grid()
    whole = sum(map(costs, cells))
    sample = draw(cells, costs, 4, seed=1)
    total = estimated_total([0.01 * costs(c) for c in sample], [costs(c) for c in sample], whole)
    assert total.seconds == pytest.approx(0.01 * whole)
    assert total.error == pytest.approx(0.0, abs=1e-9)


def test_wrong_predictions_give_the_total_on_average_with_their_error():
    """Jobs take 2 s and 0.5 s per particle, which the prediction does not know."""
    cells, costs = grid()
    work, seconds = np.array([costs(c) for c in cells]), np.array([2.0 + 0.5 * c.particles for c in cells])
    of = dict(zip((c.key for c in cells), zip(seconds, work, strict=True), strict=True))
    totals = []
    for seed in range(400):
        drawn = [of[c.key] for c in draw(cells, costs, 20, seed)]
        totals.append(estimated_total(*zip(*drawn, strict=True), work.sum()))
    found = np.array([total.seconds for total in totals])
    assert found.mean() == pytest.approx(seconds.sum(), rel=0.02)
    assert found.std() == pytest.approx(np.mean([total.error for total in totals]), rel=0.1)


def test_presets_and_files_are_read(tmp_path):
    (tmp_path / "own.toml").write_text('worlds = ["loop"]\nseeds = 2\n')
    assert len(specification("particles").worlds) == 23
    assert specification(str(tmp_path / "own.toml")).seeds == (0, 1)
