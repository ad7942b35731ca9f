# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure how fast datasets are written and read.

    python -m tools.measure.measure_datasets [--seconds 120] [--world office] [--backend fast]
    python -m tools.measure.measure_datasets --memory

Prints: the table of speed in docs/formats.md, with --memory the peak memory of a process that writes a long drive

Figures are simulated seconds per CPU second of one process, without start-up, and ratios to the floor: the CPU time of
the format's library alone (mcap or rosbags, sqlite3, pyarrow, gzip) to write the same content from memory. A figure is
the best of three.
"""

from __future__ import annotations

import argparse
import gzip
import os
import sqlite3
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from testbed.formats import Log, open_log
from testbed.formats.write import LogFormat, write_log
from testbed.frame_table import BLOCK_FRAMES
from testbed.simulation import SimulationConfig, simulate
from worlds import load

SUFFIX = {"rosbag1": ".bag", "carmen": ".log.gz"}
FORMATS: tuple[LogFormat, ...] = ("rosbag2", "rosbag2-lean", "rosbag2-sqlite", "rosbag1", "carmen", "parquet")
REPEATS = 3
LARGE_WORLD = "generated:rooms:size=80x60:1"
"""A world whose tour takes about two hours."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--world", default="office")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--backend", choices=("fast", "pybullet"), default="fast")
    parser.add_argument("--memory", action="store_true", help="measure memory instead, of a minute and of two hours")
    args = parser.parse_args()
    if args.memory:
        for seconds in (60.0, 7200.0):
            print(f"{LARGE_WORLD}, {seconds:.0f} s: {peak_memory(seconds):.0f} MB", flush=True)
        return
    world, config = load(args.world), SimulationConfig(backend=args.backend, duration=args.seconds)
    list(simulate(world, SimulationConfig(backend=args.backend, duration=1.0)).blocks(BLOCK_FRAMES))  # kernels loaded
    simulated = best(lambda: list(simulate(world, config).blocks(BLOCK_FRAMES)))
    log = Log.from_frames(list(simulate(world, config)), path=Path("drive"), format="simulation")
    seconds = float(log.table.stamps[-1] - log.table.stamps[0])
    print(f"{args.world}, {seconds:.0f} s, {log.scan_count} scans of {log.table.readings[0]} beams, {args.backend}")
    print(f"simulation alone: {seconds / simulated:.0f} simulated s per CPU s; start-up: {start_up():.1f} CPU s\n")
    print("| format | simulate and write | write alone | floor / write | read as arrays | read as frames | kB per s |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for log_format in FORMATS:
            row = measured(Path(folder), log, log_format)
            write, size = row["write"], row["bytes"] / seconds / 1000
            rates = (seconds / (simulated + write), seconds / write)
            reads = (seconds / row["read"], seconds / row["frames"])
            print(
                f"| `{log_format}` | {rates[0]:.0f} | {rates[1]:.0f} | {row['floor'] / write:.2f} | {reads[0]:.0f} | "
                f"{reads[1]:.0f} | {size:.0f} |"
            )


def measured(folder: Path, log: Log, log_format: LogFormat) -> dict[str, float]:
    """CPU seconds to write and read a log in one format, the floor of the library, and the size."""
    paths = iter(folder / f"{log_format}-{k}{SUFFIX.get(log_format, '')}" for k in range(REPEATS + 1))
    path = next(paths)
    write_log(path, log, log_format)  # libraries loaded
    write = best(lambda: write_log(next(paths), log, log_format))
    files = [path] if path.is_file() else [file for file in path.iterdir() if file.is_file()]
    return {
        "write": write,
        "read": best(lambda: open_log(path)),
        "frames": best(lambda: open_log(path).frames),
        "floor": best(floor(folder, path, log_format)),
        "bytes": float(sum(file.stat().st_size for file in files)),
    }


def floor(folder: Path, path: Path, log_format: LogFormat) -> Callable[[], object]:
    """What the library of a format does to write the same content from memory."""
    out = folder / "floor"
    if log_format == "parquet":
        import pyarrow.parquet as pq

        table = pq.read_table(path / "frames.parquet")
        return lambda: pq.write_table(table, out, compression="zstd")
    if log_format == "carmen":
        text = gzip.decompress(path.read_bytes())
        return lambda: out.write_bytes(packed(text))
    messages = raw_messages(path)
    if log_format == "rosbag2-sqlite":
        return lambda: write_sqlite(out, messages)
    if log_format == "rosbag1":
        return lambda: write_rosbag1(out, messages)
    return lambda: write_mcap(out, messages)


def packed(text: bytes) -> bytes:
    """A text in gzip, as quickly as zlib packs digits."""
    packer = zlib.compressobj(level=1, wbits=zlib.MAX_WBITS + 16, strategy=zlib.Z_HUFFMAN_ONLY)
    return packer.compress(text) + packer.flush()


def raw_messages(path: Path) -> list[tuple[Any, int, bytes]]:
    """Connection, time and content of all messages."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        return [(connection, time, bytes(raw)) for connection, time, raw in reader.messages()]


def write_mcap(out: Path, messages: list[tuple[Any, int, bytes]]) -> None:
    """Write messages by the mcap library, with its check sums."""
    from mcap.writer import CompressionType, Writer

    with out.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for connection, time, raw in messages:
            if connection.topic not in channels:
                schema = writer.register_schema(connection.msgtype, "ros2msg", connection.msgdef.data.encode())
                channels[connection.topic] = writer.register_channel(connection.topic, "cdr", schema)
            writer.add_message(channels[connection.topic], time, raw, time)
        writer.finish()


def write_sqlite(out: Path, messages: list[tuple[Any, int, bytes]]) -> None:
    """Write messages by sqlite3."""
    out.unlink(missing_ok=True)
    base = sqlite3.connect(out)
    base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic INTEGER, timestamp INTEGER, data BLOB)")
    rows = ((connection.id, time, raw) for connection, time, raw in messages)
    base.executemany("INSERT INTO messages (topic, timestamp, data) VALUES(?, ?, ?)", rows)
    base.execute("CREATE INDEX timestamps ON messages (timestamp ASC)")
    base.commit()
    base.close()


def write_rosbag1(out: Path, messages: list[tuple[Any, int, bytes]]) -> None:
    """Write messages by rosbags."""
    from rosbags.rosbag1 import Writer

    out.unlink(missing_ok=True)
    with Writer(out) as writer:
        connections: dict[str, Any] = {}
        for connection, time, raw in messages:
            if connection.topic not in connections:
                connections[connection.topic] = writer.add_connection(
                    connection.topic, connection.msgtype, msgdef=connection.msgdef.data, md5sum=connection.digest
                )
            writer.write(connections[connection.topic], time, raw)


def start_up() -> float:
    """CPU seconds of `testbed simulate` for a drive of a tenth of a second."""
    program = "import resource, testbed.cli as c\n"
    program += "try: c.main(['simulate', 'office', '--out', OUT, '--duration', '0.3'])\nexcept SystemExit: pass\n"
    program += "u = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]\n"
    program += "import sys; print(sum(r.ru_utime + r.ru_stime for r in u), file=sys.stderr)"
    found = []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as out:
            command = [sys.executable, "-c", program.replace("OUT", repr(out))]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
        found.append(float(done.stderr.split()[-1]))
    return min(found)


def best(function: Callable[[], object]) -> float:
    """The least CPU time of a few calls [s]."""
    found = []
    for _ in range(REPEATS):
        start = time.process_time()
        function()
        found.append(time.process_time() - start)
    return min(found)


def peak_memory(seconds: float) -> float:
    """Peak memory of a process that simulates and writes one drive of at most so many seconds [MB = 1e6 bytes]."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--duration", str(seconds), "--out", f"{folder}/data"]
        process = subprocess.Popen(
            [str(Path(sys.executable).with_name("testbed")), "simulate", LARGE_WORLD, *options],
            stdout=subprocess.DEVNULL,
        )
        _, status, used = os.wait4(process.pid, 0)
    if status:
        raise RuntimeError(f"testbed simulate ended with status {os.waitstatus_to_exitcode(status)}")
    return used.ru_maxrss * 1024 / 1e6


if __name__ == "__main__":
    main()
