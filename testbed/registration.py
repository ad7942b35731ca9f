# SPDX-License-Identifier: MIT
"""Registration of the environments with gymnasium, which imports their modules in `gymnasium.make`.

Gymnasium itself is not imported here, so that `testbed --help` is fast.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType


def register_environments() -> None:
    """Register all environments with gymnasium; may be called twice."""
    import gymnasium

    if "testbed/Drive-v0" in gymnasium.registry:
        return
    gymnasium.register(
        "testbed/Drive-v0",
        entry_point="testbed.envs.drive:DriveEnv",
        vector_entry_point="testbed.envs.drive_vector:DriveVectorEnv",
        max_episode_steps=1000,
    )
    gymnasium.register("testbed/Explore-v0", entry_point="testbed.envs.explore:ExploreEnv", max_episode_steps=3000)


def when_imported(name: str, action: Callable[[], None]) -> None:
    """Call `action` now if the module of that name is loaded, otherwise right after its import."""
    if name in sys.modules:
        action()
    else:
        sys.meta_path.insert(0, _Watch(name, action))


class _Watch(MetaPathFinder):
    """Finds one module once, by the other finders, and calls an action after its execution."""

    def __init__(self, name: str, action: Callable[[], None]) -> None:
        self._name, self._action = name, action

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of the module, whose loader calls the action at the end; None for other modules."""
        if fullname != self._name:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(fullname)
        if spec is None or spec.loader is None:
            return None
        execute = spec.loader.exec_module

        def execute_and_act(module: ModuleType) -> None:
            execute(module)
            self._action()

        spec.loader.exec_module = execute_and_act  # type: ignore[method-assign]
        return spec
