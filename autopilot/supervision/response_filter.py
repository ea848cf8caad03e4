"""What the rudder-response monitor supposes of boat, sea and slide: the filter that its evidence comes from.

State (psi, r, p, w): psi' = r, T r' = K (a delta + p + w) - lambda r. p [rad of rudder] is wind, trim and a rudder that
stands anywhere, a random walk; w [rad of rudder] is the sea, w' = -w/tau + white noise. lambda = n1 + n2 r + n3 r^2 at
the rate that is, so that the answers to the rudder and to all else add up. A compass shows psi.

A hull also slides: sway, and the way that it loses as it turns, brake it in a long turn by up to a few times what the
model's damping is worth. That is one more input, the own damping delayed as the slide is (`slide_step`), times a share
c >= 0. c is estimated over a time constant, with a prior of variance U^2 about zero; and U^2 itself is what the boat
has shown: of both = sum y g/v and squares = sum g^2/v, y = c g + noise of variance v, E[both^2] = c^2 squares^2 +
squares, half of it where both > 0. So a boat that has sailed a turn without a slide has no share for one (an empirical
Bayes estimate, Robbins 1956). A slide comes after the turn has begun: what a turn shows counts SLIDE_LASTS time
constants later.

Scalar functions over NamedTuples, compiled by `sitl.compiled` as they are. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import shortest_turn
from autopilot.estimation.tuning import SLIDE_LASTS, SLIDE_UNKNOWN, WAVE_FREQUENCY_LEAST
from autopilot.models.norrbin import Norrbin
from autopilot.signals import NavState
from autopilot.supervision.tuning import (
    ANSWERS_MOST,
    CHANGED_LEAST,
    CHANGED_TIME,
    FADES_TIME,
    OWN_UNKNOWN,
    PUSH_CHANGE,
    ROUGH,
    ROUGH_TIME,
    SEA_LASTS,
    SEA_LEAST,
    SEA_SLOWEST,
    SEA_TURNED,
    SEA_UNMET,
    SLIDE_SURE,
    USUAL_TIME,
)

SEA_KNOWN_S = 2.0 * math.pi / WAVE_FREQUENCY_LEAST
"""One period of the longest wave that is estimated [s]: before, how large the sea is is not known, and it looks like a
push."""
STEEPEST = 20.0
"""The growth of a course-unstable boat over one step is cut at exp of this."""


Transition = tuple[float, float, float, float, float]
"""turn, drift, decay, gain, kept: psi += turn r + drift u, r = decay r + gain u, w = kept w; u: rudder, push, sea."""
Covariance = tuple[float, float, float, float, float, float, float, float, float, float]
"""p00, p01, p02, p03, p11, p12, p13, p22, p23, p33: the upper triangle, common to all suppositions about the rudder; i
and j count psi, r, p, w."""
Gains = tuple[float, float, float, float, float]
"""The variance [rad^2] of a heading's innovation, and what psi, r, p and w take of it."""


class Noise(NamedTuple):
    """heading [rad^2]; densities a second of acceleration [(rad/s)^2/s] and push [rad^2/s]; sea [rad^2] about zero,
    which changes at its pace [1/s]; unmet [rad^2]: by so much it may be larger, as it is not known yet."""

    heading: float
    acceleration: float
    push: float
    sea: float
    pace: float
    unmet: float


Mean = tuple[float, float, float, float]
"""psi [rad], r [rad/s], p [rad], w [rad]."""

NOTHING: Mean = (0.0, 0.0, 0.0, 0.0)
RATE_UNKNOWN = 0.2**2
PUSH_UNKNOWN = math.radians(20.0) ** 2
"""Variances of a rate [(rad/s)^2] and a push [rad^2] of which nothing is known."""
Means = tuple[Mean, Mean, Mean, Mean, Mean]
"""Of the heading without a rudder [rad], and of what adds to it: the rudder, a late one, what brakes a boat that
slides, a slow rudder."""


class Seaway(NamedTuple):
    """What a boat has met: at `time` [s], nan: nothing yet, `swing` [rad] the largest yaw by waves of the last
    SEA_LASTS, `north` and `east` the mean of the headings of the last SEA_KNOWN_S, as unit vectors; `begun` [s]:
    since when it is estimated."""

    time: float
    swing: float
    north: float
    east: float
    begun: float


NO_SEAWAY = Seaway(math.nan, 0.0, 0.0, 0.0, math.nan)


def seaway_step(before: Seaway, time: float, heading: float, swing: float) -> Seaway:
    """Return what has been met by `time` [s] with waves that yaw the boat by `swing` [rad] on a `heading` [rad]."""
    north, east = math.cos(heading), math.sin(heading)
    last, largest, mean_north, mean_east, begun = before
    if last != last:
        return Seaway(time, swing, north, east, begun if begun == begun else time)
    kept = math.exp(-(time - last) / SEA_KNOWN_S)
    largest *= math.exp(-(time - last) / SEA_LASTS)
    return Seaway(
        time,
        largest if largest > swing else swing,
        north + kept * (mean_north - north),
        east + kept * (mean_east - east),
        begun,
    )


def counts_as_course(seaway: Seaway, now: float, holds_course: bool) -> bool:
    """Return whether a rudder is judged at `now` [s] as on a course that is held: in a turn too as long as it is not
    known how large the sea is, which may be what keeps the boat from turning."""
    return holds_course or not now - seaway.begun >= SEA_KNOWN_S


def sea_of(model: Norrbin, swing: float, pace: float) -> float:
    """Return the sea [rad^2 of rudder] that yaws the boat by `swing` [rad] at its pace [1/s]."""
    yaw, lag = swing * pace / model.gain, pace * model.time_constant
    sea = yaw * yaw * (1.0 + lag * lag)
    return sea if sea > SEA_LEAST else SEA_LEAST


def seaway_noise(model: Norrbin, heading: float, state: NavState, seaway: Seaway, worked: float, unmet: float) -> Noise:
    """Return the noise of a boat in this `state`, with a compass of `heading` [rad^2]; where it has turned away from
    where the sea was estimated, of that one, the largest that has been met, and one that nobody has met yet, at the
    slowest pace, the one that pushes hardest. A sea from right ahead or astern turns no boat, until it leaves that
    course.

    worked [rad^2]: the mean square of a rudder that works against the sea. The yaw that is left is less than the sea is
    worth then, and the rudder of a boat that is quicker than the waves makes up for it. unmet: see `Noise`.
    """
    drive, frequency = model.gain / model.time_constant, state.wave_frequency
    pace = frequency if frequency > SEA_SLOWEST else SEA_SLOWEST
    sea = sea_of(model, state.wave_deviation, pace)
    swing = seaway.swing if seaway.swing > SEA_UNMET else SEA_UNMET
    largest = sea_of(model, swing, SEA_SLOWEST)
    if largest > sea and abs(shortest_turn(math.atan2(seaway.east, seaway.north), state.heading)) > SEA_TURNED:
        sea, pace = largest, SEA_SLOWEST
    return Noise(heading, drive * drive * ROUGH * ROUGH_TIME, PUSH_CHANGE, sea + worked, pace, unmet)


def changing_noise(model: Norrbin, noise: Noise, rate: float, speed: float) -> Noise:
    """Return the noise of a boat that turns at `rate` [rad/s] and goes at another speed than the `speed` [m/s] of late.

    n3 ~ 1/U^2 and n2 ~ 1/U, and a speed that is measured late or seldom is off by what it has changed by: a boat that
    loses way in a hard turn is braked by more than its rudder, and turns slower against it. What a course-unstable boat
    does by itself nearly balances its rudder in a slow turn, and a little of it decides which way it goes.
    """
    change, own = abs(model.reference_speed / speed - 1.0), 0.0
    if model.n1 < 0.0:
        own = OWN_UNKNOWN * abs(model.n1 * rate)
    elif change < CHANGED_LEAST:
        return noise
    unknown = (own + change * abs((2.0 * model.n3 * rate + model.n2) * rate * rate)) / model.time_constant
    acceleration = noise.acceleration + unknown * unknown * CHANGED_TIME
    return Noise(noise.heading, acceleration, noise.push, noise.sea, noise.pace, noise.unmet)


Slide = tuple[float, float, float, float, float, float]
"""What a boat has shown of its slide: both, squares, lately, lately_sure, shown, sure. both and squares: sums of what
is left over times the slide's answer, and of the answer's square, over the variance, of a time constant; lately and
lately_sure: sums for the share's mean square and its weight, of a turn that may be going on; shown and sure: of those
before."""
NO_SLIDE: Slide = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def slide_share(slide: Slide) -> float:
    """Return how many times its own damping the boat is braked by."""
    (both, squares, _, _, shown, sure), prior = slide, SLIDE_SURE * SLIDE_SURE
    usual = (shown + SLIDE_UNKNOWN * SLIDE_UNKNOWN * prior) / (sure + prior)
    return 0.0 if usual <= 0.0 or both <= 0.0 else both * usual / (squares * usual + 1.0)


def slide_learnt(before: Slide, model: Norrbin, seen: tuple[float, float, float], dt: float, learns: bool) -> Slide:
    """Return what is known after a heading of which the answers but the slide's leave so much [rad], the slide's own
    answer being so large [rad], with a variance [rad^2] of the innovation: `seen`. learns: nothing is suspect."""
    left, answer, variance = seen
    both, squares, lately, lately_sure, shown, sure = before
    changes = model.time_constant if model.time_constant < FADES_TIME else FADES_TIME
    fresh = -math.expm1(-dt / changes)
    both += left * answer / variance - fresh * both
    squares += answer * answer / variance - fresh * squares
    if not learns:
        return both, squares, lately, lately_sure, shown, sure
    # half of white noise lies to the side that is no slide
    square = both * both if both > 0.0 else 0.0
    passed, remembered = -math.expm1(-dt / (SLIDE_LASTS * model.time_constant)), math.exp(-dt / USUAL_TIME)
    return (
        both,
        squares,
        lately - passed * lately + fresh * (square - 0.5 * squares),
        lately_sure - passed * lately_sure + fresh * squares * squares,
        remembered * shown + passed * lately,
        remembered * sure + passed * lately_sure,
    )


def transition_of(model: Norrbin, rate: float, pace: float, dt: float) -> Transition:
    """Return the transition over `dt` [s] of a boat that turns at about `rate` [rad/s] in a sea of that pace [1/s]."""
    boat_gain, time_constant, n3, n2, n1, _, _ = model
    slope = n1 + (n2 + n3 * rate) * rate
    x = slope * dt / time_constant
    x = x if x > -STEEPEST else -STEEPEST
    lost = -math.expm1(-x)
    once, twice = (1.0 - 0.5 * x, 0.5) if -1.0e-3 < x < 1.0e-3 else (lost / x, (x - lost) / (x * x))
    drive = boat_gain * dt / time_constant
    return dt * once, drive * dt * twice, 1.0 - lost, drive * once, math.exp(-pace * dt)


def foreseen(
    step: Transition,
    known: Covariance,
    means: Means,
    rudders: tuple[float, float, float, float],
    noises: tuple[float, float, float, float],
    dt: float,
) -> tuple[Covariance, Gains, Covariance, Means]:
    """Return the covariance before the next heading, F P F' + Q, how much that is believed, the covariance after it,
    and the means before it, `dt` [s] after the last. rudders [rad]: since then; noises: heading, acceleration, push and
    sea, as `Noise` has them."""
    heading, acceleration, push, sea = noises
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = known
    turn, drift, decay, gain, kept = step
    push_and_sea, of_sea = p22 + p23, p23 + p33
    pushes = p12 + p13
    a01 = p01 + turn * p11 + drift * pushes
    a02 = p02 + turn * p12 + drift * push_and_sea
    a03 = p03 + turn * p13 + drift * of_sea
    a12 = decay * p12 + gain * push_and_sea
    a13 = decay * p13 + gain * of_sea
    q = acceleration * dt
    before = (
        p00 + turn * p01 + drift * (p02 + p03) + turn * a01 + drift * (a02 + a03) + q * dt * dt / 3.0,
        decay * a01 + gain * (a02 + a03) + 0.5 * q * dt,
        a02,
        kept * a03,
        decay * (decay * p11 + gain * pushes) + gain * (a12 + a13) + q,
        a12,
        kept * a13,
        p22 + push * dt,
        kept * p23,
        kept * kept * p33 + (1.0 - kept * kept) * sea,
    )
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = before
    variance = p00 + heading
    k0, k1, k2, k3 = p00 / variance, p01 / variance, p02 / variance, p03 / variance
    after = (
        p00 - k0 * p00,
        p01 - k0 * p01,
        p02 - k0 * p02,
        p03 - k0 * p03,
        p11 - k1 * p01,
        p12 - k1 * p02,
        p13 - k1 * p03,
        p22 - k2 * p02,
        p23 - k2 * p03,
        p33 - k3 * p03,
    )
    return before, (variance, k0, k1, k2, k3), after, all_moved(step, means, rudders)


def all_moved(step: Transition, means: Means, rudders: tuple[float, float, float, float]) -> Means:
    """Return the means a step later: of the heading without a rudder, and of what each of the held `rudders` [rad]
    adds. Written out, as each mean would be one call more."""
    (psi, r, p, w), (psi_1, r_1, p_1, w_1), (psi_2, r_2, p_2, w_2), (psi_3, r_3, p_3, w_3), (psi_4, r_4, p_4, w_4) = (
        means
    )
    u_1, u_2, u_3, u_4 = rudders
    turn, drift, decay, gain, kept = step
    u, u_1, u_2, u_3, u_4 = p + w, u_1 + p_1 + w_1, u_2 + p_2 + w_2, u_3 + p_3 + w_3, u_4 + p_4 + w_4
    return (
        (psi + turn * r + drift * u, decay * r + gain * u, p, kept * w),
        (psi_1 + turn * r_1 + drift * u_1, decay * r_1 + gain * u_1, p_1, kept * w_1),
        (psi_2 + turn * r_2 + drift * u_2, decay * r_2 + gain * u_2, p_2, kept * w_2),
        (psi_3 + turn * r_3 + drift * u_3, decay * r_3 + gain * u_3, p_3, kept * w_3),
        (psi_4 + turn * r_4 + drift * u_4, decay * r_4 + gain * u_4, p_4, kept * w_4),
    )


def all_corrected(gains: Gains, means: Means, innovation: float) -> Means:
    """Return the means after a heading that was `innovation` [rad] off what it would be without a rudder: the gains are
    the same for all, and so each answer is the smaller by its own part of what is explained."""
    (psi, r, p, w), (psi_1, r_1, p_1, w_1), (psi_2, r_2, p_2, w_2), (psi_3, r_3, p_3, w_3), (psi_4, r_4, p_4, w_4) = (
        means
    )
    _, k0, k1, k2, k3 = gains
    return (
        (psi + k0 * innovation, r + k1 * innovation, p + k2 * innovation, w + k3 * innovation),
        (psi_1 - k0 * psi_1, r_1 - k1 * psi_1, p_1 - k2 * psi_1, w_1 - k3 * psi_1),
        (psi_2 - k0 * psi_2, r_2 - k1 * psi_2, p_2 - k2 * psi_2, w_2 - k3 * psi_2),
        (psi_3 - k0 * psi_3, r_3 - k1 * psi_3, p_3 - k2 * psi_3, w_3 - k3 * psi_3),
        (psi_4 - k0 * psi_4, r_4 - k1 * psi_4, p_4 - k2 * psi_4, w_4 - k3 * psi_4),
    )


def first_means(heading: float) -> Means:
    """Return the means after the first `heading` [rad]."""
    return (heading, 0.0, 0.0, 0.0), NOTHING, NOTHING, NOTHING, NOTHING


def first_covariance(heading: float, sea: float) -> Covariance:
    """Return the covariance after the first heading of that variance [rad^2] in a `sea` [rad^2]."""
    return heading, 0.0, 0.0, 0.0, RATE_UNKNOWN, 0.0, 0.0, PUSH_UNKNOWN, 0.0, sea


def unlike(off: float, s: float, s_slow: float, opposite: float) -> float:
    """Return the square [rad^2] of what is left of a heading that is so far `off` by that share of the answer `s` which
    explains most, of the opposite one no more than `opposite`, or by a slow rudder's, which is no gust either."""
    ahead, size = (-off, -s) if s < 0.0 else (off, s)
    least, most = -opposite * size, ANSWERS_MOST * size
    left = ahead - least if ahead < least else ahead - most if ahead > most else 0.0
    by_slow = off - s_slow
    return left * left if left * left < by_slow * by_slow else by_slow * by_slow
