# SPDX-License-Identifier: MIT
"""The maps of other particles next to the best one's, with the walls marked that lie elsewhere."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.views.map_cells import OCCUPIED_TO, UNKNOWN
from testbed.views.rerun import entities
from testbed.views.rerun.recorded import TIME, GridImage, Recorded, grid_image, joined

NAMES = dict(zip(entities.RANKS[1:], ("lightest", "most different (1)", "most different (2)"), strict=True))
"""The particles of a comparison other than the best."""
ANY_OF_EQUAL_WEIGHT = "one of equal weight"
"""Stands for `lightest` where all particles weigh the same."""
ELSEWHERE_M = 0.1
"""A wall lies elsewhere if the best particle's map has none within this distance [m]."""


class OtherParticle(NamedTuple):
    """A particle and its map."""

    title: str
    map: GridImage
    elsewhere: NDArray[np.bool_]
    """Pixels of the map that are walls, and lie elsewhere than those of the best particle's map."""


def map_at(recorded: Recorded, parent: str, time: float) -> GridImage | None:
    """The map that is logged at an entity, or in squares below it, at a time [s]; None where there is none."""
    found = [(name, recorded.latest(name, time)) for name in [parent, *recorded.names(parent)]]
    return joined([grid_image(recorded.fixed(name) | row) for name, row in found if row is not None])


def other_particles(recorded: Recorded, time: float) -> list[OtherParticle]:
    """The particles of the newest comparison up to a time [s], each one once; none where the run has a single one."""
    found: dict[str, OtherParticle] = {}
    for rank, name in NAMES.items():
        entity = f"{entities.COMPARE}/{rank}"
        label = recorded.latest(f"{entity}/robot/label", time)
        if label is None:
            return []
        at, particle = float(label[TIME]), label["Points3D:labels"].as_py()[0].split(entities.AS_OF)[0]
        if particle in found:
            names, _, rest = found[particle].title.partition(": ")
            found[particle] = found[particle]._replace(title=f"{names}, {name}: {rest}")
            continue
        best, shown = map_at(recorded, entities.MAP, at), map_at(recorded, f"{entity}/map", at)
        if best is not None and shown is not None:
            equal = name == NAMES["lightest"] and particle.endswith(entities.EQUAL_WEIGHT)
            title = f"{ANY_OF_EQUAL_WEIGHT if equal else name}: {particle}, {at:.1f} s"
            found[particle] = OtherParticle(title, shown, _elsewhere(shown, best))
    return list(found.values()) if len(found) > 1 else []


def first_comparison(recorded: Recorded) -> float | None:
    """Time of the first comparison of several particles [s]; None where there is none. At the first scan all are the
    same one."""
    compared = [f"{entities.COMPARE}/{rank}/robot/label" for rank in NAMES]
    for time in recorded.times(compared[0]).tolist():
        rows = [recorded.latest(label, time) for label in compared]
        if len({row["Points3D:labels"].as_py()[0].split(entities.AS_OF)[0] for row in rows if row is not None}) > 1:
            return float(time)
    return None


def _elsewhere(shown: GridImage, best: GridImage) -> NDArray[np.bool_]:
    """Which pixels (rows, columns) of a map are walls that another map, not turned against it, does not have nearby but
    has seen there."""
    rows, columns = np.nonzero(shown.image <= OCCUPIED_TO)
    x = shown.pose[0] + (columns + 0.5) * shown.cell
    y = shown.pose[1] + (shown.image.shape[0] - rows - 0.5) * shown.cell
    high, wide = best.image.shape
    column = np.floor((x - best.pose[0]) / best.cell).astype(np.intp)
    row = high - 1 - np.floor((y - best.pose[1]) / best.cell).astype(np.intp)
    reach = round(ELSEWHERE_M / best.cell)
    near, known = np.zeros(len(rows), np.bool_), np.zeros(len(rows), np.bool_)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            r, c = row + down, column + right
            inside = (r >= 0) & (r < high) & (c >= 0) & (c < wide)
            level = best.image[np.where(inside, r, 0), np.where(inside, c, 0)]
            near |= inside & (level <= OCCUPIED_TO)
            known |= inside & (level != UNKNOWN)
    elsewhere = np.zeros(shown.image.shape, np.bool_)
    elsewhere[rows, columns] = known & ~near
    return elsewhere
