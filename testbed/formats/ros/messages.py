# SPDX-License-Identifier: MIT
"""The single messages at the begin of a bag: static transforms, robot, true map. For ROS 1 and ROS 2 alike."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from slam.occupancy import OccupancyGrid
from slam.se2 import Pose


class Joint(NamedTuple):
    """A transform from a frame to its child."""

    parent: str
    child: str
    xyz: tuple[float, float, float]
    """[m]"""
    rpy: tuple[float, float, float]
    """Turns about the fixed axes x, y, z in this order [rad]."""


def planar_joint(parent: str, child: str, pose: Pose) -> Joint:
    """A transform in the plane; pose (3,)."""
    x, y, theta = map(float, pose)
    return Joint(parent, child, (x, y, 0.0), (0.0, 0.0, theta))


def joints_of(urdf: str) -> list[Joint]:
    """The joints of a robot at rest; an `origin` or a part of it that is left out is zero."""
    return [
        Joint(
            _attribute(joint, "parent", "link", ""),
            _attribute(joint, "child", "link", ""),
            _triple(_attribute(joint, "origin", "xyz", "0 0 0")),
            _triple(_attribute(joint, "origin", "rpy", "0 0 0")),
        )
        for joint in ElementTree.fromstring(urdf).iterfind("joint")
    ]


def _attribute(joint: ElementTree.Element, tag: str, name: str, default: str) -> str:
    element = joint.find(tag)
    return default if element is None else element.get(name, default)


def _triple(text: str) -> tuple[float, float, float]:
    x, y, z = map(float, text.split())
    return x, y, z


@dataclass(frozen=True)
class Messages:
    """Makes messages out of the types of one ROS."""

    types: Any
    """The message types of a rosbags typestore, by name."""

    def transforms(self, stamp: int, joints: list[Joint]) -> Any:
        """A TFMessage."""
        stamped = [
            self._geometry(
                "TransformStamped",
                header=self.header(stamp, joint.parent),
                child_frame_id=joint.child,
                transform=self._geometry(
                    "Transform",
                    translation=self._geometry("Vector3", **dict(zip("xyz", joint.xyz, strict=True))),
                    rotation=self._rotation(*joint.rpy),
                ),
            )
            for joint in joints
        ]
        return self.types["tf2_msgs/msg/TFMessage"](transforms=stamped)

    def map(self, stamp: int, grid: OccupancyGrid) -> Any:
        """An OccupancyGrid message: percent, -1 unknown."""
        rows, cols = grid.probability.shape
        x, y, theta = grid.origin
        percent = np.where(grid.known, np.rint(100.0 * np.nan_to_num(grid.probability)), -1.0)
        return self.types["nav_msgs/msg/OccupancyGrid"](
            header=self.header(stamp, "map"),
            info=self.types["nav_msgs/msg/MapMetaData"](
                map_load_time=self.time(stamp),
                resolution=grid.resolution,
                width=cols,
                height=rows,
                origin=self._geometry(
                    "Pose",
                    position=self._geometry("Point", x=x, y=y, z=0.0),
                    orientation=self._rotation(0.0, 0.0, theta),
                ),
            ),
            data=percent.astype(np.int8).ravel(),
        )

    def text(self, content: str) -> Any:
        """A String."""
        return self.types["std_msgs/msg/String"](data=content)

    def header(self, stamp: int, frame_id: str) -> Any:
        """A Header; ROS 1 counts messages in it, which nobody reads any more."""
        header = self.types["std_msgs/msg/Header"]
        counted = {"seq": 0} if "seq" in header.__dataclass_fields__ else {}
        return header(stamp=self.time(stamp), frame_id=frame_id, **counted)

    def time(self, stamp: int) -> Any:
        """A Time; stamp [ns]."""
        seconds, rest = divmod(stamp, 1_000_000_000)
        return self.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)

    def _rotation(self, roll: float, pitch: float, yaw: float) -> Any:
        """Turned about the fixed axes x, y, z in this order, as in a URDF."""
        (cr, cp, cy), (sr, sp, sy) = ([f(angle / 2) for angle in (roll, pitch, yaw)] for f in (math.cos, math.sin))
        return self._geometry(
            "Quaternion",
            x=sr * cp * cy - cr * sp * sy,
            y=cr * sp * cy + sr * cp * sy,
            z=cr * cp * sy - sr * sp * cy,
            w=cr * cp * cy + sr * sp * sy,
        )

    def _geometry(self, kind: str, **values: Any) -> Any:
        return self.types[f"geometry_msgs/msg/{kind}"](**values)
