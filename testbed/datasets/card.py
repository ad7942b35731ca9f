# SPDX-License-Identifier: MIT
"""The card of a collection (README.md) and its contact sheet: what there is, in words and in one picture."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.files.atomic_write import atomic_write
from eval.files.map_server import read_map
from eval.files.tum import read_tum
from testbed.datasets.commands import shortest_commands
from testbed.datasets.index import COLUMNS, INDEX, SPLITS, chosen_splits
from testbed.datasets.overlap import DEFINITION
from testbed.formats.parquet import COLUMNS as FRAME_COLUMNS
from testbed.presets import PresetError, load_lidar, load_robot

CARD, SHEET = "README.md", "contact_sheet.png"
MARK = "<!-- written by testbed simulate -->"
"""A README.md without this line belongs to somebody else and is kept."""
MAX_TILES = 48
"""Drives in a contact sheet; of more, evenly chosen ones are shown."""
COLUMNS_OF_TILES = 6
TILE, TITLE, LINE, GAP = 240, 26, 12, 8
"""Side of a drawing, height of its title and of a line of text, and the room between tiles and at the edge [pixels]."""
FIRST, LAST = (68, 1, 84), (245, 170, 20)
"""Colours of the path at the beginning and at the end of a drive."""
START, END = (0, 150, 60), (210, 30, 30)
"""Colours of the start and the end of a drive."""
SPLIT_COLOURS = {"train": (60, 60, 60), "validation": (0, 90, 200), "test": (200, 30, 30)}
"""Colours of the titles, by split."""
MAX_PIECES = 400
"""Pieces of one colour that a path is drawn in."""
LEGEND = "green ring: start; red dot: end; line: the true path, from dark (begin) to bright (end)"
TITLE_COLOURS = {"validation": "; blue title: validation", "test": "; red title: test"}
"""What the legend adds for the splits that there are."""
LINE_LENGTH = 120
"""Characters in a line of a card's paragraphs."""
SOFTWARE = "The slam-testbed authors, slam-testbed: a simulation-integrated SLAM testbed"
"""Authors and title of this package, as CITATION.cff states them."""
PAPER = """Giorgio Grisetti, Cyrill Stachniss, Wolfram Burgard: Improved Techniques for Grid Mapping With
Rao-Blackwellized Particle Filters. IEEE Transactions on Robotics 23(1), 34-46, 2007,
https://doi.org/10.1109/TRO.2006.889486"""
"""The paper whose filter the testbed implements, as CITATION.cff states it."""
AUTHOR, ADDRESS = "- Author: ", "- Address: "
"""Beginnings of the lines that name who published the data, and where."""
NOT_GIVEN = "not given"
MADE_BY = "## Made by\n```\n"
"""Begin of the part of a card that holds the commands."""
TOPICS = {
    "/scan": "`LaserScan`, the scans with the time between beams; with several lidars `/scan_NAME` for each",
    "/scan_cloud": "`PointCloud2`, hits of the scans, for viewers",
    "/odom": "`Odometry`, wheel odometry: pose of `base_link` in `odom`, velocity; covariances are not filled in (0)",
    "/tf": "`TFMessage`, the same pose: `odom` to `base_link`",
    "/tf_static": "`TFMessage`, mounts: `base_link` to the frame of each lidar, such as `laser`",
    "/cmd_vel": "`Twist`, commanded speed and turn rate",
    "/robot_description": "`String`, the robot as URDF",
    "/ground_truth/odom": "`Odometry`, the true pose: `base_link` in `map`",
    "/ground_truth/tf": "`TFMessage`, the true `map` to `odom`, not in `/tf`, where a SLAM node publishes its own",
    "/ground_truth/map": "`OccupancyGrid`, the true map",
    "/testbed/sha256": "`String`, sum of all other messages: a changed byte is noticed",
}
"""Topics of a bag and what they hold."""
ONLY_IN = {"/scan_cloud": ("rosbag2",), "/testbed/sha256": ("rosbag1", "rosbag2-sqlite")}
"""Formats of the topics that not all bags have."""


class Publication(NamedTuple):
    """What the card says of the collection as a publication; None = as the card says already."""

    title: str | None = None
    """At first the name of the directory."""
    author: str | None = None
    """Who publishes the data, for the sentence to cite."""
    url: str | None = None
    """Where the data are published."""


NO_CHANGE = Publication()


def write_card(
    directory: Path, rows: Sequence[dict[str, Any]], command: str | None = None, publication: Publication = NO_CHANGE
) -> bool:
    """Write the card of a collection; False, and no change, where its README.md was written by somebody else.

    rows: of the index
    command: a command that made some of the datasets; the card names it after those that it names already, and then
        leaves out those that make nothing further
    """
    path, old = directory / CARD, _text(directory)
    if old and MARK not in old:
        return False
    commands = [*commands_in(directory), *([command] if command else [])]
    name, chosen = directory.resolve().name, chosen_splits(directory)
    commands = shortest_commands(commands, name, chosen)
    given = (new or stated for new, stated in zip(publication, _stated(old), strict=True))
    text = _card(Publication(*given), name, rows, commands, bool(chosen))
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return True


def stated_publication(directory: Path) -> Publication | None:
    """What the card of a collection says; None where there is no card, or one that somebody else wrote.

    A title that is only the name of the directory counts as not given.
    """
    card = _text(directory)
    if MARK not in card:
        return None
    stated = _stated(card)
    return stated if stated.title != directory.resolve().name else stated._replace(title=None)


def _stated(card: str) -> Publication:
    return Publication(_rest_of_line(card, "# "), _rest_of_line(card, AUTHOR), _rest_of_line(card, ADDRESS))


def _rest_of_line(card: str, begin: str) -> str | None:
    """The rest of the first line that begins so, which the owner may have edited; None where nothing is given."""
    found = next((line.removeprefix(begin).strip() for line in card.splitlines() if line.startswith(begin)), "")
    return None if not found or found.startswith(NOT_GIVEN) else found


def commands_in(directory: Path) -> list[str]:
    """The commands that made the datasets of a collection, by its card; none where there is no card."""
    return _text(directory).partition(MADE_BY)[2].partition("\n```")[0].splitlines()


def _text(directory: Path) -> str:
    """The card of a collection; empty where there is none."""
    path = directory / CARD
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""


def write_contact_sheet(directory: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Draw the drives of a collection: each on the true map of its world, with split, lidar and length."""
    from PIL import Image, ImageDraw

    chosen = [rows[k] for k in np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MAX_TILES)).astype(int))]
    tiles = [_tile(directory / row["dataset"], _tile_title(row), SPLIT_COLOURS[row["split"]]) for row in chosen]
    lines = [tiles[k : k + COLUMNS_OF_TILES] for k in range(0, len(tiles), COLUMNS_OF_TILES)]
    heights = [max(tile.size[1] for tile in line) + GAP for line in lines]
    width = GAP + max(map(len, lines)) * (TILE + GAP)
    text = LEGEND + "".join(words for split, words in TITLE_COLOURS.items() if any(r["split"] == split for r in rows))
    legend = [piece.strip() for piece in text.split(";")] if len(chosen) <= 2 else [text]
    sheet = Image.new("RGB", (max(width, 2 * (TILE + GAP)), 2 * GAP + sum(heights) + LINE * len(legend)), "white")
    for number, text in enumerate(legend):
        ImageDraw.Draw(sheet).text((GAP, GAP + sum(heights) + LINE * number), text, fill=(60, 60, 60))
    for number, line in enumerate(lines):
        for column, tile in enumerate(line):
            sheet.paste(tile, (GAP + column * (TILE + GAP), GAP + sum(heights[:number])))
    with atomic_write(directory / SHEET) as temporary:
        sheet.save(temporary, format="PNG", optimize=True)


def _tile_title(row: dict[str, Any]) -> str:
    length = f", {row['metres']:.0f} m" if row["metres"] is not None else ""
    return f"{row['dataset']}\n{row['split']}, {row['lidar']}, {row['seconds']:.0f} s{length}"


def _tile(dataset: Path, title: str, title_colour: tuple[int, int, int]) -> Any:
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
    for piece, colour in _coloured(pixels):
        draw.line(piece, fill=colour, width=2)
    (x, y), (x_end, y_end) = pixels[0].tolist(), pixels[-1].tolist()
    draw.ellipse((x - 5, y - 5, x + 5, y + 5), outline=START, width=2)
    draw.ellipse((x_end - 3, y_end - 3, x_end + 3, y_end + 3), fill=END)
    tile = Image.new("RGB", (TILE, size[1] + TITLE), "white")
    tile.paste(image, ((TILE - size[0]) // 2, 0))
    ImageDraw.Draw(tile).text((0, size[1] + 1), title, fill=title_colour)
    return tile


def _coloured(pixels: NDArray[np.float64]) -> Iterator[tuple[list[tuple[float, float]], tuple[int, int, int]]]:
    """The pieces of a path (n, 2), each with the colour of its time."""
    ends = np.unique(np.linspace(0, len(pixels) - 1, min(len(pixels), MAX_PIECES + 1)).astype(int)).tolist()
    for begin, end in pairwise(ends):
        share = begin / (len(pixels) - 1)
        red, green, blue = (round(first + share * (last - first)) for first, last in zip(FIRST, LAST, strict=True))
        yield [(x, y) for x, y in pixels[begin : end + 1].tolist()], (red, green, blue)


def _card(
    publication: Publication, directory: str, rows: Sequence[dict[str, Any]], commands: Sequence[str], chosen: bool
) -> str:
    title = publication.title or directory
    seconds, metres = sum(row["seconds"] for row in rows), sum(row["metres"] or 0.0 for row in rows)
    size, worlds = sum(row["bytes"] for row in rows), sorted({row["world"] for row in rows})
    formats = ", ".join(f"`{kind}`" for kind in sorted({row["format"] for row in rows}))
    summary = (
        f"{len(rows)} simulated drives of a robot with a 2D lidar, with their true poses and true maps, for SLAM: "
        f"{_hours(seconds)} and {metres / 1000:.2f} km in {len(worlds)} world{'' if len(worlds) == 1 else 's'}, "
        f"{_size(size)} as {formats}. {_routes(rows)}"
    )
    split_note = "No world is in two splits, so that a method is tested in buildings that it has not seen. " + (
        "Which world is in which split was chosen by hand, by the last command of this card."
        if chosen
        else "A hash of the worlds' names decided which world is in which split."
    )
    licence, map_note = _licence(rows)
    licence_note = f"CC-BY-4.0: use and publish the data for any purpose, if you cite it. {map_note}"
    return f"""---
pretty_name: {json.dumps(title, ensure_ascii=False)}
{licence}
tags: [robotics, slam, lidar, 2d-mapping]
configs:
- config_name: index
  data_files: {INDEX}
---
{MARK}
# {title}

{fill(summary, LINE_LENGTH)}

![The drives on the maps of their worlds]({SHEET})

{_common_ways(rows)}## Splits
{fill(split_note, LINE_LENGTH)}

| split | datasets | time | metres | worlds |
|---|---|---|---|---|
{_lines(_split_line(rows, split) for split in SPLITS)}

| lidar | train | validation | test |
|---|---|---|---|
{_lines(_lidar_line(rows, lidar) for lidar in sorted({row["lidar"] for row in rows}))}

## Sensors
{_lines(_sensors(rows))}

{_draws(rows)}## Files
`{INDEX}` has a row a dataset. Each dataset is a directory with the recording, `truth.tum` (the true pose of the
robot at each scan), `truth_map.yaml` and `.pgm` (the true map), `world.toml`, and `config.toml` with all settings and
the SHA-256 of the other files.

| column of `{INDEX}` | meaning |
|---|---|
{_lines(f"| `{column}` | {meaning} |" for column, meaning in COLUMNS.items())}

{_content(rows)}
Angles in radians, counter-clockwise; distances in metres; times in seconds.

## Load
Run these in this directory.

{_without_testbed(rows)}With the Python package slam-testbed {version("slam-testbed")} (MIT licence), for all
formats. It is installed from its source directory, by `pip install .` or, with an environment of its own, `make run`:

```python
from testbed.datasets import open_collection

for dataset in open_collection(".").split("train"):
    dataset.scans, dataset.odometry, dataset.truth  # (n, beams) [m], (n, 3) and (n, 3) [m, m, rad]
```
Odometry and truth are poses of the robot, not of the lidar: `dataset.mount` is the pose of the lidar on the robot.

## Licence and citation
{fill(licence_note, LINE_LENGTH)}

{_citation(publication, directory)}

slam-testbed is a testbed for the particle filter of

> {PAPER.replace(chr(10), chr(10) + "> ")}

{_made_by(commands)}"""


def _citation(publication: Publication, directory: str) -> str:
    """Author and address of the data, and the sentence to cite."""
    title, author, url = publication.title or directory, publication.author, publication.url
    advice = f"{NOT_GIVEN}; `testbed datasets index {directory} --author NAME --url ADDRESS` adds it"
    made = f"made with slam-testbed {version('slam-testbed')} ({SOFTWARE})"
    by = f"{author} ({time.localtime().tm_year}). " if author else ""
    sentence = f"{by}{title}: simulated 2D lidar drives, {made}. CC-BY-4.0.{f' {url}' if url else ''}"
    return f"{AUTHOR}{author or advice}\n{ADDRESS}{url or advice}\n\n> {sentence}"


def _routes(rows: Sequence[dict[str, Any]]) -> str:
    """How the drives of one world differ."""
    sentences = {
        "stops": "Each drive begins elsewhere and visits other stops on the floor, drawn from its seed.",
        "random": "Each drive begins elsewhere on the tour of its world and takes it in its own order and direction.",
        "fixed": "**Drives of one world with a fixed route follow the same path**; they differ in their noise.",
    }
    routes = {row["route"] for row in rows}
    return " ".join(sentence for route, sentence in sentences.items() if route in routes)


def _common_ways(rows: Sequence[dict[str, Any]]) -> str:
    """How much the drives of one world have in common; empty where no world has two."""
    overlaps = [row["overlap"] for row in rows if row["overlap"] is not None]
    places = [row["same_places"] for row in rows if row["same_places"] is not None]
    if not overlaps:
        return ""
    found = (
        f"The two most similar drives of one world share {_percent(max(overlaps))} of their way; the median drive "
        f"shares {_percent(np.median(overlaps))} with its nearest (column `overlap`). Counted in any direction and "
        f"order, the most similar drive has {_percent(max(places))} of its way in common with another one, the median "
        f"drive {_percent(np.median(places))} (column `same_places`)."
    )
    return f"## What drives have in common\n{fill(found, LINE_LENGTH)}\n\n{fill(DEFINITION, LINE_LENGTH)}\n\n"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _licence(rows: Sequence[dict[str, Any]]) -> tuple[str, str]:
    """The licence for the head of the card, and a sentence on worlds that somebody else may have a right to."""
    sources = {row["world"]: str(json.loads(row["settings"]).get("world", "")) for row in rows}
    files = sorted(f"`{world}`" for world, source in sources.items() if source.endswith((".toml", ".yaml", ".yml")))
    if not files:
        return "license: cc-by-4.0", "The worlds are part of slam-testbed or generated by it."
    return "license: other\nlicense_name: cc-by-4.0-and-that-of-the-maps", (
        f"The map of {', '.join(files)} is from a file that is not part of slam-testbed: the licence of that file "
        "applies to the data too."
    )


def _without_testbed(rows: Sequence[dict[str, Any]]) -> str:
    """How to read a recording with other software."""
    formats, name = {row["format"] for row in rows}, rows[0]["dataset"]
    text = ""
    if any(kind.startswith("rosbag") for kind in formats):
        path = next(row["dataset"] for row in rows if row["format"].startswith("rosbag"))
        path += f"/{path}.bag" if "rosbag1" in formats else ""
        text += f"""Bags, by everything that reads rosbag2 or rosbag1, such as `pip install rosbags`:

```python
from pathlib import Path
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

with AnyReader([Path("{path}")], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
    connections = [connection for connection in bag.connections if connection.topic == "/scan"]
    for connection, time, raw in bag.messages(connections):
        scan = bag.deserialize(raw, connection.msgtype)  # scan.ranges, scan.angle_min, scan.angle_increment
```

"""
    if "parquet" in formats:
        text += f'Tables, by pandas: `pandas.read_parquet("{name}/frames.parquet")`.\n\n'
    if "carmen" in formats:
        text += "CARMEN logs are packed text with a message a line, such as `ROBOTLASER1`.\n\n"
    return text


def _made_by(commands: Sequence[str]) -> str:
    """The commands that made the datasets."""
    again = """
`testbed simulate --config DATASET/config.toml --out DIRECTORY` makes one dataset again, byte for byte, with the same
versions, which stand in its `config.toml`.
"""
    return f"{MADE_BY}{_lines(commands)}\n```\n{again}" if commands else f"## Made by{again}"


def _content(rows: Sequence[dict[str, Any]]) -> str:
    """What the recordings hold: topics of bags, columns of tables."""
    formats = {row["format"] for row in rows}
    text = ""
    if any(kind.startswith("rosbag") for kind in formats):
        there = [topic for topic in TOPICS if formats & set(ONLY_IN.get(topic, formats))]
        topics = _lines(f"| `{topic}` | {TOPICS[topic]} |" for topic in there)
        text = f"| topic of a bag | type and content |\n|---|---|\n{topics}\n\n"
        text += "Stamps begin at 0 s; there is no `/clock`.\n\n"
    table = "`frames.parquet` and of `Dataset.to_pandas()`" if "parquet" in formats else "`Dataset.to_pandas()`"
    columns = _lines(f"| `{column}` | {meaning} |" for column, meaning in FRAME_COLUMNS.items())
    return f"{text}| column of {table} | meaning |\n|---|---|\n{columns}\n"


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(lines)


def _split_line(rows: Sequence[dict[str, Any]], split: str) -> str:
    chosen = [row for row in rows if row["split"] == split]
    worlds = sorted({row["world"] for row in chosen})
    named = ", ".join(worlds[:6]) + (f" and {len(worlds) - 6} others" if worlds[6:] else "")
    seconds, metres = sum(row["seconds"] for row in chosen), sum(row["metres"] or 0.0 for row in chosen)
    return f"| {split} | {len(chosen)} | {_hours(seconds)} | {metres:.0f} | {named or '–'} |"


def _lidar_line(rows: Sequence[dict[str, Any]], lidar: str) -> str:
    counts = Counter(row["split"] for row in rows if row["lidar"] == lidar)
    return f"| {lidar} | {' | '.join(str(counts[split]) for split in SPLITS)} |"


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
