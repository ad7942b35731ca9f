# SPDX-License-Identifier: MIT
"""The native viewer without a display: draws recordings into pictures, for documents and tests.

Needs no graphics card either: Mesa's software Vulkan driver will do (Debian: mesa-vulkan-drivers). Uses
`rerun.experimental`, as of Rerun 0.41.
"""

from __future__ import annotations

import glob
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from testbed.views.live import programs
from testbed.views.rerun import entities

DRIVERS = "/usr/share/vulkan/icd.d/lvp_icd*.json"
"""Mesa's software Vulkan."""
LOAD_TIMEOUT = 60.0
"""Longest time to read a recording [s]."""
SETTLE = 1.5
"""Until notices have faded and everything is drawn [s]."""


class NoDriverError(RuntimeError):
    """There is nothing to draw with; the message says what to install."""


class HeadlessViewer:
    """A viewer that takes recordings as files, or live at `url`. Use `headless_viewer`."""

    def __init__(self, client: Any, url: str, timeline: str) -> None:
        """client: a `rerun.experimental.ViewerClient`;  url: where it takes live recordings;  timeline: of all times"""
        self._client = client
        self.url = url
        self._timeline = timeline

    def open(self, recording: Path) -> float:
        """Open a file and wait until all of it is read; its last time [s]."""
        self._client.open(str(recording.resolve()))
        return self.await_recording()

    def await_recording(self, until: float = 0.0) -> float:
        """Wait until what is shown reaches the time `until` [s] and nothing is being loaded; its last time [s].

        Raises:
            TimeoutError: it does not within `LOAD_TIMEOUT`.
        """
        deadline = time.monotonic() + LOAD_TIMEOUT
        while time.monotonic() < deadline:
            state = self._client.get_state()
            for recording in state.recordings:
                if recording.store_id != state.active_recording or state.loading:
                    continue
                for timeline in recording.timelines:
                    if timeline.name == self._timeline and timeline.end is not None and timeline.end / 1e9 >= until:
                        return float(timeline.end / 1e9)
            time.sleep(0.2)
        raise TimeoutError(f"the viewer shows no recording up to {until} s after {LOAD_TIMEOUT:g} s")

    def picture(self, at: float, view: str | None = None, settle: float = SETTLE, largest: int | None = None) -> bytes:
        """PNG of the window, or of one view by its name, at a time [s]; its longer side at most `largest` pixels.

        Raises:
            ValueError: there is no such view.
        """
        self._client.set_time(self._timeline, duration=at, play_state="paused")
        time.sleep(settle)
        if view is None:
            return bytes(self._client.take_screenshot(max_size=largest))
        views = {drawn.name: drawn.view_id for drawn in self._client.get_state().views}
        if view not in views:
            raise ValueError(f"no view {view!r}, expected one of {', '.join(views)}")
        return bytes(self._client.take_screenshot(views[view], max_size=largest))

    def complaints(self) -> list[str]:
        """What views report about data that they could not draw."""
        return [f"{v.name}: {r.severity} {r.summary}" for v in self._client.get_state().views for r in v.reports]


@contextmanager
def headless_viewer(timeline: str = entities.TIMELINE) -> Iterator[HeadlessViewer]:
    """A viewer for the length of the context, of recordings that have this timeline.

    Raises:
        NoDriverError: there is no Vulkan driver.
        FileNotFoundError: the viewer is not installed.
    """
    choose_driver()
    from rerun.experimental import ViewerClient

    port = programs.free_port()
    client = ViewerClient.spawn(
        headless=True,
        port=port,
        memory_limit=programs.VIEWER_MEMORY,
        hide_welcome_screen=True,
        detach_process=False,
        executable_path=programs.viewer_binary(),
    )
    with client:
        yield HeadlessViewer(client, programs.proxy_url(port), timeline)


def choose_driver() -> None:
    """Take Mesa's software driver, unless VK_ICD_FILENAMES names one; it draws the same on every machine."""
    if not sys.platform.startswith("linux") or os.environ.get("VK_ICD_FILENAMES"):
        return
    found = sorted(glob.glob(DRIVERS))
    if not found:
        raise NoDriverError(f"no software Vulkan driver, nothing matches {DRIVERS}; install mesa-vulkan-drivers")
    os.environ["VK_ICD_FILENAMES"] = found[0]
