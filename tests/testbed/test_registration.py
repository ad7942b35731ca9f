# SPDX-License-Identifier: MIT
"""`import testbed` makes the environments known, before gymnasium is imported or after, without loading it."""

import subprocess
import sys

import pytest

SHOW = "print('testbed/Drive-v0' in gymnasium.registry, 'testbed/Explore-v0' in gymnasium.registry)"


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


@pytest.mark.parametrize(
    "imports",
    ["import testbed, gymnasium", "import gymnasium, testbed", "import testbed.envs.drive, gymnasium"],
)
def test_the_order_of_imports_does_not_matter(imports):
    assert run(f"{imports}; {SHOW}") == "True True"


def test_gymnasium_is_not_loaded_for_those_who_do_not_ask():
    assert run("import sys, testbed; print('gymnasium' in sys.modules)") == "False"


def test_gymnasium_finds_the_package_by_itself():
    assert run("import gymnasium; print(gymnasium.make('testbed:testbed/Drive-v0').spec.id)") == "testbed/Drive-v0"
