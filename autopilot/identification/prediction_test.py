"""Two models of a boat predict its heading side by side, stretch by stretch, from the rudder alone.

What else pushes the boat, each model finds for itself: beside each runs a filter (`live_filter`) whose boat is the
model's, and which knows gusts and trim only. A stretch begins with its rate, its gust, which dies away, and its trim,
which stays, so that wind counts for neither model and what is left to tell them apart is what the rudder does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.identification.live_filter import GUST_TIME_S, LiveFilter, Push, moved_on
from autopilot.models.norrbin import Norrbin

AHEAD_TIME_CONSTANTS, AHEAD_SHORTEST_S, AHEAD_LONGEST_S = 4.0, 3.0, 30.0
"""A stretch is this many time constants long, within these limits: long enough for the models to differ."""

LONGEST_GAP_S = 2.0
LEAST_RUDDER_RANGE_RAD, LEAST_TURNED_RAD = math.radians(3.0), math.radians(8.0)
"""A stretch in which rudder or boat turned less tells nothing of either model: a rudder that only answers gusts, so
that nothing turns, would speak for the model on which it does least."""
SETTLES = 2.0
"""Stretches' worth of time in which the filters find gust and trim."""


class Outcome(NamedTuple):
    """Heading errors [rad] at a stretch's end: of the present model and of the other."""

    present: float
    other: float


class _Side:
    """A model, its filter, and its boat since the stretch began: rate [rad/s] and angle turned [rad]."""

    def __init__(self, model: Norrbin) -> None:
        self.model = model._replace(n0=0.0)
        self.filter = LiveFilter(model, held=True)
        self.motion, self.push = (0.0, 0.0), Push(0.0, 0.0)

    def begin(self) -> None:
        """Start a stretch."""
        self.motion, self.push = (self.filter.rate, 0.0), self.filter.push

    def move(self, ratio: float, dt: float, since: float, rudders: tuple[float, float]) -> None:
        """Go on `dt` [s], `since` [s] after the stretch began, from one rudder [rad] to the other."""
        a = self.model.gain / self.model.time_constant
        fading = math.exp(-(since + 0.5 * dt) / GUST_TIME_S)
        extra = (self.push.gust * fading / max(ratio, 0.2) ** 2 + self.push.trim) / a
        self.motion = moved_on(self.model, ratio, self.motion, dt, (rudders[0] + extra, rudders[1] + extra))


class PredictionTest:
    """Feed it with `update`; it answers at the end of each stretch that tells something. Constant memory."""

    def __init__(self, present: Norrbin, other: Norrbin) -> None:
        longest = max(present.time_constant, other.time_constant)
        self.ahead = min(max(AHEAD_TIME_CONSTANTS * longest, AHEAD_SHORTEST_S), AHEAD_LONGEST_S)
        self._sides = _Side(present), _Side(other)
        self._at = self._settled = -math.inf
        self._rudder = self._heading = 0.0
        self._begun: float | None = None
        self._turned = self._least = self._most = self._port = self._starboard = 0.0

    def update(self, time: float, rudder: float, ratio: float, heading: float, rate: float | None) -> Outcome | None:
        """Take a sample as `LiveFilter.update` does, always with a heading; return the outcome at a stretch's end."""
        for side in self._sides:
            side.filter.update(time, rudder, ratio, heading, rate)
        dt = time - self._at
        outcome = None
        if not 0.0 < dt <= LONGEST_GAP_S:
            self._begun, self._settled = None, time + SETTLES * self.ahead
        elif self._begun is not None:
            self._turned += wrap(heading - self._heading)
            for side in self._sides:
                side.move(ratio, dt, self._at - self._begun, (self._rudder, rudder))
            self._least, self._most = min(self._least, rudder), max(self._most, rudder)
            self._port, self._starboard = min(self._port, self._turned), max(self._starboard, self._turned)
            if time - self._begun >= self.ahead:
                outcome = self._end()
        if self._begun is None and time >= self._settled:
            self._begun, self._turned = time, 0.0
            self._least = self._most = rudder
            self._port = self._starboard = 0.0
            for side in self._sides:
                side.begin()
        self._at, self._rudder, self._heading = time, rudder, heading
        return outcome

    def _end(self) -> Outcome | None:
        self._begun = None
        if self._most - self._least < LEAST_RUDDER_RANGE_RAD or self._starboard - self._port < LEAST_TURNED_RAD:
            return None
        present, other = (side.motion[1] - self._turned for side in self._sides)
        return Outcome(present, other)
