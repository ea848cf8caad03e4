"""The whole pilot, and every reader of files, under millions of inputs: two engines, one command.

    python benchmarks/fuzz_everything.py --inputs 100000                       # every target, random damage
    python benchmarks/fuzz_everything.py --only "pilot, backstepping" --inputs 1000000
    python benchmarks/fuzz_everything.py --only ULog --engine atheris --inputs 50000     # guided by coverage

For the pilot an input is one tick; for a reader it is one file. Random damage: sound inputs cut, joined, doubled, with
bytes and bits changed, put in and taken out, and noise. `atheris` (extra `bench`) watches which branches an input
reaches and builds on those that reach new ones; there inputs are counted as it counts them. Exit code 1 at the first
input that a target cannot take, which is written to fuzz-failure.bin.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

FAILURE = Path("fuzz-failure.bin")
LONGEST = 1 << 16
INTERESTING = (0, 1, 0x7F, 0x80, 0xFF, 0x0A, 0x2C, 0x2D, 0x3A, 0x22)


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
    place, kind = rng.randrange(len(data)), rng.randrange(8)
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
    else:
        data[place : place + 8] = rng.randbytes(min(8, len(data) - place))


def names() -> list[str]:
    """Return the names of all targets."""
    from fuzz_file_targets import targets
    from fuzz_pilot_target import LAWS

    return [*(f"pilot, {law}" for law in LAWS), *targets()]


def target_of(name: str) -> tuple[Callable[[bytes], None], Sequence[bytes], Callable[[], int]]:
    """Return a target, its sound inputs, and what counts its inputs, -1 where each call is one."""
    from fuzz_file_targets import pilot_seeds, targets
    from fuzz_pilot_target import PilotTarget

    if name.startswith("pilot, "):
        pilot = PilotTarget(name.removeprefix("pilot, "))
        return pilot, pilot_seeds(), lambda: pilot.steps
    target = targets()[name]
    return target.take, target.seeds, lambda: -1


def run_random(name: str, inputs: int, seed: int) -> Count:
    """Give a target so many inputs; the exception of one that it cannot take goes up."""
    from fuzz_file_targets import REFUSALS

    take, seeds, counted = target_of(name)
    rng = random.Random(f"{seed} {name}")
    calls = taken = 0
    for data in damaged(rng, seeds):
        calls += 1
        try:
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
        print("--engine atheris needs the extra: pip install 'norrbin[bench]'", file=sys.stderr)
        return 2
    with atheris.instrument_imports(include=["autopilot", "sitl"]):
        from fuzz_file_targets import REFUSALS

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


def main() -> int:
    """Run the targets asked for and print a row of each; 1 where one has failed."""
    options = argparse.ArgumentParser()
    options.add_argument("--inputs", type=int, default=100_000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only")
    options.add_argument("--engine", choices=("random", "atheris"), default="random")
    arguments = options.parse_args()
    if arguments.engine == "atheris":
        return run_atheris(arguments.only, arguments.inputs, arguments.seed)
    chosen = names()
    if arguments.only is not None and arguments.only not in chosen:
        options.error(f"--only {arguments.only}: allowed are {', '.join(chosen)}")
    print("| target | inputs | taken | what was seen | us an input |")
    print("|---|---|---|---|---|")
    for name in chosen if arguments.only is None else [arguments.only]:
        start = time.perf_counter()
        count = run_random(name, arguments.inputs, arguments.seed)
        each = (time.perf_counter() - start) / count.inputs * 1e6
        print(f"| {name} | {count.inputs} | {count.taken} | {count.remark} | {each:.0f} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
