# SPDX-License-Identifier: MIT
"""Recordings with a byte changed or cut off: a complaint that names the file, or nothing but what was written."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from testbed.formats import Log, LogError, open_log
from testbed.formats.write import write_log
from tests.testbed.recordings import LOG_FORMATS, SUFFIX, assert_same, two_lidar_drive

POSITIONS = 24
"""Places that are damaged, in each file."""
RECORDINGS = {f"{log_format}{SUFFIX.get(log_format, '')}": (log_format,) for log_format in LOG_FORMATS}
"""Names of recordings, and the formats that tell what must come back."""
ALONE = {"alone.mcap": ("rosbag2",), "alone.parquet": ("parquet", "carmen"), "alone.log": ("carmen",)}
"""Single files without the check sums beside them; the table alone has no map."""


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    folder, drive = tmp_path_factory.mktemp("sound"), two_lidar_drive()
    for log_format in LOG_FORMATS:
        write_log(folder / f"{log_format}{SUFFIX.get(log_format, '')}", drive, log_format)
    write_log(folder / "alone.log", drive, "carmen")
    shutil.copy(next((folder / "rosbag2").glob("*.mcap")), folder / "alone.mcap")
    shutil.copy(next((folder / "parquet").glob("*.parquet")), folder / "alone.parquet")
    return folder


@pytest.mark.parametrize(("name", "log_formats"), (RECORDINGS | ALONE).items())
@pytest.mark.parametrize("damage", ["changed", "cut"])
def test_damage_is_reported_or_harmless(tmp_path, sound, name, log_formats, damage):
    rng = np.random.default_rng(sum(map(ord, name)))
    whole = sound / name
    reported = 0
    for number in range(POSITIONS if damage == "changed" else POSITIONS // 4):
        copy = tmp_path / str(number) / name
        copy.parent.mkdir()
        if whole.is_dir():
            shutil.copytree(whole, copy)
            file = sorted(copy.iterdir())[int(rng.integers(len(list(copy.iterdir()))))]
        else:
            shutil.copy(whole, copy)
            file = copy
        content = bytearray(file.read_bytes())
        at = int(rng.integers(len(content)))
        if damage == "cut":
            del content[at:]
        else:
            content[at] ^= int(rng.integers(1, 256))
        file.write_bytes(content)
        reported += is_reported(copy, two_lidar_drive(), log_formats, f"byte {at} of {file.name}")
        shutil.rmtree(copy.parent)
    assert reported > 0


def is_reported(path: Path, written: Log, log_formats: tuple[str, ...], what: str) -> bool:
    """Whether the reader complained, in one line that names the file; if not, it has read what was written, or says
    what it has left out."""
    try:
        read = open_log(path, scans_needed=False)
    except LogError as error:
        complaint = str(error)
        assert str(path) in complaint, what
        assert "\n" not in complaint, what
        return True
    if any("left out" in note for note in read.notes):
        return True
    try:
        assert_same(read, written, log_formats)
    except (AssertionError, AttributeError) as error:
        raise AssertionError(f"{what} changed, silently wrong: {error}") from None
    return False
