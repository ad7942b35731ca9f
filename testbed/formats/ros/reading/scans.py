# SPDX-License-Identifier: MIT
"""The scans of a bag: one topic for each lidar, and the columns of a frame table that describe them."""

from __future__ import annotations

import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from testbed.formats.log import LogError
from testbed.formats.ros.reading.content import BagContent
from testbed.formats.ros.reading.namespaces import choices
from testbed.formats.ros.reading.raw_scans import Head, RawScans, ScanRecorder, in_order_of_time
from testbed.formats.ros.reading.repairs import Fan, sound_beats
from testbed.formats.ros.reading.topics import usual_topic
from testbed.formats.ros.reading.transforms import LeaningLidarError
from testbed.frame_table import BeamPattern, Floats, Integers

MAX_BAD_SHARE = 0.1
"""So many scans that make no sense are left out; where there are more, all of them are doubtful."""
MIN_RANGE = 0.01
"""No lidar measures nearer [m]: such readings are a driver's way to say "nothing", as 0 is."""
MAX_BEATS, SWEEP_STEP = 100, 1e-5
"""Drivers that measure the time of each turn state another one for each scan. Of more than so many, the times of turns
are rounded to so much [s], a tenth of a millimetre at 10 m/s: else each scan would have beam times of its own."""


class ScanColumns:
    """Lidars, beam patterns, limits and mounts of scans; LogError, with the place, where they make no sense."""

    def __init__(self, path: Path, content: BagContent, scans: RawScans, range_max: float | None) -> None:
        self._path, self._content = path, content
        self.lidars: dict[str, int] = {}
        self.patterns: list[BeamPattern] = []
        self._angles: dict[tuple[Any, ...], Floats] = {}
        kinds, first, kind_of = np.unique(
            np.column_stack([scans.heads, scans.sizes]), axis=0, return_index=True, return_inverse=True
        )
        kind_of = kind_of.reshape(-1)
        lidars, limits, mounts = np.zeros(len(kinds), np.int64), np.empty((len(kinds), 2)), np.empty((len(kinds), 3))
        known_mounts: dict[str, tuple[tuple[float, float, float], bool]] = {}
        fans: list[tuple[Fan, bool]] = [(Fan(0.0, 0.0, 0.0, 0), False)] * len(kinds)
        for kind in np.argsort(first).tolist():
            row = int(first[kind])
            head = self._in_radians(self._with_limits(scans.head(row), range_max), int(scans.sizes[row]))
            place = scans.place(row)
            if head.frame_id not in known_mounts:
                known_mounts[head.frame_id] = self._mount(head, place)
            mounts[kind], upside_down = known_mounts[head.frame_id]
            fans[kind] = _fan(head, int(scans.sizes[row])), upside_down
            self._note_fan(fans[kind][0])
            lidars[kind] = self.lidars.setdefault(head.frame_id, len(self.lidars))
            limits[kind] = head.range_min, head.range_max
        self.lidar_of, self.limits, self.mounts = lidars[kind_of], limits[kind_of], mounts[kind_of]
        self.pattern_of = self._make_patterns(fans, kind_of, self._sound_beats(scans))

    def _make_patterns(self, fans: list[tuple[Fan, bool]], kind_of: Integers, beats: Floats) -> Integers:
        """Fill the patterns of all scans, numbered as they come first; the number of each scan's, (n,).

        fans: angles of each kind, and whether the lidar hangs upside down; kind_of, beats [s] of each scan, (n,)
        """
        keys, first, key_of = np.unique(
            np.column_stack([kind_of.astype(np.float64), beats]), axis=0, return_index=True, return_inverse=True
        )
        numbers = np.empty(len(keys), dtype=np.int64)
        known: dict[tuple[Any, ...], int] = {}
        for row in np.argsort(first).tolist():
            fan, upside_down = fans[int(keys[row, 0])]
            beat = float(keys[row, 1])
            shape = fan.angle_min, fan.increment, fan.readings, upside_down
            numbers[row] = known.setdefault((shape, beat), len(self.patterns))
            if numbers[row] == len(self.patterns):
                if shape not in self._angles:
                    self._angles[shape] = _angles(*shape)
                times = beat * np.arange(fan.readings, dtype=np.float64) if beat != 0.0 else None
                self.patterns.append(BeamPattern(angles=self._angles[shape], time_offsets=times))
        pattern_of: Integers = numbers[key_of.reshape(-1)]
        return pattern_of

    def _in_radians(self, head: Head, readings: int) -> Head:
        """The same with angles in radians, with a note where they were in degrees."""
        if not _fan(head, readings).is_in_degrees:
            return head
        if not any("in degrees" in other for other in self._content.notes):
            numbers = f"{head.angle_min:g} to {head.angle_max:g}"
            self._content.notes.append(f"the angles of the scans are in degrees ({numbers}): read as such")
        fan = _fan(head, readings).in_radians()
        return head._replace(angle_min=fan.angle_min, angle_max=fan.angle_max, angle_increment=fan.increment)

    def _sound_beats(self, scans: RawScans) -> Floats:
        """Time between two beams of each scan [s], (n,); 0, with a note, where the stated one cannot be true."""
        beats = scans.beats
        sound = sound_beats(beats, scans.sizes)
        if not sound.all():
            row = int(np.argmin(sound))
            self._content.notes.append(
                f"time_increment {beats[row]:g} s makes a scan of {beats[row] * scans.sizes[row]:g} s: it is ignored, "
                "the beams of a scan count as taken at once"
            )
        beats = np.where(sound, beats, 0.0)
        if len(np.unique(beats)) <= MAX_BEATS:
            return beats
        sizes = np.maximum(scans.sizes, 1)
        return np.round(beats * sizes / SWEEP_STEP) * SWEEP_STEP / sizes

    def _with_limits(self, head: Head, range_max: float | None) -> Head:
        """The same with a range_min of at least `MIN_RANGE`, taken as 0 with a note where it is none, and the range_max
        that the user gave."""
        least = head.range_min
        if not least >= 0.0:
            least = 0.0
            if not any("range_min is" in other for other in self._content.notes):
                self._content.notes.append(f"range_min is {head.range_min:g}: taken as 0")
        most = head.range_max if range_max is None else range_max
        return head._replace(range_min=max(least, MIN_RANGE), range_max=most)

    def _note_fan(self, fan: Fan) -> None:
        note = fan.check()
        if note is not None and not any("angle_max is" in other for other in self._content.notes):
            self._content.notes.append(note)

    def _mount(self, head: Head, place: str) -> tuple[tuple[float, float, float], bool]:
        content, robot = self._content, self._content.odometry.child_frame
        if content.laser_offset is not None:
            content.notes.append(f"{head.frame_id} {content.laser_offset:+g} m along x (as given)")
            return (content.laser_offset, 0.0, 0.0), False
        if head.frame_id in content.level_mounts:
            return content.level_mounts[head.frame_id], False
        try:
            mount = content.transforms.mount(robot, head.frame_id)
        except ValueError as error:
            advice = choices([robot, head.frame_id])
            raise LogError(
                f"{self._path}: {place}: {error}{advice}; --laser-offset X says where the lidar sits"
            ) from None
        if not content.transforms.leads(robot, head.frame_id):
            content.notes.append(
                f"no transform says where {head.frame_id} is mounted: it is taken to sit at the robot's centre, ahead; "
                "--laser-offset X says otherwise"
            )
        return mount


def _fan(head: Head, readings: int) -> Fan:
    return Fan(head.angle_min, head.angle_max, head.angle_increment, readings)


def _angles(first: float, step: float, count: int, upside_down: bool) -> Floats:
    """Directions of beams in the lidar's frame [rad], (count,)."""
    angles = first + step * np.arange(count, dtype=np.float64)
    return -angles if upside_down else angles


def sound_scans(path: Path, content: BagContent, scans: RawScans, range_max: float | None) -> RawScans:
    """The scans without those whose angles or limits make no sense, with a note, where they are few: drivers send such
    when they start. range_max [m] overrides what the scans say.

    Raises LogError, naming the first one, where there are more, and where no scan has a reading.
    """
    if len(scans) and not scans.sizes.any():
        raise LogError(f"{path}: all {len(scans)} scans are empty: they have no ranges")
    kinds, first, kind_of = np.unique(
        np.column_stack([scans.heads, scans.sizes]), axis=0, return_index=True, return_inverse=True
    )
    faults = [
        _fault_of(scans.head(row), size, range_max) for row, size in zip(first, kinds[:, 1].tolist(), strict=True)
    ]
    bad = np.array([fault is not None for fault in faults], dtype=bool)[kind_of.reshape(-1)]
    if not bad.any():
        return scans
    row = int(np.argmax(bad))
    fault = f"{scans.place(row)}: {faults[kind_of.reshape(-1)[row]]}"
    if bad.sum() > MAX_BAD_SHARE * len(scans):
        raise LogError(f"{path}: {fault}")
    content.notes.append(f"{bad.sum()} of {len(scans)} scans are left out: {fault}")
    return scans.chosen(~bad)


def _fault_of(head: Head, readings: int, range_max: float | None) -> str | None:
    """Why the angles or limits of a scan make no sense; None where they do."""
    if not (math.isfinite(head.angle_min) and math.isfinite(head.angle_increment)):
        return f"angles must be finite, got angle_min {head.angle_min} and angle_increment {head.angle_increment}"
    most = head.range_max if range_max is None else range_max
    if head.range_min >= most or not most > 0.0:
        return f"expected 0 <= range_min < range_max, got {head.range_min} and {most}"
    fan = _fan(head, readings)
    try:
        (fan.in_radians() if fan.is_in_degrees else fan).check()
    except ValueError as error:
        return str(error)
    return None


def of_level_lidars(content: BagContent, scans: RawScans) -> RawScans:
    """The scans without those of lidars that lean, with a note, if others remain: many robots carry one that looks down
    or up."""
    if content.laser_offset is not None or content.selection.heights is not None:
        return scans
    faults = {}
    for name in scans.frames:
        try:
            content.transforms.mount(content.odometry.child_frame, name)
        except LeaningLidarError as error:
            faults[name] = str(error)
        except ValueError:
            continue  # no chain of transforms, or a circle: reported where its mount is needed
    if len(faults) == len(scans.frames):
        return scans
    kept = np.ones(len(scans), dtype=bool)
    for name, fault in sorted(faults.items()):
        leaning = scans.in_frame(name)
        kept &= ~leaning
        content.notes.append(f"{leaning.sum()} scans of {name} are left out: {fault}")
    return scans if kept.all() else scans.chosen(kept)


def one_topic_per_lidar(path: Path, content: BagContent) -> tuple[RawScans, list[str]]:
    """The scans of all lidars in the order of time, and the topics that are left out: scans with the same frame are
    the same lidar's, once more or processed somehow."""
    by_lidar: defaultdict[str, list[str]] = defaultdict(list)
    for topic, scans in content.scans.items():
        for name in sorted(scans.frames):
            by_lidar[name].append(topic)
    chosen = set()
    for topics in by_lidar.values():
        usual = usual_topic(topics, "/scan")
        if usual is None:
            several = f"several topics with scans of one lidar, none is /scan: {', '.join(topics)}"
            raise LogError(f"{path}: {several}; --topics NAME says which")
        chosen.add(usual)
    kept = [content.scans[topic] for topic in sorted(chosen)] or [ScanRecorder(content.scan_store).finish()]
    return in_order_of_time(kept), [topic for topic in content.scans if topic not in chosen]
