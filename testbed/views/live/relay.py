# SPDX-License-Identifier: MIT
"""Follows a recording while it is written and sends it to a viewer: `python -m testbed.views.live.relay JOB`.

It ends with status 0 after the recording's end was delivered, and 1, with the reason on stderr, when the viewer is
gone. When its stdin ends, so has the run that started it: it delivers what there is and ends too.

An .rrd file is a header of 12 bytes, then messages of two little-endian 64-bit numbers, kind and length, and as many
bytes (Rerun 0.41, seen in its files; the relay's test fails if that changes). The stores are announced by messages of
kind 1; data have kind 2; kind 0 ends the file.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NoReturn
from urllib.parse import urlsplit

HEADER_BYTES = 12
MESSAGE = struct.Struct("<QQ")
END, ANNOUNCEMENT = 0, 1
POLL = 0.1
"""Time between two looks at the file [s]."""
START_TIMEOUT = 60.0
"""Longest start of a viewer [s]."""
SEND_TIMEOUT = 15.0
"""A viewer that takes nothing for so long is lost [s]."""
LAST_DELIVERY = 30.0
"""The longest that a viewer is sent what is left after the run has ended [s]."""


class ViewerLostError(Exception):
    """The viewer is gone; the message says what is known."""


def batches(source: IO[bytes], gone: threading.Event) -> Iterator[bytes]:
    """Recordings that each hold what has come since the one before, until the file's end or until `gone` is set."""
    header, announcements, waiting, ended = b"", b"", b"", False
    while not ended:
        last_look = gone.is_set()
        waiting += source.read()
        if not header and len(waiting) >= HEADER_BYTES:
            header, waiting = waiting[:HEADER_BYTES], waiting[HEADER_BYTES:]
        start = end = 0
        while header and len(waiting) >= end + MESSAGE.size and not ended:
            kind, length = MESSAGE.unpack_from(waiting, end)
            stop = end + MESSAGE.size + length
            if len(waiting) < stop:
                break
            ended = kind == END
            if kind == ANNOUNCEMENT:
                announcements += waiting[end:stop]
            if not ended:
                end = stop
        if end > start:
            yield header + announcements + waiting[start:end]
            waiting = waiting[end:]
        if last_look:
            return
        if not ended:
            gone.wait(POLL)


def await_listener(url: str, program: subprocess.Popen[bytes] | None) -> None:
    """Wait until somebody listens at the URL; without a program of ours there is no wait.

    Raises:
        ViewerLostError: nobody does.
    """
    parts = urlsplit(url)
    default = 80 if parts.scheme == "rerun+http" else 443
    deadline = time.monotonic() + START_TIMEOUT
    while True:
        try:
            socket.create_connection((parts.hostname or "", parts.port or default), timeout=5.0).close()
            return
        except OSError as error:
            if program is None:
                raise ViewerLostError(f"nobody listens: {error}") from error
            if program.poll() is not None or time.monotonic() > deadline:
                raise ViewerLostError("the viewer did not start") from error
        time.sleep(POLL)


def send(
    source: IO[bytes], job: dict[str, Any], gone: threading.Event, program: subprocess.Popen[bytes] | None
) -> None:
    """Send the recording to the job's URL, to its end.

    Raises:
        ViewerLostError: the viewer was closed or takes nothing.
    """
    import rerun as rr

    from testbed.views.rerun import entities
    from testbed.views.rerun.blueprints import blueprint
    from testbed.views.rerun.scene.scenery import Scenery

    warnings.simplefilter("ignore", rr.error_utils.RerunWarning)  # each batch is a file without footer
    rec = rr.RecordingStream(entities.APPLICATION, recording_id=job["run"])
    rec.set_sinks(rr.GrpcSink(job["url"]), default_blueprint=blueprint(Scenery.from_json(job["scenery"])))
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder) / "part.rrd"
        for batch in batches(source, gone):
            part.write_bytes(batch)
            reader = rr.chunk.RrdReader(part)
            if reader.recordings():  # else it holds the blueprint only, which the sink has sent
                rec.send_chunks(reader.stream())
            try:
                rec.flush(timeout_sec=SEND_TIMEOUT)
            except RuntimeError as error:
                raise ViewerLostError("connection lost") from error
            if program is not None and program.poll() is not None:
                raise ViewerLostError("the viewer was closed")


def await_end_of_stdin(gone: threading.Event, server: subprocess.Popen[bytes] | None) -> None:
    """Set `gone` when the other end of stdin is closed, by whatever way the run ended.

    What the viewer has not taken soon after that, it does not get: Rerun's calls may wait for it without limit. The
    server of ours, if there is one, ends then too.
    """
    sys.stdin.buffer.read()
    gone.set()
    time.sleep(LAST_DELIVERY)
    if server is not None:
        server.terminate()
    sys.stderr.write("the viewer took nothing any more\n")
    _exit(1)


def relay(job: dict[str, Any]) -> None:
    """Start the job's program, if it has one, and feed it.

    job: recording, run (its id), scenery (see `Scenery.to_json`), url, and where a viewer is to be started its
    command as `program`; `serving` where that is a server that shall end with the run

    Raises:
        ViewerLostError: the viewer is gone.
    """
    gone, program = threading.Event(), None
    with open(job["recording"], "rb") as source, tempfile.TemporaryFile() as output:
        if "program" in job:
            program = subprocess.Popen(
                job["program"], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=output
            )
        server = program if job.get("serving") else None
        threading.Thread(target=await_end_of_stdin, args=(gone, server), daemon=True).start()
        try:
            await_listener(job["url"], program)
            send(source, job, gone, program)
        except ViewerLostError:
            if program is not None and program.poll() not in (None, 0):
                output.seek(0)
                sys.stderr.write(output.read().decode(errors="replace"))
            raise
        finally:
            if program is not None and job.get("serving"):
                while program.poll() is None and not gone.wait(POLL):
                    pass
                program.terminate()
                program.wait()


def main() -> None:
    """Relay the job that the first argument gives as JSON."""
    try:
        relay(json.loads(sys.argv[1]))
    except ViewerLostError as error:
        sys.stderr.write(f"{error}\n")
        _exit(1)  # here: when the error goes, so does its stream, which waits without limit for a viewer that hangs
    _exit(0)


def _exit(status: int) -> NoReturn:
    """End the process; the usual end waits for its streams, without limit if the viewer hangs."""
    sys.stderr.flush()
    os._exit(status)


if __name__ == "__main__":
    main()
