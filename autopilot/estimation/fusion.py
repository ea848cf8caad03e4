"""One measurement taken into the filter: what it leaves of the boat's state, and of how compass and gyro err.

A heading that lies too far from what is expected is a spike, and left out, unless the boat can have turned so far since
the measurement before, or the rate of turn beside it shows that it has; a rate that no rudder makes is none. What
lies to one side for seconds, or leans to it for the time of gusts, pushes the boat, and the bias is quick meanwhile.

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
from autopilot.estimation.disturbance import FilterNoise, Noises, Sea, frequency, raised_intensity, reset_density
from autopilot.estimation.heading_ekf import FilterState, fused, innovations, predict, predict_mean
from autopilot.estimation.rudder_observer import RudderPast, angle_at
from autopilot.estimation.tuning import (
    BIAS_MOST,
    GATE_LASTS,
    GATE_LEAST,
    GATE_PATIENCE,
    GATE_SIGMAS,
    GRAIN_SHARE,
    INNOVATION_LASTING,
    INNOVATION_MEAN_TIME,
    INNOVATION_MOST,
    LEAN_SIGMAS,
    LEARNT,
    LONGEST_SHARE,
    NOISE_GAP,
    NOISE_MEMORY,
    NOISE_MOST,
    PREDICT_LONGEST,
    RATE_BIAS_APART,
    RATE_BIAS_CHANGE,
    RATE_BIAS_FELT,
    RATE_BIAS_UNKNOWN,
    RATE_COMPASS_LAG,
    RATE_HELD,
    RATE_MEAN_TIME,
    UNLEARNT_TIME,
    WAVE_MEMORY_FIRST,
)
from autopilot.models.norrbin import Norrbin
from autopilot.signals import NavState
from autopilot.supervision.tuning import TURN_GAINED

White = tuple[float, float, float, float]
"""The headings' own noise, whatever g is: how far [rad] the newest was from psi, and by how much more than the one
before it, nan where none came shortly before; the variance [rad^2], and of how many changes of that."""
NO_WHITE: White = (math.nan, math.nan, 0.0, 0.0)


def white_step(before: White, off: float, gap: float, supposed: float) -> White:
    """Return what is known of the noise after a heading that is `off` [rad], a `gap` [s] after the one before.

    A sixth of the mean square of second differences, of all there are at first, and of one of which nothing is known:
    that may be NOISE_MOST times as noisy as is `supposed` [rad^2].
    """
    last, change, known, count = before
    more = off - last
    if change != change:
        return off, more, known, count
    known = known if count > 0.0 else NOISE_MOST * NOISE_MOST * supposed
    count += 1.0
    of_late, share = -math.expm1(-gap / NOISE_MEMORY), 1.0 / (count + 1.0)
    share = of_late if of_late > share else share
    return off, more, known + share * ((more - change) * (more - change) / 6.0 - known), count


class RateBias(NamedTuple):
    """What is known of g at `time` [s], the newest heading having come at `seen` [s].

    heading [rad]: psi, nan before the first; rate [rad/s]: the newest w, nan where there is no rate sensor, of the time
    `rated` [s]; bias [rad/s]: g; p00 [rad^2], p01, p11 [(rad/s)^2]: the covariance of both; apart [rad]: how far the
    compass is from psi on the average of late; turning [rad/s]: how fast the boat turned of late; white: see `White`.
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
    white: White = NO_WHITE


NO_RATE_BIAS = RateBias(-math.inf, math.nan, math.nan, 0.0, 0.0, 0.0, RATE_BIAS_UNKNOWN, 0.0, 0.0, -math.inf, -math.inf)
"""Before the first rate: it is supposed to be right, within what such sensors are off."""


def rate_bias_step(before: RateBias, measured: tuple[float, float, float], noise: tuple[float, float]) -> RateBias:
    """Return what is known after a heading [rad] and a rate [rad/s] at a time [s], nan where they were not measured.

    noise: the variances of a heading [rad^2] and of a rate [(rad/s)^2].
    """
    (time, heading, rate), (of_heading, of_rate) = measured, noise
    last, psi, held, bias, p00, p01, p11, apart, turning, seen, rated, white = before
    is_rate, is_held = rate == rate, time - rated <= RATE_HELD  # what is no number is not itself
    if not (is_held or is_rate):
        # headings alone say nothing of a gyro that is silent, or refused
        return before
    dt = time - last
    rate, rated = (rate, time) if is_rate else (held, rated)
    if not is_held or dt < 0.0 or psi != psi:
        # g outlasts a gap, and is known as well as before it
        white = math.nan, math.nan, white[2], white[3]
        return RateBias(time, heading, rate, bias, of_heading, 0.0, p11, 0.0, turning, time, rated, white)
    mean = 0.5 * (held + rate)
    psi += dt * (mean - bias)
    turned = mean - bias if mean > bias else bias - mean
    turning -= math.expm1(-dt / RATE_MEAN_TIME) * (turned - turning)
    # what turns the boat between two rates is not seen: of a walk from one to the other the mean has this variance
    differs = (rate - held) * (rate - held) / 12.0
    p00 += dt * (dt * (p11 + (of_rate if of_rate > differs else differs)) - 2.0 * p01)
    p01 -= dt * p11
    p11 += RATE_BIAS_CHANGE * dt
    if heading != heading:
        psi = psi if -PI < psi <= PI else wrap(psi)
        return RateBias(time, psi, rate, bias, p00, p01, p11, apart, turning, seen, rated, white)
    off = heading - psi
    off = off if -PI < off <= PI else wrap(off)
    white = white_step(white, off, time - seen, of_heading)
    lag = RATE_COMPASS_LAG * turning
    apart -= math.expm1(-(time - seen) / RATE_MEAN_TIME) * (off - apart)
    if apart * apart > RATE_BIAS_APART + of_heading + 4.0 * lag * lag:
        p11 = p11 if p11 > RATE_BIAS_UNKNOWN else RATE_BIAS_UNKNOWN
        white = math.nan, math.nan, white[2], white[3]
        return RateBias(time, heading, rate, bias, of_heading, 0.0, p11, 0.0, turning, time, rated, white)
    total = p00 + of_heading + lag * lag
    k0, k1 = p00 / total, p01 / total
    psi += k0 * off
    psi = psi if -PI < psi <= PI else wrap(psi)
    bias += k1 * off
    p00, p01, p11 = p00 - k0 * p00, p01 - k0 * p01, p11 - k1 * p01
    return RateBias(time, psi, rate, bias, p00, p01, p11, apart, turning, time, rated, white)


def bias_unknown(gyro: RateBias, supposed: float) -> float:
    """Return the variance [(rad/s)^2] of the standing error as it is known: the covariance is that of headings whose
    variance is the `supposed` one [rad^2], and as much larger where their noise is."""
    _, _, known, count = gyro.white
    known = known if count > 0.0 else NOISE_MOST * NOISE_MOST * supposed
    return gyro.p11 * known / supposed if known > supposed else gyro.p11


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


class Fusion(NamedTuple):
    """What the measurements have left: the filter's state, what lies between expectation and measurement on average
    [standard deviations], how many spikes in a row agree, and the newest of them [rad]; lean: the average of the
    headings alone over the time of gusts, and leans [s]: for how long it has been more than white noise leaves; gyro:
    what is known of the rate sensor's standing error; headings and rates: how noisy they turn out to be; unlearnt [rad
    of rudder]: what pushes the boat beyond model and bias, see `unlearnt_step`."""

    state: FilterState
    innovation_mean: float = 0.0
    spikes: int = 0
    spike: float = 0.0
    lean: float = 0.0
    leans: float = 0.0
    gyro: RateBias = NO_RATE_BIAS
    headings: Noise = NO_NOISE
    rates: Noise = NO_NOISE
    unlearnt: float = 0.0


def is_pushed(fusion: Fusion, noise: FilterNoise) -> bool:
    """Return whether the innovations lie to one side, by a lot for seconds or by a little for the time of gusts."""
    is_even = -INNOVATION_LASTING < fusion.innovation_mean < INNOVATION_LASTING
    # what leans for longer than a push takes to be learnt is something else, instruments that contradict one another
    return not is_even or 0.0 < fusion.leans < LEARNT * noise.gust_time


NOT_BEGUN = Fusion(FilterState(-math.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
"""Before the first heading."""


class Measured(NamedTuple):
    """A measurement at `time` [s]: heading [rad] and rate [rad/s], nan where they were not measured."""

    time: float
    heading: float
    rate: float


class Moment(NamedTuple):
    """When the boat is looked at [s], its speed then [m/s], and when the newest heading was measured [s]."""

    now: float
    speed: float
    heading_time: float


def stretch(past: RudderPast, begun: float, end: float, grain: float) -> tuple[float, float]:
    """Return until when [s], `end` at most, the rudder stood as at `begun` [s], and its angle [rad].

    Neighbours that together last no longer than `grain` [s] are one, with their mean angle.
    """
    times, angles, ticks = past
    tick = newest = ticks - 1
    ring = len(times) - 1
    if newest < 0 or begun >= times[newest & ring]:
        return end, angles[newest & ring]
    oldest = newest - ring if newest > ring else 0
    while tick > oldest and times[tick & ring] > begun:
        tick -= 1
    at, turned = begun, 0.0
    while at < end:
        until = times[(tick + 1) & ring] if tick < newest else end
        until = end if end < until else until
        if until > at:
            if until - begun > grain and at > begun:
                break
            turned += (until - at) * angles[tick & ring]
            at = until
        if at < end:
            tick += 1
    return at, turned / (at - begun)


def carried(model: Norrbin, noises: Noises, fusion: Fusion, past: RudderPast, to: float) -> FilterState:
    """Return the filter's state carried to the time `to` [s] under the rudder that was."""
    state = fusion.state
    at = state.time
    end = at + PREDICT_LONGEST
    end = end if end < to else to
    longest, grain = LONGEST_SHARE * model.time_constant, GRAIN_SHARE * model.time_constant
    moving = noises.pushed if is_pushed(fusion, noises.usual) else noises.usual
    stop = noises.usual.stop
    while at < end:
        until, angle = stretch(past, at, end, grain)
        noise = moving if -stop < angle < stop else noises.stopped
        if until - at > longest:
            for left in range(math.ceil((until - at) / longest), 1, -1):
                at += (until - at) / left
                state = predict(model, noise, state, angle, at)
        state, at = predict(model, noise, state, angle, until), until
    return state if at == to else FilterState(to, *state[1:])


def seen_at(
    model: Norrbin, noises: Noises, fusion: Fusion, past: RudderPast, at: tuple[float, float, float]
) -> NavState:
    """Return what the filter knows of the boat; the waves that are not yet known count as the boat's own. at: see
    `Moment`."""
    (now, speed, heading_time), (_, angles, ticks) = at, past
    state = fusion.state
    begun, psi, rate, wave, wave_rate = state.time, state.psi, state.rate, state.wave, state.wave_rate
    sea, bias = state.sea, state.bias
    if now > begun:
        latest = begun + PREDICT_LONGEST
        end = latest if latest < now else now
        until, angle = stretch(past, begun, end, GRAIN_SHARE * model.time_constant)
        if until >= end and until - begun <= LONGEST_SHARE * model.time_constant:
            # what is a moment away needs no covariance
            psi, rate, wave, wave_rate = predict_mean(model, state, angle, until)
        else:
            state = carried(model, noises, fusion, past, now)
            psi, rate, wave, wave_rate = state.psi, state.rate, state.wave, state.wave_rate
    unknown = 1.0 - known(sea)
    psi, rate = psi + unknown * wave, rate + unknown * wave_rate
    wave, wave_rate = wave - unknown * wave, wave_rate - unknown * wave_rate
    heading = psi + wave
    return NavState(
        now,
        heading if -PI < heading <= PI else wrap(heading),
        rate + wave_rate,
        speed,
        angles[(ticks - 1) & (len(angles) - 1)],
        -BIAS_MOST if bias < -BIAS_MOST else BIAS_MOST if bias > BIAS_MOST else bias,
        now - heading_time,
        True,
        wave,
        wave_rate,
        math.sqrt(sea.heading),
        frequency(sea),
    )


def are_truth(fusion: Fusion, silent: float) -> bool:
    """Return whether the headings that were left out last are no spikes; silent [s]: since the last that was fused."""
    spikes = fusion.spikes
    return spikes > GATE_PATIENCE or (spikes > 1 and silent >= GATE_LASTS)


def is_borne_out(gyro: RateBias, time: float, heading: float, rate: float) -> bool:
    """Return whether compass and rate sensor tell of the same turn up to a `heading` [rad] and `rate` [rad/s], nan
    where none was measured: what is expected of the boat is wrong then, and the heading is no spike."""
    last, psi, held, bias, rated = gyro.time, gyro.heading, gyro.rate, gyro.bias, gyro.rated
    if psi != psi or not 0.0 <= time - rated <= RATE_HELD:
        return False
    mean = 0.5 * (held + rate) if rate == rate else held
    off = wrap(heading - psi - (time - last) * (mean - bias))
    return -GATE_LEAST <= off <= GATE_LEAST


def fuse_measured(
    model: Norrbin, noises: Noises, fusion: Fusion, past: RudderPast, measured: tuple[float, float, float]
) -> tuple[Fusion, bool]:
    """Return what a measurement leaves, and whether it was fused: a spike is not. measured: see `Measured`."""
    time, heading, raw = measured
    before, mean, spikes, spike, lean, leans, gyro, headings, rates, unlearnt = fusion
    noise, dt = noises.usual, time - before.time
    filed_heading, filed_rate = noise.heading, noise.rate
    longest = model.time_constant if model.time_constant < NOISE_GAP else NOISE_GAP
    of_heading = headings[0] if headings[0] > filed_heading else filed_heading
    of_rate = rates[0] if rates[0] > filed_rate else filed_rate
    rate = raw - gyro.bias
    doubt = gyro.p11 if gyro.p11 > RATE_BIAS_FELT * of_rate else 0.0
    variances, changes = (of_heading, of_rate + doubt), (noise.bias, noise.gusty_bias, noise.gust_time)
    state = carried(model, noises, fusion, past, time)
    unknown = state.p11 + 2.0 * state.p14 + state.p44 + doubt
    apart = rate - state.rate - state.wave_rate
    most = noises.rate_most + GATE_SIGMAS * math.sqrt(unknown + of_rate)
    if (apart > most or apart < -most) and not is_pushed(fusion, noises.usual):
        # no rudder makes it, and no heading shows that anything else does
        rate = raw = math.nan
    off, innovation, deviation = innovations(state, variances, heading, rate)
    off = -INNOVATION_MOST if off < -INNOVATION_MOST else INNOVATION_MOST if off > INNOVATION_MOST else off
    mean -= math.expm1(-dt / INNOVATION_MEAN_TIME) * (off - mean)
    if heading == heading:  # what is no number is not itself
        gate = GATE_SIGMAS * deviation
        gate = gate if gate > GATE_LEAST else GATE_LEAST
        # a boat gains the quickest rate that it may have in TURN_GAINED
        reach = noises.rate_most * dt * (dt / TURN_GAINED if dt < TURN_GAINED else 1.0)
        gate = reach if gate < reach < math.inf else gate
        if (innovation > gate or innovation < -gate) and not is_borne_out(gyro, time, heading, raw):
            agrees = spikes > 0 and abs(wrap(heading - spike)) <= gate
            spikes = spikes + 1 if agrees else 1
            # the rate goes on carrying the heading that both show
            gyro = rate_bias_step(gyro, (time, math.nan, raw), (of_heading, of_rate))
            return Fusion(before, mean, spikes, heading, lean, leans, gyro, headings, rates, unlearnt), False
        spikes = 0
        shown = deviation * deviation - of_heading
        headings = noise_step(headings, filed_heading, innovation, shown, time, longest)
        share = -math.expm1(-dt / noise.gust_time)
        lean += share * (innovation / deviation - lean)
        # the mean of white noise has the variance share/(2 - share)
        is_off = lean * lean * (2.0 - share) > LEAN_SIGMAS * LEAN_SIGMAS * share
        leans = leans + dt if is_off else 0.0
        if noise.waves and leans > 0.0:
            is_push = leans < LEARNT * noise.gust_time
            intensity = raised_intensity(state.intensity, changes, dt) if is_push else reset_density(state.intensity)
            state = FilterState(*state[:-1], intensity)
    if rate == rate:
        rates = noise_step(rates, filed_rate, apart, unknown, time, longest)
    # what lies to one side for seconds is neither sea nor gusts
    learns = noise.waves and -INNOVATION_LASTING < mean < INNOVATION_LASTING
    rudder = angle_at(past, time) if learns else math.nan
    gyro = rate_bias_step(gyro, (time, heading, raw), (of_heading, of_rate))
    expected, state = state, fused(state, changes, variances, (heading, rate), rudder, dt)
    unlearnt = unlearnt_step(model, unlearnt, expected, state, dt)
    return Fusion(state, mean, spikes, spike, lean, leans, gyro, headings, rates, unlearnt), True


def unlearnt_step(model: Norrbin, before: float, expected: FilterState, found: FilterState, dt: float) -> float:
    """Return what pushes the boat beyond model and bias [rad of rudder], `dt` [s] after it was `before`.

    By T r' + n1 r = K (delta + b + d), d is what a measurement has corrected, `expected` to `found`, in the time
    since the last: d = (T dr + n1 dpsi)/(K dt), averaged over as long as the boat shows a push. A bias that is slow,
    as waves are not to move it, has not learnt it yet.
    """
    if dt <= SHORTEST:
        return before
    turned = found.psi - expected.psi
    turned = turned if -PI < turned <= PI else wrap(turned)
    corrected = model.time_constant * (found.rate - expected.rate) + model.n1 * turned
    share = -math.expm1(-dt / (UNLEARNT_TIME * model.time_constant))
    return before + share * (corrected / (model.gain * dt) - before)


SHORTEST = 1.0e-9
"""[s]: clocks count nanoseconds; what is closer is of one moment."""


def known(sea: Sea) -> float:
    """Return which share of the wave motion is to be believed: none until the sea has been watched for
    WAVE_MEMORY_FIRST, all of it after twice as long. At first every motion of the boat is taken for a wave."""
    share = sea.watched / WAVE_MEMORY_FIRST - 1.0
    return 0.0 if share < 0.0 else 1.0 if share > 1.0 else share
