# SPDX-License-Identifier: MIT
"""What each reading of a scan counts as."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slam import FilterConfig, GMapping, Scan


@pytest.mark.parametrize(
    ("reading", "kind"),
    [
        (1.0, "hit"),
        (0.1, "hit"),
        (math.nextafter(10.0, 0.0), "hit"),
        (10.0, "no return"),
        (81.91, "no return"),
        (math.inf, "no return"),
        (0.0999, "invalid"),
        (0.0, "invalid"),
        (-0.0, "invalid"),
        (-1.0, "invalid"),
        (-math.inf, "invalid"),
        (math.nan, "invalid"),
    ],
)
def test_readings(reading, kind):
    scan = Scan(ranges=np.array([reading]), angles=np.zeros(1), range_min=0.1, range_max=10.0)
    assert (scan.hit[0], scan.no_return[0]) == (kind == "hit", kind == "no return")


def test_zero_is_invalid_without_a_smallest_range_too():
    assert not Scan(ranges=np.zeros(1), angles=np.zeros(1), range_max=10.0).hit.any()


@given(st.lists(st.floats(), max_size=20), st.floats(0.0, 5.0), st.floats(1e-3, 100.0))
@settings(deadline=None)
def test_no_reading_is_a_hit_and_a_no_return(readings, low, width):
    high = low + width
    scan = Scan(ranges=np.array(readings), angles=np.zeros(len(readings)), range_min=low, range_max=high)
    assert not np.any(scan.hit & scan.no_return)
    valid = scan.ranges[scan.hit]
    assert np.all(np.isfinite(valid))
    assert np.all((valid > 0.0) & (valid >= low) & (valid < high))


def test_a_lidar_without_largest_range_knows_infinity_as_no_return():
    scan = Scan(ranges=np.array([1e6, np.inf]), angles=np.zeros(2), range_max=math.inf)
    assert scan.hit.tolist() == [True, False]
    assert scan.no_return.tolist() == [False, True]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"angles": np.zeros(2)}, r"\(3,\) and \(2,\)"),
        ({"ranges": np.zeros((3, 1)), "angles": np.zeros((3, 1))}, r"\(3, 1\)"),
        ({"time_offsets": np.zeros(4)}, r"time_offsets .* \(4,\)"),
        ({"mount": (0.0, math.nan, 0.0)}, "mount must be finite"),
        ({"range_max": math.nan}, "expected 0 <= range_min < range_max, got 0.0 m and nan m"),
        ({"range_min": math.nan}, "expected 0 <= range_min < range_max"),
        ({"range_min": 2.0}, "expected 0 <= range_min < range_max, got 2.0 m and 1.0 m"),
        ({"range_min": -0.1}, "expected 0 <= range_min < range_max"),
    ],
)
def test_what_does_not_fit_together_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        Scan(**({"ranges": np.zeros(3), "angles": np.zeros(3), "range_max": 1.0} | change))


def test_no_scan_at_all_is_refused_by_name():
    mapper = GMapping(FilterConfig(particles=2), threads=1)
    with pytest.raises(ValueError, match=r"^expected at least one scan, got none$"):
        mapper.process(np.zeros(3), [])
    assert mapper.scans == 0


def test_lists_in_the_place_of_arrays_are_refused_by_name():
    with pytest.raises(TypeError, match=r"^angles must be a numpy array \(beams,\), got list$"):
        Scan(ranges=np.ones(2), angles=[0.0, 1.0], range_max=10.0)


@pytest.mark.parametrize("given", [np.ones(3), [np.ones(3)]])
def test_ranges_in_the_place_of_a_scan_are_refused_by_name(given):
    mapper = GMapping(FilterConfig(particles=2), threads=1)
    with pytest.raises(TypeError, match=r"^scan must be a slam.Scan, or several of them, got (ndarray|list)$"):
        mapper.process(np.zeros(3), given)
    assert mapper.scans == 0
