"""What is still to be said to a rudder drive: the newest order while it is renewed, or the releases that are left."""

from __future__ import annotations

import math
from collections.abc import Callable

from autopilot.signals import RudderCommand

RELEASES = 5
"""A release is said so often: one telegram may be lost, and nothing follows that would mend it."""
RELEASE_SPACING_S = 0.1
ORDER_AGE_S = 1.0
"""An order that is not renewed for this long is no longer repeated: whoever gave it has stopped, and the drive stops by
its own timeout."""


class StandingOrder:
    """The order of a drive link, said every `order_period` [s]; after it a release, every `release_period` [s]."""

    def __init__(self, order_period: float, release_period: float) -> None:
        self._order_period, self._release_period = order_period, release_period
        self._angle: float | None = None
        self._given = math.nan
        self._next_order = self._next_release = -math.inf
        self._releases_left = 0

    @property
    def angle(self) -> float | None:
        """The rudder ordered [rad], or None after a release."""
        return self._angle

    def take(self, now: float, command: RudderCommand) -> float | None:
        """Take the newest command and return `angle`; one that is not engaged, or not finite, is a release."""
        if command.engaged and math.isfinite(command.angle):
            self._angle, self._given, self._releases_left = command.angle, now, RELEASES
        else:
            self._angle = None
        return self._angle

    def say(self, now: float, write: Callable[[float | None], bool]) -> None:
        """Call `write` with the order, or with None for a release, where one is due.

        A release that `write` could not pass on (False) stays to be said; an order does not, a newer one follows.
        """
        if self._angle is not None and now - self._given <= ORDER_AGE_S:
            if now >= self._next_order:
                self._next_order = now + self._order_period
                write(self._angle)
        elif self._angle is None and self._releases_left and now >= self._next_release:
            self._next_release = now + self._release_period
            self._releases_left -= write(None)

    def end(self) -> int:
        """Forget the order and return how many releases are to be said at once: none where none is owed."""
        owed = max(self._releases_left, 1) if self._angle is not None or self._releases_left else 0
        self._angle, self._releases_left = None, 0
        return owed
