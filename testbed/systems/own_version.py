# SPDX-License-Identifier: MIT
"""Version of the systems that are made of this package alone."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def own_version() -> str:
    """Return the version of this package."""
    try:
        return version("slam-testbed")
    except PackageNotFoundError:  # run from its source tree
        return "source"
