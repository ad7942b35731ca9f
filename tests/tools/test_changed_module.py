# SPDX-License-Identifier: MIT
"""Tests that run on another text of a module see that text, and nothing is left of it afterwards."""

import subprocess
import sys

import pytest

from tools.catalogue import ROOT
from tools.changed_module import dependents

TRY = """
import sys
from pathlib import Path
import slam.gmapping
from tools.changed_module import passes
tests = ["-p", "no:cacheprovider", "tests/slam/particles/test_weights.py", "-k", "effective_sample_size or mixture"]
code = Path(sys.argv[1])
text = code.read_text()
assert sys.argv[2] in text
results = [passes(tests, code, new, 600.0) for new in (text, text.replace(*sys.argv[2:4]), text)]
results.append(passes(tests, code, "while True: pass", 0.5))
print(results)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "old", "new"),
    [
        ("slam/particles/weights.py", "self.values**2", "self.values**3"),
        ("slam/particles/_weight_kernels.py", "2.0 * np.pi", "3.0 * np.pi"),
    ],
)
def test_a_change_is_noticed_and_the_next_run_does_not_see_it(code, old, new):
    """Also where the changed module, or a kernel that others call, has been imported before."""
    command = [sys.executable, "-c", TRY, code, old, new]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[True, False, True, False]"


def test_what_depends_on_a_module_is_found_over_several_steps():
    import slam.gmapping  # noqa: F401  it imports the weights by way of the particles

    found = dependents("slam.particles.weights")
    assert {"slam.particles.weights", "slam.particles.particle_set", "slam.gmapping"} <= found
    assert not found & {"slam.se2", "slam._jit", "slam.particles._weight_kernels"}
