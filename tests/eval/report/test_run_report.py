# SPDX-License-Identifier: MIT
"""The report: one file that needs nothing else, says the right thing, and works whatever a run knows."""

import base64
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from eval.files.run_reader import RunFilesError, read_run
from eval.filter.step_table import pose_columns
from eval.report.map_plots import _laid_under_estimate, failure_over_map, path_plots
from eval.report.report_context import ReportContext
from eval.report.run_report import _why_closed, write_report
from eval.report.time_plots import _peak_in_words
from eval.wording import up_to_a_tenth
from slam.occupancy import OccupancyGrid
from slam.se2 import transform_points
from tests.eval.helpers import room
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


def test_the_sections_are_those_that_the_data_allow(texts):
    with_truth = Page(texts["good"]).headings
    for heading in (
        "Difference",
        "Error by place, aligned over all poses",
        "Position error",
        "Particle ancestry",
        "Consistency (NEES)",
    ):
        assert heading in with_truth
    without = Page(texts["log"]).headings
    assert {"Estimated map", "Trajectories", "Effective sample size", "Where the time goes"} <= set(without)
    assert not {"True map", "Difference", "Position error", "Error over time"} & set(without)
    assert not any(heading.startswith("Error by place") for heading in without)
    assert "Error by place, aligned at the first scan" in Page(texts["broken"]).headings


def test_errors_by_place_are_those_of_the_headline(runs, monkeypatch):
    """The path of a good run is coloured by the errors whose root mean square is the trajectory error."""
    drawn_errors = []
    monkeypatch.setattr(
        "eval.report.plots.error_by_place", lambda path, error, **_: drawn_errors.append(error) or "data:,"
    )
    good, broken = (ReportContext.of(read_run(runs[name])) for name in ("good", "broken"))
    for context in (good, broken):
        list(path_plots(context))
    assert np.sqrt(np.mean(drawn_errors[0] ** 2)) == pytest.approx(good.run.metric("trajectory.ate_rmse_m"))
    assert drawn_errors[1] == pytest.approx(broken.errors_from_start()[0])  # wrong at its end only


def loop(stamp, gap, errors=None):
    found = {"stamp": stamp, "seen_before_stamp": 1010.0, "length_m": 30.0, "accepted": True, "closed_by_filter": True}
    found |= {"gap_m": gap, "gap_deg": 0.7, "overlap_m": 18.1, "agreeing_share": 0.96}
    return found if errors is None else found | errors


@pytest.mark.parametrize("truth", [True, False])
@pytest.mark.usefixtures("without_pictures")
def test_the_table_of_loops_tells_whose_error_it_is(runs, tmp_path, truth):
    """A match that differs from the filter's path by 17 cm may be wrong itself: with truth, both errors are there."""
    folder = tmp_path / "run"
    shutil.copytree(runs["good"], folder)
    metrics = json.loads((folder / "metrics.json").read_text())
    errors = {"match_error_m": 0.151, "match_error_deg": 0.6, "filter_error_m": 0.04, "filter_error_deg": 0.01}
    found = {"found": 1, "accepted": 1, "rejected": 0, "left_open_by_filter": 0, "path_changed": False}
    found["list"] = [loop(1050.0, 0.17, errors if truth else None)]
    (folder / "metrics.json").write_text(json.dumps(metrics | {"loops": found}))
    table = write_report(folder).read_text().partition("Loops that the final pass found")[2].partition("</table>")[0]
    table = table.replace("\N{NO-BREAK SPACE}", " ").replace("<br>", " ")
    heads, cells = (re.findall(f"<{tag}[^>]*>([^<]*)</{tag}>", table) for tag in ("th", "td"))
    errors_found = ["15 cm, 0.6°", "4.0 cm, 0.0°"] if truth else []
    closed = "closed by the filter: the walls agree along its path too"
    assert cells == ["50.0 s", "10.0 s", closed, "30.00 m", "18.10 m", "17 cm, 0.7°", *errors_found]
    assert len(heads) == len(cells)
    assert ("error of the filter's path" in heads) == truth


@pytest.mark.parametrize(("gap", "accepted", "closed"), [(0.09, True, True), (0.3, True, False), (0.3, False, True)])
def test_only_a_loop_that_counts_as_closed_although_its_match_is_far_is_explained(gap, accepted, closed):
    assert _why_closed(loop(1050.0, gap) | {"accepted": accepted, "closed_by_filter": closed}) == ""
    assert _why_closed(loop(1050.0, 0.3)) != ""


@pytest.mark.usefixtures("without_pictures")
def test_passing_errors_are_ordered_by_the_measure_that_is_shown(runs, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(runs["broken"], folder)
    finding = json.loads((folder / "finding.json").read_text())
    errors = ((0.74, 14.0), (0.44, 34.0), (0.48, 33.0), (0.2, 5.1))
    finding["blips"] = [
        {"stamp": 1001.0 + k, "end": 1002.0 + k, "metres": m, "degrees": d} for k, (m, d) in enumerate(errors)
    ]
    (folder / "finding.json").write_text(json.dumps(finding))
    table = write_report(folder).read_text().partition("Passing errors")[2].partition("</table>")[0]
    cells = re.findall(r"<td>([^<]+)</td>", table)
    assert [float(cell) for cell in cells[2::5]] == [6.8, 6.6, 4.9, 1.3]
    assert [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in cells[3::5]] == ["44 cm", "48 cm", "74 cm", "20 cm"]


@pytest.mark.parametrize(("broken", "lead"), [(False, "OK: relation error"), (True, "The map is broken")])
@pytest.mark.usefixtures("without_pictures")
def test_a_recorded_log_is_judged_by_its_relations(tmp_path, broken, lead):
    folder = write_run(tmp_path / "intel", truth=False, relations=True, broken=broken)
    page = Page(write_report(folder).read_text())
    assert lead in page.text
    relations = json.loads((folder / "metrics.json").read_text())["relations"]
    assert f"Against {relations['pairs']} hand-checked relations" in page.text
    for part in (relations, relations["short"], relations["loops"]):
        assert f"{part['trans_mean_m']:.4f} ± {part['trans_std_m']:.4f} m" in page.text


def test_a_broken_run_is_called_so_and_its_moment_is_named(texts):
    page = Page(texts["broken"])
    assert "The map is broken" in page.text
    assert "Where it went wrong" in page.headings
    named = int(re.search(r"\(scan (\d+)\)", page.text)[1])
    assert BREAK <= named <= BREAK + 1.0 / 0.06
    assert "Where it went wrong" not in Page(texts["good"]).headings


@pytest.mark.usefixtures("without_pictures")
def test_the_report_says_when_the_recording_calls_it_lost(runs, texts, tmp_path):
    """The estimate that turns by 12 degrees at one scan has a broken loop; one that turns by 90 is lost there."""
    assert "does not call it lost at any time" in Page(texts["broken"]).text
    assert "The recording judges" not in texts["log"]
    folder = tmp_path / "run"
    shutil.copytree(runs["broken"], folder)
    steps = pq.read_table(folder / "steps.parquet").to_pydict()
    steps["theta"] = [theta + (1.57 if row >= BREAK else 0.0) for row, theta in enumerate(steps["theta"])]
    pq.write_table(pa.table(steps), folder / "steps.parquet")
    found = re.search(
        r"calls it lost from ([0-9.]+) s on", " ".join(Page(write_report(folder).read_text()).text.split())
    )
    assert float(found[1]) == pytest.approx(0.1 * BREAK, abs=0.5)


def drawn(text: str, title: str) -> str:
    """The SVG of a plot."""
    source = re.search(rf'<img src="data:image/svg\+xml;base64,([^"]+)" alt="{title}', text)[1]
    return base64.b64decode(source).decode()


class Recorded:
    """A recording in which another particle became the best at 20 s."""

    another_best = np.array([20.0])

    def __init__(self):
        self.drawn, self.pairs, self.maps = [], [], []

    def png(self, time):
        self.drawn.append(time)
        return b"a picture"

    def side_by_side(self, before, at):
        self.pairs.append((before, at))
        return b"two pictures"

    def map_at(self, time):
        self.maps.append(time)
        return room()


def test_the_first_sign_of_the_self_check_is_marked_on_the_paths(runs, texts, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(runs["broken"], folder)
    metrics = json.loads((folder / "metrics.json").read_text())
    check = {"verdict": "lost", "reason": "because", "stamp": 1040.0, "time_s": 40.0, "place": [1.0, 2.0, 0.0]}
    (folder / "metrics.json").write_text(json.dumps(metrics | {"self_check": check}))
    assert "first sign" in drawn(write_report(folder).read_text(), "Trajectories")
    assert "first sign" not in drawn(texts["broken"], "Trajectories")


def test_where_another_particle_became_the_best_is_marked(runs, texts, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(runs["good"], folder)
    marked = write_report(folder, Recorded()).read_text()
    assert "another best particle" in drawn(marked, "Position error")
    assert "jumps to its history" in marked
    assert "another best particle" not in drawn(texts["good"], "Position error")
    assert "jumps to its history" not in texts["good"]


@pytest.mark.usefixtures("without_pictures")
def test_a_moment_that_is_named_twice_is_drawn_once(runs, tmp_path):
    """The largest error is where the largest loop has its full length; the final pass had found that loop left open."""
    folder = tmp_path / "run"
    shutil.copytree(runs["good"], folder)
    steps = pq.read_table(folder / "steps.parquet").to_pydict()
    stamps = np.array(steps["stamp"])
    at = np.flatnonzero(np.array(steps["updated"], bool))[[30, 40]]
    lengths = np.zeros(len(stamps))
    lengths[at] = 20.0, 60.0
    errors = np.where(stamps == stamps[at[1]], 0.9, 0.1)
    pq.write_table(pa.table(steps | {"loop_length": lengths, "error_m": errors}), folder / "steps.parquet")
    metrics = json.loads((folder / "metrics.json").read_text())
    open_loop = loop(stamps[at[1]], 0.38) | {"closed_by_filter": False, "accepted": True}
    loops = {"found": 1, "rejected": 0, "list": [open_loop]}
    (folder / "metrics.json").write_text(json.dumps(metrics | {"loops": loops}))
    recording = Recorded()
    news = []
    text = write_report(folder, recording, news.append).read_text()
    assert len(recording.drawn) == len(set(recording.drawn)) >= 2
    assert news == [*(f"drawing {time:.1f} s" for time in recording.drawn), "plots"]
    shown = f"{stamps[at[1]] - stamps[0]:.1f} s"
    again = f"The largest error of the pose while driving, {shown}: the picture “The largest loop, "
    assert f"{again}{shown}” above." in text
    assert f"at {shown} left open, closed now (38\N{NO-BREAK SPACE}cm" in text.partition("<h2>The largest loop")[2]
    assert "loop, closed" not in text


def test_a_failure_is_drawn_with_the_update_before_it(runs, tmp_path):
    """Both side by side, the moment as a whole, and the scan over the map that the estimate had before."""
    folder = tmp_path / "run"
    shutil.copytree(runs["broken"], folder)
    run, recording = read_run(folder), Recorded()
    text = write_report(folder, recording).read_text()
    failure = run.failure.failure
    stamps, updated = (np.array(run.steps[name]) for name in ("stamp", "updated"))
    before = up_to_a_tenth(stamps[(updated == 1.0) & (stamps < failure.stamp - 1e-6)][-1] - stamps[0])
    at = failure.time_to_watch(run.estimate.stamps)
    assert recording.pairs == [(before, at)]
    assert at in recording.drawn
    assert before not in recording.drawn
    assert recording.maps == [before]
    title = f"Map and scan at the update before, {before:.1f} s, and where it went wrong, {at:.1f} s"
    names = (title, f"Where it went wrong, {at:.1f} s")
    section = text.partition("<h2>Where it went wrong</h2>")[2].partition("<h2>")[0]
    places = [section.index(f"<h3>{name}</h3>") for name in names]
    assert places == sorted(places)
    over_map = drawn(section, f"The same over the estimate&#39;s map of {before:.1f} s")
    for label in ("scan from the estimated pose", "scan from the true pose"):
        assert label in over_map
    assert "Where rings and dots both lie on walls" in section
    unknown = replace(run, failure=replace(run.failure, failure=replace(failure, true_pose=None)))
    plot = failure_over_map(ReportContext.of(unknown), room(), before)
    assert plot.caption == "The map at the update before, laid under the estimated pose."


def test_the_map_under_the_scan_is_laid_by_the_estimated_pose(runs):
    """A single wall where the scan, drawn from the estimated pose, has one: the wall lies under its end points."""
    context = ReportContext.of(read_run(runs["broken"]))
    failure, points = context.run.failure.failure, context.run.failure.points
    pose_in_map = pose_columns(context.run.steps)[failure.shown_scan]
    cells = np.floor((transform_points(pose_in_map, points) + 20.0) / 0.05).astype(int)
    probability = np.full((800, 800), 0.1, np.float32)
    probability[cells[:, 1], cells[:, 0]] = 1.0
    grid = OccupancyGrid(probability=probability, resolution=0.05, origin=(-20.0, -20.0, 0.0))
    laid = _laid_under_estimate(context, failure, grid)
    ends = transform_points(failure.estimated, points)
    left, _, _, top = laid.extent
    columns, rows = np.floor((ends - [left, top]) * [1.0, -1.0] / 0.05).astype(int).T
    near = [laid.pixels[r - 1 : r + 2, c - 1 : c + 2].min() for r, c in zip(rows, columns, strict=True)]
    assert np.mean(np.array(near) < 60) > 0.95


def test_a_peak_of_the_error_that_is_soon_over_is_explained(runs):
    steps = dict(read_run(runs["good"]).steps)
    n = len(steps["stamp"])
    steps["error_deg"], steps["odometry_jumped"] = np.full(n, 2.0), np.zeros(n)
    assert _peak_in_words(steps, "error_deg", 1000.0) == ""
    steps["error_deg"][300:302] = 21.0
    assert _peak_in_words(steps, "error_deg", 1000.0) == " The peak of 21° at 30.0 s is over after 0.3 s."
    steps["odometry_jumped"][301] = 1.0
    assert "over after 0.3 s: the odometry moved further" in _peak_in_words(steps, "error_deg", 1000.0)
    steps["error_deg"][300:320] = 21.0
    assert _peak_in_words(steps, "error_deg", 1000.0) == ""


def test_the_scan_is_drawn_from_both_poses(texts):
    broken, log = drawn(texts["broken"], "Around scan"), drawn(texts["log"], "Around scan")
    for label in ("true path", "estimated path", "scan from the estimated pose", "scan from the true pose"):
        assert label in broken
    assert "scan from the estimated pose" in log
    assert "true pose" not in log


def test_what_comes_from_files_is_escaped(texts):
    assert "some &lt;processor&gt;" in texts["good"]


@pytest.mark.parametrize("missing", ["steps.parquet", "estimate.tum", "map.yaml"])
@pytest.mark.usefixtures("without_pictures")
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
        ("finding.json", '{"scan": 1}', r"finding\.json: expected finding\.json"),
        ("finding.json", "[1]", r"finding\.json: expected finding\.json"),
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
