"""Where the rudder is and was: the steering-gear model under the orders given, set right by feedback.

    delta(t) = fed back(t_f) + gear(t) - gear(t_f)

so that feedback, which is late and sparse, corrects the level, and the model adds the motion since. Without
feedback the model stands alone. Memory: the last `KEPT` ticks.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step

KEPT = 256
FEEDBACK_FRESH = 2.0
"""Feedback older than this [s] is not believed any more."""


class Ring(Protocol):
    """A list here, an array where runs are compiled."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> float: ...


class RudderPast(NamedTuple):
    """Rudder angles [rad] from their times [s] on, in rings: tick n, of `ticks` so far, is at n modulo their length.

    The length is a power of two, so that n & (length - 1) is that place, for which no division is needed. The rings
    begin with zeros: before the first tick the rudder is amidships.
    """

    times: Ring
    angles: Ring
    ticks: int


def held(past: RudderPast, start: float, end: float, grain: float) -> Iterator[tuple[float, float]]:
    """Yield (until [s], angle [rad]) from `start` to `end` [s], oldest first; see `stretch`."""
    at, tick = start, tick_at(past, start)
    while at < end:
        at, angle, tick = stretch(past, tick, at, end, grain)
        yield at, angle


def stretch(past: RudderPast, tick: int, begun: float, end: float, grain: float) -> tuple[float, float, int]:
    """Return until when [s], `end` at most, the rudder stood as at `begun` [s], its angle [rad] and that time's tick.

    tick: that of `begun`. Neighbours that together last no longer than `grain` [s] are one, with their mean angle.
    """
    times, angles, newest, ring = past.times, past.angles, past.ticks - 1, len(past.times) - 1
    if newest < 0 or begun >= times[newest & ring]:
        return end, angles[newest & ring], newest
    at, turned = begun, 0.0
    while at < end:
        until = min(times[(tick + 1) & ring], end) if tick < newest else end
        if until > at:
            if until - begun > grain and at > begun:
                break
            turned += (until - at) * angles[tick & ring]
            at = until
        if at < end:
            tick += 1
    return at, turned / (at - begun), tick


def tick_at(past: RudderPast, time: float) -> int:
    """Return the newest tick at or before `time` [s], or the oldest that is known."""
    tick, ring = past.ticks - 1, len(past.times) - 1
    oldest = max(past.ticks - ring - 1, 0)
    while tick > oldest and past.times[tick & ring] > time:
        tick -= 1
    return tick


def angle_at(past: RudderPast, time: float) -> float:
    """Return the rudder's angle [rad] at `time` [s]; 0 where none is known."""
    return past.angles[tick_at(past, time) & (len(past.times) - 1)]


class RudderTrack:
    """Rudder angle over the recent past, piecewise constant between ticks."""

    def __init__(self, gear: SteeringGear) -> None:
        self._gear = gear
        self._line = DelayLine(gear.delay)
        self.reset()

    def reset(self) -> None:
        """Forget everything: rudder amidships."""
        self._line.reset()
        self._modelled = 0.0
        self._times = [0.0] * KEPT
        self._gears = [0.0] * KEPT
        self._angles = [0.0] * KEPT
        self._ticks = 0
        self._feedback: tuple[float, float] | None = None

    def reconfigure(self, gear: SteeringGear) -> None:
        """Go on with another steering gear; a changed delay forgets the orders that were still on their way."""
        if gear.delay != self._gear.delay:
            effective = self._line.newest
            self._line = DelayLine(gear.delay, effective)
        self._gear = gear

    @property
    def past(self) -> RudderPast:
        """Where the rudder was."""
        return RudderPast(self._times, self._angles, self._ticks)

    @property
    def angle(self) -> float:
        """Newest estimate [rad]."""
        return self._angles[(self._ticks - 1) & (KEPT - 1)]

    def is_known(self, now: float) -> bool:
        """Return whether feedback at `now` [s] says where the rudder is, whoever moves it."""
        return self._feedback is not None and now - self._feedback[0] < FEEDBACK_FRESH

    def feed_back(self, time: float, angle: float) -> None:
        """Take a measured `angle` [rad], measured at `time` [s]; older than the newest one is ignored."""
        if self._feedback is None or time >= self._feedback[0]:
            self._feedback = (time, angle)

    def order(self, now: float, order: float) -> None:
        """Take the `order` [rad] that left for the steering gear at `now` [s]."""
        self._line.give(now, order)

    def advance(self, now: float) -> float:
        """Move the model to `now` [s] and return the estimate [rad]."""
        if self._ticks:
            dt = now - self._times[(self._ticks - 1) & (KEPT - 1)]
            if dt <= 0.0:
                return self.angle
            self._modelled = gear_step(self._gear, self._modelled, self._line.effective(now), dt)
        angle = self._modelled
        if self._feedback is not None and self.is_known(now):
            angle += self._feedback[1] - self._modelled_at(self._feedback[0])
        place = self._ticks & (KEPT - 1)
        self._times[place], self._gears[place], self._angles[place] = now, self._modelled, angle
        self._ticks += 1
        return angle

    def _modelled_at(self, time: float) -> float:
        if not self._ticks or time >= self._times[(self._ticks - 1) & (KEPT - 1)]:
            return self._modelled
        return self._gears[tick_at(self.past, time) & (KEPT - 1)]

    def held(self, start: float, end: float, grain: float) -> list[tuple[float, float]]:
        """Return what `held` yields of this rudder's past."""
        return list(held(self.past, start, end, grain))
