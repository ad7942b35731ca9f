# SPDX-License-Identifier: MIT
"""The messages of a topic with poses or commands, decoded some thousand at a time while a bag is read: a message takes
ten times the memory of what it says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from testbed.formats.ros.layouts import Encoding
from testbed.formats.ros.reading.content import RawMessage
from testbed.formats.ros.reading.decode import (
    NO_TRACK,
    BadMessageError,
    Deserialise,
    Track,
    decode_commands,
    decode_odometry,
    decode_truth,
    publishers,
    seconds,
)
from testbed.formats.ros.reading.transforms import ROBOT_FRAMES
from testbed.frame_table import Floats, Integers

BATCH = 4096
"""Messages that are decoded at a time: 3 MB of odometry."""
MAX_BAD_SHARE = 0.1
"""So many messages without a sound pose are left out; where there are more, the topic makes no sense."""
MAX_LOST_SHARE = 0.5
"""So many true poses may be none, as where a tracking system loses the robot; where there are more, they may be of a
camera."""
Pair = tuple[str, str]
"""Frame and child frame."""


class Batches:
    """Messages of one topic, of which `decode` makes something as soon as there are `BATCH`."""

    def __init__(self, decode: Callable[[list[RawMessage]], None]) -> None:
        self._decode = decode
        self._waiting: list[RawMessage] = []

    def take(self, message: RawMessage) -> None:
        """Take in a message."""
        self._waiting.append(message)
        if len(self._waiting) == BATCH:
            self.flush()

    def flush(self) -> None:
        """Decode what is waiting."""
        waiting, self._waiting = self._waiting, []
        if waiting:
            self._decode(waiting)


class OdometryColumns:
    """The Odometry messages of a topic."""

    def __init__(self, encoding: Encoding, deserialise: Deserialise) -> None:
        self._encoding, self._deserialise = encoding, deserialise
        self._batches = Batches(self._decode)
        self.take = self._batches.take
        self._parts: list[tuple[Pair, _Part]] = []
        self._faults: dict[Pair, list[BadMessageError]] = {}
        self._counts: Counter[Pair] = Counter()

    def finish(self, note: Callable[[str], None], topic: str) -> tuple[Floats, Track]:
        """The bag's times [s], (n,), and the poses of one pair of frames in the order of the bag: where several
        programs send to the topic, that of the robot's base, else the most frequent one.

        Messages whose pose is none in the plane are left out where they are few. Raises BadMessageError, with the
        number of the first one in the bag, where they are not.
        """
        self._batches.flush()
        pairs, named = set(self._counts), [pair for pair in self._counts if all(pair)]
        if len(named) > 1:
            chosen = max(named, key=lambda pair: (pair[0] == "odom" and pair[1] in ROBOT_FRAMES, self._counts[pair]))
            left_out = self._counts.total() - self._counts[chosen]
            note(f"{left_out} messages of {topic} are of other frames than {chosen[0]} to {chosen[1]}: left out")
            pairs = {chosen}
        faults = [fault for pair in pairs & self._faults.keys() for fault in self._faults[pair]]
        if faults:
            first = min(faults, key=lambda fault: fault.number)
            if len(faults) > MAX_BAD_SHARE * sum(self._counts[pair] for pair in pairs):
                raise first
            note(f"{len(faults)} messages of {topic} are left out: message {first.number}: {first}")
        kept = [part for pair, part in self._parts if pair in pairs]
        self._parts = []
        return _in_order(kept)

    def _decode(self, messages: list[RawMessage]) -> None:
        pairs = publishers([message.data for message in messages], self._encoding)
        by_pair: dict[Pair, list[RawMessage]] = {}
        for message, pair in zip(messages, pairs, strict=True):
            by_pair.setdefault(pair, []).append(message)
        for pair, of_pair in by_pair.items():
            self._counts[pair] += len(of_pair)
            try:
                self._decode_all(pair, of_pair)
            except BadMessageError:
                for message in of_pair:
                    try:
                        self._decode_all(pair, [message])
                    except BadMessageError as error:
                        self._faults.setdefault(pair, []).append(BadMessageError(message.number, str(error)))

    def _decode_all(self, pair: Pair, messages: list[RawMessage]) -> None:
        track = decode_odometry([message.data for message in messages], self._encoding, self._deserialise)
        self._parts.append((pair, _Part.of(messages, track)))


class PoseColumns:
    """True poses of messages of another kind than Odometry; of a nav_msgs/Path, which grows, the longest."""

    def __init__(self, kind: str, deserialise: Deserialise) -> None:
        self._kind, self._deserialise = kind, deserialise
        self._batches = Batches(self._decode)
        self._parts: list[_Part] = []
        self._longest: RawMessage | None = None
        self._count = 0
        self._faults: list[BadMessageError] = []

    def take(self, message: RawMessage) -> None:
        """Take in a message."""
        if not self._kind.endswith("/Path"):
            self._batches.take(message)
        elif self._longest is None or len(message.data) > len(self._longest.data):
            self._longest = message

    def finish(self, note: Callable[[str], None], topic: str) -> tuple[Floats | None, Track]:
        """The bag's times [s], (n,), None for the poses of a path, and the poses in the order of the bag.

        Poses that are none in the plane are left out where they are fewer than the others, as where a tracking system
        loses the robot. Raises BadMessageError, with the number of the first one from 0, where they are not.
        """
        if self._longest is not None:
            return None, decode_truth([self._longest.data], self._kind, self._deserialise)
        self._batches.flush()
        if self._faults:
            first = self._faults[0]
            if len(self._faults) > MAX_LOST_SHARE * self._count:
                raise first
            note(
                f"{len(self._faults)} of {self._count} poses of {topic} are left out: pose {first.number + 1}: {first}"
            )
        return _in_order(self._parts)

    def _decode(self, messages: list[RawMessage]) -> None:
        try:
            self._decode_all(messages)
        except BadMessageError:
            for number, message in enumerate(messages, start=self._count):
                try:
                    self._decode_all([message])
                except BadMessageError as error:
                    self._faults.append(BadMessageError(number, str(error)))
        self._count += len(messages)

    def _decode_all(self, messages: list[RawMessage]) -> None:
        track = decode_truth([message.data for message in messages], self._kind, self._deserialise)
        self._parts.append(_Part.of(messages, track))


class CommandColumns:
    """Twist and TwistStamped messages of a topic."""

    def __init__(self, encoding: Encoding, deserialise: Deserialise) -> None:
        self._encoding, self._deserialise = encoding, deserialise
        self._batches = Batches(self._decode)
        self.take = self._batches.take
        self._parts: list[Floats] = []
        self._fault: BadMessageError | None = None

    def finish(self) -> Floats:
        """Stamp [s], speed [m/s], turn rate [rad/s], (n, 3), in the order of the bag; BadMessageError, with the number
        of the message in the bag, for numbers that are not finite."""
        self._batches.flush()
        if self._fault is not None:
            raise self._fault
        return np.concatenate(self._parts) if self._parts else np.empty((0, 3))

    def _decode(self, messages: list[RawMessage]) -> None:
        data, times = [message.data for message in messages], [message.time for message in messages]
        try:
            self._parts.append(decode_commands(data, times, self._encoding, self._deserialise))
        except BadMessageError as error:
            self._fault = self._fault or BadMessageError(messages[error.number].number, str(error))


class _Part(NamedTuple):
    """What some messages say."""

    numbers: Integers
    """Of the messages in the bag, (n,)."""
    times: Floats
    """Of the bag [s], (n,)."""
    track: Track

    @classmethod
    def of(cls, messages: list[RawMessage], track: Track) -> _Part:
        numbers = np.array([message.number for message in messages])
        return cls(numbers, np.array([seconds(message.time) for message in messages]), track)


def _in_order(parts: list[_Part]) -> tuple[Floats, Track]:
    """Times [s], (n,), and poses of all parts in the order of the bag."""
    if not parts:
        return np.empty(0), NO_TRACK
    order = np.argsort(np.concatenate([part.numbers for part in parts]), kind="stable")
    tracks = [part.track for part in parts]
    child = next((track.child_frame for track in tracks if track.child_frame), "")
    stamps, poses, twists = (
        np.concatenate([getattr(track, name) for track in tracks])[order] for name in ("stamps", "poses", "twists")
    )
    track = Track(stamps, poses, twists, tracks[0].frame, child)
    return np.concatenate([part.times for part in parts])[order], track
