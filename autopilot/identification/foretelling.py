"""Two models foretell the same boat, stretch after stretch, from the rudder alone."""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, rate_step

AHEAD_TIME_CONSTANTS, AHEAD_SHORTEST_S, AHEAD_LONGEST_S = 4.0, 3.0, 30.0
"""A stretch is this many time constants long, within these limits: long enough for the models to differ."""

LONGEST_GAP_S = 2.0
LEAST_RUDDER_RANGE_RAD = math.radians(3.0)
"""A stretch in which the rudder moved less tells nothing of either model."""

SETTLING_S = 1.0
"""The rate that a stretch begins with is the mean over this time, or over a share of T where that is shorter."""


class Outcome(NamedTuple):
    """Heading errors [rad] at a stretch's end: of the present model and of the other."""

    present: float
    other: float


class _Boat:
    """A model's boat since the stretch began: rate [rad/s] and angle turned through [rad]."""

    def __init__(self, model: Norrbin) -> None:
        self.model = model
        self.rate = self.turned = 0.0

    def begin(self, rate: float) -> None:
        self.rate, self.turned = rate, 0.0

    def move(self, dt: float, before: float, rudder: float, ratio: float) -> None:
        model = at_speed_ratio(self.model, max(ratio, SPEED_FLOOR_RATIO))
        steps = math.ceil(2.0 * dt / model.time_constant)
        for step in range(steps):
            was, angle = self.rate, before + (rudder - before) * (step + 0.5) / steps
            moved = rate_step(model, was, angle, dt / steps)
            self.rate = min(max(moved, -3.0), 3.0) if moved == moved else 0.0
            self.turned += 0.5 * dt / steps * (was + self.rate)


class Foretelling:
    """Feed it with `update`; it answers at the end of each stretch that tells something. Constant memory."""

    def __init__(self, present: Norrbin, other: Norrbin) -> None:
        longest = max(present.time_constant, other.time_constant)
        self.ahead = min(max(AHEAD_TIME_CONSTANTS * longest, AHEAD_SHORTEST_S), AHEAD_LONGEST_S)
        self._settling = min(SETTLING_S, 0.5 * min(present.time_constant, other.time_constant))
        self._boats = _Boat(present), _Boat(other)
        self._at = -math.inf
        self._rudder = self._heading = self._rate = 0.0
        self._begun: float | None = None
        self._turned = 0.0
        self._least = self._most = 0.0

    def update(
        self, time: float, rudder: float, ratio: float, heading: float, rate: float | None, moved_by: float
    ) -> Outcome | None:
        """Take a sample as `IntegralWindow.update` does, always with a heading; return the outcome at a stretch's end.

        moved_by [rad]: the rudder without its answers to waves, which decides whether a stretch tells something.

        Both boats begin a stretch with the rate measured, smoothed over a moment, or with the heading's slope.
        """
        dt = time - self._at
        if not 0.0 < dt <= LONGEST_GAP_S:
            self._begun = None
            self._rate = rate or 0.0
            self._remember(time, rudder, heading)
            return None
        turned = wrap(heading - self._heading)
        share = dt / max(dt, self._settling)
        self._rate += share * ((turned / dt if rate is None else rate) - self._rate)
        outcome = None
        if self._begun is not None:
            self._turned += turned
            for boat in self._boats:
                boat.move(dt, self._rudder, rudder, ratio)
            self._least, self._most = min(self._least, moved_by), max(self._most, moved_by)
            if time - self._begun >= self.ahead:
                outcome = self._end()
        if self._begun is None:
            self._begin(time, moved_by)
        self._remember(time, rudder, heading)
        return outcome

    def _remember(self, time: float, rudder: float, heading: float) -> None:
        self._at, self._rudder, self._heading = time, rudder, heading

    def _begin(self, time: float, moved_by: float) -> None:
        self._begun, self._turned = time, 0.0
        self._least = self._most = moved_by
        for boat in self._boats:
            boat.begin(self._rate)

    def _end(self) -> Outcome | None:
        self._begun = None
        if self._most - self._least < LEAST_RUDDER_RANGE_RAD:
            return None
        present, other = (boat.turned - self._turned for boat in self._boats)
        return Outcome(present, other)
