# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Measure the memory of the filter on a whole log, in a process of its own.

    python -m tools.measure.memory_of_log LOG [--particles 300]

Prints: the figures of memory in docs/filter.md, as one JSON object

`tests/benchmarks/test_engine.py` starts this script, so that the memory of other benchmarks is not counted.
"""

import argparse
import json
import resource
from collections import deque

from slam import FilterConfig, GMapping
from testbed.formats import open_log


def resident_mb() -> int:
    """Largest resident size of this process so far [MB = 1e6 bytes]."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6)


def main() -> None:
    """Map the log and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log")
    parser.add_argument("--particles", type=int, default=300)
    args = parser.parse_args()
    mapper, in_use = GMapping(FilterConfig(particles=args.particles)), []
    before = resident_mb()
    frames = deque(open_log(args.log).frames)
    while frames:  # frames are freed as they are used, so that they are not counted
        frame = frames.popleft()
        if frame.scan is not None:
            in_use.append(mapper.process(frame.odometry, frame.scan, twist=frame.twist).map_bytes)
    figures = {
        "updates": len(mapper.update_scans),
        "worst_map_mb_per_particle": round(max(in_use) / args.particles / 1e6, 2),
        "last_map_mb_per_particle": round(in_use[-1] / args.particles / 1e6, 2),
        "process_mb_before": before,
        "process_mb_peak": resident_mb(),
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
