# SPDX-License-Identifier: MIT
"""What is said of one moment of a run, from its recording."""

from __future__ import annotations

import textwrap

import numpy as np

from slam import se2
from testbed.views.rerun import entities
from testbed.views.rerun.drawing import ELLIPSE_SIGMAS
from testbed.views.rerun.figure_parts import (
    seen_from,
)
from testbed.views.rerun.now import MIN_DEVIATION, in_words
from testbed.views.rerun.other_particles import first_comparison
from testbed.views.rerun.recorded import (
    TIME,
    Event,
    Recorded,
    ellipse,
    points,
    pose,
)

LEVELS = ("INFO", "WARN", "ERROR")
"""Of several events at one time the one of the highest level is printed, a change of the best particle last."""
RECENT_EVENT_S = 20.0
"""The last event is printed for this long [s]."""


def _weight(event: Event) -> tuple[float, int, bool]:
    """Of two events the one with the larger weight is printed."""
    return event.time, LEVELS.index(event.level), not event.text.startswith(entities.ANOTHER_BEST_EVENT)


class MomentWords:
    """Words for moments of one run. Times are seconds since the first scan."""

    def __init__(self, recorded: Recorded) -> None:
        self._recorded = recorded
        self._T_world_map = pose(recorded.fixed(entities.SLAM))

    def before_comparison(self, time: float) -> str:
        """Words that stand where the maps of other particles will; empty from their first comparison on, and where the
        run has none."""
        first = first_comparison(self._recorded)
        return f"Maps of other particles: first compared at {first:.1f} s" if first is not None and first > time else ""

    def age_of_particles(self, time: float) -> str:
        """How long ago the last update was, in words; empty where it was just now."""
        row = self._recorded.latest(entities.PARTICLES, time)
        scan = self._recorded.latest(entities.ESTIMATED_ROBOT, time)
        if row is None or scan is None or scan[TIME] - row[TIME] < 0.05:
            return ""
        return f" {scan[TIME] - row[TIME]:.1f} s before"

    def headline(self, time: float) -> str:
        """The moment in figures, and the last event."""
        found = []
        for entity, words, scale, unit in (
            (entities.POSITION_ERROR, "position error", 100.0, " cm"),
            (entities.HEADING_ERROR, "heading error", 1.0, "°"),
            (entities.SPREAD, "spread of the particles", 1.0, " cm"),
        ):
            row = self._recorded.latest(entity, time)
            if row is not None:
                found.append(f"{words} {scale * row['Scalars:scalars'].as_py()[0]:.1f}{unit}")
        if size := self._sample_size(time):
            found.append(size)
        states = []
        for lane, words in ((entities.ESTIMATE_STATE, "estimate:"), (entities.SELF_CHECK_STATE, "self-check:")):
            row = self._recorded.latest(lane, time)
            if row is not None:
                states.append(f"{words} {row['StateChange:state'].as_py()[0]}")
        lines = [f"{self._recorded.name or 'run'} at {time:.1f} s: {self._places(time)}"]
        lines += [";  ".join(part) for part in (found, states) if part]
        past = [event for event in self._recorded.events() if time - RECENT_EVENT_S <= event.time <= time + 1e-6]
        if past:
            last = max(past, key=_weight)
            lines.append(textwrap.shorten(f"last event, {last.time:.1f} s: {last.text}", 150, placeholder=" …"))
        return "\n".join(lines)

    def _sample_size(self, time: float) -> str:
        """The effective sample size at the last update, in words; empty where it is unknown. It is measured before a
        resampling: the particles that are drawn are those after it, and weigh the same."""
        row, particles = (self._recorded.latest(name, time) for name in (entities.ESS_VALUE, entities.PARTICLES))
        if row is None:
            return ""
        words = f"effective sample size {row['Scalars:scalars'].as_py()[0]:.1f}"
        resampled = self._recorded.latest(entities.ESS_RESAMPLED, time)
        if resampled is None or particles is None or resampled[TIME] != row[TIME]:
            return words
        return f"{words} before resampling, {len(points(particles['Arrows3D:origins']))} after"

    def _places(self, time: float) -> str:
        """Where the robot is by the estimate and by the truth, and whether the filter's ellipse held the truth when it
        was made, in words."""
        robot, true = (self._recorded.latest(name, time) for name in (entities.ESTIMATED_ROBOT, entities.TRUE_ROBOT))
        assert robot is not None
        spread, within = self._recorded.latest(entities.COVARIANCE, time), None
        then = None if spread is None else self._recorded.latest(entities.TRUE_ROBOT, spread[TIME])
        if spread is not None and then is not None:
            shape = seen_from(self._T_world_map, ellipse(spread))
            off = se2.transform_points(se2.inverse([*shape.centre, shape.angle]), [pose(then)[:2]])[0]
            within = bool(np.hypot(*(off / np.maximum(shape.half, ELLIPSE_SIGMAS * MIN_DEVIATION))) <= 1.0)
        age = 0.0 if spread is None else float(robot[TIME] - spread[TIME])
        return in_words(se2.compose(self._T_world_map, pose(robot)), None if true is None else pose(true), within, age)
