"""Mutation testing by a sample drawn afresh every day: exit 1 where the tests notice fewer than 95 % of the mutants.

    python benchmarks/mutation.py                        # 500 mutants, drawn from today's date
    python benchmarks/mutation.py --date 2026-11-22      # those of that day again
    python benchmarks/mutation.py --rooms control --count 60

A mutant is the program with one operator, number, condition or constant changed, by the operators of cosmic-ray. The
places are drawn evenly over all rooms together, then the change. Each mutant runs against the tests that reach its
line (of a line that only an import reaches, those of its module, or of who imports it), the quickest first, in a fork
that finds it in the place of the module. Which tests reach which line comes from one run of them with coverage, kept
in --map; after a change only the tests that are new, or reached what changed, are run again for it. Tests that live in
real time, and those of compiled code, are left out.

What survives is either in EXPLAINED, with the reason why nobody could notice, or a gap in the tests; both are printed.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import datetime
import difflib
import hashlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import math
import os
import random
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import processor_time
import pytest

from autopilot.cli.terminal import ProgressBar

ROOT = Path(__file__).parents[1]
ROOMS = {
    "supervision": ("supervision/**/*.py",),
    "links": ("links/**/*.py",),
    "estimation": ("estimation/*.py",),
    "control": ("control/*.py",),
}
"""What is changed, in `autopilot`."""
TESTS = (
    "supervision",
    "estimation",
    "control",
    "guidance",
    "pilot",
    "properties",
    "links",
    "contract",
    "closed_loop",
    "models",
    "runtime",
    "logs",
    "operators",
    "signalk",
    "cli",
)
"""Folders of tests that must notice; what they leave out lives in real time or tests other things."""
LEAST_NOTICED = 0.95
TESTS_S = 30.0
"""So many seconds of tests, by their own processor time with coverage, are tried on a mutant."""
LONGEST_S = 120
"""Processor time of all its tests; a mutant that takes longer never ends, which is noticed."""
WAITING_S = 60
"""So long one may use no processor: it waits for ever."""
PRELOADED = ("hypothesis.strategies", "numpy", "scipy.linalg", "pymavlink.dialects.v20.ardupilotmega", "serial")
"""What no mutant is in: loaded once, shared by all forks."""
SETTINGS = {"NORRBIN_HYPOTHESIS": "gate", "NORRBIN_SLOW": "1"}
"""The same inputs every time, and the night's tests too."""
SENSELESS = re.compile(
    r"BitOr_\w+$|_(BitAnd|BitOr|BitXor|LShift|RShift|Mod|Pow|FloorDiv|Invert)$|(Is|IsNot|Eq|NotEq)_(Lt|LtE|Gt|GtE)$"
    r"|Is_Eq$|IsNot_NotEq$|Eq_Is$|NotEq_IsNot$|RemoveDecorator$|ReplaceUnaryOperator_USub_Not$"
)
"""Changes that make no sense on types, numbers and members of an enumeration: every test notices, or none can."""
EXPLAINED: dict[tuple[str, str], str] = {
    ("core/ReplaceBinaryOperator_Add_Sub", "gain=model.gain * (1.0 - a * spread.gain),"): (
        "a takes both signs: the same boats in another order"
    ),
    ("core/ReplaceBinaryOperator_Add_Sub", "time_constant=model.time_constant * (1.0 - b * spread.time_constant),"): (
        "b takes both signs: the same boats in another order"
    ),
    ("core/NumberReplacer", "0.0 if holds(GAIN_LEAST) else _end(holds, 2.0, GAIN_LEAST),"): (
        "bisection from further away ends at the same place"
    ),
    ("core/NumberReplacer", "sock.listen( 0)"): (
        "how many clients may wait in the kernel, which rounds it as it likes: one at a time is taken all the same"
    ),
    ("core/NumberReplacer", "sock.listen( 2)"): (
        "how many clients may wait in the kernel, which rounds it as it likes: one at a time is taken all the same"
    ),
    ("core/ReplaceComparisonOperator_Lt_NotEq", "if len(upload.items) != upload.wanted:"): (
        "items come one at a time, and with the last one wanted the upload ends: there are never more"
    ),
    ("core/NumberReplacer", "blank = dict(vars(kind(*[ 1] * len(kind.fieldnames))))"): (
        "what is read is written over every field"
    ),
    ("core/NumberReplacer", "blank = dict(vars(kind(*[ -1] * len(kind.fieldnames))))"): (
        "what is read is written over every field"
    ),
    ("core/NumberReplacer", "body = frame[:2] + bytes([frame[ 3] | SIGNED]) + frame[3:-2]"): (
        "a frame that we are to sign has no flags yet, neither of the one kind nor of the other"
    ),
    (
        "core/ReplaceComparisonOperator_Gt_NotEq",
        "read = attrgetter(*names) if len(names) != 1 else lambda message: (getattr(message, names[0]),)",
    ): "every message has a field",
    ("core/NumberReplacer", "BISECTIONS = 23"): "the seventh digit of a margin",
    ("core/NumberReplacer", "BISECTIONS = 25"): "the seventh digit of a margin",
    ("core/NumberReplacer", "BISECTIONS = 59"): "two doubles that are next to each other are reached before",
    ("core/NumberReplacer", "BISECTIONS = 61"): "two doubles that are next to each other are reached before",
    ("core/NumberReplacer", "low, high = abs(n), abs(n) + 3.0 * bandwidth"): (
        "bisection from further away ends at the same place"
    ),
    (
        "core/ReplaceComparisonOperator_Gt_GtE",
        "overpowered = overpowered or f\"to {'port' if seen.rudder >= 0.0 else 'starboard'}\"",
    ): "a rudder that is hard over is to one side",
    (
        "core/ReplaceComparisonOperator_Gt_GtE",
        "off = f\"by {math.degrees(abs(error)):.0f} deg to {'starboard' if error >= 0.0 else 'port'}\"",
    ): "a boat that is off its course is to one side of it",
    ("core/ReplaceComparisonOperator_Gt_GtE", 'side = "starboard" if push >= 0.0 else "port"'): (
        "a push that is heavier than the rudder is to one side"
    ),
    ("core/ReplaceComparisonOperator_Gt_GtE", "side = 1.0 if error >= 0.0 else -1.0"): (
        "on the heading to be steered no side is wrong"
    ),
    ("core/ReplaceComparisonOperator_Gt_GtE", "excused = side * bias if side * bias >= 0.0 else 0.0"): (
        "a bias of 0 excuses 0"
    ),
    ("core/ReplaceComparisonOperator_Gt_GtE", "if answer >= 0.0:"): (
        "where there is no answer both sums lose the same share, and nothing is added to either"
    ),
    ("core/ReplaceComparisonOperator_Lt_LtE", "if answer <= 0.0:"): (
        "where there is no answer the sign of what is left changes, and only its square counts"
    ),
    (
        "core/NumberReplacer",
        "read = attrgetter(*names) if len(names) > 1 else lambda message: (getattr(message, names[ -1]),)",
    ): "the only field is the last one, too",
    ("core/NumberReplacer", "state, gains = ekf.initial( -1.0, 0.0, 0.0, calm), [(0.0, 0.0)] * 3"): (
        "every step begins with the time at 0"
    ),
    (
        "core/ReplaceBinaryOperator_Mul_Sub",
        "if until >= end and until - begun <= LONGEST_SHARE - model.time_constant:",
    ): "a shortcut that is taken less often: the way round comes to the same mean",
    (
        "core/ReplaceComparisonOperator_GtE_Gt",
        "if until > end and until - begun <= LONGEST_SHARE * model.time_constant:",
    ): "a shortcut that is never taken: the way round comes to the same mean",
    (
        "core/ReplaceUnaryOperator_Delete_USub",
        "def __init__(self, battery_percent: float = math.inf) -> None:",
    ): "a charge is watched where its limit is finite",
    (
        "core/ReplaceUnaryOperator_USub_UAdd",
        "def __init__(self, battery_percent: float = +math.inf) -> None:",
    ): "a charge is watched where its limit is finite",
    (
        "core/ReplaceComparisonOperator_LtE_Lt",
        "if now - since > SILENT_SAID_S or now - entry.last < entry.stale:",
    ): "a compass is left when it has been silent for longer, and is no longer silent when it is heard, which is now",
    **{
        (
            "core/NumberReplacer",
            f"straight, at_rest = linear_of(model), FilterState({', '.join(zeros)})",
        ): "where the mean goes does not depend on how well it is known"
        for place in range(4, 10)
        for one in (" 1.0", " -1.0")
        for zeros in [["0.0"] * place + [one.strip()] + ["0.0"] * (9 - place)]
    },
    (
        "core/NumberReplacer",
        "return 1 < length <= len(data) and bool(MavlinkCodec().decode(data[:length]))",
    ): "no frame is one byte long",
    ("core/NumberReplacer", "self._different = -1"): "set with each release, before anybody looks",
    ("core/NumberReplacer", "self._different = 1"): "set with each release, before anybody looks",
    ("core/NumberReplacer", "OPEN = -1"): "the value of a name that is compared by itself",
    ("core/NumberReplacer", "OPEN = 1"): "the value of a name that is compared by itself",
    ("core/NumberReplacer", "time.sleep( 2.0)  # a broken disk is not asked without end"): "seconds between two tries",
    ("core/NumberReplacer", "time.sleep( 0.0)  # a broken disk is not asked without end"): "seconds between two tries",
    ("core/ReplaceFalseWithTrue", "self._was_at_rest = True"): "set as a proof begins, before anybody looks",
    ("core/ReplaceTrueWithFalse", "self._was_at_rest = False"): "set as a proof begins, before anybody looks",
    ("core/NumberReplacer", "channels = [LEAVE_ALONE] * 8 + [0] * 9"): "the message fills up its last channel with 0",
    ("core/ReplaceComparisonOperator_GtE_Gt", "if newest < 0 or begun > times[newest & ring]:"): (
        "a shortcut that is taken less often: the way round comes to the same angle"
    ),
}
"""Operator and the line as it became -> why no test can tell the difference."""


class Place(NamedTuple):
    """Where a change may be made: a file below ROOT, the 1-based line, and each operator with its occurrence there."""

    file: str
    line: int
    changes: tuple[tuple[str, int], ...]


class Mutant(NamedTuple):
    """One change: its room, file, line, the operator that made it, and the occurrence of it in the file."""

    room: str
    file: str
    line: int
    operator: str
    occurrence: int


class Judged(NamedTuple):
    """What became of a mutant: whether a test noticed, how many there were, and the line as it became."""

    mutant: Mutant
    is_noticed: bool
    tests: int
    text: str


class Reach(NamedTuple):
    """Which tests reach which line of a file, and how long [s] each takes."""

    lines: dict[str, dict[int, list[str]]]
    seconds: dict[str, float]

    def tests_of(self, file: str, line: int) -> list[str]:
        """Return the tests that reach a line, the quickest first, as many as TESTS_S holds.

        Of a line that only an import reaches those of its module; of a module of nothing else, of who imports it.
        """
        names = self.lines.get(file, {}).get(line) or self._of_module(file)
        names = names or sorted({name for user in _users(file) for name in self._of_module(user)})
        chosen, total = [], 0.0
        for name in sorted(names, key=lambda name: self.seconds.get(name, math.inf)):
            total += self.seconds.get(name, math.inf)
            if total > TESTS_S:
                break
            chosen.append(name)
        return chosen

    def _of_module(self, file: str) -> list[str]:
        return sorted({name for names in self.lines.get(file, {}).values() for name in names})


def _users(file: str) -> list[str]:
    """Return the modules that import one."""
    name = file.removesuffix(".py").replace("/", ".")
    package, _, module = name.rpartition(".")
    said = re.compile(rf"^from ({re.escape(name)} import|{re.escape(package)} import .*\b{module}\b)", re.MULTILINE)
    return [_name(path) for path in _modules() if said.search(path.read_text(encoding="utf-8"))]


def files_of(room: str) -> list[Path]:
    """Return the modules of a room."""
    return sorted(path for pattern in ROOMS[room] for path in (ROOT / "autopilot").glob(pattern))


def places_of(path: Path) -> list[Place]:
    """Return every place of a module where some operator changes something that runs."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    nodes = list(ast_nodes(get_ast(path.read_text(encoding="utf-8"))))
    found: defaultdict[tuple[int, int], list[tuple[str, int]]] = defaultdict(list)
    for name in sorted(operator_names()):
        operator = get_operator(name)
        if SENSELESS.search(name) or operator.arguments():
            continue
        occurrence = 0
        for node in nodes:
            for start, _ in operator().mutation_positions(node):
                if not (_is_annotation(node) or _is_strict(node) or _is_bare_star(node)):
                    found[start].append((name, occurrence))
                occurrence += 1
    return [Place(str(path.relative_to(ROOT)), line, tuple(found[line, column])) for line, column in sorted(found)]


def _is_annotation(node: Any) -> bool:
    """Return whether a syntax node lies in an annotation, which nothing looks at while the program runs."""
    while node is not None:
        if node.type in ("annassign", "tfpdef") and node.children[0].type == "operator":
            return True
        before = node
        node = node.parent
        if node is not None and node.type == "annassign" and node.children[1] is before:
            return True
        if node is not None and node.type == "tfpdef":
            return True
        if node is not None and node.type == "funcdef" and node.annotation is before:
            return True
    return False


def _is_strict(node: Any) -> bool:
    """Return whether a node is the value of `strict=`: what it guards against is a mistake in the line itself."""
    argument = node.parent
    return argument is not None and argument.type == "argument" and argument.get_code(False).startswith("strict=")


def _is_bare_star(node: Any) -> bool:
    """Return whether a node is the `*` of a signature: how callers write what follows, not what becomes of it."""
    return node.type == "operator" and node.parent is not None and node.parent.type == "parameters"


def drawn(rooms: Sequence[str], count: int, seed: str) -> list[Mutant]:
    """Return `count` mutants, the same for the same seed and code: a place by chance, then one of its changes."""
    chance = random.Random(seed)
    places = [(room, place) for room in rooms for path in files_of(room) for place in places_of(path)]
    chosen = chance.sample(places, min(count, len(places)))
    return [Mutant(room, place.file, place.line, *chance.choice(place.changes)) for room, place in chosen]


def mutated(mutant: Mutant) -> str:
    """Return the whole source with the change made."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    source = (ROOT / mutant.file).read_text(encoding="utf-8")
    changed = mutate_code(source, get_operator(mutant.operator)(), mutant.occurrence)
    assert changed is not None
    return str(changed)


class _Exchanged(importlib.abc.MetaPathFinder):
    """Finds the mutant where its module is imported."""

    def __init__(self, file: str, source: str) -> None:
        self._name = file.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
        self._path, self._source = str(ROOT / file), source

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> importlib.machinery.ModuleSpec | None:
        if name != self._name:
            return None
        loader = _Loader(name, self._path, self._source)
        return importlib.util.spec_from_file_location(name, self._path, loader=loader)


class _Loader(importlib.machinery.SourceFileLoader):
    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self._source = source

    def get_code(self, fullname: str) -> Any:
        return compile(self._source, self.path, "exec")


def is_noticed(file: str, source: str, tests: Sequence[str]) -> bool:
    """Return whether any of `tests` fails with `source` in the place of `file`."""
    child = os.fork()
    if child == 0:
        code = 1
        with contextlib.suppress(BaseException):
            # processor time: on a busy machine a mutant is not noticed by waiting
            signal.signal(signal.SIGPROF, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
            code = _run_tests(file, source, tests)
        os._exit(code)
    return _outcome(child) != 0


def _outcome(child: int) -> int:
    """Return how a child ended; one that waits for ever is killed."""
    used, since = -1.0, time.monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
        now_used = sum(map(float, fields[11:15]))
        if now_used != used:
            used, since = now_used, time.monotonic()
        elif time.monotonic() - since > WAITING_S:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.02)


def _run_tests(file: str, source: str, tests: Sequence[str]) -> int:
    silence = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(silence, stream)
    os.chdir(ROOT)
    sys.meta_path.insert(0, _Exchanged(file, source))
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:cov", "--assert=plain", "-n", "0"]
    return int(pytest.main([*options, *tests]))


def judged(mutant: Mutant, tests: Sequence[str]) -> Judged:
    """Run a mutant's tests and return what became of it."""
    changed = mutated(mutant)
    before = (ROOT / mutant.file).read_text(encoding="utf-8").splitlines()
    text = next((b.strip() for a, b in zip(before, changed.splitlines(), strict=False) if a != b), "")
    return Judged(mutant, bool(tests) and is_noticed(mutant.file, changed, tests), len(tests), text)


def _prepare() -> None:
    os.environ.update(SETTINGS)
    for name in PRELOADED:
        importlib.import_module(name)


def reach(folder: Path) -> Reach:
    """Return which tests reach which line: from `folder` as far as it still holds, the rest by running tests anew."""
    kept = folder / "reach.json"
    tests, sources = _tests(), {_name(path): path.read_text(encoding="utf-8") for path in _modules()}
    if kept.exists():
        before = json.loads(kept.read_text())
        stale = stale_tests(before, tests, sources)
        document = _carried(before, stale, tests, sources)
    else:
        before, stale = {}, set(tests)
        document = {"lines": {}, "imported": {}, "seconds": {}}
    if stale:
        folder.mkdir(parents=True, exist_ok=True)
        found = _traced(folder, sorted(stale))
        document["seconds"] |= found["seconds"]
        document["imported"] |= found["imported"]
        for file, by_line in found["lines"].items():
            known = document["lines"].setdefault(file, {})
            for line, names in by_line.items():
                known[line] = sorted({*known.get(line, ()), *names})
    document |= {"tests": tests, "sources": sources}
    if document != before:
        kept.write_text(json.dumps(document))
    lines = {file: {int(line): names for line, names in each.items()} for file, each in document["lines"].items()}
    return Reach(lines, document["seconds"])


def _name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def _modules() -> list[Path]:
    return sorted((ROOT / "autopilot").rglob("*.py"))


def _tests() -> dict[str, str]:
    """Return every file of tests with a digest of it and of what it and its helpers import from `tests`."""
    paths = sorted((ROOT / "tests").rglob("*.py"))
    helpers = {path.stem: path for path in paths if not path.stem.startswith("test_") and path.stem != "conftest"}

    def read(path: Path, seen: set[Path]) -> bytes:
        seen.add(path)
        content = path.read_bytes()
        for name in re.findall(r"^(?:from|import) (\w+)", content.decode(), re.MULTILINE):
            if name in helpers and helpers[name] not in seen:
                content += read(helpers[name], seen)
        return content

    common = (ROOT / "tests" / "conftest.py").read_bytes()
    return {
        _name(path): hashlib.sha256(common + read(path, set())).hexdigest()[:16]
        for folder in TESTS
        for path in sorted((ROOT / "tests" / folder).rglob("test_*.py"))
    }


def stale_tests(before: dict[str, Any], tests: dict[str, str], sources: dict[str, str]) -> set[str]:
    """Return the files of tests that are new or changed, or of which a test reached a line that is not as it was."""
    reached: set[str] = set()
    for file, old in before["sources"].items():
        by_line, imported = before["lines"].get(file, {}), set(before["imported"].get(file, ()))
        for line in touched(old, sources.get(file, ""), {*map(int, by_line), *imported}):
            if names := by_line.get(str(line)):
                reached |= set(names)
            elif line in imported:  # a constant or a signature: whoever uses the module may notice
                reached |= {name for each in by_line.values() for name in each}
    changed = {file for file, digest in tests.items() if before["tests"].get(file) != digest}
    return changed | {name.partition("::")[0] for name in reached} & tests.keys()


def touched(old: str, new: str, known: set[int]) -> set[int]:
    """Return those of the `known` lines of `old`, 1-based, that are not in `new`, or between which something is new."""
    if old == new:
        return set()
    silent = _silent(old)
    found: set[int] = set()
    matcher = difflib.SequenceMatcher(None, old.splitlines(), new.splitlines(), autojunk=False)
    for kind, start, end, *_ in matcher.get_opcodes():
        if kind in ("replace", "delete"):
            for line in set(range(start + 1, end + 1)) - silent:
                # of a statement over several lines only some are known
                found |= {max((each for each in known if each <= line), default=0)}
        if kind == "insert":
            found |= {max((each for each in known if each <= start), default=0)}
            found |= {min((each for each in known if each > start), default=0)}
    return found - {0}


def _silent(source: str) -> set[int]:
    """Return the lines of a module that do nothing: empty ones, comments and docstrings."""
    found = {n for n, line in enumerate(source.splitlines(), 1) if not line.strip() or line.strip().startswith("#")}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            found |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return found


def _carried(before: dict[str, Any], stale: set[str], tests: dict[str, str], sources: dict[str, str]) -> dict[str, Any]:
    """Return the map of the tests that are not stale, its lines moved to where they are now."""

    def holds(name: str) -> bool:
        file = name.partition("::")[0]
        return file in tests and file not in stale

    document: dict[str, Any] = {"lines": {}, "imported": {}}
    document["seconds"] = {name: seconds for name, seconds in before["seconds"].items() if holds(name)}
    for file, source in sources.items():
        moved = _moved(before["sources"].get(file, ""), source)
        by_line, imported = before["lines"].get(file, {}), before["imported"].get(file, [])
        document["imported"][file] = [moved[line] for line in imported if line in moved]
        document["lines"][file] = {
            str(moved[int(line)]): still
            for line, names in by_line.items()
            if int(line) in moved and (still := [name for name in names if holds(name)])
        }
    return document


def _moved(old: str, new: str) -> dict[int, int]:
    """Return where each line that stayed as it was is now, 1-based."""
    matcher = difflib.SequenceMatcher(None, old.splitlines(), new.splitlines(), autojunk=False)
    return {a + n + 1: b + n + 1 for a, b, size in matcher.get_matching_blocks() for n in range(size)}


def _traced(folder: Path, files: Sequence[str]) -> dict[str, Any]:
    """Run files of tests once with coverage and return what they reach; only tests that pass count."""
    from coverage import CoverageData

    data, times = (folder / "coverage").absolute(), (folder / "times.xml").absolute()
    data.unlink(missing_ok=True)
    print(f"finding out which lines {len(files)} files of tests reach", file=sys.stderr, flush=True)
    command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "-p", "no:cacheprovider", f"--junitxml={times}"]
    command += ["--cov=autopilot", "--cov-context=test", "--cov-report=", "-o", "filterwarnings=default"]
    command += ["-p", processor_time.__name__, *files]
    path = os.pathsep.join(filter(None, (str(Path(__file__).parent), os.environ.get("PYTHONPATH"))))
    environment = {**os.environ, **SETTINGS, "COVERAGE_FILE": str(data), "PYTHONPATH": path}
    subprocess.run(command, cwd=ROOT, env=environment, check=False, stdout=sys.stderr)
    seconds = _passed(ElementTree.parse(times).getroot())
    coverage = CoverageData(str(data))
    coverage.read()
    lines: dict[str, dict[str, list[str]]] = {}
    imported: dict[str, list[int]] = {}
    for file in coverage.measured_files():
        by_line = coverage.contexts_by_lineno(file)
        name = _name(Path(file))
        imported[name] = sorted(line for line, contexts in by_line.items() if "" in contexts)
        lines[name] = {
            str(line): sorted(names & seconds.keys())
            for line, contexts in by_line.items()
            if (names := {context.partition("|")[0] for context in contexts if context}) & seconds.keys()
        }
    return {"lines": lines, "imported": imported, "seconds": seconds}


def _passed(suites: ElementTree.Element) -> dict[str, float]:
    """Return the tests that passed, by their node id, with their processor time [s]."""
    found = {}
    for case in suites.iter("testcase"):
        if len(case) == 0 or all(child.tag not in ("failure", "error", "skipped") for child in case):
            parts = str(case.get("classname")).split(".")
            cut = next((n for n in range(len(parts), 0, -1) if (ROOT / f"{'/'.join(parts[:n])}.py").exists()), 0)
            node = "::".join(["/".join(parts[:cut]) + ".py", *parts[cut:], str(case.get("name"))])
            taken = case.find(f"properties/property[@name='{processor_time.PROPERTY}']")
            found[node] = math.inf if taken is None else float(taken.get("value", math.inf))
    return found


def interval(noticed: int, total: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share."""
    z, share = 1.96, noticed / total
    middle = (share + z * z / (2 * total)) / (1 + z * z / total)
    half = z / (1 + z * z / total) * math.sqrt(share * (1 - share) / total + z * z / (4 * total * total))
    return middle - half, middle + half


def report(results: Iterable[Judged]) -> int:
    """Print the table and the survivors; return the exit code."""
    results = list(results)
    survivors = [each for each in results if not each.is_noticed]
    explained = {each for each in survivors if (each.mutant.operator, each.text) in EXPLAINED}
    total, noticed, known = (
        Counter(each.mutant.room for each in some)
        for some in (results, [e for e in results if e.is_noticed], explained)
    )
    print("| room | mutants | noticed | survive, explained | unexplained |\n|---|---|---|---|---|")
    for room in ROOMS:
        if total[room]:
            bare = total[room] - noticed[room] - known[room]
            print(f"| {room} | {total[room]} | {noticed[room]} | {known[room]} | {bare} |")
    print("\n| place | operator | the line as it became | tests | why nobody notices |\n|---|---|---|---|---|")
    for each in survivors:
        reason = EXPLAINED.get((each.mutant.operator, each.text), "UNEXPLAINED")
        operator = each.mutant.operator.removeprefix("core/")
        print(f"| {each.mutant.file}:{each.mutant.line} | {operator} | `{each.text}` | {each.tests} | {reason} |")
    judged_ = len(results) - len(explained)
    share = (judged_ - len(survivors) + len(explained)) / max(judged_, 1)
    low, high = interval(judged_ - len(survivors) + len(explained), max(judged_, 1))
    print(f"\nNoticed: {100 * share:.1f} % of those that can be ({100 * low:.1f} to {100 * high:.1f} %)")
    return int(share < LEAST_NOTICED)


def judge_all(mutants: Sequence[Mutant], reached: Reach, jobs: int) -> Iterator[Judged]:
    """Judge every mutant, several at a time."""
    tests = [reached.tests_of(mutant.file, mutant.line) for mutant in mutants]
    with ProcessPoolExecutor(jobs, initializer=_prepare) as pool, ProgressBar("mutants") as bar:
        for number, each in enumerate(pool.map(judged, mutants, tests), 1):
            bar.update(number, len(mutants))
            if not each.is_noticed:
                print(f"survives: {each.mutant.file}:{each.mutant.line}: {each.text}", file=sys.stderr, flush=True)
            yield each


def main() -> int:
    """Draw, run and print."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--rooms", default=",".join(ROOMS), help="some of " + ",".join(ROOMS))
    options.add_argument("--count", type=int, default=500, help="mutants (500)")
    options.add_argument("--date", default=datetime.date.today().isoformat(), help="the sample's seed (today)")
    options.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at a time (the cores)")
    options.add_argument("--map", type=Path, default=ROOT / "build" / "mutation", help="folder of the tests' reach")
    given = options.parse_args()
    rooms = given.rooms.split(",")
    if unknown := [room for room in rooms if room not in ROOMS]:
        options.error(f"there is no room {unknown[0]}; allowed are {', '.join(ROOMS)}")
    mutants = drawn(rooms, given.count, given.date)
    began = time.monotonic()
    reached = reach(given.map)
    code = report(judge_all(mutants, reached, given.jobs))
    print(f"Sample of {given.date}, {len(mutants)} mutants, {(time.monotonic() - began) / 60:.0f} min.")
    return code


if __name__ == "__main__":
    raise SystemExit(main())
