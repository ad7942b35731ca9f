# SPDX-License-Identifier: MIT
"""Maps that consist of given walls: as if a beam had ended on each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slam._threads import Threads
from slam.config import MapConfig
from slam.grid.particle_maps import ParticleMaps
from slam.sensor.rays import Rays


def maps_of_walls(points: NDArray[np.float64], config: MapConfig, threads: Threads) -> ParticleMaps:
    """Maps of one particle in which a beam has ended once at each of the points (n, 2) [m] and none has passed."""
    centre = np.append(0.5 * (points.min(axis=0) + points.max(axis=0)), 0.0)
    ends = points - centre[:2]
    maps = ParticleMaps(1, config, threads)
    maps.integrate_scan(centre[None], Rays(origins=ends, ends=ends, hit=np.ones(len(ends), np.bool_)))
    return maps
