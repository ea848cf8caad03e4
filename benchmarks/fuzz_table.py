"""What the fuzzers of this folder share: their result, and a table with a row for each."""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

HELD_MOST = 4096
"""Bytes that a reader may hold between inputs."""


class Result(NamedTuple):
    """What was accepted, what of it nobody sent, what no reader may hand on, and the most bytes held."""

    accepted: int = 0
    strangers: int = 0
    wrong: int = 0
    held: int = 0


Fuzzer = Callable[[random.Random, int], Result]
Round = Callable[[Fuzzer, random.Random, int], tuple[Result, tuple[str, ...], bool]]
"""Runs a fuzzer for so many inputs: its result, further cells of its row, and whether these are a failure."""


def plainly(fuzz: Fuzzer, rng: random.Random, count: int) -> tuple[Result, tuple[str, ...], bool]:
    """Run the fuzzer and measure nothing else."""
    return fuzz(rng, count), (), False


def print_table(
    fuzzers: Mapping[str, Fuzzer], heads: tuple[str, ...], each_round: Round = plainly, share: float = 1.0
) -> int:
    """Print one line for each fuzzer that the command line asks for; return 1 where one has failed.

    heads: of the columns but the last, the microseconds an input. A round feeds `share` times the inputs asked for.
    """
    options = argparse.ArgumentParser()
    options.add_argument("--inputs", type=int, default=1_000_000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only", choices=sorted(fuzzers))
    arguments = options.parse_args()
    failed = False
    print(f"| {' | '.join((*heads, 'us an input'))} |")
    print("|---" * (len(heads) + 1) + "|")
    for name, fuzz in fuzzers.items():
        if arguments.only not in (None, name):
            continue
        start = time.perf_counter()
        result, more, too_much = each_round(fuzz, random.Random(arguments.seed), arguments.inputs)
        each = (time.perf_counter() - start) / (share * arguments.inputs) * 1e6
        failed = failed or result.wrong > 0 or result.held > HELD_MOST or too_much
        cells = (name, arguments.inputs, *result, *more, f"{each:.0f}")
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
    return int(failed)
