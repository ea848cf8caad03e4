"""How large the program is, and what one tick costs: the numbers that a rebuilding is judged by.

    python benchmarks/house.py                  # a table; --json for a machine
    python benchmarks/house.py --trace          # beside it the way of one tick from file to file
    python benchmarks/house.py --wide           # beside it the functions of more than six arguments
    python benchmarks/house.py --bytecodes      # beside it which functions a tick spends its bytecodes in

Size: modules and lines of `autopilot` and `sitl`, functions of more than six arguments (those that stand for a codec's
fields apart), cycles of imports file by file. One tick: a pilot steers the simulated boat over MAVLink, in lockstep and
in calm water; of the ticks that a heading caused, the one with the median number of calls is reported: the calls that
the program makes from the arrival of the bytes to the wait for the next, the files they lie in, and how often a call or
a return leads from one file into another. `Pilot.step`: the samples of the same ticks given again in a tight
loop, the best of the repeats. Bytecodes: how many instructions of Python's own machine `Pilot.step` takes, of the
program's functions and of the making of records, the mean of COUNTED ticks: the same on any machine under any load.
"""

from __future__ import annotations

import argparse
import ast
import json
import math
import re
import sys
import time
from collections import Counter
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from lockstep import Lockstep

from autopilot.runtime.build import build_pilot
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, Tick
from autopilot.vessel.file import load_vessel

ROOT = Path(__file__).parents[1]
PACKAGES = ("autopilot", "sitl")
ARGUMENTS_MOST = 6
CODECS = re.compile(r"codec|wire|nmea|n2k|message|px4|binary")
"""Files whose functions take a message's fields."""
SETTLED_S, TRACED_S = 60.0, 20.0
REPEATS = 7
COUNTED = 100
VESSEL = "lanxin"


class Trace(NamedTuple):
    """What ran in one tick: the way as (file, function), how often it went from one file into another, and how often a
    function of the program called one of Python's own."""

    way: tuple[tuple[str, str], ...]
    changes: int
    built_in: int

    @property
    def calls(self) -> int:
        """How many calls, of the program's functions and of Python's own."""
        return len(self.way) + self.built_in

    @property
    def files(self) -> int:
        """How many files."""
        return len({file for file, _ in self.way})

    @property
    def functions(self) -> int:
        """How many different functions."""
        return len(set(self.way))


def modules() -> list[Path]:
    """Return every module of the program."""
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def lines_of(paths: list[Path]) -> int:
    """Return how many lines they have, empty ones and comments too."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def wide(paths: list[Path]) -> list[str]:
    """Return the functions of more than six arguments, `self` apart, codecs apart."""
    found = []
    for path in paths:
        name = str(path.relative_to(ROOT))
        if CODECS.search(name):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                count = sum(argument.arg not in ("self", "cls") for argument in given)
                if count > ARGUMENTS_MOST:
                    found.append(f"{name}:{node.lineno} {node.name} {count}")
    return found


def imports_of(paths: list[Path]) -> dict[str, set[str]]:
    """Return which module imports which as it is loaded: not inside a function, not for a type checker alone."""
    names = {_module(path): path for path in paths}
    found = {}
    for name, path in names.items():
        package = name if path.stem == "__init__" else name.rpartition(".")[0]
        found[name] = _imported(ast.parse(path.read_text(encoding="utf-8")), package, set(names)) - {name}
    return found


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _imported(tree: ast.Module, package: str, known: set[str]) -> set[str]:
    found: set[str] = set()
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            waiting += node.orelse
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name in known}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join(
                    [*package.split(".")[: len(package.split(".")) - node.level + 1], *filter(None, [base])]
                )
            inner = {f"{base}.{alias.name}" for alias in node.names} & known
            found |= inner or ({base} & known)
        else:
            waiting += ast.iter_child_nodes(node)
    return found


def cycles(imports: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import one another, by Tarjan's algorithm."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        order[name] = low[name] = len(order)
        stack.append(name)
        for other in sorted(imports[name]):
            if other not in order:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], order[other])
        if low[name] == order[name]:
            group: list[str] = []
            while not group or group[-1] != name:
                group.append(stack.pop())
            if len(group) > 1:
                found.append(sorted(group))

    sys.setrecursionlimit(10_000)
    for name in sorted(imports):
        if name not in order:
            visit(name)
    return found


class Tracer:
    """Keeps the way of a tick: every call of a function of the program, and every change of file."""

    def __init__(self) -> None:
        self.way: list[tuple[str, str]] = []
        self.changes = self.built_in = 0
        self._file = ""
        self._names: dict[str, str] = {}

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """See `sys.setprofile`."""
        if event == "call":
            if file := self._name(frame.f_code.co_filename):
                self.way.append((file, frame.f_code.co_qualname))
                self._enter(file)
        elif event == "c_call":
            self.built_in += bool(self._name(frame.f_code.co_filename))
        elif event == "return" and self._name(frame.f_code.co_filename):
            back: FrameType | None = frame.f_back
            while back is not None and not self._name(back.f_code.co_filename):
                back = back.f_back
            if back is not None:
                self._enter(self._name(back.f_code.co_filename))

    def _enter(self, file: str) -> None:
        self.changes += self._file not in ("", file)
        self._file = file

    def _name(self, path: str) -> str:
        if path not in self._names:
            own = str(ROOT / "autopilot") + "/"
            self._names[path] = path.removeprefix(str(ROOT) + "/") if path.startswith(own) else ""
        return self._names[path]


def sailed() -> tuple[list[Trace], list[Tick]]:
    """Return the traces of the ticks that a heading caused, and all ticks from the start."""
    boat = Lockstep(load_vessel(VESSEL))
    boat.order = Order(OrderKind.HEADING, math.radians(40.0), serial=1)
    boat.run(SETTLED_S)
    assert boat.tick.mode is Mode.ENGAGED, boat.tick.alarms
    traces, poll = [], boat.session.poll

    def traced(now: float) -> bool:
        tracer = Tracer()
        sys.setprofile(tracer)
        try:
            ticked = bool(poll(now))
        finally:
            sys.setprofile(None)
        tick = boat.session.tick
        if ticked and tick is not None and any(isinstance(sample, HeadingSample) for sample in tick.samples):
            traces.append(Trace(tuple(tracer.way), tracer.changes, tracer.built_in))
        return ticked

    boat.session.poll = traced
    boat.run(SETTLED_S + TRACED_S)
    return traces, list(boat.ticks)


def step_us(ticks: list[Tick]) -> float:
    """Return how long [us] `Pilot.step` takes for the ticks of the settled boat, the best of the repeats."""
    first = next(number for number, tick in enumerate(ticks) if tick.now >= SETTLED_S)
    least = math.inf
    for _ in range(REPEATS):
        pilot = build_pilot(load_vessel(VESSEL))
        for tick in ticks[:first]:
            pilot.step(tick.now, tick.samples, tick.order)
        begun = time.process_time()
        for tick in ticks[first:]:
            pilot.step(tick.now, tick.samples, tick.order)
        least = min(least, (time.process_time() - begun) / len(ticks[first:]))
    return 1e6 * least


def bytecodes(ticks: list[Tick]) -> Counter[str]:
    """Return how many bytecodes `Pilot.step` takes for the first COUNTED ticks of the settled boat, by function."""
    first = next(number for number, tick in enumerate(ticks) if tick.now >= SETTLED_S)
    pilot, found = build_pilot(load_vessel(VESSEL)), Counter[str]()
    for tick in ticks[:first]:
        pilot.step(tick.now, tick.samples, tick.order)

    def count(frame: FrameType, event: str, _: Any) -> Any:
        if event == "opcode":
            found[_place(frame)] += 1
        frame.f_trace_opcodes = True
        return count

    sys.settrace(count)
    try:
        for tick in ticks[first : first + COUNTED]:
            pilot.step(tick.now, tick.samples, tick.order)
    finally:
        sys.settrace(None)
    return found


def _place(frame: FrameType) -> str:
    code = frame.f_code
    file = code.co_filename.removeprefix(str(ROOT) + "/")
    return "records made" if file == "<string>" else f"{file} {code.co_qualname}"


def measured() -> dict[str, Any]:
    """Return the numbers, and what --trace and --wide show."""
    paths = modules()
    traces, ticks = sailed()
    spent = bytecodes(ticks)
    median = sorted(traces, key=lambda trace: trace.calls)[len(traces) // 2]
    return {
        "modules": len(paths),
        "lines": lines_of(paths),
        "packages": len({path.parent for path in paths}),
        "functions of more than 6 arguments": len(wide(paths)),
        "cycles of imports": len(cycles(imports_of(paths))),
        "one tick: files": median.files,
        "one tick: changes of file": median.changes,
        "one tick: calls": median.calls,
        "one tick: of these of Python's own functions": median.built_in,
        "one tick: functions": median.functions,
        "Pilot.step [us]": round(step_us(ticks), 1),
        "Pilot.step: bytecodes": round(sum(spent.values()) / COUNTED),
        "way": median.way,
        "spent": spent,
    }


def main() -> int:
    """Measure and print."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--json", action="store_true", help="numbers for a machine")
    options.add_argument("--trace", action="store_true", help="the way of one tick")
    options.add_argument("--wide", action="store_true", help="the functions of more than six arguments")
    options.add_argument("--bytecodes", action="store_true", help="the functions that a tick spends them in")
    given = options.parse_args()
    numbers = measured()
    way, spent = numbers.pop("way"), numbers.pop("spent")
    if given.json:
        print(json.dumps(numbers))
        return 0
    for name, value in numbers.items():
        print(f"{name:48}{value:>8}")
    if given.trace:
        print()
        for (file, function), times in Counter(way).items():
            print(f"{times:4} {file} {function}")
    if given.bytecodes:
        print()
        for place, count in spent.most_common():
            print(f"{count / COUNTED:8.1f} {place}")
    if given.wide:
        print("", *wide(modules()), sep="\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
