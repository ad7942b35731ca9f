# SPDX-License-Identifier: MIT
"""What is known about a robot or a lidar. Every number that a preset sets must name its source, or say "assumed"."""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

MAX_BEAMS = 100_000
"""Of one scan."""

Positive = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, ge=0.0, le=1.0)]
Degrees = Annotated[float, Field(strict=True, ge=-360.0, le=360.0)]


class _Preset(BaseModel):
    """A device: frozen, no unknown keys, a source for each number that was set."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(min_length=1)]
    """Short name, as on the command line."""
    title: str
    """Manufacturer and product."""
    sources: dict[str, str]
    """Where the value of each key comes from: a document, or "assumed" with the reason."""

    @model_validator(mode="after")
    def _every_number_has_a_source(self) -> Self:
        numbers = self.model_fields_set - {"name", "title", "sources"}
        if missing := sorted(numbers - self.sources.keys()):
            raise ValueError(f"sources lacks {', '.join(missing)}: name a document or write 'assumed'")
        if unknown := sorted(self.sources.keys() - numbers):
            raise ValueError(f"sources names {', '.join(unknown)}, which the preset does not set")
        return self


class Mount(BaseModel):
    """Pose of a lidar on the robot, `T_robot_lidar`, and its height."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=50)] = "laser"
    """Of the lidar's coordinate frame; tells several lidars apart."""
    x: Annotated[float, Field(strict=True, ge=-2.0, le=2.0)] = 0.0
    """Forward of the wheel axle's middle [m]."""
    y: Annotated[float, Field(strict=True, ge=-2.0, le=2.0)] = 0.0
    """To the left [m]."""
    theta_deg: Degrees = 0.0
    """Counter-clockwise rotation [degrees]."""
    height: Positive = 0.2
    """Of the beams above the floor [m]."""
    error: NotNegative = 0.0
    """Standard deviation of x and y of the true mount about these numbers [m]."""
    error_deg: NotNegative = 0.0
    """Standard deviation of its rotation [degrees]."""

    @property
    def pose(self) -> tuple[float, float, float]:
        """`(x, y, theta)` [m, m, rad]."""
        return self.x, self.y, math.radians(self.theta_deg)


class RobotPreset(_Preset):
    """A robot on two driven wheels. Its frame (base_link) lies on the floor below the middle of the axle."""

    wheel_radius: Positive
    """Radius of the driven wheels [m]."""
    track: Positive
    """Distance between the contact points of the wheels [m] (wheel separation)."""
    length: Positive
    """Of the body [m]."""
    width: Positive
    """Of the body [m]."""
    height: Positive
    """Of the body above its ground clearance [m]."""
    mass: Positive
    """With battery [kg]."""
    max_speed: Positive
    """Forward [m/s]."""
    max_turn_rate: Positive
    """On the spot [rad/s]."""
    max_acceleration: Positive
    """Forward [m/s²]."""
    max_turn_acceleration: Positive
    """About the vertical axis [rad/s²]."""
    ticks_per_turn: Positive
    """Encoder ticks in one turn of a wheel."""
    lidar_mount: Mount
    """Where the lidar sits."""
    further_lidar_mounts: tuple[Mount, ...] = ()
    """Where a second lidar can sit, a third …"""

    @model_validator(mode="after")
    def _lidars_have_names_of_their_own(self) -> Self:
        names = [mount.name for mount in self.lidar_mounts]
        if len(set(names)) < len(names):
            raise ValueError(f"lidar mounts must have different names, got {', '.join(names)}")
        return self

    @property
    def lidar_mounts(self) -> tuple[Mount, ...]:
        """All places for lidars, the main one first."""
        return (self.lidar_mount, *self.further_lidar_mounts)

    @property
    def footprint_radius(self) -> float:
        """Radius of the circle about the axle's middle that holds the body and the wheels [m]."""
        return max(math.hypot(self.length, self.width) / 2.0 if not self.round else self.width / 2.0, self.track / 2.0)

    round: bool = False
    """The body is a disc of diameter `width`, not a rectangle."""


class LidarPreset(_Preset):
    """A planar lidar that turns counter-clockwise at a constant rate."""

    beams: Annotated[int, Field(strict=True, ge=1, le=MAX_BEAMS)]
    """Beams in one scan."""
    field_of_view_deg: Annotated[float, Field(strict=True, gt=0.0, le=360.0)]
    """From the first to the last beam [degrees], symmetric about forward; 360 = a full turn, whose last beam comes
    one step before the first one's direction."""
    scan_rate: Positive
    """Scans in a second [Hz]."""
    range_min: NotNegative
    """Shortest range [m]; nearer surfaces give no valid reading."""
    range_max: Positive
    """Longest range [m]."""
    noise_floor: NotNegative
    """Standard deviation of a range near by [m]."""
    noise_share: Share = 0.0
    """Standard deviation of a range far away, as a share of the range; the larger of the two counts."""
    bias_floor: NotNegative = 0.0
    """Largest constant error of a device [m], drawn evenly once a run."""
    bias_share: Share = 0.0
    """Largest scale error of a device, drawn evenly once a run."""
    angle_noise_deg: NotNegative = 0.0
    """Standard deviation of the direction of a beam [degrees]."""
    range_step: NotNegative = 0.0
    """Ranges are whole multiples of this [m]; 0 = not rounded."""
    dropout: Share = 0.0
    """Share of the beams that are lost at random."""
    grazing_deg: Annotated[float, Field(strict=True, ge=0.0, lt=90.0)] = 0.0
    """Surfaces met at a smaller angle than this send nothing back [degrees]."""
    short_return_rate: NotNegative = 0.0
    """Readings before the surface (dust, insects, cross-talk), per metre of beam [1/m]."""
    spot_deg: NotNegative = 0.0
    """Width of the beam [degrees]: at an edge it meets two surfaces, and reads a range between them."""
    beam_jitter: Annotated[float, Field(strict=True, ge=0.0, le=0.5)] = 0.0
    """Standard deviation of the number of beams, as a share of `beams` (motor speed that varies, sampling that does
    not)."""

    @model_validator(mode="after")
    def _limits_in_order(self) -> Self:
        if not self.range_min < self.range_max:
            raise ValueError(f"range_min {self.range_min} m must be below range_max {self.range_max} m")
        return self

    def angles(self, beams: int | None = None) -> NDArray[np.float64]:
        """Directions of the beams in the lidar's frame [rad], first beam first, (beams,)."""
        n = self.beams if beams is None else beams
        view = math.radians(self.field_of_view_deg)
        full_turn = self.field_of_view_deg == 360.0
        step = view / n if full_turn else view / max(n - 1, 1)
        angles: NDArray[np.float64] = np.arange(n, dtype=np.float64) * step - view / 2.0
        return angles

    @property
    def sweep_time(self) -> float:
        """From the first to the last beam of a full view [s]: the mirror turns once per scan."""
        return self.field_of_view_deg / 360.0 / self.scan_rate
