"""The likelihood of a recording in which gusts, waves and noise push the boat, all possible motions summed over.

    r' = a delta - b r - d r^3 - e + g + w,    psi' = r,    g' = -g/tau + v

a = K/T, b = n1/T, d = n3/T, e = n0/T at the reference speed, each scaled with the speed of the moment; b of
either sign, so that course-stable and course-unstable boats, and those in between, are one model. In place of d r^3
d r|r| may stand (`likelihood_record.Form`). w is white, as what
noise on the recorded rudder is worth; g is a gust that lasts. Compass and gyro see psi + x and r + x' with white noise,
where x is the boat's motion in waves, x'' + 2 z W x' + W^2 x = white noise, if there are any. Or waves push the boat,
W^2 x being one more push beside g: of such waves as much is left at the slow frequencies of a manoeuvre as of a gust.

The states at all samples are found together, as the minimum of their negative logarithmic density: a sparse system, of
which each sample touches the next one only (Bell 1994, the iterated Kalman smoother as Gauss and Newton's method). The
integral over all states is that of the Gaussian with the curvature there (Laplace's approximation; exact but for the
cubic term). What a boat does in the record is known from the record, so that nothing runs away however unstable it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs

from autopilot.identification.likelihood_record import Record
from autopilot.identification.runs import FloatArray

ROUNDS, ARRIVED = 12, 1.0e-9
"""Of Newton's method to the path, at most, and what one more may gain at the end: where it might gain 1e-6 the slope of
the likelihood is off by 0.1 standard errors of the boat."""
GUST, WAVE = 2, 3
"""Columns of the states."""


class Rates(NamedTuple):
    """a [1/s^2], b [1/s], d [s/rad^2], e [rad/s^2] at the reference speed; see above."""

    a: float
    b: float
    d: float = 0.0
    e: float = 0.0


class Weather(NamedTuple):
    """gust [rad/s^2], rms, and its time [s]; white [rad/s/sqrt(s)]; noise of gyro [rad/s] and compass [rad]; wave
    [rad], rms of the heading, its frequency [rad/s] and damping; a wave of 0 is none. wave_pushes: waves are a
    moment, of `wave` times the frequency's square [rad/s^2]."""

    gust: float
    gust_time: float
    white: float
    gyro: float
    compass: float
    wave: float = 0.0
    wave_frequency: float = 1.0
    wave_damping: float = 0.1
    wave_pushes: bool = False


class Motion(NamedTuple):
    """Of each step: what it leaves of heading [rad] and rate [rad/s] unexplained, without what drives it, and how it
    goes on with rate and gust, or any other push: turned by rate, turned by gust, rate by rate, rate by gust; each of
    shape (M,).

    inside: the rate, and how it changes with the rate and with the gust at the step's begin, where substeps begin, in
    their middles and where the last one ends, shape (3, 2 S + 1, M).
    """

    heading: FloatArray
    rate: FloatArray
    turned_by_rate: FloatArray
    turned_by_gust: FloatArray
    rate_by_rate: FloatArray
    rate_by_gust: FloatArray
    inside: FloatArray


class Path(NamedTuple):
    """The states at the nodes, shape (N, D): heading [rad], rate [rad/s], gust [rad/s^2], wave [rad, rad/s; of those
    that push rad/s^2, rad/s^3]; the
    negative logarithm of the record's likelihood there, constants left out; and the curvature in rows of the lower
    band, shape (2 D, N D), with its Cholesky factor, and how the steps go on there, where a path was found."""

    states: FloatArray
    loss: float
    band: FloatArray | None = None
    factor: FloatArray | None = None
    motion: Motion | None = None


def begin_path(record: Record) -> FloatArray:
    """Return states to begin the search with: the measured ones, smoothed where only headings are."""
    N = record.nodes
    states = np.zeros((N, 3))
    ends = np.append(record.first[1:], N)
    for first, end in zip(record.first.tolist(), ends.tolist(), strict=True):
        rate, heading = record.rate[first:end], record.heading[first:end]
        time = np.concatenate([[0.0], np.cumsum(record.step[_steps(record, first, end)])])
        known = record.heading_count[first:end] > 0.0
        if known.any():
            states[first:end, 0] = np.interp(time, time[known], heading[known])
        seen = record.rate_count[first:end] > 0.0
        if seen.any():
            states[first:end, 1] = np.interp(time, time[seen], rate[seen])
            if not known.any():
                steps = 0.5 * (states[first + 1 : end, 1] + states[first : end - 1, 1]) * np.diff(time)
                states[first:end, 0] = np.concatenate([[0.0], np.cumsum(steps)])
        else:
            width = min(max(3, int(1.0 / float(np.median(np.diff(time)))) | 1), (end - first - 1) | 1)
            slope = np.gradient(states[first:end, 0], time)
            padded = np.pad(slope, width // 2, mode="edge")
            states[first:end, 1] = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")[: end - first]
    return states


def _steps(record: Record, first: int, end: int) -> slice:
    low = int(np.searchsorted(record.begin, first))
    return slice(low, low + end - first - 1)


@np.errstate(over="ignore", invalid="ignore")
def best_path(
    rates: Rates,
    weather: Weather,
    record: Record,
    rudder: tuple[FloatArray, FloatArray],
    start: FloatArray,
    rounds: int = ROUNDS,
) -> Path:
    """Return the most likely states near `start` and the loss; a loss of inf where the search does not arrive."""
    noise = noise_of(weather, record)
    states = start
    for number in range(rounds):
        found = _assembled(rates, record, rudder, states, noise)
        if found is None:
            return Path(start, math.inf)
        band, slope, density, motion = found
        factor, failed = dpbtrf(band, lower=1)
        if failed:
            return Path(start, math.inf)
        move, _ = dpbtrs(factor, -slope, lower=1)
        decrement = -float(move @ slope)
        if not math.isfinite(decrement):
            return Path(start, math.inf)
        if decrement < ARRIVED or number == rounds - 1:
            break
        states = states + move.reshape(states.shape)
    # half the decrement is what the last step would still have gained
    return Path(states, density - 0.5 * decrement + float(np.log(factor[0]).sum()), band, factor, motion)


WaveNoise = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


class StepNoise(NamedTuple):
    """Inverse covariances of what drives each step, by their entries, shape (M,): (heading, heading), (heading, rate),
    (rate, rate), gust. initial: 1/variance of the states where each segment begins, shape (segments, D). gyro, compass:
    1/variance of what was measured at each node, 0 where nothing was. keep: of the gust, shape (M,). wave: transition
    of the waves, inverse of what drives them, and both products that the curvature needs, each of shape (4, M) by rows.
    by_instrument, by_white: shares of the white push of each step that go with the instruments' noise, and with the
    weather's, shape (M,).
    pushing: which of the states push the boat. by_gyro: share of what is off in rates that goes with the gyro's noise.
    """

    angle: FloatArray
    cross: FloatArray
    rate: FloatArray
    gust: FloatArray
    initial: FloatArray
    gyro: FloatArray
    compass: FloatArray
    keep: FloatArray
    wave: WaveNoise | None
    constant: float
    by_instrument: FloatArray
    by_white: FloatArray
    pushing: tuple[int, ...] = (GUST,)
    by_gyro: float = 1.0


def noise_of(weather: Weather, record: Record) -> StepNoise:
    h = record.step
    # of less the curvature would lose the instruments in its last digits
    least = 12.0 * record.usual_step**-3.0 * _least_seen(weather, record) / WORST_RATIO
    q = weather.white**2 + least + record.blur * np.ones_like(h)
    # the inverse of [[h^3/3, h^2/2], [h^2/2, h]] q
    per = 1.0 / (q * h)
    keep, gust = gust_noise(weather, record)
    logs = float(4.0 * np.log(h).sum() - np.log(gust).sum()) + 2.0 * np.log(q).sum() - h.size * math.log(12.0)
    initial, wave = first_states(weather, record), None
    logs -= float(np.log(initial[:, GUST:]).sum())
    if weather.wave > 0.0:
        wave, log = wave_noise(weather, h)
        logs += log
    rate_noise = math.hypot(weather.gyro, record.smoothed)
    gyro, compass = record.rate_count / rate_noise**2, record.heading_count / weather.compass**2
    logs += 2.0 * (record.rates_known * math.log(rate_noise) + record.headings_known * math.log(weather.compass))
    return StepNoise(
        12.0 * per / (h * h),
        -6.0 * per / h,
        4.0 * per,
        gust,
        initial,
        gyro,
        compass,
        keep,
        wave,
        0.5 * logs,
        least / q,
        weather.white**2 / q,
        (GUST, WAVE) if wave is not None and weather.wave_pushes else (GUST,),
        (weather.gyro / rate_noise) ** 2,
    )


def first_states(weather: Weather, record: Record) -> FloatArray:
    """Return the inverse variances of the states where segments begin, shape (segments, D)."""
    initial = np.zeros((record.first.size, 3 if weather.wave <= 0.0 else 5))
    initial[:, GUST] = (weather.gust * record.rough[record.first]) ** -2.0
    if weather.wave > 0.0:
        initial[:, WAVE:] = 1.0 / still_waves(weather)
    return initial


def gust_noise(weather: Weather, record: Record) -> tuple[FloatArray, FloatArray]:
    """Return how much of a gust is left after each step, and the inverse variance of what is new."""
    h, before, after = record.step, record.rough[record.begin], record.rough[record.begin + 1]
    new = -np.expm1(-2.0 * h / weather.gust_time) * (weather.gust * after) ** 2
    return np.exp(-h / weather.gust_time) * after / before, 1.0 / new


def _least_seen(weather: Weather, record: Record) -> float:
    """Return the variance [rad^2] of what is measured of the heading in a step."""
    if record.headings_known:
        return weather.compass**2
    return (math.hypot(weather.gyro, record.smoothed) * record.usual_step) ** 2


WORST_RATIO = 1.0e10
"""Weights may differ by no more."""


def still_waves(weather: Weather) -> FloatArray:
    """Return the variances of the waves' heading and rate, or of their push and its rate."""
    size = weather.wave * weather.wave_frequency**2 if weather.wave_pushes else weather.wave
    return size**2 * np.array([1.0, weather.wave_frequency**2])


def wave_noise(weather: Weather, h: FloatArray) -> tuple[WaveNoise, float]:
    """Return `StepNoise.wave` and the logarithm of the determinant of what drives the waves in all steps of `h` [s]."""
    W, z = weather.wave_frequency, min(weather.wave_damping, 0.95)
    own = W * math.sqrt(1.0 - z * z)
    fade, cosine, sine = np.exp(-z * W * h), np.cos(own * h), np.sin(own * h) / own
    moved = np.stack(
        [fade * (cosine + z * W * sine), fade * sine, -fade * W * W * sine, fade * (cosine - z * W * sine)]
    )
    # of waves of size 1, whose squares are no smaller than numbers can be
    squared = float(still_waves(weather)[0])
    xx = 1.0 - moved[0] ** 2 - (moved[1] * W) ** 2
    xy = -moved[0] * moved[2] - moved[1] * moved[3] * W * W
    yy = W * W - moved[2] ** 2 - (moved[3] * W) ** 2
    q, faded, short = 4.0 * z * W**3, z * W * h, W * h < LEAST_TURN
    xx = np.where(short, q * h**3 / 3.0 * (1.0 - 1.5 * faded), xx)
    xy = np.where(short, q * h**2 / 2.0 * (1.0 - 2.0 * faded), xy)
    yy = np.where(short, q * h * (1.0 - 2.0 * faded), yy)
    determinant = xx * yy - xy * xy
    inverse = np.stack([yy, -xy, -xy, xx]) / (determinant * squared)
    ahead = _product(inverse, moved)
    back = _product(moved[[0, 2, 1, 3]], ahead)
    return (moved, inverse, ahead, back), float(np.log(determinant).sum()) + 2.0 * h.size * math.log(squared)


LEAST_TURN = 1.0e-3
"""Of the waves' phase in a step: of less, what is new is lost in rounding; its series is right to the square of it."""


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the products of 2 by 2 matrices, each of shape (4, M) by rows."""
    a, b, c, d = left
    e, f, g, h = right
    return np.stack([a * e + b * g, a * f + b * h, c * e + d * g, c * f + d * h])


def pushed_by(states: FloatArray, pushing: tuple[int, ...]) -> FloatArray:
    """Return the whole push on the boat of `states`, shape (N, D)."""
    return np.asarray(sum(states[:, column] for column in pushing))


def motion_of(
    rates: Rates,
    record: Record,
    rudder: tuple[FloatArray, FloatArray],
    states: FloatArray,
    pushing: tuple[int, ...] = (GUST,),
) -> Motion:
    """Return how the steps go on at `states`, shape (N, D): Runge and Kutta's steps and their own derivatives."""
    begin, end, S = record.begin, record.begin + 1, record.substeps
    a, b, d, e = rates
    h, push = record.step / S, pushed_by(states[begin], pushing)
    half, M = 0.5 * h, begin.size
    # the rate, and how it changes with the rate at the step's begin, and with the gust
    now = np.stack([states[begin, 1], np.ones(M), np.zeros(M)])
    turned, at, k1, k2, k3, k4 = (np.zeros_like(now) for _ in range(6))
    points = np.empty((3, 2 * S + 1, M))
    for s in range(S):
        steering = half * record.scales.steering[s]
        drive = steering * (a * rudder[0][s] - e) + half * (push + record.push[s])
        rise = (0.5 * a) * steering * rudder[1][s]
        terms = (b * half) * record.scales.linear[s], (d * half) * record.scales.higher[s], record.power
        _half_grown(terms, drive - rise, half, now, k1)
        _half_grown(terms, drive, half, np.add(now, k1, out=at), k2)
        _half_grown(terms, drive, half, np.add(now, k2, out=at), k3)
        np.add(k3, k3, out=at)
        at += now
        _half_grown(terms, drive + rise, half, at, k4)
        points[:, 2 * s] = now
        # Runge and Kutta's sums, each k of which is half of what the step adds: (k1 + k2 + k3)/3 for the angle turned,
        # (k1 + 2 k2 + 2 k3 + k4)/3 for the end, (5 k1 + 4 k2 + 4 k3 - k4)/12 for the middle
        k2 += k3
        np.add(k1, k2, out=at)
        k2 += k4
        k2 += at
        k2 *= 1.0 / 3.0
        at *= 1.0 / 3.0
        at += now
        k1 -= k4
        k1 *= 1.0 / 12.0
        np.add(at, k1, out=points[:, 2 * s + 1])
        at *= h
        turned += at
        now += k2
    points[:, 2 * S] = now
    psi, rate = states[:, 0], states[:, 1]
    return Motion(psi[end] - psi[begin] - turned[0], rate[end] - now[0], turned[1], turned[2], now[1], now[2], points)


def _half_grown(
    terms: tuple[FloatArray, FloatArray, int], drive: FloatArray, half: FloatArray, at: FloatArray, grown: FloatArray
) -> None:
    """Put into `grown` by how much rate and what it changes with grow in `half` a step that goes on as where they are
    `at`, shape (3, M); terms, and what drives: linear damping, that of the higher power, times that time, and
    `Form.power`.
    """
    linear, higher, power = terms
    r = at[0]
    bent = r * r if power == 3 else np.abs(r)
    bent *= higher
    damping = linear + bent
    np.multiply(r, damping, out=grown[0])
    bent *= power - 1
    damping += bent
    np.multiply(at[1:], damping, out=grown[1:])
    np.subtract(drive, grown[0], out=grown[0])
    np.negative(grown[1], out=grown[1])
    np.subtract(half, grown[2], out=grown[2])


def _assembled(
    rates: Rates,
    record: Record,
    rudder: tuple[FloatArray, FloatArray],
    states: FloatArray,
    noise: StepNoise,
) -> tuple[FloatArray, FloatArray, float, Motion] | None:
    """Return the lower band of the curvature, the slope, the density and the motion at `states`; None where they
    overflow.

    Written out by entries: A is the step's derivative, Q^-1 its inverse covariance, and of each step A'Q^-1 A, Q^-1 A
    and Q^-1 are what the states before and after it have to do with themselves and one another.
    """
    N, D = states.shape
    begin, end = record.begin, record.begin + 1
    motion = motion_of(rates, record, rudder, states, noise.pushing)
    e0, e1, t, u, m, g, _ = motion
    if not math.isfinite(float(e1.sum())):
        return None
    p, q, s, i, keep = noise.angle, noise.cross, noise.rate, noise.gust, noise.keep
    e2 = states[end, 2] - keep * states[begin, 2]
    w0, w1, w2 = p * e0 + q * e1, q * e0 + s * e1, i * e2
    density = noise.constant + 0.5 * float(e0 @ w0 + e1 @ w1 + e2 @ w2)
    slope = np.zeros((N, D))
    slope[end, 0], slope[end, 1], slope[end, 2] = w0, w1, w2
    slope[begin, 0] -= w0
    slope[begin, 1] -= t * w0 + m * w1
    slope[begin, 2] -= keep * w2
    # rows of the band are the distance from the diagonal; the columns of a node lie side by side
    band = np.zeros((N, D, 2 * D))
    pr, sr, pg, sg = p * t + q * m, q * t + s * m, p * u + q * g, q * u + s * g
    band[end, 0, 0], band[end, 0, 1], band[end, 1, 0], band[end, 2, 0] = p, q, s, i
    band[begin, 0, 0] += p
    band[begin, 0, 1] += pr
    band[begin, 1, 0] += t * pr + m * sr
    band[begin, 2, 0] += keep * keep * i
    for each in noise.pushing:
        slope[begin, each] -= u * w0 + g * w1
        band[begin, 0, each] += pg
        band[begin, 1, each - 1] += u * pr + g * sr
        for other in range(GUST, each + 1):
            band[begin, other, each - other] += u * pg + g * sg
    for column, entries in ((0, (p, q)), (1, (pr, sr)), *((each, (pg, sg)) for each in noise.pushing)):
        for row in range(2):
            band[begin, column, D + row - column] = -entries[row]
    band[begin, 2, D] = -keep * i
    if noise.wave is not None:
        density += _add_waves(noise.wave, record, states, slope, band)
    is_seen = noise.wave is not None and WAVE not in noise.pushing
    for column, values, weight in ((1, record.rate, noise.gyro), (0, record.heading, noise.compass)):
        seen = states[:, column] + states[:, WAVE + column] if is_seen else states[:, column]
        off = seen - values
        pull = weight * off
        density += 0.5 * float(off @ pull)
        slope[:, column] += pull
        band[:, column, 0] += weight
        if is_seen:
            slope[:, 3 + column] += pull
            band[:, 3 + column, 0] += weight
            band[:, column, 3] += weight
    first = record.first
    slope[first] += noise.initial * states[first]
    band[first, :, 0] += noise.initial + LOOSE
    band[first, 0, 0] += record.pins
    density += 0.5 * float((noise.initial * states[first] ** 2).sum())
    return band.reshape(N * D, 2 * D).T, slope.ravel(), density, motion


def _add_waves(
    wave: WaveNoise,
    record: Record,
    states: FloatArray,
    slope: FloatArray,
    band: FloatArray,
) -> float:
    """Add what the waves' steps have to do with their states to slope and band; return their part of the density."""
    moved, inverse, ahead, back = wave
    begin, end, D = record.begin, record.begin + 1, 5
    x, v = states[begin, 3], states[begin, 4]
    e0, e1 = states[end, 3] - moved[0] * x - moved[1] * v, states[end, 4] - moved[2] * x - moved[3] * v
    w0, w1 = inverse[0] * e0 + inverse[1] * e1, inverse[2] * e0 + inverse[3] * e1
    slope[end, 3] += w0
    slope[end, 4] += w1
    slope[begin, 3] -= moved[0] * w0 + moved[2] * w1
    slope[begin, 4] -= moved[1] * w0 + moved[3] * w1
    band[end, 3, 0] += inverse[0]
    band[end, 3, 1] += inverse[2]
    band[end, 4, 0] += inverse[3]
    band[begin, 3, 0] += back[0]
    band[begin, 3, 1] += back[2]
    band[begin, 4, 0] += back[3]
    for row in range(2):
        for column in range(2):
            band[begin, 3 + column, D + row - column] -= ahead[2 * row + column]
    return 0.5 * float(e0 @ w0 + e1 @ w1)


LOOSE = 1.0e-6
"""States are held by so little where they begin."""
