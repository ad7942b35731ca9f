# SPDX-License-Identifier: MIT
"""`--config FILE.toml`: settings from a file, such as the `config.toml` of an earlier run, or from a preset;
the command line wins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cyclopts import App, ArgumentCollection
from cyclopts.config import Toml

from slam.config.renamed import with_present_names

MAX_CONFIG_BYTES = 1_000_000
"""Bytes."""


def apply_config_file(app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Fill the arguments that were not given on the command line from the `[settings]` of the file in `--config`.

    Raises ValueError for a file that cannot be read; unknown keys are reported by cyclopts with the nearest names.
    """
    _settle_values_of_groups(arguments)
    option = next((argument for argument in arguments if argument.name == "--config"), None)
    if option is None or not option.tokens:
        return
    from testbed.presets import filter_settings, filters  # here, for `--help` to answer at once

    path = Path(option.tokens[0].value)
    if path.name in filters() and not path.exists():
        path = filter_settings(path.name)
        option.tokens[0] = option.tokens[0].evolve(value=str(path))
    if not path.is_file():
        raise ValueError(
            f"{path}: no such file, expected the settings of a run (config.toml) or a preset: {', '.join(filters())}"
        )
    if path.stat().st_size > MAX_CONFIG_BYTES:
        raise ValueError(f"{path}: larger than {MAX_CONFIG_BYTES} bytes, expected the settings of a run (config.toml)")
    _Settings(path, root_keys=("settings",), must_exist=True, use_commands_as_keys=False)(app, commands, arguments)


class _Settings(Toml):
    """A TOML file in which settings may have their names of the last release."""

    def _load_config(self, path: Path) -> dict[str, Any]:
        document = super()._load_config(path)
        return {name: with_present_names(part) if name == "settings" else part for name, part in document.items()}


def _settle_values_of_groups(arguments: ArgumentCollection) -> None:
    """Accept `--driver recorded` for `--driver.kind recorded`, because the kind decides what that group means.

    Other groups take no value of their own: only `--odometry.grade good` is clear.
    """
    for argument in arguments:
        own = [token for token in argument.tokens if token.keyword == argument.name and not token.keys]
        kind = next((child for child in argument.children if child.name == f"{argument.name}.kind"), None)
        if own and kind is not None:
            for token in own:
                argument.tokens.remove(token)
                kind.append(token.evolve(keyword=kind.name))
        elif own and argument.children:
            names = ", ".join(child.name for child in argument.children)
            raise ValueError(f"{argument.name} {own[0].value}: takes no value of its own, expected one of {names}")
