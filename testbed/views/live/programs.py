# SPDX-License-Identifier: MIT
"""How the viewer inside Rerun's wheel is called: on loopback, with bounded memory, each on a port of its own."""

from __future__ import annotations

import importlib.util
import os
import re
import socket
import sys
from pathlib import Path
from urllib.parse import quote

VIEWER_MEMORY = "1GB"
SERVER_MEMORY = "512MB"


def viewer_binary() -> str:
    """The viewer itself. `rerun` on PATH is a wrapper: ending it would leave the viewer behind.

    Raises:
        FileNotFoundError: the wheel holds no viewer.
    """
    spec = importlib.util.find_spec("rerun_cli")
    if spec is None or spec.origin is None:
        raise FileNotFoundError("the Rerun viewer is not installed: pip install rerun-sdk")
    binary = Path(spec.origin).with_name("rerun.exe" if os.name == "nt" else "rerun")
    if not binary.is_file():
        raise FileNotFoundError(f"the Rerun viewer is not where its package says: {binary}")
    return str(binary)


def free_port() -> int:
    """A TCP port of the loopback address that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def proxy_url(port: int) -> str:
    """Where a viewer or server on this machine takes recordings."""
    return f"rerun+http://127.0.0.1:{port}/proxy"


def window_command(port: int) -> list[str]:
    """The native viewer, waiting for a recording on a port."""
    return [
        viewer_binary(),
        *("--bind", "127.0.0.1", "--port", str(port), "--memory-limit", VIEWER_MEMORY),
        *("--hide-welcome-screen", "--expect-data-soon"),
    ]


def server_command(port: int, web_port: int) -> list[str]:
    """A server that takes a recording on a port and hands it to the web viewer, which it serves too."""
    return [
        viewer_binary(),
        *("--serve-web", "--bind", "127.0.0.1", "--port", str(port), "--web-viewer-port", str(web_port)),
        *("--server-memory-limit", SERVER_MEMORY),
    ]


def web_address(port: int, web_port: int) -> str:
    """The page that shows what the server on `port` has."""
    return f"http://127.0.0.1:{web_port}/?url={quote(proxy_url(port), safe='')}&hide_welcome_screen=1"


def display_missing() -> bool:
    """Whether a native viewer has nowhere to open its window."""
    return sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def reason(output: str) -> str:
    """The line of a program's output that says why it ended."""
    lines = [re.sub(r"\x1b\[[0-9;]*m", "", line).strip() for line in output.splitlines() if line.strip()]
    telling = [line for line in lines if re.search(r"\berror\b|panicked", line, re.IGNORECASE)]
    return (telling or lines or ["no reason given"])[-1][:200]
