# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Print the result hashes of a few short runs, to show that a change of structure changes no result.

    python -m tools.measure.result_hashes > before.txt      # then change the code
    python -m tools.measure.result_hashes > after.txt
    diff before.txt after.txt

Prints: hashes of trajectory and map, and of a dataset; CONTRIBUTING.md says when they may change

The runs cover both backends, the exploring driver, localisation, the filter without the final pass, a dataset, and the
Intel log if it is found in $TESTBED_DATASETS (by default ../shared/datasets). Takes about two minutes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATASETS = Path(os.environ.get("TESTBED_DATASETS", ROOT.parent / "shared" / "datasets"))
INTEL = DATASETS / "intel" / "intel-910.clf.gz"
DATASET = ("simulate", "apartment", "--backend", "fast", "--duration", "12", "--seed", "4")
"""The dataset that is hashed, and in whose true map the robot is localised."""
RUNS: dict[str, tuple[str, ...]] = {
    "pybullet": ("run", "office", "--backend", "pybullet", "--duration", "15"),
    "fast": ("run", "loop", "--backend", "fast", "--duration", "30"),
    "filter only": ("run", "loop", "--backend", "fast", "--duration", "30", "--no-refine"),
    "poor odometry": ("run", "maze", "--backend", "fast", "--duration", "30", "--odometry.grade", "poor"),
    "movers": ("run", "concourse", "--backend", "fast", "--duration", "20", "--seed", "2"),
    "explore": ("run", "apartment", "--backend", "fast", "--driver", "explore", "--duration", "20"),
}


def testbed(*arguments: str | Path) -> None:
    """Call the command line of this source tree."""
    code = "from testbed.cli import main; main()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def hash_of_run(arguments: tuple[str | Path, ...], out: Path) -> str:
    """Compute a run and return its `result_hash`."""
    testbed(*arguments, "--out", out)
    metrics = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
    return str(metrics["result_hash"])


def hash_of_recording(dataset: Path) -> str:
    """SHA-256 of the bag of a dataset."""
    (bag,) = dataset.glob("*.mcap")
    return hashlib.sha256(bag.read_bytes()).hexdigest()


def main() -> None:
    """Compute all runs and print one line for each."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        testbed(*DATASET, "--count", "1", "--out", folder / "data")
        dataset = folder / "data" / "apartment-0004"
        print(f"{'dataset':16s} {hash_of_recording(dataset)}", flush=True)
        runs: dict[str, tuple[str | Path, ...]] = {**RUNS}
        runs["localisation"] = ("slam", dataset, "--map", dataset / "truth_map.yaml")
        if INTEL.is_file():
            runs["intel-910"] = ("slam", INTEL)
        for name, arguments in runs.items():
            print(f"{name:16s} {hash_of_run(arguments, folder / name)}", flush=True)


if __name__ == "__main__":
    main()
