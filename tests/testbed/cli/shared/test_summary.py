# SPDX-License-Identifier: MIT
"""What the terminal says at the end of a run."""

from __future__ import annotations

import io

from rich.console import Console

from testbed.cli.shared.summary import headline_table


def printed(metrics: dict[str, object]) -> str:
    out = io.StringIO()
    Console(file=out, width=200).print(headline_table(metrics))
    return out.getvalue()


def test_walls_are_summed_up_without_the_iou_of_single_cells() -> None:
    walls = {
        "iou": 0.431,
        "walls_within_cell_rate": 0.96,
        "missing_wall_rate": 0.007,
        "double_wall_rate": 0.037,
        "wall_thickness_m": 0.056,
        "true_wall_thickness_m": 0.053,
        "wall_distance_subcell_m": 0.0041,
    }
    text = printed({"outcome": "ok", "outcome_reason": "every loop closes", "map": walls})
    for figure in ("96.0%", "0.7%", "3.7%", "0.056 m (0.053 m)", "0.0041 m"):
        assert figure in text
    assert "0.431" not in text
    assert "every loop closes" not in text  # nothing to explain


def test_the_reason_stands_beside_every_outcome_that_is_not_ok() -> None:
    for outcome in ("lost", "broken loop", "drift", "collided", "timeout", "interrupted", "unjudged"):
        assert "because" in printed({"outcome": outcome, "outcome_reason": "because"})
    assert "no scan" in printed({"outcome": "failed", "reason": "no scan"})


def test_each_trajectory_error_names_its_path() -> None:
    def lines(**metrics: object) -> list[list[str]]:
        text = printed({"outcome": "ok", **metrics})
        return [line.split("  ") for line in text.splitlines() if "ATE" in line]

    final, own, online = ({"ate_rmse_m": error} for error in (0.004, 0.017, 0.026))
    refined = lines(refined=True, trajectory=final, trajectory_filter=own, trajectory_online=online)
    assert [(line[0], line[-1].strip()) for line in refined] == [
        ("trajectory error (ATE), after the final pass", "0.004 m"),
        ("trajectory error (ATE), the filter's own path", "0.017 m"),
        ("trajectory error (ATE), while driving", "0.026 m"),
    ]
    plain = lines(refined=False, trajectory=own, trajectory_filter=own, trajectory_online=online)
    assert [line[0].split(", ")[1] for line in plain] == ["the filter's own path", "while driving"]
    assert [line[0] for line in lines(trajectory=own)] == ["trajectory error (ATE)"]


def test_the_self_check_is_said_with_time_and_reason() -> None:
    check = {"verdict": "lost", "reason": "walls cross", "stamp": 5e8, "time_s": 12.0, "place": [1.0, 2.0, 0.0]}
    text = printed({"outcome": "unjudged", "self_check": check})
    assert (
        "self-check  lost; the sign of the lasting loss is at 12.0 s, at (1.0, 2.0) m of the map's frame: walls cross"
        in text
    )
    assert "self-check" not in printed({"outcome": "ok"})
