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
    oldest [s]: the time of what has not been confirmed for longest.
    """

    water: Smoothed = NO_SPEED
    ground: Smoothed = NO_SPEED
    throttle: Smoothed = NO_SPEED
    reach: float = math.inf
    ahead: Smoothed = NO_SPEED
    oldest: float = math.inf

    @property
    def ground_ahead(self) -> float:
        """The speed over the ground [m/s] that is way ahead; all of it where no course is known."""
        share = self.ahead.value
        return self.ground.value if share != share else self.ground.value * (share if share > 0.0 else 0.0)

    @property
    def is_over_ground(self) -> bool:
        """Whether nothing but a speed over the ground is known."""
        water, ground = self.water.value, self.ground.value
        return water != water and ground == ground


def with_speed(speeds: Speeds, now: float, sample: SpeedSample | ThrustSample) -> Speeds:
    """Return the speeds after a sample that came at `now` [s]."""
    if isinstance(sample, ThrustSample):
        return _dated(speeds._replace(throttle=Smoothed(sample.throttle, now), reach=sample.reach))
    if sample.over_ground:
        return _dated(speeds._replace(ground=smoothed(speeds.ground, now, sample.speed)))
    return _dated(speeds._replace(water=smoothed(speeds.water, now, sample.speed)))


def with_course(speeds: Speeds, now: float, drift: float) -> Speeds:
    """Return the speeds after a course over the ground that came at `now` [s], `drift` [rad] off the heading."""
    return _dated(speeds._replace(ahead=smoothed(speeds.ahead, now, math.cos(drift))))


def _dated(speeds: Speeds) -> Speeds:
    water, ground, throttle, _, ahead, _ = speeds
    # a time that is nan is of what is not known anyway
    times = [each.time for each in (water, ground, throttle, ahead) if each.time == each.time]
    return speeds._replace(oldest=min(times, default=math.inf))


def while_fresh(speeds: Speeds, now: float) -> Speeds:
    """Return the speeds at `now` [s] without what nobody has confirmed for long."""
    water, ground, throttle, reach, ahead, _ = speeds
    stale = now - SPEED_FRESH
    return _dated(
        Speeds(
            NO_SPEED if water.time <= stale else water,
            NO_SPEED if ground.time <= stale else ground,
            NO_SPEED if throttle.time <= stale else throttle,
            math.inf if throttle.time <= stale else reach,
            NO_SPEED if ahead.time <= stale else ahead,
        )
    )


def measured_speed(speeds: Speeds) -> float:
    """Return the speed [m/s] to be shown: through the water, else over the ground; nan where there is none."""
    return speeds.ground.value if math.isnan(speeds.water.value) else speeds.water.value


def share_ahead(speeds: Speeds) -> float:
    """Return the share of the speed that is shown which is way ahead: of one over the ground, what is no drift.

    It is also the share of the model's K/T that drift leaves a rudder where only the ground tells the speed: the model
    is for half way from the way ahead, s cos b, to the trial's speed, K/T ~ U^2, and b turns boats.
    """
    share = speeds.ahead.value
    if share != share or not speeds.is_over_ground:  # what is no number is not itself
        return 1.0
    return share if share > 0.0 else 0.0


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
