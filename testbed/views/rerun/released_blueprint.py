# SPDX-License-Identifier: MIT
"""A blueprint whose stream does not outlive its sending.

Rerun (0.41) logs a blueprint to a stream of its own, in memory, and sends what came of it. This stream and its memory
refer to each other, so that every recording would leave two threads and 2 MB behind. Once it is disconnected, they do
not.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import rerun as rr
import rerun.blueprint as rrb


class _Watched(rrb.Blueprint):
    """A blueprint that remembers the streams that it was logged to."""

    def __init__(self, blueprint: rrb.Blueprint) -> None:
        self._blueprint = blueprint
        self.streams: list[rr.RecordingStream] = []

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self.streams.append(stream)
        self._blueprint._log_to_stream(stream)


@contextmanager
def released(blueprint: rrb.Blueprint) -> Iterator[rrb.Blueprint]:
    """The blueprint to be sent within the block."""
    watched = _Watched(blueprint)
    try:
        yield watched
    finally:
        for stream in watched.streams:
            stream.disconnect()
