# SPDX-License-Identifier: MIT
"""Pictures of moments show what was at that time."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from eval.map.grids import cell_centres
from eval.report import plots
from slam.se2 import transform_points
from testbed.views import moments_of
from testbed.views.map_cells import grey_levels, probability_of_greys
from testbed.views.rerun import entities
from testbed.views.rerun.figure_parts import show_around
from testbed.views.rerun.moment_picture import MomentPictures
from testbed.views.rerun.moment_scene import MAX_SCAN_REACH, PAIR_WIDE, SCAN_SHARE
from testbed.views.rerun.moment_words import _weight
from testbed.views.rerun.recorded import Event, points
from testbed.views.rerun.recorded import Recorded as Reader
from testbed.views.rerun.scene import styles
from tests.testbed.views.conftest import Recorded

PINK = (220, 40, 140)


def picture(run: Path, time: float) -> NDArray[np.int64]:
    """A moment as colours (rows, columns, 3)."""
    moments = moments_of(run)
    assert moments is not None
    return np.asarray(Image.open(io.BytesIO(moments.png(time))).convert("RGB"), dtype=np.int64)


def test_the_map_grows_and_the_robot_moves(recorded: Recorded) -> None:
    early, late = (picture(recorded.path, time) for time in (1.0, 20.0))
    assert early.shape == late.shape
    black_early, black_late = ((shot.max(axis=2) < 60).sum() for shot in (early, late))
    assert black_late > black_early
    assert (np.abs(late - PINK).max(axis=2) < 60).sum() > 50  # the scan
    assert (early != late).any(axis=2).mean() > 0.02
    assert (picture(recorded.path, 1.0) == early).all()


def test_picture_and_viewer_say_the_same_of_both_positions(recorded: Recorded) -> None:
    rows = Reader(recorded.path)
    pictures = MomentPictures(Reader(recorded.path))
    start, said = recorded.snapshots[0].stamp, set()
    for snapshot in recorded.snapshots[::7]:
        time = snapshot.stamp - start
        row = rows.latest(entities.NOW, time)
        assert row is not None
        (words,) = row["TextDocument:text"].as_py()
        assert words == pictures._words._places(time)
        x, y, _ = snapshot.truth
        assert f"truth ({x:.2f}, {y:.2f}) m" in words
        said.update(word for word in ("inside", "outside", "is", "was") if f" {word} " in words)
    assert said == {"inside", "outside", "is", "was"}


def test_histories_reach_the_particles_at_every_time(recorded: Recorded) -> None:
    """Also between the times at which the tree was logged: there they go on through the particles of each update."""
    rows, pictures = Reader(recorded.path), MomentPictures(Reader(recorded.path))
    logged, updates = rows.times(entities.PARTICLE_PATHS), rows.times(entities.PARTICLES)
    between = updates[~np.isclose(updates[:, None], logged).any(axis=1)]
    assert len(between) > 10
    for time in [*between[::9].tolist(), between[-1]]:
        ends = np.array([line[-1] for line in pictures._scene._histories(time)])
        origins = pictures._scene._origins(rows.latest(entities.PARTICLES, time))
        assert (ends[-len(origins) :] == origins).all()
        longest = max(len(line) for line in pictures._scene._histories(time)[-len(origins) :])
        since = logged[logged < time].max(initial=0.0)
        assert longest == np.count_nonzero((updates >= since - 1e-6) & (updates <= time + 1e-6))


def test_two_pictures_to_compare_show_the_same_places(recorded: Recorded) -> None:
    pictures = MomentPictures(Reader(recorded.path))
    (centre, reach), (same_centre, same_reach) = (
        pictures._scene.frame_around(time, [time, other]) for time, other in ((5.0, 6.0), (6.0, 5.0))
    )
    assert (centre == same_centre).all()
    assert reach == same_reach
    for time in (5.0, 6.0):
        assert np.hypot(*(pictures._scene.robot(time)[:2] - centre)) < reach
    assert reach > pictures._scene.frame_around(5.0, [5.0])[1]


def test_the_scale_is_seen_on_a_black_wall() -> None:
    """At 100 pixels a metre: the bar of 2 m lies in a light box."""
    figure = Figure(figsize=(6.4, 4.0), dpi=100)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), facecolor="black")
    show_around(axes, np.array([3.0, 7.0]), 2.0)
    axes.set(xlim=(-0.2, 6.2), ylim=(5.0, 9.0))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    dark = np.asarray(canvas.buffer_rgba())[..., :3].max(axis=2) < 60
    rows, columns = np.nonzero(~dark)
    box = dark[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert (~box[0]).all()
    assert (~box[-1]).all()
    bar = box.sum(axis=1).max()
    assert bar == pytest.approx(200, abs=3)


def test_pictures_of_places_far_apart_have_one_scale(recorded: Recorded) -> None:
    """The robot has driven so far that one view of both places would show the particles as specks."""
    pictures = MomentPictures(Reader(recorded.path))
    times = [1.0, 15.0]
    frames = [pictures._scene.frame_around(time, [time, *times]) for time in times]
    for time, (centre, reach) in zip(times, frames, strict=True):
        assert (centre == pictures._scene.robot(time)[:2]).all()
        assert reach == max(pictures._scene.frame_around(other, [other])[1] for other in times)


def test_two_moments_side_by_side_hold_robots_and_most_of_the_scans(recorded: Recorded) -> None:
    rows, pictures = Reader(recorded.path), MomentPictures(Reader(recorded.path))
    times = [5.0, 7.0]
    centre, reach = pictures._scene.frame_of_scans(times)
    for time in times:
        scan = rows.latest(entities.SCAN, time)
        assert scan is not None
        robot = pictures._scene.robot(time)
        ends = transform_points(robot, points(scan["Points3D:positions"]))
        near = ends[np.hypot(*(ends - robot[:2]).T) <= MAX_SCAN_REACH]
        assert len(near) > 50
        for places, share in ((near, 1.0 - 4.0 * (1.0 - SCAN_SHARE)), (robot[None, :2], 1.0)):
            inside = (np.abs(places - centre) <= [PAIR_WIDE * reach, reach]).all(axis=1)
            assert inside.mean() >= share
    shot = np.asarray(Image.open(io.BytesIO(pictures.side_by_side(*times))).convert("RGB"), dtype=np.int64)
    half = shot.shape[1] // 2
    for part in (shot[:, :half], shot[:, half:]):
        assert (np.abs(part - PINK).max(axis=2) < 60).sum() > 50  # each has its scan
        assert (part.max(axis=2) < 60).sum() > 500  # and walls
    assert (shot[:400, :half] != shot[:400, -half:]).any()


def test_the_sample_size_is_named_before_and_after_a_resampling(recorded: Recorded) -> None:
    """The particles that are drawn are those after it: all weigh the same, so that their number is their size."""
    pictures, rows = MomentPictures(Reader(recorded.path)), Reader(recorded.path)
    updates = [snapshot for snapshot in recorded.snapshots if snapshot.step is not None and snapshot.step.updated]
    said = set()
    for snapshot in updates:
        time = snapshot.stamp - recorded.snapshots[0].stamp
        words = f"effective sample size {snapshot.step.ess:.1f}"
        if snapshot.step.resampled:
            weights = rows.latest(entities.PARTICLES, time)
            assert weights is not None
            assert len(set(weights["Arrows3D:colors"].as_py())) == 1
            words += f" before resampling, {len(snapshot.poses)} after"
        assert pictures._words._sample_size(time) == words
        said.add(snapshot.step.resampled)
    assert said == {True, False}


def test_the_map_of_a_moment_is_the_one_that_is_drawn(recorded: Recorded) -> None:
    grid, last = MomentPictures(Reader(recorded.path)).map_at(np.inf), recorded.snapshots[-1]
    assert grid is not None
    assert last.map is not None
    true = last.map(None)
    rows, columns = np.nonzero(true.occupied)
    places = cell_centres(true, true.occupied)
    offset = np.floor((places - grid.origin[:2]) / grid.resolution).astype(int)
    assert len(rows) == len(columns) == len(places) > 100
    assert grid.occupied[offset[:, 1], offset[:, 0]].mean() > 0.95
    assert grid.occupied.sum() == pytest.approx(true.occupied.sum(), rel=0.05)


def test_loops_and_scans_have_the_colours_of_the_recording_in_the_report() -> None:
    of_report = [plots.SCAN, plots.LOOP_CLOSED, plots.LOOP_LEFT_OPEN]
    closed, left_open, _ = entities.FINAL_LOOPS
    of_recording = [styles.SCAN, styles.FINAL_LOOPS[closed], styles.FINAL_LOOPS[left_open]]
    assert [tuple(round(255 * part) for part in to_rgb(colour)) for colour in of_report] == of_recording


def test_grey_levels_give_their_probabilities_back() -> None:
    probability = np.array([np.nan, 0.12, 0.2, 0.45, 0.55, 0.8, 0.97])
    assert probability_of_greys(grey_levels(probability)) == pytest.approx(probability, abs=0.02, nan_ok=True)


@pytest.mark.slow
def test_a_time_beyond_the_run_shows_its_end(recorded: Recorded) -> None:
    end = recorded.snapshots[-1].stamp - recorded.snapshots[0].stamp
    assert (picture(recorded.path, np.inf) == picture(recorded.path, end)).all()


def test_what_holds_no_run_is_refused(tmp_path: Path) -> None:
    assert moments_of(tmp_path) is None
    (tmp_path / "recording.rrd").touch()
    with pytest.raises(ValueError, match=r"recording\.rrd: expected"):
        moments_of(tmp_path)


def test_of_two_events_the_one_that_says_more_is_printed() -> None:
    resampled = Event(5.0, "INFO", "resampled: 11 particles died")
    best = Event(5.0, "INFO", "another particle became the best: the reported pose moved by 3.0 cm")
    warning, later = Event(5.0, "WARN", "matching failed"), Event(6.0, "INFO", best.text)
    assert max([best, resampled], key=_weight) is max([resampled, best], key=_weight) is resampled
    assert max([resampled, warning, best], key=_weight) is warning
    assert max([warning, later], key=_weight) is later
