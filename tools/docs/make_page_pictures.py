# SPDX-License-Identifier: MIT
"""Draw what the pages of the reference speak of: terminal, report, notebook, scan, self-check, from a minute's drive.

    python -m tools.docs.make_page_pictures

Writes: docs/pictures/page_*.png, docs/pictures/page_*.svg

All are of the world `loop`, seed 0. Pages are drawn by Chromium (Debian: apt-get install chromium).
"""

from __future__ import annotations

import argparse
import base64
import io
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console
from rich.text import Text

import testbed.library as tb
from eval.files.run_reader import read_run
from eval.report import plots
from slam import FilterConfig, GMapping
from testbed.library.notebook import html_of
from tools.docs.make_pictures import PICTURES

WORLD = "loop"
SECONDS = 60
START = "3,1.1,0"
"""Where the tour of the world begins."""
LEFT_OUT = 20
"""Of the times of the updates: the first ones load the kernels."""
PUSHED_S = 6
"""By how many seconds of driving the robot is carried on for the picture of the self-check."""
COLOURS = 256
"""Of a picture of a page; with 64 two colours of a legend became one."""


def main() -> None:
    """Make all pictures."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        said(f"simulate {WORLD} --route fixed --duration {SECONDS} --out data", folder)
        dataset = f"data/{WORLD}-0000"
        draw_terminal(f"slam {dataset} --particles 10 --out run", folder, "terminal")
        draw_terminal(f"inspect {dataset}", folder, "inspect")
        draw_stages(folder / "run")
        said(f"slam {dataset} --map {dataset}/truth_map.yaml --start {START} --out localized", folder)
        said("view localized --time 12 --save localization.png", folder)
        save_small(folder / "localization.png", "localization")
        said(f"perturb {dataset} pushed --push {PUSHED_S}", folder)
        said("slam pushed --particles 10 --out lost", folder)
        draw_self_check(folder / "lost")
        draw_page((folder / "run" / "report.html").read_text(encoding="utf-8"), folder, "report", height=1500)
    draw_objects()


def said(command: str, folder: Path) -> str:
    """The results that a command prints in a folder, whatever it thinks of them; not its progress."""
    program = Path(sys.executable).with_name("testbed")
    done = subprocess.run(
        [program, *command.split()],
        cwd=folder,
        text=True,
        check=False,
        capture_output=True,
    )
    if done.returncode not in (0, 1):
        raise RuntimeError(f"testbed {command}: {done.stderr}")
    return done.stdout


def draw_terminal(command: str, folder: Path, name: str) -> None:
    """Draw a command and what it prints as a terminal shows it."""
    lines = [line.rstrip() for line in said(command, folder).replace(f"{folder}/", "").splitlines()]
    console = Console(record=True, width=max(map(len, lines)) + 1, file=io.StringIO())
    console.print(Text("\n".join([f"$ testbed {command}", *lines])))
    svg = console.export_svg(title="")
    (PICTURES / f"page_{name}.svg").write_text(
        re.sub(r"@font-face \{.*?\}", "", svg, flags=re.DOTALL), encoding="utf-8"
    )


def draw_stages(run: Path) -> None:
    """Draw which stage of the filter takes how long, at each update."""
    steps = read_run(run).steps
    assert steps is not None
    on = np.flatnonzero(steps["updated"])[LEFT_OUT:]
    names = [name for name in ("match_s", "map_s", "resample_s", "other_s") if name in steps]
    parts = {name.removesuffix("_s"): 1e3 * steps[name][on] for name in names}
    save_uri(plots.stacked_over_time(steps["stamp"][on] - steps["stamp"][0], parts, "time per update [ms]"), "stages")


def draw_self_check(run: Path) -> None:
    """Draw the error, and what the filter said of itself at that time."""
    steps = read_run(run).steps
    assert steps is not None
    on = steps["updated"].astype(bool)
    time, error, verdict = (steps[name][on] for name in ("stamp", "error_m", "self_check"))
    time = time - steps["stamp"][0]
    figure = Figure(figsize=(7.6, 2.6), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(time, error, color="black", label="position error")
    for code, (word, colour) in enumerate((("doubtful", "tab:orange"), ("lost", "tab:red")), start=1):
        said_so = verdict == code  # as docs/run-directory.md states
        axes.fill_between(
            time, 0.0, np.nanmax(error), where=said_so, color=colour, alpha=0.35, lw=0, label=f"says {word}"
        )
    axes.set(xlabel="time [s]", ylabel="error [m]")
    axes.legend(loc="upper left")
    save_uri(plots.svg_uri(figure), "self_check")


def draw_objects() -> None:
    """Draw what a notebook shows, the filter after a loop of one's own, and a scan with and without its errors."""
    drive = tb.simulate(WORLD, duration=SECONDS)
    mapper = GMapping(FilterConfig(particles=10), seed=0)
    frames = [frame for frame in drive.frames if frame.scan is not None]
    for frame in frames:
        mapper.process(frame.odometry, frame.scan)
    save_uri(re.findall(r'src="(data:[^"]*)"', str(html_of(mapper)))[0], "filter")
    draw_scan()
    shown = [str(html_of(frames[0].scan)), tb.run("scan-matching", drive)._repr_html_()]
    with tempfile.TemporaryDirectory() as folder:
        draw_page("".join(shown), Path(folder), "notebook", height=1250)


def draw_scan() -> None:
    """Draw the first scan of two lidars at one place."""
    figure = Figure(figsize=(7.6, 3.6), layout="constrained")
    for number, (lidar, title) in enumerate(
        (("lds01", "LDS-01: 360 beams, 3.5 m"), ("utm30lx", "UTM-30LX: 1081 beams, 30 m"))
    ):
        drive = tb.simulate("office", duration=1, settings={"lidar": lidar})
        scan = next(frame.scan for frame in drive.frames if frame.scan is not None)
        angles, ranges = scan.angles[scan.hit] + scan.mount[2], scan.ranges[scan.hit]
        axes = figure.add_subplot(1, 2, number + 1)
        axes.plot(scan.mount[0] + ranges * np.cos(angles), scan.mount[1] + ranges * np.sin(angles), ".", ms=2.0)
        axes.plot(0.0, 0.0, ">", color="black")
        axes.set(aspect="equal", title=title, xlabel="x, forward [m]", ylabel="y, left [m]")
    figure.savefig(PICTURES / "page_scan.png", dpi=110)


def draw_page(page: str, folder: Path, name: str, *, height: int) -> None:
    """Draw the upper part of a page, so high [px], as a browser shows it."""
    browser = shutil.which("chromium")
    if browser is None:
        raise RuntimeError("pages are drawn by Chromium, which is not installed")
    (folder / "page.html").write_text(f'<meta charset="utf-8">{page}', encoding="utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    command += [f"--window-size=900,{height}", f"--screenshot={folder / 'page.png'}", str(folder / "page.html")]
    subprocess.run(command, check=True, capture_output=True)
    save_small(folder / "page.png", name)


def save_small(png: Path, name: str) -> None:
    """Keep a picture with few colours."""
    Image.open(png).convert("RGB").quantize(COLOURS).save(PICTURES / f"page_{name}.png", optimize=True)


def save_uri(address: str, name: str) -> None:
    """Keep a drawing that is given as a `data:` address."""
    (PICTURES / f"page_{name}.svg").write_bytes(base64.b64decode(address.partition(",")[2]))


if __name__ == "__main__":
    main()
