# SPDX-License-Identifier: MIT
"""Suggestions follow the fit: harder drives need more, and the reasons say which feature it is."""

import numpy as np
import pytest

from eval.sweep.needed_count import NeededCount
from testbed.cli.shared.sweep_suggestion import check_command, origin, sentences
from testbed.sweep.errors import SweepError
from testbed.sweep.suggest import features_of_log, features_of_world, is_world, suggest
from tests.shell import call
from tests.testbed.sweep.room import room_file

EASY = {"longest_unknown_m": 16.0, "odometry_deg_per_m": 1.0, "scan_observability": 0.5}


def model() -> NeededCount:
    """Doubling the way through unknown floor costs as much as a quarter of the particles gives."""
    one = np.array([4.0, 0.5, -1.0, 0.0, 0.0])
    shift = np.array([0.2, 0.0, 0.0, 0.0, 0.0])
    none = np.zeros((3, 2))
    return NeededCount(
        max_count=64,
        centre=np.array([4.0, 0.0, -1.0]),
        low=np.array([3.0, -1.0, -3.0]),
        high=np.array([8.0, 2.0, 0.0]),
        holding=np.array([one, one + shift, one - shift]),
        holding_spread=none,
        growth=np.zeros((3, 4)),
        growth_spread=none,
        provenance={"runs": 1, "worlds": 1},
    )


def test_longer_ways_need_more_particles_and_are_the_reason():
    needed = []
    for metres in (16.0, 64.0, 128.0, 256.0):
        found = suggest("ring", EASY | {"longest_unknown_m": metres}, model())
        needed.append(found.needed)
        assert [reason.needed_if_usual for reason in found.reasons] == [needed[0], found.needed, found.needed]
        assert found.holds >= found.largest_holds - 0.1
        assert found.interval[0] <= found.needed <= found.start == found.interval[1]
        assert found.chance == 1.0
    assert needed == sorted(needed)
    assert needed[0] == 1
    assert needed[-1] > 8


def reasons_of(found):
    """The printed reasons by the first words of the feature."""
    lines = sentences(found)
    first = next(number for number, line in enumerate(lines) if line.startswith("Why "))
    return lines[first], {line.split()[0]: line[line.index("(") :] for line in lines[first + 1 :]}


def test_a_reason_says_what_it_compares_with(tmp_path):
    found = suggest("ring", EASY | {"longest_unknown_m": 256.0}, model())
    head, reasons = reasons_of(found)
    assert head == f"Why the median world needs {found.needed}:"
    middle = "a world with 16 m, the median of those tested, would need"
    assert reasons["longest"] == f"({middle} 1 instead of {found.needed})"
    assert reasons_of(suggest("ring", EASY, model()))[1]["longest"] == f"({middle} as many)"
    hopeless = suggest("desert", EASY | {"longest_unknown_m": 4096.0}, model())
    assert reasons_of(hopeless)[0] == "Why the median world needs more than 64:"
    assert reasons_of(hopeless)[1]["longest"] == f"({middle} 1 instead of more than 64)"


def test_a_feature_that_the_experiment_does_not_show_is_no_reason():
    """The coefficients of the odometry are 1 and -1.2 in two draws: more or fewer particles."""
    unsure = model()
    unsure.holding[:, 3] = [-1.0, 1.0, -1.2]
    found = suggest("ring", EASY | {"odometry_deg_per_m": 16.0, "longest_unknown_m": 64.0}, unsure)
    assert [reason.is_shown for reason in found.reasons] == [True, False, False]
    assert reasons_of(found)[1]["heading"] == "(that this matters is not shown by the experiment)"
    sure = model()
    sure.growth[:, 2] = [0.5, 0.4, 0.6]  # the error falls more slowly where the odometry is worse
    assert suggest("ring", EASY, sure).reasons[1].is_shown


def test_an_effect_that_goes_the_other_way_says_so():
    """Worse odometry holds more often here, so that it needs fewer particles."""
    strange = model()
    strange.holding[:, 3] = 1.0
    found = suggest("ring", EASY | {"odometry_deg_per_m": 4.0, "longest_unknown_m": 256.0}, strange)
    usual = found.reasons[1].needed_if_usual
    assert found.needed < usual
    assert [reason.is_as_expected for reason in found.reasons] == [True, False, True]
    assert reasons_of(found)[1]["heading"].endswith(
        f"would need {usual} instead of {found.needed}: the other way than one would expect)"
    )
    usual_way = model()
    usual_way.holding[:, 3] = -1.0
    assert suggest("ring", EASY | {"odometry_deg_per_m": 4.0}, usual_way).reasons[1].is_as_expected


def test_what_the_experiment_did_not_cover_is_named():
    inside, outside = (suggest("x", EASY | {"odometry_deg_per_m": e}, model()) for e in (1.0, 30.0))
    assert inside.outside == ()
    assert outside.outside == ("heading error of the odometry over a metre: 30 deg, measured were 0.5 deg to 4 deg",)
    first = "x is outside of what was measured, so this is an extrapolation: heading error"
    assert sentences(outside)[0].startswith(first)
    assert not any("outside of" in line for line in sentences(inside))
    assert sentences(inside)[:2] == [
        "x: start with 1 particle, enough in nearly all worlds like it.",
        "The median world of this kind needs 1; 95 % of them need between 1 and 1.",
    ]


def test_hopeless_drives_get_no_count():
    found = suggest("desert", EASY | {"longest_unknown_m": 4096.0}, model())
    assert found.needed is None
    assert sentences(found)[1].startswith("desert: even with 64 particles most runs end lost")


def test_runs_of_earlier_versions_are_called_so():
    experiment = {"runs": 852, "worlds": 42, "code": "aa, bb"}
    assert origin(experiment, "bb") == "From 852 runs in 42 worlds (docs/study.md)."
    assert origin(experiment, "b") == "From 852 runs in 42 worlds of earlier versions of this filter (docs/study.md)."


def test_the_command_checks_the_suggestion_from_both_sides():
    found = suggest("office", EASY | {"longest_unknown_m": 256.0}, model())
    command = check_command("office", {"lidar": "lds01"}, found)
    assert f"--particles {found.needed // 2},{found.needed},{found.start},64 --until decided" in command
    assert command.endswith("--until decided --margin 10% --set lidar=lds01")
    assert check_command("office", {"route": "fixed"}, found).endswith("--until decided --margin 10% --route fixed")


def test_the_name_says_whether_it_is_a_world_or_a_log(tmp_path):
    assert all(map(is_world, ("office", "generated:blocks:3", "floor.yaml", str(room_file(tmp_path)))))
    assert not any(map(is_world, ("intel.clf.gz", "office.bag", "recordings/monday")))


def test_features_of_a_world_depend_on_the_settings():
    good, poor = (features_of_world("apartment", {"odometry.grade": grade}) for grade in ("good", "poor"))
    assert poor["odometry_deg_per_m"] > 1.5 * good["odometry_deg_per_m"]
    assert poor["longest_unknown_m"] == pytest.approx(good["longest_unknown_m"], abs=1.0)
    with pytest.raises(SweepError, match="unknown setting"):
        features_of_world("apartment", {"odometri.grade": "good"})


@pytest.mark.slow
def test_a_log_gives_the_features_of_its_drive(tmp_path):
    # the log of a simulated drive: what the filter finds is what the truth says
    world = "generated:rooms:size=12x9:loops=1:clutter=0:1"
    assert (
        call("simulate", world, "--format", "carmen", "--seed", "0", "--route", "fixed", "--out", tmp_path / "l") == 0
    )
    (log,) = tmp_path.rglob("*.log.gz")
    from_log, from_world = features_of_log(str(log)), features_of_world(world, {})
    # a scan of such a log comes with the odometry of the last message, so turns add to its error
    assert from_log["odometry_deg_per_m"] == pytest.approx(from_world["odometry_deg_per_m"], rel=0.4)
    assert from_log["longest_unknown_m"] == pytest.approx(from_world["longest_unknown_m"], abs=2.0)
    assert from_log["scan_observability"] == pytest.approx(from_world["scan_observability"], abs=0.05)


def test_suggest_takes_no_other_request(capsys):
    assert call("sweep", "--suggest", "office", "--seeds", "3") == 2
    assert "takes --set and --route only" in capsys.readouterr().err
