# SPDX-License-Identifier: MIT
"""The report of a sweep: its numbers are those of the tables, its files are whole and need no network."""

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from eval.sweep.figures.accuracy import accuracy
from eval.sweep.figures.cost import pareto_front
from eval.sweep.figures.differences import differences
from eval.sweep.figures.layout import style
from eval.sweep.figures.marks import ZONE
from eval.sweep.measure import Measure
from eval.sweep.paper_tables import figure_caption, latex_table, markdown_table
from eval.sweep.report import DRAWINGS, write_sweep_report
from eval.sweep.results import SweepTableError, read_sweep
from eval.sweep.statistics import paired_difference
from eval.sweep.summary import summarise, worst_runs
from tests.eval.synthetic_sweep import COUNTS, LINES, PLACES, errors_of, write_sweep


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_sweep(tmp_path_factory.mktemp("sweep"))


def test_every_run_is_found_at_its_place_in_the_cubes(folder):
    table = read_sweep(folder)
    assert (table.places, table.lines, table.counts, len(table.seeds)) == (PLACES, LINES, COUNTS, 10)
    for index in np.ndindex(*table.shape):
        assert table.error[index] == errors_of(*index)
    np.testing.assert_allclose(table.curves["ess"][..., -1], 0.7)
    assert np.isnan(table.curves["nees"]).all()


def test_groups_tell_medians_differences_and_costs(folder):
    table = read_sweep(folder)
    summary = summarise(table)
    group = summary.group("cave", "motion", 5)
    errors = [errors_of(1, 1, 1, s) for s in range(10)]
    assert group.median.value == pytest.approx(np.median(errors))
    assert group.mean.value == pytest.approx(np.mean(errors))
    assert group.to_baseline == paired_difference(errors, [errors_of(1, 0, 1, s) for s in range(10)])
    assert group.to_largest == paired_difference(errors, [errors_of(1, 1, 2, s) for s in range(10)])
    assert group.detectable < group.to_baseline.value  # so it was seen
    assert group.cost == pytest.approx(2.5)  # ms: 0.25 s for 100 updates
    assert summary.group("cave", "improved", 5).to_baseline is None
    assert summary.group("cave", "motion", 20).to_largest is None
    assert summary.decision("cave", "improved").count == 1
    assert summary.decision("cave", "motion").kind == "more"
    refined = summary.group("cave", "motion", 20).refined
    assert refined.value == pytest.approx(0.2 * np.median([errors_of(1, 1, 2, s) for s in range(10)]))
    assert summary.group("cave", "motion", 5).refined.count == 0


def test_failed_and_missing_runs_are_counted_separately(tmp_path):
    def outcome(p, k, c, s):
        return {0: "lost", 1: "drift", 2: "broken loop"}.get(s, "ok") if (p, k, c) == (0, 1, 0) else "ok"

    write_sweep(tmp_path, outcome=outcome, missing=frozenset({(0, 1, 0, 9), (0, 1, 0, 8)}))
    group = summarise(read_sweep(tmp_path)).group("hall_a", "motion", 1)
    assert (group.runs, group.failures, group.median.count) == (8, 2, 8)
    assert group.failure_interval[0] < 0.25 < group.failure_interval[1]


@pytest.mark.usefixtures("without_pictures")
def test_a_sweep_with_few_results_has_a_report(tmp_path):
    there = {(0, 0, 0, 0), (1, 1, 2, 3)}
    everything = set(np.ndindex(len(PLACES), len(LINES), len(COUNTS), 10))
    write_sweep(tmp_path, missing=frozenset(everything - there))
    page = write_sweep_report(tmp_path).read_text()
    assert "undecided with 0 seeds" in page
    assert "118 jobs have not been computed" in page
    assert "nan" not in re.sub(r"base64,[^\"]+", "", page).lower()


def test_the_worst_runs_have_the_largest_errors_of_each_line(folder):
    worst = worst_runs(read_sweep(folder))
    assert [(run.line, run.place) for run in worst] == [(line, place) for line in LINES for place in reversed(PLACES)]
    for run in worst:
        p, k = PLACES.index(run.place), LINES.index(run.line)
        assert run.error == max(errors_of(p, k, c, s) for c in range(len(COUNTS)) for s in range(10))
        assert run.key == f"{p}-{k}-{COUNTS.index(run.count)}-{run.seed}"


def test_page_and_figures_need_no_network_and_links_exist(tmp_path):
    write_sweep(tmp_path)
    worst = worst_runs(read_sweep(tmp_path))[0]
    (tmp_path / "worst" / worst.key).mkdir(parents=True)
    (tmp_path / "worst" / worst.key / "report.html").write_text("")
    page = write_sweep_report(tmp_path).read_text()
    assert not re.findall(r"(?:src|href)=\"https?:", page)
    assert page.count('src="data:image/svg+xml') == len(DRAWINGS)
    assert f'href="worst/{worst.key}/report.html"' in page
    assert f'href="worst/{worst.key}/recording.rrd"' not in page
    assert page.count("1 particle is enough") == len(PLACES)
    assert "of the best particle&#39;s path at the end, before any final pass" in page

    figures = {path.name: path.read_bytes() for path in (tmp_path / "figures").iterdir()}
    assert sorted(figures) == sorted(f"{drawing.name}.{form}" for drawing in DRAWINGS for form in ("pdf", "svg"))
    assert write_sweep_report(tmp_path).read_text() == page
    assert {path.name: path.read_bytes() for path in (tmp_path / "figures").iterdir()} == figures


def test_tables_for_papers_hold_the_medians_with_their_intervals(tmp_path):
    write_sweep(tmp_path, outcome=lambda p, k, c, s: "lost" if (p, k, c) == (0, 1, 0) and s < 3 else "ok")
    summary = summarise(read_sweep(tmp_path))
    m = summary.group("hall_a", "motion", 1).median
    cell = f"{100 * m.value:.1f} [{100 * m.low:.1f}, {100 * m.high:.1f}] (3/10)"
    column = 3 + LINES.index("motion")
    markdown, differences = tables_in(markdown_table(summary))
    (first,) = [row for row in markdown if row[:2] == ["hall_a", "1"]]
    assert (first[2], first[column]) == ("10", cell)
    (answer,) = [row for row in markdown if row[:2] == ["hall_a", "enough"]]
    assert answer[column] == "more than 5"
    (first,) = [row for row in differences if row[:2] == ["hall_a", "1"]]
    d = summary.decision("hall_a", "motion").differences[0]
    assert first[column] == f"{100 * d.value:+.1f} [{100 * d.low:+.1f}, {100 * d.high:+.1f}]"
    assert (differences[0][0], differences[0][column]) == ("against 20 [95 %]", "motion")
    rows = [line for line in latex_table(summary).splitlines() if "&" in line]
    assert not any(re.search(r"[ \[]-\d", line) for line in rows)  # a hyphen would be printed
    latex = [line.removesuffix(r" \\").replace("$-$", "-").replace("\\", "") for line in rows]
    assert [row.split(" & ") for row in latex] == [row for row in markdown + differences if row[0] != "---"]
    assert len(latex) == 2 * (1 + len(PLACES) * (len(COUNTS) + 1))


def tables_in(markdown):
    """Rows of the tables of a Markdown text."""
    blocks = [block for block in markdown.split("\n\n") if block.startswith("|")]
    return [[line.strip("|")[1:-1].split(" | ") for line in block.splitlines()] for block in blocks]


def test_a_single_line_has_errors_and_differences_side_by_side(tmp_path, monkeypatch):
    """With the level that decides, and which look this is."""
    monkeypatch.setattr("tests.eval.synthetic_sweep.LINES", ("improved",))
    missing = frozenset((p, 0, c, s) for p in range(2) for c in range(3) for s in range(8, 40))
    write_sweep(tmp_path, seeds=40, missing=missing, about={"level": 0.99})
    summary = summarise(read_sweep(tmp_path).judged())
    text = markdown_table(summary)
    (rows,) = tables_in(text)
    assert rows[0] == ["world", "particles", "runs", "error", "against 20 [99 %]"]
    d = summary.decision("cave", "improved").differences[1]
    (row,) = [row for row in rows if row[:2] == ["cave", "5"]]
    assert row[4] == f"{100 * d.value:+.2f} [{100 * d.low:+.2f}, {100 * d.high:+.2f}]"
    assert [row[4] for row in rows if row[1] == "20"] == ["", ""]
    caption, method = text.splitlines()[0], text.splitlines()[-1]
    assert "with the 99 % interval that decides" in caption
    assert len(caption.split(". ")) <= 4
    assert method.startswith("Method: ")
    assert "looked at up to 5 times (after 8, 16, 24, 32 and 40 seeds), with 99 % intervals" in method
    assert "This is look 1, with 8 of at most 40 seeds." in method
    assert "looked at" not in caption
    assert "Dots: runs (8 for each count); large marks" in figure_caption(summary)


def test_numbers_below_zero_have_minus_signs_in_latex_but_not_in_markdown(tmp_path, monkeypatch):
    """The smallest count has a smaller error; the method names the difference after the final pass, too."""
    monkeypatch.setattr("tests.eval.synthetic_sweep.LINES", ("improved",))
    summary = summarise(read_sweep(write_sweep(tmp_path, lambda p, k, c, s: 0.02 + 0.001 * c + 0.0001 * s)))
    latex, markdown = latex_table(summary), markdown_table(summary)
    assert len(re.findall(r"(?<![\w.])-\d", markdown)) == latex.count("$-$") > 0
    assert re.search(r"(?<![\w.])-\d", latex) is None


@pytest.mark.usefixtures("without_pictures")
def test_a_margin_that_was_chosen_after_a_look_is_said(tmp_path):
    change = {"before": "", "margin": "13mm", "seeds": 8}
    facts = {"level": 0.99, "margin": "13mm", "margin_changes": [change]}
    write_sweep(tmp_path, seeds=40, about=facts)
    words = (
        "The margin was changed from 5 mm (10 % where that is more) to 13 mm after look 1, with 8 seeds had been seen"
    )
    assert words in markdown_table(summarise(read_sweep(tmp_path))).splitlines()[0]
    assert words in write_sweep_report(tmp_path).read_text()
    back = facts | {"margin": "", "margin_changes": [change, {"before": "13mm", "margin": "", "seeds": 8}]}
    write_sweep(tmp_path, seeds=40, about=back)
    assert "The margin was changed" not in markdown_table(summarise(read_sweep(tmp_path)))


def test_a_table_says_where_runs_are_too_few_and_under_what_conditions(tmp_path):
    missing = frozenset((0, k, 2, s) for k in range(2) for s in range(7))
    facts = {"conditions": "robot create3, lidar lds01", "margin": "2mm"}
    summary = summarise(read_sweep(write_sweep(tmp_path, missing=missing, about=facts, route="random")))
    table = markdown_table(summary)
    assert "| hall_a | 20 | 3 * |" in table
    assert "| hall_a | 5 | 10 |" in table
    assert "| cave | 20 | 10 |" in table
    assert "at most 2 mm (hall_a 10 %, cave 5 % of the error with 20) worse than 20 particles, with 95 %" in table
    assert "* Too few runs for an interval: smallest and largest run." in table
    assert "At least 8 runs are needed to show that a count is enough." in table
    assert "After the final pass, which is no part of the filter, the smallest count " in table
    assert "Each seed drives another route through the whole world. Robot create3, lidar lds01." in table
    assert "Too few" not in markdown_table(summarise(read_sweep(write_sweep(tmp_path / "whole"))))
    none = missing | {(1, k, 1, s) for k in range(2) for s in range(10)}
    table = markdown_table(summarise(read_sweep(write_sweep(tmp_path / "none", missing=none))))
    assert "| cave | 5 | 0 |" in table  # no mark: there is nothing to explain
    assert "* Too few runs for an interval" in table


def test_the_method_names_the_software_that_computed_the_runs(tmp_path):
    for commit, words in (
        ("v0.1-5-gabc", "(commit v0.1-5-gabc, code version 0123456789abcdef)"),
        ("slam-testbed 0.2", "(0.2, code version 0123456789abcdef)"),
        ("", "(code version 0123456789abcdef)"),
    ):
        table = latex_table(summarise(read_sweep(write_sweep(tmp_path, about={"commit": commit}))))
        assert table.endswith(f"Computed with slam-testbed {words}.\n")
    assert "\\begin{table*}" in table
    assert "\\end{table*}" in table


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="needs pdflatex (Debian: texlive-latex-recommended)")
def test_the_latex_table_compiles_whatever_the_names(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.eval.synthetic_sweep.PLACES", ("hall_a & {b}", r"50 % of $x^2$ ~ #1 \cave"))
    table = latex_table(summarise(read_sweep(write_sweep(tmp_path / "sweep"))))
    head = "\\documentclass{article}\n\\usepackage{booktabs}\n\\begin{document}\n"
    (tmp_path / "paper.tex").write_text(f"{head}{table}\\end{{document}}\n")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, errors="replace", check=False)
    assert done.returncode == 0, done.stdout
    assert (tmp_path / "paper.pdf").is_file()
    assert "Overfull" not in done.stdout


@pytest.mark.parametrize(
    ("key", "words", "estimate", "outcome", "refined", "unit"),
    [
        (
            "trajectory_filter.ate_rmse_m",
            "trajectory error",
            "filter",
            "outcome_filter",
            "trajectory.ate_rmse_m",
            ("cm", 100.0),
        ),
        ("trajectory_online.ate_rmse_m", "trajectory error", "online", "outcome_online", None, ("cm", 100.0)),
        ("trajectory.ate_rmse_m", "trajectory error", "final", "outcome", None, ("cm", 100.0)),
        (
            "map_filter.wall_distance_m",
            "map wall distance",
            "filter",
            "outcome_filter",
            "map.wall_distance_m",
            ("cm", 100),
        ),
        ("trajectory.heading_rmse_deg", "trajectory heading rmse", "final", "outcome", None, ("deg", 1.0)),
        ("map.log_loss", "map log loss", "final", "outcome", None, ("", 1.0)),
    ],
)
def test_a_measure_knows_its_estimate_words_and_unit(key, words, estimate, outcome, refined, unit):
    measure = Measure(key)
    assert (measure.words, measure.estimate, measure.outcome, measure.refined_key) == (
        words,
        estimate,
        outcome,
        refined,
    )
    assert (measure.unit(0.5).name, measure.unit(0.5).factor) == unit


def test_lengths_are_shown_in_the_unit_that_fits():
    measure = Measure("trajectory_filter.ate_rmse_m")
    assert [measure.unit(v).name for v in (0.002, 1.9, 2.0, 40.0)] == ["cm", "cm", "m", "m"]
    assert [measure.unit(0.1).text(v) for v in (0.00234, 0.0234, 0.234, 1.5)] == ["0.23", "2.3", "23.4", "150"]


@pytest.mark.parametrize("content", [None, b"", b"PAR1 no table"])
def test_damaged_tables_are_named(tmp_path, content):
    write_sweep(tmp_path)
    (tmp_path / "sweep.parquet").unlink()
    if content is not None:
        (tmp_path / "sweep.parquet").write_bytes(content)
    with pytest.raises(SweepTableError, match=r"sweep\.parquet"):
        write_sweep_report(tmp_path)


points = st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), max_size=30)


@settings(deadline=None)
@given(points)
def test_the_front_holds_exactly_what_nothing_beats(points):
    array = np.array(points, dtype=float).reshape(-1, 2)
    front = {tuple(array[row]) for row in pareto_front(array)}

    def beaten(a):
        return any((b <= a).all() and (b < a).any() for b in array)

    assert front == {tuple(a) for a in array if not beaten(a)}


def test_few_runs_have_a_range_instead_of_a_band_and_an_interval(tmp_path):
    few = summarise(read_sweep(write_sweep(tmp_path / "few", seeds=5)))
    table = markdown_table(few)
    errors = [errors_of(0, 0, 0, s) for s in range(5)]
    assert f"[{100 * min(errors):.2f}, {100 * max(errors):.2f}]" in table
    assert "median [smallest and largest run]" in table
    assert "against 20 [range]" in markdown_table(few) or len(few.table.lines) > 1
    assert "*" not in table  # all are too few: a mark would tell nothing
    assert "95 % bootstrap interval" not in table
    bands = {}
    for seeds in (5, 6):
        figure = accuracy(summarise(read_sweep(write_sweep(tmp_path / str(seeds), seeds=seeds))))
        drawn = [c for c in figure.axes[0].collections if isinstance(c, PolyCollection) and c.get_label() != "x"]
        bands[seeds] = sum(len(path.vertices) for c in drawn for path in c.get_paths())
    assert bands[5] == 0
    assert bands[6] > 0


def test_every_mark_of_the_first_figures_is_in_their_legends(tmp_path):
    def error(p, k, c, s):
        """1 is worse, 5 is open, and one run is far above the others."""
        return 0.02 * (1.0 + (1.0, 0.4 * ((5 * s) % 8 - 3.5) / 3.5, 0.0)[c] + 40.0 * ((p, k, c, s) == (0, 0, 0, 1)))

    summary = summarise(read_sweep(write_sweep(tmp_path, error=error)))
    (legend,) = accuracy(summary).legends
    shared = {f"within the margin of {COUNTS[-1]}", "one run", "beyond the axis", "open", "shown to be worse", *LINES}
    own = {"95 % interval of the median", "after the final pass", f"{COUNTS[-1]} particles"}
    assert {text.get_text() for text in legend.get_texts()} == shared | own
    (legend,) = differences(summary).legends
    own = {"margin", "95 % interval, which decides"}
    assert {text.get_text() for text in legend.get_texts()} == shared | own


def test_the_green_zone_ends_at_the_margin_in_both_figures(tmp_path):
    """It begins at the lower end of the axis: a count that is better than the largest is as good as it, too."""
    summary = summarise(read_sweep(write_sweep(tmp_path)))
    limit = 100.0 * summary.decision("hall_a", "improved").limit
    tops = {}
    for draw in (accuracy, differences):
        ax = draw(summary).axes[0]
        (zone,) = [patch for patch in ax.patches if to_hex(patch.get_facecolor()) == ZONE]
        assert zone.get_y() == ax.get_ylim()[0]
        tops[draw] = zone.get_y() + zone.get_height()
    median = 100.0 * summary.group("hall_a", "improved", COUNTS[-1]).median.value
    assert tops[differences] == pytest.approx(limit)
    assert tops[accuracy] == pytest.approx(median + limit)


@pytest.mark.parametrize("lines", [LINES[:1], LINES])
@pytest.mark.parametrize("places", [PLACES[:1], PLACES, (*PLACES, "office"), (*PLACES, "rooms-0", "rooms-1")])
def test_no_legend_is_cut_or_covers_a_panel(tmp_path, monkeypatch, places, lines):
    """With all marks, in figures of one, two and three columns, also of a kind of building."""
    monkeypatch.setattr("tests.eval.synthetic_sweep.PLACES", places)
    monkeypatch.setattr("tests.eval.synthetic_sweep.LINES", lines)

    def error(p, k, c, s):
        """1 is worse, 5 is open or good, and one run is far above the others."""
        noise = 0.4 * (k + p) * ((5 * s) % 8 - 3.5) / 3.5
        return 0.02 * (1.0 + (1.0, noise, 0.0)[c] + 40.0 * ((p, k, c, s) == (0, 0, 0, 1)))

    families = tuple("rooms" if place.startswith("rooms") else None for place in places)
    summary = summarise(read_sweep(write_sweep(tmp_path, error=error, families=families)))
    for drawing in DRAWINGS:
        with style():
            figure = drawing.draw(summary)
            FigureCanvasAgg(figure).draw()
        for legend in figure.legends:
            box = legend.get_window_extent()
            assert box.x1 <= figure.bbox.x1, drawing.name
            assert box.y1 <= figure.bbox.y1, drawing.name
            titles = [ax.title.get_window_extent().y1 for ax in figure.axes if ax.get_visible()]
            assert box.y0 >= max(titles), drawing.name


@pytest.mark.usefixtures("without_pictures")
def test_answers_rest_on_complete_seeds_up_to_the_last_look(tmp_path):
    """Seed 3 lacks one count; of a sweep with looks after 8 and 16 seeds 11 are complete."""
    write_sweep(tmp_path / "once", missing=frozenset({(0, 0, 1, 3)}))
    table = read_sweep(tmp_path / "once").judged()
    assert table.ran[0, 0].sum(axis=-1).tolist() == [9, 9, 9]
    assert table.ran[0, 1].sum(axis=-1).tolist() == [10, 10, 10]
    assert np.isnan(table.error[0, 0, :, 3]).all()
    assert (table.columns["status"][0, 0, :, 3] == ["left out", "missing", "left out"]).all()
    assert summarise(table).decision("hall_a", "improved").units == 9

    later = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(11 + 3 * p, 16))
    write_sweep(tmp_path / "looks", seeds=16, missing=later | {(1, 0, 0, 2)}, about={"level": 0.975})
    looked = read_sweep(tmp_path / "looks").judged()
    assert looked.ran[0].sum(axis=-1).tolist() == [[8, 8, 8], [8, 8, 8]]
    assert looked.ran[1, 0].sum(axis=-1).tolist() == [2, 2, 2]  # no look is complete: what there is, in pairs
    page = write_sweep_report(tmp_path / "looks").read_text()
    assert "finished runs are left out here" in page
    assert "all seeds drive the same route" in page  # settings of the runs that are left out still count


def test_a_table_without_a_complete_seed_keeps_its_runs(tmp_path):
    missing = frozenset((p, k, 2, s) for p in range(2) for k in range(2) for s in range(10))
    table = read_sweep(write_sweep(tmp_path, missing=missing))
    assert table.judged().ran.sum() == table.ran.sum() == 80


def test_runs_without_the_final_pass_have_no_final_estimate(tmp_path):
    """Their `trajectory` repeats that of the filter: compared with refined runs they would look five times worse."""
    table = read_sweep(write_sweep(tmp_path))
    assert not table.measure.needs_final_pass
    final = replace(table, measure=Measure("trajectory.ate_rmse_m"))
    assert final.measure.needs_final_pass
    assert final.with_final_pass().ran.any(axis=(0, 1, 3)).tolist() == [True, False, True]
    table.columns["refined"][:] = 0.0  # no run was meant to have one
    assert table.with_final_pass().ran.all()


def test_drawn_worlds_with_a_seed_each_have_the_interval_that_decides(tmp_path, monkeypatch):
    monkeypatch.setattr("tests.eval.synthetic_sweep.PLACES", tuple(f"rooms-{n}" for n in range(8)))
    page = write_sweep_report(write_sweep(tmp_path, seeds=1, families=("rooms",) * 8)).read_text()
    assert "too few for the interval that decides" not in page
    assert "1 seed a world (seed 0)" in page
    legend = (tmp_path / "figures" / "differences.svg").read_text()
    assert "95 % interval, which decides" in legend
    text = (tmp_path / "table.md").read_text()
    assert "with the 95 % interval that decides" in text
    assert "*" not in text
    assert "are needed to show" not in text


def test_a_few_runs_that_did_far_better_do_not_stretch_the_axis_of_differences(tmp_path):
    """All runs of 5 are as those of 20, but one that is 3.8 cm better; the margin is 5 mm."""
    write_sweep(tmp_path, lambda p, k, c, s: 0.002 if (c, s) == (1, 0) else 0.04, seeds=20)
    summary = summarise(read_sweep(tmp_path))
    with style():
        low, high = differences(summary).axes[0].get_ylim()
    assert low == pytest.approx(-1.15 * 0.5)
    assert high == pytest.approx(1.15 * 0.75)
