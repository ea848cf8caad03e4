"""The extended Kalman filter over heading, rate and parameters in Friedland's separated form, linear in the parameters.

Parameters that stay as they are need no filter of their own: one filter follows heading and rate with the parameters
held at a point theta_0, and beside it runs how its prediction moves with them, M = dx/dtheta:

    x- = f(x, theta_0),  M- = f_x M + f_theta;   x = x- + k e,  M = (I - k H) M-,  Psi = H M-
    e(theta) = e - Psi (theta - theta_0)

so that the belief about theta follows by least squares of innovations, at every step and for all of the record. That is
the filter with the parameters as states (Friedland 1969), but its slopes belong to one point instead of to what it
happens to believe at each moment. Early beliefs are rough, and what was counted as information on a rough belief is
never taken back: on a slow boat, where K, T and n3 move the motion alike, such a filter ends too sure and in the wrong
place. Passes over the record move theta_0 to where the one before ended, prior and all else as before: Gauss and
Newton's method. The standard errors are those of scores Psi' e that may remember, as in the output-error fit, not those
of noise that does exactly what the filter supposes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.filters.kalman import FloatArray, Gaussian
from autopilot.identification.gust_strength import Passage
from autopilot.identification.residuals import robust_covariance
from autopilot.models.norrbin import Norrbin, at_speed_ratio


class Innovations(NamedTuple):
    """What each of n steps told, in units of its standard deviation: the innovations of heading and rate, shape (n, 2),
    and how they fall with the parameters, shape (n, 2, p); 0 where nothing was measured."""

    value: FloatArray
    slope: FloatArray


class Separated:
    """The filter of one segment with the parameters (ln K, ln T, n0/w[, n3 w^2]) held at those of a model.

    unit: the typical rate w [rad/s]; cubic: whether n3 is among the parameters; process: the process noise
    [rad/s/sqrt(s)].
    """

    def __init__(self, model: Norrbin, unit: float, cubic: bool, process: float) -> None:
        self._model, self._unit, self._count, self._process = model, unit, 4 if cubic else 3, process

    def innovations(self, passage: Passage) -> Innovations:
        """Return what the passage tells."""
        steps, p = passage.steps, self._count
        n = steps.dt.size
        value, slope = np.zeros((n, 2)), np.zeros((n, 2, p))
        self._psi, self._r = passage.start.tolist()
        self._a, self._b, self._c = float(passage.variance[0]), 0.0, float(passage.variance[1])
        self._by_psi, self._by_r = [0.0] * p, [0.0] * p
        R = passage.R.tolist()
        rows = zip(steps.dt.tolist(), passage.rudder.tolist(), steps.inputs, steps.measured.tolist(), strict=True)
        for k, (dt, rudder, drive, (heading, rate)) in enumerate(rows):
            self._predict(dt, rudder, drive.ratio)
            if heading == heading:
                value[k, 0], slope[k, 0] = self._take_heading(heading, R[0])
            if rate == rate:
                value[k, 1], slope[k, 1] = self._take_rate(rate, R[1])
        return Innovations(value, slope)

    def _predict(self, dt: float, rudder: list[float], ratio: float) -> None:
        """A step of Runge and Kutta's with the rudder at its beginning, middle and end, and of what moves beside it; in
        the last place how the step moves with the rate that it begins with."""
        boat, third = at_speed_ratio(self._model, ratio), dt / 6.0
        begun, beside = self._r, [*self._by_r, 1.0]
        k1, d1 = self._slope(boat, ratio, begun, beside, rudder[0])
        k2, d2 = self._slope(boat, ratio, begun + 0.5 * dt * k1, _ahead(beside, 0.5 * dt, d1), rudder[1])
        k3, d3 = self._slope(boat, ratio, begun + 0.5 * dt * k2, _ahead(beside, 0.5 * dt, d2), rudder[1])
        k4, d4 = self._slope(boat, ratio, begun + dt * k3, _ahead(beside, dt, d3), rudder[2])
        self._r = begun + third * (k1 + 2.0 * (k2 + k3) + k4)
        self._psi += dt * (begun + third * (k1 + k2 + k3))
        *self._by_r, keep = [
            m + third * (e + 2.0 * (f + g) + i) for m, e, f, g, i in zip(beside, d1, d2, d3, d4, strict=True)
        ]
        turned = [dt * (m + third * (e + f + g)) for m, e, f, g in zip(beside, d1, d2, d3, strict=True)]
        self._by_psi = [m + x for m, x in zip(self._by_psi, turned, strict=False)]
        turn, a, b, c, Q = turned[-1], self._a, self._b, self._c, self._process**2 * dt
        self._a = a + turn * (2.0 * b + turn * c) + Q * dt * dt / 3.0
        self._b, self._c = keep * (b + turn * c) + 0.5 * Q * dt, keep * keep * c + Q

    def _slope(
        self, boat: Norrbin, ratio: float, r: float, beside: list[float], rudder: float
    ) -> tuple[float, list[float]]:
        """Return r' and how it moves with the parameters and with the rate."""
        T, w, square = boat.time_constant, self._unit * ratio, r * r
        drive = boat.gain * rudder / T
        rate = drive - (boat.n0 + (boat.n3 * square + boat.n1) * r) / T
        decay = -(3.0 * boat.n3 * square + boat.n1) / T
        push = drive, -rate, -w / T, -square * r / (T * w * w)
        return rate, [*(decay * m + f for m, f in zip(beside[:-1], push, strict=False)), decay * beside[-1]]

    def _take_heading(self, measured: float, variance: float) -> tuple[float, list[float]]:
        size, e, told = self._a + variance, measured - self._psi, self._by_psi
        self._correct(self._a / size, self._b / size, e, told)
        self._a, self._b, self._c = (
            self._a * variance / size,
            self._b * variance / size,
            self._c - self._b * self._b / size,
        )
        root = math.sqrt(size)
        return e / root, [m / root for m in told]

    def _take_rate(self, measured: float, variance: float) -> tuple[float, list[float]]:
        size, e, told = self._c + variance, measured - self._r, self._by_r
        self._correct(self._b / size, self._c / size, e, told)
        self._a, self._b, self._c = (
            self._a - self._b * self._b / size,
            self._b * variance / size,
            self._c * variance / size,
        )
        root = math.sqrt(size)
        return e / root, [m / root for m in told]

    def _correct(self, of_psi: float, of_r: float, e: float, told: list[float]) -> None:
        self._psi += of_psi * e
        self._r += of_r * e
        self._by_psi = [m - of_psi * x for m, x in zip(self._by_psi, told, strict=True)]
        self._by_r = [m - of_r * x for m, x in zip(self._by_r, told, strict=True)]


def _ahead(values: list[float], step: float, slopes: list[float]) -> list[float]:
    return [m + step * f for m, f in zip(values, slopes, strict=True)]


def beliefs(told: Innovations, about: FloatArray, prior: Gaussian) -> tuple[FloatArray, FloatArray]:
    """Return the parameters after each step, shape (n, p), and their covariance at the end, shape (p, p), by what was
    told about the point `about`, shape (p,), after a prior."""
    root = np.linalg.inv(prior.covariance)
    information = root + np.cumsum(np.einsum("nci,ncj->nij", told.slope, told.slope), axis=0)
    score = root @ (prior.mean - about) + np.cumsum(np.einsum("nci,nc->ni", told.slope, told.value), axis=0)
    return about + np.linalg.solve(information, score[:, :, None])[:, :, 0], np.linalg.inv(information[-1])


def together_told(told: Sequence[Innovations]) -> Innovations:
    """Return one segment's innovations after the other's."""
    return Innovations(np.concatenate([each.value for each in told]), np.concatenate([each.slope for each in told]))


def covariance_of(told: Sequence[Innovations], off: FloatArray, prior: FloatArray) -> FloatArray:
    """Return the covariance, shape (p, p), of an estimate that lies `off` the point of what each segment told, beside
    a prior's: of scores that may remember (`noise.robust_covariance`). What the record does not tell stays as it was.
    """
    flat = np.concatenate([each.slope.reshape(-1, off.size) for each in told])
    information, certain = flat.T @ flat, np.linalg.inv(prior)
    scores = robust_covariance([each.slope for each in told], [each.value - each.slope @ off for each in told])
    outer = np.linalg.inv(information + certain)
    return np.asarray(outer @ (information @ scores @ information + certain) @ outer)
