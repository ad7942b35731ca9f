# SPDX-License-Identifier: MIT
"""ROS bags, read without ROS: rosbag2 directories (MCAP, SQLite), single `.mcap` or `.db3` files, ROS 1 `.bag` files.

Scans are `sensor_msgs/LaserScan`, odometry and truth `nav_msgs/Odometry`, commands `geometry_msgs/Twist`, the true map
`nav_msgs/OccupancyGrid`; the lidars' mounts come from the static transforms. Frames by REP 105: the odometry's
`child_frame_id` is the robot, and the frame of a scan tells which lidar took it.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.occupancy import OccupancyGrid
from slam.se2 import Pose
from testbed.formats.checksums import SEAL_TOPIC, MessageSum, verify
from testbed.formats.log import Log, LogError
from testbed.formats.ros.decode import (
    NO_TRACK,
    BadMessageError,
    RawScan,
    Track,
    decode_commands,
    decode_odometry,
    decode_scan,
    seconds,
)
from testbed.formats.ros.layouts import Encoding
from testbed.formats.ros.repairs import Fan, bag_time, bridged, first_pass, with_twists
from testbed.formats.ros.salvage import readable
from testbed.formats.ros.transforms import Moving, Transforms, joint_transforms, planar_pose, planar_transform
from testbed.frame_table import BeamPattern, FrameTable

SCAN_TYPE = "sensor_msgs/msg/LaserScan"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
TRANSFORM_TYPE = "tf2_msgs/msg/TFMessage"
COMMAND_TYPES = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
MAP_TYPE = "nav_msgs/msg/OccupancyGrid"
DESCRIPTION = "/robot_description"
COMMANDS = "/cmd_vel"
MAX_CELLS = 100_000_000
"""Cells."""
TRUTH_WORDS = ("ground_truth", "truth", "groundtruth")
"""A topic whose name contains one of these words holds the true pose."""
MAX_METADATA = 1_000_000
"""Bytes of a metadata.yaml."""
ODOMETRY_REACH = 0.2
"""A scan may lie outside of the odometry's time by this much [s], one period of slow odometry."""


def read_bag(path: Path, *, laser_offset: float | None = None, range_max: float | None = None) -> Log:
    """Read a ROS bag; frames are sorted by the stamps in the messages' headers.

    laser_offset [m]: the lidar sits this far ahead of the robot's centre, whatever the transforms say; range_max [m]
    overrides what the scans say. Topics are chosen by type: of several, `/odom` and `/cmd_vel`, and of
    several with scans of one lidar (one frame) `/scan`. Odometry and truth are interpolated at the scans' stamps, a
    frame's command is the latest one; scans outside of the odometry's time are left out and counted, as are topics.
    Raises LogError, naming the file and the place, for damaged bags, missing topics, clocks that do not meet, and
    values that make no sense.
    """
    if path.is_dir():
        verify(path)
    metadata = path / "metadata.yaml"
    if metadata.is_file() and metadata.stat().st_size > MAX_METADATA:
        raise LogError(f"{metadata}: larger than {MAX_METADATA} bytes")
    content = _Content(laser_offset=laser_offset)
    with _complaints(path, content), readable(path) as (paths, notes):
        content.notes += notes
        _read_messages(path, paths, content)
    if not len(content.odometry.stamps):
        raise LogError(f"{path}: no odometry: the topic {content.topics['odometry']} is empty")
    return _assemble(path, content, range_max)


@dataclass
class _Content:
    """What is read of a bag."""

    laser_offset: float | None = None
    """The lidar's place ahead of the robot's centre as the user gave it [m]."""
    notes: list[str] = field(default_factory=list)
    """What was found and mended, for the user."""
    topics: dict[str, str] = field(default_factory=dict)
    """Topics of odometry, truth, commands and map, as far as there are any."""
    others: list[str] = field(default_factory=list)
    """Topics that are left out, as the user reads them."""
    scans: dict[str, list[RawScan]] = field(default_factory=dict)
    """The scans of each topic."""
    places: dict[int, str] = field(default_factory=dict)
    """Number and topic of each scan in the bag, by its `id`, for messages to the user."""
    odometry: Track = NO_TRACK
    truth: Track = NO_TRACK
    commands: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3)))
    """Stamp [s], speed [m/s], turn rate [rad/s], in the order of the bag."""
    transforms: Transforms = field(default_factory=Transforms)
    moving: Moving = field(default_factory=Moving)
    """Transforms of topics that are not static; only read where odometry or mounts are nowhere else."""
    clock_offset: float = 0.0
    """How far the bag's own times lie behind the stamps of odometry [s]."""
    truth_map: OccupancyGrid | None = None
    robot_urdf: str | None = None
    messages: int = 0


class _Raw(NamedTuple):
    """A serialised message."""

    number: int
    """Counts the messages that are read, from 1."""
    time: int
    """Time of the bag [ns]."""
    data: bytes


@contextmanager
def _complaints(path: Path, content: _Content) -> Iterator[None]:
    """Turn whatever a damaged bag raises deep inside the readers into one line with the file and the place."""
    try:
        yield
    except LogError:
        raise
    except Exception as error:  # struct, SQLite, YAML, codecs, message definitions: all mean a damaged bag
        reason = " ".join(str(error).split()) or type(error).__name__
        raise LogError(f"{path}: damaged or unreadable bag, after {content.messages} messages: {reason}") from None


def _read_messages(path: Path, paths: list[Path], content: _Content) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader(paths, default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = _choose_topics(path, reader, content)
        topics = {connection.topic for connection in wanted}
        sealed, total, seal = any(c.topic == SEAL_TOPIC for c in reader.connections), MessageSum(), ""
        raws: dict[str, tuple[Any, list[_Raw]]] = {}
        for connection, time, raw in reader.messages(connections=reader.connections if sealed else wanted):
            if connection.topic == SEAL_TOPIC:
                seal = str(getattr(reader.deserialize(raw, connection.msgtype), "data", ""))
                continue
            if sealed:
                total.add(connection.topic, time, raw)
            if connection.topic not in topics:
                continue
            content.messages += 1
            raws.setdefault(connection.topic, (connection, []))[1].append(_Raw(content.messages, time, raw))
        if sealed and seal != total.text:
            raise LogError(f"{path}: damaged bag: its messages differ from the SHA-256 in {SEAL_TOPIC}")
        odometry = content.topics["odometry"]  # first, since its clock mends others
        for topic in sorted(raws, key=lambda topic: topic != odometry):
            connection, messages = raws[topic]
            try:
                _decode(content, connection, messages, reader)
            except BadMessageError as error:
                raise LogError(f"{path}: message {messages[error.number].number} ({topic}): {error}") from None
        try:
            _complete_transforms(path, content, raws, reader)
        except ValueError as error:
            raise error if isinstance(error, LogError) else LogError(f"{path}: /tf: {error}") from None


def _choose_topics(path: Path, reader: Any, content: _Content) -> list[Any]:
    """Connections that are to be read; what they are for goes into `content`."""
    by_type: defaultdict[str, set[str]] = defaultdict(set)
    for connection in reader.connections:
        by_type[connection.msgtype].add(connection.topic)
    poses, maps = sorted(by_type[ODOMETRY_TYPE]), sorted(by_type[MAP_TYPE])
    truths = [topic for topic in poses if _is_ground_truth(topic)]
    others = [topic for topic in poses if topic not in truths]
    commands = sorted(set().union(*(by_type[kind] for kind in COMMAND_TYPES)))
    content.scans = {topic: [] for topic in sorted(by_type[SCAN_TYPE])}
    if not others and by_type[SCAN_TYPE] and "/tf" in by_type[TRANSFORM_TYPE]:
        content.topics = {"odometry": "/tf"}
    else:
        content.topics = {"odometry": _choose(path, ODOMETRY_TYPE, others, "/odom", reader)}
    if truths:
        content.topics["truth"] = truths[0]
    if COMMANDS in commands or len(commands) == 1:
        content.topics["commands"] = COMMANDS if COMMANDS in commands else commands[0]
    if true_maps := [topic for topic in maps if _is_ground_truth(topic)]:
        content.topics["map"] = true_maps[0]
    taken = {*content.topics.values(), *content.scans, *(by_type["std_msgs/msg/String"] & {DESCRIPTION})}
    wanted = [c for c in reader.connections if c.topic in taken or c.msgtype == TRANSFORM_TYPE]
    derived = {SEAL_TOPIC, *(f"{topic}_cloud" for topic in content.scans)}
    content.others = sorted(
        {
            f"{c.topic} ({c.msgtype}, {c.msgcount} messages)"
            for c in reader.connections
            if c not in wanted and c.topic not in derived
        }
    )
    return wanted


def _is_ground_truth(topic: str) -> bool:
    return any(word in topic.lower() for word in TRUTH_WORDS)


def _choose(path: Path, kind: str, topics: list[str], usual: str, reader: Any) -> str:
    if not topics:
        there = ", ".join(sorted({f"{c.topic} ({c.msgtype})" for c in reader.connections})[:8]) or "nothing"
        raise LogError(f"{path}: no topic of type {kind}; there is: {there}")
    if len(topics) > 1 and usual not in topics:
        raise LogError(f"{path}: several topics of type {kind} and none is {usual}: {', '.join(topics)}")
    return usual if usual in topics else topics[0]


def _decode(content: _Content, connection: Any, raws: list[_Raw], reader: Any) -> None:
    """Decode all messages of a topic; BadMessageError where one makes no sense."""
    topic, topics = connection.topic, content.topics
    encoding: Encoding = "cdr" if reader.is2 else "ros1"
    data = [raw.data for raw in raws]

    def deserialise(raw: bytes) -> Any:
        return reader.deserialize(raw, connection.msgtype)

    if connection.msgtype == TRANSFORM_TYPE:
        if "static" in topic:  # moving joints are no mount
            _one_by_one(data, lambda raw: content.transforms.add(deserialise(raw)))
    elif topic == DESCRIPTION:
        content.robot_urdf = deserialise(data[-1]).data
    elif topic in content.scans:
        content.scans[topic] = _in_one_pass(content, raws, [decode_scan(raw, encoding, deserialise) for raw in data])
        places = (f"message {raw.number} ({topic})" for raw in raws[: len(content.scans[topic])])
        content.places |= dict(zip(map(id, content.scans[topic]), places, strict=True))
    elif topic == topics.get("commands"):
        content.commands = decode_commands(data, [raw.time for raw in raws], encoding, deserialise)
    elif topic == topics.get("map"):
        _one_by_one(data[-1:], lambda raw: setattr(content, "truth_map", _grid(deserialise(raw))))
    elif topic == topics["odometry"]:
        track = decode_odometry(data, encoding, deserialise)
        content.odometry = _one_clock(content, np.array([seconds(raw.time) for raw in raws]), track)
    else:
        truth = decode_odometry(data, encoding, deserialise)
        content.truth = truth.first(first_pass(truth.stamps))


def _one_clock(content: _Content, times: NDArray[np.float64], track: Track) -> Track:
    """Odometry without repeated passes, with the bag's `times` [s], (n,), where all of its stamps are equal."""
    mended = bag_time(track.stamps, times, 0.0)
    if mended is not None:
        content.notes.append(f"all stamps of the odometry are {track.stamps[0]:g} s: the bag's own times are used")
        track = track._replace(stamps=mended)
    else:
        content.clock_offset = float(np.median(times - track.stamps))
    count = first_pass(track.stamps)
    if count < len(track.stamps):
        content.notes.append(
            f"time steps back by {track.stamps[:count].max() - track.stamps[count]:.1f} s: the recording was played "
            f"more than once; the first pass is used, {len(track.stamps) - count} messages of odometry are left out"
        )
    return track.first(count)


def _in_one_pass(content: _Content, raws: list[_Raw], scans: list[RawScan]) -> list[RawScan]:
    """The same for the scans of a topic."""
    stamps = np.array([scan.stamp for scan in scans])
    times = np.array([seconds(raw.time) for raw in raws])
    mended = bag_time(stamps, times, content.clock_offset)
    if mended is not None:
        content.notes.append(f"all stamps of the scans are {stamps[0]:g} s: the bag's own times are used")
        stamps = mended
        scans = [scan._replace(stamp=stamp) for scan, stamp in zip(scans, stamps.tolist(), strict=True)]
    return scans[: first_pass(stamps)]


def _complete_transforms(path: Path, content: _Content, raws: dict[str, tuple[Any, list[_Raw]]], reader: Any) -> None:
    """Look for odometry in /tf, and for mounts in /tf and the robot's description, where they are nowhere else."""
    lidars = {scan.frame_id for scans in content.scans.values() for scan in scans}
    robot = content.odometry.child_frame
    from_tf = content.topics["odometry"] == "/tf"
    if from_tf or not all(content.transforms.leads(robot, lidar) for lidar in lidars):
        for topic, (connection, messages) in raws.items():
            if connection.msgtype == TRANSFORM_TYPE and "static" not in topic:
                for raw in messages:
                    content.moving.add(reader.deserialize(raw.data, connection.msgtype))
    if from_tf:
        pair = content.moving.odometry()
        if pair is None:
            raise LogError(f"{path}: no topic of type {ODOMETRY_TYPE}, and /tf has no transform from odom")
        track = _track_of(content.moving, pair)
        content.odometry = with_twists(_one_clock(content, track.stamps, track))
        content.topics["odometry"] = f"/tf ({pair[0]} to {pair[1]})"
        robot = pair[1]
    if lidars and not all(content.transforms.leads(robot, lidar) for lidar in lidars):
        _find_mounts(content, robot, lidars)


def _track_of(moving: Moving, pair: tuple[str, str]) -> Track:
    """Odometry out of transforms; ValueError where one leans."""
    poses = [planar_transform(matrix) for matrix in moving.matrices[pair]]
    stamps = np.array(moving.stamps[pair])
    return Track(stamps, np.array(poses), np.full((len(stamps), 3), np.nan), *pair)


def _find_mounts(content: _Content, robot: str, lidars: set[str]) -> None:
    """Complete the static transforms from /tf and the robot's description; notes say where mounts were found."""
    known = content.transforms.parents
    sources = {"/tf": content.moving.fixed()}
    if content.robot_urdf is not None:
        sources[DESCRIPTION] = joint_transforms(content.robot_urdf)
    for source, found in sources.items():
        missing = {lidar for lidar in lidars if not content.transforms.leads(robot, lidar)}
        if missing:
            content.transforms.parents = found | known | content.transforms.parents
            if reached := sorted(lidar for lidar in missing if content.transforms.leads(robot, lidar)):
                content.notes.append(f"the mount of {', '.join(reached)} is taken from {source}")
            else:
                content.transforms.parents = known
            known = content.transforms.parents


def _one_by_one(raws: list[bytes], take: Callable[[bytes], None]) -> None:
    """Take messages; BadMessageError with the number of the one that makes no sense."""
    for number, raw in enumerate(raws):
        try:
            take(raw)
        except ValueError as error:
            raise BadMessageError(number, str(error)) from None


def _grid(message: Any) -> OccupancyGrid:
    """An OccupancyGrid message; ValueError where it is too large or makes no sense."""
    info = message.info
    if not 0 < info.width * info.height <= MAX_CELLS:
        raise ValueError(f"a map of {info.width} x {info.height} cells, expected 1 to {MAX_CELLS}")
    if len(message.data) != info.width * info.height or not 0.0 < info.resolution < math.inf:
        raise ValueError(f"a map of {info.width} x {info.height} cells of {info.resolution} m with {len(message.data)}")
    percent = np.asarray(message.data, dtype=np.float32).reshape(info.height, info.width)
    x, y, theta = planar_pose(info.origin.position, info.origin.orientation).tolist()
    return OccupancyGrid(
        probability=np.where(percent < 0.0, np.float32(np.nan), percent / np.float32(100.0)),
        resolution=float(str(np.float32(info.resolution))),  # 0.05, not the float32 next to it
        origin=(x, y, theta),
    )


def _assemble(path: Path, content: _Content, range_max: float | None) -> Log:
    track, jumps = bridged(content.odometry.in_time())
    content.notes += jumps
    first, last = track.stamps[0], track.stamps[-1]
    scans, repeated = _one_topic_per_lidar(path, content)
    reachable = [scan for scan in scans if first - ODOMETRY_REACH <= scan.stamp <= last + ODOMETRY_REACH]
    if scans and not reachable:
        raise LogError(
            f"{path}: the clocks of scans and odometry do not meet: scans from {scans[0].stamp:.3f} to "
            f"{scans[-1].stamp:.3f} s, odometry from {first:.3f} to {last:.3f} s"
        )
    chosen = " and ".join(topic for topic in content.scans if topic not in repeated) or "nowhere"
    notes = [f"scans from {chosen}, odometry from {content.topics['odometry']}"]
    if len(reachable) < len(scans):
        outside = len(scans) - len(reachable)
        notes.append(f"{outside} of {len(scans)} scans lie outside of the odometry's time and are left out")
    if left_out := [*(f"{topic} (the same lidar)" for topic in repeated), *content.others]:
        notes.append(f"topics left out: {', '.join(left_out[:8])}{' and others' if left_out[8:] else ''}")
    table = _table(path, content, track, reachable, range_max)
    return Log(
        path=path,
        format="ROS bag",
        table=table,
        notes=(*notes, *content.notes),
        truth_map=content.truth_map,
        robot_urdf=content.robot_urdf,
    )


def _table(path: Path, content: _Content, track: Track, scans: list[RawScan], range_max: float | None) -> FrameTable:
    """A frame for each scan, and one for each odometry message at whose stamp there is no scan."""
    stamps = np.array([scan.stamp for scan in scans])
    alone = ~np.isin(track.stamps, stamps)
    at = np.clip(np.searchsorted(track.stamps, stamps), 0, len(track.stamps) - 1)
    all_stamps = np.concatenate([track.stamps[alone], stamps])
    order = np.argsort(all_stamps, kind="stable")
    twists = np.concatenate([track.twists[alone], track.twists[at]])[order]
    twists[~np.isfinite(twists).all(axis=1)] = np.nan
    all_stamps, seen = all_stamps[order], _Scans(path, content, scans, range_max)
    rows = np.empty(len(order), dtype=np.int64)
    rows[order] = np.arange(len(order))
    return FrameTable(
        stamps=all_stamps,
        odometry=np.concatenate([track.poses[alone], interpolate(track.stamps, track.poses, stamps)])[order],
        twist=twists,
        command=_latest(content.commands, all_stamps),
        truth=_truth_at(content.truth, all_stamps),
        scan_rows=rows[int(alone.sum()) :],
        scan_lidars=np.array(seen.lidar_of, dtype=np.int64),
        scan_patterns=np.array(seen.pattern_of, dtype=np.int64),
        scan_starts=np.cumsum([0, *(scan.ranges.size for scan in scans)], dtype=np.int64),
        ranges=np.concatenate([scan.ranges for scan in scans]) if scans else np.empty(0, dtype=np.float32),
        range_limits=np.array(seen.limits).reshape(-1, 2),
        mounts=np.array(seen.mounts).reshape(-1, 3),
        lidars=tuple(seen.lidars),
        patterns=tuple(seen.patterns),
    )


class _Scans:
    """Lidars, beam patterns, limits and mounts of scans; LogError, with the place, where they make no sense."""

    def __init__(self, path: Path, content: _Content, scans: list[RawScan], range_max: float | None) -> None:
        self._path, self._content = path, content
        self.lidars: dict[str, int] = {}
        self.lidar_of: list[int] = []
        self.patterns: list[BeamPattern] = []
        self.pattern_of: list[int] = []
        self.limits: list[tuple[float, float]] = []
        self.mounts: list[tuple[float, float, float]] = []
        known: dict[tuple[Any, ...], int] = {}
        checked: set[Fan] = set()
        mounts: dict[str, tuple[tuple[float, float, float], bool]] = {}
        for scan in scans:
            self._check(scan)
            if scan.frame_id not in mounts:
                mounts[scan.frame_id] = self._mount(scan)
            mount, upside_down = mounts[scan.frame_id]
            fan = Fan(scan.angle_min, scan.angle_max, scan.angle_increment, scan.ranges.size)
            if fan not in checked:
                self._check_fan(scan, fan)
                checked.add(fan)
            key = scan.angle_min, scan.angle_increment, scan.time_increment, scan.ranges.size, upside_down
            number = known.setdefault(key, len(self.patterns))
            if number == len(self.patterns):
                self.patterns.append(_pattern(*key))
            self.pattern_of.append(number)
            self.lidar_of.append(self.lidars.setdefault(scan.frame_id, len(self.lidars)))
            self.limits.append((scan.range_min, scan.range_max if range_max is None else range_max))
            self.mounts.append(mount)

    def _check(self, scan: RawScan) -> None:
        if not (math.isfinite(scan.angle_min) and math.isfinite(scan.angle_increment)):
            numbers = f"angle_min {scan.angle_min} and angle_increment {scan.angle_increment}"
            raise LogError(f"{self._place(scan)}: angles must be finite, got {numbers}")
        if not scan.range_max > scan.range_min >= 0.0:
            limits = f"{scan.range_min} and {scan.range_max}"
            raise LogError(f"{self._place(scan)}: expected 0 <= range_min < range_max, got {limits}")

    def _check_fan(self, scan: RawScan, fan: Fan) -> None:
        try:
            note = fan.check()
        except ValueError as error:
            raise LogError(f"{self._place(scan)}: {error}") from None
        if note is not None and not any("angle_max is" in other for other in self._content.notes):
            self._content.notes.append(note)

    def _mount(self, scan: RawScan) -> tuple[tuple[float, float, float], bool]:
        content, robot = self._content, self._content.odometry.child_frame
        if content.laser_offset is not None:
            content.notes.append(f"{scan.frame_id} {content.laser_offset:+g} m along x (as given)")
            return (content.laser_offset, 0.0, 0.0), False
        try:
            mount = content.transforms.mount(robot, scan.frame_id)
        except ValueError as error:
            raise LogError(f"{self._place(scan)}: {error}; --laser-offset X says where the lidar sits") from None
        if not content.transforms.leads(robot, scan.frame_id):
            content.notes.append(
                f"no transform says where {scan.frame_id} is mounted: it is taken to sit at the robot's centre, ahead; "
                "--laser-offset X says otherwise"
            )
        return mount

    def _place(self, scan: RawScan) -> str:
        return f"{self._path}: {self._content.places[id(scan)]}"


def _pattern(first: float, step: float, between: float, count: int, upside_down: bool) -> BeamPattern:
    beams = np.arange(count, dtype=np.float64)
    angles = first + step * beams
    return BeamPattern(
        angles=-angles if upside_down else angles, time_offsets=between * beams if between != 0.0 else None
    )


def _one_topic_per_lidar(path: Path, content: _Content) -> tuple[list[RawScan], list[str]]:
    """The scans of all lidars in the order of time, and the topics that are left out: scans with the same frame are
    the same lidar's, once more or processed somehow."""
    by_lidar: defaultdict[str, list[str]] = defaultdict(list)
    for topic, scans in content.scans.items():
        for name in sorted({scan.frame_id for scan in scans}):
            by_lidar[name].append(topic)
    chosen = set()
    for topics in by_lidar.values():
        if len(topics) > 1 and "/scan" not in topics:
            raise LogError(f"{path}: several topics with scans of one lidar, none is /scan: {', '.join(topics)}")
        chosen.add("/scan" if "/scan" in topics else topics[0])
    kept = [scan for topic in sorted(chosen) for scan in content.scans[topic]]
    return sorted(kept, key=lambda scan: scan.stamp), [topic for topic in content.scans if topic not in chosen]


def interpolate(stamps: NDArray[np.float64], poses: Pose, times: NDArray[np.float64]) -> Pose:
    """Poses (m, 3) at `times` (m,) between their neighbours in time, along a constant motion; beyond the ends the
    nearest.

    stamps (n,) increasing [s];  poses (n, 3)
    """
    after = np.searchsorted(stamps, times)
    inside = (after > 0) & (after < len(stamps))
    found: Pose = poses[np.minimum(after, len(stamps) - 1)]
    after, times = after[inside], times[inside]
    share = (times - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    between = se2.compose(poses[after - 1], share[:, None] * se2.between(poses[after - 1], poses[after]))
    exact = share == 1.0  # where the frame was written with its odometry
    found[inside] = np.where(exact[:, None], poses[after], between)
    return found


def _truth_at(truth: Track, stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """The true poses (n, 3) where their topic covers the stamps (n,), NaN elsewhere."""
    found = np.full((len(stamps), 3), np.nan)
    if len(truth.stamps):
        track = truth.in_time()
        covered = (track.stamps[0] - 1e-9 <= stamps) & (stamps <= track.stamps[-1] + 1e-9)
        found[covered] = interpolate(track.stamps, track.poses, stamps[covered])
    return found


def _latest(commands: NDArray[np.float64], stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """The latest command at stamps (n,), NaN where there is none by then, (n, 2)."""
    found = np.full((len(stamps), 2), np.nan)
    if len(commands):
        commands = commands[np.argsort(commands[:, 0], kind="stable")]
        latest = np.searchsorted(commands[:, 0], stamps, side="right") - 1
        found[latest >= 0] = commands[latest[latest >= 0], 1:]
    return found
