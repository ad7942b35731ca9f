# SPDX-License-Identifier: MIT
"""The commands of `testbed` and their exit statuses; a command is imported when it is called, so that help is fast."""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Sequence
from importlib.metadata import version

from cyclopts import App, CycloptsError, MissingArgumentError, Parameter, UnusedCliTokensError

from testbed.cli.shared.at_work import AT_WORK
from testbed.cli.shared.config_file import apply_config_file
from testbed.cli.shared.help_pages import ALL, AllOptions, UsualOptions
from testbed.cli.shared.help_texts import HELP
from testbed.cli.shared.status import USAGE_ERROR

MAX_QUOTED, MAX_MESSAGE = 200, 2000
"""Largest numbers of characters of a word, which is no path, and of a whole complaint."""

app = App(
    name="testbed",
    help="A SLAM testbed: simulate a robot or read a log, map it with a particle filter, score the result.",
    help_epilogue="Begin with `testbed run office`, and open the report whose path it prints. `testbed view --demo` "
    "shows a finished run at once. `testbed COMMAND --help` has examples to paste; words in CAPITALS stand for names "
    "of your own.",
    version=lambda: version("slam-testbed"),
    config=apply_config_file,
    default_parameter=Parameter(negative_iterable=()),
    help_format="markdown",
    help_formatter=UsualOptions(),
    suppress_keyboard_interrupt=False,
    result_action="return_value",
)
_ARGUMENTS = {"sweep": "[SPEC]", "view": "[PATHS]"}
"""Arguments that may only stand without a name, as the line of usage calls them."""
for _name, _help in HELP.items():
    if _name in ("datasets", "worlds", "presets", "systems"):
        app.command(f"testbed.cli.{_name}:app", name=_name, help=_help)
    else:
        _usage = f"Usage: testbed {_name} [OPTIONS] {_ARGUMENTS[_name]}" if _name in _ARGUMENTS else None
        app.command(f"testbed.cli.{_name}:{_name}", name=_name, help=_help, help_epilogue="", usage=_usage)


def run_app(arguments: Sequence[str] | None) -> int:
    """Run a command and return its exit status; errors of usage or input are one line on stderr."""
    try:
        status = app(_with_whole_help(_with_present_names(arguments)), exit_on_error=False, print_error=False)
    except BrokenPipeError:  # the reader of our output, such as `head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (CycloptsError, ValueError, OSError) as error:
        if os.environ.get("TESTBED_DEBUG"):
            raise
        _complain(_one_line(error))
        return USAGE_ERROR
    return status or 0  # commands that measure nothing return None


def _with_whole_help(tokens: list[str]) -> list[str]:
    """The arguments with `--help` for `--help-all`, which is prepared."""
    command = next((token for token in tokens if not token.startswith("-")), "")
    app.help_formatter = AllOptions() if ALL in tokens else UsualOptions(command)
    return ["--help" if token == ALL else token for token in tokens]


def _with_present_names(arguments: Sequence[str] | None) -> list[str]:
    """The arguments, settings of the last release under their present names."""
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    for k, token in enumerate(tokens):
        if token.startswith(("--filter.", "--localization.")):
            from slam.config.renamed import present_name  # here, for `--help` to answer at once

            option, equals, value = token[2:].partition("=")
            tokens[k] = f"--{present_name(option.replace('-', '_'))}{equals}{value}"
    return tokens


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        what = "no space left on the disk" if error.errno == errno.ENOSPC else error.strerror.lower()
        return f"{error.filename}: {what}" if error.filename else what
    if isinstance(error, UnusedCliTokensError):
        words = ", ".join(error.unused_tokens or ())
        return f"unexpected {words}; several worlds or values are separated by commas, without spaces: office,lab"
    if isinstance(error, MissingArgumentError) and error.command_chain and error.keyword is None:
        return _what_is_missing(error)
    return " ".join(_without_long_words(str(error)).split())


def _without_long_words(text: str) -> str:
    """A message without the most of what it quotes, which may be as long as a file; paths are left as they are."""
    short = (word if len(word) <= MAX_QUOTED or "/" in word else f"{word[:MAX_QUOTED]} …" for word in text.split(" "))
    text = " ".join(short)
    return text if len(text) <= MAX_MESSAGE else f"{text[: MAX_MESSAGE - MAX_QUOTED]} … {text[-MAX_QUOTED:]}"


def _what_is_missing(error: MissingArgumentError) -> str:
    """Name the missing argument as a user does, with the first example of the help that has it."""
    assert error.argument is not None
    command, name = " ".join(error.command_chain or ()), error.argument.name
    if error.argument.field_info.is_positional:
        name = name.lstrip("-").upper()
    examples = re.findall(rf"^testbed {command} .*$", HELP[command.split(maxsplit=1)[0]], flags=re.MULTILINE)
    example = f", as in: {examples[0]}" if examples else f"; testbed {command} --help says more"
    return f"{command}: expected {name}{example}"


def _complain(text: str) -> None:
    sys.stderr.write(f"testbed: {text}\n")
    AT_WORK.heard()
