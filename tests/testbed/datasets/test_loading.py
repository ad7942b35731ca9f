# SPDX-License-Identifier: MIT
"""One recording of a collection as arrays, frames and tables."""

import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from eval.files.tum import read_tum
from testbed.datasets import open_collection, open_dataset
from testbed.datasets.index import COLUMNS, datasets_in
from testbed.datasets.loading import require_pandas
from testbed.formats import LogError, open_log
from tests.shell import call

DRAWS = ("--draw", "lidar=lds01,rplidar_a2", "--draw", "noise=0.5..2")


def test_arrays_are_the_frames(made):
    dataset = open_dataset(made / "office-0001")
    frames = open_log(made / "office-0001").frames
    scans = [frame for frame in frames if frame.scan is not None]
    np.testing.assert_array_equal(dataset.scans, [frame.scan.ranges for frame in scans])
    np.testing.assert_array_equal(dataset.angles, [frame.scan.angles for frame in scans])
    np.testing.assert_array_equal(dataset.time_offsets, [frame.scan.time_offsets for frame in scans])
    for name in ("odometry", "truth", "twist", "command"):
        np.testing.assert_array_equal(getattr(dataset, name), [getattr(frame, name) for frame in scans])
    np.testing.assert_array_equal(dataset.stamps, [frame.stamp for frame in scans])
    assert [frame.stamp for frame in dataset] == [frame.stamp for frame in frames]
    assert (dataset.mount, len(dataset)) == (scans[0].scan.mount, len(scans))
    assert dataset.range_limits == (scans[0].scan.range_min, scans[0].scan.range_max)
    np.testing.assert_allclose(read_tum(made / "office-0001" / "truth.tum").poses, dataset.truth, atol=1e-9)
    assert dataset.truth_map.occupied.any()


def test_a_slice_of_time_is_those_scans(made):
    dataset = open_dataset(made / "office-0001")
    part = dataset.between(1.0, 3.0)
    inside = (dataset.stamps >= 1.0) & (dataset.stamps < 3.0)
    assert 0 < inside.sum() < len(dataset)
    np.testing.assert_array_equal(part.scans, dataset.scans[inside])
    np.testing.assert_array_equal(part.truth, dataset.truth[inside])


def test_scans_with_varying_beams_are_padded(tmp_path):
    common = ("--duration", "3", "--format", "rosbag2-lean", "--out", tmp_path)
    assert call("simulate", "office", "--lidar", "rplidar_a1", *common) == 0
    (path,) = datasets_in(tmp_path)
    dataset = open_dataset(path)
    scans = [frame.scan for frame in open_log(path).frames if frame.scan is not None]
    assert dataset.scans.shape == (len(scans), max(scan.ranges.size for scan in scans))
    for row, angles, scan in zip(dataset.scans, dataset.angles, scans, strict=True):
        count = scan.ranges.size
        np.testing.assert_array_equal(row[:count], scan.ranges)
        np.testing.assert_array_equal(angles[:count], scan.angles)
        assert np.isnan(row[count:]).all()
        assert np.isnan(angles[count:]).all()


def test_pandas_has_a_row_for_each_frame(made):
    pytest.importorskip("pandas")
    dataset = open_dataset(made / "loop-0002")
    table = dataset.to_pandas()
    assert len(table) == len(dataset.table)
    scans = table[table.lidar.notna()]
    np.testing.assert_array_equal(np.stack(scans.ranges.to_list()), dataset.scans)
    np.testing.assert_array_equal(scans[["truth_x", "truth_y", "truth_theta"]], dataset.truth)
    index = open_collection(made).to_pandas()
    assert list(index.columns) == list(COLUMNS)


def test_a_collection_is_no_dataset(made):
    with pytest.raises(LogError, match=r"holds 9 datasets; name one, such as .*loop-0000, or .* open_collection"):
        open_dataset(made)


def test_a_recording_without_settings_has_a_repr(made, tmp_path):
    (tmp_path / "config.toml").write_text("")
    assert repr(open_dataset(tmp_path)) == f"<Dataset {tmp_path.name!r}: not read yet>"


def test_one_dataset_is_no_collection(made):
    with pytest.raises(LogError, match="use open_dataset"):
        open_collection(made / "office-0002")


def test_one_dataset_is_a_collection_without_an_index(made, tmp_path):
    shutil.copytree(made / "loop-0000", tmp_path / "loop-0000")
    (row,) = open_collection(tmp_path).rows
    assert row == next(row for row in open_collection(made).rows if row["dataset"] == "loop-0000") | {
        "split": "train",
        "overlap": None,
        "same_places": None,
    }


def test_what_is_no_collection_is_refused(made, tmp_path):
    with pytest.raises(LogError, match=r"no datasets in it; `testbed simulate"):
        open_collection(tmp_path)
    for name in ("loop-0000", "loop-0001"):
        shutil.copytree(made / name, tmp_path / "unindexed" / name)
    with pytest.raises(LogError, match=r"no datasets\.parquet; `testbed datasets index"):
        open_collection(tmp_path / "unindexed")
    shutil.copy(made / "datasets.parquet", tmp_path)
    with pytest.raises(LogError, match=r"the index names .* which is not there"):
        open_collection(tmp_path)
    (tmp_path / "datasets.parquet").write_bytes(b"PAR1 and so on")
    with pytest.raises(LogError, match=r"datasets\.parquet: damaged"):
        open_collection(tmp_path)
    with pytest.raises(LogError, match="no such file"):
        open_dataset(tmp_path / "nothing")


def test_reprs_are_one_line(made):
    collection = open_collection(made)
    dataset = collection[0]
    assert collection[dataset.path.name].path == dataset.path
    with pytest.raises(KeyError, match="office-9999: no dataset of this collection"):
        collection["office-9999"]
    assert repr(dataset).endswith("create3, lds01, 6.0 s, not read yet>") or "rplidar_a2, 6.0 s" in repr(dataset)
    _ = dataset.scans
    for shown in (collection, dataset, dataset.log, next(iter(dataset))):
        assert len(repr(shown)) < 150
        assert "\n" not in repr(shown)


def test_the_code_of_the_docs_runs(made, monkeypatch, capsys):
    pytest.importorskip("pandas")
    text = (Path(__file__).parents[3] / "docs" / "datasets.md").read_text()
    monkeypatch.chdir(made.parent)
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 6
    assert call("convert", made / "office-0001", made.parent / "bag", "--to", "rosbag2") == 0
    for block in blocks:
        exec(block.replace('Path("data/office-0001")', 'Path("bag")'), {})
    assert "predicting no motion" in capsys.readouterr().out


def test_a_choice_without_datasets_is_a_warning(made, tmp_path):
    collection = open_collection(made)
    with pytest.warns(UserWarning, match="no dataset has lidar lds1, only lds01, rplidar_a2"):
        assert len(collection.where(lidar="lds1")) == 0
    with pytest.warns(UserWarning, match="no dataset has world loop and seed 7|no dataset has seed 7, only 0, 1, 2"):
        collection.where(world="loop", seed=7)
    for name in ("loop-0000", "loop-0001"):
        shutil.copytree(made / name, tmp_path / name)
    assert call("datasets", "index", tmp_path) == 0
    with pytest.warns(UserWarning, match="only train. Nothing for validation and test: there is one world"):
        open_collection(tmp_path).split("test")


def test_without_pandas_the_command_for_this_python_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=re.escape(f"{sys.executable} -m pip install pandas")):
        require_pandas()
