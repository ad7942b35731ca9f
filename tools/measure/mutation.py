# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Change the code in one place at a time and count the changes that no test notices (mutation testing, cosmic-ray).

    python -m tools.measure.mutation SESSIONS [--only resampling --only weights] [--limit 200]

Prints: the score of each module, and every change that survived, with its line

SESSIONS is a directory with one database for each module; the command goes on where it was stopped. Kernels run as
plain Python. The tests run in a copy of the tree, so that the tree itself is never changed. Survivors that are left on
purpose are listed with the reason in docs/mutation.md.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tools.catalogue import ROOT

if TYPE_CHECKING:  # the extra `nightly`
    from cosmic_ray.work_db import WorkDB
    from cosmic_ray.work_item import MutationSpec, WorkItem

PACKAGES = ("slam", "eval", "worlds", "testbed", "tests", "tools")
BINARY = (
    "Add_Sub|Sub_Add|Mul_Div|Div_Mul|FloorDiv_Mul|Mod_FloorDiv|Pow_Mul|BitOr_BitAnd|BitAnd_BitOr|[LR]Shift_[LR]Shift"
)
COMPARISON = "Eq_NotEq|NotEq_Eq|Lt_LtE|Lt_Gt|LtE_Lt|LtE_Gt|Gt_GtE|Gt_Lt|GtE_Gt|GtE_Lt|Is_IsNot|IsNot_Is"
CHANGES = re.compile(
    rf"core/(ReplaceBinaryOperator_({BINARY})|ReplaceComparisonOperator_({COMPARISON})|ReplaceUnaryOperator_\w+_USub"
    r"|ReplaceUnaryOperator_(Delete|USub)_\w*|AddNot|ReplaceTrueWithFalse|ReplaceFalseWithTrue|ReplaceAndWithOr"
    r"|ReplaceOrWithAnd|ReplaceBreakWithContinue|ReplaceContinueWithBreak|NumberReplacer|ZeroIterationForLoop)$"
)
"""One neighbour of each operator; each operator by each other one is ten times as many, and teaches little more."""


@dataclass(frozen=True)
class Target:
    """A file of code and the tests that must notice each change of it."""

    code: str
    tests: tuple[str, ...]
    timeout: float = 60.0
    """Time after which a change counts as noticed: it never ends [s]."""


TARGETS = {
    "resampling": Target("slam/particles/resampling.py", ("tests/slam/particles/test_resampling.py",)),
    "weights": Target("slam/particles/weights.py", ("tests/slam/particles/test_weights.py",)),
    "weight_kernels": Target("slam/particles/_weight_kernels.py", ("tests/slam/particles/test_weights.py",)),
    "ancestry": Target("slam/particles/ancestry.py", ("tests/slam/particles/test_ancestry.py",)),
    "ancestry_kernels": Target("slam/particles/_ancestry_kernels.py", ("tests/slam/particles/test_ancestry.py",)),
    "association": Target("eval/trajectory/association.py", ("tests/eval/trajectory/test_association.py",)),
    "relations": Target("eval/trajectory/relations.py", ("tests/eval/trajectory/test_relations.py",)),
    "measures": Target("eval/trajectory/errors.py", ("tests/eval/trajectory/test_errors.py",)),
    "checkpoint": Target("slam/checkpoint.py", ("tests/slam/test_checkpoint.py",), 300.0),
    "checkpoint_check": Target("slam/checkpoint_check.py", ("tests/slam/test_checkpoint.py",), 300.0),
    "proposal": Target("slam/matching/proposal.py", ("tests/slam/matching/test_proposal.py",), 600.0),
    "proposal_kernels": Target("slam/matching/_proposal_kernels.py", ("tests/slam/matching/test_proposal.py",), 600.0),
}
COMPILED = ("checkpoint", "checkpoint_check", "proposal")
"""Targets without kernels of their own, whose tests run faster with compiled ones."""


def main() -> None:
    """Run what is left of each session, then print scores and survivors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sessions", type=Path, help="directory of the databases")
    parser.add_argument("--only", action="append", choices=TARGETS, help="only these modules (may be repeated)")
    parser.add_argument("--limit", type=int, help="only that many changes of each module, spread over its lines")
    arguments = parser.parse_args()
    arguments.sessions.mkdir(parents=True, exist_ok=True)
    for name in arguments.only or TARGETS:
        session = arguments.sessions / f"{name}.sqlite"
        run(name, TARGETS[name], session, arguments.limit)
        report(name, TARGETS[name], session)


def run(name: str, target: Target, session: Path, limit: int | None) -> None:
    """Make all changes of a target that have no result yet, one after the other, in a copy of the tree."""
    from cosmic_ray.work_db import WorkDB, use_db

    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        for package in PACKAGES:
            shutil.copytree(ROOT / package, tree / package, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", tree)
        tests = " ".join(target.tests)
        command = f"{sys.executable} -m pytest -x -p no:cacheprovider --hypothesis-seed=0 {tests}"
        (tree / "mutation.toml").write_text(
            f'[cosmic-ray]\nmodule-path = "{target.code}"\ntimeout = {target.timeout}\ntest-command = "{command}"\n'
            'excluded-modules = []\n[cosmic-ray.distributor]\nname = "local"\n'
        )
        env = (
            {"TESTBED_DATASETS": str(ROOT.parent / "shared" / "datasets")}
            | os.environ
            | {
                "PYTHONPATH": str(tree),
                "PYTHONDONTWRITEBYTECODE": "1",  # a change within a second would go unseen
                "NUMBA_DISABLE_JIT": str(int(name not in COMPILED)),
            }
        )
        subprocess.run(command, shell=True, cwd=tree, env=env, check=True, stdout=subprocess.DEVNULL)  # all pass
        if not session.exists():
            cosmic_ray("init", "mutation.toml", str(session.resolve()), tree=tree, env=env)
            with use_db(session, WorkDB.Mode.open) as database:
                skip(database, (ROOT / target.code).read_text(encoding="utf-8"), limit)
        cosmic_ray("exec", "mutation.toml", str(session.resolve()), tree=tree, env=env)


def cosmic_ray(*arguments: str, tree: Path, env: dict[str, str]) -> None:
    """Run a command of cosmic-ray."""
    subprocess.run([sys.executable, "-m", "cosmic_ray.cli", *arguments], cwd=tree, env=env, check=True)


def skip(database: WorkDB, source: str, limit: int | None) -> None:
    """Mark changes of other kinds, those of annotations, and those beyond the limit as skipped."""
    from cosmic_ray.work_item import WorkerOutcome, WorkResult

    wanted = []
    annotations = annotation_spans(source)
    lines = source.splitlines()
    for item in database.pending_work_items:
        place = mutation(item).start_pos
        is_star = lines[place[0] - 1][place[1] :].startswith("*,")  # of keyword-only arguments, no product
        unseen = is_star or any(a <= place < b for a, b in annotations)
        if CHANGES.match(mutation(item).operator_name) and not unseen:
            wanted.append(item.job_id)
        else:
            database.set_result(item.job_id, WorkResult(WorkerOutcome.SKIPPED))
    if limit is not None and len(wanted) > limit:
        kept = {wanted[k * len(wanted) // limit] for k in range(limit)}
        for job in set(wanted) - kept:
            database.set_result(job, WorkResult(WorkerOutcome.SKIPPED))


def mutation(item: WorkItem) -> MutationSpec:
    """The one change of a piece of work."""
    return item.mutations[0]


def annotation_spans(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """From where to where (line, column) types stand, which are never evaluated, and the decorators of classes."""
    types: list[ast.expr | None] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            types.append(node.returns)
        elif isinstance(node, ast.arg | ast.AnnAssign):
            types.append(node.annotation)
        elif isinstance(node, ast.ClassDef):
            types += node.decorator_list
    return [((t.lineno, t.col_offset), (t.end_lineno or 0, t.end_col_offset or 0)) for t in types if t is not None]


def report(name: str, target: Target, session: Path) -> None:
    """Print the score of a target and its survivors."""
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import WorkerOutcome

    with use_db(session, WorkDB.Mode.open) as database:
        done = [(i, r) for i, r in database.completed_work_items if r.worker_outcome != WorkerOutcome.SKIPPED]
    outcomes = Counter("killed" if result.is_killed else "survived" for _, result in done)
    share = outcomes["killed"] / max(len(done), 1)
    print(f"{name}: {outcomes['killed']} of {len(done)} changes noticed ({share:.1%})")
    lines = (ROOT / target.code).read_text(encoding="utf-8").splitlines()
    for item, result in done:
        if not result.is_killed:
            change = mutation(item)
            operator, line = change.operator_name.removeprefix("core/"), change.start_pos[0]
            print(f"  {target.code}:{line}:{change.start_pos[1]} {operator} #{change.occurrence}")
            print(f"    {lines[line - 1].strip()}")


if __name__ == "__main__":
    main()
