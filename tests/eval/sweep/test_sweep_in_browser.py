# SPDX-License-Identifier: MIT
"""The report of a sweep in headless Chromium: no console message, nothing wider than a phone or a sheet of paper."""

import html
import re

import pytest

from eval.sweep.report import DRAWINGS, write_sweep_report
from tests.eval.report.test_report_in_browser import CHROMIUM, browse
from tests.eval.synthetic_sweep import write_sweep

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install --no-install-recommends chromium"),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    return write_sweep_report(write_sweep(tmp_path_factory.mktemp("sweep")))


def test_it_fits_a_phone_and_all_figures_load_without_a_message(page, tmp_path):
    frame = tmp_path / "phone.html"
    frame.write_text(
        f'<iframe id="f" style="width:390px;height:800px;border:0" srcdoc="{html.escape(page.read_text())}"></iframe>'
        "<script>onload = () => { const d = document.getElementById('f').contentDocument;"
        "const drawn = [...d.images].filter(i => i.naturalWidth > 0).length;"
        "document.title = `width ${d.documentElement.scrollWidth} drawn ${drawn}`; }</script>"
    )
    done = browse(frame, tmp_path / "profile", "--virtual-time-budget=10000", "--dump-dom")
    assert "CONSOLE" not in done.stderr
    width, drawn = map(int, re.search(r"width (\d+) drawn (\d+)", done.stdout).groups())
    assert width <= 390
    assert drawn == len(DRAWINGS)


def test_the_first_screen_has_the_answers_and_the_figure_that_decides(tmp_path):
    """Undecided answers, whose cards are the longest, in a window of 1400 by 900 pixels."""

    def noisy(p, k, c, s):
        return 0.02 + 0.001 * (0.0, 6.0 * ((5 * s) % 8 - 3.5) / 3.5, 0.0)[c]

    page = write_sweep_report(write_sweep(tmp_path / "sweep", noisy, seeds=8, about={"level": 0.99}))
    frame = tmp_path / "screen.html"
    frame.write_text(
        f'<iframe id="f" style="width:1400px;height:900px;border:0" srcdoc="{html.escape(page.read_text())}"></iframe>'
        "<script>onload = () => { const d = document.getElementById('f').contentDocument;"
        "document.title = `${d.images[0].alt} ends at ${Math.ceil(d.images[0].getBoundingClientRect().bottom)}`; }"
        "</script>"
    )
    done = browse(frame, tmp_path / "profile", "--virtual-time-budget=10000", "--dump-dom")
    title = re.search(r"<title>(What decides.*) ends at (\d+)</title>", done.stdout)
    assert title.group(1) == next(drawing.title for drawing in DRAWINGS if drawing.decides)
    assert int(title.group(2)) <= 900


def test_it_prints_on_a_few_pages(page, tmp_path):
    pdf = tmp_path / "sweep.pdf"
    browse(page, tmp_path / "profile", "--no-pdf-header-footer", f"--print-to-pdf={pdf}")
    assert 3 <= len(re.findall(rb"/Type /Page\b", pdf.read_bytes())) <= 9
