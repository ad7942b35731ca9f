# SPDX-License-Identifier: MIT
"""Make random graphs on a lattice, and closed walks through all their edges, which become tours."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

Edge = tuple[int, int]


class Graph(NamedTuple):
    """Nodes 0, 1, … and the edges between them."""

    nodes: int
    """Number of nodes."""
    tree: list[Edge]
    """Edges that connect all nodes without a loop, each from a connected node to a new one, beginning at node
    `tree[0][0]`."""
    extra: list[Edge]
    """Edges that close loops, one loop each."""


def random_graph(nodes: int, possible: list[Edge], loops: int, rng: Generator) -> Graph:
    """Draw a random spanning tree of the `possible` edges (randomized depth-first search), and up to `loops` more.

    Raises `ValueError` if the possible edges do not connect all nodes.
    """
    neighbours = _neighbours(possible)
    start = int(rng.integers(nodes))
    seen, stack, tree = {start}, [start], []
    while stack:
        here = stack[-1]
        unseen = [n for n in neighbours[here] if n not in seen]
        if not unseen:
            stack.pop()
            continue
        there = unseen[int(rng.integers(len(unseen)))]
        tree.append((here, there))
        seen.add(there)
        stack.append(there)
    if len(seen) < nodes:
        raise ValueError(f"only {len(seen)} of {nodes} nodes are connected")
    used = {frozenset(edge) for edge in tree}
    unused = [edge for edge in possible if frozenset(edge) not in used]
    chosen = rng.permutation(len(unused))[:loops]
    return Graph(nodes, tree, [unused[k] for k in chosen])


def lattice_edges(cols: int, rows: int) -> list[Edge]:
    """Return the edges between neighbours on a lattice; node (row, col) has the number row * cols + col."""
    number = np.arange(rows * cols).reshape(rows, cols)
    across = np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2)
    up = np.stack([number[:-1], number[1:]], axis=-1).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in np.concatenate([across, up])]


def closed_walk(graph: Graph) -> list[int]:
    """Return the nodes of a closed walk that uses every edge once or twice.

    The walk goes round every loop: edges that close a loop are used once. An edge of the tree is used once if that
    makes the degree of all nodes beyond it even, otherwise twice (a minimal T-join on the tree). Hierholzer's algorithm
    then finds a walk that uses every edge of this multigraph once.
    """
    odd = np.zeros(graph.nodes, dtype=np.int64)
    for a, b in graph.extra:
        odd[a] ^= 1
        odd[b] ^= 1
    edges = list(graph.extra)
    for parent, child in reversed(graph.tree):  # children first
        edges += [(parent, child)] * (1 if odd[child] else 2)
        if odd[child]:
            odd[parent] ^= 1
    unused: dict[int, list[int]] = defaultdict(list)
    for k, (a, b) in enumerate(edges):
        unused[a].append(k)
        unused[b].append(k)
    done = [False] * len(edges)
    stack, walk = [graph.tree[0][0] if graph.tree else 0], []
    while stack:
        here = stack[-1]
        while unused[here] and done[unused[here][-1]]:
            unused[here].pop()
        if not unused[here]:
            walk.append(stack.pop())
            continue
        k = unused[here].pop()
        done[k] = True
        a, b = edges[k]
        stack.append(b if here == a else a)
    return walk


def _neighbours(edges: list[Edge]) -> dict[int, list[int]]:
    neighbours: dict[int, list[int]] = defaultdict(list)
    for a, b in edges:
        neighbours[a].append(b)
        neighbours[b].append(a)
    return neighbours
