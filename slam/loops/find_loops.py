# SPDX-License-Identifier: MIT
"""Finding loops: which local maps may show the same place, whether they do, and what that makes of the path.

Candidates are pairs of local maps whose relative pose is so uncertain that the final pass could not bring them
together, and that may overlap. The least uncertain are matched first, since each loop found makes the others' windows
smaller. The estimate that the loops are to correct is the first hypothesis of each pair: where both maps agree there,
the loop is closed already.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config import FilterConfig
from slam.loops.correlative_match import Agreement, agreement, prepare, refine_pose, search_window
from slam.loops.local_maps import LENGTH, Track
from slam.loops.loop import Loop, edges_of
from slam.loops.pose_graph import Edges, Marginals, join, optimise_robustly
from slam.loops.refuted_loops import NEIGHBOURS, refuted_loops

CHAIN_INFLATION = 2.0
"""Factor on the covariances of the chain: errors of matches against one local map are not independent. On four logs
and two simulations the mean NEES of steps of 6 m was 0.5 to 5.8 without it, where 3 is right."""
KNOWN_POSITION, KNOWN_HEADING = 0.1, 0.02
"""A pair whose relative pose has smaller standard deviations [m, rad] needs no loop: the gate of the final pass is
twice as wide."""
WINDOW_SIGMAS = 3.0
"""Half width of the search windows in standard deviations."""
MIN_WINDOW, MAX_WINDOW = (0.5, 0.1), (15.0, 1.0)
"""Bounds of the half widths [m, rad]; where more is needed, other loops must make the pair less uncertain first."""
MIN_PREDICTIONS = 10
"""From so many loops on, the errors of what the graph predicted of them scale the windows of the search."""
MEDIAN_CHI2 = 2.366
"""Median of a chi-squared variable with three degrees of freedom."""
MIN_SCALE = 0.05
"""The covariances of the chain are scaled down to this share at most."""
MIN_OVERLAP_LENGTH = 10.0
"""Length of the walls that both maps must show [m]."""
MIN_SHARE = 0.85
"""Smallest share of walls that agree, among those that agree or contradict, at a pose found by the search."""
MIN_CLOSED_SHARE = 0.75
"""The same at the pose that the given path says: it need not be told from all others in a window."""
MAX_RIVALRY = 0.8
"""A match does not count where another place in the window reaches this share of its score."""
BENT = (0.05, 0.05, 0.01)
"""What the bend of local maps adds to the standard deviation of a match [m, m, rad]."""
BATCH = 16
"""Pairs that are matched before the graph is optimised anew."""
MIN_LENGTH = 2.0 * LENGTH
"""Driven length of a loop [m]; over less, local maps overlap, and the final pass needs no help."""
RETRY_FACTOR = 0.5
"""A pair is tried again where its standard deviation has shrunk by this factor since: its window is another then."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FoundLoops:
    """The loops between local maps, and where the maps lie with them."""

    poses: se2.Pose
    """Poses of the maps' anchors, (maps, 3); the first is as given."""
    chain: Edges
    """The robot's motion between neighbouring anchors."""
    loops: list[Loop]
    """All matches found, those last that the other maps refute."""
    accepted: NDArray[np.bool_]
    """Whether each agrees with the chain, the other loops and the maps, (loops,)."""


def find_loops(track: Track, path: se2.Pose, config: FilterConfig, threads: Threads) -> FoundLoops:
    """Find the loops of a recording; path (maps, 3): the anchors by the estimate that is to be corrected."""
    return _Search(track, path, config, threads).run()


class _Pair(NamedTuple):
    """Two local maps that may show the same place."""

    first: int
    """Number of the earlier one."""
    second: int
    """Number of the later one."""
    seen: se2.Pose
    """Pose of the second's anchor seen from the first's, by the graph, (3,)."""
    position_sigma: float
    """Largest standard deviation of its position [m]."""
    heading_sigma: float
    """Standard deviation of its heading [rad]."""


class _Search:
    def __init__(self, track: Track, path: se2.Pose, config: FilterConfig, threads: Threads) -> None:
        self._path, self._config, self._threads = path, config, threads
        self._maps = [prepare(local, config.map.cell) for local in track.maps]
        self._reach = np.array([seen.reach for seen in self._maps])
        self._distance = track.distance[track.anchors]
        self._chain = chain_of(track)
        start = track.poses[track.anchors]
        self._poses = se2.compose(se2.compose(path[0], se2.inverse(start[0])), start)
        self._loops: list[Loop] = []
        self._refuted: list[Loop] = []
        self._weights = np.ones(0)
        self._squares: list[float] = []
        """Squared error of what the graph predicted of each loop, normalised by the chain's covariances as stated."""
        first, second = np.triu_indices(len(self._maps), 1)
        far = self._distance[second] - self._distance[first] >= MIN_LENGTH
        seen = np.array([len(m.walls) > 0 for m in self._maps])  # a map without walls matches nothing
        far &= seen[first] & seen[second]
        self._first, self._second = first[far], second[far]
        self._measure_uncertainty()
        self._tried = np.full((len(self._maps), len(self._maps)), np.inf)
        """Smallest standard deviation of position with which each pair or a neighbour of it was tried [m]."""

    def run(self) -> FoundLoops:
        """Try pairs until none is left that is uncertain and may overlap, and no loop is refuted."""
        self._search()
        while refuted := self._refuted_now():
            self._refuted += refuted
            self._loops = [loop for loop in self._loops if not any(loop is other for other in refuted)]
            self._optimise()
            self._search()
        return FoundLoops(
            poses=self._poses,
            chain=self._chain,
            loops=self._loops + self._refuted,
            accepted=np.concatenate([self._weights > 0.5, np.zeros(len(self._refuted), np.bool_)]),
        )

    def _search(self) -> None:
        while pairs := self._candidates():
            found = [loop for pair in pairs if (loop := self._try(pair)) is not None]
            if found:
                self._squares += [self._prediction_error(loop) for loop in found]
                self._loops += found
                self._optimise()

    def _optimise(self) -> None:
        self._poses, self._weights = optimise_robustly(self._poses, self._chain, edges_of(self._loops))
        self._measure_uncertainty()

    def _refuted_now(self) -> list[Loop]:
        """The accepted loops that the maps refute most."""
        accepted = [loop for loop, weight in zip(self._loops, self._weights, strict=True) if weight > 0.5]
        return [accepted[k] for k in refuted_loops(self._maps, self._poses, self._chain, accepted)]

    def _prediction_error(self, loop: Loop) -> float:
        """Squared error of what the graph predicted of a loop, were the chain's covariances as stated."""
        (k,) = np.flatnonzero((self._first == loop.first) & (self._second == loop.second))
        predicted = se2.between(self._poses[loop.first], self._poses[loop.second])
        return scale_of(self._squares) * squared_error(predicted, self._relative[k], loop.pose, loop.covariance)

    def _candidates(self) -> list[_Pair]:
        """Pairs to try next, the nearest and least uncertain first."""
        first, second, position, heading = self._first, self._second, self._position, self._heading
        seen = se2.between(self._poses[first], self._poses[second])
        apart, reach = np.hypot(seen[:, 0], seen[:, 1]), 0.5 * (self._reach[first] + self._reach[second])
        wanted = apart - WINDOW_SIGMAS * position < reach
        wanted &= (position > KNOWN_POSITION) | (heading > KNOWN_HEADING)
        wanted &= (WINDOW_SIGMAS * position <= MAX_WINDOW[0]) & (WINDOW_SIGMAS * heading <= MAX_WINDOW[1])
        wanted &= position < RETRY_FACTOR * self._tried[first, second]
        order = np.flatnonzero(wanted)
        order = order[np.argsort(apart[order] / reach[order] + position[order], kind="stable")]
        return _spread(
            _Pair(int(first[k]), int(second[k]), seen[k], float(position[k]), float(heading[k])) for k in order
        )

    def _measure_uncertainty(self) -> None:
        """Find how uncertain it is where the second map of each pair lies, seen from the first."""
        weights = np.concatenate([np.ones(len(self._chain.first)), self._weights])
        chain = self._chain._replace(covariance=scale_of(self._squares) * self._chain.covariance)
        marginals = Marginals(self._poses, join(chain, edges_of(self._loops)), weights)
        self._relative = marginals.relative(self._first, self._second)
        """Covariances along the axes of the first maps, (pairs, 3, 3)."""
        self._position = np.sqrt(np.linalg.eigvalsh(self._relative[:, :2, :2])[:, 1])
        """Largest standard deviations of the position [m], (pairs,)."""
        self._heading = np.sqrt(self._relative[:, 2, 2])
        """Standard deviations of the heading [rad], (pairs,)."""

    def _try(self, pair: _Pair) -> Loop | None:
        """Match two local maps: first where the given path has them, then in the whole window."""
        i, j = pair.first, pair.second
        around = self._tried[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
        np.minimum(around, pair.position_sigma, out=around)
        first, second = self._maps[i], self._maps[j]
        given = se2.between(self._path[i], self._path[j])
        if self._is_match(agreement(first, second, given), MIN_CLOSED_SHARE):
            return self._loop(i, j, given, was_closed=True)
        distance = max(WINDOW_SIGMAS * pair.position_sigma, MIN_WINDOW[0])
        heading = max(WINDOW_SIGMAS * pair.heading_sigma, MIN_WINDOW[1])
        match = search_window(first, second, pair.seen, distance, heading)
        if match is None or match.rivalry > MAX_RIVALRY:
            return None
        return self._loop(i, j, match.pose, was_closed=False)

    def _loop(self, i: int, j: int, pose: se2.Pose, *, was_closed: bool) -> Loop | None:
        """The loop of two maps that lie at a relative pose (3,), refined; None where they do not agree well enough."""
        first, second = self._maps[i], self._maps[j]
        pose, covariance = refine_pose(first, second, pose, self._config, self._threads)
        agreed = agreement(first, second, pose)
        if not self._is_match(agreed, MIN_CLOSED_SHARE if was_closed else MIN_SHARE):
            return None
        turn = se2.rotation(-pose[2])
        covariance = turn @ covariance @ turn.T + np.diag(np.square(BENT))
        return Loop(i, j, pose, covariance, agreed, self._overlap(agreed), was_closed)

    def _is_match(self, agreed: Agreement, share: float) -> bool:
        return self._overlap(agreed) >= MIN_OVERLAP_LENGTH and agreed.share >= share

    def _overlap(self, agreed: Agreement) -> float:
        """Length of the walls that two maps both show [m]."""
        return agreed.overlap * self._config.map.cell


def scale_of(squares: Sequence[float]) -> float:
    """By how much the chain's covariances are too large, from the squared errors of the predictions of loops.

    squares: normalised by the covariances as stated. The median over that of a chi-squared variable with three degrees
    of freedom: wrong loops among them hardly move it.
    """
    if len(squares) < MIN_PREDICTIONS:
        return 1.0
    return float(np.clip(np.median(squares) / MEDIAN_CHI2, MIN_SCALE, 1.0))


def squared_error(
    predicted: se2.Pose, covariance: NDArray[np.float64], found: se2.Pose, own_covariance: NDArray[np.float64]
) -> float:
    """Squared Mahalanobis distance of a found relative pose (3,) from a predicted one (3,).

    covariance: of the prediction along the axes of the first node;  own_covariance: of what was found, along those of
    the second. Chi-squared with three degrees of freedom where both are right.
    """
    turn = se2.rotation(-predicted[2])
    error = se2.between(predicted, found)
    return float(error @ np.linalg.solve(turn @ covariance @ turn.T + own_covariance, error))


def _spread(pairs: Iterable[_Pair]) -> list[_Pair]:
    """The first `BATCH` pairs of which no two are neighbours in both visits: one loop makes the next unnecessary."""
    kept: list[_Pair] = []
    for pair in pairs:
        if all(max(abs(pair.first - k.first), abs(pair.second - k.second)) > NEIGHBOURS for k in kept):
            kept.append(pair)
        if len(kept) == BATCH:
            break
    return kept


def chain_of(track: Track) -> Edges:
    """The edges between the anchors of neighbouring local maps, from the matches between them."""
    anchors = track.anchors
    covariances = [_accumulated(track.poses[a : b + 1], track.covariances[a : b + 1]) for a, b in pairwise(anchors)]
    numbers = np.arange(len(anchors))
    return Edges(
        numbers[:-1],
        numbers[1:],
        se2.between(track.poses[anchors[:-1]], track.poses[anchors[1:]]),
        CHAIN_INFLATION * np.array(covariances).reshape(-1, 3, 3),
    )


def _accumulated(poses: se2.Pose, covariances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance (3, 3) of the last pose seen from the first, about the last's axes, the steps being independent."""
    total = np.zeros((3, 3))
    for step, own in zip(se2.between(poses[:-1], poses[1:]), covariances[1:], strict=True):
        moved = np.eye(3)
        moved[:2, 2] = -step[1], step[0]  # a turn of the frame moves what is seen from it
        F = se2.rotation(-step[2]) @ moved
        total = F @ total @ F.T + own
    return total
