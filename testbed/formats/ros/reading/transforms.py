# SPDX-License-Identifier: MIT
"""Static transforms between the frames of a robot, and what of them lies in the plane."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from slam.se2 import Pose
from testbed.formats.ros.messages import joints_of
from testbed.formats.ros.reading.namespaces import choices, is_within

ROBOT_FRAMES = ("base_footprint", "base_link")
"""Names of the robot's own frame, by REP 105 and REP 120."""
MAX_PLAY = 1e-4
"""A transform whose numbers change by less [m], [1] is a fixed mount."""
MAX_WOBBLE = 0.05
"""A transform whose numbers are usually within this of their medians [m], [1] is a mount that is measured again and
again, or that shakes: 5 cm, 3 degrees."""
MAX_PLACE = 1e8
"""Places further from the origin [m] are none: coordinates on Earth reach 1e7 m."""
MAX_TILT = math.radians(5.0)
"""Lidars and poses that lean more than this are not planar [rad]."""


class NotConnectedError(ValueError):
    """No chain of transforms leads from one frame to another."""


class LeaningLidarError(ValueError):
    """A lidar is neither level nor upside down."""


class Moving:
    """Transforms that are sent again and again, by parent and child frame, as columns."""

    def __init__(self) -> None:
        self._columns: dict[tuple[str, str], tuple[array[float], array[float], array[float]]] = {}

    def add(self, message: Any, recorded: float) -> None:
        """Take in a tf2_msgs/TFMessage that was recorded at a time of the bag [s]; ValueError where a transform is not
        finite."""
        for transform in message.transforms:
            pair = _name(transform.header.frame_id), _name(transform.child_frame_id)
            if pair not in self._columns:
                self._columns[pair] = array("d"), array("d"), array("d")
            stamps, times, matrices = self._columns[pair]
            time = transform.header.stamp
            stamps.append((time.sec * 1_000_000_000 + time.nanosec) / 1_000_000_000)
            times.append(recorded)
            matrices.frombytes(_matrix(transform.transform.translation, transform.transform.rotation).tobytes())

    @property
    def counts(self) -> dict[tuple[str, str], int]:
        """How many transforms there are, by parent and child."""
        return {pair: len(stamps) for pair, (stamps, _, _) in self._columns.items()}

    def stamps(self, pair: tuple[str, str]) -> NDArray[np.float64]:
        """Stamps of the transforms from a parent to a child [s], (n,)."""
        return np.array(self._columns[pair][0])

    def times(self, pair: tuple[str, str]) -> NDArray[np.float64]:
        """The bag's times of them [s], (n,)."""
        return np.array(self._columns[pair][1])

    def matrices(self, pair: tuple[str, str]) -> NDArray[np.float64]:
        """The transforms themselves, (n, 4, 4)."""
        return np.array(self._columns[pair][2]).reshape(-1, 4, 4)

    def odometry(self, namespace: str | None = None) -> tuple[str, str] | None:
        """Parent and child of the transform that is odometry: from `odom`, best to the robot's base; None = there is
        none.

        namespace: that of the robot, where there are several; ValueError where it is needed
        """
        pairs = [pair for pair, count in self.counts.items() if "odom" in pair[0].lower() and count > 1]
        if namespace is not None:
            pairs = [pair for pair in pairs if is_within(pair[1], namespace)] or pairs
        order = {name: rank for rank, name in enumerate(ROBOT_FRAMES)}
        ranks = {pair: order.get(pair[1].rpartition("/")[2], len(order)) for pair in pairs}
        bases = [pair[1] for pair in pairs if ranks[pair] < len(order)]
        if not set(ROBOT_FRAMES) & set(bases) and (advice := choices(bases)):
            raise ValueError(f"odometry of several robots: {', '.join(sorted(bases))}{advice}")
        return min(pairs, key=lambda pair: (ranks[pair], pair), default=None)

    def mounts(self) -> dict[str, Mount]:
        """Transforms that hardly change, by their child: mounts that are sent as if they moved."""
        found = {}
        for parent, child in self._columns:
            stack = self.matrices((parent, child))
            off = np.abs(stack - np.median(stack, axis=0)).max(axis=(1, 2))
            if float(np.median(off)) < MAX_WOBBLE:
                found[child] = Mount(parent, stack[int(np.argmin(off))].copy(), float(off.max()))
        return found

    def moved(self) -> dict[str, str]:
        """Parent of each frame whose transform changes, by the frame."""
        fixed = self.mounts()
        return {child: parent for parent, child in self._columns if child not in fixed}


class Mount(NamedTuple):
    """A frame on another one."""

    parent: str
    T_parent_child: NDArray[np.float64]
    """(4, 4), the one nearest to the median."""
    off: float
    """How far the transforms are from their median at most [m], [1]."""


@dataclass
class Transforms:
    """A tree of frames, each with the transform from its parent, (4, 4)."""

    parents: dict[str, tuple[str, NDArray[np.float64]]] = field(default_factory=dict)
    changed: set[str] = field(default_factory=set)
    """Frames whose transform was sent again with other numbers; the last one counts, as in tf2."""

    def add(self, message: Any) -> None:
        """Take in a tf2_msgs/TFMessage; ValueError where a transform is not finite."""
        for transform in message.transforms:
            T = _matrix(transform.transform.translation, transform.transform.rotation)
            parent, child = _name(transform.header.frame_id), _name(transform.child_frame_id)
            before = self.parents.get(child)
            if before is not None and (before[0] != parent or np.abs(before[1] - T).max() > MAX_PLAY):
                self.changed.add(child)
            self.parents[child] = parent, T

    def chain(self, frame: str) -> list[str]:
        """The frame, its parent, and so on up to the root; ValueError for a circle."""
        return self._ancestors(_name(frame))

    def robot_frames(self) -> list[str]:
        """The frames that have a name of the robot's own, the best first."""
        known = self.parents.keys() | {parent for parent, _ in self.parents.values()}
        return [name for name in ROBOT_FRAMES if name in known]

    def leads(self, robot: str, lidar: str) -> bool:
        """Tell whether a chain of transforms leads from one frame to the other."""
        try:
            self.place(robot, lidar)
        except ValueError as error:
            return not isinstance(error, NotConnectedError)
        return _name(robot) == _name(lidar) or bool(self.parents)

    def mount(self, robot: str, lidar: str) -> tuple[tuple[float, float, float], bool]:
        """`T_robot_lidar` in the plane [m, m, rad], and whether the lidar hangs upside down.

        Without any transforms both frames are taken for the same. Raises NotConnectedError where no chain of transforms
        leads from one frame to the other, LeaningLidarError where the lidar is neither level nor upside down.
        """
        robot, lidar = _name(robot), _name(lidar)
        if robot == lidar or not self.parents:
            return (0.0, 0.0, 0.0), False
        T = self.place(robot, lidar)
        up = float(T[2, 2])
        if abs(up) < math.cos(MAX_TILT):
            raise LeaningLidarError(f"the lidar ({lidar}) leans by {math.degrees(math.acos(abs(up))):.0f} degrees")
        return (float(T[0, 3]), float(T[1, 3]), math.atan2(T[1, 0], T[0, 0])), up < 0.0

    def place(self, robot: str, lidar: str) -> NDArray[np.float64]:
        """`T_robot_lidar` in space, (4, 4), however the lidar leans; the identity where no transforms are known.

        Raises NotConnectedError where no chain of transforms leads from one frame to the other.
        """
        robot, lidar = _name(robot), _name(lidar)
        if robot == lidar or not self.parents:
            return np.eye(4)
        T: NDArray[np.float64] = np.linalg.inv(self._from_root(robot, lidar)) @ self._from_root(lidar, robot)
        return T

    def _from_root(self, frame: str, other: str) -> NDArray[np.float64]:
        """Transform from the common ancestor of two frames, or the root, to `frame`, (4, 4)."""
        above_other = set(self._ancestors(other))
        T = np.eye(4)
        for ancestor in self._ancestors(frame):
            if ancestor in above_other:
                return T
            T = self.parents[ancestor][1] @ T if ancestor in self.parents else T
        raise NotConnectedError(f"no transforms lead from {other} to {frame}")

    def _ancestors(self, frame: str) -> list[str]:
        """The frame, its parent, and so on up to the root; ValueError for a circle."""
        chain = [frame]
        while chain[-1] in self.parents:
            parent = self.parents[chain[-1]][0]
            if parent in chain:
                raise ValueError(f"the transforms of {parent} run in a circle")
            chain.append(parent)
        return chain


def planar_pose(position: Any, orientation: Any) -> Pose:
    """x, y, yaw (3,) of a geometry_msgs pose; ValueError where it is not finite, no rotation, or leans."""
    return planar_transform(_matrix(position, orientation))


def planar_transform(T: NDArray[np.float64]) -> Pose:
    """x, y, yaw (3,) of a transform (4, 4); ValueError where it leans."""
    if T[2, 2] < math.cos(MAX_TILT):
        raise ValueError(f"the robot leans by {math.degrees(math.acos(max(T[2, 2], -1.0))):.0f} degrees")
    return np.array([T[0, 3], T[1, 3], math.atan2(T[1, 0], T[0, 0])])


def joint_transforms(urdf: str) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """The joints of a robot at rest, as `Transforms.parents` has them; none where the text is no URDF."""
    try:
        joints = joints_of(urdf)
    except (ElementTree.ParseError, ValueError):
        return {}
    found = {}
    for joint in joints:
        T = np.eye(4)
        T[:3, :3] = _rotation(*joint.rpy)
        T[:3, 3] = joint.xyz
        found[joint.child] = joint.parent, T
    return found


def _rotation(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """Turned about the fixed axes x, y, z in this order, (3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = ([f(angle) for angle in (roll, pitch, yaw)] for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _name(frame: str) -> str:
    return frame.lstrip("/")  # tf of ROS 1 wrote a slash in front


def _matrix(translation: Any, rotation: Any) -> NDArray[np.float64]:
    """Homogeneous transform (4, 4) of a geometry_msgs translation and quaternion."""
    numbers = [translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z, rotation.w]
    x, y, z, qx, qy, qz, qw = (float(number) for number in numbers)
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not (all(abs(number) <= MAX_PLACE for number in numbers) and abs(norm - 1.0) < 0.01):
        raise ValueError(f"expected a finite pose with a unit quaternion, got {' '.join(f'{n:g}' for n in numbers)}")
    qx, qy, qz, qw = qx / norm, qy / norm, qz / norm, qw / norm
    return np.array(
        [
            [1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw), 2 * (qx * qz + qy * qw), x],
            [2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qx * qw), y],
            [2 * (qx * qz - qy * qw), 2 * (qy * qz + qx * qw), 1 - 2 * (qx * qx + qy * qy), z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
