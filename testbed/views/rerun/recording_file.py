# SPDX-License-Identifier: MIT
"""The file of a recording, and the errors of writing it, such as a full disk.

Rerun's own file sink loses its thread when a write fails, and a call that waits for that thread then never returns
(0.41, seen in 2 of 5 runs on a full disk). So the sink writes into a pipe that a thread of ours empties into the file;
after an error it goes on emptying the pipe, so that nothing waits.
"""

from __future__ import annotations

import os
from pathlib import Path
from threading import Thread

import rerun as rr
import rerun.blueprint as rrb
from rerun_bindings import flush_and_cleanup_orphaned_recordings

from testbed.views.rerun.released_blueprint import released

PIECE = 1 << 16
"""Bytes that are copied at a time: as much as a pipe holds."""


class RecordingFile:
    """Connects a recording stream with a file, until `close`. Raises OSError that names the file."""

    def __init__(self, path: Path, rec: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
        """Make or replace the file, and write the blueprint and all that was logged so far."""
        # Rerun (0.41) keeps a stream that nobody refers to any more, with two threads and 2 MB, until this is called.
        flush_and_cleanup_orphaned_recordings()
        self._path, self._rec = path, rec
        self._error: OSError | None = None
        self._file = path.open("wb", buffering=0)
        source, sink = os.pipe()
        self._copy = Thread(target=self._copy_from, args=(source,), name=f"writes {path.name}", daemon=True)
        self._copy.start()
        try:
            with released(blueprint) as sent:
                rec.set_sinks(rr.FileSink(f"/dev/fd/{sink}"), default_blueprint=sent)
        finally:
            os.close(sink)  # the stream has opened its own end

    def check(self) -> None:
        """Raise the error that ended the writing, if there was one."""
        if self._error is not None:
            raise OSError(self._error.errno, self._error.strerror, str(self._path)) from self._error

    def close(self) -> None:
        """End the stream's writing and complete the file. It may be called again."""
        self._rec.flush()
        self._rec.disconnect()
        self._copy.join()
        self.check()

    def _copy_from(self, source: int) -> None:
        """Write what comes out of the pipe until its other end is closed; after an error only empty it."""
        with self._file, open(source, "rb", buffering=0) as pipe:
            while piece := memoryview(pipe.read(PIECE)):
                while piece and self._error is None:
                    try:
                        piece = piece[self._file.write(piece) :]
                    except OSError as error:
                        self._error = error
