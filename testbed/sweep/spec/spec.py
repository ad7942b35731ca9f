# SPDX-License-Identifier: MIT
"""The specification of a sweep: worlds or logs x seeds x lines x particle counts, from TOML or flags."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator

from eval.sweep.look_schedule import level_of, looks_for
from eval.sweep.margin import parse_margin
from eval.sweep.statistics import LEVEL
from testbed.sweep.errors import SweepError
from testbed.sweep.spec.seeds import MAX_SEED, MAX_SEEDS, parse_seeds, seeds_of_count
from testbed.sweep.spec.settings import FILES, Value, checked
from testbed.systems.entrant import name_of
from testbed.systems.finding import file_of
from worlds import expand_names, family, label
from worlds.regular_file import refuse_devices

MAX_FILE_BYTES = 1_000_000
"""Largest file of a specification [bytes]."""
MAX_CELLS = 100_000
"""Largest number of cells in a sweep."""
_PRESETS = resources.files("testbed") / "sweep" / "presets"
BASELINE = Path(str(_PRESETS / "gate-baseline.json"))
"""Baseline of the preset `gate` (`eval.sweep.regression_check`)."""

ESTIMATES = {"online": "_online", "filter": "_filter", "refined": ""}
"""The three estimates of a run by their words for `measure`, and the suffix of their keys in `metrics.json`."""
FINAL = ("trajectory", "map", "relations", "outcome")
"""Heads of keys that describe the final estimate, which the final pass refines."""
MEASURES = {f"{head}{suffix}" for head in ("trajectory", "relations", "map") for suffix in ESTIMATES.values()} | {
    "filter"
}
"""Heads of keys by which accuracy can be measured."""
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Seed = Annotated[int, Field(strict=True, ge=0, le=MAX_SEED)]


class LogSource(BaseModel):
    """A recorded log and the reference for scoring; paths are relative to the file of the specification."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    log: str
    """A log as `testbed slam` reads it."""
    relations: str | None = None
    """Hand-checked relations between poses."""
    truth: str | None = None
    """True trajectory, TUM."""
    laser_offset: float | None = None
    """x of the laser in the robot's frame [m], if the log does not state it."""
    range_max: float | None = None
    """Readings of this range or more are treated as no return [m]."""

    @property
    def name(self) -> str:
        """Short name: the file name up to its first dot."""
        return Path(self.log).name.split(".")[0]


@dataclass(frozen=True)
class Line:
    """One line of every plot: a combination of settings whose accuracy is followed over the particle count."""

    name: str
    settings: Mapping[str, Value]


class SweepSpec(BaseModel):
    """Everything that decides the results of a sweep; how it is executed is not part of it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    title: str = ""
    """Title of the report."""
    worlds: tuple[str, ...] = ()
    """Names from the catalogue, TOML files, ROS maps, `generated:KIND:SEED`; `generated:KIND*N` stands for N of these.
    With the setting `route` = "fixed" all seeds drive the same tour with other noise, with "random" other routes."""
    logs: tuple[LogSource, ...] = ()
    """Recorded logs instead of worlds; the seed is then that of the filter only."""
    seeds: Annotated[tuple[Seed, ...], Field(max_length=MAX_SEEDS)] = tuple(range(10))
    """Also a single number, which is how many, from 0 on, or a text such as "0:10"."""
    drawn_seeds: Annotated[int, Field(strict=True, ge=1, le=MAX_SEEDS)] | None = None
    """With how many of the seeds each drawn world is driven (`drawn_worlds`), since there each world counts once; the
    default is all of them."""
    particles: tuple[Count, ...] = (1, 2, 5, 10, 20, 50, 100)
    """Particle counts."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Settings of all runs, by dotted name or nested tables."""
    variants: dict[str, dict[str, Any]] = Field(default_factory=dict)
    """Named groups of settings; each is one line of the plots."""
    axes: dict[str, tuple[Any, ...]] = Field(default_factory=dict)
    """Settings with several values; every combination is a line, for each of the variants."""
    baseline: str = ""
    """Name of the line that the others are compared with; default: the first."""
    measure: str = ""
    """Key of `metrics.json` by which accuracy is measured, smaller is better; or one of the words `online`, `filter`,
    `refined`, which stand for the main measure of that estimate. Default: `filter`, which shows what the particles
    do (`trajectory_filter.ate_rmse_m` for worlds, `relations_filter.trans_mean_m` for logs); `refined` where SLAM
    systems are compared."""
    margin: str = ""
    """How much larger an error may be than that of the largest count before it matters: a share such as "10%", a length
    such as "2mm", or both, of which the larger counts. Default: "10%,5mm"."""
    until: Literal["", "decided", "smallest"] = ""
    """The seeds are an upper bound, and worlds whose answer is known get no more (`testbed.sweep.looks`). decided: they
    end with the first answer; smallest: when it is also known whether fewer particles are enough."""

    give_up: tuple[str, ...] = ()
    """Worlds or logs that get no more seeds with `until`, by their names in the tables."""

    @field_validator("seeds", mode="before")
    @classmethod
    def _list_of_seeds(cls, value: Any) -> Any:
        if isinstance(value, str):
            return parse_seeds(value)
        if isinstance(value, int) and not isinstance(value, bool):
            return seeds_of_count(value)
        if not isinstance(value, list | tuple):
            raise ValueError(f"expected a number of seeds such as 10, or a list such as [0, 1, 2], got {value!r}")
        return value

    @field_validator("margin")
    @classmethod
    def _readable_margin(cls, value: str) -> str:
        parse_margin(value)
        return value

    @field_validator("worlds", mode="before")
    @classmethod
    def _list_of_worlds(cls, value: Any) -> Any:
        is_text = isinstance(value, str)
        names = [value] if is_text else value
        if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names) or not names:
            return value
        return tuple(expand_names(value) if is_text else [single for name in names for single in expand_names(name)])

    @field_validator("worlds", "logs", "seeds", "particles", mode="after")
    @classmethod
    def _no_doubles(cls, values: tuple[Any, ...], info: ValidationInfo) -> tuple[Any, ...]:
        if info.field_name in ("seeds", "particles"):
            if not values:
                raise ValueError("is empty, expected at least one")
            values = tuple(sorted(values))
        if len(set(values)) < len(values):
            raise ValueError("names the same thing twice")
        return values

    @field_validator("settings", mode="before")
    @classmethod
    def _flat_settings(cls, value: Any) -> Any:
        return _flat(value) if isinstance(value, dict) else value

    @field_validator("variants", mode="before")
    @classmethod
    def _flat_variants(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {name: _flat(table) if isinstance(table, dict) else table for name, table in value.items()}

    @field_validator("axes", mode="before")
    @classmethod
    def _flat_axes(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        return {name: tuple(v) if isinstance(v, list) else v for name, v in _flat(value).items()}

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if bool(self.worlds) == bool(self.logs):
            raise ValueError("expected either worlds or logs")
        head, dot, rest = self.key_measure.partition(".")
        if head not in MEASURES or not (dot and rest):
            raise ValueError(
                f"measure {self.measure!r}: expected one of {', '.join(ESTIMATES)}, or a key of metrics.json such as "
                "trajectory_online.ate_rmse_m or map_filter.wall_thickness_m"
            )
        names = [line.name for line in self.lines()]
        if self.baseline and self.baseline not in names:
            raise ValueError(f"baseline {self.baseline!r}: no such line, expected one of {', '.join(names)}")
        self._check_give_up()
        if self.drawn_seeds is not None and self.until:
            raise ValueError("drawn_seeds: expected without --until, which gives each world as many seeds as it needs")
        if self.names_systems and self.until:
            raise ValueError("until: asks how many particles are enough, expected it without SLAM systems")
        if self.names_systems and len(self.particles) > 1:
            raise ValueError(
                f"particles {', '.join(map(str, self.particles))}: expected one count, since systems are compared"
            )
        if self.size > MAX_CELLS:
            raise ValueError(f"{self.size} jobs, expected at most {MAX_CELLS}")
        return self

    def _check_give_up(self) -> None:
        """Raise ValueError if worlds that get no more seeds are named wrongly, or without `until`."""
        places = [*map(label, self.worlds), *(log.name for log in self.logs)]
        if self.give_up and not self.until:
            raise ValueError("give_up: expected with --until only, which adds seeds")
        if unknown := [name for name in self.give_up if name not in places]:
            raise ValueError(f"give_up: {unknown[0]!r}: no such world or log here, expected one of {', '.join(places)}")

    @property
    def size(self) -> int:
        """Number of cells."""
        places, drawn, all_seeds = len(self.worlds) + len(self.logs), len(self.drawn_worlds), len(self.seeds)
        few = len(self.seeds[: self.drawn_seeds])
        return ((places - drawn) * all_seeds + drawn * few) * len(self.lines()) * len(self.particles)

    @property
    def drawn_worlds(self) -> frozenset[str]:
        """Generated worlds of kinds of which there are several: samples, so that the answer is about the kind."""
        kinds = {world: family(world) for world in self.worlds}
        numbers = Counter(kinds.values())
        return frozenset(world for world, kind in kinds.items() if kind is not None and numbers[kind] > 1)

    @property
    def key_measure(self) -> str:
        """Key of the measure of accuracy in `metrics.json`."""
        word = self.measure or ("refined" if self.names_systems else "filter")
        if word not in ESTIMATES:
            return word
        has_relations = any(log.relations for log in self.logs) or not any(log.truth for log in self.logs)
        by_relations = bool(self.logs) and has_relations
        head, rest = ("relations", "trans_mean_m") if by_relations else ("trajectory", "ate_rmse_m")
        return f"{head}{ESTIMATES[word]}.{rest}"

    @property
    def looks(self) -> tuple[int, ...]:
        """After how many seeds the results are looked at, from the fewest that can decide on; last: all seeds."""
        return looks_for(len(self.seeds)) if self.until else (len(self.seeds),)

    @property
    def level(self) -> float:
        """Confidence level of the intervals at each look, so that all looks together keep `LEVEL`."""
        return level_of(self.looks) if self.until else LEVEL

    def refines(self, line: Line, particles: int) -> bool:
        """Whether runs of a line with so many particles end with the final pass.

        Where neither the setting `refine` says so nor the measure needs it, the smallest and the largest count do: the
        final pass takes longer than a filter of few particles, and the question is about the particles.
        """
        if "refine" in line.settings:
            return bool(line.settings["refine"])
        head = self.key_measure.partition(".")[0]
        return head in FINAL or particles in (self.particles[0], self.particles[-1])

    @property
    def names_systems(self) -> bool:
        """Whether the specification names SLAM systems; they are compared by their final estimates."""
        return any("system" in table for table in (self.settings, self.axes, *self.variants.values()))

    @property
    def names_route(self) -> bool:
        """Whether the specification says which routes are driven."""
        return any("route" in table for table in (self.settings, self.axes, *self.variants.values()))

    def lines(self) -> list[Line]:
        """All combinations of variants and values of axes; raises SweepError for wrong or repeated settings."""
        recorded = bool(self.logs)
        for name, values in self.axes.items():
            if not values:
                raise SweepError(f"axis {name}: is empty, expected at least one value")
        shared = {name: checked(name, value, recorded=recorded) for name, value in self.settings.items()}
        lines = []
        for variant, table in (self.variants or {"": {}}).items():
            own = {name: checked(name, value, recorded=recorded) for name, value in table.items()}
            for values in product(*self.axes.values()):
                chosen = {n: checked(n, v, recorded=recorded) for n, v in zip(self.axes, values, strict=True)}
                for name in sorted((shared.keys() & own) | (shared.keys() & chosen) | (own.keys() & chosen)):
                    raise SweepError(f"{name}: is set twice, in two of settings, variants and axes")
                words = [variant] * bool(variant) + [_label(n, v) for n, v in chosen.items()]
                lines.append(Line(", ".join(words) or "default", shared | own | chosen))
        for line in lines:
            if sum(other.settings == line.settings or other.name == line.name for other in lines) > 1:
                raise SweepError(f"line {line.name!r}: occurs twice, expected different names and settings")
        return lines

    def document(self) -> dict[str, Any]:
        """The specification as plain data for TOML, without values that equal their default."""
        return self.model_dump(mode="json", exclude_defaults=True, exclude_none=True) | {
            "seeds": list(self.seeds),
            "particles": list(self.particles),
        }

    def located(self, folder: Path) -> SweepSpec:
        """The specification with absolute paths of all files; relative paths start at `folder`."""

        def place(name: Any) -> Any:
            if isinstance(name, str) and (file := file_of(name)) is not None and (folder / file).exists():
                return f"{(folder / file).resolve()}:{name.rpartition(':')[2]}"
            is_file = isinstance(name, str) and Path(name).suffix and (folder / name).exists()
            return str((folder / name).resolve()) if is_file else name

        def settings(table: Mapping[str, Any]) -> dict[str, Any]:
            return {k: place(v) if k in FILES else v for k, v in table.items()}

        files = ("log", "relations", "truth")
        return SweepSpec.model_validate(
            self.model_dump()
            | {
                "worlds": tuple(map(place, self.worlds)),
                "logs": tuple(log.model_copy(update={n: place(getattr(log, n)) for n in files}) for log in self.logs),
                "settings": settings(self.settings),
                "variants": {name: settings(table) for name, table in self.variants.items()},
                "axes": {k: tuple(map(place, v)) if k in FILES else v for k, v in self.axes.items()},
            }
        )


def presets() -> list[str]:
    """Names of the specifications that come with the package, sorted."""
    return sorted(entry.name.removesuffix(".toml") for entry in _PRESETS.iterdir() if entry.name.endswith(".toml"))


def read_preset(name: str) -> dict[str, Any]:
    """Document of a specification that comes with the package; raises SweepError for an unknown name."""
    if name not in presets():
        raise SweepError(f"unknown preset {name!r}, expected one of {', '.join(presets())}")
    return tomllib.loads((_PRESETS / f"{name}.toml").read_text(encoding="utf-8"))


def read_document(path: Path) -> dict[str, Any]:
    """Read a specification's document from a TOML file; raises SweepError if that fails."""
    if path.is_file() and path.stat().st_size > MAX_FILE_BYTES:
        raise SweepError(f"{path}: larger than {MAX_FILE_BYTES} bytes, expected the specification of a sweep")
    try:
        refuse_devices(path)
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SweepError(f"{path}: {str(error.strerror).lower()}, expected the specification of a sweep") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SweepError(f"{path}: {error}, expected TOML") from None


def parse_spec(document: Mapping[str, Any], source: str, folder: Path) -> SweepSpec:
    """Check a document and return the specification. `source` names it in messages; relative paths start at `folder`.

    Raises SweepError with the key and what was expected.
    """
    try:
        return SweepSpec.model_validate(dict(document)).located(folder)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in problem["loc"])
        what = problem["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
        if problem["type"] == "extra_forbidden":
            what = f"unknown key, expected one of {', '.join(SweepSpec.model_fields)}"
        raise SweepError(": ".join(filter(None, (source, key, what)))) from None


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Leaves of nested tables by dotted name. In TOML `filter.match.hit_sigma = 0.1` is nested unless it is quoted."""
    leaves: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            leaves |= _flat(value, f"{prefix}{key}.")
        else:
            leaves[f"{prefix}{key}"] = value
    return leaves


def _label(name: str, value: Value) -> str:
    """Label of an axis value: a word stands alone, a number follows the last part of the setting's name."""
    if name == "system":
        return name_of(str(value)) or "filter"
    if isinstance(value, str):
        return Path(value).stem if name in FILES else value
    return f"{name.rpartition('.')[2]} {str(value).lower() if isinstance(value, bool) else format(value, 'g')}"


def parsed_axes(texts: Iterable[str]) -> dict[str, list[Any]]:
    """Parse `NAME=VALUE,VALUE` from the command line. Values are read as TOML if possible, else as words.

    Raises SweepError for other text.
    """
    axes: dict[str, list[Any]] = {}
    for text in texts:
        name, equals, values = text.partition("=")
        if not equals or not name.strip():
            raise SweepError(f"{text!r}: expected NAME=VALUE,VALUE such as odometry.grade=good,poor")
        if name.strip() in axes:
            raise SweepError(f"{name.strip()}: is given twice")
        axes[name.strip()] = [_parsed(word.strip()) for word in values.split(",") if word.strip()]
    return axes


def _parsed(word: str) -> Any:
    try:
        return tomllib.loads(f"value = {word}")["value"]
    except tomllib.TOMLDecodeError:
        return word
