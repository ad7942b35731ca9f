# SPDX-License-Identifier: MIT
"""Closing the loops that a path has left open: local maps, loops between them, and the path that agrees with both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam._threads import Threads
from slam.config import FilterConfig
from slam.loops.find_loops import FoundLoops, find_loops
from slam.loops.local_maps import Track, track_locally
from slam.loops.loop import Loop, edges_of
from slam.loops.pose_graph import TRUNCATION, Edges, join, squared_distances
from slam.motion.interpolation import between_updates, interpolate_with_odometry
from slam.sensor.rays import Rays

TORN = 4.0 * TRUNCATION
"""Squared Mahalanobis distance of the chain from which on a path counts as torn: twice the distance at which a loop
counts as wrong, since of some hundred steps of a good path the worst comes to half of that."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopClosing:
    """The loops of a recording and the path after they were closed."""

    path: se2.Pose
    """Poses of all frames, (frames, 3); the given ones where `changed` is false."""
    changed: bool
    """Whether the given path had left a loop open, or contradicts the local maps."""
    frames: NDArray[np.int64]
    """Frames from whose poses the local maps are seen: the nodes of the graph, (maps,)."""
    nodes: se2.Pose
    """Poses of these frames after loop closing, before the adjustment of all scans, (maps, 3)."""
    chain: Edges
    """The robot's motion between neighbouring nodes, by the local maps."""
    loops: list[Loop]
    """All matches between local maps, in the order in which they were found."""
    accepted: NDArray[np.bool_]
    """Whether each match agrees with the robot's motion and the others, (loops,)."""

    @property
    def accepted_edges(self) -> Edges:
        """The edges of the graph whose least squares estimate the nodes are: the chain and the accepted loops."""
        return join(self.chain, edges_of([loop for loop, sure in zip(self.loops, self.accepted, strict=True) if sure]))


def close_loops(
    odometry: se2.Pose, path: se2.Pose, rays: Mapping[int, Rays], config: FilterConfig, threads: Threads
) -> LoopClosing:
    """Close the loops that a path left open.

    odometry (frames, 3);  path (frames, 3): the estimate;  rays of the frames with a hit, in order
    """
    track = track_locally(odometry, path, rays, config, threads)
    anchors = track.anchors
    frames = track.frames[anchors]
    found = find_loops(track, path[frames], config, threads)
    result = LoopClosing(
        path=path,
        changed=_contradicts(path[frames], found),
        frames=frames,
        nodes=found.poses,
        chain=found.chain,
        loops=found.loops,
        accepted=found.accepted,
    )
    if not result.changed:
        return result
    return replace(result, path=_through_nodes(odometry, track, found.poses))


def _contradicts(nodes: se2.Pose, found: FoundLoops) -> bool:
    """Whether a path through nodes (maps, 3) does not fit the loops, or the chain that they have proved right.

    Without a loop nobody can say which of the two is right, the path or the chain of local maps. A small gap is left
    to the adjustment of all scans: where few loops are found, the chain drifts more than the path.
    """
    if not found.accepted.any():
        return False
    loops = squared_distances(nodes, edges_of(found.loops))[found.accepted]
    return bool(loops.max() > TRUNCATION or squared_distances(nodes, found.chain).max() > TORN)


def _through_nodes(odometry: se2.Pose, track: Track, nodes: se2.Pose) -> se2.Pose:
    """Path (frames, 3) through nodes (maps, 3): along the track between them, along the odometry between its scans."""
    at_scans = interpolate_with_odometry(track.poses, track.anchors, nodes)
    return between_updates(odometry, track.frames, at_scans)
