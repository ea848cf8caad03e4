"""Which speed the model and the gains follow: that through the water, and over the ground only half the way.

K ~ U and T ~ 1/U, so a loop designed for the ratio s of the trial's speed has (U/s)^2 times the gain that it was
designed for where the boat goes at the ratio U. A loop bears an error of two either way; with a third of the true speed
it swings for ever. Speed over the ground is the speed through the water and a current that nobody knows. Of two claims,
that the boat goes as fast as the ground says, s, and that it goes as in the trial, 1, the geometric mean sqrt(s) is
wrong by sqrt(s) at most, whichever is true. A rudder steers by the way ahead: where the course over the ground is known
too, drift and a stream across are taken out. s counts for no less than STREAM_LEAST, so that this is 1.7 against a
current of two thirds of the boat's speed, and more. Where log and ground differ by more than SPEEDS_APART, one of them
is wrong or the current is strong, and the mean of both is taken in the same way. A speed that the boat's own turns have
proven wrong (`autopilot.supervision.rudder_watch`) is not gone by at all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.estimation.tuning import (
    SPEED_FRESH,
    SPEED_RATIO_MOST,
    SPEED_SMOOTHING,
    SPEEDS_APART,
    STREAM_LEAST,
    STREAM_MOST,
)
from autopilot.models.drives import RUDDER_LAW, DriveLaw, at_point
from autopilot.models.norrbin import Norrbin, at_speed
from autopilot.models.steering_gear import clip
from autopilot.signals import SpeedSample, ThrustSample


class Smoothed(NamedTuple):
    """One kind of speed, smoothed [m/s], and the time [s] of its newest sample; nan where there is no fresh one."""

    value: float = math.nan
    time: float = math.nan


def smoothed(before: Smoothed, now: float, speed: float) -> Smoothed:
    """Return the smoothed speed after a `speed` [m/s] that came at `now` [s]."""
    if math.isnan(before.value):
        return Smoothed(speed, now)
    share = 1.0 - math.exp(-max(now - before.time, 0.0) / SPEED_SMOOTHING)
    return Smoothed(before.value + share * (speed - before.value), now)


NO_SPEED = Smoothed()


class Speeds(NamedTuple):
    """Speed through the water and over the ground; and what the drive is given, beside which it works.

    throttle [share of full] and reach [rad] as the newest ThrustSample has them, not smoothed: thrust follows at once.
    ahead: the share of the speed over the ground that is ahead rather than across, by the course over the ground.
    """

    water: Smoothed = NO_SPEED
    ground: Smoothed = NO_SPEED
    throttle: Smoothed = NO_SPEED
    reach: float = math.inf
    ahead: Smoothed = NO_SPEED

    @property
    def ground_ahead(self) -> float:
        """The speed over the ground [m/s] that is way ahead; all of it where no course is known."""
        share = self.ahead.value
        return self.ground.value if math.isnan(share) else self.ground.value * (share if share > 0.0 else 0.0)

    @property
    def is_over_ground(self) -> bool:
        """Whether nothing but a speed over the ground is known."""
        return math.isnan(self.water.value) and not math.isnan(self.ground.value)


def with_speed(speeds: Speeds, now: float, sample: SpeedSample | ThrustSample) -> Speeds:
    """Return the speeds after a sample that came at `now` [s]."""
    if isinstance(sample, ThrustSample):
        return Speeds(speeds.water, speeds.ground, Smoothed(sample.throttle, now), sample.reach, speeds.ahead)
    if sample.over_ground:
        return Speeds(speeds.water, smoothed(speeds.ground, now, sample.speed), *speeds[2:])
    return Speeds(smoothed(speeds.water, now, sample.speed), *speeds[1:])


def with_course(speeds: Speeds, now: float, drift: float) -> Speeds:
    """Return the speeds after a course over the ground that came at `now` [s], `drift` [rad] off the heading."""
    return speeds._replace(ahead=smoothed(speeds.ahead, now, math.cos(drift)))


def while_fresh(speeds: Speeds, now: float) -> Speeds:
    """Return the speeds at `now` [s] without what nobody has confirmed for long."""
    water, ground, throttle, reach, ahead = speeds
    _, of_water = water
    _, of_ground = ground
    _, of_throttle = throttle
    _, of_course = ahead
    # a time that is nan is of what is not known anyway
    oldest = now - SPEED_FRESH
    if not (of_water <= oldest or of_ground <= oldest or of_throttle <= oldest or of_course <= oldest):
        return speeds
    return Speeds(
        NO_SPEED if of_water <= oldest else water,
        NO_SPEED if of_ground <= oldest else ground,
        NO_SPEED if of_throttle <= oldest else throttle,
        math.inf if of_throttle <= oldest else reach,
        NO_SPEED if of_course <= oldest else ahead,
    )


def measured_speed(speeds: Speeds) -> float:
    """Return the speed [m/s] to be shown: through the water, else over the ground; nan where there is none."""
    return speeds.ground.value if math.isnan(speeds.water.value) else speeds.water.value


def way_ahead(speeds: Speeds, speed: float) -> float:
    """Return how much of the `speed` [m/s] that is shown is way ahead: of one over the ground, what is no drift."""
    return speeds.ground_ahead if speeds.is_over_ground else speed


def left_by_drift(speeds: Speeds) -> float:
    """Return the share of the model's K/T that drift leaves a rudder where only the ground tells the speed, 1 without
    it: the model is for half way from the way ahead, s cos b, to the trial's speed, K/T ~ U^2, and b turns boats."""
    share = speeds.ahead.value
    return share if 0.0 < share < 1.0 and speeds.is_over_ground else 1.0


def speeds_apart(speeds: Speeds) -> float:
    """Return how far log and ground lie apart [m/s] where no stream explains it; 0 where one does."""
    if math.isnan(speeds.water.value) or math.isnan(speeds.ground.value):
        return 0.0
    water, ground = abs(speeds.water.value), abs(speeds.ground.value)
    if not _are_apart(water, ground):
        return 0.0
    return abs(water - ground) if abs(water - ground) > STREAM_MOST else 0.0


def scheduled_speed(speeds: Speeds, reference_speed: float) -> float:
    """Return the speed [m/s] for model and gains, nan where none is known; `reference_speed` [m/s]: what is to be
    expected of the speed through the water, the trial's where no throttle tells.

    ValueError for a reference speed that is not positive.
    """
    if not reference_speed > 0.0:
        raise ValueError("the reference speed must be positive")
    water, ground = speeds.water.value, speeds.ground_ahead
    if math.isnan(water):
        return ground if math.isnan(ground) else _half_way(ground, reference_speed)
    # astern and at a standstill the ground says nothing about a log
    if math.isnan(ground) or water <= 0.0 or not _are_apart(water, abs(ground)):
        return water
    return _half_way(min(water, abs(ground)), max(water, abs(ground)))


def _are_apart(one: float, other: float) -> bool:
    return max(one, other) > SPEEDS_APART * min(one, other)


def _half_way(low: float, high: float) -> float:
    return math.sqrt(max(abs(low), STREAM_LEAST * high) * high)


def model_at(reference: Norrbin, speed: float, law: DriveLaw = RUDDER_LAW, throttle: float = math.nan) -> Norrbin:
    """Return the model at the scheduled `speed` [m/s], the trial's where it is nan, and `throttle` [share of full]."""
    speed = reference.reference_speed if math.isnan(speed) and not law.is_rudder else speed
    if math.isnan(speed):
        return reference
    most = SPEED_RATIO_MOST * reference.reference_speed
    held = clip(speed, -most, most)
    return at_speed(reference, held) if law.is_rudder else at_point(law, reference, held, throttle)
