"""How strong the gusts are, and how good the instruments: what a filter must know before it can weigh samples.

Gusts and what the model leaves out enter as white noise on r'. Of each of a row of strengths a Kalman filter over
heading and rate alone, the parameters held, tells how likely the record is:

    -2 log L = sum log det S_k + e_k' S_k^-1 e_k

and the strength that makes it most likely is taken (Ljung 1999, section 7.4). All strengths pass over the record at
once. A heading that drifts away betrays gusts long before the rates' own scatter does, and for a boat that is
course-unstable, whose simulation strays however good the model is, the filter stays with the record.

The instruments' noise comes from second differences of the record, or of what a simulation leaves of it where that is
less: there the motion itself is gone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.filters.midpoint import FloatArray
from autopilot.identification.noise import instrument_noise
from autopilot.identification.prediction import simulate_run
from autopilot.identification.recursive import Steps
from autopilot.identification.runs import Run
from autopilot.models.norrbin import Norrbin, at_speed_ratio, yaw_acceleration

LEAST_PROCESS, LARGEST_PROCESS, STRENGTHS = 1.0e-5, 3.0, 23
"""Gusts make the rate stray by between these shares of the typical rate; the strengths tried lie a factor of 1.8
apart, which is closer than a record tells them."""

LONGEST_LOOK = 20000
"""Steps of a long record that the strength is taken from; the others would cost more than they tell."""


class RunNoise(NamedTuple):
    """process [rad/s/sqrt(s)]: root of the intensity on the rate. rate [rad/s], heading [rad]: the instruments'."""

    process: float
    rate: float
    heading: float


class Passage(NamedTuple):
    """A segment's n steps with the rudder [rad] at the beginning, middle and end of each, shape (n, 3), the state that
    it begins with, heading [rad] and rate [rad/s], their variances, and the measurements' variances, shapes (2,)."""

    steps: Steps
    rudder: FloatArray
    start: FloatArray
    variance: FloatArray
    R: FloatArray


def instruments(model: Norrbin, runs: Sequence[Run]) -> tuple[float, float]:
    """Return the noise of rate [rad/s] and heading [rad], 1 where nothing is measured."""
    rates, headings = [], []
    for run in runs:
        simulated = simulate_run(model, run) if model.n1 > 0.0 else [np.zeros((s.time.size, 2)) for s in run.segments]
        for segment, motion in zip(run.segments, simulated, strict=True):
            rates.append(min(instrument_noise(segment.rate), instrument_noise(segment.rate - motion[:, 0])))
            headings.append(min(instrument_noise(segment.heading), instrument_noise(segment.heading - motion[:, 1])))
    return _typical(rates), _typical(headings)


def gust_strength(model: Norrbin, unit: float, passages: Sequence[Passage]) -> float:
    """Return the process noise [rad/s/sqrt(s)] with which `model` explains the passages best; unit: a typical rate."""
    memory = float(np.sqrt(2.0 / model.time_constant))
    strengths = unit * memory * np.geomspace(LEAST_PROCESS, LARGEST_PROCESS, STRENGTHS)
    total, left = np.zeros(STRENGTHS), LONGEST_LOOK
    for passage in passages:
        total += _unlikeliness(model, strengths, passage, left)
        left -= min(left, passage.steps.dt.size)
    known = np.where(np.isfinite(total), total, np.inf)
    return float(strengths[int(np.argmin(known))])


def _unlikeliness(model: Norrbin, strengths: FloatArray, passage: Passage, most: int) -> FloatArray:
    """Return -2 log L of a passage for each strength: heading and rate with their covariance a, b, c, all at once."""
    psi, r = (np.full(strengths.size, value) for value in passage.start)
    a, b, c = np.full(strengths.size, passage.variance[0]), np.zeros(strengths.size), passage.variance[1] + 0.0 * r
    intensity, total = strengths**2, np.zeros(strengths.size)
    steps = passage.steps
    for dt, drive, z in zip(steps.dt[:most], steps.inputs, steps.measured, strict=False):
        boat = at_speed_ratio(model, drive.ratio)
        psi, r, keep, turn = _moved(boat, psi, r, drive.rudder, float(dt))
        a, b, c = a + turn * (2.0 * b + turn * c), keep * (b + turn * c), keep * keep * c
        a, b, c = a + intensity * dt**3 / 3.0, b + intensity * dt**2 / 2.0, c + intensity * dt
        if z[0] == z[0]:
            S, e = a + passage.R[0], z[0] - psi
            total += np.log(S) + e * e / S
            psi, r, a, b, c = psi + a / S * e, r + b / S * e, a - a * a / S, b - a * b / S, c - b * b / S
        if z[1] == z[1]:
            S, e = c + passage.R[1], z[1] - r
            total += np.log(S) + e * e / S
            psi, r, a, b, c = psi + b / S * e, r + c / S * e, a - b * b / S, b - b * c / S, c - c * c / S
    return total


def _moved(boat: Norrbin, psi: Any, r: Any, rudder: float, dt: float) -> tuple[Any, Any, Any, Any]:
    """Return heading and rate after a step of the midpoint rule, taken twice, and the slopes of both by the rate."""
    keep: Any = 1.0
    turn: Any = 0.0
    h = 0.5 * dt
    for _ in range(2):
        middle = r + 0.5 * h * yaw_acceleration(boat, r, rudder)
        psi, r = psi + h * middle, r + h * yaw_acceleration(boat, middle, rudder)
        decay = -(3.0 * boat.n3 * middle * middle + boat.n1) / boat.time_constant
        half = keep * (1.0 + 0.5 * h * decay)
        turn, keep = turn + h * half, keep + h * decay * half
    return psi, r, keep, turn


def _typical(noises: Sequence[float]) -> float:
    known = [noise for noise in noises if np.isfinite(noise)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else 1.0
