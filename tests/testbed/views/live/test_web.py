# SPDX-License-Identifier: MIT
"""The web viewer in a real browser."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from testbed.views import open_run
from testbed.views.rerun.scene.styles import ESTIMATE, ODOMETRY
from tests.browser import browser_page
from tests.testbed.views.conftest import Recorded
from tests.testbed.views.test_pictures import UNKNOWN, WALL
from tests.viewer import near

LOAD_TIMEOUT = 200.0
"""The viewer's 40 MB are compiled and drawn without a graphics card [s]."""


@pytest.mark.slow
@pytest.mark.timeout(280)
def test_the_web_viewer_draws_map_and_paths(recorded: Recorded, tmp_path: Path) -> None:
    run = open_run(recorded.path, serve=True)
    assert run.address is not None
    wanted = {"walls": (WALL, 500), "box": (UNKNOWN, 2000), "estimate": (ESTIMATE, 200), "odometry": (ODOMETRY, 200)}
    missing: list[str] = list(wanted)
    try:
        with browser_page(tmp_path / "profile") as page:
            page.open(run.address)
            deadline = time.monotonic() + LOAD_TIMEOUT
            while missing and time.monotonic() < deadline:
                time.sleep(3.0)
                picture = page.picture()
                left = picture[:, : picture.shape[1] * 3 // 5]  # where the map is
                missing = [name for name, (colour, least) in wanted.items() if near(left, colour).sum() < least]
    finally:
        run.process.terminate()
        run.process.wait()
    assert not missing
