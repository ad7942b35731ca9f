# SPDX-License-Identifier: MIT
"""Live viewers of a run. Each is fed by a process of its own that reads the recording while it is written.

Why not by the run itself: a stream of Rerun 0.41 that has a gRPC sink blocks every log call once 100 MiB wait for a
viewer that hangs, and blocks the end of the process (measured; docs/views.md). The run writes a file and nothing else;
what happens to a viewer or to a connection is the relay's business.
"""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import tempfile
from pathlib import Path

from testbed.views.live import programs
from testbed.views.rerun.scene.scenery import Scenery
from testbed.views.view import ViewOptions

logger = logging.getLogger(__name__)


class LiveViewer:
    """One relay, and the viewer that it feeds."""

    def __init__(self, name: str, relay_job: dict[str, object], address: str | None = None) -> None:
        """Start the relay; `relay_job` are the arguments of `testbed.views.live.relay.relay`."""
        self.name = name
        self.address = address
        self._output = tempfile.TemporaryFile()  # noqa: SIM115, read whenever the relay ends
        self._process = subprocess.Popen(
            [sys.executable, "-m", "testbed.views.live.relay", json.dumps(relay_job)],
            stdin=subprocess.PIPE,  # never written to: its end tells the relay that we are gone
            stdout=subprocess.DEVNULL,
            stderr=self._output,
            start_new_session=True,  # Ctrl-C ends the run, not its viewers
        )
        self._lost = False

    def check(self) -> None:
        """Warn, once, if the viewer is gone."""
        if self._lost or self._process.poll() in (None, 0):
            return
        self._lost = True
        self._output.seek(0)
        why = programs.reason(self._output.read().decode(errors="replace"))
        logger.warning("%s: %s; the run goes on, its recording is complete", self.name, why)

    def wait(self) -> None:
        """Wait until Ctrl-C if a web page is served, then end the server."""
        if self.address is None:
            return
        try:
            self._process.wait()
        except KeyboardInterrupt:
            logger.info("web viewer closed")
        finally:
            if self._process.stdin is not None:
                self._process.stdin.close()
            self._process.wait()


def start_viewers(recording: Path, run: str, scenery: Scenery, options: ViewOptions) -> list[LiveViewer]:
    """Start what the options ask for; a viewer that cannot be started costs a warning, never the run.

    recording: the file, which is there already;  run: its recording id;  scenery: what its blueprint depends on
    """
    job: dict[str, object] = {
        "recording": str(recording.resolve()),
        "run": run,
        "scenery": scenery.to_json(),
    }
    viewers = []
    if options.connect is not None:
        viewers.append(LiveViewer(f"viewer at {options.connect}", job | {"url": options.connect}))
    try:
        if options.window and programs.display_missing():
            logger.warning("no display to open the viewer on; the run goes on (the web viewer needs none)")
        elif options.window:
            port = programs.free_port()
            command = programs.window_command(port)
            viewers.append(LiveViewer("viewer", job | {"url": programs.proxy_url(port), "program": command}))
        if options.serve:
            port, web_port = programs.free_port(), programs.free_port()
            command = programs.server_command(port, web_port)
            viewers.append(
                LiveViewer(
                    "web viewer",
                    job | {"url": programs.proxy_url(port), "program": command, "serving": True},
                    programs.web_address(port, web_port),
                )
            )
    except OSError as error:
        logger.warning("no viewer: %s; the run goes on", error)
    return viewers
