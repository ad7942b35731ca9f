# SPDX-License-Identifier: MIT
"""Graphs of places: a random one on a lattice, and a closed walk through all its edges, from which tours are made."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

Edge = tuple[int, int]


class Graph(NamedTuple):
    """Places 0, 1, … and the ways between them."""

    nodes: int
    """How many places."""
    tree: list[Edge]
    """Ways that connect all places without a loop; each from a place already connected to a new one, from place
    `tree[0][0]` on."""
    extra: list[Edge]
    """Ways that close loops, one each."""


def random_graph(nodes: int, possible: list[Edge], loops: int, rng: Generator) -> Graph:
    """A random spanning tree of the `possible` ways (randomized depth-first search), and up to `loops` ways more.

    Raises `ValueError` if the possible ways do not connect all places.
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
        raise ValueError(f"only {len(seen)} of {nodes} places are connected")
    used = {frozenset(edge) for edge in tree}
    unused = [edge for edge in possible if frozenset(edge) not in used]
    chosen = rng.permutation(len(unused))[:loops]
    return Graph(nodes, tree, [unused[k] for k in chosen])


def lattice_edges(cols: int, rows: int) -> list[Edge]:
    """Ways between neighbours on a lattice; place (row, col) has the number row * cols + col."""
    number = np.arange(rows * cols).reshape(rows, cols)
    across = np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2)
    up = np.stack([number[:-1], number[1:]], axis=-1).reshape(-1, 2)
    return [(int(a), int(b)) for a, b in np.concatenate([across, up])]


def closed_walk(graph: Graph) -> list[int]:
    """Places of a walk that goes every way at least once, none more than twice, and ends where it began.

    Every loop is driven round: ways that close a loop are gone once, and a way of the tree is gone once if that makes
    the number of ways even at all places beyond it, otherwise there and back (a minimal T-join on the tree). The rest
    is Hierholzer's algorithm for a walk that uses every way of such a multigraph once.
    """
    odd = np.zeros(graph.nodes, dtype=np.int64)
    for a, b in graph.extra:
        odd[a] ^= 1
        odd[b] ^= 1
    ways = list(graph.extra)
    for parent, child in reversed(graph.tree):  # children first
        ways += [(parent, child)] * (1 if odd[child] else 2)
        if odd[child]:
            odd[parent] ^= 1
    open_ways: dict[int, list[int]] = defaultdict(list)
    for k, (a, b) in enumerate(ways):
        open_ways[a].append(k)
        open_ways[b].append(k)
    gone = [False] * len(ways)
    stack, walk = [graph.tree[0][0] if graph.tree else 0], []
    while stack:
        here = stack[-1]
        while open_ways[here] and gone[open_ways[here][-1]]:
            open_ways[here].pop()
        if not open_ways[here]:
            walk.append(stack.pop())
            continue
        k = open_ways[here].pop()
        gone[k] = True
        a, b = ways[k]
        stack.append(b if here == a else a)
    return walk


def _neighbours(edges: list[Edge]) -> dict[int, list[int]]:
    neighbours: dict[int, list[int]] = defaultdict(list)
    for a, b in edges:
        neighbours[a].append(b)
        neighbours[b].append(a)
    return neighbours
