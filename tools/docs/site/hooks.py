# SPDX-License-Identifier: MIT
"""What mkdocs does besides to make a site of docs/: pages of the README, of the public API, and of the sources linked.

The pages of docs/ are written for a reader of the repository. They link files outside of docs/, which get a page of
their own here.
"""

from __future__ import annotations

import importlib
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[3]
TEXTS = {"README.md": "readme.md", "CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
"""Pages beside docs/, and what they are called in the site."""
API = {
    "slam": ("The filter, its settings, its input and its report; localisation; the final pass.", ["slam"]),
    "testbed": (
        "Recorded logs, simulated drives, datasets, SLAM systems, environments.",
        [
            "testbed.formats",
            "testbed.simulation",
            "testbed.datasets",
            "testbed.systems",
            "testbed.library",
            "testbed.envs",
        ],
    ),
    "eval": (
        "Measures of trajectories and maps, and the files they come from.",
        [
            "eval.scoring",
            "eval.limits",
            "eval.trajectory.trajectory",
            "eval.files.tum",
            "eval.files.map_server",
            "eval.report.run_report",
            "eval.report.comparison",
            "eval.sweep.report",
        ],
    ),
    "worlds": ("Worlds: the catalogue, generators, files, the true map.", ["worlds"]),
}
"""What each page of the API says first, and the modules whose public names it holds."""
_LINK = re.compile(r"(\]\()([^)\s]+)(\))")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages beside docs/, the API, and the sources that pages link."""
    for name, page in TEXTS.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text(encoding="utf-8")))
    for package, (said, modules) in API.items():
        files.append(File.generated(config, f"api/{package}.md", content=_api_page(package, said, modules)))
    texts = [(ROOT / name, (ROOT / name).read_text(encoding="utf-8")) for name in TEXTS]
    texts += [(path, path.read_text(encoding="utf-8")) for path in sorted((ROOT / "docs").glob("*.md"))]
    for source in sorted({source for path, text in texts for source in _sources_of(path, text)}):
        files.append(File.generated(config, f"source/{source}.md", content=_source_page(source)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links to files outside of docs/ lead to their pages in the site."""
    own = page.file.src_uri
    beside = {site: name for name, site in TEXTS.items()}
    at = ROOT / beside[own] if own in beside else ROOT / "docs" / own

    def linked(found: re.Match[str]) -> str:
        target, mark, anchor = found[2].partition("#")
        place = _in_site(at, target)
        if place is None:
            return found[0]
        return f"{found[1]}{posixpath.relpath(place, posixpath.dirname(own) or '.')}{mark}{anchor}{found[3]}"

    return markdown if own.startswith(("api/", "source/")) else _LINK.sub(linked, markdown)


def _in_site(page: Path, target: str) -> str | None:
    """Where the target of a link lies in the site; None for links within docs/ as they are, and to other sites."""
    if not target or "://" in target:
        return None
    file = (page.parent / target).resolve()
    if not file.is_relative_to(ROOT):
        return None
    name = file.relative_to(ROOT).as_posix()
    if name in TEXTS:
        return TEXTS[name]
    if name.startswith("docs/") and not name.startswith("docs/jobs/"):
        return name.removeprefix("docs/")
    return f"source/{name}.md" if file.is_file() else None


def _sources_of(page: Path, text: str) -> Iterator[str]:
    """Files outside of docs/ that a page links."""
    for _, target, _ in _LINK.findall(text):
        place = _in_site(page, target.partition("#")[0])
        if place is not None and place.startswith("source/"):
            yield place.removeprefix("source/").removesuffix(".md")


def _source_page(name: str) -> str:
    """A source file as a page that no search finds: what is looked for is in the pages."""
    text = (ROOT / name).read_text(encoding="utf-8")
    language = {".py": "python", ".toml": "toml", ".yaml": "yaml", ".sh": "bash"}.get(Path(name).suffix, "text")
    return f"---\nsearch:\n  exclude: true\n---\n# {name}\n\n````{language}\n{text}````\n"


def _api_page(package: str, said: str, modules: list[str]) -> str:
    """The public names of a package, from their docstrings."""
    parts = [f"# API: {package}", said]
    for module in modules:
        names = getattr(importlib.import_module(module), "__all__", None)
        if len(modules) > 1:
            parts.append(f"## {module}")
        parts += [f"::: {_home(module, name)}" for name in names] if names else [f"::: {module}"]
    return "\n\n".join(parts) + "\n"


def _home(module: str, name: str) -> str:
    """Where a public name is defined: packages take theirs from modules."""
    found = getattr(importlib.import_module(module), name)
    home = getattr(found, "__module__", module)
    return f"{home}.{name}" if getattr(found, "__name__", None) == name else f"{module}.{name}"
