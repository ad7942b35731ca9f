# SPDX-License-Identifier: MIT
"""A SLAM system that is a program of any language: it reads a recording and leaves a trajectory and maybe a map.

The command is split as a shell does it, and started without a shell. In its words `{dataset}` stands for the recording
in a format that is chosen, without the truth, `{out}` for an empty directory, `{seed}` for the seed. The program leaves
`trajectory.tum` and, if it has one, `map.yaml` with its picture in `{out}`, and ends with status 0.

It runs in a process group of its own, which is killed as a whole when it ends, or takes too much time or memory.
"""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from eval.files.map_server import read_map
from eval.files.trajectory_file import read_trajectory
from testbed.formats import Log
from testbed.formats.write import write_log
from testbed.frame import Frame
from testbed.systems.errors import SystemFailedError, SystemsError
from testbed.systems.feeding import Cost, Estimated, Step, estimated_from, shown_to_systems

CHECK_PERIOD = 0.05
"""Period at which time and memory are checked [s]."""
INTERPRETERS, SCRIPTS = ("python", "sh", "bash", "julia"), {".py", ".sh", ".jl"}
"""Programs that are named by the script that they run, and the suffixes of scripts."""
LAST_LINES = 3
"""So many of the last lines of a program that failed are in the message."""
MAX_TAIL = 20_000
"""So much of the end of its output is read for them [bytes]."""
DatasetFormat = Literal["rosbag2", "rosbag2-lean", "rosbag2-sqlite", "rosbag1", "carmen", "carmen-flaser", "parquet"]
"""Formats that hold scans, see `testbed.formats.write.LogFormat`."""
SUFFIXES: dict[DatasetFormat, str] = {"rosbag1": ".bag", "carmen": ".log", "carmen-flaser": ".log"}
"""Suffix of `{dataset}` by format; the others are directories."""


@dataclass(frozen=True, kw_only=True)
class Program:
    """A program as a system."""

    command: str
    """The command, with `{dataset}` and `{out}` in it."""
    log_format: DatasetFormat = "rosbag2"
    """Format of the recording."""
    seconds: float = 3600.0
    """Time limit [s]."""
    megabytes: float | None = None
    """Limit of the resident memory of all its processes [MB]; None = none."""
    keep_log: Path | None = None
    """Directory in which `program.log`, all that the program prints, is kept; None = it is not kept."""
    label: str = ""
    """Name of its directory and in tables, if it is not that of the program."""
    version: str = "unknown"

    def __post_init__(self) -> None:
        for place in ("{dataset}", "{out}"):
            if place not in self.command:
                raise SystemsError(f"{self.command!r}: expected {place} in the command")
        if not self.seconds > 0.0:
            raise SystemsError(f"{self.name}: the time limit must be positive, got {self.seconds} s")
        if self.megabytes is not None and not self.megabytes > 0.0:
            raise SystemsError(f"{self.name}: the memory limit must be positive, got {self.megabytes} MB")
        if shutil.which(self.words[0]) is None:
            raise SystemsError(f"{self.words[0]}: no such program, expected one that can be executed")

    @property
    def words(self) -> list[str]:
        """The words of the command. Raises SystemsError where a quote is left open."""
        return _words(self.command)

    @property
    def name(self) -> str:
        """Name of its directory and in tables."""
        return self.label or program_name(self.command)

    def facts(self) -> dict[str, Any]:
        """Name, version and settings, for `config.toml`."""
        settings = {"command": self.command, "format": self.log_format, "time_limit": self.seconds}
        return {"name": self.name, "version": self.version, "settings": settings | {"memory_limit": self.megabytes}}

    def run(self, frames: Sequence[Frame], seed: int, step: Step | None = None) -> tuple[Estimated, Cost]:
        """Write the recording, run the program, and read what it left; SystemFailedError where that fails."""
        with tempfile.TemporaryDirectory(prefix="testbed-") as folder:
            dataset, out = Path(folder) / f"dataset{SUFFIXES.get(self.log_format, '')}", Path(folder) / "out"
            shown = [shown_to_systems(frame) for frame in frames]
            write_log(dataset, Log.from_frames(shown, path=dataset, format="frames"), self.log_format)
            out.mkdir()
            places = {"{dataset}": str(dataset), "{out}": str(out), "{seed}": str(seed)}
            log = Path(folder) / "program.log"
            try:
                used = self._execute([_filled(word, places) for word in self.words], log)
            finally:
                if self.keep_log is not None and log.is_file():
                    shutil.copyfile(log, self.keep_log / "program.log")
            estimated = self._result(frames, out, log)
        scans = sum(frame.scan is not None for frame in frames)
        return estimated, Cost(
            wall_s=used.wall_s, cpu_s=used.cpu_s, ms_per_scan=1e3 * used.wall_s / scans, memory_mb=used.memory_mb
        )

    def _execute(self, words: Sequence[str], log: Path) -> Cost:
        """Run the command to its end; its output goes to the file `log`."""
        began, peak, pid = time.monotonic(), 0.0, 0
        with log.open("wb") as output:
            process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
            try:
                while True:
                    pid, status, usage = os.wait4(process.pid, os.WNOHANG)
                    if pid:
                        break
                    peak = max(peak, group_megabytes(process.pid))
                    self._check_limits(time.monotonic() - began, peak, log)
                    time.sleep(CHECK_PERIOD)
            finally:
                with suppress(ProcessLookupError):  # what it started may still run when it has ended
                    os.killpg(process.pid, signal.SIGKILL)
                if not pid:
                    os.wait4(process.pid, 0)
                process.returncode = 0  # it is waited for: subprocess must not do it again
        wall = time.monotonic() - began
        code = os.waitstatus_to_exitcode(status)
        if code != 0:
            how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit status {code}"
            raise SystemFailedError(f"{self.name}: ended {how}, expected status 0{_last_lines(log)}")
        largest = usage.ru_maxrss * 1024 / 1e6  # of a single process; a short one may end between two looks
        return Cost(wall_s=wall, cpu_s=usage.ru_utime + usage.ru_stime, memory_mb=max(peak, largest))

    def _check_limits(self, seconds: float, megabytes: float, log: Path) -> None:
        if seconds > self.seconds:
            raise SystemFailedError(f"{self.name}: exceeded the time limit of {self.seconds:g} s{_last_lines(log)}")
        if self.megabytes is not None and megabytes > self.megabytes:
            raise SystemFailedError(
                f"{self.name}: exceeded the memory limit of {self.megabytes:g} MB{_last_lines(log)}"
            )

    def _result(self, frames: Sequence[Frame], out: Path, log: Path) -> Estimated:
        """Read the trajectory and the map that the program left."""
        path, map_file = out / "trajectory.tum", out / "map.yaml"
        if not path.is_file():
            left = ", ".join(sorted(entry.name for entry in out.iterdir())) or "nothing"
            raise SystemFailedError(f"{self.name}: left {left} in {{out}}, expected trajectory.tum{_last_lines(log)}")
        try:
            trajectory, _ = read_trajectory(path)
            grid = read_map(map_file) if map_file.is_file() else None
        except (ValueError, OSError) as error:
            words = str(error).replace(f"{out}/", "")
            raise SystemFailedError(f"{self.name}: {words}{_last_lines(log)}") from None
        return estimated_from(self.name, frames, trajectory, grid)


def program_name(command: str) -> str:
    """Return the name of a command: that of the program, or of the script that an interpreter runs."""
    words = [Path(word) for word in _words(command)]
    scripts = [word for word in words[1:] if word.suffix in SCRIPTS]
    return scripts[0].stem if scripts and words[0].name.startswith(INTERPRETERS) else words[0].name


def _words(command: str) -> list[str]:
    try:
        return shlex.split(command)
    except ValueError as error:
        raise SystemsError(f"{command!r}: {error}") from None


def group_megabytes(group: int) -> float:
    """Return the resident memory of all processes of a session or a process group [MB]; 0 where Linux does not say."""
    pages = 0
    for entry in Path("/proc").iterdir() if Path("/proc").is_dir() else ():
        if entry.name.isdecimal():
            with suppress(OSError, IndexError, ValueError):  # it has ended meanwhile
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                if group in (int(fields[2]), int(fields[3])):
                    pages += int(fields[21])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _filled(word: str, places: dict[str, str]) -> str:
    for place, value in places.items():
        word = word.replace(place, value)
    return word


def _last_lines(log: Path) -> str:
    """The end of what a program printed, as the end of a message; empty where it printed nothing."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - MAX_TAIL))
        lines = file.read().decode(errors="replace").splitlines()
    last = [" ".join(line.split()) for line in lines if line.strip()][-LAST_LINES:]
    printable = "".join(c if c.isprintable() else "?" for c in " | ".join(last))
    return f"; its last lines: {printable}" if printable else ""
