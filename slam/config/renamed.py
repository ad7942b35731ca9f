# SPDX-License-Identifier: MIT
"""Settings that have a new name since version 0.1, or are gone; files with the old ones are read for one release."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

RENAMED = {
    "filter.adapt.least": "min_particles",
    "filter.adapt.most": "max_particles",
    "filter.adapt.change": "resize_factor",
    "filter.refine.most_points": "max_points",
    "localization.near": "explained_distance",
    "localization.least_fit": "min_explained_share",
    "localization.fit_memory": "explained_memory",
    "localization.sure": "found_weight",
    "localization.place_position": "cluster_position",
    "localization.place_heading": "cluster_heading",
    "localization.spread_position": "search_spacing",
    "localization.spread_heading": "search_spacing_heading",
    "localization.most_poses": "max_search_poses",
    "localization.most_candidates": "max_candidates",
}
"""The new name of each setting, by the old one with the groups that it is in."""
ESTIMATED = frozenset({"filter.refine.hit_sigma", "filter.refine.range_share"})
"""Former settings that are estimated from the data now (`slam.refinement.noise`): files that have them can be read."""


def present_name(setting: str) -> str:
    """Dotted name of a setting as it is called now, such as `filter.adapt.max_particles`."""
    new = RENAMED.get(setting)
    return setting if new is None else f"{setting.rpartition('.')[0]}.{new}"


def with_present_names(settings: Mapping[str, Any], group: str = "") -> dict[str, Any]:
    """Nested settings under the names that they have now; a present name wins over an old one for the same setting.

    Former settings that are estimated now are left out.

    group: dotted name of the group that the settings are in, with a dot at its end
    """
    old = [name for name in settings if f"{group}{name}" in RENAMED]
    renamed = {RENAMED[f"{group}{name}"]: settings[name] for name in old}
    kept = {name: value for name, value in settings.items() if name not in old and f"{group}{name}" not in ESTIMATED}
    return {
        name: with_present_names(value, f"{group}{name}.") if isinstance(value, Mapping) else value
        for name, value in {**renamed, **kept}.items()
    }
