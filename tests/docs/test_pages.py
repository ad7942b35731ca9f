# SPDX-License-Identifier: MIT
"""What the pages name must exist: pages and headings behind links, code, files, commands, options, make targets."""

import ast
import importlib
import re
import shlex
from collections.abc import Iterator
from functools import cache
from itertools import takewhile
from pathlib import Path

import pytest

from eval.estimates import SCORED
from testbed.cli.shared.app import app
from testbed.cli.shared.help_texts import HELP

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
INDEX = DOCS / "index.md"
PAGES = sorted([*DOCS.glob("**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
PACKAGES = ("slam", "eval", "worlds", "testbed")
ROOMS = (*PACKAGES, "tests", "tools", "docs")
ENVIRONMENTS = {"testbed/Drive-v0", "testbed/Explore-v0"}
PREFIXES = {"MAX_", "MIN_"}
FOREIGN_OPTIONS = {
    "--extra", "--format", "--help", "--help-all", "--hypothesis-profile", "--name-only", "--remap", "--runs",
}  # fmt: skip
"""Options of other programs (git, pip, pytest, ros2) and those that every program has."""
READ_FILES = {"convert", "gather", "inspect", "perturb", "report", "score", "slam", "twin", "view"}
"""Commands whose arguments are files or directories."""
FOREIGN_WORDS = {
    "argmax", "base_link", "choco", "deque", "footprint_radius", "go_to", "map_server", "odom", "pip", "pipx",
    "publish_map", "robot_localization", "ros1", "ros2", "slam_toolbox", "std_msgs", "to_csv",
}  # fmt: skip
"""Words in code spans that belong to other software."""


def page_id(path: Path) -> str:
    return str(path.relative_to(ROOT))


every_page = pytest.mark.parametrize("page", PAGES, ids=page_id)


def prose_of(page: Path) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def spans_of(page: Path) -> list[str]:
    """Code spans of a page."""
    return re.findall(r"(?<!`)`([^`\n]+)`(?!`)", prose_of(page))


def commands_of(page: Path) -> list[str]:
    """Command lines of a page: code spans, indented blocks and fenced shell blocks that start with `testbed`."""
    text = page.read_text(encoding="utf-8")
    lines = [line.strip().removeprefix(".venv/bin/") for line in text.splitlines()]
    found = [re.sub(r"\s+#.*", "", line) for line in lines if re.match(r"testbed [a-z]", line)]
    return found + [span for span in spans_of(page) if re.match(r"testbed [a-z]", span)]


def anchors_of(page: Path) -> set[str]:
    """Anchors of the headings of a page, by GitHub's rule."""
    headings = re.findall(r"^#+ (.+)$", prose_of(page), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@cache
def sources() -> str:
    """The code of all packages, of the tools and of the templates."""
    folders = [ROOT / name for name in (*PACKAGES, "tools")]
    return "\n".join(
        path.read_text(encoding="utf-8")
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".py", ".toml", ".j2")
    )


@cache
def words_of_the_code() -> set[str]:
    """Every identifier-like word in the code, string literals included: keys, columns and topics are strings."""
    return set(re.findall(r"\w+", sources()))


@cache
def names_of_estimates() -> set[str]:
    """Keys of `metrics.json` that name a group and the estimate that it scores."""
    return {f"{group}_{estimate}" for group in SCORED for estimate in ("online", "filter")}


@cache
def options_of(command: str | None = None) -> set[str]:
    """Options of a command of `testbed`, those of its subcommands included; None = of all commands."""
    if command is None:
        return set().union(*(options_of(name) for name in HELP))
    return {name for part in _parts(app[command]) for name in _own_options(part)}


def _parts(part) -> Iterator:
    yield part
    for name in part:
        if not name.startswith("-"):
            yield from _parts(part[name])


def _own_options(part) -> Iterator[str]:
    if part.default_command is not None:
        for argument in part.assemble_argument_collection():
            yield from argument.names


@cache
def options_of_tools() -> set[str]:
    """Options of the scripts."""
    calls = re.findall(r'add_argument\(\s*"(--[a-z-]+)"', sources())
    return set(calls)


def test_the_index_links_every_page():
    linked = {(DOCS / target).resolve() for target in re.findall(r"\]\(([^)#]+)", INDEX.read_text(encoding="utf-8"))}
    assert [page_id(page) for page in PAGES if page != INDEX and page.resolve() not in linked] == []


@every_page
def test_links_lead_to_files_and_headings(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", prose_of(page)):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{target}: no such file"
        if anchor:
            assert anchor in anchors_of(file), f"{target}: no such heading"


@every_page
def test_every_table_has_rows(page):
    text = prose_of(page)
    assert re.findall(r"^\|(?: ?-+ ?\|)+\n(?!\|).*$", text, flags=re.MULTILINE) == []


@every_page
def test_files_it_names_exist(page):
    for span in spans_of(page):
        path = span.split("::")[0]
        if "NAME" not in path and re.fullmatch(rf"({'|'.join(ROOMS)})/[\w./*-]*", path) and path not in ENVIRONMENTS:
            assert list(ROOT.glob(path.rstrip("/"))), f"`{span}`: no such file"


@every_page
def test_modules_and_their_members_exist(page):
    for span in spans_of(page):
        name = re.sub(r"[(\[].*", "", span)
        if re.fullmatch(rf"(python -m )?({'|'.join((*PACKAGES, 'tools'))})(\.\w+)+", name):
            assert is_importable(name.removeprefix("python -m ")), f"`{span}`: no such module or member"


def is_importable(name: str) -> bool:
    """Whether a dotted name is a module, or a member of one (of a class in one)."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            fields = getattr(found, "__annotations__", {})
            if not hasattr(found, part) and part not in fields:
                return False
            found = getattr(found, part, None)
        return True
    return False


@every_page
def test_identifiers_are_those_of_the_code(page, finished_run):
    """Functions, classes, settings, columns and keys in code spans occur in the code or in a run's files."""
    known = words_of_the_code() | FOREIGN_WORDS | names_of_estimates() | finished_run.keys | set(finished_run.columns)
    for span in spans_of(page):
        if re.fullmatch(r"\w+\.py", span):
            assert list(ROOT.glob(f"*/**/{span}")), f"`{span}`: no such file"
        elif re.fullmatch(r"_?[A-Za-z]\w*(\._?[A-Za-z]\w*)*(\(\))?", span) and ("_" in span or span[0].isupper()):
            missing = [word for word in re.findall(r"\w+", span) if word not in known | PREFIXES]
            assert missing == [], f"`{span}`: {missing} does not occur in the code"


@every_page
def test_commands_and_their_options_exist(page):
    for line in commands_of(page):
        if line.split()[1] != "COMMAND":
            assert_command(line)


@pytest.mark.parametrize("text", HELP.values(), ids=HELP)
def test_commands_in_the_help_exist(text):
    for line in re.findall(r"^testbed [a-z].*$", text, flags=re.MULTILINE):
        assert_command(line)


@pytest.mark.parametrize("text", HELP.values(), ids=HELP)
def test_examples_in_the_help_read_what_an_earlier_line_has_written(text):
    """So they work when they are pasted into an empty directory; words in capitals are files of the user."""
    written: set[str] = set()
    for line in re.findall(r"^testbed [a-z].*$", text, flags=re.MULTILINE):
        command, *words = shlex.split(line)[1:]
        out = {words[k + 1] for k, word in enumerate(words) if word in ("--out", "--save")}
        inputs = list(takewhile(lambda word: not word.startswith("--"), words))
        if command in ("convert", "perturb"):
            out.add(inputs.pop())
        read = inputs[1:] if command == "datasets" else inputs if command in READ_FILES else []
        read += [word for word in words if re.fullmatch(r"[\w./-]+\.(toml|yaml|tum|gz)", word) and word not in out]
        missing = [word for word in read if not word[0].isupper() and word.split("/")[0] not in written]
        assert missing == [], f"`{line}`: nothing has written {missing}"
        written |= out


def assert_command(line: str) -> None:
    """The command of a line and its options exist."""
    command = line.split()[1]
    assert command in HELP, f"`{line}`: no such command"
    for option in re.findall(r"(?<![\w-])--[a-z][\w.-]*\w", line):
        known = options_of(command) | options_of("run" if command == "sweep" else command) | {"--help"}
        assert option in known, f"`{line}`: {command} has no option {option}"


@every_page
def test_options_in_prose_exist(page):
    known = options_of() | options_of_tools() | FOREIGN_OPTIONS
    for span in spans_of(page):
        if span.startswith("--"):
            option = re.match(r"--[a-z][\w.-]*\w", span)
            assert option is None or option[0] in known, f"`{span}`: no such option"


@every_page
def test_make_targets_exist(page):
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))
    named = {span.split()[1] for span in spans_of(page) if re.match(r"make [a-z]", span)}
    named |= set(re.findall(r"^ {4}make ([a-z]+)", page.read_text(encoding="utf-8"), flags=re.MULTILINE))
    assert named <= targets


@every_page
def test_python_blocks_import_what_exists(page):
    """Every import of the packages in a Python block resolves."""
    for block in re.findall(r"^```python\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        try:
            tree = ast.parse(block)
        except SyntaxError:
            continue  # an excerpt of a function's body
        for node in ast.walk(tree):
            names = []
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PACKAGES:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names if alias.name.split(".")[0] in PACKAGES]
            assert [name for name in names if not is_importable(name)] == []
