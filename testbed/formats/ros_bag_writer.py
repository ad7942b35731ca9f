# SPDX-License-Identifier: MIT
"""ROS 2 bags, written without ROS: a rosbag2 directory (metadata.yaml and one .mcap) that `ros2 bag play` takes.

Topics: `/scan`, `/odom`, `/tf` (odom to base_link), `/tf_static` (base_link to laser and to the robot's parts),
`/robot_description` and, where truth is known, `/ground_truth/odom`, `/ground_truth/map` and `/ground_truth/tf` (map to
odom). Frames by REP 105: map, odom, base_link, laser.

Viewers such as Rerun draw neither LaserScan nor Odometry: for them the hits are there once more as a point cloud,
`/scan_cloud`, and `/ground_truth/tf` hangs the odometry's frame where it truly is. That is no part of `/tf`, where it
would contradict the mapper that a bag is played to.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.scan import Scan
from slam.se2 import Pose
from testbed.formats.beams import even_spacing
from testbed.formats.log import LogError
from testbed.frame import Frame

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer

SAME_MOUNT = 1e-5
"""Mounts that differ by less [m], [rad] are the same: logs round their poses."""
TYPES = {
    "/scan": "sensor_msgs/msg/LaserScan",
    "/scan_cloud": "sensor_msgs/msg/PointCloud2",
    "/odom": "nav_msgs/msg/Odometry",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/robot_description": "std_msgs/msg/String",
    "/ground_truth/odom": "nav_msgs/msg/Odometry",
    "/ground_truth/tf": "tf2_msgs/msg/TFMessage",
    "/ground_truth/map": "nav_msgs/msg/OccupancyGrid",
}
LATCHED = ("/tf_static", "/robot_description", "/ground_truth/map")
"""Topics of one message that late subscribers still receive."""
FLOAT32 = 7
"""PointField.FLOAT32."""


def write_bag(
    path: str | Path,
    frames: Sequence[Frame],
    *,
    truth_map: OccupancyGrid | None = None,
    robot_urdf: str | None = None,
    cloud: bool = True,
) -> None:
    """Write frames as a rosbag2 directory `path`, which must not exist; equal frames give equal bytes.

    robot_urdf: the robot as URDF text with the root link base_link; its joints are written at rest
    cloud: write `/scan_cloud` too, which more than doubles the size of a bag

    ROS holds ranges and angles as float32, all poses as float64, stamps in nanoseconds. Raises LogError where stamps
    step backwards (a bag is ordered by time), where beams or their times are not evenly spaced, or where scans differ
    in mount. The directory is written aside and renamed.
    """
    path = Path(path)
    if path.exists():
        raise LogError(f"{path}: exists")
    _check(path, frames)
    aside = path.parent / f".{path.name}.writing" / path.name  # the bag's files are named after their directory
    shutil.rmtree(aside.parent, ignore_errors=True)
    aside.parent.mkdir(parents=True)
    try:
        _write(aside, frames, truth_map, robot_urdf, cloud)
        aside.replace(path)
    finally:
        shutil.rmtree(aside.parent, ignore_errors=True)


def _check(path: Path, frames: Sequence[Frame]) -> None:
    mounts = np.array([frame.scan.mount for frame in frames if frame.scan is not None])
    if not mounts.size:
        raise LogError(f"{path}: no scans to write")
    if np.abs(mounts - mounts[0]).max() > SAME_MOUNT:
        raise LogError(f"{path}: scans from lidars mounted at different places, a bag here holds one lidar")
    stamps = np.array([frame.stamp for frame in frames])
    back = np.flatnonzero(np.diff(stamps) < 0.0)
    if back.size:
        raise LogError(f"{path}: frame {back[0] + 1}: the stamps step backwards; a bag is ordered by time")


def _write(
    path: Path, frames: Sequence[Frame], truth_map: OccupancyGrid | None, robot_urdf: str | None, cloud: bool
) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        bag = _Bag(writer)
        first_scan = next(frame.scan for frame in frames if frame.scan is not None)
        start = frames[0].stamp
        bag.static_transforms(start, np.array(first_scan.mount), robot_urdf)
        if robot_urdf is not None:
            bag.put("/robot_description", start, bag.types["std_msgs/msg/String"](data=robot_urdf))
        if truth_map is not None:
            bag.map(start, truth_map)
        for index, frame in enumerate(frames):
            bag.odometry("/odom", frame.stamp, "odom", frame.odometry, frame.twist)
            bag.transform("/tf", frame.stamp, "odom", "base_link", frame.odometry)
            if frame.truth is not None:
                bag.odometry("/ground_truth/odom", frame.stamp, "map", frame.truth, None)
                T_map_odom = se2.compose(frame.truth, se2.inverse(frame.odometry))
                bag.transform("/ground_truth/tf", frame.stamp, "map", "odom", T_map_odom)
            if frame.scan is not None:
                bag.scan(index, frame.stamp, frame.scan)
                if cloud:
                    bag.cloud(frame.stamp, frame.scan)


class _Joint(NamedTuple):
    """A transform from a frame to its child."""

    parent: str
    child: str
    xyz: tuple[float, float, float]
    """[m]"""
    rpy: tuple[float, float, float]
    """Turns about the fixed axes x, y, z in this order [rad]."""


def _joints(urdf: str) -> list[_Joint]:
    """The joints of a robot at rest; an `origin` or a part of it that is left out is zero."""
    return [
        _Joint(
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


@dataclass
class _Bag:
    """Messages into a writer, by topic."""

    writer: Writer
    connections: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_JAZZY)
        self.types = self.store.types

    def put(self, topic: str, stamp: float, message: Any) -> None:
        kind = TYPES[topic]
        if topic not in self.connections:
            qos = [_latched()] if topic in LATCHED else []
            self.connections[topic] = self.writer.add_connection(
                topic, kind, typestore=self.store, offered_qos_profiles=qos
            )
        raw = self.store.serialize_cdr(message, kind)
        self.writer.write(self.connections[topic], _nanoseconds(stamp), raw)

    def scan(self, index: int, stamp: float, scan: Scan) -> None:
        times = scan.time_offsets if scan.time_offsets is not None else np.zeros(scan.ranges.size)
        angles, beats = even_spacing(scan.angles), even_spacing(times)
        if angles is None or beats is None or abs(beats[0]) > 1e-9:
            raise LogError(f"frame {index}: LaserScan needs beams evenly spaced in angle and time, these are not")
        message = self.types["sensor_msgs/msg/LaserScan"](
            header=self.header(stamp, "laser"),
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
        self.put("/scan", stamp, message)

    def odometry(self, topic: str, stamp: float, frame_id: str, pose: Pose, twist: Pose | None) -> None:
        vx, vy, omega = (math.nan,) * 3 if twist is None else map(float, twist)
        geometry = self._geometry
        message = self.types["nav_msgs/msg/Odometry"](
            header=self.header(stamp, frame_id),
            child_frame_id="base_link",
            pose=geometry(
                "PoseWithCovariance",
                pose=geometry(
                    "Pose",
                    position=geometry("Point", x=float(pose[0]), y=float(pose[1]), z=0.0),
                    orientation=self._quaternion(pose[2]),
                ),
                covariance=np.zeros(36),
            ),
            twist=geometry(
                "TwistWithCovariance",
                twist=geometry(
                    "Twist",
                    linear=geometry("Vector3", x=vx, y=vy, z=0.0),
                    angular=geometry("Vector3", x=0.0, y=0.0, z=omega),
                ),
                covariance=np.zeros(36),
            ),
        )
        self.put(topic, stamp, message)

    def cloud(self, stamp: float, scan: Scan) -> None:
        """The hits of a scan as a PointCloud2 message; float32 x, y, z in the lidar's frame."""
        points = np.zeros((np.count_nonzero(scan.hit), 3), dtype="<f4")
        ranges, angles = scan.ranges[scan.hit], scan.angles[scan.hit]
        points[:, 0], points[:, 1] = ranges * np.cos(angles), ranges * np.sin(angles)
        field = self.types["sensor_msgs/msg/PointField"]
        message = self.types["sensor_msgs/msg/PointCloud2"](
            header=self.header(stamp, "laser"),
            height=1,
            width=len(points),
            fields=[field(name=name, offset=4 * k, datatype=FLOAT32, count=1) for k, name in enumerate("xyz")],
            is_bigendian=False,
            point_step=12,
            row_step=points.nbytes,
            data=points.view(np.uint8).ravel(),
            is_dense=True,
        )
        self.put("/scan_cloud", stamp, message)

    def transform(self, topic: str, stamp: float, parent: str, child: str, pose: Pose) -> None:
        """A TFMessage of one pose in the plane, (3,)."""
        x, y, theta = map(float, pose)
        self._transforms(topic, stamp, [_Joint(parent, child, (x, y, 0.0), (0.0, 0.0, theta))])

    def static_transforms(self, stamp: float, mount: Pose, robot_urdf: str | None) -> None:
        """One TFMessage of the lidar's mount and all joints: late subscribers receive the last message only."""
        x, y, theta = map(float, mount)
        joints = [] if robot_urdf is None else _joints(robot_urdf)
        self._transforms("/tf_static", stamp, [_Joint("base_link", "laser", (x, y, 0.0), (0.0, 0.0, theta)), *joints])

    def _transforms(self, topic: str, stamp: float, joints: list[_Joint]) -> None:
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
        self.put(topic, stamp, self.types["tf2_msgs/msg/TFMessage"](transforms=stamped))

    def map(self, stamp: float, grid: OccupancyGrid) -> None:
        """An OccupancyGrid message: percent, -1 unknown."""
        rows, cols = grid.probability.shape
        x, y, theta = grid.origin
        percent = np.where(grid.known, np.rint(100.0 * np.nan_to_num(grid.probability)), -1.0)
        message = self.types["nav_msgs/msg/OccupancyGrid"](
            header=self.header(stamp, "map"),
            info=self.types["nav_msgs/msg/MapMetaData"](
                map_load_time=self.time(stamp),
                resolution=grid.resolution,
                width=cols,
                height=rows,
                origin=self._geometry(
                    "Pose",
                    position=self._geometry("Point", x=x, y=y, z=0.0),
                    orientation=self._quaternion(theta),
                ),
            ),
            data=percent.astype(np.int8).ravel(),
        )
        self.put("/ground_truth/map", stamp, message)

    def header(self, stamp: float, frame_id: str) -> Any:
        return self.types["std_msgs/msg/Header"](stamp=self.time(stamp), frame_id=frame_id)

    def time(self, stamp: float) -> Any:
        seconds, nanoseconds = divmod(_nanoseconds(stamp), 1_000_000_000)
        return self.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)

    def _quaternion(self, yaw: float) -> Any:
        return self._rotation(0.0, 0.0, yaw)

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


def _nanoseconds(stamp: float) -> int:
    seconds = math.floor(stamp)
    return seconds * 1_000_000_000 + round((stamp - seconds) * 1e9)  # stamp * 1e9 would lose digits


def _latched() -> Any:
    """Quality of service of topics that late subscribers still receive."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(2147483647, 4294967295)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        False,
    )
