"""What other boats say of one that is not yet known: their K, T and n3 without dimensions, and how those scatter.

With h = L/U, a' = K' /T' = (K/T) h^2, b' = n1/T' = (n1/T) h and d' = n3'/T' = (n3/T)/h, where K' = K h, T' = T/h and
n3' = n3/h^2 (the "prime" scaling of SNAME 1952, Nomoto et al. 1957). a' and d' are taken to be log-normal, b', which
may have either sign, normal. Boats of like length count most: the mean is weighted with the distance of the lengths'
logarithms, the deviation lies between that of the boats near by and that of all.

A fit's answer (mean and covariance of a, b, d, e) and what the other boats say are put together where both are most
likely, and it is said how much of it is the other boats'. The further both are apart, the less the other boats count;
where they contradict each other the recording alone is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from autopilot.identification.marginal_likelihood import Rates
from autopilot.identification.runs import FloatArray
from autopilot.models.norrbin import Norrbin

CONTRADICTS = float(chdtri(3, 0.01))
"""A recording contradicts the other boats where their squared distance, in deviations, is one in a hundred's."""
WIDENED, LIKE = 1.3, 2.0
"""What deviations are multiplied by, for boats do not scatter normally, and the distance of the lengths' logarithms
within which boats are alike: of 0.7, 1, 1.5, 2, 3 and any, the one that makes each published boat likeliest as the
others let expect it. 26 of 28 numbers lie in 95 % intervals then (`benchmarks/ordinary_sailing.py boats`)."""
ALL_COUNT = 4.0
"""So many boats' worth the deviation of all counts beside that of the boats near by."""
MATTERS = 0.05
"""Shares of the knowledge below this are not the other boats'."""
LEAST_CUBIC = 0.5
"""An n3 whose standard error is more than this share of it is no number of the boat's."""
ROUNDS = 50


class KnownBoat(NamedTuple):
    """name, length [m], model, and the standard error of n3 [s^2/rad^2], 0 where none is given."""

    name: str
    length: float
    model: Norrbin
    n3_error: float = 0.0


class Expected(NamedTuple):
    """Mean and deviation of ln a, b and ln d of one boat, shape (3,) each, in SI units; from how many `boats`."""

    mean: FloatArray
    deviation: FloatArray
    boats: int


class BoatPrior(NamedTuple):
    """Mean and deviation of ln a', b' and ln d', shape (3,) each, for a boat of `length` [m]; from how many `boats`."""

    mean: FloatArray
    deviation: FloatArray
    boats: int
    length: float

    def at(self, speed: float) -> Expected:
        """Return what is expected at the reference `speed` [m/s]."""
        h = self.length / speed
        shift = np.array([-2.0 * math.log(h), 0.0, math.log(h)])
        scale = np.array([1.0, 1.0 / h, 1.0])
        return Expected(self.mean * scale + shift, self.deviation * scale, self.boats)


def primes(boat: KnownBoat) -> tuple[float, float, float]:
    """Return ln a', b' and ln d'; the last is nan where n3 is not known."""
    model = boat.model
    h = boat.length / model.reference_speed
    a, b, d = model.gain / model.time_constant, model.n1 / model.time_constant, model.n3 / model.time_constant
    known = model.n3 > 0.0 and boat.n3_error < LEAST_CUBIC * model.n3
    return math.log(a * h * h), b * h, math.log(d / h) if known else math.nan


def prior_of(boats: Sequence[KnownBoat], length: float) -> BoatPrior:
    """Return what `boats` say of another of `length` [m]. Raises ValueError for fewer than three with an n3."""
    table = np.array([primes(boat) for boat in boats])
    known = np.isfinite(table)
    if len(boats) < 3 or known.sum(axis=0).min() < 3:
        raise ValueError("what other boats say takes three of them at least")
    far = np.log([boat.length / length for boat in boats]) / LIKE
    weight = np.where(known, np.exp(-0.5 * far * far)[:, None] + 1.0e-9, 0.0)
    total, values = weight.sum(axis=0), np.where(known, table, 0.0)
    worth = total**2 / (weight**2).sum(axis=0)
    mean = (weight * values).sum(axis=0) / total
    near = (weight * (values - mean) ** 2).sum(axis=0) / total
    square = (worth * near + ALL_COUNT * np.nanvar(table, axis=0, ddof=1)) / (worth + ALL_COUNT)
    return BoatPrior(mean, WIDENED * np.sqrt(square * (1.0 + 1.0 / worth)), len(boats), length)


class Combined(NamedTuple):
    """rates and covariance of a, b, d, e, shape (4, 4), of recording and other boats together; shares of the other
    boats in what is known of a, b and d. contradicted: the recording alone was taken."""

    rates: Rates
    covariance: FloatArray
    shares: tuple[float, float, float]
    contradicted: bool = False


def combined(rates: Rates, covariance: FloatArray, expected: Expected) -> Combined:
    """Return a fit's `rates`, with the covariance of a, b, d and e, put together with what is expected of the boat.

    Newton's steps in ln a, b, ln d and e, in which what is expected is normal.
    """
    nothing = (0.0, 0.0, 0.0)
    if rates.a <= 0.0:
        return Combined(rates, covariance, nothing)
    found = np.array([rates.a, rates.b, max(rates.d, 1.0e-12), rates.e])
    distance = _distance(found, covariance, expected)
    if distance > CONTRADICTS:
        return Combined(rates, covariance, nothing, contradicted=True)
    weight = np.linalg.pinv(covariance, hermitian=True)
    # a boat that is further off than boats are on average may be another kind: it is expected less surely
    pull = np.append(expected.deviation**-2.0 / max(1.0, distance / expected.deviation.size), 0.0)
    mean = np.append(expected.mean, 0.0)

    def loss(y: FloatArray) -> float:
        off = _opened(y) - found
        return float(0.5 * off @ weight @ off + 0.5 * np.sum(pull * (y - mean) ** 2))

    starts = [
        np.array([math.log(found[0]), found[1], math.log(found[2]), found[3]]),
        np.append(expected.mean, found[3]),
    ]
    y: FloatArray = min(starts, key=loss)
    for _ in range(ROUNDS):
        x = _opened(y)
        slope_of = np.array([x[0], 1.0, x[2], 1.0])
        slope = slope_of * (weight @ (x - found)) + pull * (y - mean)
        curvature = np.outer(slope_of, slope_of) * weight + np.diag(pull)
        move = np.linalg.solve(curvature, -slope)
        size, here = min(1.0, 1.0 / float(np.max(np.abs(move[[0, 2]])) + 1.0e-300)), loss(y)
        while loss(y + size * move) > here and size > 1.0e-6:
            size *= 0.5
        y = y + size * move
        if float(np.max(np.abs(size * move) / np.maximum(np.abs(y), 1.0e-3))) < 1.0e-9:
            break
    x = _opened(y)
    stretched = np.array([x[0], 1.0, x[2], 1.0])
    spread = np.linalg.inv(np.outer(stretched, stretched) * weight + np.diag(pull))
    together = np.outer(stretched, stretched) * spread
    # of ln a and ln d: a recording that knows nothing of d does not know it better because d is small
    alone = np.diag(covariance)[:3] / np.array([x[0], 1.0, x[2]]) ** 2
    shares = np.clip(1.0 - np.diag(spread)[:3] / np.maximum(alone, 1.0e-300), 0.0, 1.0)
    if shares.max() < MATTERS:
        return Combined(rates, covariance, nothing)
    new = Rates(float(x[0]), float(x[1]), float(x[2]), float(x[3]))
    return Combined(new, together, (float(shares[0]), float(shares[1]), float(shares[2])))


def _opened(y: FloatArray) -> FloatArray:
    return np.array([math.exp(min(y[0], 50.0)), y[1], math.exp(min(y[2], 50.0)), y[3]])


def _distance(found: FloatArray, covariance: FloatArray, expected: Expected) -> float:
    """Return the squared distance between a fit and what is expected, in their deviations together."""
    middle = np.array([math.exp(expected.mean[0]), expected.mean[1], math.exp(expected.mean[2])])
    # where the recording says little of a or d, their logarithms there mean nothing: the larger of both is the unit
    unit = np.array([max(found[0], middle[0]), 1.0, max(found[2], middle[2])])
    known = covariance[:3, :3] / np.outer(unit, unit)
    off = (found[:3] - middle) / unit
    return float(off @ np.linalg.solve(known + np.diag(expected.deviation**2), off))
