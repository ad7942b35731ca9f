# SPDX-License-Identifier: MIT
"""How a recording is to be read, where it does not say so itself, or says it wrongly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from testbed.formats import Log, open_log
from testbed.inspect.mount_correction import parse_mount_correction, with_mount_correction
from testbed.inspect.own_body import without_own_body
from testbed.inspect.segments import with_segments_apart
from testbed.inspect.sweeps import with_beam_times
from testbed.inspect.time_offset import parse_time_offset, without_time_offset


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What overrides a recording, as the command line and `config.toml` name it."""

    laser_offset: float | None = None
    """x of the laser in the robot's frame [m]; default: stated by the log."""
    range_max: float | None = None
    """Readings of at least this range are no returns [m]; default: stated or shown by the log."""
    time_offset: str | None = None
    """Seconds by which the stamps of scans are too late compared with odometry; they are subtracted from the scans'
    stamps (`testbed score --time-offset` is added to those of a trajectory). auto: estimate the offset and correct it
    if it is significant. Default: 0; a note is printed if an offset is found."""
    mount_correction: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """X,Y,DEG: the lidar sits this much further ahead [m], left [m] and turned left [deg] than the log says."""
    slice: str | None = None
    """LOW,HIGH: scans are made from the points of clouds (PointCloud2) between these heights above the robot's frame
    [m]."""

    namespace: str | None = None
    """For a bag with several robots: the prefix of the topics and frames to read, such as robot1."""
    topics: str | None = None
    """For a bag with several topics of one type: the topics to read, such as /front/scan,/odom_raw."""

    def __post_init__(self) -> None:
        if self.time_offset is not None:
            parse_time_offset(self.time_offset)
        if self.mount_correction is not None:
            parse_mount_correction(self.mount_correction)
        self._heights()

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Reading:
        """Return the part of the settings of a run that says how its log was read."""
        return cls(**{field.name: settings.get(field.name) for field in fields(cls)})

    def open(self, path: Path, *, scans_needed: bool = True) -> Log:
        """Read a log, see `open_log`."""
        log = open_log(
            path,
            laser_offset=self.laser_offset,
            range_max=self.range_max,
            heights=self._heights(),
            namespace=None if self.namespace is None else self.namespace.strip("/"),
            topics=() if self.topics is None else tuple(name.strip() for name in self.topics.split(",")),
            scans_needed=scans_needed,
        )
        log = without_own_body(with_beam_times(with_segments_apart(log)))
        if self.mount_correction is not None:
            log = with_mount_correction(log, parse_mount_correction(self.mount_correction))
        if self.time_offset is None or not log.scan_count:
            return log
        return without_time_offset(log, parse_time_offset(self.time_offset))

    def _heights(self) -> tuple[float, float] | None:
        if self.slice is None:
            return None
        try:
            low, high = map(float, self.slice.split(","))
        except ValueError:
            low = high = 0.0
        if not low < high:
            raise ValueError(f"--slice {self.slice}: expected two heights, LOW,HIGH, such as 0.1,0.5")
        return low, high


AS_STATED = Reading()
