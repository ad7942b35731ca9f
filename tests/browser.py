# SPDX-License-Identifier: MIT
"""Debian's Chromium without a display, driven over its debugging pipe: opens a page, gives pictures of it."""

from __future__ import annotations

import base64
import io
import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.viewer import pixels

ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--window-size=1280,800",
    "--remote-debugging-pipe",
    "--no-first-run",
)


class Page:
    """One page of a browser; commands of the Chrome DevTools Protocol, answers matched by number."""

    def __init__(self, requests: io.BufferedWriter, answers: io.BufferedReader) -> None:
        self._requests, self._answers, self._number = requests, answers, 0
        self._session: str | None = None
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def open(self, address: str) -> None:
        """Load an address."""
        self._call("Page.navigate", url=address)

    def picture(self) -> np.ndarray:
        """What the page shows, (rows, cols, 3) uint8."""
        return pixels(base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"]))

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        request: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            request["sessionId"] = self._session
        self._requests.write(json.dumps(request).encode() + b"\0")
        self._requests.flush()
        while True:
            answer = json.loads(self._message())
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                result: dict[str, Any] = answer["result"]
                return result

    def _message(self) -> bytes:
        message = bytearray()
        while (byte := self._answers.read(1)) != b"\0":
            if not byte:
                raise RuntimeError("the browser ended")
            message += byte
        return bytes(message)


@contextmanager
def browser_page(profile: Path) -> Iterator[Page]:
    """A page for the length of the context; skips the test where there is no Chromium. profile: an empty folder"""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no Chromium on PATH (apt-get install chromium)")
    to_browser, from_us = os.pipe()
    to_us, from_browser = os.pipe()

    def place_pipes() -> None:  # the browser reads descriptor 3 and writes descriptor 4
        reader, writer = os.dup(to_browser), os.dup(from_browser)
        os.dup2(reader, 3)
        os.dup2(writer, 4)

    process = subprocess.Popen(
        [chromium, *ARGUMENTS, f"--user-data-dir={profile}"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        close_fds=False,
        preexec_fn=place_pipes,  # noqa: PLW1509, two system calls between fork and exec
    )
    os.close(to_browser)
    os.close(from_browser)
    try:
        with open(from_us, "wb") as requests, open(to_us, "rb") as answers:
            yield Page(requests, answers)
    finally:
        process.terminate()
        process.wait(timeout=20.0)
