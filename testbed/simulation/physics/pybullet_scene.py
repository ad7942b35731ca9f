# SPDX-License-Identifier: MIT
"""PyBullet scenes, which hold a robot among the walls of a world and are used again.

PyBullet never frees the memory of a mesh, neither on `resetSimulation` nor on `disconnect` (bullet3#2898, #3319;
measured: 1.6 kB per wall and time). A world that is simulated again therefore gets its old scene, with the robot at
rest at the start: the bits are those of a new scene, without a second of settling. The robot settles at the origin
before there are walls, and is moved from there to any start, so that scenes do not depend on it.
"""

from __future__ import annotations

import hashlib
import math
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.presets import RobotPreset
from testbed.simulation.physics.backend import STEP_RATE
from testbed.simulation.physics.urdf import LEFT_WHEEL, RIGHT_WHEEL, robot_urdf
from worlds import Start, World

_RAYS, _WALLS, _OPAQUE, _ROBOT = 1, 2, 4, 8
"""Collision groups. Glass is a wall that is not opaque; rays (group 1 in Bullet) hit opaque surfaces only."""
_QUADS_PER_MESH = 30_000
"""Largest number of vertices of a mesh; larger ones fail somewhere between 131 072 and 262 144."""
_SOLVER_ITERATIONS = 50
_WHEEL_TORQUE_PER_KG = 40.0
"""Torque of a wheel motor per kilogram of robot and metre of wheel radius [N/kg]; it is ample, so that the wheels keep
the commanded speed (1 Nm for 0.8 kg on 33 mm wheels)."""
_SETTLE_STEPS = STEP_RATE
_RAYS_PER_CALL = 16_000
"""Largest number of rays in one call; 16384 silently return nothing (bullet3#4215)."""
_MAX_IDLE = 4
"""Number of unused scenes that are kept; each takes about 30 MB."""

_idle: list[PyBulletScene] = []
"""Unused scenes, the one that was returned last at the end."""


class PyBulletScene:
    """A robot among walls in its own physics client without a window."""

    def __init__(
        self,
        p: Any,
        key: str,
        opaque: NDArray[np.float64],
        glass: NDArray[np.float64],
        robot: RobotPreset,
    ) -> None:
        """Build the scene and let the robot settle for a second; `borrow` is the way to get one.

        p: the module pybullet; key: equal for equal scenes; opaque, glass: walls as upright rectangles (n, 4, 3) [m]
        """
        self._p, self.key = p, key
        self._takes_arrays = bool(p.isNumpyEnabled())  # the wheels of the fork for new Pythons take lists only
        self._client: int = p.connect(p.DIRECT)
        p.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
        p.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / STEP_RATE, numSolverIterations=_SOLVER_ITERATIONS, physicsClientId=self._client
        )
        self._add_floor()
        self._robot = self._add_robot(robot)
        joints = {p.getJointInfo(self._robot, j, self._client)[1].decode(): j for j in self._joints()}
        self._wheels = [joints[LEFT_WHEEL], joints[RIGHT_WHEEL]]
        self._torques = [_WHEEL_TORQUE_PER_KG * robot.mass * robot.wheel_radius] * 2
        self._base_in_mass_frame = p.invertTransform(*p.getDynamicsInfo(self._robot, -1, self._client)[3:5])
        self.turn_wheels([0.0, 0.0])
        for _ in range(_SETTLE_STEPS):
            self.step()
        self._settled = p.getBasePositionAndOrientation(self._robot, self._client)
        self._walls = self._add_walls(opaque, _WALLS | _OPAQUE) + self._add_walls(glass, _WALLS)
        self._rest: int = p.saveState(physicsClientId=self._client)

    def set_back(self, start: Start) -> None:
        """Put the robot to rest at the start."""
        p = self._p
        p.restoreState(self._rest, physicsClientId=self._client)
        turned = (0.0, 0.0, math.sin(start.theta / 2.0), math.cos(start.theta / 2.0))
        position, rotation = p.multiplyTransforms((start.x, start.y, 0.0), turned, *self._settled)
        p.resetBasePositionAndOrientation(self._robot, position, rotation, physicsClientId=self._client)

    def turn_wheels(self, rates: list[float]) -> None:
        """Set the rates of both wheel motors [rad/s]."""
        self._p.setJointMotorControlArray(
            self._robot, self._wheels, self._p.VELOCITY_CONTROL, targetVelocities=rates, forces=self._torques,
            physicsClientId=self._client,
        )  # fmt: skip

    def step(self) -> None:
        """Simulate one step of 1 / `STEP_RATE` s."""
        self._p.stepSimulation(self._client)

    def pose(self) -> tuple[float, float, float]:
        """Return `T_world_robot`; PyBullet's base pose is that of the centre of mass, which lies behind the axle."""
        position, rotation = self._p.getBasePositionAndOrientation(self._robot, self._client)
        (x, y, _), (qx, qy, qz, qw) = self._p.multiplyTransforms(position, rotation, *self._base_in_mass_frame)
        return x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))

    def wheel_angles(self) -> tuple[float, float]:
        """Return the angles of the left and the right wheel [rad]; their zero is arbitrary."""
        left, right = self._p.getJointStates(self._robot, self._wheels, self._client)
        return left[0], right[0]

    def touching(self) -> bool:
        """Return whether the robot touches a wall."""
        return any(self._p.getContactPoints(self._robot, body, physicsClientId=self._client) for body in self._walls)

    def cast(self, begin: NDArray[np.float64], end: NDArray[np.float64]) -> list[Any]:
        """Return the result of `rayTestBatch` for each ray among opaque walls; begin, end (rays, 3) [m]."""
        answers: list[Any] = []
        for low in range(0, len(begin), _RAYS_PER_CALL):
            ends = [points[low : low + _RAYS_PER_CALL] for points in (begin, end)]
            answers += self._p.rayTestBatch(
                *(ends if self._takes_arrays else (points.tolist() for points in ends)),
                numThreads=1,
                collisionFilterMask=_OPAQUE,
                physicsClientId=self._client,
            )
        return answers

    def disconnect(self) -> None:
        """Disconnect the physics client; the scene cannot be used any more."""
        self._p.disconnect(self._client)

    def _joints(self) -> range:
        return range(self._p.getNumJoints(self._robot, self._client))

    def _add_floor(self) -> None:
        p = self._p
        shape = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=self._client)
        floor = p.createMultiBody(0.0, shape, physicsClientId=self._client)
        p.changeDynamics(floor, -1, lateralFriction=1.0, physicsClientId=self._client)
        p.setCollisionFilterGroupMask(floor, -1, _WALLS, _ROBOT, physicsClientId=self._client)

    def _add_walls(self, quads: NDArray[np.float64], group: int) -> list[int]:
        """Add static triangle meshes of upright rectangles (n, 4, 3) [m], and return their body ids."""
        p, bodies = self._p, []
        for begin in range(0, len(quads), _QUADS_PER_MESH):
            corners = quads[begin : begin + _QUADS_PER_MESH]
            first = 4 * np.arange(len(corners))[:, None]
            shape = p.createCollisionShape(
                p.GEOM_MESH,
                vertices=corners.reshape(-1, 3).tolist(),
                indices=(first + np.array([0, 1, 2, 0, 2, 3])).ravel().tolist(),
                flags=p.GEOM_FORCE_CONCAVE_TRIMESH,
                physicsClientId=self._client,
            )
            body = p.createMultiBody(0.0, shape, useMaximalCoordinates=1, physicsClientId=self._client)
            p.setCollisionFilterGroupMask(body, -1, group, _ROBOT | _RAYS, physicsClientId=self._client)
            bodies.append(body)
        return bodies

    def _add_robot(self, preset: RobotPreset) -> int:
        p = self._p
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(robot_urdf(preset), encoding="utf-8")
            robot: int = p.loadURDF(str(path), physicsClientId=self._client)
        for link in range(-1, p.getNumJoints(robot, self._client)):
            p.setCollisionFilterGroupMask(robot, link, _ROBOT, _WALLS, physicsClientId=self._client)
        return robot


def borrow(p: Any, world: World, robot: RobotPreset) -> PyBulletScene:
    """Return a scene with the robot at rest at the start of the world; `give_back` takes it back. p: the module
    pybullet."""
    opaque, glass = _wall_quads(world, glass=False), _wall_quads(world, glass=True)
    content = hashlib.sha256(f"{robot} {len(opaque)} {len(glass)}".encode())
    content.update(opaque.tobytes() + glass.tobytes())
    key = content.hexdigest()
    scene = next((idle for idle in _idle if idle.key == key), None)
    if scene is None:
        scene = PyBulletScene(p, key, opaque, glass, robot)
    else:
        _idle.remove(scene)
    scene.set_back(world.start)
    return scene


def give_back(scene: PyBulletScene) -> None:
    """Keep a scene for its next use, and disconnect the oldest if there are too many."""
    _idle.append(scene)
    if len(_idle) > _MAX_IDLE:
        _idle.pop(0).disconnect()


def _wall_quads(world: World, *, glass: bool) -> NDArray[np.float64]:
    """Return upright rectangles of all glass, or of all other surfaces, (n, 4, 3) [m].

    They are the outlines of the slices between the heights at which elements end.
    """
    groups = ("walls", "boxes", "discs", "polygons")
    chosen = world.model_copy(update={g: [e for e in getattr(world, g) if e.glass == glass] for g in groups})
    slices = []
    for low, high in pairwise([0.0, *chosen.heights]):
        x0, y0, x1, y1 = chosen.boundary_segments(low).T
        bottom, top = np.full(len(x0), low), np.full(len(x0), high)
        corners = [(x0, y0, bottom), (x1, y1, bottom), (x1, y1, top), (x0, y0, top)]
        slices.append(np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1))
    return np.concatenate(slices) if slices else np.empty((0, 4, 3))
