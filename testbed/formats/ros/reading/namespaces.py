# SPDX-License-Identifier: MIT
"""Which topics of a bag are read, where it has several: those of one robot, whose topics and frames begin with its
name, as `/robot1/scan` and `robot1/base_link`; or those that the user names.
"""

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


def of_topics(connections: list[Any], topics: tuple[str, ...]) -> list[Any]:
    """The connections of some topics, and of all types that none of them has; ValueError for one that is not there."""
    there = {connection.topic for connection in connections}
    if missing := [topic for topic in topics if topic not in there]:
        raise ValueError(f"no topic {', '.join(missing)}; there is: {', '.join(sorted(there)[:20])}")
    kinds = {connection.msgtype for connection in connections if connection.topic in topics}
    return [c for c in connections if c.topic in topics or c.msgtype not in kinds]


def choices(names: Iterable[str]) -> str:
    """Advice that lists the namespaces of topics or frames; empty where they are fewer than two."""
    found = sorted({namespace for name in names if (namespace := namespace_of(name))})
    if len(found) < 2:
        return ""
    return f"; --namespace NAME reads one robot of {', '.join(found)}"
