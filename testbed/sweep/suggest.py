# SPDX-License-Identifier: MIT
"""Suggests a particle count for a world or a log, from the features of a drive and the fit of the experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eval.sweep.needed_count import PREDICTORS, NeededCount, Predictor, predictors_of
from slam.config import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.sweep.errors import SweepError
from testbed.sweep.execution.drive_features import drive_features
from testbed.sweep.execution.recordings import recording_of
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.settings import checked
from worlds import catalogue, label

LOOK_PARTICLES = 5
"""Particles of the run that finds out where the robot of a log has been."""
_WORLD_SUFFIXES = (".toml", ".yaml", ".yml")


@dataclass(frozen=True)
class Reason:
    """What one predictor does to the needed count."""

    words: str
    """The predictor and its value."""
    usual: str
    """Its median in the experiment."""
    needed_if_usual: int | None
    """The needed count if this predictor were at that median; None = more than the largest count."""
    is_shown: bool
    """Whether the experiment shows an effect of this predictor."""
    is_as_expected: bool
    """Whether its effect here goes the way that one expects."""


@dataclass(frozen=True)
class Suggestion:
    """A particle count for a drive, and why."""

    name: str
    needed: int | None
    """The count that the middle one of such worlds needs to be as good as the largest one; None if not even that one
    holds."""
    interval: tuple[int | None, int | None]
    """95 % of the worlds like it need a count in it; None = more than the largest count."""
    start: int
    """The count to start with, which is enough in most worlds like it."""
    chance: float
    """Share of the worlds like it in which `start` is enough."""
    holds: float
    """Probability that a run with `start` particles holds."""
    largest: int
    """The largest count of the experiment."""
    largest_holds: float
    reasons: tuple[Reason, ...]
    outside: tuple[str, ...]
    """Predictors outside of what the experiment covered, in words: the value, and what was measured."""
    record: str
    """How the counts to start with did in worlds that were held out, in words; may be empty."""


def suggest(name: str, features: Mapping[str, Any], model: NeededCount) -> Suggestion:
    """Suggest a particle count for a drive with these features."""
    at = predictors_of(features)
    start = model.start(at)
    holds, largest_holds = model.holds(np.array([start, model.max_count]), at).tolist()
    return Suggestion(
        name=name,
        needed=model.needed(at),
        interval=model.interval(at),
        start=start,
        chance=model.chance(at, start),
        holds=holds,
        largest=model.max_count,
        largest_holds=largest_holds,
        reasons=tuple(_reason(model, at, k) for k in range(len(PREDICTORS))),
        outside=tuple(_outside(model, at, predictor) for predictor in model.outside(at)),
        record=model.record,
    )


def _reason(model: NeededCount, at: np.ndarray, k: int) -> Reason:
    usual = at.copy()
    usual[k] = model.centre[k]
    predictor, needed = PREDICTORS[k], model.needed(usual)
    is_harder = predictor.expected * (at[k] - usual[k]) > 0.0
    more = _or_infinite(model.needed(at)) - _or_infinite(needed)
    return Reason(
        f"{predictor.words}: {predictor.text(float(at[k]))}",
        predictor.text(float(model.centre[k])),
        needed,
        is_shown=model.is_shown(predictor),
        is_as_expected=not (more < 0.0 if is_harder else more > 0.0),  # NaN where neither holds
    )


def _or_infinite(count: int | None) -> float:
    return math.inf if count is None else float(count)


def _outside(model: NeededCount, at: np.ndarray, predictor: Predictor) -> str:
    k = PREDICTORS.index(predictor)
    ends = (predictor.text(float(end[k])) for end in (model.low, model.high))
    return f"{predictor.words}: {predictor.text(float(at[k]))}, measured were {' to '.join(ends)}"


def is_world(name: str) -> bool:
    """Whether a name is that of a world: of the catalogue, generated, or a file of a world or map."""
    return name in catalogue() or name.startswith("generated:") or name.endswith(_WORLD_SUFFIXES)


def features_of_world(name: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Features of one simulated drive in a world, with these settings of robot, sensors and route.

    Raises WorldError, PresetError or SweepError for unusable input.
    """
    values = {key: checked(key, value, recorded=False) for key, value in settings.items()}
    cell = Cell(
        place=label(name),
        source={"world": name},
        line="",
        settings=values,
        particles=1,
        seed=0,
        inputs={},
        code="",
    )
    return dict(recording_of(cell).features)


def features_of_log(path: str) -> dict[str, Any]:
    """Features of a recorded log: the path is that of the filter with `LOOK_PARTICLES` particles and the final pass.

    Raises LogError for an unusable log, SweepError for one without scans or where the robot stands still.
    """
    frames: Sequence[Frame] = list(open_log(path).frames)
    estimation = Estimation(FilterConfig(particles=LOOK_PARTICLES), 0)
    for frame in frames:
        estimation.process(frame)
    if not len(estimation.scan_frames):
        raise SweepError(f"{Path(path).name}: has no scan, expected a log with scans and odometry")
    poses = estimation.refined(estimation.filtered()).at_scans.poses
    if np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() < 1.0:
        raise SweepError(f"{Path(path).name}: the robot drives less than a metre, expected a drive")
    return dict(drive_features(frames, poses))
