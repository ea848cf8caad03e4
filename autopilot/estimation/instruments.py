"""What instruments say, believed as far as they deserve: which speed is followed, and how compass and gyro err.

Which speed the model and the gains follow: that through the water, and over the ground only half the way.

K ~ U and T ~ 1/U, so a loop designed for the ratio s of the trial's speed has (U/s)^2 times the gain that it was
designed for where the boat goes at the ratio U. A loop bears an error of two either way; with a third of the true speed
it swings for ever. Speed over the ground is the speed through the water and a current that nobody knows. Of two claims,
that the boat goes as fast as the ground says, s, and that it goes as in the trial, 1, the geometric mean sqrt(s) is
wrong by sqrt(s) at most, whichever is true. A rudder steers by the way ahead: where the course over the ground is known
too, drift and a stream across are taken out. s counts for no less than STREAM_LEAST, so that this is 1.7 against a
current of two thirds of the boat's speed, and more. Where log and ground differ by more than SPEEDS_APART, one of them
is wrong or the current is strong, and the mean of both is taken in the same way. A speed that the boat's own turns have
proven wrong (`autopilot.supervision.rudder_watch`) is not gone by at all.

How compass and rate sensor err, learnt on the way: the rate sensor's standing error, and the noise of both.

x = (psi, g): the measured rate w carries the heading, psi' = w - g, and g' = 0 + noise; a compass shows psi. A Kalman
filter of two states on measurements alone: no model of boat or rudder is in it, so that neither wind nor a wrong model
is taken for an error of the gyro, nor the other way round. Sensors that lag, deviate or are read at different moments
lie apart by an angle that goes with the rate of turn, for which a heading counts for less in a turn. Where they drift
apart all the same, the heading is begun anew and g is looked for again: an angle that stays is none of a gyro's.

Noise is what an instrument's successive innovations v go back and forth by, d(k) = v(k) - v(k-1). With the innovation's
variance P + R, P what the filter does not know of the boat, white innovations have E[-d(k) d(k-1)] = P + R, so

    R += share (-d(k) d(k-1) - P - R),

and what lies to one side for longer, or comes and stays, wind, a wrong model, a lag, counts for nothing. R is at least
the file's: an instrument that seems better than that may be damped, and its errors no white noise.

Source: the complementary filter of compass and gyro with the gyro's bias as a state, Farrell 2008, Aided Navigation,
section 10.3; noise by what innovations correlate with those before, Mehra 1970; scalar code over NamedTuples, which
campaigns compile as it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.estimation.tuning import (
    NOISE_MEMORY,
    NOISE_MOST,
    RATE_BIAS_APART,
    RATE_BIAS_CHANGE,
    RATE_BIAS_UNKNOWN,
    RATE_COMPASS_LAG,
    RATE_HELD,
    RATE_MEAN_TIME,
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
        return self.ground.value if share != share else self.ground.value * (share if share > 0.0 else 0.0)

    @property
    def is_over_ground(self) -> bool:
        """Whether nothing but a speed over the ground is known."""
        water, ground = self.water.value, self.ground.value
        return water != water and ground == ground


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


class RateBias(NamedTuple):
    """What is known of g at `time` [s], the newest heading having come at `seen` [s].

    heading [rad]: psi, nan before the first; rate [rad/s]: the newest w, nan where there is no rate sensor, of the time
    `rated` [s]; bias [rad/s]: g; p00 [rad^2], p01, p11 [(rad/s)^2]: the covariance of both; apart [rad]: how far the
    compass is from psi on the average of late; turning [rad/s]: how fast the boat turned of late.
    """

    time: float
    heading: float
    rate: float
    bias: float
    p00: float
    p01: float
    p11: float
    apart: float
    turning: float
    seen: float
    rated: float


NO_RATE_BIAS = RateBias(-math.inf, math.nan, math.nan, 0.0, 0.0, 0.0, RATE_BIAS_UNKNOWN, 0.0, 0.0, -math.inf, -math.inf)
"""Before the first rate: it is supposed to be right, within what such sensors are off."""


def rate_bias_step(before: RateBias, measured: tuple[float, float, float], noise: tuple[float, float]) -> RateBias:
    """Return what is known after a heading [rad] and a rate [rad/s] at a time [s], nan where they were not measured.

    noise: the variances of a heading [rad^2] and of a rate [(rad/s)^2].
    """
    (time, heading, rate), (of_heading, of_rate) = measured, noise
    last, psi, held, bias, p00, p01, p11, apart, turning, seen, rated = before
    is_rate, is_held = rate == rate, time - rated <= RATE_HELD  # what is no number is not itself
    if not (is_held or is_rate):
        # headings alone say nothing of a gyro that is silent, or refused
        return before
    dt = time - last
    rate, rated = (rate, time) if is_rate else (held, rated)
    if not is_held or dt < 0.0 or psi != psi:
        # g outlasts a gap, and is known as well as before it
        return RateBias(time, heading, rate, bias, of_heading, 0.0, p11, 0.0, turning, time, rated)
    mean = 0.5 * (held + rate)
    psi += dt * (mean - bias)
    turned = mean - bias if mean > bias else bias - mean
    turning -= math.expm1(-dt / RATE_MEAN_TIME) * (turned - turning)
    p00 += dt * (dt * (p11 + of_rate) - 2.0 * p01)
    p01 -= dt * p11
    p11 += RATE_BIAS_CHANGE * dt
    if heading != heading:
        psi = psi if -PI < psi <= PI else wrap(psi)
        return RateBias(time, psi, rate, bias, p00, p01, p11, apart, turning, seen, rated)
    off = heading - psi
    off = off if -PI < off <= PI else wrap(off)
    lag = RATE_COMPASS_LAG * turning
    apart -= math.expm1(-(time - seen) / RATE_MEAN_TIME) * (off - apart)
    if apart * apart > RATE_BIAS_APART + of_heading + 4.0 * lag * lag:
        p11 = p11 if p11 > RATE_BIAS_UNKNOWN else RATE_BIAS_UNKNOWN
        return RateBias(time, heading, rate, bias, of_heading, 0.0, p11, 0.0, turning, time, rated)
    total = p00 + of_heading + lag * lag
    k0, k1 = p00 / total, p01 / total
    psi += k0 * off
    psi = psi if -PI < psi <= PI else wrap(psi)
    bias += k1 * off
    return RateBias(time, psi, rate, bias, p00 - k0 * p00, p01 - k0 * p01, p11 - k1 * p01, apart, turning, time, rated)


Noise = tuple[float, float, float, float]
"""An instrument's noise: its variance R, 0 before anything is known; the newest innovation, by how much it was more
than the one before, nan where none came shortly before, and its time [s]."""

NO_NOISE: Noise = (0.0, 0.0, math.nan, -math.inf)
"""Before the first measurement."""


def noise_step(before: Noise, filed: float, innovation: float, unknown: float, time: float, longest: float) -> Noise:
    """Return what is known of the noise after an `innovation` at `time` [s], of whose variance `unknown` is the boat's;
    filed: the variance that the file says. Two innovations further apart than `longest` [s] say nothing of it."""
    known, last, back, seen = before
    known, most = known if known > filed else filed, NOISE_MOST * NOISE_MOST * filed
    gap = time - seen
    if not 0.0 < gap <= longest:
        forth = math.nan
    else:
        forth = innovation - last
        if back == back:
            known -= math.expm1(-gap / NOISE_MEMORY) * (-forth * back - unknown - known)
    known = filed if known < filed else most if known > most else known
    return known, innovation, forth, time
