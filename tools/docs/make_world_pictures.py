# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Draw every world of the catalogue with its tour, and print the table of the catalogue.

    python -m tools.docs.make_world_pictures

Writes: docs/worlds/*.png
Prints: the table of docs/worlds.md
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import worlds

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "worlds"


def draw(world: worlds.World, path: Path) -> None:
    """Draw the true map, the tour and the start of one world."""
    truth = worlds.true_map(world, 0.05, margin=0.3)
    grey = np.where(truth.occupied, 0, np.where(truth.free, 255, 170)).astype(np.uint8)
    rows, cols = grey.shape
    x0, y0, _ = truth.origin
    figure = Figure(figsize=(4.0, 4.0 * rows / cols), dpi=80)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(
        grey, cmap="gray", origin="lower", extent=(x0, x0 + cols * 0.05, y0, y0 + rows * 0.05), vmin=0, vmax=255
    )
    axes.plot(*world.path().T, color="tab:orange", linewidth=0.8)
    for person in world.people:
        axes.plot(*np.array(person.points).T, color="tab:blue", linewidth=0.8, linestyle=":")
    axes.plot(world.start.x, world.start.y, "o", color="tab:green", markersize=4)
    axes.set_axis_off()
    figure.savefig(path, metadata={"Software": None})


def main() -> None:
    """Draw all worlds and print the table."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    FOLDER.mkdir(exist_ok=True)
    print("| | world | what it is | area m² | free | loops | tour m | observability | corridor | symmetry |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name in worlds.catalogue():
        world = worlds.load(name)
        draw(world, FOLDER / f"{name}.png")
        d = world.difficulty
        assert d is not None
        print(
            f'| <img src="worlds/{name}.png" width="160" alt="{name}"> '
            f"| [{name}](worlds/{name}.png) | {world.description} | {d.area:.0f} | {d.free_share:.2f} | {d.loops} "
            f"| {d.tour_length:.0f} | {d.observability:.2f} | {d.corridor_share:.2f} | {d.symmetry:.2f} |"
        )


if __name__ == "__main__":
    main()
