"""The whole pilot, and every reader of files, under millions of inputs: two engines, one command.

    python benchmarks/fuzz_everything.py --inputs 100000                       # every target, random damage
    python benchmarks/fuzz_everything.py --only pilot --inputs 1000000 --kept parts.jsonl
    python benchmarks/fuzz_everything.py --only ULog --engine atheris --inputs 50000     # guided by coverage

For the pilot an input is one tick; for a reader it is one file. Random damage: sound inputs cut, joined, doubled, with
bytes and bits changed, put in and taken out, numbers of 5000 digits, infinite or next to nought, and noise. `atheris`
(extra `bench`) watches which branches an input reaches and builds on those that reach new ones; there inputs are
counted as it counts them. Exit code 1 at the first input that a target cannot take, or does not end with; it
is written to fuzz-failure.bin.

`--kept` names a file with a line for every part that is done, and a run that was cut goes on from there. The pilot's
targets need no more than pymavlink and pyyaml, so that PyPy can run them, twice as fast.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import random
import re
import signal
import struct
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from autopilot.errors import InputError
from autopilot.links.base import LinkError

REFUSALS = (InputError, LinkError)
"""How a target refuses its input."""
FAILURE = Path("fuzz-failure.bin")
LONGEST = 1 << 16
HANG_S = 60
"""An input that takes longer than this, where others take milliseconds, has no end."""
PART = 50_000
"""Inputs after which a run is kept."""
INTERESTING = (0, 1, 0x7F, 0x80, 0xFF, 0x0A, 0x2C, 0x2D, 0x3A, 0x22)
NUMBER = re.compile(rb"[+-]?[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?")
STRANGE_NUMBERS = (
    *(b"9" * digits for digits in (12, 20, 39, 310, 400, 5000)),
    *(b"0." + b"0" * digits + b"1" for digits in (20, 330)),
    *(b"1e308", b"1e309", b"-1e309", b"1e999999999", b"5e-324", b"1e-999", b"2.2250738585072011e-308"),
    *(b"inf", b"-Infinity", b"nan", b"NaN", b".inf", b"-0", b"--1", b"+-1", b"1_0", b"0x7fffffffffffffff", b"1e", b"."),
    *(b"18446744073709551616", b"-9223372036854775809", b"2147483648", b"253402300800", b"\xd9\xa3"),
)
"""What stands in the place of a number: too many digits, no end, too near nought, signs, other ways to write."""
STRANGE_TEXTS = (b"\x1b[31m", b"\xe2\x80\xae", b"\xed\xa0\x80", b'"\\ud800"', b"[" * 4000, b"{" * 900, b"\\c:1" * 500)
"""Escape sequences, marks of writing direction, halves of characters, depth."""
STRANGE_WORDS = tuple(
    struct.pack(order + kind, value)
    for order in "<>"
    for kind, values in (
        ("f", (math.nan, math.inf, -math.inf, 1e-45, 3.4e38)),
        ("d", (math.nan, math.inf, -math.inf, 5e-324, 1.7e308)),
        ("Q", (0, 1, 2**63, 2**64 - 1, 253402300800000000)),
        ("i", (-(2**31), 2**31 - 1, -1)),
    )
    for value in values
)
"""The same in binary."""


class Count(NamedTuple):
    """Inputs given, and what a target has to say about them."""

    inputs: int
    taken: int
    remark: str = ""


def damaged(rng: random.Random, seeds: Sequence[bytes]) -> Iterator[bytes]:
    """Yield inputs without end."""
    while True:
        if rng.random() < 0.05:
            yield rng.randbytes(rng.randrange(400))
            continue
        data = bytearray(rng.choice(seeds))
        for _ in range(rng.choice((1, 1, 2, 4, 8, 16))):
            _damage(rng, data, seeds)
        yield bytes(data[:LONGEST])


def _damage(rng: random.Random, data: bytearray, seeds: Sequence[bytes]) -> None:
    """Change one thing."""
    if not data:
        data += rng.randbytes(8)
    place, kind = rng.randrange(len(data)), rng.randrange(11)
    if kind == 0:
        data[place] ^= 1 << rng.randrange(8)
    elif kind == 1:
        data[place] = rng.choice(INTERESTING) if rng.random() < 0.5 else rng.randrange(256)
    elif kind == 2:
        del data[place : place + rng.randrange(1, 32)]
    elif kind == 3:
        data[place:place] = rng.randbytes(rng.randrange(1, 16))
    elif kind == 4:
        data[place:place] = data[place : place + rng.randrange(1, 64)]
    elif kind == 5:
        del data[place:]
    elif kind == 6:
        other = rng.choice(seeds)
        start = rng.randrange(len(other)) if other else 0
        data[place:place] = other[start : start + rng.randrange(1, 200)]
    elif kind == 7:
        data[place : place + 8] = rng.randbytes(min(8, len(data) - place))
    elif kind == 8:
        number = NUMBER.search(data, place)
        at, end = number.span() if number is not None else (place, place)
        data[at:end] = rng.choice(STRANGE_NUMBERS)
    elif kind == 9:
        data[place:place] = rng.choice(STRANGE_TEXTS)
    else:
        word = rng.choice(STRANGE_WORDS)
        data[place : place + len(word)] = word


def names() -> list[str]:
    """Return the names of all targets."""
    from fuzz_file_targets import targets

    return [*pilot_names(), *targets()]


def pilot_names() -> list[str]:
    """Return the names of the pilot's targets."""
    from fuzz_pilot_target import BOATS

    return [f"pilot, {name}" for name in BOATS]


def target_of(name: str) -> tuple[Callable[[bytes], None], Sequence[bytes], Callable[[], int]]:
    """Return a target, its sound inputs, and what counts its inputs, -1 where each call is one."""
    if name.startswith("pilot, "):
        from fuzz_pilot_target import PilotTarget, pilot_seeds

        pilot = PilotTarget(name.removeprefix("pilot, "))
        return pilot, pilot_seeds(), lambda: pilot.steps
    from fuzz_file_targets import targets

    target = targets()[name]
    return target.take, target.seeds, lambda: -1


def run_random(name: str, inputs: int, seed: int, part: int = 0) -> Count:
    """Give a target so many inputs, others in every part; the exception of one that it cannot take goes up."""
    take, seeds, counted = target_of(name)
    rng = random.Random(f"{seed} {name}" + (f" {part}" if part else ""))
    calls = taken = 0
    for data in damaged(rng, seeds):
        calls += 1
        try:
            with must_end(HANG_S):
                take(data)
            taken += 1
        except REFUSALS:
            pass
        except BaseException:
            FAILURE.write_bytes(data)
            raise
        done = counted()
        if (calls if done < 0 else done) >= inputs:
            break
    return Count(calls if counted() < 0 else counted(), taken, remark_of(take))


@contextlib.contextmanager
def must_end(seconds: int) -> Iterator[None]:
    """Raise TimeoutError where the block has not ended after `seconds`: a reader that hangs is found."""

    def late(number: int, frame: object) -> None:
        raise TimeoutError(f"not done after {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def remark_of(take: Callable[[bytes], None]) -> str:
    """Return what a pilot's target has seen, '' of another."""
    states = getattr(take, "states", ())
    if not states:
        return ""
    engaged = 100.0 * take.engaged / max(take.steps, 1)  # type: ignore[attr-defined]
    return f"engaged {engaged:.0f} %, {len(states)} states"


def run_atheris(name: str, inputs: int, seed: int) -> int:
    """Run libFuzzer on a target in this process, which ends here; return what `main` returns where it cannot."""
    try:
        import atheris
    except ImportError:
        print("--engine atheris needs the extra: pip install '.[bench]'", file=sys.stderr)
        return 2
    with atheris.instrument_imports(include=["autopilot", "sitl"]):
        take, seeds, counted = target_of(name)
    folder = Path(f"/tmp/fuzz-seeds-{seed}-{abs(hash(name))}")
    folder.mkdir(exist_ok=True)
    for number, data in enumerate(seeds):
        (folder / f"seed-{number}").write_bytes(data[:LONGEST])

    def one(data: bytes) -> None:
        with contextlib.suppress(*REFUSALS):
            take(data)
        if counted() >= inputs:
            print(f"DONE {counted()} {remark_of(take)}", flush=True)
            sys.stdout.flush()
            import os

            os._exit(0)

    runs = inputs if counted() < 0 else 1 << 30
    options = [f"-runs={runs}", f"-seed={seed}", f"-max_len={LONGEST}", "-print_final_stats=1", str(folder)]
    atheris.Setup([sys.argv[0], *options], one)
    atheris.Fuzz()
    return 0


class Kept:
    """The parts that are done, of this run and, where a file keeps them, of those before it."""

    def __init__(self, path: Path | None, seed: int) -> None:
        self._path, self._seed = path, seed
        lines = path.read_text().splitlines() if path is not None and path.exists() else []
        self._parts = [part for part in map(json.loads, lines) if part["seed"] == seed]

    def parts(self, name: str) -> list[dict[str, Any]]:
        """Return those of one target."""
        return [part for part in self._parts if part["name"] == name]

    def inputs(self, name: str) -> int:
        """Return how many inputs a target has had."""
        return sum(part["inputs"] for part in self.parts(name))

    def run_part(self, name: str, inputs: int) -> None:
        """Run the next part of a target."""
        start = time.process_time()
        count = run_random(name, min(PART, inputs - self.inputs(name)), self._seed, len(self.parts(name)))
        part = {"name": name, "seed": self._seed, **count._asdict(), "seconds": time.process_time() - start}
        self._parts.append(part)
        if self._path is not None:
            with self._path.open("a") as kept:
                print(json.dumps(part), file=kept)

    def row(self, name: str) -> str:
        """Return the row of a target."""
        parts, inputs = self.parts(name), self.inputs(name)
        each = sum(part["seconds"] for part in parts) / max(inputs, 1) * 1e6
        seen = max((part["remark"] for part in parts), key=len, default="")
        return f"| {name} | {inputs} | {sum(part['taken'] for part in parts)} | {seen} | {each:.0f} |"


def main() -> int:
    """Run the targets asked for and print a row of each; 1 where one has failed."""
    options = argparse.ArgumentParser()
    options.add_argument("--inputs", type=int, default=100_000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only", help="a target's name, or how it begins")
    options.add_argument("--engine", choices=("random", "atheris"), default="random")
    options.add_argument("--kept", type=Path)
    arguments = options.parse_args()
    if arguments.engine == "atheris":
        return run_atheris(arguments.only, arguments.inputs, arguments.seed)
    known = pilot_names() if (arguments.only or "").startswith("pilot") else names()
    chosen = [name for name in known if name.startswith(arguments.only or "")]
    if not chosen:
        options.error(f"--only {arguments.only}: allowed are {', '.join(known)}")
    kept = Kept(arguments.kept, arguments.seed)
    while left := [name for name in chosen if kept.inputs(name) < arguments.inputs]:
        for name in left:
            kept.run_part(name, arguments.inputs)
            print(kept.row(name), file=sys.stderr, flush=True)
    print("| target | inputs | taken | what was seen | us an input |")
    print("|---|---|---|---|---|")
    for name in chosen:
        print(kept.row(name))
    return 0


if __name__ == "__main__":
    sys.exit(main())
