# SPDX-License-Identifier: MIT
"""How every numba kernel of the project is compiled."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import config as numba_config

from slam._kernel_cache import GuardedCache, cache_folder

OPTIONS: Any = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""Of all kernels; none is called from C, and a wrapper for that would take time to compile."""


def top_package(source: Path) -> Path:
    """Folder of the outermost package that a source file belongs to."""
    folder = source.parent
    while (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    return folder


def kernel(function: Callable[..., Any]) -> Any:
    """Compile `function` on first use, keep the machine code on disk, release the GIL while it runs.

    `error_model="numpy"`: x / 0 is inf as in numpy. No `fastmath`: it breaks `isnan` and the equality of results.
    `SLAM_KERNEL_CACHE=0` switches the cache on disk off.
    """
    folder = None
    if os.environ.get("SLAM_KERNEL_CACHE", "1") == "1":
        folder = cache_folder(top_package(Path(inspect.getfile(function))))
    settings: Any = numba_config  # its attributes are made at run time
    previous = settings.CACHE_DIR
    settings.CACHE_DIR = str(folder)
    try:
        compiled: Any = numba.njit(cache=folder is not None, **OPTIONS)(function)
    finally:
        settings.CACHE_DIR = previous
    if folder is not None and not settings.DISABLE_JIT:  # with NUMBA_DISABLE_JIT it is the function itself
        compiled._cache = GuardedCache(compiled._cache)
    return compiled


def inlined(function: Callable[..., Any]) -> Any:
    """Compile `function` into the kernels that call it.

    A call that passes a tuple of arrays counts a reference for each of them, which made inner loops ten times slower
    (benchmark: tests/benchmarks); inlined, the counting cancels out.
    """
    return numba.njit(forceinline=True, **OPTIONS)(function)
