# SPDX-License-Identifier: MIT
"""Objects of all packages show themselves in a notebook: a line of text with a picture or a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slam import FilterConfig, GMapping, OccupancyGrid, Recording, Scan
from testbed.datasets import open_collection, open_dataset
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.library import notebook
from testbed.library.html import Table
from testbed.library.notebook import SHOWN, html_of
from testbed.systems.feeding import feed
from testbed.systems.odometry import OdometrySystem
from tests.shell import call
from tests.slam.rooms import drive, scan_at


@pytest.fixture(scope="module")
def recording() -> Recording:
    made = Recording(GMapping(FilterConfig(particles=2), threads=1))
    for k, pose in enumerate(drive(3)):
        made.process(pose, scan_at(pose, stamp=0.5 * k))
    return made


def test_what_a_filter_makes_is_drawn(recording: Recording) -> None:
    scan = recording.scans[0]
    frame = Frame(stamp=0.0, odometry=np.zeros(3), scan=scan)
    for thing in (recording, recording.mapper, recording.mapper.map(), recording.refine(threads=1), scan, frame):
        shown = html_of(thing)
        assert shown is not None
        assert "<img" in shown
        assert repr(thing)[1:].partition(" ")[0] in shown
    assert html_of(Frame(stamp=0.0, odometry=np.zeros(3))).startswith("<p>&lt;Frame")
    assert "<img" not in html_of(GMapping(FilterConfig(particles=2), threads=1))


def test_the_hits_of_a_scan_are_drawn_where_the_robot_sees_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lidar looks back: what is in front of it is behind the robot."""
    scan = Scan(ranges=np.array([2.0, 9.0]), angles=np.zeros(2), range_max=5.0, mount=(0.5, 0.0, np.pi))
    seen: list[np.ndarray] = []
    monkeypatch.setattr(notebook.plots, "scan_over_map", lambda scans, *_, **__: seen.append(scans[0].points) or "")
    html_of(scan)
    np.testing.assert_allclose(seen[0], [[-1.5, 0.0]], atol=1e-12)


def test_what_a_system_estimated_is_drawn() -> None:
    frames = [Frame(stamp=0.5 * k, odometry=pose, scan=scan_at(pose, stamp=0.5 * k)) for k, pose in enumerate(drive(3))]
    estimated, _ = feed(OdometrySystem(), "odometry", frames, seed=0)
    shown = html_of(estimated)
    assert "Estimated: poses at 4 scans" in shown
    assert "<img" in shown


def test_what_is_empty_is_a_line_without_a_picture() -> None:
    grid = OccupancyGrid(probability=np.full((2, 2), np.nan, np.float32), resolution=0.1, origin=(0.0, 0.0, 0.0))
    assert "<img" not in html_of(grid)


def test_a_step_is_a_table_and_the_first_had_nothing_to_match(recording: Recording) -> None:
    mapper = GMapping(FilterConfig(particles=2), threads=1)
    first, second = (mapper.process(pose, scan_at(pose, stamp=float(k))) for k, pose in enumerate(drive(1)))
    assert "nothing to match with yet" in repr(first)
    assert "updated, matched" in repr(second)
    assert "<td>ess</td><td>2</td>" in html_of(second)


def test_recordings_and_collections(tmp_path: Path) -> None:
    command = ("simulate", "office", "--backend", "fast", "--duration", 2, "--lidar", "lds01", "--count", 2)
    assert call(*command, "--out", tmp_path / "data") == 0
    dataset = open_dataset(tmp_path / "data" / "office-0000")
    assert "<img" not in html_of(dataset)  # not read for a picture
    assert len(dataset) > 0
    assert "<img" in html_of(dataset)
    assert "<img" in html_of(open_log(tmp_path / "data" / "office-0000"))
    assert html_of(open_collection(tmp_path / "data")).count("<tr>") == 3


def test_they_are_registered_where_a_notebook_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    interactive = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell()
    monkeypatch.setattr("IPython.get_ipython", lambda: None)
    assert not notebook.register()
    monkeypatch.setattr("IPython.get_ipython", lambda: interactive)
    assert notebook.register()
    formatter = interactive.display_formatter.formatters["text/html"]
    assert all(formatter.lookup_by_type(kind) is html_of for kind in SHOWN)


def test_figures_are_a_table_of_dotted_names() -> None:
    figures = Table({"outcome": "ok", "map": {"iou": 0.51234567}})
    assert "<td>map.iou</td><td>0.512346</td>" in figures._repr_html_()
    assert figures == {"outcome": "ok", "map": {"iou": 0.51234567}}
