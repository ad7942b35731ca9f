# SPDX-License-Identifier: MIT
"""Lets a viewer that has just been opened show a moment of what it reads. A recording cannot say so itself."""

from __future__ import annotations

import logging
import subprocess
import time

from testbed.views.live import programs
from testbed.views.rerun.entities import TIMELINE

logger = logging.getLogger(__name__)

PATIENCE = 60.0
"""Longest time to wait until the viewer has read its recordings [s]."""
POLL_PERIOD = 0.3
"""[s]"""


def show_moment(viewer: subprocess.Popen[bytes], port: int, seconds: float) -> bool:
    """Let the viewer that listens at a port of this machine pause at a time [s] once it has read its recordings.

    Returns whether it does; a viewer that was closed, or does not answer, is no error.
    """
    from rerun.experimental import ViewerClient

    client, deadline = None, time.monotonic() + PATIENCE
    while time.monotonic() < deadline and viewer.poll() is None:
        try:
            client = client or ViewerClient.connect(programs.proxy_url(port))
            state = client.get_state()
            if state.active_recording is not None and not state.loading:
                client.set_time(TIMELINE, duration=seconds, play_state="paused")
                return True
        except (ConnectionError, RuntimeError) as error:  # it has not started to listen yet
            logger.debug("the viewer does not answer yet: %s", error)
        time.sleep(POLL_PERIOD)
    return False
