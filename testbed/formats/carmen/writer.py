# SPDX-License-Identifier: MIT
"""CARMEN logs, written: `ROBOTLASER1` for any lidar, `FLASER` for those whose angles its readers imply."""

from __future__ import annotations

import hashlib
import math
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_write
from slam import se2
from testbed.formats.beams import even_spacing, same_mount
from testbed.formats.carmen.reader import FLASER_LAYOUTS, LIDARS, MAXIMA, OFFSETS, SEAL, SEALED
from testbed.formats.head import LidarHead, LogHead
from testbed.formats.log import LogError
from testbed.frame_table import BeamPattern, Floats, FrameTable, Integers

HOST = "testbed"
PACKING = zlib.Z_HUFFMAN_ONLY
"""Strategy of gzip: digits of measured ranges hardly repeat. Without a search for repetitions, packing takes two thirds
of the time of level 1, and a twentieth less space; level 9 takes thirty times as long as level 1 and saves a fifth."""

T = TypeVar("T")
Message = Literal["ROBOTLASER", "FLASER"]


def write_carmen(
    path: str | Path, blocks: Iterable[FrameTable], head: LogHead, *, message: Message = "ROBOTLASER"
) -> None:
    """Write blocks of frames as a CARMEN log, gzip where the name ends in `.gz`; numbers keep all their digits.

    The scans of one lidar become `ROBOTLASER1` or `FLASER` lines, those of a second one `ROBOTLASER2` or `RLASER`.
    Truth goes into `TRUEPOS` lines. CARMEN cannot hold commands, `range_min` and the times of single beams, and
    `FLASER` cannot hold the twist: readings that are no hit become 0 (invalid) or `range_max` (no return), the rest is
    left out. Raises LogError where there are more lidars, where beams are not evenly spaced and, for `FLASER`, where
    its readers would imply other angles or the scans of a lidar differ in mount or range. The file appears whole or
    not at all; its last line holds the SHA-256 of all others; equal blocks give equal bytes.
    """
    path = Path(path)
    lines = _Flaser(path, head) if message == "FLASER" else _Robotlaser(path, head)
    digest = hashlib.sha256()
    with (
        atomic_write(path) as temporary,
        temporary.open("wb") as file,
        _packed(file) if path.suffix == ".gz" else nullcontext(file.write) as write,
    ):
        head_lines = "".join([f"{SEALED}\n", *lines.parameters()]).encode("ascii")
        for raw in chain((head_lines,), map(lines.text, blocks)):
            digest.update(raw)
            write(raw)
        write(f"{SEAL}{digest.hexdigest()}\n".encode("ascii"))


@contextmanager
def _packed(file: BinaryIO) -> Iterator[Callable[[bytes], object]]:
    """Give a function that writes bytes into a gzip file."""
    packer = zlib.compressobj(level=1, wbits=zlib.MAX_WBITS + 16, strategy=PACKING)  # + 16: with the head of gzip
    yield lambda raw: file.write(packer.compress(raw))
    file.write(packer.flush())


class _Lines:
    """Turns blocks of frames into lines; what both kinds of messages share."""

    KINDS: tuple[str, str]

    def __init__(self, path: Path, head: LogHead) -> None:
        self._path, self._head = path, head
        self._kinds = _kinds(path, list(head.lidars), self.KINDS)
        self._checked: dict[int, tuple[BeamPattern, Any]] = {}

    def parameters(self) -> Iterator[str]:
        """Lines before the first frame."""
        return iter(())

    def text(self, block: FrameTable) -> bytes:
        """All lines of a block; the readings, which are most of it, are copied once."""
        self._checked.clear()
        tails = [f"{stamp} {HOST} {stamp}\n" for stamp in _texts(block.stamps[:, None])]
        poses = _texts(block.odometry)
        lines: list[list[bytes | memoryview]] = [[] for _ in range(len(block))]
        truth = block.known(block.truth)
        for row, true_pose in zip(np.flatnonzero(truth).tolist(), _texts(block.truth[truth]), strict=True):
            lines[row].append(f"TRUEPOS {true_pose} {poses[row]} {tails[row]}".encode("ascii"))
        twists = _texts(block.twist[:, [0, 2]])
        bare = np.ones(len(block), dtype=bool)
        bare[block.scan_rows] = False
        for row in np.flatnonzero(bare).tolist():
            lines[row].append(f"ODOM {poses[row]} {twists[row]} 0 {tails[row]}".encode("ascii"))
        lasers = _texts(se2.compose(block.odometry[block.scan_rows], block.mounts)) if len(block.scan_rows) else []
        readings, counts = _readings(block), block.readings.tolist()
        for number, row in enumerate(block.scan_rows.tolist()):
            kind = self._kinds[block.lidars[block.scan_lidars[number]]]
            self.check(block, number)
            places = f"{lasers[number]} {poses[row]}"
            before, behind = self.scan(block, number, kind, places, twists[row])
            space = " " if counts[number] else ""
            lines[row] += [
                f"{before}{counts[number]}{space}".encode("ascii"),
                readings[number],
                f"{behind}{tails[row]}".encode("ascii"),
            ]
        return b"".join(chain.from_iterable(lines))

    def check(self, block: FrameTable, number: int) -> None:
        """Raise LogError where the log cannot hold a scan."""
        raise NotImplementedError

    def scan(self, block: FrameTable, number: int, kind: str, places: str, twist: str) -> tuple[str, str]:
        """A scan's line up to the number of its readings, and what follows the readings, up to the stamp."""
        raise NotImplementedError

    def of_pattern(self, block: FrameTable, number: int, value: Callable[[BeamPattern], T]) -> T:
        """A value that follows from a scan's beam pattern, worked out once for each pattern."""
        pattern = block.patterns[block.scan_patterns[number]]
        if id(pattern) not in self._checked:
            self._checked[id(pattern)] = pattern, value(pattern)  # keeps it, so that its id stays its own
        found: T = self._checked[id(pattern)][1]
        return found

    def complain(self, block: FrameTable, number: int, text: str) -> LogError:
        """The error for a scan that the log cannot hold."""
        return LogError(f"{self._path}: frame {block.first + int(block.scan_rows[number])}: {text}")


class _Robotlaser(_Lines):
    KINDS = ("ROBOTLASER1", "ROBOTLASER2")

    def check(self, block: FrameTable, number: int) -> None:
        """Raise LogError where the beams are not evenly spaced."""
        if self.of_pattern(block, number, _fan) is None:
            raise self.complain(block, number, "ROBOTLASER1 needs evenly spaced beams, these are not")

    def scan(self, block: FrameTable, number: int, kind: str, places: str, twist: str) -> tuple[str, str]:
        """A scan's line before and behind its readings."""
        fan, range_max = self.of_pattern(block, number, _fan), float(block.range_limits[number, 1])
        return f"{kind} 0 {fan} {range_max!r} 0 0 ", f" 0 {places} {twist} 0 0 0 "


class _Flaser(_Lines):
    KINDS = ("FLASER", "RLASER")

    def parameters(self) -> Iterator[str]:
        """The lasers' offsets and ranges, which single messages do not hold."""
        for name, kind in self._kinds.items():
            lidar: LidarHead = self._head.lidars[name]
            if not same_mount(lidar.mount, (lidar.mount[0], 0.0, math.pi if kind == "RLASER" else 0.0)):
                raise LogError(
                    f"{self._path}: {kind} cannot hold a lidar mounted at {lidar.mount}: only an offset along x"
                )
            yield f"PARAM {OFFSETS[kind]} {lidar.mount[0]!r}\n"
            if math.isfinite(lidar.range_max):
                yield f"PARAM {MAXIMA[kind]} {lidar.range_max!r}\n"

    def check(self, block: FrameTable, number: int) -> None:
        """Raise LogError where the message would imply another mount, range or angles."""
        lidar = self._head.lidars[block.lidars[block.scan_lidars[number]]]
        x, y, theta = block.mounts[number].tolist()
        if not same_mount((x, y, theta), lidar.mount) or block.range_limits[number, 1] != lidar.range_max:
            raise self.complain(block, number, "FLASER cannot hold scans that differ in mount or range_max")
        if not self.of_pattern(block, number, _is_flaser):
            count = block.readings[number]
            raise self.complain(block, number, f"FLASER implies other angles for {count} beams: write ROBOTLASER1")

    def scan(self, block: FrameTable, number: int, kind: str, places: str, twist: str) -> tuple[str, str]:
        """A scan's line before and behind its readings."""
        return f"{kind} ", f" {places} "


def _kinds(path: Path, lidars: list[str], kinds: tuple[str, str]) -> dict[str, str]:
    """Kind of message for each lidar: a rear one comes second, else their order of appearance counts."""
    if len(lidars) > len(kinds):
        raise LogError(f"{path}: scans of {len(lidars)} lidars ({', '.join(lidars)}), CARMEN has a front and a rear")
    rear = LIDARS[kinds[1]]
    others = [name for name in lidars if name != rear]
    return dict(zip(others, kinds, strict=False)) | ({rear: kinds[1]} if rear in lidars else {})


def _fan(pattern: BeamPattern) -> str | None:
    """First angle, field of view and step of evenly spaced beams as text; None where they are not."""
    spacing = even_spacing(pattern.angles)
    if spacing is None:
        return None
    start, step = spacing
    return f"{start!r} {step * (pattern.angles.size - 1)!r} {step!r}"


def _is_flaser(pattern: BeamPattern) -> bool:
    """Tell whether the angles are those that readers imply for this number of beams."""
    count = pattern.angles.size
    first, step = FLASER_LAYOUTS.get(count, (math.nan, math.nan))
    return np.allclose(pattern.angles, np.deg2rad(first + step * np.arange(count)), rtol=0.0, atol=1e-6)


def _readings(block: FrameTable) -> list[memoryview]:
    """The readings of each scan: hits as they are, the others as 0 or `range_max`."""
    ranges, limits = np.asarray(block.ranges, dtype=np.float64), np.repeat(block.range_limits, block.readings, axis=0)
    hit = (ranges >= limits[:, 0]) & (ranges > 0.0) & (ranges < limits[:, 1])
    kept = np.where(hit, ranges, np.where(ranges >= limits[:, 1], limits[:, 1], 0.0))
    texts = _joined(kept, block.scan_starts)
    _, offsets, data = texts.buffers()
    if data is None:  # no readings at all
        return [memoryview(b"")] * len(texts)
    ends = np.frombuffer(offsets, np.int32)[texts.offset : texts.offset + len(texts) + 1].tolist()
    whole = memoryview(data)
    return [whole[begin:end] for begin, end in pairwise(ends)]


def _texts(values: NDArray[np.float64]) -> list[str]:
    """The rows (n, k) as text, without a loss of digits."""
    n, k = values.shape
    texts: list[str] = _joined(np.ascontiguousarray(values).reshape(-1), k * np.arange(n + 1)).to_pylist()
    return texts


def _joined(values: Floats, starts: Integers) -> Any:
    """Runs of values as an arrow array of texts, of the shortest numbers that read back the same; starts: begin of
    each, and the end."""
    import pyarrow as pa
    import pyarrow.compute as pc

    numbers = pa.array(values).cast(pa.string())  # seven times as fast as repr
    runs = pa.ListArray.from_arrays(pa.array(starts, pa.int32()), numbers)
    return pc.binary_join(runs, " ")
