# SPDX-License-Identifier: MIT
"""`testbed worlds`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import App, Parameter
from rich.table import Table

from eval.files.atomic_write import atomic_write
from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.console import announce_world, console, results
from worlds import World, catalogue, dumps, generate, import_map_with_notes, load, true_map
from worlds.generation.generators import Kind

app = App(name="worlds", help="List, draw, generate and import worlds.", help_epilogue="")


@app.command(name="list")
def list_worlds() -> None:
    """List the names, sizes and tours of the worlds of the package.

    Example: `testbed worlds list`
    """
    table = Table(box=None, pad_edge=False)
    for heading in ("name", "size", "tour", "description"):
        table.add_column(heading)
    for name in catalogue():
        world = load(name)
        table.add_row(name, _size(world), _tour(world), world.description)
    results.print(table)


@app.command
def show(world: str, *, out: Path | None = None, overwrite: bool = False) -> None:
    """Draw a world with its start and tour, and print its size and free space.

    Example: `testbed worlds show office --out office.png`

    Parameters
    ----------
    world
        Name from the catalogue, a TOML file, or a ROS map (`.yaml`).
    out
        Picture file (.png, .svg, .pdf); default: the name of the world with .png.
    overwrite
        Replace an existing picture.
    """
    AT_WORK.now_doing(f"drawing {world}")
    loaded = load(world)
    out = out or Path(f"{loaded.name}.png")
    if out.exists() and not overwrite:
        raise ValueError(f"{out}: exists; choose another --out or add --overwrite")
    _draw(loaded, out)
    truth = true_map(loaded)
    announce_world(loaded)
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("name", loaded.name)
    table.add_row("description", loaded.description)
    table.add_row("size", _size(loaded))
    table.add_row("free space", f"{truth.free.sum() * truth.resolution**2:.0f} m²")
    table.add_row("tour", _tour(loaded))
    table.add_row("picture", str(out))
    results.print(table)


@app.command(name="generate")
def generate_world(
    kind: Kind,
    *,
    out: Path,
    size: Annotated[tuple[str, ...], Parameter(consume_multiple=True)] = ("20x15",),
    clutter: float = 1.0,
    loops: int = 2,
    seed: int = 0,
) -> None:
    """Generate a random world with a tour through all of it; the same options give the same world.

    Example: `testbed worlds generate cave --size 30x20 --clutter 1.5 --seed 7 --out cave.toml`

    Parameters
    ----------
    kind
        Kind of world.
    out
        TOML file for the world.
    size
        Width and depth [m], as 80x60 or 80,60.
    clutter
        Objects per 10 m² of floor.
    loops
        Number of additional openings, each of which closes a loop.
    seed
        Random seed.
    """
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")
    _write(generate(kind, size=_parsed_size(size), clutter=clutter, loops=loops, seed=seed), out)


@app.command(name="import")
def import_world(map_: Annotated[Path, Parameter(name="map")], *, out: Path) -> None:
    """Convert a ROS map_server map to a world with walls along the edges of occupied cells and no tour.

    Example: `testbed worlds import MAP.yaml --out floor.toml`

    Parameters
    ----------
    map_
        The map's .yaml file; its image is next to it.
    out
        TOML file for the world.
    """
    with AT_WORK.doing(f"importing {map_}"):
        world, notes = import_map_with_notes(map_)
        _write(world, out)
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)


def _write(world: World, out: Path) -> None:
    if out.exists():
        raise ValueError(f"{out}: exists; choose another --out")
    with atomic_write(out) as aside:
        aside.write_text(dumps(world), encoding="utf-8")
    results.print(f"{out}: {world.name}, {_size(world)}, tour {_tour(world)}")


def _parsed_size(words: tuple[str, ...]) -> tuple[float, float]:
    """Return width and depth [m] of `80x60`, `80,60`, or `80 60` as two words; ValueError for anything else."""
    try:
        width, depth = map(float, re.split("[x,]", "x".join(words)))
    except ValueError:
        raise ValueError(f"--size {' '.join(words)}: expected width and depth in metres, such as 80x60") from None
    return width, depth


def _size(world: World) -> str:
    segments = world.boundary_segments().reshape(-1, 2)
    width, height = np.ptp(segments, axis=0)
    return f"{width:.1f} x {height:.1f} m"


def _tour(world: World) -> str:
    return f"{np.linalg.norm(np.diff(world.path(), axis=0), axis=1).sum():.0f} m"


def _draw(world: World, out: Path) -> None:
    """Draw walls in black, the tour in blue, the start as an arrow; the name decides the format of the picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.add_collection(LineCollection(list(world.boundary_segments().reshape(-1, 2, 2)), colors="black", linewidths=1))
    axes.plot(*world.path().T, color="tab:blue", linewidth=1)
    start = world.start
    axes.quiver(start.x, start.y, np.cos(start.theta), np.sin(start.theta), color="tab:blue", pivot="middle")
    axes.set(title=world.name, xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.autoscale()
    with atomic_write(out) as aside:
        figure.savefig(aside, format=out.suffix.lstrip(".") or "png", dpi=150)
