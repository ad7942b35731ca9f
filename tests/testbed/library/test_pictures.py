# SPDX-License-Identifier: MIT
"""What a notebook shows of maps, paths, scans, logs, the filter and runs."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import testbed
import testbed.library as tb
from slam import GMapping
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from testbed.frame import Frame
from testbed.library import pictures, shown_run
from testbed.views import DEMO, OpenedRun
from tests.eval.synthetic_run import write_run

formatters = pytest.importorskip("IPython.core.formatters")


@pytest.fixture(scope="module")
def drive() -> tb.Drive:
    return tb.simulate("loop", duration=2, settings={"lidar": "lds01"})


@pytest.fixture(scope="module")
def shown():
    """What a notebook shows of an object."""
    formatter = formatters.HTMLFormatter()
    pictures.register(formatter)
    return formatter


def drawn(page: str) -> str:
    """The drawing in a page."""
    (picture,) = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", page)
    return base64.b64decode(picture).decode()


def test_each_object_shows_its_line_and_a_picture(drive, shown, tmp_path) -> None:
    mapper = GMapping(seed=0)
    frame = next(frame for frame in drive.frames if frame.scan is not None)
    mapper.process(frame.odometry, frame.scan)
    result = tb.run("odometry", drive)
    for thing in (mapper, mapper.map(), result.trajectory, frame.scan):
        page = shown(thing)
        assert page.startswith(f"<p>{repr(thing).replace('<', '&lt;').replace('>', '&gt;')}")
        assert "<svg" in drawn(page)
        assert len(page) < 400_000
    assert "<svg" in drawn(shown(frame))
    assert "no scan" in shown(Frame(stamp=0.0, odometry=np.zeros(3)))


def test_the_hits_of_a_scan_are_drawn_where_the_robot_sees_them() -> None:
    """The lidar looks back: what is in front of it is behind the robot."""
    scan = Scan(ranges=np.array([2.0, 9.0]), angles=np.zeros(2), range_max=5.0, mount=(0.5, 0.0, np.pi))
    seen: list[np.ndarray] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures.plots, "svg_uri", lambda figure: seen.append(figure.axes[0].lines[0].get_xydata()) or "")
        pictures.of_scan(scan)
    np.testing.assert_allclose(seen[0], [[-1.5, 0.0]], atol=1e-12)


def test_what_is_empty_is_a_line_without_a_picture(shown) -> None:
    grid = OccupancyGrid(probability=np.full((2, 2), np.nan, np.float32), resolution=0.1, origin=(0.0, 0.0, 0.0))
    for thing in (grid, GMapping(seed=0)):
        assert "<img" not in shown(thing)


def test_a_run_shows_outcome_paths_and_the_viewer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = write_run(tmp_path / "run")
    (run / "recording.rrd").touch()
    ended: list[str] = []
    process = SimpleNamespace(terminate=lambda: ended.append("terminate"), wait=lambda: None)
    opened = OpenedRun(process=process, address="http://127.0.0.1:1/?url=a&b=c")
    monkeypatch.setattr(shown_run, "open_run", lambda path, serve: opened)
    found = testbed.show(run)
    page = found._repr_html_()
    assert repr(found).startswith("<Run run: ok, error 0.")
    assert "<svg" in drawn(page)
    assert '<iframe src="http://127.0.0.1:1/?url=a&amp;b=c"' in page
    found.close()
    assert ended == ["terminate"]
    assert "<iframe" not in testbed.show(run, viewer=False)._repr_html_()


@pytest.mark.slow
def test_the_demo_is_served_and_ends() -> None:
    found = testbed.show(DEMO)
    assert found.viewer is not None
    assert found.viewer.process.poll() is None
    found.close()
    assert found.viewer.process.poll() is not None
