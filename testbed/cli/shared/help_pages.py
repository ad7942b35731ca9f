# SPDX-License-Identifier: MIT
"""Help pages that fit a screen or two: settings that few touch are shown by `--help-all` only."""

from __future__ import annotations

from cyclopts.help import DefaultFormatter, HelpEntry, HelpPanel
from rich.console import Console, ConsoleOptions

ALL = "--help-all"
"""Shows every setting."""
USUAL_SETTINGS = frozenset(
    {
        "--driver.kind",
        "--odometry.grade",
        "--odometry.slip-distance",
        "--odometry.slip-rate",
    }
)
"""Settings of a group, such as `--filter.match.hit-sigma`, that the short pages show too."""


class UsualOptions(DefaultFormatter):
    """Shows of each panel what is usually set, and how many further settings there are."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Draw a panel without the settings that few touch."""
        usual = [entry for entry in panel.entries if _is_usual(entry)]
        hidden = len(panel.entries) - len(usual)
        if hidden:
            number = f"{hidden} more" if usual else f"the {hidden}"
            usual.append(HelpEntry(positive_names=(ALL,), description=f"Shows {number} settings of this kind."))
        super().__call__(console, options, panel.copy(entries=usual))


def _is_usual(entry: HelpEntry) -> bool:
    names = entry.positive_names
    return not names or not all("." in name for name in names) or not USUAL_SETTINGS.isdisjoint(names)
