# SPDX-License-Identifier: MIT
"""The report in headless Chromium: no console error, no request, nothing blank, nothing wider than a phone."""

import html
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from eval.report.comparison import write_comparison
from eval.report.run_report import write_report
from tests.eval.synthetic_run import write_run

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install --no-install-recommends chromium"),
]


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    runs = {
        "good": write_run(folder / "good"),
        "broken": write_run(folder / "broken", broken=True),
        "log": write_run(folder / "log", truth=False),
    }
    pages = {name: write_report(run) for name, run in runs.items()}
    pages["comparison"] = write_comparison(list(runs.values()), folder / "comparison.html")
    return pages


def browse(page: Path, profile: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Open a page with no network; the messages of its console go to stderr."""
    command = [
        str(CHROMIUM),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--hide-scrollbars",
        "--enable-logging=stderr",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        f"--user-data-dir={profile}",
        *options,
        page.as_uri(),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)


@pytest.mark.parametrize("name", ["good", "broken", "log", "comparison"])
def test_a_page_is_drawn_without_a_console_message(pages, tmp_path, name):
    shot = tmp_path / "shot.png"
    done = browse(pages[name], tmp_path / "profile", "--window-size=1240,2400", f"--screenshot={shot}")
    assert "CONSOLE" not in done.stderr
    picture = imread(shot)[:, :, :3]
    assert picture.shape[:2] == (2400, 1240)
    # Every band of the page down to its end shows something: text, a plot or a map.
    drawn = np.ptp(picture.reshape(2400, -1), axis=1) > 0.3
    last = np.flatnonzero(drawn)[-1]
    assert last > 1200
    assert np.diff(np.flatnonzero(drawn[: last + 1])).max() < 120


@pytest.mark.parametrize(
    ("name", "colour"), [("good", (43, 138, 62)), ("broken", (201, 42, 42)), ("log", (92, 102, 112))]
)
def test_the_badge_has_the_colour_of_the_outcome(pages, tmp_path, name, colour):
    shot = tmp_path / "shot.png"
    browse(pages[name], tmp_path / "profile", "--window-size=1240,600", f"--screenshot={shot}")
    top = np.rint(255.0 * imread(shot)[:100, :, :3]).astype(int)
    assert (np.abs(top - colour).max(axis=2) <= 3).sum() > 300


@pytest.mark.parametrize("name", ["good", "broken", "log", "comparison"])
def test_a_page_fits_a_phone_and_all_pictures_load(pages, tmp_path, name):
    frame = tmp_path / "phone.html"
    page = html.escape(pages[name].read_text())
    frame.write_text(
        f'<iframe id="f" style="width:390px;height:800px;border:0" srcdoc="{page}"></iframe>'
        "<script>onload = () => { const d = document.getElementById('f').contentDocument;"
        "const broken = [...d.images].filter(i => i.naturalWidth === 0).length;"
        "document.title = `width ${d.documentElement.scrollWidth} broken ${broken} of ${d.images.length}`; }</script>"
    )
    done = browse(frame, tmp_path / "profile", "--virtual-time-budget=10000", "--dump-dom")
    width, broken, images = map(int, re.search(r"width (\d+) broken (\d+) of (\d+)", done.stdout).groups())
    assert width <= 390
    assert broken == 0
    assert images >= 3


def test_a_report_prints_on_a_few_pages(pages, tmp_path):
    pdf = tmp_path / "report.pdf"
    browse(pages["good"], tmp_path / "profile", "--no-pdf-header-footer", f"--print-to-pdf={pdf}")
    content = pdf.read_bytes()
    assert content.startswith(b"%PDF")
    assert 2 <= len(re.findall(rb"/Type /Page\b", content)) <= 8
