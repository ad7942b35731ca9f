# SPDX-License-Identifier: MIT
"""What the odometry errs by throughout a recording: wheels larger than stated, or wider apart, or unequal.

Such errors do not average out as those of a random walk do: where scans do not say how far the robot has come (a long
corridor, a hall), the path would be wrong by them. So three numbers are estimated with the poses, as Censi, Franchi,
Marchionni and Oriolo (T-RO 2013) calibrate wheels and lidar together: the motion that is meant is

    (1 + c_0) (dx, dy),   dtheta + c_1 dtheta' + c_2 dx.

The turn dtheta' is not the one that was counted but the one that odometry without other errors would have counted, by
the poses as estimated so far. Between frames that follow each other fast, a counted turn is mostly its own error while
the robot drives straight on. A factor on it would come out such that it takes these errors away: too small by as large
a share as they have in the sum of the squared turns (errors in variables; Fuller, "Measurement Error Models", 1987,
section 1.1), 3 to 6 % where the robot hardly turns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.motion.odometry_model import MotionPrior
from slam.refinement._chain_kernels import add_calibration

SIGMA = np.array([0.05, 0.05, 0.05])
"""Standard deviations of the three numbers before any data: a wheel that is 5 % too large; 0.05 rad/m."""


class CalibrationEquations(NamedTuple):
    """How the numbers take part in the equations of the poses."""

    coupling: NDArray[np.float64]
    """Blocks between poses and numbers, (frames, 3, 3)."""
    precision: NDArray[np.float64]
    """Block of the numbers themselves, (3, 3)."""
    gradient: NDArray[np.float64]
    """(3,)."""

    def taken_from_poses(self) -> NDArray[np.float64]:
        """C K^-1/2 (frames, 3, 3), whose product with its transpose is what the numbers take from the equations of the
        poses."""
        root = np.linalg.inv(np.linalg.cholesky(self.precision))
        taken: NDArray[np.float64] = np.einsum("nij,kj->nik", self.coupling, root)
        return taken


class OdometryCalibration:
    """The three numbers, as estimated so far."""

    def __init__(self, motions: se2.Pose) -> None:
        """motions (frames - 1, 3): displacements as measured."""
        self.measured = motions
        self.values = np.zeros(3)
        self.basis = basis_of(motions)

    def follow(self, poses: se2.Pose) -> None:
        """From now on the factor on turns is one on those of poses (frames, 3)."""
        turns = se2.wrap_angle(np.diff(poses[:, 2])) - self.values[2] * self.measured[:, 0]
        self.basis[:, 2, 1] = turns / (1.0 + self.values[1])

    def motions(self) -> se2.Pose:
        """The displacements that are meant, (frames - 1, 3)."""
        meant: se2.Pose = self.measured + np.einsum("nij,j->ni", self.basis, self.values)
        return meant

    def equations(self, prior: MotionPrior, poses: se2.Pose) -> CalibrationEquations:
        """Their equations at poses (frames, 3); prior: of all steps, arrays (frames - 1, ...)."""
        coupling, precision = np.zeros((len(poses), 3, 3)), np.diag(SIGMA**-2)
        gradient = SIGMA**-2 * self.values
        add_calibration(prior, poses, self.motions(), self.basis, coupling, precision, gradient)
        return CalibrationEquations(coupling, precision, gradient)

    def move(self, change: NDArray[np.float64]) -> None:
        """Change the numbers by (3,)."""
        self.values = self.values + change


def basis_of(motions: se2.Pose) -> NDArray[np.float64]:
    """Derivatives of displacements (steps, 3) by the three numbers, (steps, 3, 3)."""
    basis = np.zeros((*motions.shape, 3))
    basis[:, :2, 0] = motions[:, :2]
    basis[:, 2, 1] = motions[:, 2]
    basis[:, 2, 2] = motions[:, 0]
    return basis
