# SPDX-License-Identifier: MIT
"""ROS messages made from scans, poses, commands and maps, for ROS 1 and ROS 2 alike."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose
from testbed.formats.beams import even_spacing

FLOAT32 = 7
"""PointField.FLOAT32."""


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


def nanoseconds(stamp: float) -> int:
    """A time in whole nanoseconds; `stamp * 1e9` would lose digits."""
    seconds = math.floor(stamp)
    return seconds * 1_000_000_000 + round((stamp - seconds) * 1e9)


@dataclass(frozen=True)
class Messages:
    """Makes messages out of the types of one ROS."""

    types: Any
    """By name, of a rosbags typestore."""

    def scan(self, stamp: float, frame_id: str, scan: Scan) -> Any:
        """A LaserScan; ValueError where the beams are not evenly spaced in angle and time."""
        times = scan.time_offsets if scan.time_offsets is not None else np.zeros(scan.ranges.size)
        angles, beats = even_spacing(scan.angles), even_spacing(times)
        if angles is None or beats is None or abs(beats[0]) > 1e-9:
            raise ValueError("LaserScan needs beams evenly spaced in angle and time, these are not")
        return self.types["sensor_msgs/msg/LaserScan"](
            header=self.header(stamp, frame_id),
            angle_min=angles[0],
            angle_max=angles[0] + angles[1] * max(scan.angles.size - 1, 0),
            angle_increment=angles[1],
            time_increment=beats[1],
            scan_time=0.0,  # unknown; the message has no word for that but zero
            range_min=scan.range_min,
            range_max=scan.range_max,
            ranges=scan.ranges.astype(np.float32),
            intensities=np.empty(0, dtype=np.float32),
        )

    def odometry(self, stamp: float, frame_id: str, pose: Pose, twist: Pose | None) -> Any:
        """An Odometry message of base_link; a twist that is unknown is NaN."""
        vx, vy, omega = (math.nan,) * 3 if twist is None else map(float, twist)
        geometry = self._geometry
        return self.types["nav_msgs/msg/Odometry"](
            header=self.header(stamp, frame_id),
            child_frame_id="base_link",
            pose=geometry(
                "PoseWithCovariance",
                pose=geometry(
                    "Pose",
                    position=geometry("Point", x=float(pose[0]), y=float(pose[1]), z=0.0),
                    orientation=self._rotation(0.0, 0.0, float(pose[2])),
                ),
                covariance=np.zeros(36),
            ),
            twist=geometry("TwistWithCovariance", twist=self.twist(vx, vy, omega), covariance=np.zeros(36)),
        )

    def twist(self, vx: float, vy: float, omega: float) -> Any:
        """A Twist in the plane [m/s, m/s, rad/s]."""
        return self._geometry(
            "Twist",
            linear=self._geometry("Vector3", x=vx, y=vy, z=0.0),
            angular=self._geometry("Vector3", x=0.0, y=0.0, z=omega),
        )

    def cloud(self, stamp: float, frame_id: str, scan: Scan) -> Any:
        """The hits of a scan as a PointCloud2; float32 x, y, z in the lidar's frame."""
        points = np.zeros((np.count_nonzero(scan.hit), 3), dtype="<f4")
        ranges, angles = scan.ranges[scan.hit], scan.angles[scan.hit]
        points[:, 0], points[:, 1] = ranges * np.cos(angles), ranges * np.sin(angles)
        field = self.types["sensor_msgs/msg/PointField"]
        return self.types["sensor_msgs/msg/PointCloud2"](
            header=self.header(stamp, frame_id),
            height=1,
            width=len(points),
            fields=[field(name=name, offset=4 * k, datatype=FLOAT32, count=1) for k, name in enumerate("xyz")],
            is_bigendian=False,
            point_step=12,
            row_step=points.nbytes,
            data=points.view(np.uint8).ravel(),
            is_dense=True,
        )

    def transforms(self, stamp: float, joints: list[Joint]) -> Any:
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

    def map(self, stamp: float, grid: OccupancyGrid) -> Any:
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

    def header(self, stamp: float, frame_id: str) -> Any:
        """A Header; ROS 1 counts messages in it, which nobody reads any more."""
        header = self.types["std_msgs/msg/Header"]
        counted = {"seq": 0} if "seq" in header.__dataclass_fields__ else {}
        return header(stamp=self.time(stamp), frame_id=frame_id, **counted)

    def time(self, stamp: float) -> Any:
        """A Time."""
        seconds, rest = divmod(nanoseconds(stamp), 1_000_000_000)
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
