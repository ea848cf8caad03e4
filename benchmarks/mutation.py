"""Mutation testing of the limits and the supervisor, printed as a table; exit 1 where a survivor is unexplained.

    python benchmarks/mutation.py [--keep FOLDER]

cosmic-ray changes one operator, number or condition at a time in a copy of the source; tests that still pass have not
noticed. Left out: annotations, and operators that make no sense on numbers and members of an enumeration, which every
test notices. What survives is either in EXPLAINED, with the reason why nobody could notice, or a gap in the tests.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome

ROOT = Path(__file__).parents[1]
MODULES = ("autopilot/limits.py", "autopilot/safety.py")
TESTS = (
    "tests/core/test_supervisor_returns.py",
    "tests/core/test_supervisor.py",
    "tests/core/test_helm_handover.py",
    "tests/core/test_envelope.py",
    "tests/properties/test_limits_and_gear.py",
)
NEEDED = ("autopilot", "tests", "pyproject.toml")
SENSELESS = re.compile(
    r"BitOr_\w+$|_(BitAnd|BitOr|BitXor|LShift|RShift|Mod|Pow|FloorDiv|Invert)$|(Is|IsNot|Eq|NotEq)_(Lt|LtE|Gt|GtE)$"
    r"|Is_Eq$|IsNot_NotEq$|Eq_Is$|NotEq_IsNot$"
)
CONFIG = """[cosmic-ray]
module-path = {modules}
timeout = 60.0
excluded-modules = []
test-command = "{python} -m pytest -x -q -p no:cacheprovider {tests}"
[cosmic-ray.distributor]
name = "local"
"""

EXPLAINED: dict[tuple[str, str], str] = {}
"""Operator and changed line -> why no test can tell the difference."""


class Mutant(NamedTuple):
    """One change: where, by which operator, the line as it became, and whether a test noticed."""

    module: str
    operator: str
    line: str
    is_killed: bool


def run_all(folder: Path) -> list[Mutant]:
    """Mutate a copy of the source in `folder` and return what became of each mutant."""
    for name in NEEDED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / name)
    tests, modules = " ".join(TESTS), "[" + ", ".join(f'"{module}"' for module in MODULES) + "]"
    config = folder / "mutation.toml"
    config.write_text(CONFIG.format(modules=modules, python=sys.executable, tests=tests), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    session = folder / "mutation.sqlite"
    for step in (("init", config.name, session.name), ("exec", config.name, session.name)):
        if step[0] == "exec":
            _leave_out(session)
        subprocess.run([_program(), *step], cwd=folder, env=environment, check=True)
    return _results(session)


def _program() -> str:
    return str(Path(sys.executable).with_name("cosmic-ray"))


def _leave_out(session: Path) -> None:
    """Take the senseless mutants out of the work, as skipped."""
    from cosmic_ray.work_item import WorkerOutcome, WorkResult

    with use_db(session, WorkDB.Mode.open) as work:
        for item in list(work.pending_work_items):
            if SENSELESS.search(item.mutations[0].operator_name):
                work.set_result(item.job_id, WorkResult(worker_outcome=WorkerOutcome.SKIPPED, output="senseless"))


def _results(session: Path) -> list[Mutant]:
    mutants = []
    with use_db(session, WorkDB.Mode.open) as work:
        outcomes = dict(work.results)
        for item in work.work_items:
            result = outcomes.get(item.job_id)
            if result is None or result.test_outcome is None:
                continue
            mutation = item.mutations[0]
            added = [line[1:].strip() for line in (result.diff or "").splitlines() if re.match(r"\+(?!\+)", line)]
            killed = result.test_outcome is not TestOutcome.SURVIVED
            name = mutation.operator_name.removeprefix("core/")
            mutants.append(Mutant(str(mutation.module_path), name, " ".join(added), killed))
    return mutants


def report(mutants: list[Mutant]) -> int:
    """Print the table and the survivors; return how many of them nobody has explained."""
    made = Counter(mutant.module for mutant in mutants)
    survivors = [mutant for mutant in mutants if not mutant.is_killed]
    alive = Counter(mutant.module for mutant in survivors)
    print("| module | mutants | killed | survived, explained | unexplained |\n|---|---|---|---|---|")
    unexplained = [mutant for mutant in survivors if (mutant.operator, mutant.line) not in EXPLAINED]
    bare = Counter(mutant.module for mutant in unexplained)
    for module in MODULES:
        print(
            f"| {module} | {made[module]} | {made[module] - alive[module]} | {alive[module] - bare[module]} | "
            f"{bare[module]} |"
        )
    print("\n| operator | as it became | why nobody notices |\n|---|---|---|")
    for mutant in survivors:
        reason = EXPLAINED.get((mutant.operator, mutant.line), "UNEXPLAINED")
        print(f"| {mutant.operator} | `{mutant.line}` | {reason} |")
    return len(unexplained)


def main() -> int:
    """Run all mutants and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--keep", type=Path, help="an empty folder to work in, kept afterwards")
    arguments = parser.parse_args()
    if arguments.keep is not None:
        arguments.keep.mkdir(parents=True, exist_ok=True)
        return int(report(run_all(arguments.keep)) > 0)
    with tempfile.TemporaryDirectory() as folder:
        return int(report(run_all(Path(folder))) > 0)


if __name__ == "__main__":
    raise SystemExit(main())
