# SPDX-License-Identifier: MIT
"""The backend that `--backend auto` stands for, which is decided before anything is written."""

from __future__ import annotations

from typing import TypeVar

from testbed.cli.shared.console import console
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation.physics.pybullet import how_to_install

_Options = TypeVar("_Options", bound=SimulatorOptions)


def with_backend(simulator: _Options) -> _Options:
    """Return the options with all defaults decided; say so where PyBullet would have been used but is not installed."""
    settled = simulator.settled()
    if simulator.backend == "auto" and settled.backend == "fast":
        console.print(
            "PyBullet is not installed: the backend is fast, exact arcs and rays without physics "
            f"(to have PyBullet: {how_to_install()})",
            soft_wrap=True,
        )
    return settled  # type: ignore[return-value]  # settled() returns its own class
