# SPDX-License-Identifier: MIT
"""Provenance of a result, as `config.toml` holds it: command, settings, inputs, versions, machine."""

from __future__ import annotations

import hashlib
import os
import platform
import shlex
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from testbed.toml import dump_toml

PACKAGES = ("slam-testbed", "numpy", "numba", "scipy", "shapely", "pybullet", "rerun-sdk")
PYBULLET_FORK = "pybullet-arm64"
"""The package that is the module pybullet where PyBullet itself has no wheel."""
MISSING = "not installed"
"""Version of a package that is not there."""


def config_document(settings: Mapping[str, Any], inputs: Iterable[Path] = ()) -> dict[str, Any]:
    """Return the content of `config.toml`: `[settings]`, with which `--config` repeats the run, and the provenance.

    inputs: files that were read; their SHA-256 shows whether they have changed
    """
    read = {str(path): _sha256(path) for path in inputs}
    return {
        "command": shlex.join(["testbed", *sys.argv[1:]]),
        "settings": dict(settings),
        **({"inputs": read} if read else {}),
        "versions": versions(),
        "machine": {"system": platform.platform(), "processor": _processor(), "cores": os.cpu_count()},
    }


def settings_as_markdown(document: Mapping[str, Any]) -> str:
    """Return the command and the settings of a `config_document` as Markdown for a viewer."""
    return f"`{document['command']}`\n\n```toml\n{dump_toml(document['settings'])}```\n"


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that results depend on, by name."""
    found = {"python": platform.python_version(), **{package: _version(package) for package in PACKAGES}}
    if found["pybullet"] == MISSING and (fork := _version(PYBULLET_FORK)) != MISSING:
        found["pybullet"] = f"{fork} ({PYBULLET_FORK})"
    return found


@cache
def _version(package: str) -> str:
    """Return the version of an installed package; reading it takes milliseconds."""
    try:
        return version(package)
    except PackageNotFoundError:
        return MISSING


def _processor() -> str:
    """Return the name of the processor; `platform` knows only its architecture on Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
