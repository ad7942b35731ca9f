# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Fuzz all readers, guided by the code that an input reaches (atheris).

    python -m tests.fuzz --seconds 60 [--only carmen] [--corpus DIR]

The time is shared among the readers. An input that a reader takes wrongly is written to tests/fuzz/failures, and the
exit status is 1; `tests/fuzz/test_failures.py` tries all of them again, so keep it with its mend. `--corpus` keeps the
inputs that reach new code, for the next time.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import FunctionType

FAILURES = Path(__file__).parent / "failures"
INSTRUMENTED = [
    "testbed.formats", "testbed.presets", "testbed.sweep.spec", "worlds.format", "worlds.names", "worlds.world",
    "eval.files", "eval.trajectory.relations", "rosbags",
]  # fmt: skip
"""Modules whose branches guide the fuzzer; no kernels, which are compiled from the code that it would change."""
MAX_BYTES = 20_000
"""Largest input, unless a sound file is longer."""
TIMEOUT_S, MEMORY_MB = 20, 3000
"""An input that takes longer, or more memory, is a failure."""


def main() -> None:
    """Fuzz one reader after the other, each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="time for all readers together")
    parser.add_argument("--only", action="append", help="only these readers")
    parser.add_argument("--corpus", type=Path, help="directory for inputs that reach new code")
    parser.add_argument("--target", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.target:
        fuzz(arguments.target, arguments.corpus, int(arguments.seconds))
        return
    from tests.fuzz.targets import TARGETS

    names = arguments.only or list(TARGETS)
    share = max(1, round(arguments.seconds / len(names)))
    failed = [name for name in names if not fuzz_apart(name, arguments.corpus, share)]
    print(f"{len(names) - len(failed)} of {len(names)} readers held for {share} s each")
    sys.exit(1 if failed else 0)


def fuzz_apart(name: str, corpus: Path | None, seconds: int) -> bool:
    """Fuzz a reader in another process; whether it held."""
    with tempfile.TemporaryDirectory() as folder:
        inputs = Path(folder) / "corpus" if corpus is None else (corpus / name).resolve()
        inputs.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", "tests.fuzz", "--target", name, "--seconds", str(seconds)]
        done = subprocess.run(
            [*command, "--corpus", str(inputs)],
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            env=os.environ | {"TMPDIR": folder},
        )
        runs = [line for line in done.stderr.splitlines() if line.startswith("Done ")]
        for crash in (path for kind in ("crash", "timeout", "oom") for path in Path(folder).glob(f"{kind}-*")):
            content = crash.read_bytes()
            kept = FAILURES / f"{name}-{hashlib.sha256(content).hexdigest()[:12]}"
            kept.write_bytes(content)
            print(f"{name}: {kept}")
        reason = [line for line in done.stdout.splitlines() if line.startswith("problem: ")]
        print(f"{name}: {(runs or reason or done.stderr.splitlines()[-3:] or ['no output'])[-1]}")
        return done.returncode == 0


def fuzz(name: str, corpus: Path, seconds: int) -> None:
    """Fuzz a reader in this process."""
    import atheris

    with atheris.instrument_imports(include=INSTRUMENTED):
        from tests.fuzz.targets import TARGETS, problem_of
    from slam import checkpoint_check

    for function in vars(checkpoint_check).values():  # by itself: all of `slam` would be changed with it
        if isinstance(function, FunctionType):
            atheris.instrument_func(function)
    target = TARGETS[name]
    work = Path(tempfile.mkdtemp())
    path = work / target.file
    target.write_sound(path)
    (corpus / "sound").write_bytes(path.read_bytes())

    def try_input(data: bytes) -> None:
        path.write_bytes(data)
        problem = problem_of(target, path)
        if problem is not None:
            print(f"problem: {problem}", flush=True)
            raise AssertionError(problem)

    options = [
        f"-max_total_time={seconds}",
        f"-max_len={max(MAX_BYTES, 2 * path.stat().st_size)}",
        f"-timeout={TIMEOUT_S}",
    ]
    options += [f"-rss_limit_mb={MEMORY_MB}", f"-artifact_prefix={tempfile.gettempdir()}/", "-verbosity=1"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], try_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
