# SPDX-License-Identifier: MIT
"""Pictures of moments of a comparison show each system as it was at that time."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from testbed.views import moments_of, record_systems
from testbed.views.rerun import systems_picture
from testbed.views.rerun.recorded import Recorded
from testbed.views.rerun.systems_picture import SystemsPictures, systems_in
from tests.testbed.views.rerun.test_frames_recording import frames
from tests.testbed.views.rerun.test_systems_recording import BLUE, RED, layers
from tests.testbed.views.synthetic import scene


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("systems") / "recording.rrd"
    record_systems(path, frames(), layers(), scene())
    return path


def figure_of(recording: Path, time: float, monkeypatch: pytest.MonkeyPatch) -> Figure:
    """The figure of a moment, before it becomes a picture."""
    drawn: list[Figure] = []
    monkeypatch.setattr(systems_picture, "as_png", lambda figure: drawn.append(figure) or b"")
    SystemsPictures(Recorded(recording)).png(time)
    return drawn[0]


def line_ends(figure: Figure, panel: int, colour: tuple[int, int, int]) -> NDArray[np.float64]:
    """Where the lines of a colour end in a panel, (lines, 2)."""
    own = [line for line in figure.axes[panel].lines if np.allclose(line.get_color(), np.array(colour) / 255.0)]
    return np.array([line.get_xydata()[np.isfinite(line.get_xydata()[:, 0])][-1] for line in own])


def test_each_system_has_its_error_its_path_and_its_map(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figure = figure_of(recording, 1.0, monkeypatch)
    titles = [axes.get_title() + axes.get_title(loc="left") for axes in figure.axes]
    assert titles[:2] == ["off, 30\N{NO-BREAK SPACE}cm off, no map", "right, 0.0\N{NO-BREAK SPACE}cm off"]
    assert titles[2].startswith("All of them around the robot")
    assert titles[3].startswith("Position error [cm]")
    assert len(figure.axes[1].images) == 1
    truth = frames()[10].truth
    assert np.hypot(*(line_ends(figure, 1, BLUE) - truth[:2]).T).min() < 1e-5
    assert np.hypot(*(line_ends(figure, 0, RED) - truth[:2] - [0.3, 0.0]).T).min() < 1e-5
    assert len(line_ends(figure, 2, BLUE)) > 0
    assert len(line_ends(figure, 2, RED)) > 0


def test_a_system_without_a_pose_says_so(recording: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert figure_of(recording, 0.2, monkeypatch).axes[0].get_title() == "off, no pose yet, no map"
    right, off = layers()
    short = replace(off, rows=off.rows[:5], poses=off.poses[:5], errors=off.errors[:5])
    record_systems(tmp_path / "recording.rrd", frames(), [right, short], scene())
    late = figure_of(tmp_path / "recording.rrd", 1.5, monkeypatch)
    assert late.axes[0].get_title() == "off, no pose since 0.9 s, no map"


def test_without_truth_there_are_no_errors(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    shown = [replace(layer, errors=None) for layer in layers()]
    record_systems(path, [replace(f, truth=None) for f in frames()], shown, replace(scene(), true_map=None))
    figure = figure_of(path, 1.0, monkeypatch)
    assert [axes.get_title() for axes in figure.axes[:2]] == ["off, no map", "right"]
    assert len(figure.axes) == 3


def test_a_comparison_is_drawn_by_systems_and_a_time_beyond_it_shows_its_end(recording: Path) -> None:
    assert systems_in(Recorded(recording)) == ["off", "right"]
    pictures = moments_of(recording.parent)
    assert isinstance(pictures, SystemsPictures)
    assert pictures.end == pytest.approx(2.0)
    last, beyond = (np.array(Image.open(io.BytesIO(pictures.png(time)))) for time in (2.0, np.inf))
    assert (last == beyond).all()
