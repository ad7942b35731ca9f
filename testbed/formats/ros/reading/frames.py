# SPDX-License-Identifier: MIT
"""Put odometry, scans, commands and truth of a bag together to frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from testbed.formats.log import Log, LogError
from testbed.formats.pose_interpolation import ODOMETRY_REACH, interpolate
from testbed.formats.ros.reading.content import BagContent
from testbed.formats.ros.reading.decode import Track
from testbed.formats.ros.reading.raw_scans import RawScans
from testbed.formats.ros.reading.repairs import bridged, with_sound_twists
from testbed.formats.ros.reading.scans import ScanColumns, of_level_lidars, one_topic_per_lidar, sound_scans
from testbed.formats.ros.reading.stale_poses import with_fresh_poses
from testbed.frame_table import FrameTable

MAX_GAP, GAP_PERIODS = 1.0, 3.0
"""Scans between two odometry messages that are further apart than this [s], and than some usual periods, are noted."""
MAX_TRUTH_GAP = 0.5
"""Between true poses that are further apart than this [s], and than some usual periods, the truth is unknown."""
MIN_MESSAGES = 5
"""Of fewer messages of odometry nothing is said."""
MAX_PERIOD = 0.5
"""Odometry that usually comes more rarely than this [s] loses the turns between two messages."""


def assemble(path: Path, content: BagContent, range_max: float | None) -> Log:
    """Make a log of what was read of a bag; notes say which topics were used and which scans were left out.

    range_max [m] overrides what the scans say. Raises LogError where the clocks of scans and odometry do not meet, or
    where several topics have scans of one lidar.
    """
    track, stale = with_fresh_poses(content.odometry.in_time())
    track, odd_twists = with_sound_twists(track)
    try:
        track, jumps = bridged(track)
    except ValueError as error:
        raise LogError(f"{path}: {content.topics['odometry']}: {error}") from None
    content.notes += [*stale, *odd_twists, *jumps]
    first, last = track.stamps[0], track.stamps[-1]
    scans, repeated = one_topic_per_lidar(path, content)
    scans = sound_scans(path, content, of_level_lidars(content, scans), range_max)
    if len(scans) and not len(_reachable(scans, track)):
        scans = _by_clock_of_bag(content, scans)
    reachable = _reachable(scans, track)
    if len(scans) and not len(reachable):
        raise LogError(
            f"{path}: the clocks of scans and odometry do not meet, nor by the bag's own times: scans from "
            f"{scans.stamps[0]:.3f} to {scans.stamps[-1]:.3f} s, odometry from {first:.3f} to {last:.3f} s"
        )
    chosen = " and ".join(topic for topic in content.scans if topic not in repeated) or "nowhere"
    notes = [f"scans from {chosen}, odometry from {content.topics['odometry']}"]
    if len(reachable) < len(scans):
        outside = len(scans) - len(reachable)
        notes.append(f"{outside} of {len(scans)} scans lie outside of the odometry's time and are left out")
    content.notes += _gap_notes(track, reachable)
    if left_out := [*(f"{topic} (the same lidar)" for topic in repeated), *content.others]:
        notes.append(f"topics left out: {', '.join(left_out[:8])}{' and others' if left_out[8:] else ''}")
    table = _table(path, content, track, reachable, range_max)
    return Log(
        path=path,
        format="ROS bag",
        table=table,
        notes=(*notes, *content.notes),
        repairs=tuple(content.notes),
        topics=tuple(content.all_topics),
        truth_map=content.truth_map,
        robot_urdf=content.robot_urdf,
    )


def _reachable(scans: RawScans, track: Track) -> RawScans:
    """The scans within the time of the odometry; they are in the order of time."""
    first, last = track.stamps[0] - ODOMETRY_REACH, track.stamps[-1] + ODOMETRY_REACH
    begin = int(np.searchsorted(scans.stamps, first, side="left"))
    return scans.chosen(slice(begin, int(np.searchsorted(scans.stamps, last, side="right"))))


def _by_clock_of_bag(content: BagContent, scans: RawScans) -> RawScans:
    """Scans whose clock is another than that of the odometry, such as the time since the lidar was switched on: both
    are related by the times at which the bag recorded them."""
    shift = content.scan_clock_offset - content.clock_offset
    content.notes.append(
        f"stamps of scans are by another clock, {-shift:+.1f} s from that of the odometry: related by the bag's own "
        "times; --time-offset auto refines that"
    )
    return scans.at(scans.stamps + shift)


def _gap_notes(track: Track, scans: RawScans) -> list[str]:
    """Notes on scans for whose time there is no odometry near by."""
    if len(track.stamps) < MIN_MESSAGES or not len(scans):
        return []
    spans = np.diff(track.stamps)
    if (period := float(np.median(spans))) > MAX_PERIOD:
        return [f"odometry comes every {period:.1f} s only: poses are interpolated, turns between them are lost"]
    after = np.clip(np.searchsorted(track.stamps, scans.stamps), 1, len(spans))
    around = spans[after - 1]
    far = around > max(MAX_GAP, GAP_PERIODS * float(np.median(spans)))
    if not far.any():
        return []
    return [
        f"{far.sum()} of {len(scans)} scans lie in gaps of the odometry of up to {around.max():.1f} s: their poses are "
        "interpolated"
    ]


def _table(path: Path, content: BagContent, track: Track, scans: RawScans, range_max: float | None) -> FrameTable:
    """A frame for each scan, and one for each odometry message at whose stamp there is no scan."""
    stamps = scans.stamps
    alone = ~np.isin(track.stamps, stamps)
    at = np.clip(np.searchsorted(track.stamps, stamps), 0, len(track.stamps) - 1)
    all_stamps = np.concatenate([track.stamps[alone], stamps])
    order = np.argsort(all_stamps, kind="stable")
    twists = np.concatenate([track.twists[alone], track.twists[at]])[order]
    twists[~np.isfinite(twists).all(axis=1)] = np.nan
    all_stamps, seen = all_stamps[order], ScanColumns(path, content, scans, range_max)
    rows = np.empty(len(order), dtype=np.int64)
    rows[order] = np.arange(len(order))
    return FrameTable(
        stamps=all_stamps,
        odometry=np.concatenate([track.poses[alone], interpolate(track.stamps, track.poses, stamps)])[order],
        twist=twists,
        command=_latest(content.commands, all_stamps),
        truth=_truth_at(content, all_stamps),
        scan_rows=rows[int(alone.sum()) :],
        scan_lidars=seen.lidar_of,
        scan_patterns=seen.pattern_of,
        scan_starts=np.concatenate([[0], np.cumsum(scans.sizes)]),
        ranges=scans.ranges(),
        range_limits=seen.limits,
        mounts=seen.mounts,
        lidars=tuple(seen.lidars),
        patterns=tuple(seen.patterns),
    )


def _truth_at(content: BagContent, stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """The true poses (n, 3) where their topic covers the stamps (n,), NaN elsewhere and in its gaps, with a note."""
    found, track = np.full((len(stamps), 3), np.nan), content.truth.in_time()
    if not len(track.stamps):
        return found
    covered = (track.stamps[0] - 1e-9 <= stamps) & (stamps <= track.stamps[-1] + 1e-9)
    if len(track.stamps) > 1:
        spans = np.diff(track.stamps)
        gaps = spans > max(MAX_TRUTH_GAP, GAP_PERIODS * float(np.median(spans)))
        if gaps.any():
            content.notes.append(f"the truth is unknown in {gaps.sum()} of its gaps, of up to {spans.max():.1f} s")
        after = np.clip(np.searchsorted(track.stamps, stamps), 1, len(spans))
        at_an_end = np.minimum(np.abs(stamps - track.stamps[after - 1]), np.abs(stamps - track.stamps[after])) < 1e-9
        covered &= at_an_end | ~gaps[after - 1]
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
