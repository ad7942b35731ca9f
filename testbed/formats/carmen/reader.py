# SPDX-License-Identifier: MIT
"""CARMEN logs, read: text, one message a line, metres and radians, plain or gzip.

Source: the header that CARMEN's logger writes into each log (carmen.sourceforge.net/logger_playback.html) and, for
`ROBOTLASER1`, what the logger writes in fact: the counted remissions after the ranges and `turn_axis` at the end.

    ODOM x y theta tv rv accel  ipc_time host logger_time
    FLASER n r_1 … r_n  laser_x laser_y laser_theta  odom_x odom_y odom_theta  ipc_time host logger_time
    RLASER … the same of the rear laser
    ROBOTLASER1 type start fov step range_max accuracy remission_mode  n r_1 … r_n  m s_1 … s_m
        laser_x laser_y laser_theta  robot_x robot_y robot_theta  tv rv forward_safety side_safety turn_axis
        ipc_time host logger_time
    ROBOTLASER2 … the same of the rear laser
    RAWLASER1 … n r_1 … r_n  m s_1 … s_m  ipc_time host logger_time   as ROBOTLASER1, without poses; to RAWLASER5
    TRUEPOS true_x true_y true_theta  odom_x odom_y odom_theta  ipc_time host logger_time
    PARAM name value …
"""

from __future__ import annotations

import gzip
import hashlib
import math
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.scan import MAX_MOUNT, Scan
from slam.se2 import Pose
from testbed.formats.log import Log, LogError
from testbed.formats.pose_interpolation import ODOMETRY_REACH, interpolate
from testbed.formats.stamps import NANOSECONDS_NOTE, StampUnit
from testbed.frame import Frame
from testbed.frame_table import FrameTable
from testbed.large_arrays import ReadingsStore

RAW = {"RAWLASER1": "laser", "RAWLASER2": "rear_laser", **{f"RAWLASER{k}": f"laser_{k}" for k in (3, 4, 5)}}
"""Messages with scans without a pose, and the name of the lidar that took them."""
LIDARS = {"FLASER": "laser", "RLASER": "rear_laser", "ROBOTLASER1": "laser", "ROBOTLASER2": "rear_laser", **RAW}
"""Messages with scans, and the name of the lidar that took them."""
MESSAGES = (*LIDARS, "ODOM", "PARAM", "TRUEPOS")
"""Messages that are read; all others are counted and skipped."""
SEALED = "# CARMEN Logfile; metres, radians, seconds; the last line holds the SHA-256 of all above it"
"""First line of logs that this package has written: text has no check sum of its own."""
SEAL = "# SHA-256 "
"""How their last line begins."""
UNSEAL = "delete the lines that name SHA-256 if that was meant"
"""Advice for people who edit a log."""
MAX_LINE = 1_000_000
"""Characters: a scan of some 100 000 beams. What is longer is no CARMEN log."""
MAX_MEDIAN_RANGE = 100.0
"""Metres; readings with a larger median are in another unit."""

# An FLASER line holds no angles: the number of beams tells the device (first beam and step in degrees, right to left).
# SICK LMS 180 deg and 100 deg modes; Hokuyo URG-04LX, steps 44 to 725 of 1024 a turn, 384 being forward.
FLASER_LAYOUTS = {
    180: (-90.0, 1.0),
    181: (-90.0, 1.0),
    360: (-90.0, 0.5),
    361: (-90.0, 0.5),
    101: (-50.0, 1.0),
    201: (-50.0, 0.5),
    401: (-50.0, 0.25),
    682: (-340 * 360 / 1024, 360 / 1024),
}

FRONT, REAR = "robot_frontlaser_offset", "robot_rearlaser_offset"
OFFSETS = {"FLASER": FRONT, "RLASER": REAR, "RAWLASER1": FRONT, "RAWLASER2": REAR}
"""Parameters with the x of a laser [m]. The rear one faces backwards."""
MAXIMA = {"FLASER": "robot_front_laser_max", "RLASER": "robot_rear_laser_max"}
"""Parameters with the range from which on there is no return [m]."""

BLOCK_SCANS = 4096
"""Scans whose readings are counted at a time."""
END = 0.05
"""The far end of the readings: this share of the largest one."""
MIN_REPEATS = 10
"""Readings without a return are at least so many, and so many times as frequent as others near them."""
NEXT_VALUE = 0.015
"""Readings [m] that differ by less are neighbours: logs hold centimetres."""

_OFFSET_IN_COMMENT = re.compile(r"robot_frontlaser_offset\s+(-?[0-9]*\.?[0-9]+)")


def read_carmen(path: str | Path, *, laser_offset: float | None = None, range_max: float | None = None) -> Log:
    """Read a CARMEN log, plain or gzip; frames come in the order of the file. A log of odometry alone has no scans.

    laser_offset  x of the front laser in the robot's frame [m]; None: what the log says (`PARAM
                  robot_frontlaser_offset`, a comment of that name, or the two poses of a `ROBOTLASER1` line), else 0
    range_max     readings from here on are no returns [m]; None: what the log says (`ROBOTLASER1`, `PARAM
                  robot_front_laser_max`), else the no-return value found in the readings, see `no_return_from`
    Odometry of a frame is the robot's (`odom_*`, `robot_*`); stamps are the ipc clock. `TRUEPOS` becomes the truth of
    the next frame with its stamp. Scans without a pose (`RAWLASER1`) get that of `ODOM`, interpolated, unless others of
    their lidar have one. Raises LogError, naming file and line, for anything that does not fit the format.
    """
    path = Path(path)
    content = _Content()
    for number, line in _lines(path):
        try:
            _take(line, content)
        except ValueError as error:
            if line.endswith("\n") or not content.messages:
                raise LogError(f"{path}:{number}: {error}") from None
            content.cut_note = f"line {number}, the last one, ends early and is left out: {error}"
    return _assemble(path, content, laser_offset, range_max)


def no_return_from(ranges: NDArray[np.float64]) -> float | None:
    """The reading from which on a log writes that a beam did not return, or None; ranges (n,) [m].

    Such readings are a cluster at the far end of the histogram: often one value, sometimes a few near each other (error
    codes of the lidar, or one value in several units). It begins with the lowest value in the last `END` of the range
    that is 10 times as frequent as any value in the stretch of that length before, and with the frequent ones next to
    it. Real walls spread over many values; where several values hold most of all readings, they are a wall.
    """
    return _no_return_from(*_value_counts([ranges]))


def _no_return_from(values: NDArray[np.float64], counts: NDArray[np.int64]) -> float | None:
    """As `no_return_from`, of the distinct readings (k,), increasing, and how often each is there."""
    if values.size == 0:
        return None
    end = values > (1.0 - END) * values[-1]
    before = (values > (1.0 - 2.0 * END) * values[-1]) & ~end
    usual = counts[before].max(initial=1)
    frequent = np.flatnonzero(end & (counts >= MIN_REPEATS * usual))
    if frequent.size == 0 or (frequent.size > 1 and 2 * counts[end].sum() > counts.sum()):
        return None
    first = int(frequent[0])
    while first > 0 and values[first] - values[first - 1] <= NEXT_VALUE and counts[first - 1] > usual:
        first -= 1
    return float(values[first])


def _value_counts(parts: list[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The distinct finite readings of scans, increasing, and how often each is there; a block of scans at a time."""
    values, counts = np.empty(0), np.empty(0, dtype=np.int64)
    for begin in range(0, len(parts), BLOCK_SCANS):
        block = np.concatenate(parts[begin : begin + BLOCK_SCANS])
        more, often = np.unique(block[np.isfinite(block)], return_counts=True)
        values, where = np.unique(np.concatenate([values, more]), return_inverse=True)
        counts = np.bincount(where, weights=np.concatenate([counts, often]), minlength=len(values)).astype(np.int64)
    return values, counts


def _median(values: NDArray[np.float64], counts: NDArray[np.int64]) -> float:
    """The median of readings that are there so often; 0 where there are none."""
    return float(values[np.searchsorted(np.cumsum(counts), 0.5 * counts.sum())]) if len(values) else 0.0


UNKNOWN = np.full(3, np.nan)
"""The odometry of a message that does not say it."""


@dataclass
class _Message:
    """One line with odometry, and perhaps a scan, before the log's own settings are known."""

    kind: str
    stamp: float
    odometry: Pose
    twist: Pose | None = None
    truth: Pose | None = None
    ranges: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None
    range_max: float | None = None
    mount: tuple[float, float, float] | None = None


@dataclass
class _Content:
    messages: list[_Message] = field(default_factory=list)
    parameters: dict[str, float] = field(default_factory=dict)
    truth: tuple[float, Pose] | None = None
    counts: Counter[str] = field(default_factory=Counter)
    unit: StampUnit = field(default_factory=StampUnit)
    cut_note: str = ""
    """What is missing of the last line, for the user."""
    readings: ReadingsStore = field(default_factory=lambda: ReadingsStore(kind=np.float64))
    """Where the readings of scans are kept."""


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines; characters that are not ASCII become U+FFFD, which no number contains."""
    number, digest, sealed, verified = 0, hashlib.sha256(), False, False
    try:
        with path.open("rb") as raw:
            packed = raw.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if packed else path.open("rb") as stream:
            while line := stream.readline(MAX_LINE):
                number += 1
                if len(line) == MAX_LINE:
                    raise LogError(f"{path}:{number}: line longer than {MAX_LINE} characters: not a CARMEN log")
                sealed = sealed or (number == 1 and line.rstrip() == SEALED.encode())
                if line.startswith(SEAL.encode()):
                    verified = line.split()[-1] == digest.hexdigest().encode()
                    if not verified:
                        raise LogError(f"{path}:{number}: something above has changed since it was written; {UNSEAL}")
                else:
                    digest.update(line)
                yield number, line.decode("ascii", errors="replace")
        if sealed and not verified:
            raise LogError(f"{path}:{number}: the log ends early, without its SHA-256; {UNSEAL}")
    except EOFError:
        raise LogError(f"{path}:{number + 1}: the gzip file ends early: it was truncated") from None
    except (gzip.BadGzipFile, zlib.error) as error:
        raise LogError(f"{path}:{number + 1}: damaged gzip file ({error})") from None
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from None


def _take(line: str, content: _Content) -> None:
    """Add one line to the content; ValueError, without the place, where it does not fit the format."""
    if line.lstrip().startswith("#"):
        if match := _OFFSET_IN_COMMENT.search(line):
            content.parameters.setdefault("robot_frontlaser_offset", float(match[1]))
        return
    kind, *texts = line.split(maxsplit=1)[:2] or [""]
    if not kind:
        return
    rest = texts[0].split() if texts and kind not in LIDARS else texts
    content.counts[kind] += 1
    if kind == "PARAM":
        _take_parameter(rest, content)
    elif kind == "TRUEPOS":
        _expect(kind, rest, 9)
        content.truth = (content.unit.seconds(_stamp(rest[6])), _pose("true", rest[0:3]))
    elif kind == "ODOM" or kind in LIDARS:
        message = _odom(rest) if kind == "ODOM" else _scan(kind, "".join(texts))
        message.stamp = content.unit.seconds(message.stamp)
        if message.ranges is not None:
            message.ranges = content.readings.keep(message.ranges)
        if content.truth is not None and content.truth[0] == message.stamp:
            message.truth = content.truth[1]
        content.messages.append(message)


def _take_parameter(rest: list[str], content: _Content) -> None:
    if len(rest) >= 2 and rest[0] in (*OFFSETS.values(), *MAXIMA.values()):
        value = _number(rest[0], rest[1])
        if not math.isfinite(value):
            raise ValueError(f"PARAM {rest[0]} must be finite, got {rest[1]}")
        content.parameters[rest[0]] = value


def _odom(rest: list[str]) -> _Message:
    _expect("ODOM", rest, 9)
    tv, rv = _number("tv", rest[3]), _number("rv", rest[4])
    return _Message("ODOM", _stamp(rest[6]), _pose("odometry", rest[0:3]), twist=_twist(tv, rv))


def _scan(kind: str, text: str) -> _Message:
    """A message with a scan; text: its line behind the kind."""
    return _flaser(kind, text) if kind in MAXIMA else _robotlaser(kind, text)


def _flaser(kind: str, text: str) -> _Message:
    ranges, rest = _ranges(kind, text)
    _expect(f"{kind} with {ranges.size} beams", rest, 9, after="after its ranges")
    if ranges.size not in FLASER_LAYOUTS:
        known = ", ".join(str(n) for n in sorted(FLASER_LAYOUTS))
        raise ValueError(
            f"{kind} with {ranges.size} beams: it holds no angles, and they are known for {known} beams only"
        )
    first, step = FLASER_LAYOUTS[ranges.size]
    angles = _even_angles(first, step, ranges.size, degrees=True)
    _pose("laser", rest[0:3])
    return _Message(kind, _stamp(rest[6]), _pose("odometry", rest[3:6]), ranges=ranges, angles=angles)


def _robotlaser(kind: str, text: str) -> _Message:
    rest = text.split(maxsplit=7)
    if len(rest) < 8:
        raise ValueError(f"{kind} ends after {len(rest)} values")
    start, step, range_max = (
        _number(name, rest[i]) for name, i in (("start_angle", 1), ("angular_resolution", 3), ("maximum_range", 4))
    )
    if not (math.isfinite(start) and math.isfinite(step) and range_max > 0):
        raise ValueError(f"{kind} needs finite angles and a positive maximum_range, got {' '.join(rest[1:5])}")
    ranges, rest = _ranges(kind, rest[7])
    view = abs(step) * max(ranges.size - 2, 0)  # some count a beam more than there are
    if view > 2.0 * math.pi + 1e-3 or (step == 0.0 and ranges.size > 1):
        raise ValueError(
            f"{kind}: an angular_resolution of {step:g} rad and {ranges.size} beams make a view of {view:g} rad: "
            "expected up to a turn, in radians"
        )
    _, rest = _counted(kind, "remission", rest)
    _expect(f"{kind} with {ranges.size} beams", rest, 3 if kind in RAW else 14, after="after its remissions")
    message = _Message(
        kind,
        _stamp(rest[-3]),
        UNKNOWN,
        ranges=ranges,
        angles=_even_angles(start, step, ranges.size),
        range_max=range_max,
    )
    return message if kind in RAW else _with_poses(message, rest)


@lru_cache(maxsize=64)
def _even_angles(first: float, step: float, count: int, *, degrees: bool = False) -> NDArray[np.float64]:
    """Evenly spaced angles (count,) [rad], one array for all scans that have them."""
    angles: NDArray[np.float64] = first + step * np.arange(count, dtype=np.float64)
    return np.deg2rad(angles) if degrees else angles


def _with_poses(message: _Message, rest: list[str]) -> _Message:
    """The message with what follows the remissions: poses of laser and robot, velocities."""
    laser, robot = _pose("laser", rest[0:3]), _pose("robot", rest[3:6])
    x, y, theta = se2.between(robot, laser)
    if not max(abs(x), abs(y)) <= MAX_MOUNT:
        raise ValueError(f"{message.kind}: laser {x:g}, {y:g} m from the robot, expected within {MAX_MOUNT:g} m")
    return replace(
        message,
        odometry=robot,
        twist=_twist(_number("tv", rest[6]), _number("rv", rest[7])),
        mount=(round(float(x), 10), round(float(y), 10), round(float(theta), 10)),  # without what the two poses lose
    )


def _ranges(kind: str, text: str) -> tuple[NDArray[np.float64], list[str]]:
    """The ranges at the front of a text, which begins with their number, and what follows them."""
    import pyarrow as pa
    import pyarrow.compute as pc

    words = text.split(maxsplit=1)
    if len(words) == 2 and words[0].isdecimal():
        texts = pc.ascii_split_whitespace(pa.array([words[1].rstrip()])).values  # three times as fast as float()
        count = int(words[0])
        if count <= len(texts):
            try:
                numbers = texts[:count].cast(pa.float64()).to_numpy()
                return numbers, texts[count:].to_pylist()
            except pa.ArrowInvalid:
                pass  # the slow way says what is wrong
    return _counted(kind, "beam", text.split())


def _counted(kind: str, what: str, rest: list[str]) -> tuple[NDArray[np.float64], list[str]]:
    """A count and that many numbers from the front of `rest`, and what follows them."""
    if not rest or not rest[0].isdecimal():
        raise ValueError(f"{kind}: expected the number of {what}s, got {rest[0] if rest else 'the end of the line'!r}")
    count = int(rest[0])
    if len(rest) - 1 < count:
        raise ValueError(f"{kind} announces {count} {what}s, but only {len(rest) - 1} values follow")
    return _numbers(what, rest[1 : count + 1]), rest[count + 1 :]


def _numbers(what: str, texts: list[str]) -> NDArray[np.float64]:
    """Many numbers (n,); ValueError that shows the first that is none."""
    try:
        if "_" not in "".join(texts):  # float() takes 1_0 for 10
            return np.fromiter(map(float, texts), np.float64, len(texts))
    except ValueError:
        pass
    return np.array([_number(what, text) for text in texts])


def _expect(what: str, rest: list[str], count: int, after: str = "") -> None:
    if len(rest) != count:
        raise ValueError(f"{what}: expected {count} values{' ' + after if after else ''}, got {len(rest)}")


def _number(name: str, text: str) -> float:
    try:
        if "_" in text:  # float() takes 1_0 for 10
            raise ValueError
        return float(text)
    except ValueError:
        raise ValueError(f"{name}: expected a number, got {text[:40]!r}") from None


def _stamp(text: str) -> float:
    stamp = _number("ipc time", text)
    if not math.isfinite(stamp):
        raise ValueError(f"ipc time must be finite, got {text}")
    return stamp


def _pose(name: str, texts: list[str]) -> Pose:
    pose = _numbers(f"{name} pose", texts)
    if not all(map(math.isfinite, pose.tolist())):
        raise ValueError(f"{name} pose must be finite, got {' '.join(texts)}")
    return pose


def _twist(tv: float, rv: float) -> Pose | None:
    return np.array([tv, 0.0, rv]) if math.isfinite(tv) and math.isfinite(rv) else None


def _assemble(path: Path, content: _Content, laser_offset: float | None, range_max: float | None) -> Log:
    """Frames, now that the whole file has been seen; the notes say what was found out."""
    pose_notes = _give_poses(path, content)
    typical = _median(*_value_counts([m.ranges for m in content.messages if m.ranges is not None]))
    if typical > MAX_MEDIAN_RANGE:
        raise LogError(
            f"{path}: the median reading is {typical:g}: expected metres, are these centimetres or millimetres?"
        )
    no_returns, range_notes = _resolve_no_returns(content, range_max)
    offsets, offset_note = _resolve_offsets(content, laser_offset)
    if far := [offset for offset in offsets.values() if not abs(offset) <= MAX_MOUNT]:
        raise LogError(f"{path}: laser {far[0]:g} m along x from the robot, expected within {MAX_MOUNT:g} m")
    skipped = [f"{count} {kind[:20]}" for kind, count in content.counts.most_common() if kind not in MESSAGES]
    skipped_note = (
        f"messages left out: {', '.join(skipped[:8])}{' and others' if skipped[8:] else ''}" if skipped else ""
    )
    cut = content.cut_note
    unit_note = NANOSECONDS_NOTE if content.unit.is_nanoseconds else ""
    table = FrameTable.from_frames([_frame(message, offsets, no_returns) for message in content.messages])
    content.readings.forget()
    return Log(
        table=table,
        path=path,
        format="CARMEN log",
        notes=tuple(note for note in (*pose_notes, *range_notes, offset_note, skipped_note, unit_note, cut) if note),
    )


def _give_poses(path: Path, content: _Content) -> list[str]:
    """Give scans without a pose that of the `ODOM` messages, and leave those out that come with a pose, too; notes."""
    posed = {LIDARS[m.kind] for m in content.messages if m.kind in LIDARS and m.kind not in RAW}
    raw = [m for m in content.messages if m.kind in RAW]
    if not raw:
        return []
    notes = []
    if twice := [m for m in raw if LIDARS[m.kind] in posed]:
        kinds = " and ".join(sorted({m.kind for m in twice}))
        notes.append(f"{len(twice)} scans of {kinds} are left out: the log has those of this laser with a pose, too")
    alone = [m for m in raw if LIDARS[m.kind] not in posed]
    odometry = [m for m in content.messages if m.kind == "ODOM"]
    if alone and not odometry:
        raise LogError(
            f"{path}: {alone[0].kind} messages have no pose, and there are no ODOM messages to give them one"
        )
    outside: list[_Message] = []
    if alone:
        stamps, rows = np.unique([m.stamp for m in odometry], return_index=True)
        poses = np.array([odometry[row].odometry for row in rows.tolist()])
        found = interpolate(stamps, poses, np.array([m.stamp for m in alone]))
        for message, pose in zip(alone, found, strict=True):
            message.odometry = pose
            message.twist = odometry[rows[max(int(np.searchsorted(stamps, message.stamp, side="right")) - 1, 0)]].twist
        first, last = stamps[0] - ODOMETRY_REACH, stamps[-1] + ODOMETRY_REACH
        outside = [m for m in alone if not first <= m.stamp <= last]
        notes.append("scans without a pose (RAWLASER) have that of the ODOM messages, interpolated")
    if outside:
        notes.append(f"{len(outside)} of {len(alone)} scans lie outside of the odometry's time and are left out")
    left_out = {id(m) for m in (*twice, *outside)}
    content.messages = [m for m in content.messages if id(m) not in left_out]
    return notes


def _resolve_no_returns(content: _Content, given: float | None) -> tuple[dict[str, float], list[str]]:
    """The range from which on there is no return [m], by kind of message that does not hold it itself; and notes."""
    kinds = sorted({m.kind for m in content.messages if m.ranges is not None})
    if given is not None:
        return dict.fromkeys(kinds, given), [f"no return from {given:g} m on (as given)"]
    found, notes = {}, []
    for kind in kinds:
        if kind in MAXIMA:
            ranges = [m.ranges for m in content.messages if m.kind == kind and m.ranges is not None]
            found[kind], note = _no_return_of(content.parameters.get(MAXIMA[kind]), MAXIMA[kind], ranges)
            notes.append(f"{kind}: {note}" if len(kinds) > 1 else note)
    return found, notes


def _no_return_of(logged: float | None, name: str, ranges: list[NDArray[np.float64]]) -> tuple[float, str]:
    """The range from which on there is no return in the scans of one lidar [m], and the note about it."""
    if logged is not None:
        return logged, f"no return from {logged:g} m on (PARAM {name})"
    values, counts = _value_counts(ranges)
    found = _no_return_from(values, counts)
    if found is None:
        return math.inf, 'no value for "no return" stands out: all readings count as hits'
    top = float(values[-1])
    written = f"{found:g} m" if found == top else f"{found:g} to {top:g} m"
    share = counts[values >= found].sum() / sum(part.size for part in ranges)
    return found, f"no return is written as {written} ({share:.1%} of the readings)"


def _resolve_offsets(content: _Content, given: float | None) -> tuple[dict[str, float], str]:
    """x of the lasers [m], by the kind of message, as far as the messages do not say so themselves; the note."""
    front, rear = content.parameters.get(FRONT), content.parameters.get(REAR) or 0.0
    offsets, ahead = {"RLASER": rear, "RAWLASER2": rear}, ("FLASER", "ROBOTLASER1", "RAWLASER1")
    if given is not None:
        return offsets | dict.fromkeys(ahead, given), f"laser {given:+g} m along x (as given)"
    if front is not None:
        return offsets | dict.fromkeys(ahead, front), f"laser {front:+g} m along x (robot_frontlaser_offset in the log)"
    return offsets, ""


def _frame(message: _Message, offsets: dict[str, float], no_returns: dict[str, float]) -> Frame:
    scan = None
    if message.ranges is not None and message.angles is not None:
        mount = message.mount or (0.0, 0.0, 0.0)
        if message.kind in offsets:
            mount = (offsets[message.kind], 0.0, math.pi if OFFSETS.get(message.kind) == REAR else 0.0)
        own_max = message.range_max if message.range_max is not None else math.inf
        scan = Scan(
            ranges=message.ranges,
            angles=message.angles,
            range_max=no_returns.get(message.kind, own_max),
            stamp=message.stamp,
            mount=mount,
        )
    return Frame(
        stamp=message.stamp,
        odometry=message.odometry,
        scan=scan,
        lidar=LIDARS.get(message.kind, Frame.lidar),
        twist=message.twist,
        truth=message.truth,
    )
