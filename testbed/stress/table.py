# SPDX-License-Identifier: MIT
"""The table of perturbations: what makes a drive harder to map, by how much, and how it is applied.

Each is a filter on the frames of a drive, so the same for simulated and recorded ones. `testbed perturb`, `testbed
stress`, sweeps (the setting `perturb`) and the stress suite use this table.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from testbed.frame import Frame
from testbed.seeds import Stream, children
from testbed.stress import lidar, perturbations, surroundings, wheels

PERIOD = 20.0
"""Faults that last for a moment are repeated after this time [s]."""
Apply = Callable[[list[Frame], float, Generator], Iterable[Frame]]
"""From frames, a value and a source of random numbers to other frames."""


@dataclass(frozen=True, kw_only=True)
class Perturbation:
    """A way to make a drive harder, with one value."""

    name: str
    unit: str
    """Unit of the value, for people."""
    summary: str
    """What it does, with the value as N."""
    harmless: float
    """A value that hardly any system notices …"""
    hopeless: float
    """… and one that hardly any survives: the range that is searched."""
    apply: Apply
    scale: Literal["log", "share"] = "log"
    """Equal steps of the severity multiply the value (log), or what is left of the share (share)."""
    neutral: float = 0.0
    """The value that changes nothing, bit for bit: 0, or inf."""
    most: float = math.inf
    """Largest value that makes sense; of a share, 1 is too much."""
    needs_truth: bool = False
    """Whether every scan must have its true pose."""

    def value_at(self, severity: float) -> float:
        """The value at a severity from 0 (harmless) to 1 (hopeless), to three digits; shares to four decimals."""
        low, high = self.harmless, self.hopeless
        if self.scale == "share":
            left: float = (1.0 - low) * ((1.0 - high) / (1.0 - low)) ** severity
            return round(1.0 - left, 4)
        return float(f"{low * (high / low) ** severity:.3g}")

    def check(self, value: float) -> float:
        """Return the value; ValueError where it makes no sense."""
        if value == self.neutral:
            return value
        positive = self.neutral == 0.0 or value > 0.0
        if not (math.isfinite(value) and value >= 0.0 and positive and value <= self.most):
            raise ValueError(f"{self.name} = {value:g}: expected {self._range} ({self.unit})")
        if self.scale == "share" and value >= 1.0:
            raise ValueError(f"{self.name} = {value:g}: expected {self._range} ({self.unit})")
        return value

    @property
    def _range(self) -> str:
        if self.scale == "share":
            return "0 to less than 1"
        if self.neutral == math.inf:
            return "more than 0"
        return f"0 to {self.most:g}" if math.isfinite(self.most) else "0 or more"


def _repeated(fault: Callable[..., Iterator[Frame]]) -> Apply:
    """The fault of so many seconds, each `PERIOD`."""
    return lambda frames, seconds, _: fault(frames, _times(frames, PERIOD), seconds=seconds)


def _times(frames: Sequence[Frame], period: float) -> NDArray[np.float64]:
    """Times a period apart, from the first frame on, without it [s]."""
    stamps = [frame.stamp for frame in frames]
    return np.arange(min(stamps) + period, max(stamps), period)


def _push(frames: list[Frame], seconds: float, _: Generator) -> Iterator[Frame]:
    """Cut so many seconds out after each `PERIOD` that is left."""
    return perturbations.carry(frames, _times(frames, PERIOD + seconds) - seconds, seconds)


def _spin(frames: list[Frame], degrees: float, _: Generator) -> Iterator[Frame]:
    return perturbations.slip(frames, _times(frames, PERIOD), np.array([0.1, 0.0, math.radians(degrees)]))


_ROWS = (
    Perturbation(
        name="glass", unit="share of the walls", harmless=0.05, hopeless=0.99, scale="share",
        summary="A share N of the walls is glass, whose beams return nothing. Needs the truth of the drive.",
        apply=surroundings.turn_walls_to_glass, needs_truth=True,
    ),
    Perturbation(
        name="people", unit="people on 100 m²", harmless=0.1, hopeless=100.0, most=1000.0,
        summary="N people on 100 square metres walk about.",
        apply=surroundings.add_people,
    ),
    Perturbation(
        name="reach", unit="m", harmless=30.0, hopeless=0.3, neutral=math.inf,
        summary="What is farther than N metres returns nothing.",
        apply=lambda frames, value, _: perturbations.limit_range(frames, value),
    ),
    Perturbation(
        name="field-of-view", unit="degrees", harmless=270.0, hopeless=2.0, neutral=math.inf,
        summary="Only N degrees of the field of view are left, centred ahead.",
        apply=lambda frames, value, _: lidar.narrow_view(frames, value),
    ),
    Perturbation(
        name="beams", unit="beams of a scan", harmless=300.0, hopeless=1.0, neutral=math.inf,
        summary="At most N beams of each scan are left, evenly spread.",
        apply=lambda frames, value, _: lidar.use_fewer_beams(frames, value),
    ),
    Perturbation(
        name="dropout", unit="share of the beams", harmless=0.1, hopeless=0.998, scale="share",
        summary="A share N of the beams of each scan is lost, different ones each time.",
        apply=lidar.lose_beams,
    ),
    Perturbation(
        name="range-noise", unit="m", harmless=0.01, hopeless=5.0,
        summary="Ranges get a normal error of N metres (standard deviation).",
        apply=lidar.add_range_noise,
    ),
    Perturbation(
        name="drop-scans", unit="share of the scans", harmless=0.1, hopeless=0.998, scale="share",
        summary="Each scan is lost with probability N.",
        apply=lidar.drop_scans,
    ),
    Perturbation(
        name="scan-gap", unit=f"s every {PERIOD:g} s", harmless=0.5, hopeless=PERIOD, most=PERIOD,
        summary=f"No scan comes for N seconds, every {PERIOD:g} s.",
        apply=_repeated(perturbations.lose_scans),
    ),
    Perturbation(
        name="scan-period", unit="s", harmless=0.1, hopeless=60.0,
        summary="At most one scan comes every N seconds.",
        apply=lambda frames, value, _: perturbations.thin_scans(frames, value),
    ),
    Perturbation(
        name="askew", unit="degrees", harmless=0.3, hopeless=120.0, most=180.0,
        summary="The mount of the lidar is stated N degrees too far counter-clockwise.",
        apply=lambda frames, value, _: lidar.mount_askew(frames, value),
    ),
    Perturbation(
        name="push", unit=f"s every {PERIOD:g} s", harmless=0.1, hopeless=15.0, most=1000.0,
        summary=f"Every {PERIOD:g} s the robot is carried to where it would be N seconds later, and its wheels notice "
        "nothing.",
        apply=_push,
    ),
    Perturbation(
        name="odometry-noise", unit="times typical errors", harmless=0.3, hopeless=100.0,
        summary="Adds systematic and random odometry errors of N times the grade `typical`.",
        apply=wheels.add_odometry_noise,
    ),
    Perturbation(
        name="slip", unit="slips per metre", harmless=0.01, hopeless=20.0, most=1000.0,
        summary=f"One wheel spins ahead by {wheels.SLIP_DISTANCE:g} m on average, N times per metre.",
        apply=wheels.slip_at_random,
    ),
    Perturbation(
        name="spin", unit=f"degrees every {PERIOD:g} s", harmless=3.0, hopeless=180.0, most=180.0,
        summary=f"The wheels spin and report a turn of N degrees that the robot does not make, every {PERIOD:g} s.",
        apply=_spin,
    ),
    Perturbation(
        name="stuck-odometry", unit=f"s every {PERIOD:g} s", harmless=0.3, hopeless=PERIOD, most=PERIOD,
        summary=f"The wheels' counters stand still for N seconds, every {PERIOD:g} s.",
        apply=_repeated(perturbations.stop_odometry),
    ),
    Perturbation(
        name="backward-odometry", unit=f"s every {PERIOD:g} s", harmless=0.3, hopeless=PERIOD, most=PERIOD,
        summary=f"The wheels' counters count backward for N seconds, every {PERIOD:g} s.",
        apply=_repeated(perturbations.reverse_odometry),
    ),
    Perturbation(
        name="restart-odometry", unit="times a minute", harmless=0.3, hopeless=60.0, most=600.0,
        summary="The odometry starts again at zero, N times a minute.",
        apply=lambda frames, value, _: perturbations.restart_odometry(frames, _times(frames, 60.0 / value)),
    ),
    Perturbation(
        name="time-offset", unit="s", harmless=0.01, hopeless=10.0, most=60.0,
        summary="Scans are stamped N seconds too late (testbed slam --time-offset N corrects it).",
        apply=lambda frames, value, _: lidar.delay_stamps(frames, value),
    ),
    Perturbation(
        name="scan-distance", unit="m", harmless=0.1, hopeless=30.0,
        summary="At most one scan comes every N metres of the path that the wheels count.",
        apply=lambda frames, value, _: perturbations.space_scans(frames, value),
    ),
)  # fmt: skip
PERTURBATIONS = {row.name: row for row in _ROWS}
"""All perturbations by name, in the order in which several are applied: from the surroundings over the lidar and the
robot to its wheels and clocks. It decides the random numbers of each: new ones are appended."""


def perturb(frames: Iterable[Frame], chosen: Mapping[str, float], stream: Stream) -> list[Frame]:
    """Apply perturbations, value by name, to the frames of a whole drive.

    Values that change nothing leave the frames as they are. Each perturbation draws from a stream of its own, and the
    same numbers for each of its values. Raises ValueError for an unknown name or a value that makes no sense.
    """
    checked = {name: find(name).check(value) for name, value in chosen.items()}
    out = list(frames)
    for perturbation, own in zip(_ROWS, children(stream, len(_ROWS)), strict=True):
        value = checked.get(perturbation.name, perturbation.neutral)
        if value != perturbation.neutral and out:
            out = list(perturbation.apply(out, value, np.random.default_rng(own)))
    return out


def find(name: str) -> Perturbation:
    """Return the perturbation of a name; ValueError with the most similar names where there is none."""
    if name not in PERTURBATIONS:
        near = difflib.get_close_matches(name, PERTURBATIONS, n=3, cutoff=0.4) or list(PERTURBATIONS)
        raise ValueError(f"{name}: no such perturbation, expected such as {', '.join(near)}")
    return PERTURBATIONS[name]


def parse_perturbations(text: str) -> dict[str, float]:
    """Read `NAME=VALUE+NAME=VALUE`, such as `drop-scans=0.3+askew=5`; an empty text is no perturbation."""
    chosen: dict[str, float] = {}
    for part in filter(None, text.split("+")):
        name, equals, value = part.partition("=")
        try:
            number = float(value)
        except ValueError:
            equals, number = "", math.nan
        if not equals:
            raise ValueError(f"{part!r}: expected NAME=VALUE such as drop-scans=0.3")
        if name in chosen:
            raise ValueError(f"{name}: is given twice")
        chosen[name] = find(name).check(number)
    return chosen


def text_of(chosen: Mapping[str, float]) -> str:
    """The text that `parse_perturbations` reads."""
    return "+".join(f"{name}={value:.6g}" for name, value in chosen.items())
