# SPDX-License-Identifier: MIT
"""What must hold of a filter's state that was read from a file: compiled code takes its numbers for indices."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

POOLS = ("counts", "surface", "field")
"""Names of the maps' pools of tiles."""
MAY_BE_NEGATIVE_INFINITE = ("log_weights", "log_histories")
"""Logarithms of weights: a particle that cannot be has minus infinity."""
ROUNDING = 1e-6
"""By how much the sum of the weights may be off."""
FARTHEST = 1e8
"""Largest number of a pose [m, rad] or of a cell: the path begins at the origin, and maps end before."""

Arrays = Mapping[str, NDArray[Any]]


def check_state(arrays: Arrays, values: Mapping[str, Any], fresh: tuple[Arrays, Mapping[str, Any]]) -> None:
    """Raise ValueError, with the name of the part, unless a state is one that a filter can go on from.

    arrays, values: as `GMapping.state` gives them;  fresh: those of a new filter of the same settings
    """
    fresh_arrays, fresh_values = fresh
    _require(set(arrays) == set(fresh_arrays), f"arrays {sorted(set(arrays) ^ set(fresh_arrays))} missing or unknown")
    for name, expected in fresh_arrays.items():
        _check_kind(name, arrays[name], expected)
    _check_sizes(arrays)
    _check_particles(arrays)
    _check_scans(arrays, values)
    _check_tree(arrays)
    for pool in POOLS:
        _check_pool(pool, arrays)
    _check_area(arrays)
    _check_values("values", values, fresh_values)
    for pose in values["track"]["poses"]:
        _require(pose is None or _is_pose(pose), "track: poses of other than three finite numbers")


def check_field(arrays: Arrays, words: int) -> None:
    """Raise ValueError unless all words of the nearest-wall field are below `words`, the size of its offset table."""
    field = arrays["field_data0"]
    _require(field.size == 0 or int(field.max()) < words, f"field_data0: words from {words} on")


def _require(holds: bool, problem: str) -> None:
    if not holds:
        raise ValueError(problem)


def _is_pose(pose: Any) -> bool:
    numbers = isinstance(pose, list) and len(pose) == 3 and all(isinstance(number, Real) for number in pose)
    return numbers and bool(np.isfinite(pose).all())


def _check_kind(name: str, array: NDArray[Any], expected: NDArray[Any]) -> None:
    """Check the type, the number of axes, and that numbers are finite."""
    kinds = f"{array.dtype} with {array.ndim} axes, expected {expected.dtype} with {expected.ndim}"
    _require(array.dtype == expected.dtype and array.ndim == expected.ndim, f"{name}: {kinds}")
    if array.dtype.kind == "f":
        finite = np.isfinite(array) | ((array == -np.inf) if name in MAY_BE_NEGATIVE_INFINITE else False)
        _require(bool(finite.all()), f"{name}: numbers that are not finite")
    fixed = array.shape[1:] == expected.shape[1:]
    if name.endswith(("_data0", "_data1")) or name in ("poses", "spread", "errors", "tree_poses"):
        _require(fixed, f"{name}: shape {array.shape}, expected (n, {', '.join(map(str, expected.shape[1:]))})")


def _check_sizes(arrays: Arrays) -> None:
    """Check that everything is there once for each particle."""
    particles = len(arrays["poses"])
    _require(particles > 0, "poses: no particle")
    names = (
        "log_weights",
        "spread",
        "errors",
        "log_histories",
        "tree_leaves",
        "tree_founders",
        *(f"{p}_table" for p in POOLS),
    )
    for name in names:
        _require(len(arrays[name]) == particles, f"{name}: {len(arrays[name])} particles, expected {particles}")
    _require(arrays["map_corner"].shape == (2,), "map_corner: expected two numbers")


def _check_particles(arrays: Arrays) -> None:
    """Check that the weights have the sum 1, that covariances may be some, and that nothing is endlessly far away."""
    with np.errstate(over="ignore"):
        total = float(np.exp(arrays["log_weights"]).sum())
    _require(abs(total - 1.0) < ROUNDING, f"log_weights: weights with the sum {total:.3g}, expected 1")
    variances = np.diagonal(arrays["spread"], axis1=1, axis2=2)
    _require(bool((variances >= 0.0).all()), "spread: negative variances")
    for name in ("poses", "tree_poses", "map_corner"):
        farthest = max(float(arrays[name].max(initial=0)), -float(arrays[name].min(initial=0)))
        _require(farthest <= FARTHEST, f"{name}: {farthest:.3g}, expected at most {FARTHEST:.0e}")


def _check_scans(arrays: Arrays, values: Mapping[str, Any]) -> None:
    """Check that the scans that were used are among those that came, and that the last of them is known."""
    used, scans = arrays["update_scans"], values.get("scans")
    _require(isinstance(scans, int) and scans >= 0, f"scans: {str(scans)[:40]}, expected a number of scans")
    sound = used.size == 0 or (used[0] >= 0 and used[-1] < scans and bool((np.diff(used) > 0).all()))
    _require(sound, "update_scans: not in order, or beyond the last scan")
    _require(arrays["odometry"].shape == ((3,) if used.size else (0,)), "odometry: not that of the last used scan")
    counts = int(arrays["map_scans"]), int(arrays["tree_generations"])
    _require(counts == (len(used), len(used)), f"{counts} scans in map and histories, expected {len(used)}")


def _check_tree(arrays: Arrays) -> None:
    """Check that parents come before their children, and that each history has all generations."""
    parents, leaves, founders = arrays["tree_parents"], arrays["tree_leaves"], arrays["tree_founders"]
    nodes, generations = len(parents), int(arrays["tree_generations"])
    _require(len(arrays["tree_poses"]) == nodes, "tree_poses: not one for each node")
    _require(bool(((parents >= -1) & (parents < np.arange(nodes))).all()), "tree_parents: not before their children")
    depth = np.zeros(nodes + 1, np.int64)  # the last one stands for the parent -1
    for node, parent in enumerate(parents.tolist()):
        depth[node] = depth[parent] + 1
    _require(bool(((leaves >= -1) & (leaves < nodes)).all()), "tree_leaves: outside the tree")
    _require(bool((depth[leaves] == generations).all()), f"tree_leaves: histories not of {generations} poses")
    _require(bool(((founders >= 0) & (founders < len(leaves))).all()), "tree_founders: not particles")


def _check_pool(pool: str, arrays: Arrays) -> None:
    """Check that tables name tiles that are there, and that each tile has as many owners as it counts."""
    table, references, free = (arrays[f"{pool}_{part}"] for part in ("table", "references", "free"))
    tiles = len(references)
    data = [array for name, array in arrays.items() if name.startswith(f"{pool}_data")]
    _require(tiles > 0 and all(len(array) == tiles for array in data), f"{pool}_references: not one for each tile")
    _require(table.size == 0 or (table.min() >= 0 and table.max() < tiles), f"{pool}_table: tiles that are not there")
    owners = np.bincount(table.ravel(), minlength=tiles)
    owners[0] = 1  # the empty tile
    _require(bool((owners == references).all()), f"{pool}_references: not the number of owners")
    unowned = np.flatnonzero(references == 0)
    _require(np.array_equal(np.sort(free), unowned), f"{pool}_free: not the tiles without an owner")
    _require(not any(array[0].any() for array in data), f"{pool}_data: the empty tile is not empty")


def _check_area(arrays: Arrays) -> None:
    """Check that the tables of all pools cover as many cells, since one index serves them all."""
    cells = [
        tuple(math.isqrt(arrays[f"{pool}_data0"].shape[1]) * size for size in arrays[f"{pool}_table"].shape[1:])
        for pool in POOLS
    ]
    _require(len(set(cells)) == 1, f"tables of {', '.join(POOLS)} that cover {cells} cells, expected the same")
    touched, tiles = arrays["map_touched"].shape, arrays["counts_table"].shape[1:]
    _require(touched == tiles, f"map_touched: shape {touched}, expected {tiles}")
    side = math.isqrt(arrays["counts_data0"].shape[1])
    _require(not (arrays["map_corner"] % side).any(), f"map_corner: not the corner of a tile of {side} cells")


def _check_values(name: str, value: Any, fresh: Any) -> None:
    """Check that plain values have the types of a new filter's; where that has none yet, anything plain will do."""
    if isinstance(fresh, Mapping):
        _require(isinstance(value, Mapping) and set(value) == set(fresh), f"{name}: expected {sorted(fresh)}")
        for key, expected in fresh.items():
            _check_values(key, value[key], expected)
    elif isinstance(fresh, bool | str):
        _require(type(value) is type(fresh), f"{name}: {str(value)[:40]}, expected a {type(fresh).__name__}")
    elif isinstance(fresh, Real):
        real = isinstance(value, Real) and not isinstance(value, bool)
        _require(
            real and (isinstance(value, int) or bool(np.isfinite(value))),
            f"{name}: {str(value)[:40]}, expected a number",
        )
    elif isinstance(fresh, list | tuple):
        _require(isinstance(value, list | tuple), f"{name}: {str(value)[:40]}, expected a list")
