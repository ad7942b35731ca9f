# SPDX-License-Identifier: MIT
"""The reference backend: PyBullet moves the robot and casts the rays."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.physics.backend import AccelerationLimits, Hits, Motion, ramp
from testbed.simulation.physics.pybullet_scene import borrow, give_back
from worlds import World

MIN_FORK_PYTHON, MAX_FORK_PYTHON = (3, 12), (3, 14)
"""PyBullet has wheels below the first of these versions of Python, its fork pybullet-arm64 below the second."""


class PyBulletMissingError(ValueError):
    """PyBullet is not installed; the message says what to do."""


class PyBulletBackend:
    """A world and a robot, moved by physics; each open one has its own physics client (about 30 MB).

    A copy or an unpickled backend repeats all motions from the start, since PyBullet cannot save its contacts; the bits
    are the same.
    """

    def __init__(self, world: World, robot: RobotPreset, limits: AccelerationLimits) -> None:
        """Place the robot at the start of the world. Raise `PyBulletMissingError` if pybullet cannot be imported."""
        self._made_of = (world, robot, limits)
        self._driven: list[tuple[float, float, int]] = []
        self._scene = borrow(import_pybullet(), world, robot)
        self._open = True
        self._half_track, self._wheel_radius, self._limits = robot.track / 2.0, robot.wheel_radius, limits
        self._command = (0.0, 0.0)
        self._wheel_zero = self._scene.wheel_angles()

    def drive(self, speed: float, turn_rate: float, steps: int) -> Motion:
        """Move the robot, see `Backend.drive`."""
        scene = self._scene
        self._driven.append((speed, turn_rate, steps))
        speeds = ramp(self._command[0], speed, self._limits.acceleration, steps)
        turn_rates = ramp(self._command[1], turn_rate, self._limits.turn_acceleration, steps)
        rims = np.stack([speeds - self._half_track * turn_rates, speeds + self._half_track * turn_rates], axis=-1)
        poses, contact = np.empty((steps, 3)), False
        for k, rates in enumerate((rims / self._wheel_radius).tolist()):
            scene.turn_wheels(rates)
            scene.step()
            poses[k] = scene.pose()
            contact = contact or scene.touching()
        self._command = (float(speeds[-1]), float(turn_rates[-1]))
        poses[:, 2] = np.unwrap(poses[:, 2])
        return Motion(poses, np.subtract(scene.wheel_angles(), self._wheel_zero), contact)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64], reach: float, height: float) -> Hits:
        """Cast horizontal rays, see `Backend.cast`."""
        n = len(directions)
        cos, sin = np.cos(directions), np.sin(directions)
        begin = np.column_stack([origins, np.full(n, height)])
        end = begin + reach * np.column_stack([cos, sin, np.zeros(n)])
        answers = self._scene.cast(begin, end)
        missed = np.array([answer[0] for answer in answers]) < 0
        distances = reach * np.array([answer[2] for answer in answers])
        distances[missed] = np.inf
        normals = np.array([answer[4] for answer in answers]).reshape(n, 3)
        head_on = np.abs(normals[:, 0] * cos + normals[:, 1] * sin)
        return Hits(distances, np.clip(head_on, 0.0, 1.0))

    def close(self) -> None:
        """Return the scene for further use; this may be called twice, but nothing else after it."""
        if self._open:
            give_back(self._scene)
            self._open = False

    def __getstate__(self) -> dict[str, Any]:
        return {"made_of": self._made_of, "driven": self._driven, "open": self._open}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._open = False
        if state["open"]:
            self.__init__(*state["made_of"])  # type: ignore[misc]  # the state is what the constructor needs
            for motion in state["driven"]:
                self.drive(*motion)


def import_pybullet() -> Any:
    """Return the module pybullet; raise `PyBulletMissingError` if it is absent."""
    try:
        with _silent_stdio():
            import pybullet
    except ImportError:
        raise PyBulletMissingError(
            "PyBullet is not installed: expected the backend fast, or auto, or that you run " + how_to_install()
        ) from None
    return pybullet


def is_installed() -> bool:
    """Tell whether PyBullet can be imported, without importing it."""
    return find_spec("pybullet") is not None


def how_to_install() -> str:
    """Return the command that installs PyBullet on this Python."""
    release = sys.version_info[:2]
    if platform.machine() != "aarch64":  # see pyproject.toml
        if release < MIN_FORK_PYTHON and sys.platform == "linux":
            return "'pip install pybullet==3.2.7'"
        if release < MAX_FORK_PYTHON:
            return "'pip install pybullet-arm64==3.2.8'"
    return "'pip install pybullet', which compiles it for long: there is no wheel for this Python"


@contextmanager
def _silent_stdio() -> Iterator[None]:
    """Suppress the build time that PyBullet's C code prints on import, past Python's streams."""
    if "pybullet" in sys.modules:
        yield
        return
    saved = [(fd, os.dup(fd)) for fd in (1, 2)]
    sys.stdout.flush()
    sys.stderr.flush()
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        for fd, _ in saved:
            os.dup2(null, fd)
        yield
    finally:
        os.close(null)
        for fd, copy in saved:
            os.dup2(copy, fd)
            os.close(copy)
