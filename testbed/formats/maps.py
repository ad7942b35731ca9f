# SPDX-License-Identifier: MIT
"""Maps inside a dataset."""

from __future__ import annotations

from pathlib import Path

from eval.files.map_server import read_map
from slam.occupancy import OccupancyGrid


def read_map_inside(path: Path) -> OccupancyGrid:
    """The map of a dataset; a user's own map may name a picture anywhere, that of a dataset from elsewhere may not.

    Raises ValueError where the picture lies outside of the map's folder, and as `eval.files.map_server.read_map` does.
    """
    from worlds import map_image  # takes geometry libraries along, 40 MB that most logs need not

    map_image(path)
    return read_map(path)
