# SPDX-License-Identifier: MIT
"""The group `self_check` of `metrics.json`: what the run says of itself, without truth and relations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam.diagnosis.contradiction import SelfCheck
from slam.diagnosis.path_check import check_path, left_out_score
from slam.diagnosis.wheel_speed import WheelNews, wheel_news
from slam.gmapping import GMapping
from slam.se2 import Pose
from slam.sensor.rays import Rays, make_rays
from testbed.estimation.estimation import Estimation
from testbed.estimation.known_map import failure_reason
from testbed.run.estimate import Estimate


def self_check_metrics(estimation: Estimation, estimate: Estimate, *, replay: bool) -> dict[str, Any]:
    """Return the group `self_check` of a run that has made a map.

    replay: whether the estimate is checked by drawing its map once more; otherwise the filter's own verdict counts,
    which it found while it drove
    """
    assert isinstance(estimation.mapper, GMapping)
    start = float(estimation.stamps[estimation.scan_frames[0]])
    driving = _as_json(estimation.mapper.self_check, start)
    if not replay:
        return {**driving, "while_driving": driving}
    stamps, poses, odometry, rays = used_scans(estimation, estimate)
    monitor = check_path(stamps, poses, odometry, rays, _news_of_wheels(estimation), estimation.config)
    return {
        **_as_json(monitor.overall, start),
        "contradiction_scans": monitor.max_total,
        "left_out_log_likelihood": left_out_score(poses, rays, estimation.config.map),
        "while_driving": driving,
    }


def localization_self_check(found: Mapping[str, Any], start: float) -> dict[str, Any]:
    """Return the group `self_check` of a localisation, from its `localization_metrics`.

    start: stamp of the first scan [s]
    """
    reason = failure_reason({**found, "error_median_m": None})  # the error is known from the truth only
    if reason is None:
        return _as_json(SelfCheck("plausible", "the scans agree with the map at one position"), start)
    if not found["losses"]:
        return _as_json(SelfCheck("doubtful" if found["state"] == "ambiguous" else "lost", reason), start)
    return _as_json(SelfCheck("lost", reason, start + found["lost_at_s"][0]), start)


def used_scans(estimation: Estimation, estimate: Estimate) -> tuple[NDArray[np.float64], Pose, Pose, list[Rays]]:
    """Return stamps [s] (scans,), estimated poses (scans, 3), odometry (scans, 3) and rays of the used scans."""
    rows = estimation.scan_frames[np.asarray(estimation.mapper.update_scans)]
    settings = estimation.config
    rays = []
    for row in rows:
        frame = estimation.frames[row]
        assert frame.scan is not None
        twist = frame.twist if settings.deskew else None
        rays.append(make_rays([frame.scan], usable_range=settings.map.usable_range, twist=twist))
    return estimation.stamps[rows], estimate.dense.poses[rows], estimation.odometry[rows], rays


def _news_of_wheels(estimation: Estimation) -> list[WheelNews]:
    """Return what the speed of the wheels says at each used scan."""
    rows, used = estimation.scan_frames, np.asarray(estimation.mapper.update_scans)
    return wheel_news(estimation.stamps[rows], estimation.odometry[rows], used)


def _as_json(check: SelfCheck, start: float) -> dict[str, Any]:
    """Return a verdict as plain values; start: stamp of the first scan [s]."""
    return {
        "verdict": check.verdict,
        "reason": check.reason,
        "stamp": check.stamp,
        "time_s": None if check.stamp is None else check.stamp - start,
        "place": None if check.place is None else list(check.place),
    }
