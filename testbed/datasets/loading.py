# SPDX-License-Identifier: MIT
"""One dataset, or any recording, as arrays, as frames, and as a pandas table."""

from __future__ import annotations

import shlex
import sys
import tomllib
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slam.occupancy import OccupancyGrid
from testbed.datasets.index import datasets_in
from testbed.formats import Log, LogError, open_log
from testbed.formats.checksums import CONFIG
from testbed.frame import Frame
from testbed.frame_table import FrameTable

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]


class Dataset:
    """A recording with its truth; made by `open_dataset`. The file is read when its content is first asked for.

    The arrays are aligned: row k of `stamps`, `scans`, `odometry`, `truth` and `twist` belongs to the k-th scan of one
    lidar. `table` and iteration have all frames, also those between scans, which hold odometry only (20 Hz).
    """

    def __init__(
        self, path: str | Path, *, lidar: str | None = None, start: float = -np.inf, end: float = np.inf
    ) -> None:
        self.path = Path(path)
        self._lidar, self._start, self._end = lidar, start, end

    @property
    def name(self) -> str:
        """Name of the directory or file."""
        return self.path.resolve().name

    @cached_property
    def config(self) -> dict[str, Any]:
        """Content of config.toml: settings, drive, versions, check sums; empty where there is none."""
        file = self.path / CONFIG
        return tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the simulator: world, seed, robot, lidar, noise and so on."""
        return dict(self.config.get("settings", {}))

    @cached_property
    def log(self) -> Log:
        """The whole recording; LogError where it cannot be read."""
        return open_log(self.path, scans_needed=False)

    @cached_property
    def table(self) -> FrameTable:
        """All frames as arrays, or those between the times given to `between`."""
        whole = self.log.table
        if np.isneginf(self._start) and np.isposinf(self._end):
            return whole
        if (np.diff(whole.stamps) < 0.0).any():
            raise LogError(f"{self.path}: the stamps step backwards, so that no time can be cut out")
        begin, end = np.searchsorted(whole.stamps, [self._start, self._end]).tolist()
        return whole.rows(begin, end)

    @property
    def lidars(self) -> tuple[str, ...]:
        """Names of the lidars, the one with the most scans first."""
        counts = np.bincount(self.log.table.scan_lidars, minlength=len(self.log.table.lidars))
        return tuple(self.log.table.lidars[k] for k in np.argsort(-counts, kind="stable").tolist())

    @property
    def lidar(self) -> str:
        """The lidar whose scans `scans` holds."""
        if self._lidar is None:
            if not self.lidars:
                raise LogError(f"{self.path}: no scans")
            return self.lidars[0]
        if self._lidar not in self.lidars:
            raise ValueError(f"{self.path}: no lidar {self._lidar!r}, expected one of {', '.join(self.lidars)}")
        return self._lidar

    @cached_property
    def scans(self) -> Floats:
        """Ranges of each scan [m], (n, beams): inf = no return, NaN = lost, or no beam where the count varies."""
        table, numbers = self.table, self._numbers
        counts = table.readings[numbers]
        width = int(counts.max(initial=0))
        starts = table.scan_starts[numbers]
        if (counts == width).all():
            return np.asarray(table.ranges[starts[:, None] + np.arange(width)], dtype=np.float64)
        filled = np.full((len(numbers), width), np.nan)
        beam = np.arange(width)
        there = beam < counts[:, None]
        filled[there] = table.ranges[(starts[:, None] + beam)[there]]
        return filled

    @cached_property
    def angles(self) -> Floats:
        """Direction of each beam in the lidar's frame [rad], counter-clockwise, (n, beams); NaN where is no beam."""
        patterns = self.table.patterns
        return self._by_pattern([pattern.angles for pattern in patterns])

    @cached_property
    def time_offsets(self) -> Floats:
        """Time of each beam after the scan's stamp [s], (n, beams); NaN where it is unknown."""
        patterns = self.table.patterns
        times = (p.time_offsets if p.time_offsets is not None else np.full(p.angles.size, np.nan) for p in patterns)
        return self._by_pattern(list(times))

    @property
    def stamps(self) -> Floats:
        """Time of each scan's first beam [s], (n,)."""
        return self.table.stamps[self._rows]

    @property
    def odometry(self) -> Floats:
        """Pose by wheel odometry at each scan, `T_odom_robot` [m, m, rad], (n, 3)."""
        return self.table.odometry[self._rows]

    @property
    def truth(self) -> Floats:
        """True pose at each scan, `T_world_robot` [m, m, rad], (n, 3); NaN where unknown."""
        return self.table.truth[self._rows]

    @property
    def twist(self) -> Floats:
        """Velocity by odometry while each scan was taken [m/s, m/s, rad/s], (n, 3); NaN where unknown."""
        return self.table.twist[self._rows]

    @property
    def command(self) -> Floats:
        """Commanded speed and turn rate at each scan [m/s, rad/s], (n, 2); NaN where unknown."""
        return self.table.command[self._rows]

    @property
    def mount(self) -> tuple[float, float, float]:
        """`T_robot_lidar` of the lidar [m, m, rad]."""
        x, y, theta = self.table.mounts[self._numbers[0]].tolist()
        return x, y, theta

    @property
    def range_limits(self) -> tuple[float, float]:
        """`range_min`, `range_max` [m]: a reading r is a hit where range_min <= r < range_max."""
        low, high = self.table.range_limits[self._numbers[0]].tolist()
        return low, high

    @property
    def truth_map(self) -> OccupancyGrid | None:
        """The true map; None where it is unknown."""
        from eval.files.map_server import read_map

        file = self.path / "truth_map.yaml"
        return read_map(file, inside=True) if file.is_file() else self.log.truth_map

    def between(self, start: float, end: float) -> Dataset:
        """The frames from `start` to before `end` [s]; stamps stay as they are."""
        part = Dataset(self.path, lidar=self._lidar, start=max(start, self._start), end=min(end, self._end))
        if "log" in self.__dict__:
            part.__dict__["log"] = self.log  # read once
        return part

    def of_lidar(self, lidar: str) -> Dataset:
        """The same with the scans of another lidar."""
        other = Dataset(self.path, lidar=lidar, start=self._start, end=self._end)
        if "log" in self.__dict__:
            other.__dict__["log"] = self.log
        return other

    def __iter__(self) -> Iterator[Frame]:
        """All frames, one after the other, as an estimator takes them."""
        for block in self.table.blocks():
            yield from block.frames()

    def __len__(self) -> int:
        """Number of scans."""
        return len(self._numbers)

    def to_pandas(self) -> pd.DataFrame:
        """All frames as a table, a row a frame; columns as docs/formats.md lists them for `parquet`.

        Raises ImportError, with the command that installs it, where pandas is missing.
        """
        from testbed.formats.parquet import arrow_table

        require_pandas()
        frame: pd.DataFrame = arrow_table(self.table).to_pandas()
        return frame

    def __repr__(self) -> str:
        if "log" not in self.__dict__:
            drive, named = self.config.get("drive", {}), [self.settings.get(key) for key in ("world", "robot", "lidar")]
            known = [str(value) for value in named if value]
            known += [f"{drive['seconds']} s"] if "seconds" in drive else []
            return f"<Dataset {self.name!r}: {', '.join([*known, 'not read yet'])}>"
        lidar = f"{len(self)} scans of {self.scans.shape[1]} beams ({self.lidar})" if self.lidars else "no scans"
        span = float(np.ptp(self.table.stamps)) if len(self.table) else 0.0
        return f"<Dataset {self.name!r}: {lidar}, {len(self.table)} frames, {span:.1f} s>"

    @cached_property
    def _numbers(self) -> NDArray[np.int64]:
        """Which scans of the table are those of the lidar."""
        chosen = self.table.lidars.index(self.lidar)
        return np.flatnonzero(self.table.scan_lidars == chosen)

    @property
    def _rows(self) -> NDArray[np.int64]:
        return self.table.scan_rows[self._numbers]

    def _by_pattern(self, values: list[Floats]) -> Floats:
        """Values of the beam patterns at each scan, (n, beams)."""
        width = self.scans.shape[1]
        padded = np.full((len(values), width), np.nan)
        for number, row in enumerate(values):
            padded[number, : min(row.size, width)] = row[:width]
        found: Floats = padded[self.table.scan_patterns[self._numbers]]
        return found


def open_dataset(path: str | Path, *, lidar: str | None = None) -> Dataset:
    """Open a dataset that `testbed simulate` wrote, or any recording that `testbed slam` reads.

    lidar: name of the lidar whose scans the arrays hold; default: the one with the most scans
    Raises LogError where there is nothing at `path`, or a collection; other errors come when the content is first read.
    """
    path = Path(path)
    if not path.exists():
        raise LogError(f"{path}: no such file or directory")
    if not (path / CONFIG).is_file() and (there := datasets_in(path)):
        count = f"{len(there)} dataset{'' if len(there) == 1 else 's'}"
        raise LogError(f"{path}: holds {count}; name one, such as {there[0]}, or in Python use open_collection")
    return Dataset(path, lidar=lidar)


def require_pandas() -> None:
    """Raise ImportError, with the command that installs it, where this Python has no pandas."""
    try:
        import pandas  # noqa: F401
    except ImportError:
        command = f"{shlex.quote(sys.executable)} -m pip install pandas"
        raise ImportError(f"to_pandas needs pandas, which this Python does not have: {command}") from None
