# SPDX-License-Identifier: MIT
"""Versions of the software that results depend on."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("slam-testbed", "numpy", "numba", "scipy", "shapely", "pybullet", "rerun-sdk")


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that results depend on, by name."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
