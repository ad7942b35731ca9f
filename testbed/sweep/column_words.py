# SPDX-License-Identifier: MIT
"""Describes the columns of a sweep's tables: a sentence for each, with its unit in brackets."""

from __future__ import annotations

import re

_OWN = {
    "place": "Name of the world or log.",
    "family": "Kind of building that the world is a sample of, such as rooms; null for single worlds and logs.",
    "line": "Name of the combination of settings.",
    "particles": "Particle count.",
    "seed": "Seed of the simulation and of the filter; for logs of the filter alone.",
    "status": "done, failed (no result), missing (not computed yet), or with --until: later (needed if the next look "
    "leaves the answer open), not needed (the answer is known without it), given up (the answer is open, and it would "
    "hardly be found with it).",
    "reason": "Why there is no result; null where there is one.",
    "key": "Hash of everything that decides the result; it joins sweep, curves and timings.",
    "in_report": "Whether answers, tables and figures rest on this run: all counts of its seed were computed, "
    "and with --until its seed belongs to the last complete look.",
    "share": "Share of the updates that are done, 0 to 1.",
    "ess": "Effective sample size as a share of the particles, 0 to 1.",
    "unique_ancestors": "Unique ancestors as a share of the particles, 0 to 1.",
    "founders": "The same as unique_ancestors, for readers of versions up to 0.1.",
    "nees": "Normalised estimation error squared; 3 on average if the covariance is right.",
    "cell_s": "Time of the whole job [s].",
    "wall_s": "Time of filter and final pass [s].",
    "cpu_s": "Time that the estimate took of all cores [s]; null = unknown.",
    "filter_s": "Time of the filter alone, without the final pass [s].",
    "realtime_factor": "Duration of the drive by wall_s, with the final pass; duration_s / filter_s is the filter's.",
    "us_per_update_per_particle": "Time of the filter per update and particle [µs].",
    "duration_s": "Span of the stamps of the drive [s].",
    "refined": "Whether the final pass was made; where it was not the final path and map are the best particle's.",
    "updates": "Number of scans that the filter took in.",
    "scans": "Number of scans of the drive.",
    "mean_particles": "Mean number of particles over the updates.",
    "particle_updates": "Number of particles, summed over the updates.",
    "map_bytes_per_particle": "Largest memory of the maps by the number of particles, shared tiles once [bytes].",
    "result_hash": "SHA-256 of trajectory and map: equal hashes mean equal bits.",
    "outcome_reason": "The figures that decided the outcome.",
}
_FEATURES = {
    "area_m2": "Area of the floor [m²].",
    "route_m": "Length of the whole route [m]; a run that its duration cuts short drives less, see length_m.",
    "loops": "Number of islands in the floor that one can drive around.",
    "largest_loop_m": "Length of the outline of the largest island in the floor [m].",
    "unknown_stretch_m": "Longest way of the world's tour through floor that was not passed before [m].",
    "corridor_share": "Share of the tour on which a scan does not determine the position, 0 to 1.",
    "determined_share": "Share of the tour on which a scan determines the position, 0 to 1.",
    "observability": "How well walls determine the position on the tour, 0 (bare corridor) to 1 (walls all around).",
    "symmetry": "How alike the most similar places of the world look, 0 to 1 (docs/worlds.md).",
    "clutter_per_10_m2": "Number of small boxes and discs on 10 m² of floor.",
    "lidar_range_m": "Longest range of the lidar [m].",
    "lidar_beams": "Number of beams of a scan.",
    "lidar_view_deg": "Field of view of the lidar [deg].",
    "lidar_noise_m": "Standard deviation of a range close to the lidar [m].",
    "odometry_grade": "Grade of the simulated odometry: good, typical or poor.",
    "longest_unknown_m": "Longest way of this drive through floor that it had not passed before [m].",
    "odometry_deg_per_m": "Root mean square of the odometry's heading error over a metre [deg].",
    "scan_determined_share": "Share of the scans that by themselves determine the position, 0 to 1.",
    "scan_observability": "How well a scan determines the position, mean over the drive, 0 to 1.",
}
_ESTIMATES = {
    "online": "the pose reported at each scan",
    "filter": "the best particle's path at the end",
    "": "the final path",
}
_MAPS = {"filter": "the best particle's map", "": "the final map"}
_STATISTICS = {
    "rmse": "Root mean square of the",
    "mean": "Mean",
    "median": "Median",
    "p95": "95 % quantile of the",
    "max": "Largest",
    "std": "Standard deviation of the",
}
_STATISTIC = "(rmse|mean|median|p95|max|std)"
_OF_PATHS = (
    (rf"ate_{_STATISTIC}_m", "{0} distance of {of} from the true one, after the best rigid motion [m]."),
    (rf"ate_first_pose_{_STATISTIC}_m", "{0} distance of {of} from the true one, both starting in one pose [m]."),
    (rf"heading_{_STATISTIC}_deg", "{0} heading error of {of}, after the best rigid motion [deg]."),
    (rf"heading_first_pose_{_STATISTIC}_deg", "{0} heading error of {of}, from a common first pose [deg]."),
    (rf"rpe\.(\d+m|\d+s)\.trans_{_STATISTIC}_m", "{1} error of the motion over {0} of {of} [m]."),
    (rf"rpe\.(\d+m|\d+s)\.rot_{_STATISTIC}_deg", "{1} error of the turn over {0} of {of} [deg]."),
    (r"rpe\.(\d+m|\d+s)\.pieces", "Number of pieces of {0} of {of} that were compared."),
    (r"final_error_m", "Distance between the last poses of {of} and of the true one, from a common first pose [m]."),
    (r"drift_percent", "Error of the motion by its length, mean over 1, 5, 20 and 50 m of {of} [%]."),
    (r"drift_deg_per_m", "Error of the turn by the length, mean over 1, 5, 20 and 50 m of {of} [deg/m]."),
    (r"length_m", "Length of {of} [m]."),
    (r"poses", "Number of poses of {of}."),
    (r"matched_share", "Share of the poses of {of} with a true pose at their time, 0 to 1."),
    (r"covered_share", "Share of the true path between the first and the last matched pose of {of}, 0 to 1."),
    (r"alignment", "How {of} was aligned with the true one."),
    (r"association", "How poses of {of} and true poses were matched by time."),
    (r"suggested_time_offset_s", "Offset of the clock that would explain the error of {of} [s]; null = none."),
    (r"ate_rmse_at_suggested_offset_m", "Root mean square of the distance of {of} with that offset [m]."),
    (rf"((?:short|loops)\.)?trans_{_STATISTIC}_m", "{1} position error of {0}relations in {of} [m]."),
    (rf"((?:short|loops)\.)?rot_{_STATISTIC}_deg", "{1} angle error of {0}relations in {of} [deg]."),
    (r"((?:short|loops)\.)?failure_rate", "Share of the {0}relations with an error above 0.5 m in {of}."),
)
_OF_MAPS = (
    (r"(iou|f1|precision|recall)(?:_([12])_cells)?", "{0} of the occupied cells of {of}{1}, 0 to 1."),
    (r"free_(iou|f1)(?:_([12])_cells)?", "{0} of the free cells of {of}{1}, 0 to 1."),
    (r"wall_distance_m", "Mean distance between the walls of {of} and the true ones, both directions [m]."),
    (
        r"wall_distance_subcell_m",
        "Mean distance between walls of {of} and the exact ones drawn on its own cells, both directions [m].",
    ),
    (
        r"wall_distance_to_truth\.(trimmed_mean|mean|p95)_m",
        "{0} distance from a wall of {of} to a true one [m].",
    ),
    (r"wall_distance_from_truth\.(trimmed_mean|mean|p95)_m", "{0} distance from a true wall to one of {of} [m]."),
    (r"walls_within_cell_rate", "Share of the wall cells of {of} with a true wall at most a cell away, 0 to 1."),
    (r"double_wall_rate", "Share of the points of true walls where {of} has two walls, 0 to 1."),
    (r"missing_wall_rate", "Share of the points of true walls where {of} has none, 0 to 1."),
    (r"wall_thickness_m", "Mean thickness of the walls of {of} [m]."),
    (r"true_wall_thickness_m", "Mean thickness of the walls of the true map [m]."),
    (r"log_loss", "Mean negative log probability of the true cells in {of} [nats]."),
    (r"brier", "Mean squared error of the probabilities of {of}, 0 to 1."),
    (r"auc", "Probability that a true wall cell is more probable in {of} than a free one, 0 to 1."),
    (r"calibration_error", "Mean difference of predicted and observed frequency of walls in {of}, 0 to 1."),
    (r"coverage", "Share of the observable cells that {of} knows, 0 to 1."),
    (r"observable_cells", "Number of cells in sight from the true path."),
    (r"alignment", "How {of} was aligned with the true map."),
    (r"structure\.corners", "Number of corners in {of}."),
    (r"structure\.enclosed_areas", "Number of enclosed areas in {of}."),
    (r"structure\.entropy_bits", "Mean entropy of a cell of {of} [bit]."),
    (r"structure\.known_area_m2", "Area that {of} knows [m²]."),
    (r"structure\.occupied_share", "Share of the known cells of {of} that are occupied, 0 to 1."),
)
_OTHERS = (
    (r"filter\.mean_ess", "Mean effective sample size before resampling."),
    (r"filter\.min_ess", "Smallest effective sample size before resampling."),
    (r"filter\.mean_ess_share", "Mean effective sample size as a share of the particles, 0 to 1."),
    (r"filter\.resamplings", "Number of resamplings."),
    (r"filter\.updates", "Number of scans that passed the update gate."),
    (r"filter\.match_failures", "Number of failed scan matches, summed over the particles."),
    (r"filter\.match_failure_share", "Share of the scan matches that failed, 0 to 1."),
    (r"filter\.mean_matched_share", "Mean share of the hits that lay near a wall of the map, 0 to 1."),
    (r"filter\.loop_closures", "Number of returns to old walls, whether the loop was closed or left open."),
    (r"filter\.largest_loop_m", "Length of the longest loop, closed or left open [m]; null = none."),
    (r"filter\.largest_loop_stamp", "Stamp of the scan at which that loop had its full length [s]; null = none."),
    (r"filter\.coalescence", "Mean number of updates until all particles descend from one; null = never."),
    (r"filter\.coalescences", "How often all particles came to descend from one."),
    (r"filter\.consistency\.nees_mean", "Mean NEES of the online pose; 3 if the covariance is right."),
    (r"filter\.consistency\.inside_share", "Share of the updates with the truth inside the 95 % ellipsoid, 0 to 1."),
    (r"filter\.consistency\.steps", "Number of updates with a NEES."),
    (r"filter\.consistency\.degenerate", "Number of updates whose covariance is singular, as with one particle."),
    (r"loops\.found", "Number of loops that the final pass looked at."),
    (r"loops\.accepted", "Number of loops that the final pass accepted."),
    (r"loops\.rejected", "Number of loops that the final pass rejected."),
    (r"loops\.left_open_by_filter", "Number of accepted loops at which the maps did not agree in the filter's path."),
    (r"loops\.path_changed", "Whether the final pass started from another path than the filter's."),
    (r"self_check\.(while_driving\.)?verdict", "Verdict of the self-check{0}: plausible, doubtful or lost."),
    (r"self_check\.(while_driving\.)?reason", "What the self-check{0} saw; null if nothing."),
    (r"self_check\.(while_driving\.)?stamp", "Stamp at which the self-check{0} saw it begin [s]."),
    (r"self_check\.(while_driving\.)?time_s", "Time since the first scan at which the self-check{0} saw it begin [s]."),
    (r"self_check\.(while_driving\.)?place", "Estimated pose at which the self-check{0} saw it begin [m, m, rad]."),
)
_WORDS = {
    **_STATISTICS,
    "trimmed_mean": "Mean (without the worst 10 %)",
    "iou": "Intersection over union",
    "f1": "F1 score",
    "precision": "Precision",
    "recall": "Recall",
    "1": " within a cell",
    "2": " within two cells",
    "while_driving.": " while driving",
    "short.": "short ",
    "loops.": "loop ",
}


def described(name: str) -> str:
    """What a column of `sweep.parquet`, `curves.parquet` or `timings.parquet` holds, as a sentence with its unit."""
    head, _, rest = name.partition(".")
    if name in _OWN:
        return _OWN[name]
    if head == "setting":
        return f"Setting {rest}; null = its default."
    if head == "features" and rest in _FEATURES:
        return _FEATURES[rest]
    group, _, estimate = head.partition("_")
    found = None
    if group == "outcome" and not rest:
        return f"Outcome of {_ESTIMATES.get(estimate, name)}: ok, drift, broken loop, lost, … (docs/metrics.md)."
    if group in ("trajectory", "relations"):
        of = _ESTIMATES.get(estimate, "")
        if rest.startswith("odometry."):
            rest, of = rest.removeprefix("odometry."), "the path by odometry alone"
        found = _matched(_OF_PATHS, rest, of)
    elif group == "map":
        found = _matched(_OF_MAPS, rest, _MAPS.get(estimate, ""))
    return found or _matched(_OTHERS, name, "") or f"The key {name} of metrics.json (docs/metrics.md)."


def _matched(patterns: tuple[tuple[str, str], ...], name: str, of: str) -> str | None:
    """The sentence of the first pattern that the whole name matches."""
    for pattern, sentence in patterns:
        match = re.fullmatch(pattern, name)
        if match is not None:
            return sentence.format(*map(_words, match.groups()), of=of)
    return None


def _words(part: str | None) -> str:
    """The words for a part of a name: a statistic, a tolerance, a number."""
    if part is None:
        return ""
    is_piece = re.fullmatch(r"\d+[ms]", part) is not None
    return f"{part[:-1]} {part[-1]}" if is_piece else _WORDS.get(part, part)
