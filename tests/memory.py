"""How much memory a call takes, as Python's allocator counts it."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import NamedTuple, TypeVar

T = TypeVar("T")


class Taken(NamedTuple):
    """Bytes: at the most, and at the end, where what the call returned is still held."""

    peak: int
    kept: int


def measured(call: Callable[[], T]) -> tuple[T, Taken]:
    """Return what a call returns, and the memory that it takes. What is loaded once counts, too: call it before."""
    tracemalloc.start()
    try:
        result = call()
        kept, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return result, Taken(peak, kept)
