# SPDX-License-Identifier: MIT
"""What the lidars of a robot see, as a recording of them shows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from eval.map.lidar_view import LidarView
from slam.scan import Scan
from testbed.frame import Frame


def lidar_views(frames: Iterable[Frame]) -> tuple[LidarView, ...]:
    """One view for each lidar that took a scan with a beam, in the order in which they appear."""
    scans: dict[str, list[Scan]] = defaultdict(list)
    for frame in frames:
        if frame.scan is not None and len(frame.scan.angles):
            scans[frame.lidar].append(frame.scan)
    return tuple(LidarView.of(taken) for taken in scans.values())
