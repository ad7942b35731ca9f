# SPDX-License-Identifier: MIT
"""A recording that was changed, written as a dataset directory with its truth and how it was made."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eval.files.atomic_write import atomic_directory
from eval.files.map_server import write_map
from eval.files.tum import write_tum
from eval.trajectory.trajectory import Trajectory
from testbed.datasets.simulated import ONE_FILE, DatasetFormat
from testbed.formats.checksums import seal_directory
from testbed.formats.head import LogHead
from testbed.formats.log import Log, LogError
from testbed.formats.write import write_blocks


def write_changed_log(path: Path, log: Log, original: Path, document: Mapping[str, Any], kind: DatasetFormat) -> None:
    """Write a log as a dataset directory, which must not exist and appears whole or not at all.

    It holds the recording, truth.tum (the true poses at the scans, where they are known), what a dataset directory at
    `original` says of its world (world.toml, truth_map), and config.toml with `document`.
    """
    if path.exists():
        raise LogError(f"{path}: exists; choose another name")
    with atomic_directory(path) as temporary:
        file = temporary / f"{path.name}{ONE_FILE[kind]}" if kind in ONE_FILE else temporary
        file.parent.mkdir(exist_ok=True)
        source = {"name": log.path.name, "format": log.format}
        write_blocks(file, log.table.blocks(), LogHead.of(log), kind, source=source)
        table = log.table
        known = table.scan_rows[table.known(table.truth)[table.scan_rows]]
        if len(known):
            write_tum(temporary / "truth.tum", Trajectory(table.stamps[known], table.truth[known]))
        if log.truth_map is not None:
            write_map(temporary / "truth_map.yaml", log.truth_map)
        for name in ("world.toml", "truth_map.yaml", "truth_map.pgm"):
            if (original / name).is_file() and not (temporary / name).exists():
                shutil.copyfile(original / name, temporary / name)
        seal_directory(temporary, {**document, "source": source})
