# SPDX-License-Identifier: MIT
"""What a sweep advises where an answer is open: the commands, their cost, and what they will be able to tell."""

import re
from dataclasses import replace

import pytest

from eval.sweep.advice import advice
from eval.sweep.answers import answers
from eval.sweep.job_times import REPORT_SECONDS, duration_words, seconds_for_seeds
from eval.sweep.margin import MARGIN
from eval.sweep.outlook import bound_for, rule_of_thumb
from eval.sweep.report import write_sweep_report
from eval.sweep.results import read_sweep
from eval.sweep.summary import summarise
from tests.eval.synthetic_sweep import COUNTS, PLACES, write_sweep


def advised(folder, **options):
    """What the page of a synthetic sweep advises."""
    return advice(summarise(read_sweep(write_sweep(folder, **options))), "OUT", 2)


def noise(spread, gain=0.0):
    """The middle count is worse by `gain` [m] with noise up to `spread`; the first is far worse."""
    return lambda p, k, c, s: (0.5, 0.02 + gain + spread * ((5 * s) % 8 - 3.5) / 3.5, 0.02)[c]


@pytest.mark.usefixtures("without_pictures")
def test_few_seeds_are_followed_by_a_sweep_that_stops_by_itself(tmp_path):
    (more,) = advised(tmp_path, error=noise(0.003), seeds=3)
    assert more.command == "testbed sweep --out OUT --until decided"  # the default bound is 40
    # a job takes 0.5 s and 0.1 s (0.05 s for the second line) a particle: 6.9 s for each seed of a world
    words = [duration_words(2 * 6.9 * seeds / 2 + REPORT_SECONDS) for seeds in (5, 37)]
    assert more.text.startswith(f"The next look, with 8 seeds, comes in about {words[0]}. ")
    assert f"up to 40 seeds (about {words[1]} at most)" in more.text
    assert more.text.endswith(f" Chance of an answer for a world: {rule_of_thumb(MARGIN)}.")
    page = write_sweep_report(tmp_path).read_text()
    assert f"testbed sweep --out {tmp_path} --until decided" in page


def test_seeds_are_advised_where_they_will_probably_tell(tmp_path):
    (more,) = advised(tmp_path / "soon", error=noise(0.005, gain=0.0005), seeds=8, about={"level": 0.99})
    outlook = summarise(read_sweep(tmp_path / "soon")).decision("cave", "improved").outlook
    assert bound_for(outlook) <= 40  # with the usual limit it ends as soon as it has its answer
    assert more.command == "testbed sweep --out OUT --until decided"
    assert re.search(r"Chance of an answer with 40 seeds: hall_a (about|over) \d+ % \(most likely: 5 ", more.text)
    (more,) = advised(tmp_path / "late", error=noise(0.006, gain=0.001), seeds=10)
    wanted = int(re.search(r"--seeds (\d+) --until decided", more.command)[1])
    outlook = summarise(read_sweep(tmp_path / "late")).decision("cave", "improved").outlook
    assert wanted == bound_for(outlook) > 40


def test_an_answer_of_a_single_look_that_several_looks_reopen_is_named(tmp_path):
    """In cave 5 are enough with 95 % intervals, not with 99 %; hall_a is open with both."""

    def error(p, k, c, s):
        spread = 0.0045 * ((5 * s) % 8 - 3.5) / 3.5
        return (0.5, 0.02 + (0.0036 if p == 0 else 0.0009) + spread, 0.02)[c]

    summary = summarise(read_sweep(write_sweep(tmp_path, error=error, seeds=8)))
    assert [summary.decision(place, "improved").kind for place in PLACES] == ["undecided", "enough"]
    more, *_ = advice(summary, "OUT", 2)
    assert "takes 99 % intervals instead of 95 %, with which cave is open again" in more.text
    assert re.search(r"Chance of an answer with \d+ seeds: hall_a .*, cave about ", more.text)


def test_a_world_that_no_number_of_seeds_decides_gets_a_margin_that_does(tmp_path):
    at_limit = {"error": lambda *index: 0.02 + noise(0.004, gain=0.0051)(*index), "seeds": 10}
    more, *found = advised(tmp_path / "usual", **at_limit)
    assert more.command == "testbed sweep --out OUT --until decided"  # it would go on, with little hope
    assert re.search(r"Chance of an answer with 40 seeds: hall_a about (10|15|20) %", more.text)
    assert [item.title for item in found] == [f"{place} without further seeds" for place in PLACES]
    said = re.fullmatch(
        r"Report the interval, as the tables below have it: 5 particles are (.*); up to 0.5 cm "
        r"\(12 % of the error\) would not matter."
        r" Or report what these seeds do decide: with a margin of (.*) cm \((\d+) % of the error with 20\) 5 particles "
        r"are enough here. Say that this margin was chosen after 10 seeds.",
        found[0].text,
    )
    assert found[0].command == ""  # another margin would be one for all worlds
    assert float(said[3]) == pytest.approx(100.0 * float(said[2]) / 4.0, abs=1.0)
    write_sweep(tmp_path / "wider", **at_limit, about={"margin": f"{said[2]}cm"})
    assert summarise(read_sweep(tmp_path / "wider")).decision("hall_a", "improved").kind == "enough"


def test_where_the_limit_that_was_set_is_reached_a_higher_one_is_offered(tmp_path):
    more, *_ = advised(tmp_path, error=noise(0.004, gain=0.0036), seeds=16, about={"level": 0.99})
    answer = answers(summarise(read_sweep(tmp_path)), "improved")[0]
    assert answer.needs.startswith("with 40 seeds the chance of any answer is about ")
    assert (more.title, more.command) == ("Raise the limit to 40 seeds", "testbed sweep --out OUT --until decided")
    assert "The next look, with 24 seeds, comes in about " in more.text


def test_a_world_that_further_seeds_would_hardly_decide_says_why_it_gets_none(tmp_path):
    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(32, 40))
    options = {"seeds": 40, "missing": missing, "about": {"level": 0.99}}
    table = read_sweep(write_sweep(tmp_path, error=noise(0.004, gain=0.005), **options)).judged()
    status = table.columns["status"].copy()
    status[status == "missing"] = "given up"
    summary = summarise(replace(table, columns=table.columns | {"status": status}))
    assert re.fullmatch(
        r"no more seeds are added: the chance of an answer with up to 40 is (under|about) 5 %, and a world goes on "
        r"from 10 %",
        answers(summary, "improved")[0].needs,
    )


def test_a_margin_within_which_a_count_is_hardly_as_good_is_not_offered(tmp_path):
    found = advised(tmp_path, error=noise(0.004, gain=0.0051), seeds=10)
    assert found
    assert not any("Or report" in item.text for item in found)  # the margin would be half of the error


@pytest.mark.usefixtures("without_pictures")
def test_nothing_is_advised_where_all_is_decided(tmp_path):
    assert advised(tmp_path, error=lambda p, k, c, s: 0.02) == []
    assert "What to do next" not in write_sweep_report(tmp_path).read_text()


def test_an_unfinished_sweep_is_gone_on_with_if_that_helps(tmp_path):
    missing = frozenset((p, k, c, 9) for p in range(2) for k in range(2) for c in range(3))
    (go_on,) = advised(tmp_path, error=noise(0.006, gain=0.001), missing=missing)
    assert go_on.command == "testbed sweep --out OUT"
    assert go_on.text.startswith(f"In about {duration_words(2 * 6.9 / 2 + REPORT_SECONDS)}.")


def test_runs_of_unfinished_seeds_shorten_the_time_to_the_next_look(tmp_path):
    """Seeds 8 to 15 were computed with the smallest count only: they are left out of the answers, but are there."""
    later = [(p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(8, 40)]
    unfinished = frozenset(index for index in later if index[2] > 0 or index[3] >= 16)
    times = {}
    for name, missing in (("none", frozenset(later)), ("some", unfinished)):
        write_sweep(tmp_path / name, error=noise(0.006, gain=0.001), seeds=40, missing=missing, about={"level": 0.99})
        table = read_sweep(tmp_path / name).judged()
        times[name] = seconds_for_seeds(table, PLACES, 16, 1) - REPORT_SECONDS
    job = {(k, c): 0.1 * COUNTS[c] * (1.0 - 0.5 * k) + 0.5 for k in range(2) for c in range(3)}
    assert times["none"] == pytest.approx(2 * 8 * sum(job.values()))
    assert times["some"] == pytest.approx(2 * 8 * sum(seconds for (_, c), seconds in job.items() if c > 0))


def test_a_world_that_will_stay_open_may_be_left(tmp_path):
    """In cave the difference lies at the margin, in hall_a it is clear with some more seeds."""

    def error(p, k, c, s):
        gain = (0.001, 0.0051)[p] + (0.004, 0.008)[p] * ((5 * s) % 8 - 3.5) / 3.5
        return (0.5, 0.02 + gain, 0.02)[c]

    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(8, 40))
    write_sweep(tmp_path, error=error, seeds=40, missing=missing, about={"level": 0.99})
    found = advice(summarise(read_sweep(tmp_path).judged()), "OUT", 2)
    assert [item.command for item in found[:2]] == ["testbed sweep --out OUT", "testbed sweep --out OUT --give-up cave"]
    assert found[1].title == "Go on with hall_a only"


def test_a_sweep_that_will_stay_open_may_be_stopped(tmp_path):
    """Where all open answers are improbable; a world that was left before stays left."""
    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(8, 40))
    write_sweep(tmp_path, error=noise(0.008, gain=0.0051), seeds=40, missing=missing, about={"level": 0.99})
    summary = summarise(read_sweep(tmp_path).judged())
    go_on, stop, *_ = advice(summary, "OUT", 2)
    assert "Chance of an answer with 40 seeds: hall_a about " in go_on.text
    assert (stop.title, stop.command) == ("Stop here", "testbed sweep --out OUT --give-up hall_a,cave")
    table = summary.table
    status = table.columns["status"].copy()
    status[0][status[0] == "missing"] = "given up"
    left = replace(table, left=("hall_a",), columns=table.columns | {"status": status})
    *_, stop, _, _, again = advice(summarise(left), "OUT", 2)
    assert stop.command == "testbed sweep --out OUT --give-up hall_a,cave"
    assert again.title == "Take hall_a up again"
    assert again.command.startswith("testbed sweep --out OUT ")
    assert again.command.endswith(" --give-up none")


def test_where_all_open_worlds_were_given_up_the_page_says_how_to_take_them_up_again(tmp_path):
    """The command that adds seeds would compute nothing."""
    summary = summarise(read_sweep(write_sweep(tmp_path, seeds=3)).judged())
    left = summarise(replace(summary.table, left=("hall_a", "cave")))
    (again,) = advice(left, "OUT", 2)
    assert (again.title, again.command) == (
        "Take hall_a and cave up again",
        "testbed sweep --out OUT --until decided --give-up none",
    )
    assert again.text.startswith("The next look, with 8 seeds, comes in about ")


def test_a_sweep_that_has_its_answers_may_go_on_to_fewer_particles(tmp_path):
    """With cost and chance; where that is what it does, the same command goes on."""
    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(8, 40))
    error = lambda p, k, c, s: 0.02 + (0.0015 * ((5 * s) % 8 - 3.5) if (p, c) == (0, 0) else 0.0)  # noqa: E731
    write_sweep(tmp_path, error=error, seeds=40, missing=missing, about={"level": 0.99, "until": "decided"})
    table = read_sweep(tmp_path).judged()
    (fewer,) = advice(summarise(table), "OUT", 2)
    assert fewer.title == "Go on to fewer particles"
    assert fewer.command == "testbed sweep --out OUT --until smallest"
    assert fewer.text.startswith(
        "The answers stay; this asks whether a smaller count is enough too in hall_a. The next "
    )
    assert re.search(r"Chance of an answer with 40 seeds: hall_a (about|over) \d+ % \(most likely: 1 is ", fewer.text)
    go_on, *_ = advice(summarise(replace(table, until="smallest")), "OUT", 2)
    assert (go_on.title, go_on.command) == ("Go on, where it was stopped", "testbed sweep --out OUT")


def test_a_lower_limit_is_named_where_it_will_probably_do(tmp_path):
    (more,) = advised(tmp_path, error=noise(0.005, gain=0.0), seeds=8, about={"level": 0.99, "until": "decided"})
    limit = int(re.search(r"With --seeds (\d+) as the limit: hall_a (about|over) ", more.text)[1])
    assert 16 <= limit < 40


def test_going_on_to_fewer_particles_goes_on_with_open_worlds_too_and_costs_that(tmp_path):
    missing = frozenset((p, k, c, s) for p in range(2) for k in range(2) for c in range(3) for s in range(8, 40))

    def error(p, k, c, s):
        spread = ((5 * s) % 8 - 3.5) / 3.5
        return 0.02 + (0.005 * spread if (p, c) in ((0, 1), (1, 0)) else 0.0)

    write_sweep(tmp_path, error=error, seeds=40, missing=missing, about={"level": 0.99, "until": "decided"})
    summary = summarise(read_sweep(tmp_path).judged())
    assert [summary.decision(place, "improved").kind for place in PLACES] == ["undecided", "enough"]
    (fewer,) = [item for item in advice(summary, "OUT", 2) if item.title == "Go on to fewer particles"]
    assert "is enough too in cave. It goes on with hall_a as well; --give-up hall_a leaves that." in fewer.text
    words = duration_words(seconds_for_seeds(summary.table, PLACES, 40, 2))
    assert words != duration_words(seconds_for_seeds(summary.table, ["cave"], 40, 2))
    assert f"up to 40 seeds (about {words} at most)" in fewer.text
