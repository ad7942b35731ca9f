# SPDX-License-Identifier: MIT
"""Faults at a known time are named, and sound data name none."""

from __future__ import annotations

import numpy as np

from eval.failure_cause import find_cause
from eval.trajectory.trajectory import Trajectory
from slam.se2 import between, compose

STAMPS = 0.1 * np.arange(400)
TRUTH = np.column_stack([0.05 * np.arange(400), np.zeros(400), np.zeros(400)])
STEPS = {
    "stamp": STAMPS,
    "hits": np.full(400, 180),
    "match_failures": np.zeros(400),
    "particles": np.full(400, 10),
    "loop_closed": np.zeros(400),
}


def after(poses: np.ndarray, row: int, motion: list[float]) -> np.ndarray:
    """Poses that make one more motion before a row."""
    moved = poses.copy()
    moved[row:] = compose(compose(poses[row], motion), between(poses[row], poses[row:]))
    return moved


def cause(odometry: np.ndarray = TRUTH, truth: np.ndarray = TRUTH, **changed: object) -> str | None:
    return find_cause(
        20.0, odometry=Trajectory(STAMPS, odometry), reference=Trajectory(STAMPS, truth), steps=STEPS | changed
    )


def test_sound_data_name_no_fault():
    assert cause() is None
    assert cause(odometry=TRUTH * [1.02, 1.0, 1.0]) is None


def test_wheels_that_slip_are_named_with_both_motions():
    found = cause(odometry=after(TRUTH, 200, [0.0, 0.0, np.radians(-33.0)]))
    assert found.startswith("the wheels slipped")
    assert "-33 degrees" in found
    assert "and 0 degrees" in found


def test_a_slip_is_said_with_its_stretch_and_with_those_that_healed():
    """The wheels turn by 33 degrees from 19.9 to 20.0 s; they had slipped at 10 and at 4 s already."""
    slip = [0.0, 0.0, np.radians(-33.0)]
    first = after(TRUTH, 200, slip)
    found = cause(odometry=first)
    assert (
        "slipped: from 19.9 to 20.0 s they reported 5.0\N{NO-BREAK SPACE}cm and -33 degrees, the robot moved by"
        in found
    )
    assert found.endswith("they had not slipped before")
    found = cause(odometry=after(after(first, 100, slip), 40, slip))
    assert found.endswith(
        "they slipped in 2 of the 6 intervals of 3 s before this one too, and the estimate recovered each time"
    )


def test_a_cause_begins_before_its_effect_or_while_its_scan_is_taken():
    """The scan of 20.0 s is taken until 20.1 s: a slip that begins at 20.0 s bends it, one at 20.1 s comes too late.
    A final pass moves the poses before a slip too."""
    slip = [0.0, 0.0, np.radians(-33.0)]
    assert "scan of this moment" not in cause(odometry=after(TRUTH, 200, slip))
    found = cause(odometry=after(TRUTH, 201, slip))
    assert "from 20.0 to 20.1 s" in found
    assert "; the scan of this moment was taken then, and the wheels' motion bends it" in found
    late = {"odometry": Trajectory(STAMPS, after(TRUTH, 202, slip)), "reference": Trajectory(STAMPS, TRUTH)}
    assert find_cause(20.0, **late, steps=STEPS) is None
    found = find_cause(20.0, **late, steps=STEPS, refined=True)
    assert "from 20.1 to 20.2 s" in found
    assert found.endswith("the final pass has spread the error over the path before")


def test_a_slip_that_goes_on_after_the_moment_is_said_to_its_end():
    """The wheels turn by 10 degrees a scan from 19.9 to 20.3 s, and by 33 once more at 21 s, which is another slip."""
    wheels = TRUTH
    for row in (200, 201, 202, 203):
        wheels = after(wheels, row, [0.0, 0.0, np.radians(10.0)])
    found = cause(odometry=after(wheels, 210, [0.0, 0.0, np.radians(33.0)]))
    assert "from 19.9 to 20.3 s" in found
    assert "and 40 degrees, the robot" in found


def test_a_slip_that_grows_little_by_little_is_named_as_a_whole():
    """From 18 s on the wheels report a quarter more than the robot moves, which no single step shows."""
    steps = np.where(STAMPS >= 18.0, 1.25, 1.0) * 0.05
    found = cause(odometry=np.column_stack([np.cumsum(steps), np.zeros(400), np.zeros(400)]))
    assert found.startswith("the wheels slipped: from 17.0 to 20.1 s they reported 1.83")
    steps[195] += 0.03  # a single step stands out, and is no slip by itself
    found = cause(odometry=np.column_stack([np.cumsum(steps), np.zeros(400), np.zeros(400)]))
    assert found.startswith("the wheels slipped: from 17.0 to 20.1 s they reported 1.86")


def test_lost_scans_and_failures_after_the_moment_are_no_causes():
    hits, failures = np.full(400, 180), np.zeros(400)
    hits[202:210], failures[202:210] = 0, 7
    assert cause(hits=hits, match_failures=failures) is None
    kept = np.r_[0:202, 250:400]
    assert find_cause(20.0, odometry=Trajectory(STAMPS[kept], TRUTH[kept]), reference=None, steps=None) is None


def test_a_robot_that_is_carried_is_told_from_slip():
    found = cause(truth=after(TRUTH, 200, [2.0, 1.0, 0.5]))
    assert found.startswith("the robot was pushed or carried: within 0.1 s")
    assert "29 degrees" in found


def test_scans_matched_to_a_wrong_place_are_named_last():
    """The estimate jumps while wheels and robot agree; a slip at the same moment is the cause itself."""
    estimate = Trajectory(STAMPS, after(TRUTH, 200, [0.7, 0.1, np.radians(5.0)]))
    both = {"odometry": Trajectory(STAMPS, TRUTH), "reference": Trajectory(STAMPS, TRUTH)}
    found = find_cause(20.0, **both, steps=STEPS, estimate=estimate)
    assert found.startswith("the scans were matched to a wrong place of the map: from 19.9 to 20.0 s")
    assert "moved by 76\N{NO-BREAK SPACE}cm and 5 degrees, the robot by 5.0\N{NO-BREAK SPACE}cm and 0 degrees" in found
    assert find_cause(20.0, **both, steps=STEPS, estimate=both["reference"]) is None
    slipped = Trajectory(STAMPS, after(TRUTH, 200, [0.0, 0.0, np.radians(-33.0)]))
    found = find_cause(20.0, odometry=slipped, reference=both["reference"], steps=STEPS, estimate=estimate)
    assert found.startswith("the wheels slipped")


def test_a_loop_that_is_left_open_is_named_at_the_return():
    """A square of 10 m, driven once; the estimate turns by 0.6 degrees with each metre. The wheels say as it does."""
    corner, side = [0.0, 0.0, np.pi / 2], np.tile([0.1, 0.0, 0.0], (100, 1))
    motions = np.concatenate([np.concatenate([side, [corner]])] * 4)[:403]
    true, bent = [np.zeros(3)], [np.zeros(3)]
    for motion in motions:
        true.append(compose(true[-1], motion))
        bent.append(compose(bent[-1], np.add(motion, [0.0, 0.0, 0.1 * np.radians(0.6)])))
    stamps = 0.1 * np.arange(404)
    truth, estimate = Trajectory(stamps, np.array(true)), Trajectory(stamps, np.array(bent))
    steps = {**{name: np.resize(values, 404) for name, values in STEPS.items()}, "stamp": stamps}
    given = {"odometry": estimate, "reference": truth, "steps": steps, "estimate": estimate}
    found = find_cause(40.0, **given)
    assert found.startswith("a loop was left open: the robot is back where it was 40 s and 40 m before")
    assert "and 24 degrees since" in found
    assert find_cause(25.0, **given) is None  # on the far side of the square
    assert find_cause(40.0, **given | {"estimate": truth}) is None
    closed = steps | {"loop_closed": np.ones(404)}
    assert find_cause(40.0, **given | {"steps": closed}) == found  # its motion at the return is right


def test_an_odometry_that_starts_anew_is_named():
    assert "restarted" in cause(odometry=np.concatenate([TRUTH[:200], between(TRUTH[200], TRUTH[200:])]))


def test_a_blind_lidar_and_lost_scans_are_named():
    hits = np.full(400, 180)
    hits[170:195] = 0
    assert "next to nothing: 0 beams returned (usual: 180)" in cause(hits=hits)
    kept = np.r_[0:150, 195:400]
    lost = find_cause(20.0, odometry=Trajectory(STAMPS[kept], TRUTH[kept]), reference=None, steps=None)
    assert lost == "no scan came for 4.6 s"


def test_where_only_matching_failed_it_says_so():
    failures = np.zeros(400)
    failures[199] = 7
    assert cause(match_failures=failures).startswith("scan matching failed for 7 of 10 particles")
