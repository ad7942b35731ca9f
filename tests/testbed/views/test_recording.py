# SPDX-License-Identifier: MIT
"""What is in a recording, asked of Rerun's own reader."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eval.wording import at_time
from slam import se2
from slam.config import MotionConfig
from slam.occupancy import OccupancyGrid
from testbed.views import FinalLoop, NullView, ViewOptions, open_run, open_view
from testbed.views.another_best import errors_in_words
from testbed.views.rerun import drawing, entities
from tests.testbed.views.conftest import Recorded
from tests.testbed.views.shown_map import rows
from tests.testbed.views.synthetic import scene, snapshots, true_map


def test_every_scan_has_its_pose_and_the_last_one_is_the_estimates(recorded: Recorded) -> None:
    translations = rows(recorded.path, entities.ESTIMATED_ROBOT, "Transform3D:translation")
    assert len(translations) == len(recorded.snapshots) + 1  # once more when the view is closed
    for (stamp, value), snapshot in zip(translations, recorded.snapshots, strict=False):
        assert stamp == pytest.approx(snapshot.stamp)
        assert value[0][:2] == pytest.approx(snapshot.estimate[:2], abs=1e-6)
    quaternions = rows(recorded.path, entities.ESTIMATED_ROBOT, "Transform3D:quaternion")
    _, _, z, w = quaternions[-1][1][0]
    assert 2.0 * np.arctan2(z, w) == pytest.approx(recorded.snapshots[-1].estimate[2], abs=1e-6)


def test_truth_and_estimate_start_at_the_same_pose_of_the_world(recorded: Recorded) -> None:
    first = recorded.snapshots[0]
    assert first.truth is not None
    (_, translation), (_, quaternion) = (
        rows(recorded.path, entities.SLAM, f"Transform3D:{part}", static=True)[0]
        for part in ("translation", "quaternion")
    )
    T_world_map = np.array([*translation[0][:2], 2.0 * np.arctan2(quaternion[0][2], quaternion[0][3])])
    assert se2.compose(T_world_map, first.estimate) == pytest.approx(first.truth, abs=1e-6)


def test_errors_are_those_of_the_aligned_poses(recorded: Recorded) -> None:
    errors = rows(recorded.path, entities.POSITION_ERROR, "Scalars:scalars")
    first, last = recorded.snapshots[0], recorded.snapshots[-1]
    assert first.truth is not None
    assert last.truth is not None
    assert errors[0][1] == pytest.approx([0.0, 0.0], abs=1e-12)
    expected = [
        np.linalg.norm(se2.between(first.truth, last.truth)[:2] - se2.between(start, end)[:2])
        for start, end in ((first.estimate, last.estimate), (first.odometry, last.odometry))
    ]
    assert errors[-1][1] == pytest.approx(expected, abs=1e-9)


def test_what_the_filter_did_is_there_scan_by_scan(recorded: Recorded) -> None:
    steps = [s.step for s in recorded.snapshots if s.step is not None and s.step.updated]
    resamplings = sum(step.resampled for step in steps)
    assert resamplings > 0
    ess = rows(recorded.path, entities.ESS_VALUE, "Scalars:scalars")
    assert [value[0] for _, value in ess] == pytest.approx([step.ess for step in steps])
    assert len(rows(recorded.path, entities.PARTICLES, "Arrows3D:origins")) == len(steps)
    assert len(rows(recorded.path, entities.PROPOSAL_GAUSSIAN, "Ellipsoids3D:centers")) == len(steps) - 1
    assert len(rows(recorded.path, entities.ESS_RESAMPLED, "Scalars:scalars")) == resamplings
    log = [text[0] for _, text in rows(recorded.path, entities.EVENTS, "TextLog:text")]
    assert sum(line.startswith("resampled") for line in log) == resamplings
    for lane, state in (
        (entities.ESTIMATE_STATE, "close to the truth (limit 35 cm)"),
        (entities.MATCHING_STATE, "scan fits the map"),
    ):
        states = [value[0] for _, value in rows(recorded.path, lane, "StateChange:state")]
        assert states == [state]  # nothing changes in a good run


def test_the_samples_of_the_best_particle_go_where_none_are_drawn(recorded: Recorded, tmp_path: Path) -> None:
    updates = [s for s in recorded.snapshots if s.step is not None and s.step.updated]
    found = rows(recorded.path, entities.PROPOSAL_SAMPLES, "Points3D:positions")
    assert [stamp for stamp, _ in found] == pytest.approx([s.stamp for s in updates])
    assert len(found[0][1]) == 0  # nothing is proposed for the first scan
    for (_, points), update in zip(found[1:], updates[1:], strict=True):
        assert update.step is not None
        assert update.step.proposed is not None
        drawn = update.step.proposed.samples[update.step.best]
        assert np.array(points)[:, :2] == pytest.approx(drawn[:, :2], abs=1e-6)
    path = tmp_path / "recording.rrd"
    with open_view(path, scene()) as view:
        for update, proposal in ((updates[1], updates[1].proposal), (updates[2], None)):
            view.show(replace(update, proposal=proposal))
    assert [len(points) for _, points in rows(path, entities.PROPOSAL_SAMPLES, "Points3D:positions")] == [20, 0]


def test_samples_are_coloured_by_their_weights(recorded: Recorded, tmp_path: Path) -> None:
    update = next(s for s in recorded.snapshots if s.proposal is not None)
    assert update.proposal is not None
    weights = np.linspace(0.0, 1.0, len(update.proposal.samples))
    path = tmp_path / "recording.rrd"
    with open_view(path, scene()) as view:
        view.show(replace(update, proposal=replace(update.proposal, weights=weights)))
    ((_, colours),) = rows(path, entities.PROPOSAL_SAMPLES, "Points3D:colors")
    shown = np.array(colours, np.uint32)
    red, blue = (shown >> 24) & 255, (shown >> 8) & 255
    assert np.all(np.diff(red.astype(int)) > 0)
    assert np.all(np.diff(blue.astype(int)) < 0)
    assert (red[-1], blue[-1]) == (drawing.HEAVY[0], drawing.HEAVY[2])


def test_odometry_that_disagrees_is_said_once_at_its_moment(tmp_path: Path) -> None:
    path, turn = tmp_path / "recording.rrd", np.array([0.0, 0.0, 0.8])
    with open_view(path, replace(scene(), motion=MotionConfig())) as view:
        for snapshot in snapshots(6.0):
            late = snapshot.stamp >= 3.0
            view.show(replace(snapshot, odometry=se2.compose(snapshot.odometry, turn) if late else snapshot.odometry))
    events = rows(path, entities.EVENTS, "TextLog:text")
    said = [stamp for stamp, text in events if "the odometry disagrees" in text[0]]
    assert len(said) == 1
    assert said[0] == pytest.approx(3.0, abs=0.3)


def test_the_prior_lies_where_the_odometry_points(tmp_path: Path) -> None:
    path, shown = tmp_path / "recording.rrd", []
    with open_view(path, replace(scene(), motion=MotionConfig())) as view:
        for snapshot in snapshots(3.0):
            view.show(snapshot)
            if snapshot.step is not None and snapshot.step.updated:
                shown.append(snapshot)
    centres = rows(path, entities.PROPOSAL_PRIOR, "Ellipsoids3D:centers")
    assert [stamp for stamp, _ in centres] == pytest.approx([s.stamp for s in shown[1:]])
    for (_, centre), before, now in zip(centres, shown[:-1], shown[1:], strict=True):
        assert before.poses is not None
        assert now.step is not None
        start = before.poses[now.step.best]
        expected = se2.compose(start, se2.between(before.odometry, now.odometry))
        assert centre[0][:2] == pytest.approx(expected[:2], abs=1e-5)


def small_map() -> OccupancyGrid:
    """A map of six cells."""
    return OccupancyGrid(probability=np.ones((2, 3), np.float32), resolution=1.0, origin=(0.0, 0.0, 0.0))


def test_a_final_pass_is_shown_before_and_after_and_as_steps(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    refined = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.5]])
    grid = small_map()
    shown = list(snapshots(2.0))
    with open_view(path, scene()) as view:
        for snapshot in shown:
            view.show(snapshot)
        view.finish(refined, grid)
    assert shown[-1].path is not None
    lengths = {"before": len(shown[-1].path(None)), "after": 2}
    for step, length in lengths.items():
        strips = rows(path, f"{entities.FINAL}/{step}/path", "LineStrips3D:strips", static=True)
        assert len(strips[0][1][0]) == length
    after = rows(path, f"{entities.FINAL}/after/map", "GridMap:data", static=True)
    assert bytes(after[0][1][0]) == bytes([0] * 6)
    steps = rows(path, f"{entities.FINAL}/step/map", "GridMap:data", timeline=entities.FINAL_PASS_TIMELINE)
    assert [step for step, _ in steps] == [0, 1]
    ends = rows(path, entities.ESTIMATED_ROBOT, "Transform3D:translation")
    assert ends[-1][1][0][:2] == pytest.approx(shown[-1].estimate[:2], abs=1e-6)  # the run itself stays as it was


def test_loops_of_the_final_pass_are_drawn_before_and_after_it(tmp_path: Path) -> None:
    path, pair = tmp_path / "recording.rrd", np.array([[1.0, 2.0, 0.0], [1.5, 2.0, 0.0]])
    loops = [
        FinalLoop(kind="left_open", before=pair, after=pair + 0.25),
        FinalLoop(kind="left_open", before=pair + 1.0, after=pair + 1.25),
        FinalLoop(kind="rejected", before=pair, after=pair),
    ]
    shown = list(snapshots(2.0))
    with open_view(path, scene()) as view:
        for snapshot in shown:
            view.show(snapshot)
        view.finish(np.zeros((len(shown), 3)), small_map(), loops)

    def drawn(entity: str, **options: Any) -> list[tuple[Any, np.ndarray]]:
        found = rows(path, f"{entities.FINAL}/{entity}", "LineStrips3D:strips", **options)
        return [(time, np.array(strips)[..., :2]) for time, strips in found]

    for step, moved in (("before", 0.0), ("after", 0.25)):
        ((_, strips),) = drawn(f"{step}/loops/left_open", static=True)
        np.testing.assert_allclose(strips, [pair[:, :2] + moved, pair[:, :2] + 1.0 + moved])
        assert len(drawn(f"{step}/loops/rejected", static=True)) == 1
        assert drawn(f"{step}/loops/closed_by_filter", static=True) == []
    assert [time for time, _ in drawn("step/loops/left_open", timeline=entities.FINAL_PASS_TIMELINE)] == [0, 1]
    lines = [text for _, (text,) in rows(path, entities.EVENTS, "TextLog:text")]
    assert "final pass: 2 loops closed that the filter had left open" in lines
    assert "final pass: 1 loop rejected" in lines


def test_both_robots_are_outlines_of_one_kind(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with open_view(path, scene()) as view:
        view.show(next(iter(snapshots(0.0))))
    for part in ("outline", "heading"):
        (true,), (estimated,) = (
            rows(path, f"{robot}/{part}", "LineStrips3D:strips", static=True)
            for robot in (entities.TRUE_ROBOT, entities.ESTIMATED_ROBOT)
        )
        assert true[1] == estimated[1]


def test_a_log_without_truth_has_neither_true_robot_nor_errors(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with open_view(path, replace(scene(), true_map=None)) as view:
        for snapshot in snapshots(1.0):
            view.show(replace(snapshot, truth=None, stamp=snapshot.stamp + 1e9))
    assert rows(path, entities.TRUE_ROBOT, "Transform3D:translation") == []
    assert rows(path, entities.POSITION_ERROR, "Scalars:scalars") == []
    assert rows(path, entities.block(entities.TRUE_PATH, 0), "LineStrips3D:strips") == []
    assert rows(path, entities.ESTIMATED_ROBOT, "Transform3D:translation")[0][0] == 0.0  # times count from the start


def test_the_spread_is_that_of_the_particles_and_a_single_one_has_none(recorded: Recorded, tmp_path: Path) -> None:
    last = [s for s in recorded.snapshots if s.step is not None and s.step.updated][-1]
    assert last.poses is not None
    off = last.poses[:, :2] - np.average(last.poses[:, :2], axis=0, weights=last.weights)
    expected = 100.0 * np.sqrt(np.average((off**2).sum(axis=1), weights=last.weights))
    shown = rows(recorded.path, entities.SPREAD, "Scalars:scalars")
    assert shown[-1][1][0] == pytest.approx(expected)
    alone = tmp_path / "alone.rrd"
    with open_view(alone, scene(particles=1)) as view:
        for snapshot in snapshots(1.0, particles=1):
            view.show(snapshot)
    assert rows(alone, entities.SPREAD, "Scalars:scalars") == []


def test_maps_of_other_particles_say_how_old_they_are(recorded: Recorded) -> None:
    for rank in entities.RANKS:
        labels = rows(recorded.path, f"{entities.COMPARE}/{rank}/robot/label", "Points3D:labels")
        assert len(labels) > 1
        for stamp, (label,) in labels:
            assert label.endswith(f"{entities.AS_OF}{at_time(stamp)}") is (rank != entities.RANKS[0])


def test_a_single_particle_is_larger_than_the_line_of_its_ellipse_and_above_it(
    recorded: Recorded, tmp_path: Path
) -> None:
    alone = tmp_path / "alone.rrd"
    with open_view(alone, scene(particles=1)) as view:
        for snapshot in snapshots(1.0, particles=1):
            view.show(snapshot)
    radii = [
        abs(rows(path, entities.PARTICLE_DOTS, "Points3D:radii", static=True)[0][1][0])
        for path in (recorded.path, alone)
    ]
    assert radii[1] >= 1.5 * radii[0]
    dots, ellipses = (
        rows(alone, entity, values)[-1][1][0][2]
        for entity, values in (
            (entities.PARTICLE_DOTS, "Points3D:positions"),
            (entities.COVARIANCE, "Ellipsoids3D:centers"),
        )
    )
    assert dots > ellipses


def test_paths_reach_the_newest_poses(recorded: Recorded) -> None:
    poses = {
        entities.PATH: [s.estimate for s in recorded.snapshots],
        entities.TRUE_PATH: [s.truth for s in recorded.snapshots],
        entities.ODOMETRY_PATH: [s.odometry for s in recorded.snapshots],
    }
    for entity, expected in poses.items():
        shown = rows(recorded.path, f"{entity}/newest", "LineStrips3D:strips")
        late = shown[len(shown) // 2 :]
        ends = np.array([strip[0][-1][:2] for _, strip in late])
        starts = np.array([strip[0][0][:2] for _, strip in late])
        for stamp, end in zip([stamp for stamp, _ in late], ends, strict=True):
            np.testing.assert_allclose(end, expected[round(stamp / 0.1)][:2], atol=1e-5)
        assert np.hypot(*(ends - starts).T).max() < 0.7  # as far as a path may lag, and a scan more


def test_another_best_particle_is_marked_where_it_moves_the_estimate(recorded: Recorded) -> None:
    marked = dict(rows(recorded.path, entities.ANOTHER_BEST, "Scalars:scalars"))
    errors = dict(rows(recorded.path, entities.POSITION_ERROR, "Scalars:scalars"))
    expected = []
    for before, now in zip(recorded.snapshots[:-1], recorded.snapshots[1:], strict=True):
        if now.step is None or now.step.proposed is None or now.step.best == before.best:
            continue
        way = now.step.proposed.pose[before.best] - now.step.pose
        if np.hypot(*way[:2]) > 0.03:
            expected.append(now.stamp)
    assert len(expected) > 2
    assert list(marked) == pytest.approx(expected)
    assert all(value[0] == pytest.approx(errors[stamp][0]) for stamp, value in marked.items())
    said = [(at, text[0]) for at, text in rows(recorded.path, entities.EVENTS, "TextLog:text") if "became" in text[0]]
    assert [at for at, _ in said] == pytest.approx(expected)  # scans come each tenth of a second, as lines
    assert all(text.startswith("another particle became the best: the reported pose moved by ") for _, text in said)
    updates = [shown.stamp for shown in recorded.snapshots if shown.step is not None and shown.step.updated]
    for at, text in said:
        now = updates.index(min(updates, key=lambda stamp: abs(stamp - at)))
        off = [min(errors.items(), key=lambda row: abs(row[0] - updates[k]))[1][0] for k in (now - 1, now)]
        assert text.endswith(f", {errors_in_words(*off)}")


def test_a_change_of_the_best_particle_is_towards_the_truth_or_away_from_it() -> None:
    assert (
        errors_in_words(0.077, 0.011) == "closer to the truth (7.7\N{NO-BREAK SPACE}cm to 1.1\N{NO-BREAK SPACE}cm off)"
    )
    assert errors_in_words(0.26, 0.5) == "away from the truth (26\N{NO-BREAK SPACE}cm to 50\N{NO-BREAK SPACE}cm off)"
    assert errors_in_words(0.2601, 0.2602) == "as far from the truth as before (26\N{NO-BREAK SPACE}cm off)"


def test_collisions_and_notes_are_in_the_event_log(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    with open_view(path, scene()) as view:
        for snapshot in snapshots(0.5):
            view.show(replace(snapshot, collided=snapshot.stamp > 0.25, notes=("hello",) if not snapshot.stamp else ()))
    log = [text[0] for _, text in rows(path, entities.EVENTS, "TextLog:text")]
    assert log.count("hello") == 1
    assert log.count("the robot has collided") == 1  # when it begins, not at every scan
    assert [s[0] for _, s in rows(path, entities.ROBOT_STATE, "StateChange:state")] == ["driving", "collided"]


def test_without_a_file_nothing_is_watched() -> None:
    view = open_view(None, scene())
    assert isinstance(view, NullView)
    with view:
        view.show(next(iter(snapshots(0.0))))
        view.finish(np.zeros((1, 3)), true_map())
    view.wait()


def test_a_wrong_address_and_a_missing_recording_are_told_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"localhost:9876.*expected e\.g\. rerun\+http"):
        ViewOptions(connect="localhost:9876")
    with pytest.raises(ValueError, match="no recording"):
        open_run(tmp_path)


def test_a_full_disk_is_an_error_that_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "recording.rrd"
    if not Path("/dev/full").exists():
        pytest.skip("/dev/full is absent: a file on a full disk cannot be had")
    path.symlink_to("/dev/full")
    with pytest.raises(OSError, match=r"recording\.rrd"):
        record(path)


def test_there_may_be_fewer_particles_than_at_most(tmp_path: Path) -> None:
    with open_view(tmp_path / "recording.rrd", scene(particles=30)) as view:
        for snapshot in snapshots(1.0, particles=3):
            view.show(snapshot)
    paths = rows(tmp_path / "recording.rrd", entities.PARTICLE_PATHS, "LineStrips3D:strips")
    assert len(paths[-1][1]) > 0


def record(path: Path) -> None:
    with open_view(path, scene()) as view:
        for snapshot in snapshots(1.0):
            view.show(snapshot)


def test_times_of_events_are_short_enough_to_be_read(tmp_path: Path) -> None:
    """They are rounded up: the log cuts longer ones, and at an earlier time the event cannot be seen yet."""
    path = tmp_path / "recording.rrd"
    with open_view(path, scene()) as view:
        for snapshot in snapshots(2.0):
            view.show(replace(snapshot, stamp=0.97 * snapshot.stamp, notes=("something",)))
    times = [time for time, _ in rows(path, entities.EVENTS, "TextLog:text")]
    assert times == [round(time, 1) for time in times]
    assert 0.1 in times
    scans = [n for n, _ in rows(path, entities.EVENTS, "TextLog:text", timeline=entities.SCAN_TIMELINE)]
    assert sorted(set(scans)) == list(range(21))
