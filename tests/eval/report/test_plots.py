# SPDX-License-Identifier: MIT
"""Curves are drawn with few points and without loss."""

import numpy as np

from eval.report.plots import MAX_POINTS, thinned


def test_thinning_a_curve_keeps_its_spikes_both_ways_and_its_order():
    x = np.arange(100_000.0)
    y = np.sin(x / 1000.0)
    y[12_345], y[54_321], y[54_322] = 50.0, -50.0, 60.0
    thin_x, thin_y = thinned(x, y)
    assert len(thin_x) <= MAX_POINTS
    assert {50.0, -50.0, 60.0} <= set(thin_y)
    assert (np.diff(thin_x) > 0.0).all()
    np.testing.assert_array_equal(y[thin_x.astype(int)], thin_y)
