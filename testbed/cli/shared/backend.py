# SPDX-License-Identifier: MIT
"""What is said of the backend that `--backend auto` stands for."""

from __future__ import annotations

from testbed.cli.shared.console import console
from testbed.settings.simulator import SimulatorOptions
from testbed.simulation.physics.pybullet import how_to_install


def announce_backend(simulator: SimulatorOptions) -> None:
    """Say so where PyBullet would have been used but is not installed."""
    if simulator.backend == "auto" and simulator.settled().backend == "fast":
        console.print(
            "PyBullet is not installed: the backend is fast, exact arcs and rays without physics "
            f"(to have PyBullet: {how_to_install()})",
            soft_wrap=True,
        )
