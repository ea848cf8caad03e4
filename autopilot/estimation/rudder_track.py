"""Where the rudder is and was: the steering-gear model under the orders given, set right by feedback.

    delta(t) = fed back(t_f) + gear(t) - gear(t_f)

so that feedback, which is late and sparse, corrects the level, and the model adds the motion since. Without
feedback the model stands alone. Memory: the last `KEPT` ticks.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque

from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step

KEPT = 256
FEEDBACK_FRESH = 2.0
"""Feedback older than this [s] is not believed any more."""


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
        self._times: deque[float] = deque(maxlen=KEPT)
        self._gears: deque[float] = deque(maxlen=KEPT)
        self._angles: deque[float] = deque(maxlen=KEPT)
        self._feedback: tuple[float, float] | None = None

    def reconfigure(self, gear: SteeringGear) -> None:
        """Go on with another steering gear; a changed delay forgets the orders that were still on their way."""
        if gear.delay != self._gear.delay:
            effective = self._line.newest
            self._line = DelayLine(gear.delay, effective)
        self._gear = gear

    @property
    def angle(self) -> float:
        """Newest estimate [rad]."""
        return self._angles[-1] if self._angles else 0.0

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
        if self._times:
            dt = now - self._times[-1]
            if dt <= 0.0:
                return self._angles[-1]
            self._modelled = gear_step(self._gear, self._modelled, self._line.effective(now), dt)
        angle = self._modelled
        if self._feedback is not None and self.is_known(now):
            angle += self._feedback[1] - self._modelled_at(self._feedback[0])
        self._times.append(now)
        self._gears.append(self._modelled)
        self._angles.append(angle)
        return angle

    def _modelled_at(self, time: float) -> float:
        if not self._times or time >= self._times[-1]:
            return self._modelled
        return self._gears[max(bisect_right(self._times, time) - 1, 0)]

    def held(self, start: float, end: float, grain: float) -> list[tuple[float, float]]:
        """Return (until [s], angle [rad]) from `start` to `end` [s], oldest first.

        Neighbours that together last no longer than `grain` [s] are given as one, with their mean angle.
        """
        if end <= start:
            return []
        times, angles = self._times, self._angles
        if not times or start >= times[-1]:
            return [(end, angles[-1] if angles else 0.0)]
        parts: list[tuple[float, float]] = []
        begun = at = start
        turned = 0.0
        for index in range(max(bisect_right(times, start) - 1, 0), len(times)):
            until = min(times[index + 1], end) if index + 1 < len(times) else end
            if until <= at:
                continue
            if until - begun > grain and at > begun:
                parts.append((at, turned / (at - begun)))
                begun, turned = at, 0.0
            turned += (until - at) * angles[index]
            at = until
            if at >= end:
                break
        parts.append((end, turned / (end - begun)))
        return parts
