"""How the likelihood of a recording changes with the boat and the weather, without searching for the path anew.

The loss is f(x) + 1/2 ln det H at the best path x, H the curvature of f there. Its derivative by a parameter needs no
derivative of the path: with Z = H^-1 and l = H^-1 g, g the slope of 1/2 tr(Z H) by the path,

    F = f + 1/2 tr(Z H) - l . (slope of f by the path)

has the same derivative with x, Z and l held (the adjoint of the path's own condition). Each term of F belongs to one
step or one sample, so that it is a sum of what the second moments of each step's unexplained part are worth. Of Z only
what a state has to do with itself and the next one is needed: eliminating all states before a node, and all behind the
next one, leaves those two with each other.

How a step's end changes with the boat is an integral over the step of what changes, times what it is worth for the end
(the adjoint of the equation of motion, integrated by Simpson's rule over the substeps).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs

from autopilot.identification.likelihood_record import Record, Scales
from autopilot.identification.marginal_likelihood import (
    GUST,
    WAVE,
    Motion,
    Path,
    Rates,
    StepNoise,
    WaveNoise,
    pushed_by,
)
from autopilot.identification.runs import FloatArray

Rudder = tuple[FloatArray, FloatArray]


class Held(NamedTuple):
    """What F holds: the path's states, covariance of each step's two nodes, shape (2 D, 2 D, M), l, shape (N, D), how
    the steps go on, what is inside of them too, and which of the states push the boat."""

    record: Record
    states: FloatArray
    pairs: FloatArray
    pull: FloatArray
    motion: Motion
    pushing: tuple[int, ...]

    def moment(self, i: int, j: int) -> FloatArray:
        """Return what F takes for the product of two of the states at a step's ends, from D on those at its end."""
        (x, pull), (y, other) = self._end(i), self._end(j)
        return np.asarray(x * y - x * other - pull * y + self.pairs[i, j])

    def _end(self, i: int) -> tuple[FloatArray, FloatArray]:
        D = self.states.shape[1]
        nodes, column = (self.record.begin, i) if i < D else (self.record.begin + 1, i - D)
        return self.states[nodes, column], self.pull[nodes, column]


class Moments(NamedTuple):
    """What F takes for squares and products: of what drives each step's heading and rate, (heading, heading), (heading,
    rate), (rate, rate); of the gust, (end, end), (end, begin), (begin, begin); of the waves at begin and end, shape
    (4, 4, M), empty where there are none; of what the gyro and the compass leave, shape (N,); and of the states where
    segments begin, shape (S, D)."""

    driven: tuple[FloatArray, FloatArray, FloatArray]
    gust: tuple[FloatArray, FloatArray, FloatArray]
    waves: FloatArray
    gyro: FloatArray
    compass: FloatArray
    first: FloatArray


def held_at(path: Path, rates: Rates, record: Record, noise: StepNoise) -> Held:
    """Return what belongs to the best `path`. LinAlgError where rounding leaves its information not positive."""
    states, begin = path.states, record.begin
    assert path.band is not None and path.factor is not None and path.motion is not None
    pairs = _pairs(path.band, path.factor, record, states.shape[1])
    held = Held(record, states, pairs, np.zeros_like(states), path.motion, noise.pushing)
    adjoint = adjoint_of(held, rates, _spread_worth(held, noise))
    bent = np.zeros_like(states)
    bent[begin, 1] = adjoint.rate[0]
    for each in noise.pushing:
        bent[begin, each] = _simpson(adjoint.rate, record).sum(axis=0)
    pull, _ = dpbtrs(path.factor, bent.ravel(), lower=1)
    return held._replace(pull=pull.reshape(states.shape))


class EndWorth(NamedTuple):
    """What changes of a step's end are worth, each of shape (M,): of the angle turned, the rate, turned by rate, turned
    by gust, rate by rate and rate by gust."""

    turned: FloatArray | float
    rate: FloatArray | float
    turned_by_rate: FloatArray | float
    turned_by_gust: FloatArray | float
    rate_by_rate: FloatArray | float
    rate_by_gust: FloatArray | float


class Adjoint(NamedTuple):
    """What changes inside the steps are worth, at the points of `Motion.inside`, shape (2 S + 1, M): of the rate, and
    of how the acceleration changes with the rate, with its sign changed."""

    rate: FloatArray
    damping: FloatArray


def adjoint_of(held: Held, rates: Rates, worth: EndWorth) -> Adjoint:
    """Return what changes inside are worth where those of the ends are worth so much.

    A change of the rate at s goes on as m(1)/m(s), m(s) being how the rate at s changes with that at the begin.
    """
    record, motion = held.record, held.motion
    r, m, g = motion.inside
    rest = _behind(m, record)
    # in place: on many substeps each array for one more step of the reckoning is fetched anew from the system
    damping, by_gust, whole = worth.turned_by_rate * rest, worth.turned_by_gust * rest, worth.turned * rest
    damping += worth.rate_by_rate * motion.rate_by_rate
    damping *= m
    by_gust += worth.rate_by_gust * motion.rate_by_rate
    by_gust *= g
    damping += by_gust
    bent = np.multiply(6.0, r, out=by_gust) if record.power == 3 else np.multiply(2.0, np.sign(r), out=by_gust)
    bent *= damping
    bent = _behind(bent, record, record.scales.higher)
    bent *= rates.d
    whole += worth.rate * motion.rate_by_rate
    whole -= bent
    whole /= m
    damping /= m
    return Adjoint(whole, damping)


def _simpson(values: FloatArray, record: Record) -> FloatArray:
    """Return the integrals over the substeps, shape (S, M)."""
    whole = 4.0 * values[1::2]
    whole += values[:-2:2]
    whole += values[2::2]
    whole *= record.step / (6.0 * record.substeps)
    return np.asarray(whole)


def _behind(values: FloatArray, record: Record, scale: FloatArray | float = 1.0) -> FloatArray:
    """Return the integral, times the `scale` of each substep, from each point to the step's end, as `values`."""
    result, whole, later = np.empty_like(values), _simpson(values, record), 8.0 * values[1::2]
    whole *= scale
    np.cumsum(whole[::-1], axis=0, out=result[-3::-2])
    result[-1] = 0.0
    later -= values[:-2:2]
    later += np.multiply(5.0, values[2::2], out=whole)
    later *= scale * (record.step / (24.0 * record.substeps))
    np.add(result[2::2], later, out=result[1::2])
    return result


def worth_by_boat(
    held: Held,
    rates: Rates,
    rudder: Rudder,
    rudders: Sequence[Rudder],
    adjoint: Adjoint,
    besides: Sequence[tuple[Scales, FloatArray]] = (),
) -> FloatArray:
    """Return what a, b, d and e, changes of the rudder, and changes of scales and push are worth in each step, shape
    (4 + P + Q, M)."""
    record, power = held.record, held.record.power
    steering, linear, higher = record.scales
    r, whole = held.motion.inside[0], adjoint.rate
    driven = _simpson(whole, record)
    # what a rudder that moves while it is worth more and more brings beside its mean
    moving = (whole[2::2] - whole[:-1:2]) * (record.step / (12.0 * record.substeps))
    turned = whole * r
    at = turned + adjoint.damping
    damped = _simpson(at, record)
    turned += power * adjoint.damping
    turned *= np.multiply(r, r, out=at) if power == 3 else np.abs(r, out=at)
    bending = _simpson(turned, record)
    steered = driven * rudder[0] + moving * rudder[1]
    rows = [steering * steered, -linear * damped, -higher * bending, -steering * driven]
    # a row at a time: on many substeps those of all changes take much memory
    worth = [row.sum(axis=0) for row in rows]
    worth += [(rates.a * steering * (driven * mean + moving * rise)).sum(axis=0) for mean, rise in rudders]
    a, b, d, e = rates
    for (more, straighter, firmer), push in besides:
        row = more * (a * steered - e * driven) - b * straighter * damped - d * firmer * bending + push * driven
        worth.append(row.sum(axis=0))
    return np.array(worth)


def _pairs(band: FloatArray, factor: FloatArray, record: Record, D: int) -> FloatArray:
    """Return the covariance of the states at both ends of each step."""
    width, size = band.shape
    back = np.zeros_like(band)
    for row in range(width):
        back[row, : size - row] = band[row, size - row - 1 :: -1] if row < size else 0.0
    backward, failed = dpbtrf(back, lower=1)
    if failed:
        raise np.linalg.LinAlgError("from behind the path's information is not positive")
    before = _blocks(factor, D)
    behind = _blocks(backward, D)[::-1, ::-1, ::-1]
    begin = record.begin
    joint = np.empty((2 * D, 2 * D, begin.size))
    joint[:D, :D] = before[:, :, begin]
    joint[D:, D:] = behind[:, :, begin + 1]
    columns = band.T.reshape(-1, D, width)
    for column in range(D):
        for row in range(D):
            away = D + row - column
            across = columns[begin, column, away] if away < width else 0.0
            joint[D + row, column] = joint[column, D + row] = across
    return _inverted(joint)


def _inverted(matrices: FloatArray) -> FloatArray:
    """Return the inverses of positive matrices side by side, shape (n, n, M), in their place: by symmetric sweeps of
    Gauss and Jordan (Goodnight 1979) of the lower triangle, each for all of them at once, row after row: one array for
    all rows would be fetched anew from the system every time."""
    n = matrices.shape[0]
    taken, column = np.empty(matrices.shape[1:]), np.empty(matrices.shape[1:])
    for k in range(n):
        column[:k], column[k:] = matrices[k, :k], matrices[k:, k]
        pivot = 1.0 / column[k]
        row = column * pivot
        for i in range(n):
            if i != k:
                matrices[i, : i + 1] -= np.multiply(row[: i + 1], column[i], out=taken[: i + 1])
        matrices[k, :k], matrices[k:, k] = row[:k], row[k:]
        matrices[k, k] = -pivot
    for i in range(n):
        np.negative(matrices[i, : i + 1], out=matrices[i, : i + 1])
        matrices[:i, i] = matrices[i, :i]
    return matrices


def _blocks(factor: FloatArray, D: int) -> FloatArray:
    """Return what each node's states have to do with one another once all before are eliminated, shape (D, D, N)."""
    columns = factor.T.reshape(-1, D, factor.shape[0])
    lower = np.zeros((D, D, columns.shape[0]))
    for column in range(D):
        for row in range(column, D):
            lower[row, column] = columns[:, column, row - column]
    blocks = np.empty_like(lower)
    for i in range(D):
        for j in range(i + 1):
            blocks[i, j] = blocks[j, i] = (lower[i, : j + 1] * lower[j, : j + 1]).sum(axis=0)
    return blocks


def _driven_by(held: Held) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the covariances of what drives each step's heading, and of what drives its rate, with the rate and gust at
    its begin and with each other: (rate, gust, driven heading, driven rate), and (rate, gust, driven rate)."""
    P, D = held.pairs, held.states.shape[1]
    if WAVE in held.pushing:
        # the whole push in place of the gust
        P = P.copy()
        P[GUST] += P[WAVE]
        P[:, GUST] += P[:, WAVE]
    _, _, t, u, m, g, _ = held.motion
    heading = [P[D, i] - P[0, i] - t * P[1, i] - u * P[2, i] for i in (0, 1, 2, D, D + 1)]
    rate = [P[D + 1, i] - m * P[1, i] - g * P[2, i] for i in (1, 2, D + 1)]
    hh = heading[3] - heading[0] - t * heading[1] - u * heading[2]
    hr = heading[4] - m * heading[1] - g * heading[2]
    rr = rate[2] - m * rate[0] - g * rate[1]
    return [heading[1], heading[2], hh, hr], [rate[0], rate[1], rr]


def _spread_worth(held: Held, noise: StepNoise) -> EndWorth:
    """Return what changes of the steps' ends are worth in 1/2 tr(Z H)."""
    heading, rate = _driven_by(held)
    p, q, s = noise.angle, noise.cross, noise.rate
    turned = [-(p * heading[i] + q * rate[i]) for i in (0, 1)]
    moved = [-(q * heading[i] + s * rate[i]) for i in (0, 1)]
    return EndWorth(0.0, 0.0, *turned, *moved)


def end_worth(held: Held, noise: StepNoise) -> EndWorth:
    """Return what changes of the steps' ends are worth in F."""
    begin, pull, spread = held.record.begin, held.pull, _spread_worth(held, noise)
    p, q, s = noise.angle, noise.cross, noise.rate
    e0, e1 = held.motion.heading, held.motion.rate
    l0, l1 = _pulled(held)
    w0, w1 = p * e0 + q * e1, q * e0 + s * e1
    rate, gust = pull[begin, 1], pushed_by(pull[begin], held.pushing)
    return EndWorth(
        -(w0 - p * l0 - q * l1),
        -(w1 - q * l0 - s * l1),
        spread.turned_by_rate + w0 * rate,
        spread.turned_by_gust + w0 * gust,
        spread.rate_by_rate + w1 * rate,
        spread.rate_by_gust + w1 * gust,
    )


def _pulled(held: Held) -> tuple[FloatArray, FloatArray]:
    """Return what l does to what each step leaves of heading and rate."""
    begin, end, pull = held.record.begin, held.record.begin + 1, held.pull
    _, _, t, u, m, g, _ = held.motion
    push = pushed_by(pull[begin], held.pushing)
    l0 = pull[end, 0] - pull[begin, 0] - t * pull[begin, 1] - u * push
    return l0, pull[end, 1] - m * pull[begin, 1] - g * push


def moments_of(held: Held) -> Moments:
    """Return all moments."""
    record, D = held.record, held.states.shape[1]
    waves = np.empty((0, 0, 0))
    if D == 5:
        ends = (3, 4, D + 3, D + 4)
        waves = np.array([[held.moment(i, j) for j in ends] for i in ends])
    first, last = record.first, np.append(record.first[1:], record.nodes) - 1
    opening, closing = np.searchsorted(record.begin, first), np.searchsorted(record.begin, last - 1)
    x, pull = held.states[first], held.pull[first]
    spread = held.pairs[np.arange(D), np.arange(D)][:, opening].T
    parts = []
    for column, values in ((1, record.rate), (0, record.heading)):
        seen, drawn = held.states[:, column], held.pull[:, column]
        own = held.pairs[column, column]
        own_last = held.pairs[D + column, D + column, closing]
        if D == 5 and WAVE not in held.pushing:
            wave = WAVE + column
            seen, drawn = seen + held.states[:, wave], drawn + held.pull[:, wave]
            P = held.pairs
            own = own + P[wave, wave] + 2.0 * P[column, wave]
            own_last = own_last + P[D + wave, D + wave, closing] + 2.0 * P[D + column, D + wave, closing]
        variance = np.empty(record.nodes)
        variance[record.begin], variance[last] = own, own_last
        off = seen - values
        parts.append(off * (off - 2.0 * drawn) + variance)
    e0, e1 = held.motion.heading, held.motion.rate
    (_, _, hh, hr), (_, _, rr), (l0, l1) = *_driven_by(held), _pulled(held)
    return Moments(
        (hh + e0 * (e0 - 2.0 * l0), hr + e0 * e1 - e0 * l1 - e1 * l0, rr + e1 * (e1 - 2.0 * l1)),
        (held.moment(D + 2, D + 2), held.moment(D + 2, 2), held.moment(2, 2)),
        waves,
        parts[0],
        parts[1],
        x * (x - 2.0 * pull) + spread,
    )


class Worth(NamedTuple):
    """What the moments are worth in F, twice: of what drives heading and rate in each step, shape (M,), of gusts, gyro
    and compass, and of the first states, shape (D,)."""

    driven: FloatArray
    gust: float
    gyro: float
    compass: float
    first: FloatArray


def worth_of(moments: Moments, noise: StepNoise) -> Worth:
    """Return what the moments are worth, those of waves left out."""
    hh, hr, rr = moments.driven
    return Worth(
        noise.angle * hh + 2.0 * (noise.cross * hr) + noise.rate * rr,
        float(gust_worth(moments, noise.keep, noise.gust).sum()),
        float(noise.gyro @ moments.gyro),
        float(noise.compass @ moments.compass),
        np.asarray((noise.initial * moments.first).sum(axis=0)),
    )


def gust_worth(moments: Moments, keep: FloatArray, gust: FloatArray) -> FloatArray:
    """Return what the gusts' moments are worth in each step, shape (M,)."""
    after, between, before = moments.gust
    return np.asarray(gust * (after - keep * (2.0 * between - keep * before)))


def waves_worth(moments: Moments, wave: WaveNoise) -> float:
    """Return what the waves' moments are worth."""
    _, inverse, ahead, back = wave
    W, total = moments.waves, 0.0
    for i in (0, 1):
        for j in (0, 1):
            at = 2 * i + j
            total += float(inverse[at] @ W[2 + i, 2 + j] - 2.0 * (ahead[at] @ W[2 + i, j]) + back[at] @ W[i, j])
    return total


def information(
    factor: FloatArray,
    held: Held,
    rates: Rates,
    rudder: Rudder,
    rudders: Sequence[Rudder],
    noise: StepNoise,
    besides: Sequence[tuple[Scales, FloatArray]] = (),
) -> FloatArray:
    """Return the information about what `worth_by_boat` names, the path being found anew for each; of Gauss and Newton,
    shape (4 + P + Q, 4 + P + Q)."""
    begin, end, m, none = held.record.begin, held.record.begin + 1, held.motion.inside[1], np.zeros(1)
    ends = (_behind(m, held.record), held.motion.rate_by_rate)
    e0, e1 = (worth_by_boat(held, rates, rudder, rudders, Adjoint(each / m, none), besides) for each in ends)
    _, _, t, u, by_rate, by_gust, _ = held.motion
    w0, w1 = noise.angle * e0 + noise.cross * e1, noise.cross * e0 + noise.rate * e1
    slope = np.zeros((e0.shape[0], *held.states.shape))
    slope[:, end, 0], slope[:, end, 1] = w0, w1
    slope[:, begin, 0] -= w0
    slope[:, begin, 1] -= t * w0 + by_rate * w1
    for each in held.pushing:
        slope[:, begin, each] -= u * w0 + by_gust * w1
    flat = slope.reshape(e0.shape[0], -1).T
    answer, _ = dpbtrs(factor, flat, lower=1)
    return np.asarray(e0 @ w0.T + e1 @ w1.T - flat.T @ answer)


class Offset(NamedTuple):
    """How a number of the weather changes what is unexplained: a share of what drives the boat, of what gyro and
    compass leave; what it adds to the gust's and the waves' own steps, shape (M,) and (2, M), and to the states where
    segments begin, shape (S, D). Changes of a size count as shares of it, those of how a state goes on divided by
    sqrt(2)."""

    driven: FloatArray | float
    gyro: float
    compass: float
    gust: FloatArray
    waves: FloatArray
    first: FloatArray


def weather_information(factor: FloatArray, held: Held, noise: StepNoise, offsets: Sequence[Offset]) -> FloatArray:
    """Return the average information about the weather's numbers, shape (K, K).

    Of sizes it is the mean of the observed and of the expected one, 2 c'(1 - J H^-1 J')c (Gilmour, Thompson and Cullis
    1995), c the part of what is unexplained, in its standard deviations, that goes with the number and J how all of it
    goes with the path.
    """
    record, motion, states = held.record, held.motion, held.states
    begin, end, first = record.begin, record.begin + 1, record.first
    _, _, t, u, by_rate, by_gust, _ = motion
    e0, e1 = motion.heading, motion.rate
    w0, w1 = noise.angle * e0 + noise.cross * e1, noise.cross * e0 + noise.rate * e1
    is_seen = noise.wave is not None and WAVE not in held.pushing
    pull, parts, weighed = np.zeros((len(offsets), *states.shape)), [], []
    for slope, offset in zip(pull, offsets, strict=True):
        d0, d1 = offset.driven * w0, offset.driven * w1
        slope[end, 0], slope[end, 1] = d0, d1
        slope[begin, 0] -= d0
        slope[begin, 1] -= t * d0 + by_rate * d1
        for each in held.pushing:
            slope[begin, each] -= u * d0 + by_gust * d1
        gust = noise.gust * offset.gust
        slope[end, 2] += gust
        slope[begin, 2] -= noise.keep * gust
        initial = noise.initial * offset.first
        slope[first] += initial
        part = [offset.driven * e0, offset.driven * e1, offset.gust, offset.first.ravel()]
        weight = [d0, d1, gust, initial.ravel()]
        if noise.wave is not None:
            moved, inverse, *_ = noise.wave
            x, v = offset.waves
            w2, w3 = inverse[0] * x + inverse[1] * v, inverse[2] * x + inverse[3] * v
            slope[end, 3] += w2
            slope[end, 4] += w3
            slope[begin, 3] -= moved[0] * w2 + moved[2] * w3
            slope[begin, 4] -= moved[1] * w2 + moved[3] * w3
            part += [x, v]
            weight += [w2, w3]
        for column, share, sizes, values in (
            (1, offset.gyro, noise.gyro, record.rate),
            (0, offset.compass, noise.compass, record.heading),
        ):
            off = share * (states[:, column] - values + (states[:, WAVE + column] if is_seen else 0.0))
            slope[:, column] += sizes * off
            if is_seen:
                slope[:, WAVE + column] += sizes * off
            part.append(off)
            weight.append(sizes * off)
        parts.append(np.concatenate(part))
        weighed.append(np.concatenate(weight))
    flat = pull.reshape(len(offsets), -1).T
    answer, _ = dpbtrs(factor, flat, lower=1)
    return np.asarray(2.0 * (np.array(parts) @ np.array(weighed).T - flat.T @ answer))
