# SPDX-License-Identifier: MIT
"""The scan that `testbed score` puts beside the moment that it names."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.cli import score
from testbed.frame import Frame
from tests.testbed.views.synthetic import scan_at, truth_at


def test_the_scan_nearest_to_the_moment_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames = [Frame(stamp=t, odometry=truth_at(t), scan=scan_at(truth_at(t), t)) for t in (0.0, 2.0, 4.0)]
    monkeypatch.setattr(score, "_recording", lambda dataset: dataset)
    monkeypatch.setattr(score, "open_log", lambda path: SimpleNamespace(frames=frames))
    points = score._scan_points(tmp_path, 2.1)
    assert len(points) > 0.9 * np.count_nonzero(scan_at(truth_at(2.0), 2.0).hit)
    ranges = scan_at(truth_at(2.0), 2.0).ranges
    np.testing.assert_allclose(np.sort(np.hypot(*points.T)), np.sort(ranges)[: len(points)], atol=0.05)
    assert len(score._scan_points(tmp_path, 10.0)) == 0


def test_without_a_recording_there_are_no_points(tmp_path: Path) -> None:
    assert score._scan_points(tmp_path, 0.0).shape == (0, 2)
