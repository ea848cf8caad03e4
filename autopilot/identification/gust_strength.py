"""How strong the gusts are, and how good the instruments: what a filter must know before it can weigh samples.

Gusts and what the model leaves out enter as white noise on r'. Of each of a row of strengths a Kalman filter over
heading and rate alone, the parameters held, tells how likely the record is:

    -2 log L = sum log det S_k + e_k' S_k^-1 e_k

and the strength that makes it most likely is taken (Ljung 1999, section 7.4). A heading that drifts away betrays gusts
long before the rates' own scatter does, and where a boat is course-unstable, and its simulation strays however good the
model is, the filter stays with the record.

The instruments' noise comes from second differences of the record, or of what a simulation leaves of it where that is
less: there the motion itself is gone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.filters.kalman import FloatArray
from autopilot.identification.augmented_state import Steps
from autopilot.identification.residual_tests import simulate_run
from autopilot.identification.residuals import instrument_noise
from autopilot.identification.runs import Run
from autopilot.models.norrbin import Norrbin, at_speed_ratio

LEAST_PROCESS, LARGEST_PROCESS, STRENGTHS = 1.0e-5, 3.0, 23
"""Gusts make the rate stray by between these shares of the typical rate; the strengths tried lie a factor of 1.8 apart,
which is closer than a record tells them."""

ROUGHLY = 4
"""Where nothing is known, every fourth strength is tried before the search goes uphill."""

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


def gust_strength(model: Norrbin, unit: float, passages: Sequence[Passage], near: float | None = None) -> float:
    """Return the process noise [rad/s/sqrt(s)] with which `model` explains the passages best; unit: a typical rate;
    near: where to look first."""
    memory = math.sqrt(2.0 / model.time_constant)
    strengths = (unit * memory * np.geomspace(LEAST_PROCESS, LARGEST_PROCESS, STRENGTHS)).tolist()
    tried: dict[int, float] = {}

    def unlikeliness(place: int) -> float:
        if place not in tried:
            total = _of_all(model, strengths[place], passages)
            tried[place] = total if math.isfinite(total) else math.inf
        return tried[place]

    begin = range(0, STRENGTHS, ROUGHLY)
    if near is not None:
        begin = range(int(np.argmin(np.abs(np.log(strengths) - math.log(near)))), STRENGTHS, STRENGTHS)
    best = min(begin, key=unlikeliness)
    while True:
        beside = range(max(best - 1, 0), min(best + 2, STRENGTHS))
        better = min(beside, key=unlikeliness)
        if unlikeliness(better) >= unlikeliness(best):
            return float(strengths[best])
        best = better


def _of_all(model: Norrbin, process: float, passages: Sequence[Passage]) -> float:
    total, left = 0.0, LONGEST_LOOK
    for passage in passages:
        total += _unlikeliness(model, process * process, passage, left)
        left -= min(left, passage.steps.dt.size)
    return total


def _unlikeliness(model: Norrbin, intensity: float, passage: Passage, most: int) -> float:
    """Return -2 log L of a passage, but for a constant: heading and rate with their covariance a, b, c, in plain
    numbers, by two steps of the midpoint rule each."""
    steps, (psi, r), (a, c), (R_heading, R_rate) = passage.steps, *(v.tolist() for v in passage[2:])
    b, total, ratio, log = 0.0, 0.0, 0.0, math.log
    for dt, drive, (heading, rate) in zip(
        steps.dt[:most].tolist(), steps.inputs, steps.measured.tolist(), strict=False
    ):
        if drive.ratio != ratio:
            boat = at_speed_ratio(model, drive.ratio)
            ratio, T, n1, n3 = drive.ratio, boat.time_constant, boat.n1, boat.n3
        push = boat.gain * drive.rudder - boat.n0
        keep, turn, h = 1.0, 0.0, 0.5 * dt
        for _ in range(2):
            middle = r + 0.5 * h * (push - (n3 * r * r + n1) * r) / T
            psi, r = psi + h * middle, r + h * (push - (n3 * middle * middle + n1) * middle) / T
            decay = -(3.0 * n3 * middle * middle + n1) / T
            half = keep * (1.0 + 0.5 * h * decay)
            turn, keep = turn + h * half, keep + h * decay * half
        a, b, c = a + turn * (2.0 * b + turn * c), keep * (b + turn * c), keep * keep * c
        a, b, c = a + intensity * dt**3 / 3.0, b + intensity * dt**2 / 2.0, c + intensity * dt
        if heading == heading:
            S, e = a + R_heading, heading - psi
            total += log(S) + e * e / S
            psi, r, a, b, c = psi + a / S * e, r + b / S * e, a - a * a / S, b - a * b / S, c - b * b / S
        if rate == rate:
            S, e = c + R_rate, rate - r
            total += log(S) + e * e / S
            psi, r, a, b, c = psi + b / S * e, r + c / S * e, a - b * b / S, b - b * c / S, c - c * c / S
    return total


def _typical(noises: Sequence[float]) -> float:
    known = [noise for noise in noises if np.isfinite(noise)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else 1.0
