# SPDX-License-Identifier: MIT
"""Run tests on a module with another text, in a fork of this process, which has imported and compiled everything else.

A process of its own for each change would spend most of its time on imports. Kernels of the changed module run as plain
Python, since compiling them each time would take longer still; all other kernels are compiled.
"""

from __future__ import annotations

import ast
import importlib.abc
import importlib.machinery
import importlib.util
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, ModuleType

import pytest

from slam import _jit

PACKAGES = ("slam", "eval", "worlds", "testbed", "tests")
POLL_S = 0.01


class Changed(importlib.abc.MetaPathFinder, importlib.machinery.SourceFileLoader):
    """Imports a module with another text than that of its file."""

    def __init__(self, name: str, path: Path, text: str) -> None:
        """Stand in for the module `name` of the file `path`."""
        super().__init__(name, str(path))
        self._text = text

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """This loader for the module, nothing for others."""
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self.path, loader=self)

    def get_code(self, fullname: str) -> CodeType:
        """The text, compiled; nothing is kept on disk."""
        return compile(self._text, self.path, "exec", dont_inherit=True)


def passes(command: list[str], code: Path, text: str, timeout: float) -> bool:
    """Whether tests pass with `text` in the place of a file's own; code: below the working directory."""
    name = ".".join(code.with_suffix("").parts)
    process = os.fork()
    if process == 0:
        status = 1
        try:
            os.setsid()
            silent = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silent, 1)
            os.dup2(silent, 2)
            if name.endswith("_kernels"):
                _jit.kernel = _jit.inlined = lambda function: function
            for dependent in dependents(name):
                del sys.modules[dependent]
            sys.meta_path.insert(0, Changed(name, code.resolve(), text))
            status = int(pytest.main(["--noconftest", *command]))
        finally:
            os._exit(status)
    limit = time.monotonic() + timeout
    while time.monotonic() < limit:
        ended, status = os.waitpid(process, os.WNOHANG)
        if ended:
            return status == 0
        time.sleep(POLL_S)
    os.killpg(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return False


def dependents(changed: str) -> set[str]:
    """Modules of ours that have been imported and that import a module, or one that does; and the module itself."""
    ours = {name for name in sys.modules if name.split(".")[0] in PACKAGES and name != _jit.__name__}
    imports = {name: imported_by(name) & ours for name in ours}
    found, fresh = {changed} & ours, {changed}
    while fresh:
        fresh = {name for name in ours - found if imports[name] & (found | fresh)}
        found |= fresh
    return found


def imported_by(name: str) -> set[str]:
    """Names of the modules that a module's file imports; of a package only where something else is taken from it."""
    file = getattr(sys.modules[name], "__file__", None)
    found: set[str] = set()
    if file is None:
        return found
    for node in ast.walk(ast.parse(Path(file).read_bytes())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= names if names <= sys.modules.keys() else names | {node.module}
    return found
