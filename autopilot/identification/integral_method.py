"""The integral method: the yaw equation integrated over windows, solved for the windows of all runs together.

Norrbin's equation at the speed ratio s = U/U0, multiplied by s and integrated over a window, is linear in the
parameters at U0 and needs no yaw acceleration:

    n1 A = K D - T B - n3 C - n0 E
    A = int s dpsi,   B = change of r,   C = int r^3/s dt,   D = int s^2 delta dt,   E = int s^2 dt

At s = 1 that is the integrated equation of Liao et al., patent application of Harbin Engineering University (2019).
Each term goes through the same average, weighted like a tent (0 at the ends, 1 in the middle) over two neighbouring
blocks, twelve of which make a window: so the equation stays exact for the linear part, the sensors' noise is averaged,
and the mean of the yaw rate is the difference of two blocks' mean headings, a rate from headings alone. From the mean
of all tents of a window to the last of them it is the mean of the equations over all windows up to that length.

Least squares over the windows is biased: the yaw rate on the equation's right side is measured too, and its noise
lowers every estimate, the more so the less n3 can be distinguished from K. So each equation is multiplied by
instruments zeta in place of its own terms phi: the same integrals of a boat that is simulated beside, under the
recorded rudder and with the present estimate, whose motion knows nothing of the noise (the refined instrumental
variable of Young, 1976):

    R = sum zeta phi'/s^2,   f = sum zeta (y - phi' theta_0)/s^2,   theta = theta_0 + (R + Lambda)^-1 f

Lambda holds theta near the model it began with as far as the windows say nothing; s is the equations' error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from autopilot.errors import InputError
from autopilot.identification.identified import LARGEST_RELATIVE_ERROR, Convergence, Identified, Question
from autopilot.identification.identify import sources_of
from autopilot.identification.live_filter import moved_on
from autopilot.identification.methods import Method, begin, identified_as
from autopilot.identification.residuals import initial_state, instrument_noise
from autopilot.identification.runs import FloatArray, Run, Segment, running
from autopilot.models.norrbin import Norrbin

NAMES = ("gain", "time_constant", "n3", "n0")
PASSES = 3
"""How often the runs are gone through, each time with the boat simulated by the estimate of the time before."""
BLOCKS = 12
"""Tents in a window; more would follow its end closer, fewer average more."""
WINDOW_TIME_CONSTANTS, WINDOW_SHORTEST_S, WINDOW_LONGEST_S = 4.0, 3.0, 120.0
"""A window is this many time constants long, within these limits."""
CAUTION = 1.5
"""The first windows are that much shorter: where the first T is too long, it takes no long window to find out."""
PART_S = 0.75
"""Without measured rates the cube of the rate is that between the mean headings of parts of a block, of this length or
up to twice it: shorter ones have more noise, longer ones do not follow the turns of a zigzag."""
QUIETER_S = 3.0
"""Over blocks longer than this the mean headings' difference tells the mean rate better than measured rates do, at the
usual 0.2 deg and 0.1 deg/s of noise; and it knows no drift of a gyro."""
RATIO_LEAST = 0.2
"""Below this share of the reference speed nothing is learnt: the scaling with speed has no sense near rest."""
MOVES = math.radians(4.0)
"""Windows in which the rudder moves less tell nothing."""
BOUND = 10.0
"""K and T stay within this factor of the model it begins with."""
TRIM_RAD, CUBIC_SHARE = math.radians(3.0), 0.3
"""n0 is expected to be worth a rudder of this size; n3 to make this share of the damping at the typical rate, or to be
as large as it was."""
EXPECTED_ERROR_RAD, LEAST_ERROR_RAD = math.radians(0.1), math.radians(0.02)
"""The equations' error is taken to be at least the one where they are weighed against the model it began with, at least
the other for the standard errors."""


class Equations(NamedTuple):
    """One row a window: its end [s] since the beginning of the first run; what K, T, n3 and n0 are multiplied by, shape
    (n, 4); the left side n1 A [rad], shape (n,); how far the rudder moves [rad]; the mean square of the rate."""

    time: FloatArray
    terms: FloatArray
    left: FloatArray
    moves: FloatArray
    rate_square: FloatArray


class Motion(NamedTuple):
    """What a segment is integrated from, on its N samples: heading [rad] and rate [rad/s], nan where missing; noise
    [rad] of single headings."""

    heading: FloatArray
    rate: FloatArray
    noise: float = 0.0


def window_length(time_constant: float) -> float:
    """Return a length [s] for the windows of a boat with T = `time_constant` [s]."""
    return min(max(WINDOW_TIME_CONSTANTS * time_constant, WINDOW_SHORTEST_S), WINDOW_LONGEST_S)


def equations(segment: Segment, motion: Motion, model: Norrbin, length: float, begun: float = 0.0) -> Equations:
    """Return the equations of the windows of `length` [s] in a segment that moves so; n1 and the reference speed are
    the model's. begun [s]: when the segment began."""
    ratio = np.abs(segment.speed) / model.reference_speed
    spacing = float(np.median(np.diff(segment.time)))
    step = spacing * math.ceil(length / BLOCKS / spacing - 1.0e-6)
    parts = [
        _stretch(segment.time[rows], segment.rudder[rows], ratio[rows], _of(motion, rows), step)
        for rows in _moving(ratio)
        if segment.time[rows][-1] - segment.time[rows][0] > BLOCKS * step
    ]
    offset = begun - float(segment.time[0])
    tables = [_windows(*part, model.n1, offset) for part in parts]
    empty = Equations(np.zeros(0), np.zeros((0, 4)), np.zeros(0), np.zeros(0), np.zeros(0))
    return Equations(*(np.concatenate(columns) for columns in zip(empty, *tables, strict=True)))


def _moving(ratio: FloatArray) -> list[slice]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ratio >= RATIO_LEAST, [False])).astype(int)))
    return [slice(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _of(motion: Motion, rows: slice) -> Motion:
    return Motion(motion.heading[rows], motion.rate[rows], motion.noise)


def _stretch(
    time: FloatArray, rudder: FloatArray, ratio: FloatArray, motion: Motion, step: float
) -> tuple[FloatArray, FloatArray]:
    """Return the edges between blocks of `step` [s], shape (m,), and the tents' means there: of the integrals A, C, D
    and E, of the rate, and the blocks' mean rudder [rad] behind each; shape (m, 6)."""
    edges = np.arange(time[0], time[-1] + 1.0e-9, step)
    headed, rated = np.isfinite(motion.heading), np.isfinite(motion.rate)
    psi = np.interp(time, time[headed], motion.heading[headed]) if headed.any() else None
    rate = np.interp(time, time[rated], motion.rate[rated]) if rated.any() else None
    if psi is None:
        assert rate is not None
        psi = running(time, rate)
    square = ratio * ratio
    pushed, elapsed = running(time, square * rudder), running(time, square)
    turned = np.concatenate(([0.0], np.cumsum(ratio[1:] * np.diff(psi))))
    means = np.diff(_integrals(time, psi, edges)[0]) / step
    if rate is None or (step > QUIETER_S and headed.any()):
        change = np.diff(means) / step
    else:
        change = _tents(time, rate, edges)
    if rate is None:
        cubes = _cubes_of_headings(time, psi, motion.noise, step)
        cubed = running(cubes[0], cubes[1] / np.interp(cubes[0], time, ratio))
        c = _tents(cubes[0], cubed, edges)
    else:
        c = _tents(time, running(time, rate**3 / ratio), edges)
    tents = [_tents(time, each, edges) for each in (turned, pushed, elapsed)]
    pushes = np.diff(np.interp(edges, time, pushed)) / np.diff(np.interp(edges, time, elapsed))
    return edges[1:-1], np.stack([tents[0], c, tents[1], tents[2], change, pushes[1:]], axis=1)


def _windows(edges: FloatArray, tents: FloatArray, n1: float, offset: float) -> Equations:
    """Return the equations from the mean of the last BLOCKS tents to the last of them."""
    if edges.size < BLOCKS:
        return Equations(np.zeros(0), np.zeros((0, 4)), np.zeros(0), np.zeros(0), np.zeros(0))
    together = sliding_window_view(tents, BLOCKS, axis=0)
    a, c, d, e, b = (tents[BLOCKS - 1 :, :5] - together[:, :5].mean(axis=2)).T
    step = edges[1] - edges[0]
    return Equations(
        edges[BLOCKS - 1 :] + step + offset,
        np.stack([d, -b, -c, -e], axis=1),
        n1 * a,
        np.ptp(together[:, 5], axis=1),
        np.mean(together[:, 4] ** 2, axis=1),
    )


def _integrals(time: FloatArray, values: FloatArray, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return at the edges the integral, and the integral of the integral, of what moves in straight lines."""
    grid = np.union1d(time, edges)
    f, dt = np.interp(grid, time, values), np.diff(grid)
    once = running(grid, f)
    twice = np.concatenate(([0.0], np.cumsum(once[:-1] * dt + dt * dt * (2.0 * f[:-1] + f[1:]) / 6.0)))
    at = np.searchsorted(grid, edges)
    return once[at], twice[at]


def _tents(time: FloatArray, values: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the means of what moves in straight lines, weighted like a tent over the two blocks about each inner
    edge: the second differences of its second integral."""
    step = edges[1] - edges[0]
    return np.asarray(np.diff(_integrals(time, values - values[0], edges)[1], 2) / step**2 + values[0])


def _cubes_of_headings(time: FloatArray, psi: FloatArray, noise: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Return times [s] and the cube of the rate there, between the mean headings of parts: without what noise adds to
    the mean of a cube, 3 r s^2 with s the rate's noise."""
    length = step / max(int(step / PART_S), 1)
    edges = np.arange(time[0], time[-1] + 1.0e-9, length)
    rate = np.diff(np.diff(_integrals(time, psi, edges)[0]) / length) / length
    samples = max(length / float(np.median(np.diff(time))), 1.0)
    square = 2.0 * (noise / length) ** 2 / samples
    return np.concatenate((time[:1], edges[1:-1], time[-1:])), np.pad(rate**3 - 3.0 * square * rate, 1, mode="edge")


def beside(segment: Segment, model: Norrbin, length: float) -> Motion:
    """Return the motion of a boat that knows the rudder and no noise. A course-unstable one left to itself would soon
    turn the other way than the real one, so it is led back to it over two windows."""
    rate, heading = initial_state(segment)
    rates, headings = np.full(segment.time.size, rate), np.full(segment.time.size, heading)
    ratio = np.maximum(np.abs(segment.speed) / model.reference_speed, RATIO_LEAST)
    seen = segment.rate if np.isfinite(segment.rate).any() else np.gradient(segment.heading, segment.time)
    rows = zip(*(each.tolist() for each in (np.diff(segment.time), segment.rudder, seen[1:], ratio[1:])), strict=False)
    rudders = segment.rudder.tolist()
    for k, (dt, before, real, share) in enumerate(rows, 1):
        rate, heading = moved_on(model, share, (rate, heading), dt, (before, rudders[k]))
        if model.n1 < 0.0 and real == real:
            rate += min(0.5 * dt / length, 1.0) * (real - rate)
        rates[k], headings[k] = rate, heading
    return Motion(headings, rates)


class Solution(NamedTuple):
    """The model after each window of the last pass, with the standard errors and how many windows telling something."""

    model: Norrbin
    errors: dict[str, float]
    time: FloatArray
    path: FloatArray
    length: float


def solve(runs: Sequence[Run], start: Norrbin, cubic: bool, question: Question) -> Solution:
    """Return what all windows together say; n3 is held at the start's where it is not `cubic`."""
    found = Solution(start, {}, np.zeros(0), np.zeros((0, len(NAMES))), 0.0)
    for done in range(PASSES):
        model = found.model
        length = window_length(model.time_constant / (1.0 if done else CAUTION))
        begun, tables = 0.0, list[tuple[Equations, FloatArray]]()
        for segment in (segment for run in runs for segment in run.segments):
            motion = Motion(segment.heading, segment.rate, instrument_noise(segment.heading))
            real = equations(segment, motion, model, length, begun)
            other = equations(segment, beside(segment, model, length), model, length, begun)
            telling = other.moves >= MOVES
            tables.append((Equations(*(column[telling] for column in real)), other.terms[telling]))
            begun += float(segment.time[-1] - segment.time[0])
        rows = Equations(*(np.concatenate(columns) for columns in zip(*(each for each, _ in tables), strict=True)))
        instruments = np.concatenate([each for _, each in tables])
        found = _solved(rows, instruments, start, cubic)._replace(length=length)
        question.progress(done + 1, PASSES)
    return found


def _solved(rows: Equations, instruments: FloatArray, start: Norrbin, cubic: bool) -> Solution:
    first = np.array([getattr(start, name) for name in NAMES])
    size = float(np.mean(rows.rate_square)) if rows.time.size else 1.0
    n3 = max(start.n3, CUBIC_SHARE / max(size, 1.0e-12)) if cubic else 0.0
    spread = np.array([start.gain, start.time_constant, n3, start.gain * TRIM_RAD])
    if rows.time.size <= len(NAMES):
        return Solution(start, {}, rows.time, np.tile(first, (rows.time.size, 1)), 0.0)
    missing = rows.left - rows.terms @ first
    least = np.linalg.lstsq(rows.terms * spread, missing, rcond=None)[0] * spread
    square = max(_error_square(rows, first + least), EXPECTED_ERROR_RAD**2)
    zeta, phi, one = instruments * spread, rows.terms * spread, np.eye(first.size)
    R = np.cumsum(np.einsum("ni,nj->nij", zeta, phi), axis=0)
    f = np.cumsum(zeta * missing[:, None], axis=0)
    path = first + spread * np.linalg.solve(R / square + one, f[:, :, None] / square)[:, :, 0]
    path[:, :2] = np.clip(path[:, :2], first[:2] / BOUND, first[:2] * BOUND)
    path[:, 2] = np.maximum(path[:, 2], 0.0) if cubic else start.n3
    square = _error_square(rows, path[-1])
    inverse = np.linalg.inv(R[-1] / square + one)
    scores = zeta.T @ zeta / square + one
    errors = spread * np.sqrt(np.maximum(np.diag(inverse @ scores @ inverse.T), 0.0))
    model = start._replace(**dict(zip(NAMES, path[-1].tolist(), strict=True)))
    named = {name: float(error) for name, error in zip(NAMES, errors, strict=True) if error > 0.0}
    return Solution(model, named, rows.time, path, 0.0)


def _error_square(rows: Equations, values: FloatArray) -> float:
    """Return the equations' mean square error [rad^2] with these parameters; where neighbours are alike it is raised,
    for they say the same."""
    error = rows.left - rows.terms @ values
    square = max(float(error @ error) / (error.size - len(NAMES)), LEAST_ERROR_RAD**2)
    alike = min(max(float(error[1:] @ error[:-1]) / (square * error.size), 0.0), 0.95)
    return square * (1.0 + alike) / (1.0 - alike)


def integral(runs: Sequence[Run], question: Question) -> Identified:
    """Return the solution of the integrated equation of all windows, with instruments from a simulated boat; see
    `Method`. n3 is held at 0, with the reason, where it cannot be determined."""
    start = question.start or begin(runs, question).model
    if start.n2:
        raise InputError(f"{sources_of(runs)}: the integral method knows no n2; use --method output-error.")
    cubic = question.kind == "norrbin"
    found = solve(runs, start, cubic, question)
    if found.time.size < 2 * BLOCKS:
        raise InputError(
            f"{sources_of(runs)}: the rudder moves in only {found.time.size} windows of {found.length:.3g} s, too few "
            "for the integral method; record a longer zigzag, or use --method output-error."
        )
    errors, reasons = dict(found.errors), {}
    if cubic and start.n1 > 0.0 and errors["n3"] > LARGEST_RELATIVE_ERROR * found.model.n3:
        reasons["n3"] = (
            f"n3: {found.model.n3:.3g} with a standard error of {errors['n3']:.2g} s^2/rad^2 cannot be distinguished "
            "from 0, so it is held at 0; steady turns at large rudder angles would tell it (--steady-turns)."
        )
        # what is not known of n3 is not known of K and T either: their errors are those of the fit with it
        found = solve(runs, start._replace(n3=0.0), False, question)
        del errors["n3"]
    convergence = Convergence(found.time, NAMES, found.path)
    return identified_as(found.model, runs, errors, unidentifiable=reasons, convergence=convergence)


METHODS = (
    Method(
        "integral",
        "the yaw equation integrated over windows, solved for all windows together with instruments",
        integral,
    ),
)
