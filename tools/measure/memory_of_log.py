# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Memory of the filter on a whole log, in a process that does nothing else; prints one JSON object.

    python -m tools.measure.memory_of_log LOG [--particles 300]

`test_engine.py` starts it, so that neither its own frames nor other benchmarks count.
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
    """Map the log, frame by frame as they are read."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log")
    parser.add_argument("--particles", type=int, default=300)
    args = parser.parse_args()
    mapper, in_use = GMapping(FilterConfig(particles=args.particles)), []
    before = resident_mb()
    frames = deque(open_log(args.log).frames)
    while frames:  # what was read is let go: the figure is the filter's
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
