# SPDX-License-Identifier: MIT
"""`finding.json` keeps a failure and its scan."""

from __future__ import annotations

import json

import numpy as np

from eval.files.failure_json import OLD_NAMES, read_failure, write_failure
from eval.first_failure import find_failure
from eval.trajectory.trajectory import Trajectory


def test_a_failure_comes_back_from_its_file(tmp_path):
    x = 0.1 * np.arange(300)
    truth = Trajectory(x, np.column_stack([x, 0.0 * x, 0.0 * x]))
    failure = find_failure(truth, truth=truth)
    write_failure(tmp_path / "finding.json", failure, [[1.23456, -2.0]])
    back = read_failure(tmp_path / "finding.json")
    assert (back.failure.scan, back.failure.bad, back.failure.reason) == (failure.scan, False, failure.reason)
    np.testing.assert_array_equal(back.failure.true_pose, failure.true_pose)
    np.testing.assert_allclose(back.points, [[1.235, -2.0]])


def test_a_file_of_the_last_release_is_read_and_its_keys_are_written(tmp_path):
    x = 0.1 * np.arange(300)
    truth = Trajectory(x, np.column_stack([x, 0.0 * x, 0.0 * x]))
    path = tmp_path / "finding.json"
    write_failure(path, find_failure(truth, truth=truth), [[1.0, -2.0]])
    document = json.loads(path.read_text())
    assert all(document[old] == document[new] for old, new in OLD_NAMES.items())
    path.write_text(json.dumps({key: value for key, value in document.items() if key not in OLD_NAMES.values()}))
    np.testing.assert_array_equal(read_failure(path).failure.estimated, document["estimated"])
