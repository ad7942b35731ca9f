# SPDX-License-Identifier: MIT
"""What the wheels say on the Intel log: the figures that its datasets' page states."""

import os
from pathlib import Path

import pytest

from eval.trajectory.relations import read_relations, relation_error
from testbed.formats import open_log
from testbed.systems.entrant import PythonSystem

INTEL = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).parents[4] / "shared" / "datasets")) / "intel"


@pytest.mark.skipif(not INTEL.is_dir(), reason=f"no log in {INTEL}")
def test_the_wheels_of_intel_are_as_wrong_as_published():
    relations = read_relations(INTEL / "intel-resolved.relations")
    estimated, _ = PythonSystem("odometry").run(open_log(INTEL / "intel-merged.clf.gz").frames, seed=0)
    found = relation_error(estimated.dense, relations).all
    assert found.translation.mean == pytest.approx(6.745, abs=0.001)
    assert found.translation.std == pytest.approx(13.19, abs=0.01)
    assert found.rotation.mean == pytest.approx(38.4, abs=0.1)
