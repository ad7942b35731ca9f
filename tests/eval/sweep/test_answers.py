# SPDX-License-Identifier: MIT
"""Answers in words."""

import dataclasses
import re

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from eval.sweep.answer_words import alone, likely_answer
from eval.sweep.answers import WITHIN_PAIRS, answers
from eval.sweep.outlook import bound_for, chance_sentence
from eval.sweep.paper_tables import figure_caption, markdown_table
from eval.sweep.report import write_sweep_report
from eval.sweep.results import read_sweep
from eval.sweep.statistics import paired_difference
from eval.sweep.summary import summarise
from tests.eval.synthetic_sweep import COUNTS, write_sweep

pytestmark = pytest.mark.usefixtures("without_pictures")
KEPT = "if you keep the final pass, the default of testbed run, "
"""Beginning of the line about the final pass."""


def sentences(folder, line="improved", **options):
    return [answer.sentence for answer in answers(summarise(read_sweep(write_sweep(folder, **options))), line)]


def level(*errors):
    """Errors [m] by count, with 2 % noise between seeds."""
    return lambda p, k, c, s: errors[c] * (1.0 + 0.02 * ((7 * s + 3 * c) % 5 - 2) / 2.0)


def test_a_count_that_is_enough_stands_with_its_error(tmp_path):
    assert sentences(tmp_path, error=level(0.05, 0.0241, 0.022)) == [
        "hall_a, 1 route: 5 particles are enough (2.4 cm; 20 give 2.2 cm).",
        "cave, 1 route: 5 particles are enough (2.4 cm; 20 give 2.2 cm).",
    ]
    assert sentences(tmp_path, error=level(0.022, 0.022, 0.022))[0] == (
        "hall_a, 1 route: 1 particle is enough (2.2 cm; 20 give 2.2 cm)."
    )


def test_a_card_says_how_a_decided_world_goes_on_to_smaller_counts(tmp_path):
    def spread(p, k, c, s):
        return 0.02 + (0.0015 * ((5 * s) % 8 - 3.5) if c == 0 else 0.0)

    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(8, 40))
    write_sweep(tmp_path, spread, seeds=40, missing=missing, about={"level": 0.99})
    answer = answers(summarise(read_sweep(tmp_path).judged()), "improved")[0]
    assert answer.headline == "5 particles are enough"
    assert re.fullmatch(
        r"fewer than 5 may be enough too: with \d+ seeds the chance of any answer is about \d+ % "
        r"\(most likely: 1 is enough\); --until smallest goes on to it",
        answer.needs,
    )
    assert answer.lines[1].startswith("  5 particles are 0.00 cm worse than 20 in the median pair of runs")
    assert answer.lines[2].startswith("  Fewer than 5 may be enough too: with")
    going_on = summarise(dataclasses.replace(read_sweep(tmp_path), until="smallest").judged())
    assert "--until smallest" not in answers(going_on, "improved")[0].needs


def test_what_an_earlier_look_decided_is_said_with_its_seeds_wherever_it_stands(tmp_path):
    """5 are as good as 20 in the first 8 seeds, and some 2 cm worse in the 8 that were added for 1."""

    def later(p, k, c, s):
        return (0.02 + 0.003 * ((5 * s) % 8 - 3.5), 0.02 if s < 8 else 0.03 + 0.002 * (s - 8), 0.02)[c]

    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(16, 40))
    write_sweep(tmp_path, later, seeds=40, missing=missing, about={"level": 0.99, "until": "smallest"})
    summary = summarise(read_sweep(tmp_path).judged())
    answer = answers(summary, "improved")[0]
    assert (answer.headline, answer.detail) == ("5 particles are enough", "2.0 cm; 20 give 2.0 cm in the first 8 seeds")
    of_all = paired_difference(summary.table.error[0, 0, 1], summary.table.error[0, 0, 2], level=0.99)
    assert f"99 % interval after 8 seeds], of all 16 runs {100 * of_all.value:.2f} worse; up to" in answer.difference
    assert answer.reversal == ""
    text = markdown_table(summary)
    assert f"(8); all +{100 * of_all.value:.2f} [+{100 * of_all.low:.2f}, +{100 * of_all.high:.2f}] |" in text
    assert "(8): of the first 8 seeds, which decided; all: of all runs." in text
    assert "Where the first 8 seeds decided, marks are of these." in figure_caption(summary)
    assert "+0.00 [+0.00, +0.00] (first 8 seeds)" in write_sweep_report(tmp_path).read_text()


def test_a_count_below_one_that_is_worse_may_not_be_enough(tmp_path):
    """Counts are tested from the largest down: 5 is shown to be worse, so 1 cannot be an answer, open as it is."""

    def error(p, k, c, s):
        return (0.02 + 0.004 * ((5 * s) % 8 - 3.5), 0.05, 0.02)[c]

    summary = summarise(read_sweep(write_sweep(tmp_path, error)))
    assert summary.decision("cave", "improved").states == ("open", "worse")
    answer = answers(summary, "improved")[0]
    assert (answer.kind, answer.needs) == ("more", "")


def test_an_end_of_an_interval_beside_the_margin_is_not_shown_as_the_margin(tmp_path):
    """Half of the pairs of runs of 5 and 20 differ by 5.04 mm, where up to 5 mm would not matter."""

    def error(p, k, c, s):
        return (0.5, 0.02 + (0.00504 if s % 2 else 0.001), 0.02)[c]

    summary = summarise(read_sweep(write_sweep(tmp_path, error)))
    answer = answers(summary, "improved")[0]
    assert answer.kind == "undecided"
    assert "0.504 worse; 95 % interval]; up to 0.5 cm" in answer.difference
    assert "+0.504]" in markdown_table(summary)


def test_medians_that_round_alike_have_another_digit(tmp_path):
    found = sentences(tmp_path, error=level(0.0178, 0.0178, 0.0176))
    assert found[0] == "hall_a, 1 route: 1 particle is enough (1.78 cm; 20 give 1.76 cm)."


def test_more_and_undecided_are_different_answers(tmp_path):
    assert sentences(tmp_path, error=level(0.5, 0.2, 0.1))[0] == (
        "hall_a, 1 route: more than 5 particles (5 give 20.0 cm, 20 give 10.0 cm; more were not tested)."
    )
    assert sentences(tmp_path, error=level(0.02, 0.02, 0.02), seeds=3)[0] == (
        "hall_a, 1 route: too few seeds (3): at least 8 are needed; take 20 for now (5 particles were between 0.06 "
        "cm better and 0.04 cm worse than 20 in 3 runs; up to 0.5 cm (25 % of the error) would not matter)."
    )
    assert sentences(tmp_path, error=level(0.02, 0.02, 0.02), seeds=1)[0] == (
        "hall_a, 1 route: too few seeds (1): at least 8 are needed; take 20 for now (5 particles were 0.04 cm worse "
        "than 20 in one run; up to 0.5 cm (25 % of the error) would not matter)."
    )


def test_the_difference_that_is_open_stands_with_its_margin(tmp_path):
    def noisy(p, k, c, s):
        return 0.1 + (0.0, 0.012 * (s % 5 - 2), 0.0)[c] + 0.0005 * ((3 * s) % 7)

    (answer, _) = answers(summarise(read_sweep(write_sweep(tmp_path, error=noisy))), "improved")
    assert answer.headline == "undecided with 10 seeds"
    head, *parts = answer.lines
    assert head == "hall_a, 1 route: undecided with 10 seeds; take 20 for now; 1 will probably do."
    assert [part.strip(" .").lower() for part in parts] == [
        words.lower() for words in (answer.detail, answer.difference, answer.needs, answer.risk)
    ]
    assert answer.detail == (
        "1 passes its own test, 5 is open; 1 is an answer only when 5 passes too, since counts are tested from the "
        "largest down"
    )
    assert answer.today == "take 20 for now; 1 will probably do"
    assert answer.medians == "10.2 cm with 1 to 20"
    words = (
        r"5 particles are \d\.\d\d cm (better|worse) than 20 in the median pair of runs "
        r"\[\d\.\d\d better to \d\.\d\d worse; 95 % interval\]; "
        r"up to 1 cm \(10 % of the error\) would not matter"
    )
    assert re.fullmatch(words, answer.difference)
    summary = summarise(read_sweep(tmp_path))
    outlook = summary.decision("hall_a", "improved").outlook
    assert outlook.is_within
    assert bound_for(outlook) > 40  # the usual limit
    assert answer.needs == chance_sentence(outlook, [40], "1 is enough")


def test_medians_stand_in_the_order_of_the_counts(tmp_path):
    """The error falls with the count, the middle one is noisy."""

    def falling(p, k, c, s):
        return (0.033, 0.028 + 0.012 * (s % 5 - 2), 0.022)[c]

    (answer, _) = answers(summarise(read_sweep(write_sweep(tmp_path, error=falling))), "improved")
    assert answer.medians == ("3.3 cm with 1, 2.8 with 5, 2.2 with 20")


def test_a_sweep_with_several_looks_gives_level_and_chance(tmp_path):
    def noisy(p, k, c, s):
        return 0.02 + 0.001 * (0.0, 6.0 * ((5 * s) % 8 - 3.5) / 3.5, 0.0)[c]

    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(8, 40))
    write_sweep(tmp_path, error=noisy, seeds=40, missing=missing, about={"level": 0.99})
    summary = summarise(read_sweep(tmp_path).judged())
    (answer, _) = answers(summary, "improved")
    assert "; 99 % interval]; up to 0.5 cm (25 % of the error) would not matter" in answer.difference
    outlook = summary.decision("hall_a", "improved").outlook
    assert answer.needs == chance_sentence(outlook, [16, 24, 32, 40], "1 is enough")


def test_an_answer_of_an_earlier_look_states_the_margin_of_that_look(tmp_path):
    """5 are found to be enough after 8 seeds; 1 is open then, so there are 8 more, in which all errors are a fifth."""

    def falling(p, k, c, s):
        return 0.1 * (1.0 if s < 8 else 0.2) + (0.03 * (s % 3 - 1), 0.007, 0.0)[c]

    write_sweep(tmp_path, error=falling, seeds=16, about={"level": 0.975})
    summary = summarise(read_sweep(tmp_path).judged())
    (answer, _) = answers(summary, "improved")
    assert answer.headline == "5 particles are enough"
    assert "97.5 % interval after 8 seeds]" in answer.difference
    assert answer.difference.endswith("; up to 1 cm (10 % of the error) does not matter")
    assert summary.decision("hall_a", "improved").limit < 0.007


def test_the_chance_is_that_of_a_named_answer(tmp_path):
    """The largest open count decides: it is probably worse, or enough together with the counts below that pass."""

    def noisy(offset):
        return lambda p, k, c, s: 0.1 + (0.0, offset + 0.015 * (s % 5 - 2), 0.0)[c]

    def likely(name, error):
        summary = summarise(read_sweep(write_sweep(tmp_path / name, error=error)))
        return likely_answer(summary.decision("hall_a", "improved"), COUNTS)

    assert likely("within", noisy(0.005)) == "1 is enough"  # 1 passes its own test
    assert likely("worse", noisy(0.015)) == "more than 5"

    def smallest_open(offset):
        return lambda p, k, c, s: 0.1 + (offset + 0.015 * (s % 5 - 2), 0.0, 0.0)[c]

    assert likely("lower", smallest_open(0.005)) == "1 is enough"
    assert likely("lower_worse", smallest_open(0.015)) == "1 is not enough"
    assert likely("decided", lambda p, k, c, s: 0.1) == ""


def test_a_difference_says_which_side_is_better(tmp_path):
    """Both ends of the interval are worse, or there is no difference."""
    write_sweep(tmp_path / "worse", error=lambda p, k, c, s: 0.02 + (0.001 + 0.0001 * s) * (c < 2))
    (answer, _) = answers(summarise(read_sweep(tmp_path / "worse")), "improved")
    assert answer.difference.startswith("1 particle is 0.14 cm worse than 20 in the median pair of runs [0.1")
    assert " worse; 95 % interval]; up to 0.5 cm (25 % of the error) does not matter" in answer.difference
    assert "better" not in answer.difference
    write_sweep(tmp_path / "same", error=lambda p, k, c, s: 0.02)
    (answer, _) = answers(summarise(read_sweep(tmp_path / "same")), "improved")
    assert answer.difference.startswith(
        "1 particle is 0.00 cm worse than 20 in the median pair of runs [0.00 to 0.00 worse; "
    )


def test_more_failures_that_keep_an_answer_open_are_named(tmp_path):
    write_sweep(tmp_path, error=level(0.5, 0.02, 0.02), outcome=lambda p, k, c, s: "lost" if c == 1 and s < 2 else "ok")
    (answer, _) = answers(summarise(read_sweep(tmp_path)), "improved")
    assert answer.detail == "1 is shown to be worse, 5 is open; 5 failed in 2 of 10 runs, 20 in 0 of 10"
    assert answer.needs == "how many would tell cannot be said"


def test_a_lower_count_that_failed_more_often_is_not_said_to_be_enough_perhaps(tmp_path):
    write_sweep(
        tmp_path,
        error=lambda p, k, c, s: 0.02 + (0.02 * ((5 * s) % 8 - 3.5) if c == 0 else 0.0),
        outcome=lambda p, k, c, s: "lost" if c == 0 and s == 4 else "ok",
    )
    (answer, _) = answers(summarise(read_sweep(tmp_path)), "improved")
    assert answer.headline == "5 particles are enough"
    assert answer.needs == "1 is not shown to be enough, and failed in 1 of 10 runs"


def test_a_world_in_which_all_counts_fail_says_so(tmp_path):
    lost = sentences(tmp_path, outcome=lambda p, k, c, s: "lost" if p == 0 else "ok")
    assert lost[0] == "hall_a, 1 route: no tested count works, up to 20 particles (20 fail in 10 of 10 runs)."
    assert "enough" in lost[1]


def test_long_errors_are_told_in_metres(tmp_path):
    assert "(6.0 m; 20 give 6.0 m)" in sentences(tmp_path, error=level(6.0, 6.0, 6.0))[0]


def test_kinds_of_buildings_come_first_with_the_number_of_worlds(tmp_path, monkeypatch):
    places = (*(f"rooms-{n}" for n in range(8)), "office")
    monkeypatch.setattr("tests.eval.synthetic_sweep.PLACES", places)
    families = (*["rooms"] * 8, None)
    found = sentences(tmp_path, error=level(0.05, 0.02, 0.02), seeds=2, families=families)
    assert found == [
        "rooms, 8 worlds, 8 routes: 5 particles are enough (1.99 cm; 20 give 2.00 cm).",
        "office, 1 route: too few seeds (2): at least 8 are needed; take 20 for now (5 particles were between 0.06 "
        "cm better and 0.04 cm worse than 20 in 2 runs; up to 0.5 cm (25 % of the error) would not matter).",
    ]
    assert len(COUNTS) == 3


def test_drawn_worlds_with_fewer_seeds_are_complete(tmp_path, monkeypatch):
    """Rows of seeds that were not asked for are not in the table, and nothing is said to be missing."""
    places = (*(f"rooms-{n}" for n in range(8)), "office")
    monkeypatch.setattr("tests.eval.synthetic_sweep.PLACES", places)
    write_sweep(tmp_path, level(0.05, 0.02, 0.02), seeds=8, families=(*["rooms"] * 8, None), route="random")
    tables = {name: pq.read_table(tmp_path / f"{name}.parquet") for name in ("sweep", "curves", "timings")}
    own = tables["sweep"]
    tables["sweep"] = own.filter(pc.or_(pc.equal(own["seed"], 0), pc.equal(own["place"], "office")))
    for name, table in tables.items():
        kept = table.filter(pc.is_in(table["key"], tables["sweep"]["key"].combine_chunks()))
        pq.write_table(kept, tmp_path / f"{name}.parquet")
    table = read_sweep(tmp_path)
    found = [answer.sentence for answer in answers(summarise(table.judged()), "improved")]
    assert found == [
        "rooms, 8 worlds, 8 routes: 5 particles are enough (2.02 cm; 20 give 1.98 cm).",
        "office, 8 routes: 5 particles are enough (2.00 cm; 20 give 1.99 cm).",
    ]
    page = write_sweep_report(tmp_path).read_text()
    assert "Incomplete" not in page
    assert "1 to 8 seeds a world (seeds 0 in 8 worlds; 0 to 7 in 1 world): each seed drives another route" in page


def test_the_answer_says_on_how_many_routes_it_rests(tmp_path):
    same = level(0.022, 0.022, 0.022)
    missing = frozenset((0, 0, c, 9) for c in range(len(COUNTS)))
    random = sentences(tmp_path / "random", error=same, route="random", missing=missing)
    assert [sentence.partition(":")[0] for sentence in random] == ["hall_a, 9 routes", "cave, 10 routes"]
    logs = sentences(tmp_path / "logs", error=same, about={"recorded": True})
    assert logs[0].startswith("hall_a: ")


def test_a_smaller_margin_changes_the_answer_and_stands_with_it(tmp_path):
    errors = level(0.0251, 0.0221, 0.022)
    assert "1 particle is enough" in sentences(tmp_path / "usual", error=errors)[0]
    write_sweep(tmp_path / "small", error=errors, about={"margin": "2mm"})
    summary = summarise(read_sweep(tmp_path / "small"))
    answer = answers(summary, summary.table.baseline)[0]
    assert answer.headline == "5 particles are enough"
    assert answer.difference.endswith("; up to 0.2 cm (9 % of the error) does not matter")
    write_sweep(tmp_path / "share", error=errors, about={"margin": "20%"})
    summary = summarise(read_sweep(tmp_path / "share"))
    assert answers(summary, summary.table.baseline)[0].difference.endswith(
        "; up to 0.44 cm (20 % of the error) does not matter"
    )


@pytest.mark.parametrize("errors", [(0.022, 0.022, 0.022), (0.05, 0.05, 0.022)], ids=["enough", "more"])
@pytest.mark.parametrize("seeds", [3, 10])
def test_failures_stand_in_the_terminal_whatever_is_known(tmp_path, errors, seeds):
    write_sweep(tmp_path, error=level(*errors), seeds=seeds, outcome=lambda p, k, c, s: "lost" if s == 1 else "ok")
    answer = answers(summarise(read_sweep(tmp_path)), "improved")[0]
    assert answer.kind == ("undecided" if seeds == 3 else "enough" if errors[0] == 0.022 else "more")
    count = "1 particle" if answer.kind == "enough" else "20 particles"
    assert answer.lines[-1].startswith(f"  {count}: 1 of {seeds} runs failed (a rate up to ")


def test_what_enough_promises_stands_with_it(tmp_path):
    write_sweep(tmp_path, error=level(0.022, 0.022, 0.022), outcome=lambda p, k, c, s: "lost" if s == 3 else "ok")
    summary = summarise(read_sweep(tmp_path))
    answer = answers(summary, summary.table.baseline)[0]
    # the end of Wilson's interval
    assert answer.risk == "1 particle: 1 of 10 runs failed (a rate up to 40 % is possible)"
    assert answer.difference.startswith("1 particle is ")
    undecided = summarise(read_sweep(write_sweep(tmp_path / "few", seeds=3)))
    few = answers(undecided, undecided.table.baseline)[0].risk
    assert few == "20 particles: no failure in 3 runs (a rate up to 56 % is possible)"


def test_a_smaller_count_that_looks_better_by_noise_gets_a_word(tmp_path):
    def error(p, k, c, s):
        """5 is better than 20 in the median of cave by noise, and in hall_a always."""
        return 0.03 + (0.0, (-0.002, -0.002 + 0.003 * ((5 * s) % 8 - 3.5))[p], 0.0)[c]

    hall, cave = answers(summarise(read_sweep(write_sweep(tmp_path / "many", error, seeds=8))), "improved")
    assert hall.reversal == ""
    assert cave.reversal == "that 5 look better than 20 (2.8 against 3.0 cm) is within the noise of 8 seeds"
    hall, _ = answers(summarise(read_sweep(write_sweep(tmp_path / "few", error, seeds=3))), "improved")
    assert hall.reversal == "that 5 look better than 20 (2.8 against 3.0 cm) may be noise: 3 seeds cannot tell"
    page = write_sweep_report(tmp_path / "many").read_text()
    assert "That 5 look better than 20 (2.8 against 3.0 cm) is within the noise of 8 seeds" in page
    same, _ = answers(summarise(read_sweep(write_sweep(tmp_path / "same", level(0.05, 0.03, 0.02)))), "improved")
    assert same.reversal == ""


def test_the_answer_after_the_final_pass_stands_on_the_card(tmp_path, monkeypatch):
    """In the tables it divides every error by five; the seeds differ from count to count by nothing."""

    def error(p, k, c, s):
        return (0.05, 0.03, 0.02)[c] + 0.001 * s

    write_sweep(tmp_path / "many", error, seeds=8, missing=frozenset({(0, 0, 2, 7)}))
    hall, cave = answers(summarise(read_sweep(tmp_path / "many")), "improved")
    assert cave.final_pass == f"{KEPT}the count still matters: {WITHIN_PAIRS} +0.60 cm [+0.60, +0.60]"
    figures = "1.07 cm with 1, 0.47 cm with 20 (8 runs each; paired difference: +0.60 cm [+0.60, +0.60]; 95 % interval)"
    assert cave.final_pass_figures == figures
    assert hall.final_pass_figures.startswith("1.06 cm with 1, 0.46 cm with 20 (7 runs each; ")
    page = write_sweep_report(tmp_path / "many").read_text()
    assert page.index(f"I{cave.final_pass[1:]}<") < page.index(f"After the final pass: {figures}")
    online = write_sweep(tmp_path / "online", measure="trajectory_online.ate_rmse_m")
    assert answers(summarise(read_sweep(online)), "improved")[0].final_pass == ""
    equal = write_sweep(tmp_path / "equal", lambda p, k, c, s: 0.02 - 1e-5 * (c == 0))
    assert (
        "difference: +0.00 cm [+0.00, +0.00]" in answers(summarise(read_sweep(equal)), "improved")[0].final_pass_figures
    )
    monkeypatch.setattr("tests.eval.synthetic_sweep.PLACES", ("rooms-0", "rooms-1"))
    (rooms,) = answers(summarise(read_sweep(write_sweep(tmp_path / "f", error, families=("rooms",) * 2))), "improved")
    assert "(2 worlds; paired difference: +0.60 to +0.60 cm in 2 runs)" in rooms.final_pass_figures


def test_what_the_final_pass_leaves_gets_a_conclusion_where_it_is_shown(tmp_path):
    """In the tables it divides every error by five: 1 is worse than 20 by 8 mm in hall_a, by 4 mm in cave."""

    def error(p, k, c, s):
        return 0.02 + ((0.04, 0.02)[p] if c == 0 else 0.0)

    def conclusions(name, **options):
        found = answers(summarise(read_sweep(write_sweep(tmp_path / name, error, **options))), "improved")
        return [answer.final_pass.removeprefix(KEPT).partition(": ")[0] for answer in found]

    shown = conclusions("shown", seeds=8)
    assert shown == [
        "the count still matters",
        "1 does as well",
    ]
    assert conclusions("few", seeds=3) == ["it is not shown whether 1 does as well"] * 2
    few, _ = answers(summarise(read_sweep(tmp_path / "few")), "improved")
    assert few.final_pass.endswith(": 1.20 cm against 0.40 cm, 3 runs are too few to tell")
    wide = conclusions("wide", seeds=8, about={"margin": "1cm"})
    assert wide == ["1 does as well"] * 2


def test_failures_after_the_final_pass_forbid_the_conclusion(tmp_path):
    write_sweep(tmp_path, level(0.02, 0.02, 0.02), seeds=8)
    table = read_sweep(tmp_path)
    table.columns["outcome"][0, 0, 0, 2] = "lost"  # hall_a, improved, 1 particle
    hall, cave = answers(summarise(table), "improved")
    assert hall.final_pass.startswith(f"{KEPT}it is not shown whether 1 does as well")
    assert cave.final_pass.startswith(f"{KEPT}1 does as well: ")


def test_medians_that_contradict_the_pairs_say_why(tmp_path):
    """The pairs, which decide, come first on the page and below the answer in the terminal."""
    base = (10.0, 10.1, 10.2, 10.3, 17.66, 18.0, 18.1, 18.2, 18.3)
    pairs = (1.4, 1.4, 1.4, 1.4, -0.02, 1.4, -0.1, -0.1, -0.1)  # medians 17.64 and 17.66 mm, of the pairs +1.4 mm

    def error(p, k, c, s):
        return 0.001 * (base[s] + (pairs[s] if (p, c) == (0, 0) else 0.0))

    write_sweep(tmp_path, error, seeds=9)
    hall, cave = answers(summarise(read_sweep(tmp_path)), "improved")
    why = (
        "not these medians decide, which lie 0.01 cm apart, but the differences within pairs of runs, of which the "
        "median is 0.14 cm worse"
    )
    assert (hall.detail, hall.decides) == ("1.76 cm; 20 give 1.77 cm", why)
    assert hall.lines[0].endswith(f"1 particle is enough (1.76 cm; 20 give 1.77 cm; {why}).")
    assert hall.lines[1].startswith("  1 particle is 0.14 cm worse than 20 in the median pair of runs [")
    assert cave.decides == ""
    page = write_sweep_report(tmp_path).read_text()
    assert page.index("1 particle is 0.14 cm worse than 20") < page.index("Median error 1.76 cm; 20 give 1.77 cm")
    assert f"<strong>Median error {cave.detail}</strong>" in page


def test_medians_far_from_the_pairs_say_why_also_where_both_point_the_same_way(tmp_path):
    """Medians 0.95 and 0.91 cm beside a difference of 0.17 cm puzzled a reader; 0.02 cm more or less does not."""
    base = (8.0, 8.1, 8.2, 8.3, 9.1, 9.6, 9.7, 9.8, 9.9)
    pairs = (1.7, 1.7, 1.7, 1.7, 0.4, 1.7, -0.1, -0.1, -0.1)

    def error(p, k, c, s):
        return 0.001 * (base[s] + ((pairs[s], 0.2)[p] if c == 0 else 0.0))

    hall, cave = answers(summarise(read_sweep(write_sweep(tmp_path, error, seeds=9))), "improved")
    assert "which lie 0.07 cm apart" in hall.decides
    assert "the median is 0.17 cm worse" in hall.decides
    assert cave.decides == ""


def test_a_single_particle_is_called_scan_matching(tmp_path):
    for name, errors in (("one", (0.02, 0.02, 0.02)), ("more", (0.2, 0.02, 0.02))):
        hall, _ = answers(summarise(read_sweep(write_sweep(tmp_path / name, level(*errors), seeds=8))), "improved")
        assert (hall.alone != "") == (name == "one")
        assert hall.alone.endswith("scan matching") or not hall.alone  # 90 % of the truth is inside in these tables
        page = write_sweep_report(tmp_path / name).read_text()
        assert ("and no choice between maps: it is scan matching" in page) == (name == "one")


def test_a_single_particle_that_is_too_sure_is_called_so():
    assert alone(0.04).endswith("far too sure: the truth is inside its 95 % ellipsoid at 4 % of the updates")
    assert alone(0.9) == alone(float("nan"))
    assert alone(0.9).endswith("it is scan matching")


def test_the_margin_after_the_final_pass_is_said_as_a_share_of_the_error_there(tmp_path):
    """In the tables the final pass divides every error by five: 0.10 / 5 = 2 cm, of which 5 mm are a quarter."""
    hall, _ = answers(summarise(read_sweep(write_sweep(tmp_path, level(0.10, 0.10, 0.10), seeds=8))), "improved")
    assert hall.final_pass.startswith(f"{KEPT}1 does as well: ")
    assert hall.final_pass.endswith("(margin 0.5 cm, 25 % of the error there)")


def test_a_world_that_was_given_up_says_so_also_with_too_few_seeds(tmp_path):
    table = read_sweep(write_sweep(tmp_path, seeds=3))
    hall, cave = answers(summarise(dataclasses.replace(table, left=("hall_a",))), "improved")
    assert hall.needs == "you gave this world up after 3 seeds (--give-up none takes it up again)"
    assert cave.needs == ""


def test_a_margin_above_the_whole_error_is_called_so(tmp_path):
    hall, _ = answers(summarise(read_sweep(write_sweep(tmp_path, level(0.02, 0.02, 0.02), seeds=8))), "improved")
    assert hall.final_pass == (
        f"{KEPT}1 does as well: both errors, 0.40 cm and 0.40 cm, are below the margin of 0.5 cm; "
        f"{WITHIN_PAIRS} +0.00 cm [+0.00, +0.02]"
    )
