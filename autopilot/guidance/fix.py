"""The boat's place, as far as the positions that arrive are to be believed. Pure; the memory is the newest of them."""

from __future__ import annotations

import math

from autopilot.guidance.rhumb import Place, bearing_and_distance
from autopilot.signals import PositionSample

CARRIED_S = 3.0
"""A position is carried on by heading and speed for this long; older ones guide nobody."""
JUMP_LEAST = 30.0
JUMP_SPEED = 5.0
"""Further off than this [m], with what twice the speed or this much more [m/s] explains, must be said twice."""
UNDER_WAY = 0.5
"""Above this speed [m/s] a position that stays the same to the last digit is an instrument that has stopped."""


class Fix:
    """Take every `PositionSample`; what to believe is in `newest`."""

    def __init__(self) -> None:
        self.newest: PositionSample | None = None
        self._doubted: PositionSample | None = None

    def take(self, sample: PositionSample, speed: float) -> None:
        """Take a position, the boat going at `speed` [m/s]; a repeated one is no news, a jump waits for a second."""
        newest = self.newest
        if not (math.isfinite(sample.latitude) and math.isfinite(sample.longitude) and math.isfinite(sample.time)):
            return
        if newest is not None:
            same = (sample.latitude, sample.longitude) == (newest.latitude, newest.longitude)
            if sample.time <= newest.time or (same and abs(speed) > UNDER_WAY):
                return
            if _jumps(newest, sample, speed):
                doubted, self._doubted = self._doubted, sample
                if doubted is None or sample.time <= doubted.time or _jumps(doubted, sample, speed):
                    return
        self.newest, self._doubted = sample, None

    def is_fresh(self, now: float) -> bool:
        """Return whether the place is known well enough to be guided by at `now` [s]."""
        return self.newest is not None and now - self.newest.time <= CARRIED_S

    @property
    def place(self) -> Place:
        """The newest place that is believed; ValueError before the first."""
        if self.newest is None:
            raise ValueError("fix: no position yet")
        return Place(self.newest.latitude, self.newest.longitude)

    def age(self, now: float) -> float:
        """Return for how long [s] the newest position has to be carried on to `now` [s]; 0 before the first."""
        return min(max(now - self.newest.time, 0.0), CARRIED_S) if self.newest is not None else 0.0


def _jumps(before: PositionSample, sample: PositionSample, speed: float) -> bool:
    _, distance = bearing_and_distance(Place(before.latitude, before.longitude), Place(*sample[1:3]))
    quickest = max(2.0 * abs(speed), abs(speed) + JUMP_SPEED)
    return distance > JUMP_LEAST + quickest * (sample.time - before.time)
