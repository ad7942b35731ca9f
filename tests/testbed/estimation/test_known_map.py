# SPDX-License-Identifier: MIT
"""Localisation of simulated robots in the true map and of a recorded one in its own map; what is said of the result."""

import dataclasses
import os
import re
from pathlib import Path

import numpy as np
import pytest

from eval.files.map_server import write_map
from eval.map.grids import grid_from_true_map
from slam import se2
from slam.config import FilterConfig, LocalizationConfig
from slam.localization import Localization
from testbed.estimation.estimation import Estimation
from testbed.estimation.known_map import KnownMap, failure_reason, localization_metrics, parse_start
from testbed.formats import open_log
from testbed.seeds import RunSeeds
from testbed.simulation import SimulationConfig, simulate
from worlds import load, true_map

DATASETS = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).parents[4] / "shared" / "datasets"))
SETTINGS = LocalizationConfig()


def grid_of(world):
    return grid_from_true_map(true_map(load(world)))


def frames_of(world, seed, *, begin=0.0, end=20.0):
    """Frames of a drive from `begin` to `end` [s]."""
    with simulate(
        load(world), SimulationConfig(backend="fast", seeds=RunSeeds.from_seed(seed), duration=end)
    ) as simulation:
        return [frame for frame in simulation if frame.stamp >= begin]


def localized(frames, known, seed=0):
    """Metrics of a localisation."""
    estimation = Estimation(FilterConfig(), seed, known_map=known)
    for frame in frames:
        estimation.process(frame)
    estimate = estimation.filtered()
    truth = estimation.trajectory_at_scans("truth")
    return localization_metrics(known, estimation.mapper.status, frames, estimate.at_scans, truth), estimation


def known_map(world, start=None):
    return KnownMap(grid=grid_of(world), start=start, settings=SETTINGS, has_frame_of_truth=True)


@pytest.mark.parametrize("seed", range(2))
def test_a_given_start_is_tracked_to_three_centimetres(seed):
    frames = frames_of("office", seed, end=12.0)
    error = np.random.default_rng(seed).normal(scale=(0.2, 0.2, 0.1))
    metrics, estimation = localized(frames, known_map("office", frames[0].truth + error), seed)
    assert (metrics["start"], metrics["state"], metrics["losses"]) == ("given", "found", 0)
    assert metrics["error_median_m"] < 0.03
    assert metrics["error_max_m"] < 0.10
    assert failure_reason(metrics) is None
    columns = estimation.steps.columns()
    miss = np.hypot(columns["x"] - columns["true_x"], columns["y"] - columns["true_y"])
    np.testing.assert_allclose(columns["error_m"], miss, atol=1e-12)  # nothing was aligned


def test_a_symmetric_building_is_ambiguous():
    metrics, _ = localized(frames_of("symmetric", 0, end=8.0), known_map("symmetric"))
    assert metrics["state"] == "ambiguous"
    assert failure_reason(metrics) == "ambiguous: 2 positions in the map explain the scans equally well"


def test_the_map_of_another_building_is_told():
    metrics, _ = localized(frames_of("office", 0, end=5.0), known_map("cave"))
    assert metrics["losses"] > 0
    assert "may be of another place" in failure_reason(metrics) or "not of this place" in failure_reason(metrics)


@pytest.mark.slow
def test_unknown_starts_are_found_within_five_metres():
    """From places anywhere along the tour."""
    found, medians = 0, []
    for seed in range(20):
        begin = float(np.random.default_rng(seed).uniform(0.0, 40.0))
        frames = frames_of("office", seed, begin=begin, end=begin + 10.0)
        metrics, _ = localized(frames, known_map("office"), seed)
        if metrics["state"] == "found" and metrics["losses"] == 0 and metrics["found_after_m"] < 5.0:
            found += metrics["error_max_m"] < 0.3
            medians.append(metrics["error_median_m"])
    assert found >= 18
    assert np.median(medians) < 0.03


@pytest.mark.slow
def test_a_recorded_log_is_localised_in_the_map_that_it_made(tmp_path):
    """The first minutes of the Intel log; 9 mm from the mapper's own path when this was written."""
    log = DATASETS / "intel" / "intel-merged.clf.gz"
    if not log.exists():
        pytest.skip(f"{log} is absent: set TESTBED_DATASETS")
    frames = open_log(log).frames[:2500]
    mapping = Estimation(FilterConfig(), 0)
    for frame in frames:
        mapping.process(frame)
    mapped = mapping.refined(mapping.filtered())
    write_map(tmp_path / "intel.yaml", mapped.map)
    known = KnownMap.read(tmp_path / "intel.yaml", None, SETTINGS, None)
    metrics, estimation = localized(frames, known)
    assert (metrics["state"], metrics["losses"]) == ("found", 0)
    assert metrics["found_after_m"] < 5.0
    assert "error_median_m" not in metrics  # there is no truth
    updates = estimation.mapper.update_scans
    miss = se2.between(mapped.at_scans.poses[updates], estimation.mapper.path())
    assert np.median(np.hypot(miss[:, 0], miss[:, 1])) < 0.02
    assert np.median(np.abs(miss[:, 2])) < np.radians(0.3)


def test_reading_a_map_checks_it_and_the_start(tmp_path):
    grid = grid_of("cave")
    write_map(tmp_path / "map.yaml", grid)
    free = np.argwhere(grid.free)[1000]
    x, y = (free[::-1] + 0.5) * grid.resolution + grid.origin[:2]
    known = KnownMap.read(tmp_path / "map.yaml", f"{x},{y},-90", SETTINGS, grid)
    np.testing.assert_allclose(known.start, (x, y, -np.pi / 2))
    assert known.has_frame_of_truth
    moved = dataclasses.replace(grid, origin=(1.0, 2.0, 0.0))
    assert not KnownMap.read(tmp_path / "map.yaml", None, SETTINGS, moved).has_frame_of_truth
    with pytest.raises(ValueError, match=r"map\.yaml: start \(900, 0\) m lies"):
        KnownMap.read(tmp_path / "map.yaml", "900,0,0", SETTINGS, None)
    for text in ("1,2", "a,b,c", ""):
        with pytest.raises(ValueError, match="expected X,Y,DEG"):
            parse_start(text)
    write_map(tmp_path / "bare.yaml", dataclasses.replace(grid, probability=np.zeros((9, 9), np.float32)))
    with pytest.raises(ValueError, match=r"bare\.yaml: the map has no walls"):
        KnownMap.read(tmp_path / "bare.yaml", None, SETTINGS, None)


def test_maps_of_other_systems_serve(tmp_path):
    """Trinary pixels, unknown = 205, as ROS' map_saver writes them, with an origin off its cells."""
    grid, frames = grid_of("apartment"), frames_of("apartment", 0, end=10.0)
    pixels = np.full(grid.probability.shape, 205, np.uint8)
    pixels[grid.free], pixels[grid.occupied] = 254, 0
    rows, columns = pixels.shape
    (tmp_path / "saved.pgm").write_bytes(b"P5\n%d %d\n255\n" % (columns, rows) + np.flipud(pixels).tobytes())
    shift = np.array([0.0123, -0.0456, 0.0])
    (tmp_path / "saved.yaml").write_text(
        f"image: saved.pgm\nresolution: {grid.resolution}\norigin: {(grid.origin + shift).tolist()}\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    known = KnownMap.read(tmp_path / "saved.yaml", None, SETTINGS, None)
    localization = Localization(known.grid, settings=known.settings)
    scans = [frame for frame in frames if frame.scan is not None]
    for frame in scans:
        report = localization.process(frame.odometry, frame.scan, twist=frame.twist)
    assert localization.status.state == "found"
    np.testing.assert_allclose(report.pose[:2], scans[-1].truth[:2] + shift[:2], atol=0.05)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, None),
        ({"state": "searching"}, "position in the map is still unknown"),
        ({"state": "ambiguous", "places": 3}, "ambiguous: 3 positions"),
        ({"state": "ambiguous"}, "too few scans"),
        ({"losses": 1, "lost_at_s": [12.0]}, "stopped fitting the map once, first after 12.0 s"),
        ({"losses": 2, "lost_at_s": [2.0, 5.0], "found_after_m": None}, r"was not found: .*\(tried 2 times\)"),
        ({"error_median_m": 7.0}, r"in a wrong position: the median error is 7\.00 m"),
    ],
)
def test_every_way_to_fail_has_its_sentence(changes, words):
    fine = {"losses": 0, "lost_at_s": [], "state": "found", "places": 1, "found_after_m": 1.0, "error_median_m": 0.01}
    reason = failure_reason({**fine, **changes})
    if words is None:
        assert reason is None
    else:
        assert re.search(words, reason)
