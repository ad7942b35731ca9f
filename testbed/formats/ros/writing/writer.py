# SPDX-License-Identifier: MIT
"""ROS bags, written without ROS: rosbag2 directories (MCAP or SQLite) that `ros2 bag play` takes, and ROS 1 bags.

Topics: `/scan`, `/odom`, `/cmd_vel` where the commands are known, `/tf` (odom to base_link), `/tf_static` (base_link to
laser and to the robot's parts), `/robot_description` and, where truth is known, `/ground_truth/odom`,
`/ground_truth/map` and `/ground_truth/tf` (map to odom). Bags whose format has no check sums end with one on
`/testbed/sha256`. Frames by REP 105: map, odom, base_link, laser. Of several lidars, each has a frame of its own and a
topic `/scan_` with the frame's name.

Viewers such as Rerun draw neither LaserScan nor Odometry. For them a bag also holds the hits as a point cloud,
`/scan_cloud`, and the true pose of the odometry's frame, `/ground_truth/tf`. The latter is no part of `/tf`, where it
would contradict the mapper that a bag is played to.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from eval.files.atomic_write import atomic_directory
from testbed.formats.beams import same_mount
from testbed.formats.head import LogHead
from testbed.formats.log import LogError
from testbed.formats.ros.messages import Joint, Messages, joints_of, planar_joint
from testbed.formats.ros.writing.records import RecordMaker, nanoseconds
from testbed.formats.ros.writing.storages import Bag, Storage, new_bag
from testbed.frame_table import FrameTable

MAX_STAMP = 2**31 - 1
"""ROS 2 counts seconds in 31 bits."""


def write_bag(
    path: str | Path,
    blocks: Iterable[FrameTable],
    head: LogHead,
    *,
    storage: Storage = "mcap",
    cloud: bool = True,
    compressed: bool = False,
) -> None:
    """Write blocks of frames as a bag `path`, which must not exist; equal blocks give equal bytes.

    head: its `robot_urdf` has the root link base_link; its joints are written at rest
    storage: mcap, sqlite: a rosbag2 directory (metadata.yaml and one file);  rosbag1: one file, for ROS 1
    cloud: write the point clouds too, which more than doubles the size of a bag
    compressed: pack chunks with zstd (mcap) or LZ4 (rosbag1)

    ROS holds ranges and angles as float32, all poses as float64, stamps in nanoseconds. Raises LogError where stamps
    step backwards (a bag is ordered by time) or are out of ROS's range, where beams or their times are not evenly
    spaced, or where scans of one lidar differ in mount. The bag appears whole or not at all.
    """
    path = Path(path)
    if path.exists():
        raise LogError(f"{path}: exists")
    topics = scan_topics(list(head.lidars))
    if len(set(topics.values())) < len(topics):
        raise LogError(f"{path}: names of lidars that differ in signs alone: {', '.join(topics)}")
    scan_times = {name: lidar.scan_time for name, lidar in head.lidars.items()}
    with atomic_directory(path) as temporary, new_bag(temporary, storage, compressed=compressed) as bag:
        maker = RecordMaker(bag, topics, scan_times, cloud)
        last = -math.inf
        for block in blocks:
            try:
                _check(block, last, head)
                if last == -math.inf:
                    _put_first(bag, int(nanoseconds(block.stamps[:1])[0]), head)
                for records in maker.records(block):
                    bag.write(records)
            except LogError as error:
                raise LogError(f"{path}: {error}") from None
            last = float(block.stamps[-1])
        if last == -math.inf:
            raise LogError(f"{path}: no frames to write")


def scan_topics(lidars: Sequence[str]) -> dict[str, str]:
    """Topic of each lidar's scans, by the name of its frame."""
    if len(lidars) == 1:
        return {lidars[0]: "/scan"}
    return {name: f"/scan_{re.sub(r'[^A-Za-z0-9_]', '_', name)}" for name in lidars}


def _check(block: FrameTable, last: float, head: LogHead) -> None:
    """Raise LogError where a bag cannot hold these frames, which follow one at `last` [s]."""
    back = np.flatnonzero(np.diff(block.stamps, prepend=last) < 0.0)
    if back.size:
        raise LogError(f"frame {block.first + back[0]}: the stamps step backwards; a bag is ordered by time")
    if not (block.stamps[0] >= 0.0 and block.stamps[-1] < MAX_STAMP):
        raise LogError(f"stamps from {block.stamps[0]:g} to {block.stamps[-1]:g} s, expected 0 to {MAX_STAMP}")
    mounts, first = np.unique(np.column_stack([block.scan_lidars, block.mounts]), axis=0, return_index=True)
    for lidar, *mount in mounts[np.argsort(first)].tolist():
        name = block.lidars[int(lidar)]
        if not same_mount((mount[0], mount[1], mount[2]), head.lidars[name].mount):
            raise LogError(f"scans of one lidar ({name}) mounted at different places")


def _put_first(bag: Bag, time: int, head: LogHead) -> None:
    """Write the messages that hold for the whole bag; time [ns]."""
    make = Messages(bag.types)
    joints = [planar_joint("base_link", name, np.array(lidar.mount)) for name, lidar in head.lidars.items()]
    bag.put("/tf_static", time, make.transforms(time, [*joints, *_robot_joints(head)]))  # late subscribers get one
    if head.robot_urdf is not None:
        bag.put("/robot_description", time, make.text(head.robot_urdf))
    if head.truth_map is not None:
        bag.put("/ground_truth/map", time, make.map(time, head.truth_map))


def _robot_joints(head: LogHead) -> list[Joint]:
    return [] if head.robot_urdf is None else joints_of(head.robot_urdf)
