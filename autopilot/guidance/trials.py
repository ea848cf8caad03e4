"""Manoeuvres of trials: when the rudder goes over, when a turn has become steady, when it is enough. Pure.

ITTC 7.5-04-02-01, Full Scale Manoeuvring Trials. Zigzag: rudder to one side; when the heading has changed by psi_e from
the base course, rudder to the other side; and so on. Spiral: rudder angle after angle, each held until the yaw rate is
steady. Pull-out: a steady turn, then the rudder amidships until the rate is steady again.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

from autopilot.angles import wrap

STEADY_POINTS = 64
REGISTER_BITS = 9
TAPS = (9, 5)
"""x^9 + x^5 + 1 is primitive: the sequence repeats after 511 steps (Golomb, Shift Register Sequences, 1967)."""


def zigzag_side(side: int, base: float, heading: float, heading_change: float) -> int:
    """Return the side (+1 starboard, -1 port) the rudder belongs on; angles in rad, `heading_change` > 0."""
    swing = wrap(heading - base)
    if side * swing >= heading_change:
        return -side
    return side


class SteadyRate:
    """Tells when the yaw rate has become steady: the means over both halves of the last `window` [s] differ by less
    than `tolerance` [rad/s]. Memory: about STEADY_POINTS rates.
    """

    def __init__(self, window: float, tolerance: float) -> None:
        self._window = window
        self._tolerance = tolerance
        self._rates: deque[tuple[float, float]] = deque()

    def take(self, now: float, rate: float) -> bool:
        """Take the yaw `rate` [rad/s] at `now` [s]; return whether it is steady."""
        rates = self._rates
        if not rates or now - rates[-1][0] >= self._window / STEADY_POINTS:
            rates.append((now, rate))
        while len(rates) > 2 and now - rates[1][0] >= self._window:
            rates.popleft()
        if now - rates[0][0] < self._window:
            return False
        middle = now - 0.5 * self._window
        early = [one for time, one in rates if time < middle]
        late = [one for time, one in rates if time >= middle]
        if not early or not late:
            return False
        return abs(sum(late) / len(late) - sum(early) / len(early)) < self._tolerance


class Turned:
    """Counts how far [rad] the heading has turned since the first one taken, over as many circles as it takes."""

    def __init__(self) -> None:
        self.angle = 0.0
        self._last: float | None = None

    def take(self, heading: float) -> float:
        """Take a `heading` [rad] and return the angle turned so far, starboard positive."""
        if self._last is not None:
            self.angle += wrap(heading - self._last)
        self._last = heading
        return self.angle


def spiral_angles(largest: float, coarse: float, fine: float) -> list[float]:
    """Return the rudder angles [rad] of a spiral: from `largest` to starboard over amidships to port and back.

    Steps are `coarse` outside twice `coarse` and `fine` inside, where the loop of an unstable boat shows.
    """
    down = [largest]
    while down[-1] > 1.0e-9:
        step = coarse if down[-1] > 2.0 * coarse + 1.0e-9 else fine
        down.append(max(down[-1] - step, 0.0))
    half = [*down, *(-angle for angle in reversed(down[:-1]))]
    return [*half, *reversed(half[:-1])]


def binary_sequence(seed: int) -> Iterator[int]:
    """Yield +1 and -1 of a maximum-length sequence of 511, from the place that `seed` chooses; for ever."""
    register = seed % (2**REGISTER_BITS - 1) + 1
    while True:
        yield 1 if register & 1 else -1
        fed_back = (register >> (REGISTER_BITS - TAPS[0]) ^ register >> (REGISTER_BITS - TAPS[1])) & 1
        register = register >> 1 | fed_back << (REGISTER_BITS - 1)


class BinaryHelm:
    """The side of the rudder in a pseudo-random binary trial: a new one every `hold` [s], and the side that leads back
    while the heading is further than `corridor` [rad] off the base course, until it is within half of it.
    """

    def __init__(self, hold: float, corridor: float, seed: int) -> None:
        self._hold = hold
        self._corridor = corridor
        self._sides = binary_sequence(seed)
        self._until = -math.inf
        self._side = 1
        self._back = 0

    def side(self, now: float, swing: float) -> int:
        """Return +1 (starboard) or -1 at `now` [s], the heading being `swing` [rad] to starboard of the base course."""
        if now >= self._until:
            self._until = now + self._hold
            self._side = next(self._sides)
        if abs(swing) > self._corridor:
            self._back = -1 if swing > 0.0 else 1
        elif abs(swing) < 0.5 * self._corridor:
            self._back = 0
        return self._back or self._side
