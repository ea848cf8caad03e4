"""Mutation testing of the limits and the supervisor, printed as a table; exit 1 where a survivor is unexplained.

    python benchmarks/mutation.py [--only autopilot.limits]

cosmic-ray's operators change one operator, number or condition of the source at a time; each mutant runs in a fork of
this process, where the tests find it in the place of the module. Tests that still pass have not noticed. Left out are
annotations, and operators that make no sense on numbers and members of an enumeration, which every test notices. What
survives is either in EXPLAINED, with the reason why nobody could notice, or a gap in the tests.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import os
import re
import signal
import sys
import types
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
TESTS = {
    "autopilot.limits": (
        "tests/core/test_dead_band.py",
        "tests/properties/test_limits_and_gear.py",
    ),
    "autopilot.safety": (
        "tests/core/test_supervisor_returns.py",
        "tests/core/test_supervisor.py",
        "tests/core/test_helm_handover.py",
        "tests/properties/test_limits_and_gear.py",
        "tests/core/test_envelope.py",
    ),
}
"""What is changed, and the tests that must notice."""
PRELOADED = (
    "hypothesis.strategies",
    "numpy",
    "_hypothesis_pytestplugin",
    "autopilot.envelope",
    "autopilot.models.steering_gear",
    "autopilot.supervisor",
)
"""What no mutant is in: loaded once, shared by all forks."""
LONGEST_S = 120
SENSELESS = re.compile(
    r"BitOr_\w+$|_(BitAnd|BitOr|BitXor|LShift|RShift|Mod|Pow|FloorDiv|Invert)$|(Is|IsNot|Eq|NotEq)_(Lt|LtE|Gt|GtE)$"
    r"|Is_Eq$|IsNot_NotEq$|Eq_Is$|NotEq_IsNot$"
)

FIRST = "set anew by the first change of state, before anybody asks"
SAME_END = "what comes back and what is ordered lead to the same state, one after the other in the same tick"
RELEASES = 'lets_go = self._failsafe.action in ("release", "firmware") or self._failsafe.release_after'
WAITS = "self._fire(now, _order_event(order) if {} self._spent else back, order)"
LEFT = "return Rest(before.told if band {} 0.0 else limited, wanted, False)"
EXPLAINED: dict[tuple[str, str], str] = {
    (
        "ReplaceComparisonOperator_Gt_NotEq",
        LEFT.format("!="),
    ): "no distance is within a band below 0",
    ("AddNot", WAITS.format("not order.serial !=")): SAME_END,
    ("ReplaceComparisonOperator_NotEq_Eq", WAITS.format("order.serial ==")): SAME_END,
    ("ReplaceComparisonOperator_LtE_Eq", f"{RELEASES} == 0.0"): "the vessel file knows no time below 0",
    ("ReplaceFalseWithTrue", "self._rebooted = True"): "the first tick, standing by, forgets it",
    ("ReplaceUnaryOperator_Delete_USub", "self._since = math.inf"): FIRST,
    ("ReplaceUnaryOperator_USub_Not", "self._since = not math.inf"): FIRST,
    ("ReplaceUnaryOperator_USub_UAdd", "self._since = +math.inf"): FIRST,
    ("ReplaceUnaryOperator_Delete_USub", "self._reboot_time = math.inf"): FIRST,
    ("ReplaceUnaryOperator_USub_Not", "self._reboot_time = not math.inf"): FIRST,
    ("ReplaceUnaryOperator_USub_UAdd", "self._reboot_time = +math.inf"): FIRST,
}
"""Operator and the line as it became -> why no test can tell the difference."""


class Mutant(NamedTuple):
    """One change: the module, the operator that made it, the line as it became, the whole source."""

    module: str
    operator: str
    line: str
    source: str


def mutants_of(module: str) -> Iterator[Mutant]:
    """Yield every mutant of a module."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator, operator_names

    source = _path(module).read_text(encoding="utf-8")
    before = source.splitlines()
    for name in sorted(operator_names()):
        operator = get_operator(name)
        if SENSELESS.search(name) or operator.arguments():
            continue
        occurrence = 0
        while (changed := mutate_code(source, operator(), occurrence)) is not None:
            after = changed.splitlines()
            line = next((b.strip() for a, b in zip(before, after, strict=False) if a != b), "")
            yield Mutant(module, name.removeprefix("core/"), line, changed)
            occurrence += 1


def _path(module: str) -> Path:
    return ROOT / f"{module.replace('.', '/')}.py"


def is_noticed(module: str, source: str) -> bool:
    """Return whether any test fails with `source` in the place of `module`."""
    child = os.fork()
    if child == 0:
        code = 1
        with contextlib.suppress(BaseException):
            # processor time: on a busy machine a mutant is not noticed by waiting
            signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
            code = _run_tests(module, source)
        os._exit(code)
    return os.waitpid(child, 0)[1] != 0


def _run_tests(module: str, source: str) -> int:
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    changed = types.ModuleType(module)
    changed.__file__ = str(_path(module))
    sys.modules[module] = changed
    exec(compile(source, changed.__file__, "exec"), changed.__dict__)
    package, _, name = module.rpartition(".")
    setattr(sys.modules[package], name, changed)
    options = ["-x", "-q", "-p", "no:cacheprovider", "--assert=plain"]
    return int(pytest.main([*options, *(str(ROOT / test) for test in TESTS[module])]))


def report(modules: Sequence[str], killed: Counter[str], survivors: list[Mutant]) -> int:
    """Print the table and the survivors; return how many of them nobody has explained."""
    unexplained = [mutant for mutant in survivors if (mutant.operator, mutant.line) not in EXPLAINED]
    alive, bare = (Counter(mutant.module for mutant in some) for some in (survivors, unexplained))
    print("| module | mutants | noticed | survive, explained | unexplained |\n|---|---|---|---|---|")
    for module in modules:
        total, explained = killed[module] + alive[module], alive[module] - bare[module]
        print(f"| {module} | {total} | {killed[module]} | {explained} | {bare[module]} |")
    print("\n| operator | the line as it became | why nobody notices |\n|---|---|---|")
    for mutant in survivors:
        reason = EXPLAINED.get((mutant.operator, mutant.line), "UNEXPLAINED")
        print(f"| {mutant.operator} | `{mutant.line}` | {reason} |")
    return len(unexplained)


def main() -> int:
    """Run all mutants and print."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--only", choices=TESTS)
    only = options.parse_args().only
    modules = [only] if only else list(TESTS)
    os.chdir(ROOT)
    for name in PRELOADED:
        importlib.import_module(name)
    killed: Counter[str] = Counter()
    survivors: list[Mutant] = []
    for module in modules:
        if is_noticed(module, _path(module).read_text(encoding="utf-8")):
            print(f"{module}: its tests fail as it is; put them right first", file=sys.stderr)
            return 2
        for mutant in mutants_of(module):
            if is_noticed(module, mutant.source):
                killed[module] += 1
            else:
                survivors.append(mutant)
                print(f"survives: {mutant.operator}: {mutant.line}", file=sys.stderr, flush=True)
    return int(report(modules, killed, survivors) > 0)


if __name__ == "__main__":
    raise SystemExit(main())
