# SPDX-License-Identifier: MIT
"""How every numba kernel of the project is compiled, and where the compiled code is kept."""

from __future__ import annotations

import hashlib
import inspect
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config as numba_config


def kernel_files(package: Path) -> list[Path]:
    """All kernel files of a top-level package, at any depth."""
    return sorted(package.rglob("_*_kernels.py"))


@cache
def cache_folder(package: Path) -> Path:
    """Folder of the compiled kernels of one top-level package: its name changes when any of its kernel files changes.

    numba's own cache looks at the file of the calling kernel only, and so returns stale code after an edit of a
    function in another file. A folder named by the hash of all kernel files below the package cannot go stale.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    for source in kernel_files(package):
        digest.update(f"{source.relative_to(package)}\n".encode() + source.read_bytes())
    root = os.environ.get("TESTBED_CACHE") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "slam-testbed"
    )
    folder = Path(root) / "kernels" / f"{package.name}-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # read-only home, as in many containers
        folder = Path(tempfile.gettempdir()) / f"slam-testbed-{os.getuid()}" / folder.name
        folder.mkdir(parents=True, exist_ok=True)
    return folder


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
    settings: Any = numba_config  # its attributes are made at run time
    previous = settings.CACHE_DIR
    settings.CACHE_DIR = str(cache_folder(top_package(Path(inspect.getfile(function)))))
    try:
        return numba.njit(cache=os.environ.get("SLAM_KERNEL_CACHE", "1") == "1", nogil=True, error_model="numpy")(
            function
        )
    finally:
        settings.CACHE_DIR = previous


def inlined(function: Callable[..., Any]) -> Any:
    """Compile `function` into the kernels that call it.

    A call that passes a tuple of arrays counts a reference for each of them, which made inner loops ten times slower
    (benchmark: tests/benchmarks); inlined, the counting cancels out.
    """
    return numba.njit(forceinline=True, nogil=True, error_model="numpy")(function)
