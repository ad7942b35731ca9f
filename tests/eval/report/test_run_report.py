# SPDX-License-Identifier: MIT
"""The report: one file that needs nothing else, says the right thing, and works whatever a run knows."""

import base64
import json
import re
import shutil
from html.parser import HTMLParser

import numpy as np
import pytest

from eval.files.failure_json import read_finding, write_finding
from eval.files.run_reader import RunFilesError, read_run
from eval.first_failure import find, first_bad_match, first_bad_stretch
from eval.report.run_report import write_report
from eval.report.verdict import verdict
from eval.trajectory.relations import Relations
from eval.trajectory.trajectory import Trajectory
from eval.wording import length, share, spread
from slam.se2 import between
from tests.eval.synthetic_run import BREAK, write_run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return {
        "good": write_run(folder / "good"),
        "broken": write_run(folder / "broken", broken=True),
        "log": write_run(folder / "log", truth=False),
    }


@pytest.fixture(scope="module")
def texts(runs):
    return {name: write_report(folder).read_text(encoding="utf-8") for name, folder in runs.items()}


class Page(HTMLParser):
    """Headings, pictures and addresses of a page; fails on tags that do not close."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []
        self.sources: list[str] = []
        self.text = ""
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "link", "img", "br"):
            self.open.append(tag)
        self.sources += [value for name, value in attrs if name in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("h2", "h3"):
            self.headings.append(data)
        self.text += data


@pytest.mark.parametrize("name", ["good", "broken", "log"])
def test_the_page_is_whole_and_needs_no_network(texts, name):
    text = texts[name]
    page = Page(text)
    assert page.sources
    assert all(source.startswith("data:") for source in page.sources)
    assert not re.search(r"url\(|@import|<script", text)
    for source in page.sources:
        if source.startswith("data:image"):
            kind, _, body = source.partition(";base64,")
            head = base64.b64decode(body)[:60]
            assert (b"<?xml" in head) if "svg" in kind else head.startswith(b"\x89PNG")
    assert len(text) < 3_000_000


def test_equal_runs_give_equal_bytes(runs, texts):
    assert write_report(runs["log"]).read_text(encoding="utf-8") == texts["log"]


def test_with_truth_all_sections_are_there_and_without_it_only_those_that_can_be(texts):
    with_truth = Page(texts["good"]).headings
    for heading in ("Difference", "Error by place", "Position error", "Particle ancestry", "Consistency (NEES)"):
        assert heading in with_truth
    without = Page(texts["log"]).headings
    assert {"Estimated map", "Trajectories", "Effective sample size", "Where the time goes"} <= set(without)
    assert not {"True map", "Difference", "Error by place", "Position error", "Error over time"} & set(without)


@pytest.mark.parametrize(("broken", "lead"), [(False, "Map and path hold together"), (True, "The map is broken")])
def test_a_recorded_log_is_judged_by_its_relations(tmp_path, broken, lead):
    folder = write_run(tmp_path / "intel", truth=False, relations=True, broken=broken)
    page = Page(write_report(folder).read_text())
    assert lead in page.text
    relations = json.loads((folder / "metrics.json").read_text())["relations"]
    assert f"Against {relations['pairs']} hand-checked relations" in page.text
    for part in (relations, relations["short"], relations["loops"]):
        assert f"{part['trans_mean_m']:.4f} ± {part['trans_std_m']:.4f} m" in page.text


def test_the_broken_run_is_called_broken_and_its_first_bad_scan_is_named(texts):
    page = Page(texts["broken"])
    assert "The map is broken" in page.text
    assert "Where it went wrong" in page.headings
    named = int(re.search(r"Around scan (\d+)", " ".join(page.headings))[1])
    assert BREAK <= named <= BREAK + 1.0 / 0.06
    assert "Where it went wrong" not in Page(texts["good"]).headings


def drawn(text: str, title: str) -> str:
    """The SVG of a plot."""
    source = re.search(rf'<img src="data:image/svg\+xml;base64,([^"]+)" alt="{title}', text)[1]
    return base64.b64decode(source).decode()


def test_the_bad_scan_is_drawn_where_it_was_thought_and_known_to_be(texts):
    broken, log = drawn(texts["broken"], "Around scan"), drawn(texts["log"], "Around scan")
    for label in ("true path", "estimated path", "scan, as estimated", "scan, where it truly was"):
        assert label in broken
    assert "scan, as estimated" in log
    assert "truly" not in log


def test_what_comes_from_files_is_escaped(texts):
    assert "some &lt;processor&gt;" in texts["good"]


@pytest.mark.parametrize("missing", ["steps.parquet", "estimate.tum", "map.yaml"])
def test_a_run_that_lost_a_file_still_has_a_report(runs, tmp_path, missing):
    folder = tmp_path / "run"
    shutil.copytree(runs["broken"], folder)
    (folder / missing).unlink()
    assert "The map is broken" in Page(write_report(folder).read_text()).text


def test_an_interrupted_run_says_so(tmp_path):
    (tmp_path / "metrics.json").write_text(json.dumps({"outcome": "interrupted", "reason": "no scan", "scans": 0}))
    page = Page(write_report(tmp_path).read_text())
    assert "stopped by hand" in page.text
    assert "No scan." in page.text


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("metrics.json", "{", r"metrics\.json: expected JSON"),
        ("metrics.json", "[]", r"metrics\.json: expected a JSON object"),
        ("config.toml", "a =", r"config\.toml: expected TOML"),
        ("steps.parquet", "no table", r"steps\.parquet: expected a parquet table"),
        ("finding.json", '{"scan": 1}', r"finding\.json: expected a finding"),
        ("finding.json", "[1]", r"finding\.json: expected a finding"),
        ("truth.tum", "1 2", r"truth\.tum:1: expected 8 numbers"),
    ],
)
def test_a_damaged_file_is_named(runs, tmp_path, name, content, expected):
    folder = tmp_path / "run"
    shutil.copytree(runs["log"], folder)
    (folder / name).write_text(content)
    with pytest.raises(ValueError, match=expected):
        write_report(folder)


def test_a_directory_without_a_run_is_refused(tmp_path):
    with pytest.raises(RunFilesError, match=r"expected a run directory with metrics\.json"):
        write_report(tmp_path)


# --- where it went wrong


def test_the_first_bad_stretch_is_found_where_the_path_was_bent():
    x = 0.1 * np.arange(300)
    truth = Trajectory(x, np.column_stack([x, 0.0 * x, 0.0 * x]))
    bent = truth.poses.copy()
    bent[120:, 1] += 0.3
    finding = first_bad_stretch(Trajectory(x, bent), truth)
    assert (finding.bad, finding.scan, finding.since) == (True, 120, 110)
    np.testing.assert_allclose(finding.believed, bent[120])
    np.testing.assert_allclose(finding.expected, truth.poses[120])
    fine = first_bad_stretch(truth, truth)
    assert not fine.bad
    assert first_bad_stretch(truth[:5], truth[:5]) is None


def test_without_truth_the_first_scan_that_does_not_fit_the_map_is_found():
    n = 40
    estimate = Trajectory(np.arange(n), np.column_stack([np.arange(n), np.zeros(n), np.zeros(n)]))
    steps = {
        "updated": [True] * n,
        "stamp": list(range(n)),
        "particles": [10] * n,
        "matched_share": [0.0, *[0.9] * 19, 0.3, *[0.9] * 19],
        "match_failures": [0] * n,
    }

    def found(**changed):
        return first_bad_match(estimate, steps | changed)

    assert (found().scan, found().bad, found().believed[0], found().expected) == (20, True, 20.0, None)
    failing = found(matched_share=[0.9] * n, match_failures=[0] * 30 + [6] + [0] * 9)
    assert (failing.scan, failing.bad) == (30, True)
    assert not found(matched_share=[0.9] * n).bad
    assert found(updated=[False] * n) is None


def test_with_relations_the_first_visit_that_does_not_meet_the_earlier_one_is_found():
    x = 0.5 * np.arange(40)
    truth = Trajectory(np.arange(40.0), np.column_stack([x, 0.0 * x, 0.0 * x]))
    bent = truth.poses.copy()
    bent[25:, 1] += 0.7
    first, second = np.array([20, 30, 10, 5]), np.array([24, 34, 26, 38])  # the last two straddle the bend
    for one, two in ((first, second), (second, first)):  # relations may look back in time
        relations = Relations(truth.stamps[one], truth.stamps[two], between(truth.poses[one], truth.poses[two]))
        finding = find(Trajectory(truth.stamps, bent), relations=relations)
        assert (finding.scan, finding.since, finding.bad) == (26, 10, True)
        np.testing.assert_allclose(finding.believed, bent[26])
        np.testing.assert_allclose(finding.expected, truth.poses[26])
        assert "70\xa0cm" in finding.reason
        assert find(truth, relations=relations) is None


def test_a_finding_comes_back_from_its_file(tmp_path):
    x = 0.1 * np.arange(300)
    truth = Trajectory(x, np.column_stack([x, 0.0 * x, 0.0 * x]))
    finding = find(truth, truth=truth)
    write_finding(tmp_path / "finding.json", finding, [[1.23456, -2.0]])
    back = read_finding(tmp_path / "finding.json")
    assert (back.finding.scan, back.finding.bad, back.finding.reason) == (finding.scan, False, finding.reason)
    np.testing.assert_array_equal(back.finding.expected, finding.expected)
    np.testing.assert_allclose(back.points, [[1.235, -2.0]])


def test_numbers_for_people():
    assert [length(x) for x in (0.0123, 0.45, 1.234)] == ["1.2\xa0cm", "45\xa0cm", "1.23\xa0m"]
    assert [spread(0.0181, 0.012), spread(5.12, 8.15)] == ["1.81 ± 1.20\xa0cm", "5.12 ± 8.15\xa0m"]
    assert [share(x) for x in (0.0, 0.004, 0.37, 0.996, 0.99999)] == [
        f"{number}\xa0%" for number in ("0", "0.4", "37", "99.6", "100")
    ]


def test_the_verdict_of_a_good_run_names_both_errors(runs):
    found = verdict(read_run(runs["good"]))
    assert found.mood == "good"
    assert "wheel odometry alone is" in " ".join(found.sentences)
    assert [headline.label for headline in found.headlines][:2] == ["trajectory error", "heading error"]
