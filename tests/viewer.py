# SPDX-License-Identifier: MIT
"""The native Rerun viewer without a display: takes recordings as files or live, gives pictures of what it shows."""

from __future__ import annotations

import glob
import io
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from testbed.views import programs

DRIVERS = "/usr/share/vulkan/icd.d/lvp_icd*.json"
"""Mesa's software Vulkan."""
LOAD_TIMEOUT = 60.0
"""Longest time to read a recording [s]."""


class Viewer:
    """A headless viewer at `url`."""

    def __init__(self, client: Any, url: str) -> None:
        self._client = client
        self.url = url

    def open(self, recording: Path) -> None:
        """Open a file and wait until all of it is read."""
        self._client.open(str(recording.resolve()))
        self.await_recording()

    def await_recording(self, timeline: str = "sim_time", until: float = 0.0) -> Any:
        """The state once the shown recording reaches the time `until` [s] and nothing is being loaded."""
        deadline = time.monotonic() + LOAD_TIMEOUT
        while time.monotonic() < deadline:
            state = self._client.get_state()
            for recording in state.recordings:
                ends = [t.end for t in recording.timelines if t.name == timeline and t.end is not None]
                shown = recording.store_id == state.active_recording and not state.loading
                if shown and ends and ends[0] / 1e9 >= until:
                    return state
            time.sleep(0.2)
        raise AssertionError(f"no recording up to {until} s after {LOAD_TIMEOUT} s")

    def picture(self, view: str, at: float) -> np.ndarray:
        """The named view at a time [s], (rows, cols, 3) uint8."""
        self._client.set_time("sim_time", duration=at, play_state="paused")
        time.sleep(1.5)  # notices fade
        chosen = next(v.view_id for v in self._client.get_state().views if v.name == view)
        png = self._client.take_screenshot(chosen)
        return np.rint(255.0 * matplotlib.image.imread(io.BytesIO(png))[..., :3]).astype(np.uint8)

    def complaints(self) -> list[str]:
        """What views report about data that they could not draw."""
        return [f"{v.name}: {r.severity} {r.summary}" for v in self._client.get_state().views for r in v.reports]


@contextmanager
def headless_viewer() -> Iterator[Viewer]:
    """A viewer for the length of the context; skips the test where it cannot draw."""
    if sys.platform.startswith("linux") and "VK_ICD_FILENAMES" not in os.environ:
        found = sorted(glob.glob(DRIVERS))
        if not found:
            pytest.skip(f"no software Vulkan: nothing matches {DRIVERS} (apt-get install mesa-vulkan-drivers)")
        os.environ["VK_ICD_FILENAMES"] = found[0]
    from rerun.experimental import ViewerClient

    port = programs.free_port()
    client = ViewerClient.spawn(
        headless=True,
        port=port,
        memory_limit="2GB",
        hide_welcome_screen=True,
        detach_process=False,
        executable_path=programs.viewer_binary(),
    )
    with client:
        yield Viewer(client, programs.proxy_url(port))


def near(picture: np.ndarray, colour: tuple[int, int, int], tolerance: int = 40) -> np.ndarray:
    """Pixels (rows, cols) whose channels all lie within the tolerance of a colour."""
    return (np.abs(picture.astype(int) - colour) <= tolerance).all(axis=-1)
