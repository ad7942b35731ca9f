# SPDX-License-Identifier: MIT
"""Help pages that fit a screen or two: settings that few touch are shown by `--help-all` only."""

from __future__ import annotations

from cyclopts.help import DefaultFormatter, HelpEntry, HelpPanel, InlineText
from rich.console import Console, ConsoleOptions
from rich.markdown import Markdown

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
SELDOM_USED = frozenset(
    {
        # recorded drives and crowded worlds
        "--clutter", "--commands", "--off-wall",
        # logs that are wrong about themselves
        "--mount-correction", "--slice",
        # programs as systems
        "--system-command", "--system-format", "--system-memory-limit", "--system-set", "--system-time-limit",
        # clusters
        "--memory-limit", "--scheduler", "--shard", "--time-limit",
        # datasets that are published
        "--author", "--compress", "--title", "--url",
        # sweeps
        "--baseline", "--check", "--drawn-seeds", "--give-up", "--update-baseline",
        # views elsewhere
        "--connect", "--serve",
    }
)  # fmt: skip
"""Options without a group that the short pages leave out."""
USUAL_OF_COMMAND = {"view": frozenset({"--serve"}), "datasets": frozenset({"--author", "--title", "--url"})}
"""Those of them that a command's short page shows all the same: a machine without a display has no other way, and an
index is made again to publish the data."""
SHORT_NAMES = {"--driver.kind": "--driver"}
"""What users type instead of the name that the settings have."""


FINAL_PASS = "--filter.refine.motion."
"""These settings have the texts of `--filter.motion`, of which their class is a kind."""


class AllOptions(DefaultFormatter):
    """Shows every option: by its short name where it has one, and without the default of a switch or an empty list."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Draw a panel."""
        super().__call__(console, options, panel.copy(entries=[_plain(entry) for entry in panel.entries]))


class UsualOptions(AllOptions):
    """Shows of each panel what is usually set, and how many further settings there are."""

    def __init__(self, command: str = "") -> None:
        """Of the page of this command."""
        super().__init__()
        self._seldom_used = SELDOM_USED - USUAL_OF_COMMAND.get(command, frozenset())

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Draw a panel without the settings that few touch."""
        usual = [entry for entry in panel.entries if self._is_usual(entry)]
        hidden = len(panel.entries) - len(usual)
        if hidden:
            number = f"{hidden} more" if usual else f"the {hidden}"
            words = f"{number} setting{'' if hidden == 1 else 's'} of this kind"
            usual.append(HelpEntry(positive_names=(ALL,), description=f"Shows {words}."))
        super().__call__(console, options, panel.copy(entries=usual))

    def _is_usual(self, entry: HelpEntry) -> bool:
        names = entry.positive_names
        if not names or not USUAL_SETTINGS.isdisjoint(names):
            return True
        return self._seldom_used.isdisjoint(names) and not all("." in name for name in names)


def _plain(entry: HelpEntry) -> HelpEntry:
    names = tuple(SHORT_NAMES.get(name, name) for name in entry.positive_names)
    if any(name.startswith(FINAL_PASS) for name in names):
        entry = entry.copy(description=_of_the_final_pass(entry.description))
    return entry.copy(positive_names=names, default=None if entry.default in ("False", "()") else entry.default)


def _of_the_final_pass(description: object) -> object:
    """The same text with the words `Final pass:` in front."""
    if not isinstance(description, InlineText) or not isinstance(description.primary_renderable, Markdown):
        return description
    text = description.primary_renderable.markup
    return InlineText.from_format(f"Final pass: {text[:1].lower()}{text[1:]}", "markdown")
