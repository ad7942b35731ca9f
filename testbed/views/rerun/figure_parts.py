# SPDX-License-Identifier: MIT
"""What pictures of a run are drawn with: lines, dots, ellipses, a view around a place with its scale, and the PNG."""

from __future__ import annotations

import io
import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slam import se2
from slam.se2 import Pose
from testbed.views.rerun.recorded import Ellipse, GridImage, Recorded, strips

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

DOTS_PER_INCH = 100
"""Resolution of the pictures."""
DOT = 2.6
"""Size of an end point of a scan [pt]."""
WIDE = 1.6
"""Width of a view around a place as part of its height, unless said otherwise."""
BAR = 0.02
"""Height of the scale's bar as part of that."""
LOOK: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
"""Settings for `rc_context`."""


def as_png(figure: Figure) -> bytes:
    """A figure as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    out = io.BytesIO()
    FigureCanvasAgg(figure).print_figure(out, dpi=DOTS_PER_INCH, format="png")
    return _with_palette(out.getvalue())


def _with_palette(png: bytes) -> bytes:
    """The same picture in a third of the bytes."""
    from PIL import Image

    out = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(256, kmeans=2, dither=Image.Dither.NONE).save(
        out, "png", optimize=True
    )
    return out.getvalue()


def rgb(colour: tuple[int, int, int]) -> tuple[float, float, float]:
    """A colour of 0 to 255 each as one of 0 to 1 each."""
    red, green, blue = (part / 255.0 for part in colour)
    return red, green, blue


def legend_mark(style: str, colour: tuple[int, int, int]) -> Line2D:
    """A mark for the legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="", marker=style, color=rgb(colour))


def title_left(axes: Axes) -> None:
    """Move the title to the left edge."""
    axes.title.set_horizontalalignment("left")
    axes.title.set_x(0.0)


def seen_from(T: Pose, shape: Ellipse) -> Ellipse:
    """An ellipse seen from another frame."""
    return Ellipse(se2.transform_points(T, [shape.centre])[0], shape.half, shape.angle + float(T[2]))


def draw_lines(
    axes: Axes, lines: list[NDArray[np.float64]], colour: tuple[int, int, int], width: float, label: str | None = None
) -> None:
    """Draw lines (n, 2) [m] as one curve, with the pen lifted between two of them; width: of the pen [pt]."""
    if not lines:
        return
    gap = np.full((1, 2), np.nan)
    x, y = np.concatenate([part for line in lines for part in (line, gap)]).T
    axes.plot(x, y, color=rgb(colour), lw=width, label=label, solid_capstyle="round")


def draw_dots(
    axes: Axes, places: NDArray[np.float64], colour: tuple[int, int, int], label: str | None = None, size: float = DOT
) -> None:
    """Draw places (n, 2) as dots; size: of a dot [pt]."""
    axes.plot(*places.T, ".", ms=size, color=rgb(colour), label=label, zorder=5)


def draw_grid(axes: Axes, shown: GridImage, T_world_grid: Pose) -> None:
    """Draw a map whose lower left corner has a pose (3,)."""
    from matplotlib.transforms import Affine2D

    x, y, theta = T_world_grid.tolist()
    rows, columns = shown.image.shape
    extent = (0.0, columns * shown.cell, 0.0, rows * shown.cell)
    image = axes.imshow(shown.image, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="nearest")
    image.set_transform(Affine2D().rotate(theta).translate(x, y) + axes.transData)


def draw_robot(axes: Axes, recorded: Recorded, entity: str, at: Pose, colour: tuple[int, int, int]) -> None:
    """Draw the recorded footprint of a robot at a pose (3,)."""
    for part in ("outline", "heading"):
        shape = recorded.fixed(f"{entity}/{part}")
        if shape:
            lines = [se2.transform_points(at, line) for line in strips(shape["LineStrips3D:strips"])]
            draw_lines(axes, lines, colour, 1.6)


def draw_ellipse(axes: Axes, shape: Ellipse, colour: tuple[int, int, int], label: str) -> None:
    """Draw the outline of an ellipse."""
    angles = np.linspace(0.0, 2.0 * np.pi, 65)
    circle = np.column_stack([np.cos(angles), np.sin(angles)]) * shape.half
    x, y = se2.transform_points([*shape.centre, shape.angle], circle).T
    axes.plot(x, y, color=rgb(colour), lw=1.8, label=label, zorder=5.5)


def passes_through(line: NDArray[np.float64], centre: NDArray[np.float64], reach: float) -> bool:
    """Whether a line (n, 2) passes through what `_frame` shows."""
    steps = [a + (b - a) * np.linspace(0.0, 1.0, 9)[:, None] for a, b in itertools.pairwise(line)]
    off = np.abs(np.concatenate([line, *steps]) - centre)
    return bool(((off[:, 0] < WIDE * reach) & (off[:, 1] < reach)).any())


def show_around(axes: Axes, centre: NDArray[np.float64], reach: float, wide: float = WIDE) -> None:
    """Show so much above and below a place [m], and `wide` times as much beside it, with a scale in the corner instead
    of coordinates."""
    from matplotlib.offsetbox import AnchoredOffsetbox, AuxTransformBox, TextArea, VPacker
    from matplotlib.patches import Rectangle

    axes.spines[:].set_visible(True)
    x, y = centre.tolist()
    axes.set(xlim=(x - wide * reach, x + wide * reach), ylim=(y - reach, y + reach), xticks=[], yticks=[])
    scale = 10.0 ** math.floor(math.log10(reach))
    scale *= 5.0 if reach / scale >= 5.0 else 2.0 if reach / scale >= 2.0 else 1.0
    name = f"{scale:g} m" if scale >= 1.0 else f"{100.0 * scale:g} cm"
    bar = AuxTransformBox(axes.transData)
    bar.add_artist(Rectangle((0.0, 0.0), scale, BAR * reach, color="black", lw=0.0))
    label = TextArea(name, textprops={"fontsize": 8.5})
    packed = VPacker(children=[label, bar], align="center", pad=0.0, sep=3.0)
    box = AnchoredOffsetbox("lower left", child=packed, pad=0.3, borderpad=0.5)
    box.patch.set(facecolor="white", edgecolor="none", alpha=0.85)  # walls below are black too
    box.set_zorder(10.0)
    axes.add_artist(box)
