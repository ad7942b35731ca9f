# SPDX-License-Identifier: MIT
"""Models of robots and lidars. Every number that a preset sets names its source, or says that it is estimated."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from worlds.file_names import Name

FULL_TURN_DEG = 0.01
"""A field of view is a full turn where it lacks no more than this [degrees]; no lidar has so many beams that this is
half of their spacing."""
MAX_BEAMS = 100_000
"""Largest number of beams of one scan."""

MAX_SIZE, MAX_RANGE, MAX_RATE = 100.0, 100_000.0, 10_000.0
"""Largest length of a part of a robot [m], range of a lidar [m], and number of scans a second [Hz]."""

Size = Annotated[float, Field(strict=True, gt=0.0, le=MAX_SIZE)]
Positive = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, ge=0.0, le=1.0)]
Degrees = Annotated[float, Field(strict=True, ge=-360.0, le=360.0)]


_NO_NUMBERS = {"name", "title", "source", "sources"}
"""Keys that need no source."""


class _Preset(BaseModel):
    """A device: immutable, no unknown keys, a source for each number."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    """Short name, as on the command line."""
    title: str
    """Manufacturer and product."""
    source: str = ""
    """Source of all values that `sources` does not name; empty = `sources` names each."""
    sources: dict[str, str] = Field(default_factory=dict)
    """Source of the value of each key: a document, or "estimated", the reason, and what a wrong value would change."""

    @model_validator(mode="after")
    def _every_number_has_a_source(self) -> Self:
        numbers = self.model_fields_set - _NO_NUMBERS
        missing = sorted(numbers - self.sources.keys())
        if missing and not self.source.strip():
            raise ValueError(
                f"sources lacks {', '.join(missing)}: name a document or write 'estimated'; `source = \"…\"` above the "
                "table is the source of all others"
            )
        if unknown := sorted(self.sources.keys() - numbers):
            raise ValueError(f"sources names {', '.join(unknown)}, which the preset does not set")
        return self

    @property
    def source_of(self) -> dict[str, str]:
        """The source of each value that the preset sets, in the order of `sources`, then of the keys."""
        others = [key for key in type(self).model_fields if key in self.model_fields_set and key not in self.sources]
        return self.sources | dict.fromkeys((key for key in others if key not in _NO_NUMBERS), self.source)


class Mount(BaseModel):
    """Pose of a lidar on the robot, `T_robot_lidar`, and its height."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=50)] = "laser"
    """Name of the lidar's coordinate frame, different for each lidar of a robot."""
    x: Annotated[float, Field(strict=True, ge=-2.0, le=2.0)] = 0.0
    """Position ahead of the centre of the wheel axle [m]."""
    y: Annotated[float, Field(strict=True, ge=-2.0, le=2.0)] = 0.0
    """Position to the left of it [m]."""
    theta_deg: Degrees = 0.0
    """Counter-clockwise rotation [degrees]."""
    height: Positive = 0.2
    """Height of the beams above the floor [m]."""
    offset_x: Annotated[float, Field(strict=True, ge=-2.0, le=2.0)] = 0.0
    """The lidar sits this far ahead of `x`, which nobody knows: neither the recording nor the estimator [m]."""
    error: NotNegative = 0.0
    """Standard deviation of x and y of the true mount about these numbers [m]."""
    error_deg: NotNegative = 0.0
    """Standard deviation of its rotation [degrees]."""

    @property
    def pose(self) -> tuple[float, float, float]:
        """`(x, y, theta)` [m, m, rad]."""
        return self.x, self.y, math.radians(self.theta_deg)


class RobotPreset(_Preset):
    """A robot with two driven wheels; its frame (base_link) lies on the floor below the centre of the axle."""

    wheel_radius: Size
    """Radius of the driven wheels [m]."""
    track: Size
    """Distance between the contact points of the wheels [m] (wheel separation)."""
    length: Size
    """Size of the body [m]."""
    width: Size
    """Size of the body [m]."""
    height: Size
    """Height of the body without its ground clearance [m]."""
    mass: Positive
    """Mass with battery [kg]."""
    max_speed: Positive
    """Largest speed [m/s]."""
    max_turn_rate: Positive
    """Largest turn rate [rad/s]."""
    max_acceleration: Positive
    """Largest acceleration [m/s²]."""
    max_turn_acceleration: Positive
    """Largest turn acceleration [rad/s²]."""
    ticks_per_turn: Positive
    """Encoder ticks in one turn of a wheel."""
    lidar_mount: Mount
    """Mount of the main lidar."""
    further_lidar_mounts: tuple[Mount, ...] = ()
    """Mounts of a second lidar, a third and so on."""

    @model_validator(mode="after")
    def _lidars_have_names_of_their_own(self) -> Self:
        names = [mount.name for mount in self.lidar_mounts]
        if len(set(names)) < len(names):
            raise ValueError(f"lidar mounts must have different names, got {', '.join(names)}")
        return self

    @property
    def lidar_mounts(self) -> tuple[Mount, ...]:
        """All mounts, the main one first."""
        return (self.lidar_mount, *self.further_lidar_mounts)

    @property
    def footprint_radius(self) -> float:
        """Radius of the circle around the centre of the axle that contains body and wheels [m]."""
        return max(math.hypot(self.length, self.width) / 2.0 if not self.round else self.width / 2.0, self.track / 2.0)

    round: bool = False
    """Whether the body is a disc of diameter `width` instead of a rectangle."""


class LidarPreset(_Preset):
    """A planar lidar that turns counter-clockwise at a constant rate."""

    beams: Annotated[int, Field(strict=True, ge=1, le=MAX_BEAMS)]
    """Beams in one scan."""
    field_of_view_deg: Annotated[float, Field(strict=True, gt=0.0, le=360.0)]
    """Angle from the first to the last beam [degrees], symmetric to the forward direction; with 360 the last beam lies
    one step before the first."""
    scan_rate: Annotated[float, Field(strict=True, gt=0.0, le=MAX_RATE)]
    """Scans per second [Hz]."""
    scan_times: tuple[Annotated[float, Field(strict=True, ge=0.0)], ...] | None = None
    """Times of all scans after the beginning of a drive [s], increasing, as those of a log; None: at `scan_rate`."""
    range_min: NotNegative
    """Shortest range [m]; nearer surfaces give no valid reading."""
    range_max: Annotated[float, Field(strict=True, gt=0.0, le=MAX_RANGE)]
    """Longest range [m]."""
    noise_floor: NotNegative
    """Standard deviation of short ranges [m]."""
    noise_share: Share = 0.0
    """Standard deviation of long ranges, as a share of the range; the larger of the two applies."""
    bias_floor: NotNegative = 0.0
    """Largest constant error of a device [m]; it is drawn uniformly once per run."""
    bias_share: Share = 0.0
    """Largest scale error of a device; it is drawn uniformly once per run."""
    angle_noise_deg: NotNegative = 0.0
    """Standard deviation of the direction of a beam [degrees]."""
    range_step: NotNegative = 0.0
    """Ranges are whole multiples of this [m]; 0 = not rounded."""
    dropout: Share = 0.0
    """Share of the beams that are lost at random."""
    grazing_deg: Annotated[float, Field(strict=True, ge=0.0, lt=90.0)] = 0.0
    """Surfaces at a smaller angle to the beam give no return [degrees]."""
    short_return_rate: NotNegative = 0.0
    """Rate of readings in front of the surface (dust, insects, crosstalk), per metre of beam [1/m]."""
    spot_deg: NotNegative = 0.0
    """Width of the beam [degrees]; at an edge it meets two surfaces, and the range lies between them."""
    beam_jitter: Annotated[float, Field(strict=True, ge=0.0, le=0.5)] = 0.0
    """Standard deviation of the number of beams, as a share of `beams`: the motor speed varies, the sampling does not.
    """

    @model_validator(mode="after")
    def _limits_in_order(self) -> Self:
        if not self.range_min < self.range_max:
            raise ValueError(f"range_min {self.range_min} m must be below range_max {self.range_max} m")
        return self

    @model_validator(mode="after")
    def _times_increase(self) -> Self:
        for before, after in pairwise(self.scan_times or ()):
            if not before < after < math.inf:
                raise ValueError(f"scan_times: {after} s after {before} s, expected increasing times")
        return self

    @property
    def is_full_turn(self) -> bool:
        """Whether the beams go all around, so that one more would have the direction of the first; 359.999 degrees, as
        a rounded or measured number, are a full turn."""
        return math.isclose(self.field_of_view_deg, 360.0, abs_tol=FULL_TURN_DEG)

    def angles(self, beams: int | None = None) -> NDArray[np.float64]:
        """Return the directions of the beams in the lidar's frame [rad], in their order, (beams,)."""
        n = self.beams if beams is None else beams
        view = math.radians(self.field_of_view_deg)
        step = view / n if self.is_full_turn else view / max(n - 1, 1)
        angles: NDArray[np.float64] = np.arange(n, dtype=np.float64) * step - view / 2.0
        return angles

    @property
    def sweep_time(self) -> float:
        """Time from the first to the last beam [s]; the mirror turns once per scan."""
        return self.field_of_view_deg / 360.0 / self.scan_rate
