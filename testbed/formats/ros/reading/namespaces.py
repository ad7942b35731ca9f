# SPDX-License-Identifier: MIT
"""Bags of several robots: the topics and frames of each begin with its name: `/robot1/scan`, `robot1/base_link`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def namespace_of(name: str) -> str:
    """What is in front of the last part of a topic or frame; empty where there is nothing."""
    return name.strip("/").rpartition("/")[0]


def is_within(name: str, namespace: str) -> bool:
    """Tell whether a topic or frame belongs to a namespace."""
    return name.strip("/").startswith(f"{namespace.strip('/')}/")


def of_namespace(connections: list[Any], namespace: str) -> list[Any]:
    """The connections of one robot; of a type that has none in its namespace, those in no namespace at all, such as
    `/tf`. Transforms may be in both."""
    own = [connection for connection in connections if is_within(connection.topic, namespace)]
    kinds = {connection.msgtype for connection in own}
    shared = [
        connection
        for connection in connections
        if not namespace_of(connection.topic)
        and (connection.msgtype not in kinds or connection.topic in ("/tf", "/tf_static"))
    ]
    return [connection for connection in connections if connection in own or connection in shared]


def choices(names: Iterable[str]) -> str:
    """Advice that lists the namespaces of topics or frames; empty where they are fewer than two."""
    found = sorted({namespace for name in names if (namespace := namespace_of(name))})
    if len(found) < 2:
        return ""
    return f"; --namespace NAME reads one robot of {', '.join(found)}"
