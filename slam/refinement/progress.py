# SPDX-License-Identifier: MIT
"""How far the final pass has come: told to whoever watches it, who may end it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from slam.sensor.rays import Rays

Watch = Callable[[float], bool]
"""Called with the share of the work that is done, from 0 to 1, every now and then; returns whether to go on."""

LOOPS_SHARE, ROUNDS_SHARE = 0.2, 0.6
"""Shares of the time that loops and rounds take; the map takes the rest."""
EVERY = 256
"""Number of scans from one call to the next."""


def unwatched(share: float) -> bool:
    """Go on; nobody wants to know."""
    return True


class WatchedScans(Mapping[int, Rays]):
    """Rays of scans by their frame; as they are asked for one after the other, the share that is done grows."""

    def __init__(self, rays: Mapping[int, Rays], watch: Watch, begin: float, end: float) -> None:
        """begin, end: the shares of all work that are done before the first and after the last scan."""
        self._rays, self._watch, self._begin, self._end = rays, watch, begin, end
        self._given = 0

    def __getitem__(self, frame: int) -> Rays:
        self._given += 1
        if self._given % EVERY == 0:
            done = min(self._given / len(self._rays), 1.0)
            self._watch(self._begin + done * (self._end - self._begin))
        return self._rays[frame]

    def __iter__(self) -> Iterator[int]:
        return iter(self._rays)

    def __len__(self) -> int:
        return len(self._rays)
