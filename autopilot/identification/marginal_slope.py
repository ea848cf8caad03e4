"""How the likelihood of a recording changes with the boat and the weather, without searching for the path anew.

The loss is f(x) + 1/2 ln det H at the best path x, H the curvature of f there. Its derivative by a parameter needs no
derivative of the path: with Z = H^-1 and l = H^-1 g, g the slope of 1/2 tr(Z H) by the path,

    F = f + 1/2 tr(Z H) - l . (slope of f by the path)

has the same derivative with x, Z and l held (the adjoint of the path's own condition). Each term of F belongs to one
step or one sample, so that it is a sum of what the second moments of each step's unexplained part are worth. Of Z only
what a state has to do with itself and the next one is needed: eliminating all states before a node, and all behind the
next one, leaves those two with each other.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs

from autopilot.identification.likelihood_record import Record
from autopilot.identification.marginal_likelihood import (
    Motion,
    Path,
    Rates,
    StepNoise,
    WaveNoise,
    motion_of,
    probe_of,
)
from autopilot.identification.runs import FloatArray

BEND = 1.0e3
"""Times the probe of first differences: the step of second ones."""

Rudder = tuple[FloatArray, FloatArray]


class Held(NamedTuple):
    """What F holds: the path's states, covariance of each step's two nodes, shape (2 D, 2 D, M), l, shape (N, D), the
    step of differences by rate [rad/s], and how the steps go on."""

    record: Record
    states: FloatArray
    pairs: FloatArray
    pull: FloatArray
    probe: float
    motion: Motion

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


def held_at(path: Path, rates: Rates, record: Record, rudder: Rudder, noise: StepNoise) -> Held:
    """Return what belongs to the best `path`. LinAlgError where rounding leaves its information not positive."""
    states, probe = path.states, probe_of(path.states)
    D = states.shape[1]
    assert path.band is not None and path.factor is not None
    pairs = _pairs(path.band, path.factor, record, D)
    motion = motion_of(rates, record, rudder, states, probe)
    held = Held(record, states, pairs, np.zeros_like(states), probe, motion)
    bent, sizes = np.zeros_like(states), (BEND * probe, BEND * probe / float(record.step[0]))
    moved = np.repeat(states[None, :, :3], 4, axis=0)
    for k, size in enumerate(sizes):
        moved[2 * k, :, 1 + k] += size
        moved[2 * k + 1, :, 1 + k] -= size
    traces = 0.5 * _weighed(_spread(held, motion_of(rates, record, rudder, moved, probe)), noise)
    for k, size in enumerate(sizes):
        bent[record.begin, 1 + k] = (traces[2 * k] - traces[2 * k + 1]) / (2.0 * size)
    pull, _ = dpbtrs(path.factor, bent.ravel(), lower=1)
    return held._replace(pull=pull.reshape(states.shape))


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
    """Return the inverses of positive matrices side by side, shape (n, n, M), in their place: by sweeps of Gauss and
    Jordan, each for all of them at once."""
    for k in range(matrices.shape[0]):
        pivot, column = 1.0 / matrices[k, k], matrices[:, k].copy()
        row = matrices[k] * pivot
        matrices -= column[:, None] * row
        matrices[k], matrices[:, k] = row, -column * pivot
        matrices[k, k] = pivot
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


def _spread(held: Held, motion: Motion) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the covariances of what drives each step, (heading, heading), (heading, rate) and (rate, rate), of each
    motion."""
    P, D = held.pairs, held.states.shape[1]
    _, _, t, u, m, g = motion
    of_heading = [P[D, i] - P[0, i] - t * P[1, i] - u * P[2, i] for i in (0, 1, 2, D, D + 1)]
    of_rate = [P[D + 1, i] - m * P[1, i] - g * P[2, i] for i in (1, 2, D + 1)]
    hh = of_heading[3] - of_heading[0] - t * of_heading[1] - u * of_heading[2]
    hr = of_heading[4] - m * of_heading[1] - g * of_heading[2]
    rr = of_rate[2] - m * of_rate[0] - g * of_rate[1]
    return hh, hr, rr


def _weighed(moments: tuple[FloatArray, FloatArray, FloatArray], noise: StepNoise) -> FloatArray:
    """Return what moments of heading and rate are worth in each step."""
    hh, hr, rr = moments
    return noise.angle * hh + 2.0 * noise.cross * hr + noise.rate * rr


def driven_moments(held: Held, motion: Motion) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return `Moments.driven`."""
    begin, end, pull = held.record.begin, held.record.begin + 1, held.pull
    e0, e1, t, u, m, g = motion
    hh, hr, rr = _spread(held, motion)
    l0 = pull[end, 0] - pull[begin, 0] - t * pull[begin, 1] - u * pull[begin, 2]
    l1 = pull[end, 1] - m * pull[begin, 1] - g * pull[begin, 2]
    return hh + e0 * (e0 - 2.0 * l0), hr + e0 * e1 - e0 * l1 - e1 * l0, rr + e1 * (e1 - 2.0 * l1)


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
        if D == 5:
            wave = 3 + column
            seen, drawn = seen + held.states[:, wave], drawn + held.pull[:, wave]
            P = held.pairs
            own = own + P[wave, wave] + 2.0 * P[column, wave]
            own_last = own_last + P[D + wave, D + wave, closing] + 2.0 * P[D + column, D + wave, closing]
        variance = np.empty(record.nodes)
        variance[record.begin], variance[last] = own, own_last
        off = seen - values
        parts.append(off * (off - 2.0 * drawn) + variance)
    return Moments(
        driven_moments(held, held.motion),
        (held.moment(D + 2, D + 2), held.moment(D + 2, 2), held.moment(2, 2)),
        waves,
        parts[0],
        parts[1],
        x * (x - 2.0 * pull) + spread,
    )


class Worth(NamedTuple):
    """What the moments are worth in F, twice: of what drives heading and rate, of gusts, gyro and compass, and of the
    first states, shape (D,)."""

    driven: float
    gust: float
    gyro: float
    compass: float
    first: FloatArray


def worth_of(moments: Moments, noise: StepNoise) -> Worth:
    """Return what the moments are worth, those of waves left out."""
    return Worth(
        driven_worth(moments.driven, noise),
        gust_worth(moments, noise.keep, noise.gust),
        float(noise.gyro @ moments.gyro),
        float(noise.compass @ moments.compass),
        np.asarray(noise.initial * moments.first.sum(axis=0)),
    )


def driven_worth(driven: tuple[FloatArray, FloatArray, FloatArray], noise: StepNoise) -> Any:
    """Return what the moments of heading and rate are worth, of each motion, shape (...,)."""
    hh, hr, rr = driven
    return hh @ noise.angle + 2.0 * (hr @ noise.cross) + rr @ noise.rate


def gust_worth(moments: Moments, keep: FloatArray, gust: FloatArray) -> float:
    """Return what the gusts' moments are worth."""
    after, between, before = moments.gust
    return float(gust @ (after - keep * (2.0 * between - keep * before)))


def waves_worth(moments: Moments, wave: WaveNoise) -> float:
    """Return what the waves' moments are worth."""
    _, inverse, ahead, back = wave
    W, total = moments.waves, 0.0
    for i in (0, 1):
        for j in (0, 1):
            at = 2 * i + j
            total += float(inverse[at] @ W[2 + i, 2 + j] - 2.0 * (ahead[at] @ W[2 + i, j]) + back[at] @ W[i, j])
    return total


def information(factor: FloatArray, held: Held, noise: StepNoise, changes: FloatArray) -> FloatArray:
    """Return the information about parameters that change what each step leaves of heading and rate by `changes`, shape
    (P, 2, M), the path being found anew for each; of Gauss and Newton, shape (P, P)."""
    begin, end = held.record.begin, held.record.begin + 1
    N, D = held.states.shape
    _, _, t, u, m, g = held.motion
    e0, e1 = changes[:, 0], changes[:, 1]
    w0, w1 = noise.angle * e0 + noise.cross * e1, noise.cross * e0 + noise.rate * e1
    slope = np.zeros((changes.shape[0], N, D))
    slope[:, end, 0], slope[:, end, 1] = w0, w1
    slope[:, begin, 0] -= w0
    slope[:, begin, 1] -= t * w0 + m * w1
    slope[:, begin, 2] -= u * w0 + g * w1
    flat = slope.reshape(changes.shape[0], -1).T
    answer, _ = dpbtrs(factor, flat, lower=1)
    return np.asarray(e0 @ w0.T + e1 @ w1.T - flat.T @ answer)
