"""Turn patterns as they are ordered: at the terminal (`p circle + 60`) or by number over MAVLink, checked alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.guidance import patterns
from autopilot.guidance.patterns import Pattern
from autopilot.order_values import SHOWN, typed_number
from autopilot.printable import printable

PATTERN_HELP = (
    "p u +: U turn to starboard (-: port)  p circle + M  p spiral + M M  p zigzag + DEG M  p square + M  p s + DEG M"
)


class Size(NamedTuple):
    """A number a pattern takes, in metres or degrees."""

    name: str
    unit: str
    low: float
    high: float


RADIUS = Size("radius", "m", 1.0, 10000.0)
GROWTH = Size("change of radius each turn", "m", -1000.0, 1000.0)
ANGLE = Size("angle", "deg", 1.0, 90.0)
LEG = Size("leg", "m", 1.0, 100000.0)

KINDS: dict[str, tuple[tuple[Size, ...], Callable[..., Pattern]]] = {
    "u": ((), patterns.u_turn),
    "circle": ((RADIUS,), patterns.circle),
    "spiral": ((RADIUS, GROWTH), patterns.spiral),
    "zigzag": ((ANGLE, LEG), patterns.zigzag),
    "square": ((LEG,), patterns.square),
    "s": ((ANGLE, RADIUS), patterns.s_curve),
}
"""In the order of their numbers over MAVLink, from 0."""


def pattern_of(kind: str, side: float, sizes: Sequence[float]) -> Pattern:
    """Return a pattern to one side (1 starboard, -1 port) with its sizes in metres and degrees. Raises InputError."""
    if kind not in KINDS:
        raise InputError(f"pattern {printable(repr(kind), SHOWN)}: allowed are {', '.join(KINDS)}")
    if side not in (1.0, -1.0):
        raise InputError(f"pattern {kind}: the side is + (starboard) or - (port)")
    takes, make = KINDS[kind]
    if len(sizes) < len(takes):
        raise InputError(f"pattern {kind}: give {' and '.join(f'{size.name} [{size.unit}]' for size in takes)}")
    for size, value in zip(takes, sizes, strict=False):
        if not size.low <= value <= size.high:
            raise InputError(
                f"pattern {kind}: {size.name} {value:g}, allowed is {size.low:g} to {size.high:g} {size.unit}"
            )
    given = [math.radians(value) if size.unit == "deg" else value for size, value in zip(takes, sizes, strict=False)]
    return make(int(side), *given)


def pattern_typed(text: str) -> Pattern:
    """Return the pattern of a typed line, like `circle + 60`. Raises InputError."""
    kind, *rest = text.split() or [""]
    side = {"+": 1.0, "-": -1.0}.get(rest[0], 0.0) if rest else 0.0
    try:
        sizes = [typed_number(word) for word in rest[1:]]
    except InputError as error:
        raise InputError(f"pattern: {error}; {PATTERN_HELP}") from None
    if kind in KINDS and len(sizes) > len(KINDS[kind][0]):
        raise InputError(f"pattern {kind}: too many numbers; {PATTERN_HELP}")
    return pattern_of(kind, side, sizes)
