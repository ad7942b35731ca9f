# SPDX-License-Identifier: MIT
"""Stamped poses of an estimator, a simulator or a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam.se2 import Pose


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """Stamped poses in the order in which they were recorded; the arrays are read-only copies.

    Stamps may repeat and step backwards, as in real logs (Intel: 629 steps back); functions sort them where they must.
    Raises ValueError for shapes that do not fit, an empty trajectory, and NaN or infinite values (naming the row).
    """

    stamps: NDArray[np.float64]
    """Times [s], (n,)."""
    poses: Pose
    """`(x, y, theta)` [m, m, rad], (n, 3)."""

    def __post_init__(self) -> None:
        stamps = np.array(self.stamps, dtype=np.float64)
        poses = np.array(self.poses, dtype=np.float64)
        if stamps.ndim != 1 or poses.shape != (len(stamps), 3):
            raise ValueError(f"a trajectory takes stamps (n,) and poses (n, 3), got {stamps.shape} and {poses.shape}")
        if len(stamps) == 0:
            raise ValueError("a trajectory takes at least one pose, got none")
        bad = np.flatnonzero(~(np.isfinite(stamps) & np.isfinite(poses).all(axis=1)))
        if len(bad):
            raise ValueError(
                f"a trajectory takes finite numbers, got stamp {stamps[bad[0]]}, pose {poses[bad[0]]} in row {bad[0]}"
            )
        for array, name in ((stamps, "stamps"), (poses, "poses")):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.stamps)

    def __repr__(self) -> str:
        """One line, for notebooks."""
        return f"<Trajectory: {len(self)} poses, {self.duration:.1f} s, {self.distance[-1]:.2f} m>"

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp] | Sequence[int]) -> Trajectory:
        """Return the trajectory of some rows, in the given order."""
        return Trajectory(self.stamps[rows], self.poses[rows])

    @property
    def distance(self) -> NDArray[np.float64]:
        """Distance travelled up to each pose [m], (n,), in recorded order."""
        return travelled(self.poses)

    @property
    def duration(self) -> float:
        """Time between the earliest and the latest stamp [s]."""
        return float(np.ptp(self.stamps))


def travelled(poses: ArrayLike) -> NDArray[np.float64]:
    """Return the distance travelled up to each of the poses (n, 3) [m], (n,): the sum of straight steps."""
    positions = np.asarray(poses, dtype=np.float64)[:, :2]
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])
