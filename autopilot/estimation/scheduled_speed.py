"""Which speed the model and the gains follow: that through the water, and over the ground only half the way.

K ~ U and T ~ 1/U, so a loop designed for the ratio s of the trial's speed has (U/s)^2 times the gain that it was
designed for where the boat goes at the ratio U. A loop bears an error of two either way; with a third of the true speed
it swings for ever. Speed over the ground is the speed through the water and a current that nobody knows. Of two claims,
that the boat goes as fast as the ground says, s, and that it goes as in the trial, 1, the geometric mean sqrt(s) is
wrong by sqrt(s) at most, whichever is true. s counts for no less than STREAM_LEAST, so that this is 1.7 against a
current of two thirds of the boat's speed, and more. Where log and ground differ by more than APART, one of them is
wrong or the current is strong, and the mean of both is taken in the same way. A speed that the boat's own turns have
proven wrong (`autopilot.monitors.answer`) is not gone by at all.
"""

from __future__ import annotations

import math

from autopilot.signals import SpeedSample

SPEED_SMOOTHING = 2.0
SPEED_FRESH = 10.0
"""A speed is smoothed over the first time [s]; one that nobody confirms for the second is no reason to go on steering a
slow boat's gains."""
STREAM_LEAST = 1.0 / 3.0
APART = 2.0
STREAM_MOST = 2.5
"""No stream that is sailed in makes this difference [m/s, 5 kn] between log and ground: one of the two is wrong."""


class _Smoothed:
    """One kind of speed, smoothed. value [m/s]: None where there is no fresh one."""

    def __init__(self) -> None:
        self.value: float | None = None
        self._time = math.nan

    def on_sample(self, now: float, speed: float) -> None:
        if self.value is None:
            self.value = speed
        else:
            share = 1.0 - math.exp(-max(now - self._time, 0.0) / SPEED_SMOOTHING)
            self.value += share * (speed - self.value)
        self._time = now

    def forget_stale(self, now: float) -> None:
        if self.value is not None and now - self._time >= SPEED_FRESH:
            self.value = None


class ScheduledSpeed:
    """Speeds through the water and over the ground, and what is made of them."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._water, self._ground = _Smoothed(), _Smoothed()

    def on_sample(self, now: float, sample: SpeedSample) -> None:
        """Take a speed at `now` [s]."""
        (self._ground if sample.over_ground else self._water).on_sample(now, sample.speed)

    def forget_stale(self, now: float) -> None:
        """Forget what is too old at `now` [s]."""
        self._water.forget_stale(now)
        self._ground.forget_stale(now)

    @property
    def over_ground(self) -> bool:
        """Whether nothing but a speed over the ground is known."""
        return self._water.value is None and self._ground.value is not None

    @property
    def measured(self) -> float | None:
        """The speed [m/s] to be shown: through the water, else over the ground; None where there is none."""
        return self._water.value if self._water.value is not None else self._ground.value

    @property
    def apart(self) -> float:
        """How far log and ground lie apart [m/s] where no stream explains it; 0 where one does."""
        water, ground = self._water.value, self._ground.value
        if water is None or ground is None or not _are_apart(abs(water), abs(ground)):
            return 0.0
        difference = abs(abs(water) - abs(ground))
        return difference if difference > STREAM_MOST else 0.0

    def followed(self, reference_speed: float) -> float | None:
        """Return the speed [m/s] for model and gains, None where none is known; `reference_speed` [m/s]: the trial's.

        ValueError for a reference speed that is not positive.
        """
        if not reference_speed > 0.0:
            raise ValueError(f"the reference speed must be positive, got {reference_speed}")
        water, ground = self._water.value, self._ground.value
        if water is None:
            return None if ground is None else _half_way(ground, reference_speed)
        # astern and at a standstill the ground says nothing about a log
        if ground is None or water <= 0.0 or not _are_apart(water, abs(ground)):
            return water
        return _half_way(min(water, abs(ground)), max(water, abs(ground)))


def _are_apart(one: float, other: float) -> bool:
    return max(one, other) > APART * min(one, other)


def _half_way(low: float, high: float) -> float:
    return math.sqrt(max(abs(low), STREAM_LEAST * high) * high)
