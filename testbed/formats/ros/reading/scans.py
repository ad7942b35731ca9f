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
from testbed.formats.ros.reading.decode import RawScan
from testbed.formats.ros.reading.repairs import Fan, sound_beat
from testbed.formats.ros.reading.topics import usual_topic
from testbed.frame_table import BeamPattern


class ScanColumns:
    """Lidars, beam patterns, limits and mounts of scans; LogError, with the place, where they make no sense."""

    def __init__(self, path: Path, content: BagContent, scans: list[RawScan], range_max: float | None) -> None:
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
        for stated in scans:
            scan = self._in_radians(stated)
            self._check(scan)
            if scan.frame_id not in mounts:
                mounts[scan.frame_id] = self._mount(scan)
            mount, upside_down = mounts[scan.frame_id]
            fan = Fan(scan.angle_min, scan.angle_max, scan.angle_increment, scan.ranges.size)
            if fan not in checked:
                self._check_fan(scan, fan)
                checked.add(fan)
            beat = self._sound_beat(scan)
            key = scan.angle_min, scan.angle_increment, beat, scan.ranges.size, upside_down
            number = known.setdefault(key, len(self.patterns))
            if number == len(self.patterns):
                self.patterns.append(_pattern(*key))
            self.pattern_of.append(number)
            self.lidar_of.append(self.lidars.setdefault(scan.frame_id, len(self.lidars)))
            self.limits.append((scan.range_min, scan.range_max if range_max is None else range_max))
            self.mounts.append(mount)

    def _in_radians(self, scan: RawScan) -> RawScan:
        """The scan with angles in radians, with a note where they were in degrees."""
        if not Fan(scan.angle_min, scan.angle_max, scan.angle_increment, scan.ranges.size).is_in_degrees:
            return scan
        if not any("in degrees" in other for other in self._content.notes):
            numbers = f"{scan.angle_min:g} to {scan.angle_max:g}"
            self._content.notes.append(f"the angles of the scans are in degrees ({numbers}): read as such")
        return scan._replace(
            angle_min=math.radians(scan.angle_min),
            angle_max=math.radians(scan.angle_max),
            angle_increment=math.radians(scan.angle_increment),
        )

    def _check(self, scan: RawScan) -> None:
        if not (math.isfinite(scan.angle_min) and math.isfinite(scan.angle_increment)):
            numbers = f"angle_min {scan.angle_min} and angle_increment {scan.angle_increment}"
            raise LogError(f"{self._place(scan)}: angles must be finite, got {numbers}")
        if not scan.range_max > scan.range_min >= 0.0:
            limits = f"{scan.range_min} and {scan.range_max}"
            raise LogError(f"{self._place(scan)}: expected 0 <= range_min < range_max, got {limits}")

    def _sound_beat(self, scan: RawScan) -> float:
        """Time between two beams [s]; 0, with a note, where the stated one cannot be true."""
        beat, count = scan.time_increment, scan.ranges.size
        if sound_beat(beat, count):
            return beat
        if not any("time_increment" in other for other in self._content.notes):
            self._content.notes.append(
                f"time_increment {beat:g} s makes a scan of {beat * count:g} s: it is ignored, the beams of a scan "
                "count as taken at once"
            )
        return 0.0

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
        if scan.frame_id in content.level_mounts:
            return content.level_mounts[scan.frame_id], False
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
        return f"{self._path}: {scan.place}"


def _pattern(first: float, step: float, between: float, count: int, upside_down: bool) -> BeamPattern:
    beams = np.arange(count, dtype=np.float64)
    angles = first + step * beams
    return BeamPattern(
        angles=-angles if upside_down else angles, time_offsets=between * beams if between != 0.0 else None
    )


def of_level_lidars(content: BagContent, scans: list[RawScan]) -> list[RawScan]:
    """The scans without those of lidars that lean, with a note, if others remain: many robots carry one that looks down
    or up."""
    if content.laser_offset is not None or content.heights is not None:
        return scans
    faults = {}
    for name in {scan.frame_id for scan in scans}:
        try:
            content.transforms.mount(content.odometry.child_frame, name)
        except ValueError as error:
            if "leans" in str(error):
                faults[name] = str(error)
    kept = [scan for scan in scans if scan.frame_id not in faults]
    if not kept:
        return scans
    for name, fault in sorted(faults.items()):
        count = sum(scan.frame_id == name for scan in scans)
        content.notes.append(f"{count} scans of {name} are left out: {fault}")
    return kept


def one_topic_per_lidar(path: Path, content: BagContent) -> tuple[list[RawScan], list[str]]:
    """The scans of all lidars in the order of time, and the topics that are left out: scans with the same frame are
    the same lidar's, once more or processed somehow."""
    by_lidar: defaultdict[str, list[str]] = defaultdict(list)
    for topic, scans in content.scans.items():
        for name in sorted({scan.frame_id for scan in scans}):
            by_lidar[name].append(topic)
    chosen = set()
    for topics in by_lidar.values():
        usual = usual_topic(topics, "/scan")
        if usual is None:
            raise LogError(f"{path}: several topics with scans of one lidar, none is /scan: {', '.join(topics)}")
        chosen.add(usual)
    kept = [scan for topic in sorted(chosen) for scan in content.scans[topic]]
    return sorted(kept, key=lambda scan: scan.stamp), [topic for topic in content.scans if topic not in chosen]
