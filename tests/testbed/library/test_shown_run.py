# SPDX-License-Identifier: MIT
"""What a notebook shows of a run."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

import testbed
from testbed.library import shown_run
from testbed.views import DEMO, OpenedRun
from tests.eval.synthetic_run import write_run


def drawn(page: str) -> str:
    """The drawing in a page."""
    (picture,) = re.findall(r"data:image/svg\+xml;base64,([^\"]+)", page)
    return base64.b64decode(picture).decode()


def test_a_run_shows_outcome_paths_and_the_viewer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = write_run(tmp_path / "run")
    (run / "recording.rrd").touch()
    ended: list[str] = []
    process = SimpleNamespace(terminate=lambda: ended.append("terminate"), wait=lambda: None)
    opened = OpenedRun(process=process, address="http://127.0.0.1:1/?url=a&b=c")
    monkeypatch.setattr(shown_run, "open_run", lambda path, serve: opened)
    found = testbed.show(run)
    page = found._repr_html_()
    assert repr(found).startswith("<Run run: ok, error 0.")
    assert "<svg" in drawn(page)
    assert '<iframe src="http://127.0.0.1:1/?url=a&amp;b=c"' in page
    found.close()
    assert ended == ["terminate"]
    assert "<iframe" not in testbed.show(run, viewer=False)._repr_html_()


@pytest.mark.slow
def test_the_demo_is_served_and_ends() -> None:
    found = testbed.show(DEMO)
    assert found.viewer is not None
    assert found.viewer.process.poll() is None
    found.close()
    assert found.viewer.process.poll() is not None
