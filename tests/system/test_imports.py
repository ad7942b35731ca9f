# SPDX-License-Identifier: MIT
"""White lists of what packages may import; import-linter checks the layers, but knows no white lists."""

import ast
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LIBRARIES = {
    "slam": {"numpy", "numba", "scipy"},  # scipy: sparse factors of the pose graph, distance transform of local maps
    "worlds": {"numpy", "scipy", "shapely", "pydantic", "tomli_w", "yaml", "PIL"},
    "eval": {"numpy", "scipy", "matplotlib", "jinja2", "yaml", "pyarrow", "PIL"},
}
"""Libraries that each package may import, at any depth of its functions."""
TYPES_OF_SLAM = {"slam.se2", "slam.scan", "slam.occupancy"}
"""Modules of `slam` that `eval` may import: types only, never the estimator."""


def imports_of(package: str) -> dict[str, set[str]]:
    """Imported modules (dotted names) of every file of a package, imports within functions included."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        names = found[str(path.relative_to(ROOT))] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                if node.module == "slam":  # from slam import se2: a module; from slam import GMapping: a class of one
                    names |= {f"slam.{alias.name}" for alias in node.names}
                else:
                    names.add(node.module or "")
    return found


@pytest.mark.parametrize("package", LIBRARIES)
def test_a_package_imports_only_its_libraries(package):
    ours = {"slam", "eval", "worlds", "testbed"} | set(sys.stdlib_module_names)
    strange = {
        path: unknown
        for path, names in imports_of(package).items()
        if (unknown := {name.split(".")[0] for name in names} - ours - LIBRARIES[package])
    }
    assert strange == {}


def test_eval_imports_only_the_types_of_slam():
    strange = {
        path: unknown
        for path, names in imports_of("eval").items()
        if (unknown := {name for name in names if name.split(".")[0] == "slam"} - TYPES_OF_SLAM)
    }
    assert strange == {}


@pytest.mark.parametrize("package", ["slam", "worlds", "eval", "testbed"])
def test_nothing_is_pickled(package):
    """No module loads or writes a pickle, and numpy archives are read without."""
    for file, names in imports_of(package).items():
        assert not names & {"pickle", "dill", "cloudpickle", "marshal", "shelve"}, file
        text = (ROOT / file).read_text(encoding="utf-8")
        for call in re.findall(r"np\.load\([^)]*\)", text):
            assert "allow_pickle=False" in call, f"{file}: {call}"
        assert "yaml.load(" not in text or "class _PlainLoader(yaml.SafeLoader)" in text, file
