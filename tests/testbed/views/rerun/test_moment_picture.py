# SPDX-License-Identifier: MIT
"""Pictures of moments show what was at that time."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from testbed.views import moments_of
from testbed.views.rerun import entities
from testbed.views.rerun.moment_picture import MomentPictures, _weight
from testbed.views.rerun.recorded import Event
from testbed.views.rerun.recorded import Recorded as Reader
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
    pictures = MomentPictures(recorded.path)
    start, said = recorded.snapshots[0].stamp, set()
    for snapshot in recorded.snapshots[::7]:
        time = snapshot.stamp - start
        row = rows.latest(entities.NOW, time)
        assert row is not None
        (words,) = row["TextDocument:text"].as_py()
        assert words == pictures._places(time)
        x, y, _ = snapshot.truth
        assert f"truth ({x:.2f}, {y:.2f}) m" in words
        said.update(word for word in ("inside", "outside", "is", "was") if f" {word} " in words)
    assert said == {"inside", "outside", "is", "was"}


def test_histories_reach_the_particles_at_every_time(recorded: Recorded) -> None:
    """Also between the times at which the tree was logged: there they go on through the particles of each update."""
    rows, pictures = Reader(recorded.path), MomentPictures(recorded.path)
    logged, updates = rows.times(entities.PARTICLE_PATHS), rows.times(entities.PARTICLES)
    between = updates[~np.isclose(updates[:, None], logged).any(axis=1)]
    assert len(between) > 10
    for time in [*between[::9].tolist(), between[-1]]:
        ends = np.array([line[-1] for line in pictures._histories(time)])
        origins = pictures._origins(rows.latest(entities.PARTICLES, time))
        assert (ends[-len(origins) :] == origins).all()
        longest = max(len(line) for line in pictures._histories(time)[-len(origins) :])
        since = logged[logged < time].max(initial=0.0)
        assert longest == np.count_nonzero((updates >= since - 1e-6) & (updates <= time + 1e-6))


def test_two_pictures_to_compare_show_the_same_places(recorded: Recorded) -> None:
    pictures = MomentPictures(recorded.path)
    (centre, reach), (same_centre, same_reach) = pictures._frame_around([5.0, 6.0]), pictures._frame_around([6.0, 5.0])
    assert (centre == same_centre).all()
    assert reach == same_reach
    for time in (5.0, 6.0):
        assert np.hypot(*(pictures._robot(time)[:2] - centre)) < reach
    assert reach > pictures._frame_around([5.0])[1]


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
