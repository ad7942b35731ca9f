# SPDX-License-Identifier: MIT
"""The card of a collection (README.md) and its contact sheet: what there is, in words and in one picture."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from eval.files.atomic_write import atomic_write
from eval.files.map_server import read_map
from eval.files.tum import read_tum
from testbed.datasets.index import COLUMNS, INDEX
from testbed.formats.parquet import COLUMNS as FRAME_COLUMNS
from testbed.presets import PresetError, load_lidar, load_robot

CARD, SHEET = "README.md", "contact_sheet.png"
MARK = "<!-- written by testbed simulate -->"
"""A README.md without this line belongs to somebody else and is kept."""
MAX_TILES = 48
"""Drives in a contact sheet; of more, evenly chosen ones are shown."""
COLUMNS_OF_TILES = 6
TILE, TITLE, GAP = 240, 14, 8
"""Side of a drawing, height of its title, and the room between tiles and at the edge [pixels]."""


def write_card(directory: Path, rows: Sequence[dict[str, Any]], command: str) -> bool:
    """Write the card of a collection; False, and no change, where its README.md was written by somebody else.

    rows: of the index
    command: the command that makes the collection again
    """
    path = directory / CARD
    if path.exists() and MARK not in path.read_text(encoding="utf-8", errors="replace"):
        return False
    with atomic_write(path) as temporary:
        temporary.write_text(_card(directory.resolve().name, rows, command), encoding="utf-8")
    return True


def write_contact_sheet(directory: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Draw the drives of a collection: each on the true map of its world, from the start (green) to the end (red)."""
    from PIL import Image

    chosen = [rows[k] for k in np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MAX_TILES)).astype(int))]
    tiles = [_tile(directory / row["dataset"], f"{row['dataset']} · {row['split']}") for row in chosen]
    lines = [tiles[k : k + COLUMNS_OF_TILES] for k in range(0, len(tiles), COLUMNS_OF_TILES)]
    heights = [max(tile.size[1] for tile in line) + GAP for line in lines]
    width = GAP + max(map(len, lines)) * (TILE + GAP)
    sheet = Image.new("RGB", (width, GAP + sum(heights)), "white")
    for number, line in enumerate(lines):
        for column, tile in enumerate(line):
            sheet.paste(tile, (GAP + column * (TILE + GAP), GAP + sum(heights[:number])))
    with atomic_write(directory / SHEET) as temporary:
        sheet.save(temporary, format="PNG", optimize=True)


def _tile(dataset: Path, title: str) -> Any:
    """The drive of one dataset on its map, with a title below."""
    from PIL import Image, ImageDraw

    grid, truth = read_map(dataset / "truth_map.yaml", inside=True), read_tum(dataset / "truth.tum")
    shade = np.where(grid.known, 255.0 - 195.0 * np.nan_to_num(grid.probability), 225.0).astype(np.uint8)
    scale = TILE / max(shade.shape)
    image = Image.fromarray(np.flipud(shade)).convert("RGB")
    size = (max(round(shade.shape[1] * scale), 1), max(round(shade.shape[0] * scale), 1))
    image = image.resize(size, Image.Resampling.BOX)
    pixels = (truth.poses[:, :2] - np.array(grid.origin[:2])) / grid.resolution * scale
    pixels[:, 1] = size[1] - pixels[:, 1]
    draw = ImageDraw.Draw(image)
    path = list(map(tuple, pixels.tolist()))
    draw.line(path, fill=(0, 90, 200), width=1)
    for (x, y), colour in ((path[0], (0, 150, 60)), (path[-1], (210, 30, 30))):
        draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=colour)
    tile = Image.new("RGB", (TILE, size[1] + TITLE), "white")
    tile.paste(image, ((TILE - size[0]) // 2, 0))
    ImageDraw.Draw(tile).text((0, size[1] + 1), title, fill=(60, 60, 60))
    return tile


def _card(name: str, rows: Sequence[dict[str, Any]], command: str) -> str:
    seconds, metres = sum(row["seconds"] for row in rows), sum(row["metres"] or 0.0 for row in rows)
    size, worlds = sum(row["bytes"] for row in rows), sorted({row["world"] for row in rows})
    formats = ", ".join(f"`{kind}`" for kind in sorted({row["format"] for row in rows}))
    drives = (
        "Each seed drives another route."
        if all(row["route"] == "random" for row in rows)
        else ("**Drives of one world with a fixed route follow the same path**; they differ in their noise.")
    )
    return f"""---
pretty_name: {name}
license: cc-by-4.0
tags: [robotics, slam, lidar, 2d-mapping]
configs:
- config_name: index
  data_files: {INDEX}
---
{MARK}
# {name}

{len(rows)} simulated drives of a robot with a 2D lidar, with their true poses and true maps, for SLAM:
{_hours(seconds)} and {metres / 1000:.2f} km in {len(worlds)} world{"" if len(worlds) == 1 else "s"}, {_size(size)} as
{formats}. {drives}

![The drives on the maps of their worlds]({SHEET})

## Splits
No world is in two splits, so that a method is tested in buildings that it has not seen. {_split_note(worlds)}

| split | datasets | time | metres | worlds |
|---|---|---|---|---|
{_lines(_split_line(rows, split) for split in ("train", "validation", "test"))}

## Sensors
{_lines(_sensors(rows))}

{_draws(rows)}## Files
`{INDEX}` has a row a dataset. Each dataset is a directory with the recording, `truth.tum` (the true pose at each scan),
`truth_map.yaml` and `.pgm` (the true map), `world.toml`, and `config.toml` with all settings and the SHA-256 of the
other files.

| column of `{INDEX}` | meaning |
|---|---|
{_lines(f"| `{column}` | {meaning} |" for column, meaning in COLUMNS.items())}

| column of `frames.parquet`, or of `Dataset.to_pandas()` | meaning |
|---|---|
{_lines(f"| `{column}` | {meaning} |" for column, meaning in FRAME_COLUMNS.items())}

Angles in radians, counter-clockwise; distances in metres; times in seconds.

## Load
```python
from testbed.datasets import open_collection

for dataset in open_collection("{name}").split("train"):
    dataset.scans, dataset.odometry, dataset.truth  # (n, beams) [m], (n, 3) and (n, 3) [m, m, rad]
```

## Licence and citation
CC-BY-4.0: use and publish the data for any purpose, with a reference to its source:

> {name}: simulated 2D lidar drives, made with slam-testbed {version("slam-testbed")}, CC-BY-4.0.

## Made by
```
{command}
```
The command makes the same bytes again with the same versions, which stand in each `config.toml`.
"""


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(lines)


def _split_note(worlds: Sequence[str]) -> str:
    if len(worlds) == 1:
        return "There is one world only, so that all datasets are for training: add a second world for testing."
    return "Two worlds leave none for validation: add a third." if len(worlds) == 2 else ""


def _split_line(rows: Sequence[dict[str, Any]], split: str) -> str:
    chosen = [row for row in rows if row["split"] == split]
    worlds = sorted({row["world"] for row in chosen})
    named = ", ".join(worlds[:6]) + (f" and {len(worlds) - 6} others" if worlds[6:] else "")
    seconds, metres = sum(row["seconds"] for row in chosen), sum(row["metres"] or 0.0 for row in chosen)
    return f"| {split} | {len(chosen)} | {_hours(seconds)} | {metres:.0f} | {named or '–'} |"


def _sensors(rows: Sequence[dict[str, Any]]) -> list[str]:
    """A line for each robot and each lidar."""
    lines = []
    for robot, count in sorted(Counter(row["robot"] for row in rows).items()):
        try:
            preset = load_robot(robot)
            lines.append(f"- Robot `{preset.name}` in {count} datasets: {preset.title}")
        except PresetError:
            lines.append(f"- Robot `{robot}` in {count} datasets")
    for lidar, count in sorted(Counter(one for row in rows for one in row["lidar"].split(",")).items()):
        try:
            device = load_lidar(lidar.strip())
            lines.append(
                f"- Lidar `{device.name}` ({device.title}) in {count} datasets: {device.beams} beams over "
                f"{device.field_of_view_deg:g} degrees at {device.scan_rate:g} Hz, {device.range_min:g} to "
                f"{device.range_max:g} m"
            )
        except PresetError:
            lines.append(f"- Lidar `{lidar}` in {count} datasets")
    return lines


def _draws(rows: Sequence[dict[str, Any]]) -> str:
    """What was drawn at random, with the range that came out."""
    values: dict[str, list[Any]] = {}
    for row in rows:
        for key, value in json.loads(row["draws"]).items():
            values.setdefault(key, []).append(value)
    if not values:
        return ""
    lines = []
    for key, drawn in sorted(values.items()):
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in drawn):
            lines.append(f"- `{key}`: {min(drawn):.4g} to {max(drawn):.4g}")
        else:
            lines.append(f"- `{key}`: " + ", ".join(f"{v} ({n})" for v, n in sorted(Counter(map(str, drawn)).items())))
    return "Drawn at random for each dataset, see the column `draws`:\n\n" + "\n".join(lines) + "\n\n"


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.2f} h" if seconds >= 360 else f"{seconds:.0f} s"


def _size(size: float) -> str:
    return f"{size / 1e9:.2f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"
