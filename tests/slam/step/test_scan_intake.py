# SPDX-License-Identifier: MIT
"""Which twists undo the motion within a scan."""

import numpy as np
import pytest

from slam.config import FilterConfig
from slam.scan import Scan
from slam.step.scan_intake import ScanIntake


def hits(twist):
    angles = np.linspace(-1.0, 1.0, 50)
    scan = Scan(ranges=np.full(50, 4.0), angles=angles, range_max=20.0, time_offsets=np.linspace(0.0, 0.05, 50))
    taken = ScanIntake(FilterConfig(), first_needs_hits=True).take(np.zeros(3), scan, twist)
    return taken.rays.ends


@pytest.mark.parametrize("twist", [(0.5, 0.0, 51.0), (0.5, 0.0, -13.0), (11.0, 0.0, 0.0), (0.0, -11.0, 0.0)])
def test_a_twist_that_no_robot_makes_turns_no_scan(twist):
    """As wheels report that slip within a scan: at 51 rad/s the last beam would be turned by 146 degrees."""
    np.testing.assert_array_equal(hits(twist), hits(None))


@pytest.mark.parametrize("twist", [(0.5, 0.0, 12.0), (9.0, 0.0, 0.0)])
def test_a_fast_robot_is_believed(twist):
    assert np.abs(hits(twist) - hits(None)).max() > 0.1
