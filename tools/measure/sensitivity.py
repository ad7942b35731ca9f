# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Halve and double settings of the filter, one at a time, and see which of them decides whether a log is lost.

    python -m tools.measure.sensitivity RUNS [--places intel-1500,aces] [--settings gate.distance,match.hit_sigma]
    python -m tools.measure.sensitivity RUNS --places intel,fr079,aces,office,maze --particles 30 --seeds 3

Writes: docs/accuracy.md (sensitivity)

Places are those of `measure_variants`: logs, parts of them, and worlds. Without `--settings` every number of motion
model, map, matcher, proposal, update gates and resampling is varied that is not 0. Each run is kept as a file of RUNS
and computed only once. The error is the worst over the seeds, of the filter's own path and after the final pass.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path

from eval.files.atomic_write import atomic_write
from slam.config import FilterConfig
from testbed.estimation.estimation import Estimation
from testbed.seeds import RunSeeds
from tools.measure.measure_variants import LOGS, recording
from tools.pages import DOCS, write_table

PARTS = ("motion", "map", "match", "proposal", "gate", "resample")
"""Parts of the filter's settings whose numbers are varied."""
FACTORS = (0.5, 2.0)


def names_of_settings() -> list[str]:
    """Names such as `match.hit_sigma` of all numbers that can be halved and doubled."""
    default = FilterConfig()
    numbers = [
        (part, f.name, getattr(getattr(default, part), f.name))
        for part in PARTS
        for f in fields(getattr(default, part))
    ]
    return [f"{part}.{name}" for part, name, value in numbers if isinstance(value, int | float) and value > 0]


def changed(setting: str, factor: float, particles: int) -> FilterConfig:
    """The default settings with one of them multiplied; whole numbers stay whole, and are at least 1.

    Raises:
        ValueError: the filter does not accept the value.
    """
    config = FilterConfig(particles=particles)
    if factor == 1.0:
        return config
    part, name = setting.split(".")
    value = getattr(getattr(config, part), name)
    new = max(round(value * factor), 1) if isinstance(value, int) else value * factor
    return replace(config, **{part: replace(getattr(config, part), **{name: new})})


def errors_of(place: str, config: FilterConfig, seed: int) -> tuple[float, float]:
    """Error of position [m] of the filter's own path and after the final pass."""
    data = recording(place, seed if place not in LOGS else 0)
    estimation = Estimation(config, RunSeeds.from_seed(seed).filter)
    for frame in data.frames:
        estimation.process(frame)
    own = estimation.filtered()
    return data.error(own)[0], data.error(estimation.refined(own))[0]


def kept(runs: Path, place: str, setting: str, factor: float, particles: int, seed: int) -> tuple[float, float] | None:
    """The errors of one run, which is computed if there is no file of it; None where the filter refuses the value."""
    try:
        config = changed(setting, factor, particles)
    except ValueError:
        return None
    name = "default" if factor == 1.0 else f"{setting}-{factor:g}"
    file = runs / f"{place}-{name}-{particles}-{seed}.json"
    if not file.exists():
        own, final = errors_of(place, config, seed)
        with atomic_write(file) as temporary:
            temporary.write_text(json.dumps([own, final]), encoding="utf-8")
        print(f"{file.stem}: {own:.4f} m, {final:.4f} m", flush=True)
    own, final = json.loads(file.read_text(encoding="utf-8"))
    return own, final


def rows(
    runs: Path, places: Sequence[str], settings: Sequence[str], particles: int, seeds: Sequence[int]
) -> Iterator[str]:
    """The lines of the table, as Markdown."""
    yield "| setting | value | " + " | ".join(f"{place}, filter | {place}, final pass" for place in places) + " |"
    yield "|---" * (2 + 2 * len(places)) + "|"
    for setting, factor in [("", 1.0), *((setting, factor) for setting in settings for factor in FACTORS)]:
        cells = []
        for place in places:
            found = [kept(runs, place, setting, factor, particles, seed) for seed in seeds]
            errors = [both for both in found if both is not None]
            cells += [f"{100.0 * max(column):.1f} cm" for column in zip(*errors, strict=True)] or ["refused"] * 2
        name = f"`{setting}`" if setting else "defaults"
        yield f"| {name} | {'' if factor == 1.0 else f'x {factor:g}'} | " + " | ".join(cells) + " |"


def main() -> None:
    """Compute the missing runs, then write the table into its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, metavar="RUNS", help="directory of the runs")
    parser.add_argument("--places", default="intel-1500,aces")
    parser.add_argument("--settings", help="names such as match.hit_sigma; default: all")
    parser.add_argument("--particles", type=int, default=10)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    options.runs.mkdir(parents=True, exist_ok=True)
    settings = options.settings.split(",") if options.settings else names_of_settings()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    lines = rows(options.runs, options.places.split(","), settings, options.particles, seeds)
    write_table(DOCS / "accuracy.md", "sensitivity", "\n".join(lines))


if __name__ == "__main__":
    main()
