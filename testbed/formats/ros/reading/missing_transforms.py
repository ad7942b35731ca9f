# SPDX-License-Identifier: MIT
"""Find odometry and mounts that a bag does not state in the usual place: in /tf, or in the robot's description."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from testbed.formats.log import LogError
from testbed.formats.ros.packing import messages
from testbed.formats.ros.reading.clocks import one_clock
from testbed.formats.ros.reading.content import BagContent
from testbed.formats.ros.reading.decode import Track, seconds
from testbed.formats.ros.reading.repairs import with_twists
from testbed.formats.ros.reading.topics import DESCRIPTION, ODOMETRY_TYPE
from testbed.formats.ros.reading.transforms import MAX_PLAY, Mount, Moving, joint_transforms, planar_transform


def complete_transforms(path: Path, content: BagContent, connections: list[Any], reader: Any) -> None:
    """Look for odometry in /tf, and for mounts in /tf and the robot's description, where they are nowhere else.

    connections: those of transforms that are sent again and again; they are read only now, and only if needed
    """
    lidars = {name for scans in content.scans.values() for name in scans.frames} | set(content.cloud_frames.values())
    robot = content.odometry.child_frame
    tf = content.topics["odometry"]
    from_tf = tf in {connection.topic for connection in connections}
    if from_tf or not all(content.transforms.leads(robot, lidar) for lidar in lidars):
        for connection, time, raw in messages(reader, connections) if connections else ():
            content.moving.add(reader.deserialize(raw, connection.msgtype), seconds(time))
    if from_tf:
        pair = content.moving.odometry(content.selection.namespace)
        if pair is None:
            sent = ", ".join(f"{parent} to {child}" for parent, child in list(content.moving.counts)[:8])
            raise LogError(f"{path}: no topic of type {ODOMETRY_TYPE}, and {tf} has no transform from odom, but {sent}")
        track = _track_of(content.moving, pair)
        content.odometry = with_twists(one_clock(content, content.moving.times(pair), track))
        if other := sum(
            count for (parent, child), count in content.moving.counts.items() if child == pair[1] and parent != pair[0]
        ):
            content.notes.append(f"{other} transforms to {pair[1]} come from other frames than {pair[0]}: left out")
        content.topics["odometry"] = f"{tf} ({pair[0]} to {pair[1]})"
        robot = pair[1]
    if not robot and (frames := content.transforms.robot_frames()):
        robot = frames[0]
        content.odometry = content.odometry._replace(child_frame=robot)
        content.notes.append(f"the odometry names no child_frame_id: taken to be that of {robot}")
    if lidars and not all(content.transforms.leads(robot, lidar) for lidar in lidars):
        _find_mounts(content, robot, lidars)
    up = {*content.transforms.chain(robot)}
    between = {frame for lidar in lidars for frame in up ^ {*content.transforms.chain(lidar)}}
    for frame in sorted(content.transforms.changed & between):
        content.notes.append(f"the transform of {frame} is sent again with other numbers: the last one counts")


def _track_of(moving: Moving, pair: tuple[str, str]) -> Track:
    """Odometry out of transforms; ValueError where one leans."""
    stamps = moving.stamps(pair)
    poses = np.array([planar_transform(matrix) for matrix in moving.matrices(pair)])
    return Track(stamps, poses, np.full((len(stamps), 3), np.nan), *pair)


def _find_mounts(content: BagContent, robot: str, lidars: set[str]) -> None:
    """Complete the static transforms from /tf and the robot's description; notes say where mounts were found.

    Raises ValueError for a lidar that is moved about on the robot.
    """
    known = content.transforms.parents
    mounts = content.moving.mounts()
    sources = {"/tf": {child: (mount.parent, mount.T_parent_child) for child, mount in mounts.items()}}
    if content.robot_urdf is not None:
        sources[DESCRIPTION] = joint_transforms(content.robot_urdf)
    for source, found in sources.items():
        missing = {lidar for lidar in lidars if not content.transforms.leads(robot, lidar)}
        if missing:
            content.transforms.parents = found | known | content.transforms.parents
            if reached := sorted(lidar for lidar in missing if content.transforms.leads(robot, lidar)):
                content.notes.append(f"the mount of {', '.join(reached)} is taken from {source}")
                content.notes += _wobbles(content, reached, mounts) if source == "/tf" else []
            else:
                content.transforms.parents = known
            known = content.transforms.parents
    if content.laser_offset is None:
        _refuse_moving(content, robot, {lidar for lidar in lidars if not content.transforms.leads(robot, lidar)})


def _wobbles(content: BagContent, lidars: list[str], mounts: dict[str, Mount]) -> list[str]:
    """Notes on mounts of lidars that are sent with changing numbers."""
    frames = {frame for lidar in lidars for frame in content.transforms.chain(lidar)}
    return [
        f"the transform of {frame} changes by up to {mounts[frame].off:.3f} m or rad: the middle one is taken"
        for frame in sorted(frames & mounts.keys())
        if mounts[frame].off > MAX_PLAY
    ]


def _refuse_moving(content: BagContent, robot: str, lidars: set[str]) -> None:
    """Raise ValueError where a transform that changes leads from the robot to one of the lidars."""
    moved = content.moving.moved()
    for lidar in sorted(lidars):
        frame, chain = lidar, []
        while frame != robot and frame in moved and frame not in chain:
            chain.append(frame)
            frame = moved[frame]
            while frame != robot and frame in content.transforms.parents:
                frame = content.transforms.parents[frame][0]
        if chain and frame == robot:
            raise ValueError(
                f"{chain[-1]} moves on {frame}: only lidars on fixed mounts are read; --laser-offset X "
                f"says where {lidar} sits"
            )
