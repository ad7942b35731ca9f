# SPDX-License-Identifier: MIT
"""The reference backend: PyBullet moves the robot and casts the rays. The only module that imports pybullet."""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.backend import STEP_RATE, Hits, Limits, Motion, ramp
from testbed.simulation.urdf import LEFT_WHEEL, RIGHT_WHEEL, robot_urdf
from worlds import World

_RAYS_PER_CALL = 16_000
"""16384 rays in one call silently return nothing (bullet3#4215)."""
_QUADS_PER_MESH = 30_000
"""Array meshes fail somewhere between 131 072 and 262 144 vertices."""
_SOLVER_ITERATIONS = 50
_WHEEL_TORQUE_PER_KG = 40.0
"""Torque of a wheel motor per kilogram of robot and metre of wheel radius [N/kg]: far above need, so that the wheels
keep to the commanded speed (1 Nm for 0.8 kg on 33 mm wheels)."""
_SETTLE_STEPS = STEP_RATE
_RAYS, _WALLS, _OPAQUE, _ROBOT = 1, 2, 4, 8
"""Collision groups: glass is a wall that is not opaque; rays (group 1 in Bullet) look for opaque things only."""


class PyBulletMissingError(ValueError):
    """PyBullet is not installed; the message says what to do."""


class PyBulletBackend:
    """A world and a robot in a physics client of their own, without a window. One client a process is best: each
    takes 27 MB, and PyBullet never gives a mesh's memory back."""

    def __init__(self, world: World, robot: RobotPreset, limits: Limits) -> None:
        """Build the world at its start pose and let the robot settle for a second.

        Raises `PyBulletMissingError` if pybullet cannot be imported.
        """
        self._p = import_pybullet()
        self._client: int = self._p.connect(self._p.DIRECT)
        self._robot_preset, self._limits = robot, limits
        self._command = (0.0, 0.0)
        self._wheel_zero = (0.0, 0.0)
        try:
            self._build(world)
        except BaseException:
            self.close()
            raise

    def _build(self, world: World) -> None:
        p, client = self._p, self._client
        p.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        p.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / STEP_RATE, numSolverIterations=_SOLVER_ITERATIONS, physicsClientId=client
        )
        floor = p.createMultiBody(
            0.0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client), physicsClientId=client
        )
        p.changeDynamics(floor, -1, lateralFriction=1.0, physicsClientId=client)
        p.setCollisionFilterGroupMask(floor, -1, _WALLS, _ROBOT, physicsClientId=client)
        self._walls = self._add_walls(world, glass=False) + self._add_walls(world, glass=True)
        self._robot = self._add_robot(world)
        joints = {
            p.getJointInfo(self._robot, j, client)[1].decode(): j for j in range(p.getNumJoints(self._robot, client))
        }
        self._wheels = [joints[LEFT_WHEEL], joints[RIGHT_WHEEL]]
        inertial = p.getDynamicsInfo(self._robot, -1, client)[3:5]
        self._base_in_mass_frame = p.invertTransform(*inertial)
        self._torques = [_WHEEL_TORQUE_PER_KG * self._robot_preset.mass * self._robot_preset.wheel_radius] * 2
        self.drive(0.0, 0.0, _SETTLE_STEPS)
        self._wheel_zero = self._wheel_angles()

    def _add_walls(self, world: World, *, glass: bool) -> list[int]:
        """Static triangle meshes of all surfaces: glass ones or all others."""
        p, group = self._p, _WALLS if glass else _WALLS | _OPAQUE
        bodies = []
        quads = _wall_quads(world, glass=glass)
        for begin in range(0, len(quads), _QUADS_PER_MESH):
            corners = quads[begin : begin + _QUADS_PER_MESH]
            first = 4 * np.arange(len(corners))[:, None]
            shape = p.createCollisionShape(
                p.GEOM_MESH,
                vertices=corners.reshape(-1, 3),
                indices=(first + np.array([0, 1, 2, 0, 2, 3])).ravel(),
                flags=p.GEOM_FORCE_CONCAVE_TRIMESH,
                physicsClientId=self._client,
            )
            body = p.createMultiBody(0.0, shape, useMaximalCoordinates=1, physicsClientId=self._client)
            p.setCollisionFilterGroupMask(body, -1, group, _ROBOT | _RAYS, physicsClientId=self._client)
            bodies.append(body)
        return bodies

    def _add_robot(self, world: World) -> int:
        p = self._p
        half = world.start.theta / 2.0
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(robot_urdf(self._robot_preset), encoding="utf-8")
            robot: int = p.loadURDF(
                str(path),
                (world.start.x, world.start.y, 0.0),
                (0.0, 0.0, math.sin(half), math.cos(half)),
                physicsClientId=self._client,
            )
        for link in range(-1, p.getNumJoints(robot, self._client)):
            p.setCollisionFilterGroupMask(robot, link, _ROBOT, _WALLS, physicsClientId=self._client)
        return robot

    def drive(self, speed: float, turn_rate: float, steps: int) -> Motion:
        """Steer towards that speed [m/s] and turn rate [rad/s] for some steps of 1 / `STEP_RATE` s."""
        p, client, robot = self._p, self._client, self._robot
        half_track, radius = self._robot_preset.track / 2.0, self._robot_preset.wheel_radius
        speeds = ramp(self._command[0], speed, self._limits.acceleration, steps)
        turn_rates = ramp(self._command[1], turn_rate, self._limits.turn_acceleration, steps)
        targets = np.stack([speeds - half_track * turn_rates, speeds + half_track * turn_rates], axis=-1) / radius
        poses, contact = np.empty((steps, 3)), False
        for k, target in enumerate(targets.tolist()):
            p.setJointMotorControlArray(
                robot, self._wheels, p.VELOCITY_CONTROL, targetVelocities=target, forces=self._torques,
                physicsClientId=client,
            )  # fmt: skip
            p.stepSimulation(client)
            poses[k] = self._pose()
            contact = contact or self._touching()
        self._command = (float(speeds[-1]), float(turn_rates[-1]))
        poses[:, 2] = np.unwrap(poses[:, 2])
        wheels = np.subtract(self._wheel_angles(), self._wheel_zero)
        return Motion(poses, wheels, contact)

    def _pose(self) -> tuple[float, float, float]:
        """`T_world_robot`. PyBullet's base pose is that of the centre of mass, which lies behind the axle."""
        position, rotation = self._p.getBasePositionAndOrientation(self._robot, self._client)
        (x, y, _), (qx, qy, qz, qw) = self._p.multiplyTransforms(position, rotation, *self._base_in_mass_frame)
        return x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))

    def _wheel_angles(self) -> tuple[float, float]:
        left, right = self._p.getJointStates(self._robot, self._wheels, self._client)
        return left[0], right[0]

    def _touching(self) -> bool:
        p, client = self._p, self._client
        return any(p.getContactPoints(self._robot, body, physicsClientId=client) for body in self._walls)

    def cast(self, origins: NDArray[np.float64], directions: NDArray[np.float64], reach: float, height: float) -> Hits:
        """Level rays from `origins` (rays, 2) [m] along `directions` (rays,) [rad], both in the world's frame, at
        `height` above the floor [m]."""
        n = len(directions)
        cos, sin = np.cos(directions), np.sin(directions)
        begin = np.column_stack([origins, np.full(n, height)])
        end = begin + reach * np.column_stack([cos, sin, np.zeros(n)])
        answers: list[Any] = []
        for low in range(0, n, _RAYS_PER_CALL):
            part = slice(low, low + _RAYS_PER_CALL)
            answers += self._p.rayTestBatch(
                begin[part], end[part], numThreads=1, collisionFilterMask=_OPAQUE, physicsClientId=self._client
            )
        missed = np.array([answer[0] for answer in answers]) < 0
        distances = reach * np.array([answer[2] for answer in answers])
        distances[missed] = np.inf
        normals = np.array([answer[4] for answer in answers]).reshape(n, 3)
        head_on = np.abs(normals[:, 0] * cos + normals[:, 1] * sin)
        return Hits(distances, np.arcsin(np.clip(head_on, 0.0, 1.0)))

    def close(self) -> None:
        """Disconnect the physics client; may be called twice."""
        if self._client >= 0:
            self._p.disconnect(self._client)
            self._client = -1


def _wall_quads(world: World, *, glass: bool) -> NDArray[np.float64]:
    """Upright rectangles of all glass or all other surfaces, (n, 4, 3) [m]: for each slice between two heights at
    which elements end, the outline of what stands in that slice."""
    groups = ("walls", "boxes", "discs", "polygons")
    chosen = world.model_copy(update={g: [e for e in getattr(world, g) if e.glass == glass] for g in groups})
    slices = []
    for low, high in pairwise([0.0, *chosen.heights]):
        x0, y0, x1, y1 = chosen.boundary_segments(low).T
        bottom, top = np.full(len(x0), low), np.full(len(x0), high)
        corners = [(x0, y0, bottom), (x1, y1, bottom), (x1, y1, top), (x0, y0, top)]
        slices.append(np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1))
    return np.concatenate(slices) if slices else np.empty((0, 4, 3))


def import_pybullet() -> Any:
    """The module; raises `PyBulletMissingError` where it is absent or was built without numpy."""
    try:
        with _silent_stdio():
            import pybullet
    except ImportError:
        raise PyBulletMissingError(
            "PyBullet is not installed: use the fast backend, or run "
            "'pip install numpy setuptools wheel; pip install --no-build-isolation pybullet' "
            f"(ready-made up to Python 3.11, a long build on {sys.version_info[0]}.{sys.version_info[1]})"
        ) from None
    if not pybullet.isNumpyEnabled():
        raise PyBulletMissingError(
            "PyBullet was built without numpy: run 'pip install numpy setuptools wheel; "
            "pip install --force-reinstall --no-build-isolation pybullet'"
        )
    return pybullet


@contextmanager
def _silent_stdio() -> Iterator[None]:
    """PyBullet's C code prints its build time on import, past Python's streams."""
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
