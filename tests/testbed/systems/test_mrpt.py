# SPDX-License-Identifier: MIT
"""MRPT's programs as systems: what rawlogs hold, how the programs score, and what is said where they are missing."""

import gzip
import os
import struct
from pathlib import Path

import numpy as np
import pytest

from eval.trajectory.relations import read_relations, relation_error
from slam import se2
from slam.scan import Scan
from testbed.formats import open_log
from testbed.frame import Frame
from testbed.systems import finding
from testbed.systems.entrant import entrant_of
from testbed.systems.errors import SystemsError
from testbed.systems.finding import BUILT_IN_PROGRAMS, find_system, listed
from testbed.systems.mrpt import write_rawlog
from tests.shell import call
from tests.testbed.systems.room import frames

DATASETS = Path(os.environ.get("TESTBED_DATASETS", Path(__file__).parents[4] / "shared" / "datasets"))
needs_mrpt = pytest.mark.skipif(
    not all(entry.is_installed for entry in BUILT_IN_PROGRAMS.values()),
    reason="MRPT is not installed: apt-get install mrpt-apps",
)


class Reader:
    """Reads a rawlog by the rules of MRPT's classes."""

    def __init__(self, path):
        self.data, self.at = gzip.decompress(path.read_bytes()), 0

    def numbers(self, shape):
        found = struct.unpack_from("<" + shape, self.data, self.at)
        self.at += struct.calcsize("<" + shape)
        return found

    def begin(self, name, version):
        (length,) = self.numbers("B")
        assert length & 0x80
        assert self.numbers(f"{length & 0x7F}s")[0].decode() == name
        assert self.numbers("B") == (version,)

    def end(self):
        assert self.numbers("B") == (0x88,)

    def pair(self):
        """Motion, angles, ranges, valid, mount, ticks of the next pair."""
        self.begin("mrpt::obs::CActionCollection", 0)
        assert self.numbers("I") == (1,)
        self.begin("mrpt::obs::CActionRobotMovement2D", 6)
        assert self.numbers("I") == (0,)  # by odometry
        self.begin("mrpt::poses::CPose2D", 1)
        motion = self.numbers("3d")
        self.end()
        assert self.numbers("I6fI6f")[0] == 0  # the Gaussian model
        self.numbers("?2f?2i")
        (ticks,) = self.numbers("q")
        self.end(), self.end()
        self.begin("mrpt::obs::CSensoryFrame", 2)
        assert self.numbers("I") == (1,)
        self.begin("mrpt::obs::CObservation2DRangeScan", 7)
        aperture, right_to_left, range_max = self.numbers("f?f")
        assert right_to_left
        self.begin("mrpt::poses::CPose3D", 3)
        pose = self.numbers("12d")
        self.end()
        (count,) = self.numbers("I")
        ranges, valid = self.numbers(f"{count}f"), self.numbers(f"{count}B")
        assert self.numbers("fqf")[1] == ticks
        (length,) = self.numbers("I")
        self.numbers(f"{length}s"), self.numbers("d?")
        self.end(), self.end()
        mount = (pose[0], pose[1], np.arctan2(pose[6], pose[3]))
        angles = np.linspace(-aperture / 2, aperture / 2, count)
        return motion, angles, np.array(ranges), np.array(valid, bool), mount, ticks, range_max


def test_a_rawlog_holds_motions_and_scans_as_they_are(tmp_path):
    angles, mount = np.radians(np.arange(-30.0, 121.0)), (0.1, -0.2, 0.3)
    ranges = np.linspace(1.0, 3.0, len(angles))
    ranges[[3, 9]] = np.inf, np.nan
    scan = Scan(ranges=ranges, angles=angles, range_max=8.0, stamp=5.0, mount=mount)
    made = [
        Frame(stamp=5.0, odometry=np.array([1.0, 2.0, 0.5]), scan=scan),
        Frame(stamp=5.1, odometry=np.array([1.1, 2.0, 0.5]), scan=None),
        Frame(stamp=4.9, odometry=np.array([1.2, 2.1, 0.7]), scan=scan),
    ]
    assert write_rawlog(tmp_path / "x.rawlog", made) == [0, 2]
    reader = Reader(tmp_path / "x.rawlog")
    first, second = reader.pair(), reader.pair()
    assert reader.at == len(reader.data)
    np.testing.assert_allclose(first[0], (0.0, 0.0, 0.0))
    np.testing.assert_allclose(second[0], se2.between(made[0].odometry, made[2].odometry))
    assert second[5] > first[5]  # a stamp that steps back
    for _, found, readings, valid, pose, _, range_max in (first, second):
        points = se2.transform_points(pose, (readings * [np.cos(found), np.sin(found)]).T)
        hit = np.isfinite(ranges)
        expected = se2.transform_points(mount, (ranges * [np.cos(angles), np.sin(angles)]).T[hit])
        assert (valid == hit).all()
        np.testing.assert_allclose(points[hit], expected, atol=1e-5)
        assert (readings[~hit] == range_max).all()


def test_a_recording_without_beams_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no scan with 2 beams or more"):
        write_rawlog(tmp_path / "x.rawlog", [Frame(stamp=0.0, odometry=np.zeros(3), scan=None)])


def test_a_missing_program_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setattr(finding.shutil, "which", lambda name: None)
    with pytest.raises(SystemsError, match="mrpt-icp: needs icp-slam: apt-get install mrpt-apps"):
        entrant_of("mrpt-icp")
    assert {system.name: system.missing for system in listed()}["mrpt-rbpf"] == "apt-get install mrpt-apps"
    assert call("run", "office", "--system", "odometry,mrpt-rbpf") == 2
    assert "mrpt-rbpf: needs rbpf-slam" in capsys.readouterr().err


def test_a_program_has_no_class():
    with pytest.raises(SystemsError, match="mrpt-icp: is a program, which has no class"):
        find_system("mrpt-icp")


@needs_mrpt
@pytest.mark.parametrize("name", BUILT_IN_PROGRAMS)
def test_the_programs_follow_a_circle_and_draw_its_walls(name):
    drive = frames(scans=100, between=1)
    program = entrant_of(name)
    assert program.name == name
    assert "mrpt" in program.facts()["version"]
    estimated, cost = program.run(drive, seed=1)
    truth = np.array([frame.truth for frame in drive])[estimated.frames]
    error = se2.between(se2.between(truth[0], truth), se2.between(estimated.dense.poses[0], estimated.dense.poses))
    assert np.abs(error[:, :2]).max() < 0.15
    assert cost.memory_mb > 10.0
    rows, cols = np.nonzero(estimated.grid.occupied)
    corners = np.column_stack([cols + 0.5, rows + 0.5]) * estimated.grid.resolution
    walls = se2.transform_points(truth[0], se2.transform_points(estimated.grid.origin, corners))
    assert len(walls) > 100
    assert np.median(np.abs(np.abs(walls).max(axis=1) - 4.0)) < 0.15  # on the walls of the room


@needs_mrpt
def test_the_seed_decides_the_particle_filter():
    drive = frames(scans=40, between=0)
    first, again, other = (entrant_of("mrpt-rbpf").run(drive, seed)[0].dense.poses for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.slow
@needs_mrpt
def test_icp_scores_on_a_real_log_what_the_page_states():
    log, relations = DATASETS / "intel/intel-merged.clf.gz", DATASETS / "intel/intel-resolved.relations"
    if not log.is_file():
        pytest.skip(f"no log in {DATASETS}")
    estimated, _ = entrant_of("mrpt-icp").run(open_log(log).frames, seed=0)
    error = relation_error(estimated.dense, read_relations(relations))
    assert error.all.translation.mean == pytest.approx(0.042, rel=0.1)
