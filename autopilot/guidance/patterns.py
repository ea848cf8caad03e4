"""Turn patterns: a heading that moves with the way made good through the water, or with the turn so far. Pure.

A pattern says by how much the heading should have changed from where it began, as a function of the distance gone s
[m] and the angle turned [rad, unwrapped]; side is +1 to starboard, -1 to port:

    U turn       side min(pi, turned + lead)
    circle       side s / R
    spiral       side theta, with s = R theta + G theta^2 / (4 pi): the radius changes by G each turn
    zigzag       side a on even legs of length L, -side a on odd ones
    square       side pi/2 after each leg of length L
    S            swings of side a to -side a and back, along arcs of radius R

A boat that cannot turn as sharply turns as sharply as it can: the order never leads its heading by more than `LEAD`,
so that the short way round stays the way of the pattern.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from autopilot.angles import shortest_turn, wrap

LEAD = math.radians(90.0)
DT_MOST = 2.0
LEAST_GROWTH = 0.01
"""A spiral that changes its radius by less [m] is a circle."""


class Progress(NamedTuple):
    """Since a pattern began: gone [m], turned [rad] to starboard."""

    gone: float
    turned: float


Pattern = Callable[[Progress], float]
"""The change of heading [rad] to starboard that is wanted."""


def u_turn(side: int, angle: float = math.pi) -> Pattern:
    """Return a turn by `angle` [rad] to one side, the long way round where it is more than half a circle."""
    return lambda progress: side * min(angle, side * progress.turned + LEAD)


def circle(side: int, radius: float) -> Pattern:
    """Return a circle of `radius` [m] that does not end."""
    return lambda progress: side * progress.gone / radius


def spiral(side: int, radius: float, growth: float) -> Pattern:
    """Return a circle whose radius changes by `growth` [m] each turn; it ends, straight, when no radius is left."""
    if abs(growth) < LEAST_GROWTH:
        return circle(side, radius)

    def wanted(progress: Progress) -> float:
        root = math.sqrt(max(radius * radius + growth * progress.gone / math.pi, 0.0))
        return side * (root - radius) * 2.0 * math.pi / growth

    return wanted


def zigzag(side: int, angle: float, leg: float) -> Pattern:
    """Return legs of `leg` [m], each at `angle` [rad] to one side or the other of where it began."""
    return lambda progress: side * angle * (1.0 if int(progress.gone / leg) % 2 == 0 else -1.0)


def square(side: int, leg: float) -> Pattern:
    """Return legs of `leg` [m] with a turn of 90 degrees after each."""
    return lambda progress: side * 0.5 * math.pi * int(progress.gone / leg)


def s_curve(side: int, angle: float, radius: float) -> Pattern:
    """Return swings of `angle` [rad] to both sides along arcs of `radius` [m]."""

    def wanted(progress: Progress) -> float:
        # a triangle of period 4 angle: up to the angle, down to its opposite, and back
        along = (progress.gone / radius + angle) % (4.0 * angle)
        return side * (min(along, 4.0 * angle - along) - angle)

    return wanted


def _straight(_: Progress) -> float:
    return 0.0


class PatternGuide:
    """Leads through a pattern. Memory: where it began, how far the boat has gone and turned.

    Attributes:
        following: whether it leads.
    """

    def __init__(self) -> None:
        self._pattern: Pattern = _straight
        self.leave()

    def follow(self, pattern: Pattern) -> None:
        """Begin a pattern at the heading that is."""
        self.leave()
        self._pattern, self.following = pattern, True

    def leave(self) -> None:
        """Lead no longer."""
        self.following = False
        self._pattern = _straight
        self._base: float | None = None
        self._heading = 0.0
        self._gone = self._turned = 0.0
        self._now = 0.0

    def course(self, now: float, heading: float, speed: float) -> float:
        """Return the heading [rad] to steer at `now` [s], with the boat on `heading` [rad] at `speed` [m/s]."""
        if self._base is None:
            self._base = self._heading = heading
            self._now = now
        self._gone += abs(speed) * min(max(now - self._now, 0.0), DT_MOST)
        self._turned += shortest_turn(self._heading, heading)
        self._heading, self._now = heading, now
        wanted = self._pattern(Progress(self._gone, self._turned))
        return wrap(self._base + min(max(wanted, self._turned - LEAD), self._turned + LEAD))
