# SPDX-License-Identifier: MIT
"""The directory of a sweep: its specification, a directory for each finished cell, a file for each failed one.

    sweep.toml                  specification, code version, digests of the input files, versions
    cells/KEY/cell.json         the cell; metrics.json, curves.json: its result; timing.json: what it took
    failed/KEY.json             the cell and the reason why it has no result

Files and directories are written under a temporary name and renamed, so they are complete as soon as they exist. A
directory whose name is not a key was left by a killed process and is ignored.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import socket
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from eval.files.atomic_write import atomic_directory, atomic_write, create_once
from eval.sweep.margin import parse_margin
from eval.sweep.results import MarginChange, SweepTableError, read_sweep
from testbed.provenance import versions
from testbed.sweep.errors import SweepError
from testbed.sweep.result import CellResult
from testbed.sweep.spec.cell import Cell
from testbed.sweep.spec.plan import Shard, plan
from testbed.sweep.spec.spec import SweepSpec, parse_spec
from testbed.toml import dump_toml

MANIFEST = "sweep.toml"


@dataclass(frozen=True)
class Manifest:
    """Content of `sweep.toml`: everything from which the cells follow."""

    spec: SweepSpec
    code: str
    inputs: Mapping[str, str]
    commit: str = ""
    """`testbed.sweep.spec.code_version.commit`; empty in sweeps of versions up to 0.1."""
    margin_changes: tuple[MarginChange, ...] = ()
    """When another margin was chosen after results had been seen."""

    @property
    def code_words(self) -> str:
        """The code version for messages, with the commit."""
        return f"code version {self.code}" + (f", commit {self.commit}" if self.commit else "")

    def cells(self) -> list[Cell]:
        """All cells, in the order of the tables."""
        return plan(self.spec, self.code, self.inputs)

    def document(self) -> dict[str, Any]:
        """The content as plain data for TOML."""
        commit = {"commit": self.commit} if self.commit else {}
        changes = {"margin_changes": [asdict(change) for change in self.margin_changes]} if self.margin_changes else {}
        return {
            "code": self.code,
            **commit,
            **changes,
            "spec": self.spec.document(),
            "inputs": dict(self.inputs),
            "versions": versions(),
        }


@dataclass(frozen=True)
class SweepDirectory:
    """A directory with a sweep in it; `prepare` creates it, `open` reads an existing one."""

    path: Path
    manifest: Manifest

    @classmethod
    def prepare(cls, path: Path, manifest: Manifest) -> SweepDirectory:
        """Create the directory, or open it if it already holds this sweep.

        Raises SweepError if it holds something else; the message states the difference. Nothing is changed then.
        """
        if path.exists() and not path.is_dir():
            raise SweepError(f"{path}: is a file, expected a directory")
        holds_files = path.is_dir() and any(not entry.name.startswith(".") for entry in path.iterdir())
        if holds_files and not (path / MANIFEST).is_file():
            raise SweepError(f"{path}: is not empty and holds no sweep; choose another --out")
        path.mkdir(parents=True, exist_ok=True)
        if not create_once(path / MANIFEST, dump_toml(manifest.document())):
            manifest = cls._extended(path, manifest)
        for folder in ("cells", "failed"):
            (path / folder).mkdir(exist_ok=True)
        return cls(path, manifest)

    @classmethod
    def _extended(cls, path: Path, requested: Manifest) -> Manifest:
        """The manifest of the sweep in a directory, extended to the requested one where they differ."""
        present = cls.open(path)
        extended = present._extension(requested)
        if present.manifest.spec.document() == requested.spec.document():
            return extended  # without the lock: several shards of a sweep may begin at once
        with present.locked(None):
            extended = cls.open(path)._extension(requested)  # another process may have extended it meanwhile
            with atomic_write(path / MANIFEST) as temporary:
                temporary.write_text(dump_toml(extended.document()), encoding="utf-8")
        return extended

    def _extension(self, requested: Manifest) -> Manifest:
        """The manifest of a sweep with more seeds, counts or worlds than there are, or with another question.

        It has the changes of the margin so far, to which another margin is added if there are results.

        Keys of cells are hashes of everything that decides their result, so those that are done stay valid. Raises
        SweepError if the requested sweep is another one, or lacks what is there.
        """
        check_extends(self.path, self.manifest, requested)
        changes = self.manifest.margin_changes + self._change_of_margin(requested.spec.margin)
        return replace(requested, margin_changes=changes)

    def _change_of_margin(self, margin: str) -> tuple[MarginChange, ...]:
        """The change to this margin, if it is another one and results have been seen."""
        before = self.manifest.spec.margin
        if parse_margin(before) == parse_margin(margin):
            return ()
        try:
            table = read_sweep(self.path).judged()
        except SweepTableError:  # no tables yet: nobody has seen a result
            return ()
        seeds = max(map(table.seeds_of, range(len(table.places))))
        return (MarginChange(before, margin, seeds),) if seeds else ()

    @classmethod
    def open(cls, path: Path) -> SweepDirectory:
        """Read the sweep in a directory; raises SweepError if there is none."""
        file = path / MANIFEST
        try:
            document = tomllib.loads(file.read_text(encoding="utf-8"))
            code, inputs = str(document["code"]), dict(document.get("inputs", {}))
            changes = tuple(MarginChange(**change) for change in document.get("margin_changes", ()))
            spec = parse_spec(document["spec"], str(file), path)
        except FileNotFoundError:
            raise SweepError(f"{path}: expected the directory of a sweep, with {MANIFEST} in it") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
            raise SweepError(f"{file}: {error}: expected what `testbed sweep` writes") from None
        return cls(path, Manifest(spec, code, inputs, str(document.get("commit", "")), changes))

    @contextmanager
    def locked(self, shard: Shard | None) -> Iterator[None]:
        """Lock the cells against other processes while the block runs; raises SweepError if another process has them.

        A whole sweep excludes every other process; a shard excludes the same shard and whole sweeps. The operating
        system releases a lock when its process ends, however it ends.
        """
        with (self.path / ".lock").open("a+") as everybody:
            _lock(everybody, fcntl.LOCK_EX if shard is None else fcntl.LOCK_SH, self.path)
            if shard is None:
                _write_lock_owner(everybody)
                self._discard_unfinished()
                yield
                return
            everybody.truncate(0)  # its writer no longer holds the lock
            with (self.path / f".lock-{shard.index}-of-{shard.count}").open("a+") as own:
                _lock(own, fcntl.LOCK_EX, self.path)
                _write_lock_owner(own)
                yield

    def cells(self) -> list[Cell]:
        """All cells, in the order of the tables.

        Where a cell has no final pass only because other counts have it, and the run with it is there, that run takes
        its place: it holds the filter's estimate too. So a larger count repeats no run.
        """
        settled = {line.name for line in self.manifest.spec.lines() if "refine" in line.settings}
        return [cell if cell.line in settled else self._with_final_pass(cell) for cell in self.manifest.cells()]

    def _with_final_pass(self, cell: Cell) -> Cell:
        """The same cell with the final pass, if only that one has a result; else the cell itself."""
        if cell.settings["refine"] or self.is_done(cell.key):
            return cell
        refined = replace(cell, settings={**cell.settings, "refine": True})
        return refined if self.is_done(refined.key) else cell

    def is_done(self, key: str) -> bool:
        """Whether the cell with this key has a result."""
        return (self.path / "cells" / key).is_dir()

    def keep(self, cell: Cell, result: CellResult) -> None:
        """Write the result of a cell; if another process was faster, its (equal) result stays."""
        target = self.path / "cells" / cell.key
        with suppress(FileExistsError), atomic_directory(target) as temporary:
            temporary.mkdir()
            for name, content in (("cell", cell.document()), *vars(result).items()):
                (temporary / f"{name}.json").write_text(dump_json(content), encoding="utf-8")
        self._failure(cell.key).unlink(missing_ok=True)

    def keep_failure(self, cell: Cell, reason: str) -> None:
        """Write why a cell has no result."""
        with atomic_write(self._failure(cell.key)) as temporary:
            temporary.write_text(dump_json({"cell": cell.document(), "reason": reason}), encoding="utf-8")

    def result(self, key: str) -> CellResult | None:
        """Read the result of a cell; None if there is none. Raises SweepError for damaged files."""
        folder = self.path / "cells" / key
        if not folder.is_dir():
            return None
        try:
            parts = {name: json.loads((folder / f"{name}.json").read_bytes()) for name in CellResult.__annotations__}
        except (OSError, ValueError) as error:
            raise SweepError(f"{folder}: {error}; remove it, and the next sweep computes this job again") from None
        return CellResult(**parts)

    def reason(self, key: str) -> str | None:
        """Read why a cell failed; None if it did not."""
        try:
            return str(json.loads(self._failure(key).read_bytes())["reason"])
        except FileNotFoundError:
            return None
        except (ValueError, KeyError) as error:
            raise SweepError(f"{self._failure(key)}: {error}; remove it") from None

    def _discard_unfinished(self) -> None:
        """Remove the temporary directories of processes that were killed while they wrote a cell."""
        for folder in (self.path / "cells").glob(".*.tmp"):
            shutil.rmtree(folder, ignore_errors=True)

    def _failure(self, key: str) -> Path:
        return self.path / "failed" / f"{key}.json"


def dump_json(content: Any) -> str:
    """JSON text; equal content gives equal bytes."""
    return json.dumps(content, sort_keys=True, allow_nan=False, separators=(",", ":")) + "\n"


def _lock(file: TextIOWrapper, kind: int, path: Path) -> None:
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        file.seek(0)
        raise SweepError(
            f"{path}: {file.read().strip() or 'a shard'} is working on it; wait, or choose another --out"
        ) from None


def _write_lock_owner(file: TextIOWrapper) -> None:
    """Write which process holds the lock; raises OSError that names the file."""
    file.truncate(0)
    try:  # past the buffer, whose rest would be written once more when the file is closed
        os.write(file.fileno(), f"process {os.getpid()} on {socket.gethostname()}".encode())
    except OSError as error:
        error.filename = file.name
        raise


_QUESTIONS = ("title", "measure", "margin", "baseline", "until", "give_up")
"""Parts of a specification that decide no result."""
_LISTS = ("worlds", "logs", "seeds", "particles")
"""Parts to which more may be added."""


def _shown(value: Any) -> str:
    """A part of a specification in a message: `0 to 39` for seeds, `the default` for a part that is missing."""
    if value is None:
        return "the default"
    if isinstance(value, list) and len(value) > 2 and value == list(range(len(value))):
        return f"0 to {len(value) - 1}"
    if isinstance(value, list):
        return ", ".join(str(entry.get("log", entry)) if isinstance(entry, dict) else str(entry) for entry in value)
    return str(value).lower() if isinstance(value, bool) else str(value)


def _differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """What keeps one specification from being extended to another, each with what can be done about it."""
    found = []
    for key in {**old, **new}:
        there, requested = old.get(key), new.get(key)
        if key in _LISTS:
            missing = [entry for entry in there or () if entry not in (requested or ())]
            if missing:
                found.append(
                    f"{key} {_shown(there)} are there, {_shown(requested)} requested: {_cannot_shrink(key, old)}"
                )
        elif key == "settings" and there != requested:
            names = {**(there or {}), **(requested or {})}
            changed = [name for name in names if (there or {}).get(name) != (requested or {}).get(name)]
            found += [
                f"setting {name} is {_shown((there or {}).get(name))} there, {_shown((requested or {}).get(name))} "
                "requested: all runs of a sweep share their settings"
                for name in changed
            ]
        elif key == "drawn_seeds" and there is not None and (requested is None or requested > there):
            pass  # more seeds
        elif key not in _QUESTIONS and there != requested:
            found.append(f"{key} is {_shown(there)} there, {_shown(requested)} requested")
    return found


def _cannot_shrink(key: str, there: Mapping[str, Any]) -> str:
    """Why a list of a sweep only grows, and what to do instead."""
    if key == "seeds" and there.get("until"):
        return "the upper bound decides the level of the intervals, so it can be raised only (or leave out --seeds)"
    way = "; --give-up leaves a world" if key in ("worlds", "logs") and there.get("until") else ""
    return f"a sweep can grow only, so name all of them and more (or leave out --{key}){way}"


def check_extends(path: Path, there: Manifest, requested: Manifest) -> None:
    """Raise SweepError with the difference if a directory holds another sweep, or more than the requested one."""
    old, new = there.spec.document(), requested.spec.document()
    differing = _differences(old, new)
    if differing:
        raise SweepError(f"{path}: holds another sweep: {'; '.join(differing)}. Or choose another --out")
    for file in sorted(there.inputs.keys() & requested.inputs.keys()):
        if there.inputs[file] != requested.inputs[file]:
            raise SweepError(f"{file}: has changed since the sweep in {path} was started; choose another --out")
    if there.code != requested.code:
        raise SweepError(
            f"{path}: was started with {there.code_words}; this is {requested.code_words}: results would be mixed. "
            "Use that version, choose another --out, or use `testbed gather` for what is there"
        )
