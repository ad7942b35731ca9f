# SPDX-License-Identifier: MIT
"""Plots of the report as SVG. Each is a function of plain arrays and leaves matplotlib's settings unchanged."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_rgb
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from eval.report.map_images import UNSEEN, Extent, Picture
from slam.se2 import Pose, transform_points

ESTIMATE, TRUTH, ODOMETRY, BAD, QUIET = "#1864ab", "#1b1f24", "#e67700", "#c92a2a", "#868e96"
"""Colour-blind readers can distinguish blue, black and orange, also in grey print."""
GOOD = "#2b8a3e"
SCAN = "#dc288c"
"""Of a scan from the estimated pose, as in the recording and in pictures of moments."""
LOOP_CLOSED, LOOP_LEFT_OPEN = "#0096a0", "#7828c8"
"""Of loops that the final pass found, as in the recording."""
STAGES = {"match": "#1864ab", "sample": "#63a4d8", "map": "#e8a33d", "resample": "#868e96"}
ERROR_COLOURS = LinearSegmentedColormap.from_list("error", ["#2b8a3e", "#f2b705", "#c92a2a"])
WIDE = (5.6, 2.5)
"""Size of a plot [inch]; two stand side by side on a page, one fills a phone."""
FAINT = 0.45
"""Strength of a map under a plot, 0 to 1."""
MAX_LEGEND = 52
"""Letters of the names of a legend that fit into one row above a plot."""
MAX_POINTS = 1200
STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#adb5bd",
    "axes.labelcolor": "#495057",
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#e9ecef",
    "grid.linewidth": 0.8,
    "xtick.color": "#495057",
    "ytick.color": "#495057",
    "legend.frameon": False,
    "legend.fontsize": 9.0,
    "lines.linewidth": 1.4,
    "lines.solid_joinstyle": "round",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,  # TrueType: publishers refuse Type 3
    "svg.hashsalt": "slam-testbed",  # equal runs give equal bytes
    "figure.constrained_layout.use": True,
}
"""Settings for `rc_context`."""
Series = tuple[str, ArrayLike, str]
"""Label, values, colour."""


class Marks(NamedTuple):
    """Marks in a plot over time: ticks along its axis, or diamonds on a curve."""

    times: ArrayLike
    """[s], (n,)."""
    colour: str
    on_curve: ArrayLike | None = None
    """Values of the curve at these times, (n,); None = ticks."""


def svg_uri(figure: Figure) -> str:
    """A figure as a `data:` address for HTML."""
    buffer = io.BytesIO()
    with rc_context(STYLE):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode()


def over_time(
    time: ArrayLike,
    series: Sequence[Series],
    label: str,
    *,
    marks: Mapping[str, Marks] | None = None,
    cursor: float | None = None,
    band: tuple[float, float] | None = None,
    log: bool = False,
    axis: str = "time [s]",
) -> str:
    """Plot values over time [s], or over the quantity that `axis` names.

    marks: what happened, by name. cursor: draw a line at this time. band: shade the values that are right.
    """
    t = np.asarray(time, dtype=np.float64)
    with rc_context(STYLE):
        figure, ax = _figure(WIDE)
        if band is not None:
            ax.axhspan(*band, color="#d3f9d8", lw=0, zorder=0)
        for name, values, colour in series:
            ax.plot(*thinned(t, np.asarray(values, dtype=np.float64)), color=colour, label=name)
        if log:
            ax.set_yscale("log")
        elif all(np.nanmin(np.asarray(values)) >= 0.0 for _, values, _ in series if np.isfinite(values).any()):
            ax.set_ylim(bottom=0.0)
        for row, (name, (at, colour, on_curve)) in enumerate((marks or {}).items()):
            times = np.asarray(at, dtype=np.float64)
            if len(times) and on_curve is not None:
                ax.plot(times, on_curve, "D", ms=4.0, mew=0.6, mec="white", color=colour, label=name, zorder=6)
            elif len(times):
                height = np.full(len(times), 0.03 + 0.05 * row)
                transform = ax.get_xaxis_transform()
                ax.plot(times, height, "|", ms=7, mew=1.1, color=colour, transform=transform, label=name, zorder=5)
        if cursor is not None:
            ax.axvline(cursor, color=BAD, lw=1.0, ls=(0, (4, 2)), label="where it went wrong")
        ax.set(xlabel=axis, ylabel=label)
        ax.margins(x=0.01)
        names = ax.get_legend_handles_labels()[1]
        fits = len(names) <= 4 and sum(map(len, names)) <= MAX_LEGEND
        _legend(ax, columns=4 if fits else 3 if len(names) > 4 else 2)
        return svg_uri(figure)


def stacked_over_time(time: ArrayLike, parts: Mapping[str, ArrayLike], label: str) -> str:
    """Stack the parts of a whole over time [s]; each bucket of time shows its mean."""
    t = np.asarray(time, dtype=np.float64)
    with rc_context(STYLE):
        figure, ax = _figure(WIDE)
        buckets = np.array_split(np.arange(len(t)), min(len(t), 200))
        middle = [float(np.mean(t[rows])) for rows in buckets]
        means = [[float(np.nanmean(np.asarray(part)[rows])) for rows in buckets] for part in parts.values()]
        ax.stackplot(middle, means, labels=list(parts), colors=[STAGES.get(name, QUIET) for name in parts], lw=0)
        ax.set(xlabel="time [s]", ylabel=label)
        ax.margins(x=0.01)
        _legend(ax)
        return svg_uri(figure)


def paths(
    curves: Sequence[Series], *, background: Picture | None = None, mark: tuple[str, ArrayLike] | None = None
) -> str:
    """Draw paths (n, 2) [m] from above, over a faint map; mark: a place (2,) and its name."""
    with rc_context(STYLE):
        figure, ax = _figure(_size_for(background.extent if background is not None else None))
        _ground(ax, background)
        for name, path, colour in curves:
            xy = np.asarray(path, dtype=np.float64)[:: -(-len(np.asarray(path)) // (4 * MAX_POINTS))]
            ax.plot(xy[:, 0], xy[:, 1], color=colour, label=name, lw=1.2)
        if mark is not None:
            ax.plot(
                *np.asarray(mark[1], dtype=np.float64), "X", ms=9.0, color=BAD, mec="white", label=mark[0], zorder=5
            )
        _legend(ax, columns=4 if mark is None else 2)
        return svg_uri(figure)


def ellipses(
    path: ArrayLike,
    centres: NDArray[np.float64],
    shapes: NDArray[np.float64],
    *,
    background: Picture | None = None,
) -> str:
    """Draw a path (n, 2) [m] from above and ellipses x^T shape^-1 x = 1 about centres (k, 2) [m]; shapes (k, 2, 2)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    values, axes = np.linalg.eigh(shapes)
    outlines = (axes * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ circle
    with rc_context(STYLE):
        figure, ax = _figure(_size_for(background.extent if background is not None else None))
        _ground(ax, background)
        xy = np.asarray(path, dtype=np.float64)[:: -(-len(np.asarray(path)) // MAX_POINTS)]
        ax.plot(xy[:, 0], xy[:, 1], color=QUIET, lw=1.0, label="estimate")
        drawn = (centres[:, :, None] + outlines).swapaxes(1, 2)
        ax.add_collection(LineCollection(list(drawn), colors=ESTIMATE, linewidths=1.1, label="95 % ellipses"))
        ax.autoscale_view()
        _legend(ax)
        return svg_uri(figure)


def links(
    path: ArrayLike, groups: Sequence[tuple[str, NDArray[np.float64], str]], *, background: Picture | None = None
) -> str:
    """Draw a path (n, 2) [m] from above, and groups of links between two places of it, (k, 2, 2) [m] with a colour."""
    with rc_context(STYLE):
        figure, ax = _figure(_size_for(background.extent if background is not None else None))
        _ground(ax, background)
        xy = np.asarray(path, dtype=np.float64)
        ax.plot(xy[:, 0], xy[:, 1], color=QUIET, lw=0.8, label="path")
        for name, ends, colour in groups:
            gap = np.full((len(ends), 1, 2), np.nan)  # lifts the pen between two links
            x, y = np.concatenate([ends, gap], axis=1).reshape(-1, 2).T
            ax.plot(x, y, "o-", color=colour, lw=1.2, ms=3.0, label=name)
        _legend(ax)
        return svg_uri(figure)


@dataclass(frozen=True, eq=False)
class SeenScan:
    """A scan drawn from one pose."""

    label: str
    pose: Pose
    """Pose of the robot, (3,)."""
    points: NDArray[np.float64]
    """End points of the beams in the robot's frame [m], (k, 2)."""
    colour: str
    """Of the robot."""
    scan_colour: str


def scan_over_map(
    scans: Sequence[SeenScan], curves: Sequence[Series], *, background: Picture | None, window: Extent
) -> str:
    """Draw scans, the robot and paths (n, 2) [m] over a map; `window` = x, x, y, y to show [m].

    All scans but the last are drawn as rings about its dots, so that none is hidden where they agree.
    """
    with rc_context(STYLE):
        figure, ax = _figure(_size_for(window))
        _ground(ax, background)
        for name, path, colour in curves:
            xy = np.asarray(path, dtype=np.float64)
            ax.plot(xy[:, 0], xy[:, 1], color=colour, label=name, lw=1.0)
        for number, scan in enumerate(scans):
            ring = number < len(scans) - 1
            look = {"ms": 6.0, "mew": 0.9, "mfc": "none"} if ring else {"ms": 2.2, "mew": 0.0}
            ends = transform_points(scan.pose, scan.points)
            ax.plot(ends[:, 0], ends[:, 1], "o", **look, color=scan.scan_colour, label=scan.label, zorder=6)
            nose = transform_points(scan.pose, [[0.07 * (window[1] - window[0]), 0.0]])[0]
            ax.annotate(
                "",
                xy=(nose[0], nose[1]),
                xytext=(scan.pose[0], scan.pose[1]),
                arrowprops={
                    "arrowstyle": "-|>",
                    "color": scan.colour,
                    "lw": 4.0 if ring else 1.6,
                    "shrinkA": 0.0,
                    "shrinkB": 0.0,
                },
                zorder=7,
            )
            size = 12.0 if ring else 7.0
            robot = f"robot, {scan.label.rpartition(' the ')[2]}"
            ax.plot(*scan.pose[:2], "o", ms=size, mfc="white", mec=scan.colour, mew=1.6, zorder=8, ls="", label=robot)
        ax.set_adjustable("box")  # the window is what to show, with a map and without
        ax.set_xlim(window[0], window[1])
        ax.set_ylim(window[2], window[3])
        _legend(ax, columns=2)
        return svg_uri(figure)


def error_by_place(path: ArrayLike, error: ArrayLike, *, background: Picture | None = None) -> str:
    """Draw a path (n, 2) [m] coloured by the error (n,) [m] along it, in metres where it is larger than one."""
    xy, e = np.asarray(path, dtype=np.float64), np.asarray(error, dtype=np.float64)
    step = -(-len(xy) // (2 * MAX_POINTS))
    xy, e = xy[::step], e[::step]
    with rc_context(STYLE):
        wide, high = _size_for(background.extent if background is not None else None)
        figure, ax = _figure((wide, max(0.82 * high, 2.0)))  # the colour bar takes a share of the width
        _ground(ax, background)
        top = max(float(np.percentile(e, 99.0)), 1e-3)
        scale, unit = (100.0, "cm") if top < 1.0 else (1.0, "m")
        lines = LineCollection(
            list(np.stack([xy[:-1], xy[1:]], axis=1)), cmap=ERROR_COLOURS, norm=Normalize(0.0, scale * top), lw=2.2
        )
        lines.set_array(0.5 * scale * (e[:-1] + e[1:]))
        ax.add_collection(lines)
        ax.autoscale_view()
        figure.colorbar(lines, ax=ax, label=f"error [{unit}]", pad=0.02).outline.set_visible(False)
        return svg_uri(figure)


def calibration(stated: ArrayLike, observed: ArrayLike, cells: ArrayLike) -> str:
    """Draw the calibration curve of the map's probabilities; larger dots stand for more cells."""
    n = np.asarray(cells, dtype=np.float64)
    with rc_context(STYLE):
        figure, ax = _figure(WIDE)
        ax.plot([0, 1], [0, 1], color=QUIET, lw=1.0, ls=(0, (4, 2)), label="perfect")
        ax.plot(stated, observed, color=ESTIMATE, lw=1.2)
        ax.scatter(np.asarray(stated), np.asarray(observed), s=15 + 90 * np.sqrt(n / n.max()), color=ESTIMATE, zorder=3)
        ax.set(xlabel="stated P(occupied)", ylabel="truly occupied", xlim=(-0.03, 1.03), ylim=(-0.05, 1.05))
        _legend(ax)
        return svg_uri(figure)


def labelled_dots(dots: Sequence[tuple[str, float, float, str]], x_label: str, y_label: str) -> str:
    """Draw one dot for each name, x, y and colour; both axes are logarithmic, x and y are positive."""
    with rc_context(STYLE):
        figure, ax = _figure(WIDE)
        for name, x, y, colour in dots:
            ax.plot([x], [y], "o", ms=7.0, color=colour, label=name)
        ax.set(xscale="log", yscale="log", xlabel=x_label, ylabel=y_label)
        ax.margins(0.15)
        _legend(ax)
        return svg_uri(figure)


def named_dots(groups: Sequence[Series], label: str) -> str:
    """Draw the positive values (n,) of each name as dots above it on a logarithmic axis, with a bar at the median."""
    with rc_context(STYLE):
        figure, ax = _figure(WIDE)
        for place, (_, values, colour) in enumerate(groups):
            y = np.asarray(values, dtype=np.float64)
            ax.plot(np.full(len(y), place), y, "o", ms=4.0, alpha=0.6, color=colour)
            ax.plot([place - 0.25, place + 0.25], [np.median(y)] * 2, color=colour, lw=2.4)
        ax.set_xticks(range(len(groups)), [name for name, _, _ in groups])
        ax.set(yscale="log", ylabel=label, xlim=(-0.6, len(groups) - 0.4))
        return svg_uri(figure)


def thinned(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Keep about `MAX_POINTS` points of a curve: the lowest and the highest of each bucket, so no spike is lost."""
    if len(x) <= MAX_POINTS:
        return x, y
    kept = []
    for rows in np.array_split(np.arange(len(x)), MAX_POINTS // 2):
        finite = rows[np.isfinite(y[rows])]
        ends = {int(finite[np.argmin(y[finite])]), int(finite[np.argmax(y[finite])])} if len(finite) else {int(rows[0])}
        kept += sorted(ends)
    return x[kept], y[kept]


def _size_for(shown: Extent | None) -> tuple[float, float]:
    """Return a size [inch] in the proportions of what is shown, but neither a strip nor a tower."""
    ratio = 0.75 if shown is None else (shown[3] - shown[2]) / (shown[1] - shown[0])
    return WIDE[0], float(np.clip(0.88 * WIDE[0] * ratio + 0.8, 2.0, 6.0))


def _figure(size: tuple[float, float]) -> tuple[Figure, Axes]:
    figure = Figure(figsize=size)
    return figure, figure.add_subplot()


def _ground(ax: Axes, background: Picture | None) -> None:
    """Set equal axes in metres and draw the faint map."""
    ax.set_aspect("equal", adjustable="datalim" if background is None else "box")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    if background is not None:
        # Blended by hand: the same faint grey then stands for the unknown within the picture and beyond its edge.
        faint = (255.0 - FAINT * (255.0 - background.pixels)).astype(np.uint8)
        ax.imshow(faint, extent=background.extent, interpolation="nearest", zorder=0)
        red, green, blue = (1.0 - FAINT * (1.0 - part) for part in to_rgb(UNSEEN))
        ax.set_facecolor((red, green, blue))
        ax.grid(False)


def _legend(ax: Axes, columns: int = 4) -> None:
    """Put the legend above the plot, where it hides nothing."""
    handles, labels = ax.get_legend_handles_labels()
    if len(handles) > 0:
        ax.legend(
            handles,
            labels,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=columns,
            borderaxespad=0.1,
            handlelength=1.4,
        )
