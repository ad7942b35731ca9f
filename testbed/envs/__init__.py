# SPDX-License-Identifier: MIT
"""Gymnasium environments; `import testbed` registers them."""

from testbed.envs.generated_worlds import GeneratedWorlds

__all__ = ["GeneratedWorlds"]
