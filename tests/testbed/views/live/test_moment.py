# SPDX-License-Identifier: MIT
"""A viewer opens at the moment that it was asked for."""

from __future__ import annotations

import subprocess
import sys

import pytest

from testbed.views import open_run, opening
from testbed.views.live import moment, programs
from testbed.views.rerun import entities
from tests.testbed.views.conftest import Recorded
from tools.headless_viewer import NoDriverError, choose_driver


def test_the_window_opens_at_the_moment(recorded: Recorded, monkeypatch: pytest.MonkeyPatch) -> None:
    try:
        choose_driver()
        programs.viewer_binary()
    except (NoDriverError, FileNotFoundError) as error:
        pytest.skip(str(error))
    from rerun.experimental import ViewerClient

    port, command = programs.free_port(), programs.window_command
    monkeypatch.setattr(opening.programs, "display_missing", lambda: False)
    monkeypatch.setattr(opening.programs, "free_port", lambda: port)
    monkeypatch.setattr(opening.programs, "window_command", lambda port: [*command(port), "--headless"])
    run = open_run(recorded.path, moment=1.25)
    try:
        (shown,) = ViewerClient.connect(programs.proxy_url(port)).get_state().recordings
        assert (shown.current_timeline, shown.current_time) == (entities.TIMELINE, 1.25e9)
    finally:
        run.process.terminate()
        run.process.wait()


def test_a_viewer_that_has_ended_is_not_waited_for() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert not moment.show_moment(ended, programs.free_port(), 1.0)
