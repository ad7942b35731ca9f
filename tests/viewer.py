# SPDX-License-Identifier: MIT
"""Pictures of the native viewer as arrays."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import matplotlib.image
import numpy as np
import pytest

from testbed.views.rerun import entities
from tools.headless_viewer import HeadlessViewer, NoDriverError, headless_viewer


@contextmanager
def viewer_or_skip(timeline: str = entities.TIMELINE) -> Iterator[HeadlessViewer]:
    """A headless viewer; skips the test where there is nothing to draw with."""
    with ExitStack() as stack:
        try:
            viewer = stack.enter_context(headless_viewer(timeline))
        except (NoDriverError, FileNotFoundError) as error:
            pytest.skip(str(error))
        yield viewer


def pixels(png: bytes) -> np.ndarray:
    """A PNG as (rows, cols, 3) uint8."""
    return np.rint(255.0 * matplotlib.image.imread(io.BytesIO(png))[..., :3]).astype(np.uint8)


def near(picture: np.ndarray, colour: tuple[int, int, int], tolerance: int = 40) -> np.ndarray:
    """Pixels (rows, cols) whose channels all lie within the tolerance of a colour."""
    return (np.abs(picture.astype(int) - colour) <= tolerance).all(axis=-1)
