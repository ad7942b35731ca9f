# SPDX-License-Identifier: MIT
# ruff: noqa: T201
"""Change the code in one place at a time and count the changes that no test notices (mutation testing, cosmic-ray).

    python -m tools.measure.mutation SESSIONS [--only resampling --only weights] [--limit 200]

Prints: the score of each module, and every change that survived, with its line

SESSIONS is a directory with one database for each text of a module; the command goes on where it was stopped. Kernels
of the changed file run as plain Python. No file is changed: the tests import the changed text. Survivors that are left
on purpose are listed with the reason in docs/mutation.md.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tools.catalogue import ROOT
from tools.changed_module import passes

if TYPE_CHECKING:  # the extra `nightly`
    from cosmic_ray.work_db import WorkDB
    from cosmic_ray.work_item import MutationSpec, WorkItem

LONGEST, SHORTEST_S = 10.0, 20.0
"""A change whose tests take that many times as long as without it, and so many seconds, counts as noticed."""
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


PROPOSAL_TESTS = ("tests/slam/matching/test_propose_poses.py", "tests/slam/matching/test_proposal.py")
TARGETS = {
    "resampling": Target("slam/particles/resampling.py", ("tests/slam/particles/test_resampling.py",)),
    "weights": Target("slam/particles/weights.py", ("tests/slam/particles/test_weights.py",)),
    "weight_kernels": Target("slam/particles/_weight_kernels.py", ("tests/slam/particles/test_weights.py",)),
    "ancestry": Target("slam/particles/ancestry.py", ("tests/slam/particles/test_ancestry.py",)),
    "ancestry_kernels": Target("slam/particles/_ancestry_kernels.py", ("tests/slam/particles/test_ancestry.py",)),
    "association": Target("eval/trajectory/association.py", ("tests/eval/trajectory/test_association.py",)),
    "relations": Target("eval/trajectory/relations.py", ("tests/eval/trajectory/test_relations.py",)),
    "measures": Target("eval/trajectory/errors.py", ("tests/eval/trajectory/test_errors.py",)),
    "checkpoint": Target("slam/checkpoint.py", ("tests/slam/test_checkpoint.py",)),
    "checkpoint_check": Target("slam/checkpoint_check.py", ("tests/slam/test_checkpoint_check.py",)),
    "proposal": Target("slam/matching/proposal.py", PROPOSAL_TESTS),
    "proposal_kernels": Target(
        "slam/matching/_proposal_kernels.py", ("tests/slam/matching/test_proposal_kernels.py",)
    ),  # the others take minutes as plain Python
}


def main() -> None:
    """Run what is left of each session, then print scores and survivors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sessions", type=Path, help="directory of the databases")
    parser.add_argument("--only", action="append", choices=TARGETS, help="only these modules (may be repeated)")
    parser.add_argument("--limit", type=int, help="only that many changes of each module, spread over its lines")
    parser.add_argument("--again", action="store_true", help="also those that no test has noticed the last time")
    arguments = parser.parse_args()
    sessions = arguments.sessions.resolve()
    sessions.mkdir(parents=True, exist_ok=True)
    os.chdir(ROOT)
    for name in arguments.only or TARGETS:
        text = hashlib.sha256(Path(TARGETS[name].code).read_bytes()).hexdigest()[:8]
        session = sessions / f"{name}-{text}.sqlite"
        run(TARGETS[name], session, arguments.limit, again=arguments.again)
        report(name, TARGETS[name], session)


def run(target: Target, session: Path, limit: int | None, *, again: bool) -> None:
    """Make all changes of a target that have no result yet, one after the other."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator
    from cosmic_ray.work_db import WorkDB, use_db
    from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkResult

    code = Path(target.code)
    text = code.read_text(encoding="utf-8")
    if not session.exists():
        initialise(session, target.code)
        with use_db(session, WorkDB.Mode.open) as database:
            skip(database, text, limit)
    command = ["-x", "-p", "no:cacheprovider", "--hypothesis-seed=0", *target.tests]
    if pytest.main(command) != 0:  # compiles what is needed, and loads the profile of hypothesis
        sys.exit("the tests do not pass on the code as it is")
    start = time.monotonic()
    if not passes(command, code, text, timeout=3600.0):
        sys.exit(f"the tests do not pass with the kernels of {code} as plain Python")
    timeout = max(SHORTEST_S, LONGEST * (time.monotonic() - start))
    with use_db(session, WorkDB.Mode.open) as database:
        left = list(database.pending_work_items)
        if again:
            done = database.completed_work_items
            left += [i for i, r in done if r.worker_outcome == WorkerOutcome.NORMAL and not r.is_killed]
        for item in left:
            change = mutation(item)
            changed = mutate_code(text, get_operator(change.operator_name)(), change.occurrence)
            noticed = not passes(command, code, changed, timeout)
            outcome = TestOutcome.KILLED if noticed else TestOutcome.SURVIVED
            database.set_result(item.job_id, WorkResult(WorkerOutcome.NORMAL, test_outcome=outcome))


def initialise(session: Path, code: str) -> None:
    """List all changes of a file in a new session."""
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "mutation.toml"
        settings.write_text(
            f'[cosmic-ray]\nmodule-path = "{code}"\ntimeout = 1.0\ntest-command = "true"\n'
            'excluded-modules = []\n[cosmic-ray.distributor]\nname = "local"\n'
        )
        command = [sys.executable, "-m", "cosmic_ray.cli", "init", str(settings), str(session)]
        subprocess.run(command, check=True)


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
