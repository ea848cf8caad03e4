"""The margins of the loop that sails, and what its law does with errors that saturate the rudder.

The large-signal response is simulated, with the loop itself. A describing function predicts whether a saturated rate
leads to a limit cycle; with angle and rate both saturated, a lag and a dead time the simulation of the very functions
that steer says it more simply, and at which error it begins.

The loop is law and estimator together, cut at the rudder. `design.margins` takes heading and rate for known. Here they
come from the filter, which knows every order the rudder gets, so that cutting the loop at the boat's rudder leaves
a loop inside of the pilot closed. With the filter's transfers X_y from the measurements and X_d from the rudder that it
reckons with, the law's u = -F x with its smoothing, the gear g and the boat P

    D(jw) = 1 + F X_d g,   N(jw) = F X_y (1, jw) P g exp(-jw tau),   L = N/D,   stable: D + N has no unstable zeros.

tau is what the filter does not know of: the loop's delay. N times k is a boat whose K is k times the model's, and N
times exp(-jw t) one whose rudder answers t later; the margins are the ends of the ranges where the loop stays stable.
Source: Kalman filter and state feedback as one controller, Astrom and Murray 2021, sections 8.3 and 10.

The heading filter in it is as after a long while on a straight course: constant gains.

On a straight course the filter of `heading_ekf` without waves is linear, and its covariance settles:

    x- = A x + B delta,   x = x- + G (y - x-[0:2]),   x = (psi, r, b),  y = (heading, rate)

A, B and G come from the very functions that filter.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.control.design import ahead_gains
from autopilot.control.law import NO_ROLL, LawInForce, LawInput, LoopGains
from autopilot.control.limits import RudderLimits, limit
from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation.disturbance import FilterNoise
from autopilot.estimation.heading_ekf import FilterState, fuse_heading, fuse_rate
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step
from autopilot.signals import NavState, Reference

GRID = 160
LOWEST = 1.0e-3
GAIN_MOST = 20.0
GAIN_LEAST = 0.02
BISECTIONS = 24
RUDDER_LOSS = 0.7
"""A course-unstable boat must stay steerable with this share of the rudder's effect that its model has."""


class Delays(NamedTuple):
    """What passes [s] between measurement and order without the filter's knowledge, and the age of a heading, which it
    knows."""

    unknown: float
    latency: float = 0.0


class OutputFeedbackMargins(NamedTuple):
    """The loop with the estimator: stable or not; by which factor K may be smaller (0: by any) and larger (inf: by any)
    than the model's; delay margin [s]; worst sensitivity [-]."""

    stable: bool
    gain_down: float
    gain_up: float
    delay: float
    sensitivity: float


class OutputFeedbackLoop(NamedTuple):
    """The boat as the filter knows it, its gear, what passes unknown, the law's gains, whether it takes the filter's
    bias away, and the filter."""

    model: Norrbin
    gear: SteeringGear
    delays: Delays
    gains: LoopGains
    uses_bias: bool
    steady: SteadyFilter


class _Curve(NamedTuple):
    omegas: list[float]
    inner: list[complex]
    outer: list[complex]


def output_feedback_margins(loop: OutputFeedbackLoop) -> OutputFeedbackMargins:
    """Return the margins of law and filter together."""
    curve, wanted = _curve(loop), _wanted(loop)
    if not _holds(curve, wanted, 1.0):
        return OutputFeedbackMargins(False, 1.0, 1.0, 0.0, math.inf)

    def holds(factor: float) -> bool:
        return _holds(curve, wanted, factor)

    return OutputFeedbackMargins(
        True,
        0.0 if holds(GAIN_LEAST) else _end(holds, 1.0, GAIN_LEAST),
        math.inf if holds(GAIN_MOST) else _end(holds, 1.0, GAIN_MOST),
        _delay(lambda late: _holds(curve, wanted, 1.0, late), 1.0 / _crossover(curve)),
        max(abs(inner / (inner + outer)) for inner, outer in zip(curve.inner, curve.outer, strict=True)),
    )


def refusal_of(loop: OutputFeedbackLoop) -> str:
    """Return why this loop must not be engaged with the filter in it, or ""."""
    curve, wanted = _curve(loop), _wanted(loop)
    cure = "design them anew with `autopilot gains`, or a calmer --level"
    if not _holds(curve, wanted, 1.0):
        return f"refused to engage: these gains are unstable with the heading filter in the loop; {cure}"
    if loop.model.n1 < 0.0 and not _holds(curve, wanted, RUDDER_LOSS):
        less = round(100.0 * (1.0 - RUDDER_LOSS))
        return (
            f"refused to engage: with these gains this course-unstable boat is lost where its rudder is {less} % "
            f"weaker than the model's; {cure}"
        )
    return ""


def _wanted(loop: OutputFeedbackLoop) -> float:
    """Return how far [rad] D + N has to turn: for every integrator a quarter, for an unstable boat a half."""
    integrators = 1 + (1 if loop.gains.integral > 0.0 else 0)
    return math.pi * (0.5 * integrators + (1 if loop.model.n1 < 0.0 else 0))


def _holds(curve: _Curve, wanted: float, factor: float, late: float = 0.0) -> bool:
    """Return whether the loop is stable with N times `factor`, and `late` [s] more delay."""
    values = [
        inner + factor * outer * cmath.exp(-1j * omega * late) for omega, inner, outer in zip(*curve, strict=True)
    ]
    turned = sum(cmath.phase(after / before) for before, after in itertools.pairwise(values))
    return abs(turned - wanted) < 0.5 * math.pi


def _end(holds: Callable[[float], bool], good: float, bad: float) -> float:
    """Return where it ceases to hold between `good` and `bad`, both positive, by bisection of their ratio."""
    for _ in range(BISECTIONS):
        middle = math.sqrt(good * bad)
        if holds(middle):
            good = middle
        else:
            bad = middle
    return good


def _delay(holds: Callable[[float], bool], scale: float) -> float:
    """Return the least delay [s] that is too long, looked for from a hundredth of `scale` [s] on upwards."""
    late = 0.01 * scale
    while holds(late):
        late *= 1.3
        if late > 100.0 * scale:
            return math.inf
    return _end(holds, late / 1.3, late)


def _crossover(curve: _Curve) -> float:
    crossing = [w for w, d, n in zip(*curve, strict=True) if abs(n) >= abs(d)]
    return max(crossing, default=curve.omegas[0])


def _curve(loop: OutputFeedbackLoop) -> _Curve:
    """Return D and N from far below the loop's own frequencies to half of the sampling frequency."""
    model, gear, delays, gains, uses_bias, steady = loop
    curve, on = _Curve([], [], []), ahead_gains(model, gains)
    for omega, from_command, seen in _transfers(model.time_constant, steady, delays.latency):
        s = 1j * omega
        acts = cmath.exp(-s * gear.delay) / (gear.lag * s + 1.0)
        boat = model.gain / (s * (model.time_constant * s + model.n1))
        asked = (on.heading + gains.integral / s, complex(on.rate), (1.0 if uses_bias else 0.0) + on.bias)
        law = tuple(f / (1.0 + s * gains.smoothing) for f in asked)
        reckoned = (on.rudder * acts + on.order) / (1.0 + s * gains.smoothing)
        curve.omegas.append(omega)
        curve.inner.append(1.0 + sum(f * x for f, x in zip(law, from_command, strict=True)) * acts + reckoned)
        curve.outer.append(
            sum(f * x for f, x in zip(law, seen, strict=True)) * boat * acts * cmath.exp(-s * delays.unknown)
        )
    return curve


@lru_cache(maxsize=64)
def _transfers(
    time_constant: float, steady: SteadyFilter, latency: float
) -> tuple[tuple[float, tuple[complex, ...], tuple[complex, ...]], ...]:
    """Return frequencies [rad/s], each with the estimates of psi, r and b from the rudder that the filter reckons with
    and from a heading psi; they are the same whatever the gains."""
    highest = 0.98 * math.pi / steady.interval
    lowest = LOWEST * min(1.0 / time_constant, highest)
    found = []
    for index in range(GRID):
        omega = lowest * (highest / lowest) ** (index / (GRID - 1))
        s, late = 1j * omega, cmath.exp(-1j * omega * latency)
        from_rudder, from_boat = _estimates(steady, s)
        from_command = _carried(steady.ahead, [late * x for x in from_rudder], _mean(s, latency))
        seen = _carried(steady.ahead, [late * x for x in from_boat], 0.0)
        found.append((omega, tuple(from_command), tuple(seen)))
    return tuple(found)


def _mean(s: complex, seconds: float) -> complex:
    """Return the transfer of the mean over the past `seconds` [s]."""
    return (1.0 - cmath.exp(-s * seconds)) / (s * seconds) if seconds > 0.0 else 1.0


def _carried(ahead: Prediction, state: Sequence[complex], rudder: complex) -> list[complex]:
    """Return the state carried over the age of a heading with the rudder reckoned with."""
    return [
        sum((a * x for a, x in zip(row, state, strict=True)), 0j) + drive * rudder
        for row, drive in zip(ahead.transition, ahead.drive, strict=True)
    ]


def _estimates(steady: SteadyFilter, s: complex) -> tuple[list[complex], list[complex]]:
    """Return the filter's estimates of (psi, r, b) from the rudder that it reckons with, and from heading and rate.

    x = (1 - G H) (A x/z + B delta) + G y, the mean rudder of the past interval, and y = (1, s) psi.
    """
    (a, b), back = steady.prediction, cmath.exp(-s * steady.interval)
    mean = _mean(s, steady.interval)
    matrix, by_rudder, by_boat = [], [], []
    for i, (g, k) in enumerate(steady.gains):
        kept = [(1.0 if i == j else 0.0) - (g, k, 0.0)[j] for j in range(3)]
        moved = [sum(kept[j] * a[j][column] for j in range(3)) for column in range(3)]
        matrix.append([(1.0 if i == column else 0.0) - back * moved[column] for column in range(3)])
        by_rudder.append(sum(kept[j] * b[j] for j in range(3)) * mean)
        by_boat.append(g + k * s)
    return _solved(matrix, by_rudder), _solved(matrix, by_boat)


def _solved(matrix: list[list[complex]], right: list[complex]) -> list[complex]:
    """Return x of matrix x = right for three unknowns, by Cramer's rule: steering loads no array library."""
    whole = _determinant(matrix)
    return [
        _determinant([[right[i] if j == column else matrix[i][j] for j in range(3)] for i in range(3)]) / whole
        for column in range(3)
    ]


def _determinant(m: list[list[complex]]) -> complex:
    return (
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
        - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    )


STEPS_A_TICK = 4
SETTLED = 0.05
"""An error that has come down to this share of what it was, and stays, is corrected."""
LEAST_SETTLED = math.radians(0.5)
LONGEST_TIME_CONSTANTS = 40.0
FASTEST_LOOPS = 25.0
"""The simulation lasts this many of the loop's own times, and of the boat's time constants at most."""
MOST_TICKS = 100_000
"""What is not corrected by then is not called corrected."""


class Loop(NamedTuple):
    """The boat with its rudder: model, gear, limits of the command, dead time [s] on top of the gear's, and how often
    the law is asked [1/s]."""

    model: Norrbin
    gear: SteeringGear
    limits: RudderLimits
    delay: float
    rate_hz: float


class Recovery(NamedTuple):
    """An initial heading error [rad], whether the law corrects it, how far [rad] it goes past, how long [s] until it
    stays within a twentieth (inf: never), and how far [rad] it still swings at the end."""

    error: float
    corrected: bool
    overshoot: float
    settling: float
    swing: float


def recoveries(loop: Loop, law: LawInForce, bandwidth: float, errors: Sequence[float]) -> list[Recovery]:
    """Return what becomes of each initial heading error [rad], the boat at rest in yaw and the rudder amidships.

    bandwidth [rad/s]: the loop's own, which says how long to look.
    """
    return [_recovery(error, trace(loop, law, error, _duration(loop, bandwidth))) for error in errors]


def _duration(loop: Loop, bandwidth: float) -> float:
    own = FASTEST_LOOPS / max(bandwidth, 1.0e-6)
    # the rudder can take the boat round no faster than this
    turning = 2.0 * math.pi / max(loop.model.gain * loop.limits.angle_max, 1.0e-6)
    lasting = max(own, min(LONGEST_TIME_CONSTANTS * loop.model.time_constant, 4.0 * own)) + turning
    return min(lasting, MOST_TICKS / loop.rate_hz)


class Trace(NamedTuple):
    """Times [s], heading errors [rad] and rudder angles [rad] of one recovery."""

    time: list[float]
    error: list[float]
    rudder: list[float]


def trace(loop: Loop, law: LawInForce, error: float, duration: float) -> Trace:
    """Return the motion after an initial heading error [rad], towards the course 0, everything known exactly."""
    dt = 1.0 / loop.rate_hz
    h = dt / STEPS_A_TICK
    heading, rate, rudder, command = error, 0.0, 0.0, 0.0
    line = DelayLine(loop.delay + loop.gear.delay)
    memory = law.first(0.0)
    result = Trace([], [], [])
    for tick in range(round(duration / dt)):
        now = tick * dt
        state = NavState(now, wrap(heading), rate, loop.model.reference_speed, rudder, 0.0, 0.0, True)
        given = LawInput(loop.model, 1.0, Reference(0.0), state, NO_ROLL, command, loop.limits.angle_max, dt)
        demand, memory = law.step(memory, given)
        command = limit(loop.limits, command, demand, dt)
        line.give(now, command)
        result.time.append(now)
        result.error.append(wrap(heading))
        result.rudder.append(rudder)
        for step in range(STEPS_A_TICK):
            moved = gear_step(loop.gear, rudder, line.effective(now + step * h), h)
            rate_after = rate_step(loop.model, rate, 0.5 * (rudder + moved), h)
            heading += 0.5 * h * (rate + rate_after)
            rate, rudder = rate_after, moved
    return result


def _recovery(error: float, motion: Trace) -> Recovery:
    sign = 1.0 if error >= 0.0 else -1.0
    within = max(SETTLED * abs(error), LEAST_SETTLED)
    outside = [k for k, value in enumerate(motion.error) if abs(value) > within]
    last = outside[-1] if outside else -1
    tail = motion.error[-max(len(motion.error) // 5, 1) :]
    corrected = last < len(motion.error) - len(tail)
    settling = (motion.time[last + 1] if last >= 0 else 0.0) if corrected else math.inf
    return Recovery(
        error, corrected, max(0.0, max(-sign * value for value in motion.error)), settling, max(map(abs, tail))
    )


RUDDER_IN_USE = math.radians(1.0)
"""So far [rad] the rudder moves about straight running: the model is trusted the less the more it moves."""
STEPS_MOST = 4000
CONVERGED = 1.0e-7

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]
PROBE = 1.0e-3


class Prediction(NamedTuple):
    """x- = transition x + drive delta over some time."""

    transition: Matrix
    drive: Row


class SteadyFilter(NamedTuple):
    """The prediction over `interval` [s], the gains on the innovations of heading and rate, one pair a state, and the
    prediction over the age of a heading when it arrives."""

    interval: float
    prediction: Prediction
    gains: tuple[tuple[float, float], ...]
    ahead: Prediction


def linear_of(model: Norrbin) -> Norrbin:
    """Return the model about straight running."""
    return model._replace(n3=0.0, n2=0.0, n0=0.0)


def prediction(model: Norrbin, seconds: float) -> Prediction:
    """Return what `heading_ekf.predict_mean` does over so many `seconds` with the model about straight running."""
    straight, at_rest = linear_of(model), FilterState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    columns = []
    off = (at_rest._replace(psi=PROBE), at_rest._replace(rate=PROBE), at_rest._replace(bias=PROBE))
    for state in off:
        psi, rate, *_ = ekf.predict_mean(straight, state, 0.0, seconds)
        columns.append((psi / PROBE, rate / PROBE, state.bias / PROBE))
    psi, rate, *_ = ekf.predict_mean(straight, at_rest, PROBE, seconds)
    first, second, third = zip(*columns, strict=True)
    return Prediction((first, second, third), (psi / PROBE, rate / PROBE, 0.0))


@lru_cache(maxsize=64)
def steady_filter(model: Norrbin, noise: FilterNoise, interval: float, latency: float = 0.0) -> SteadyFilter:
    """Return the filter that measurements of heading and rate every `interval` [s] settle to, in calm water.

    latency: the age [s] of a heading when it arrives.
    """
    straight, calm = linear_of(model), noise._replace(waves=False)
    state, gains = ekf.initial(0.0, 0.0, 0.0, calm), [(0.0, 0.0)] * 3
    for _ in range(STEPS_MOST):
        # the mean stays at rest: only how well it is known matters
        predicted = ekf.predict(straight, calm, state._replace(time=0.0, psi=0.0, rate=0.0), RUDDER_IN_USE, interval)
        predicted = predicted._replace(psi=0.0, rate=0.0, bias=0.0)
        by_heading = fuse_heading(predicted, 1.0, calm.heading)
        by_rate = fuse_rate(by_heading._replace(psi=0.0, rate=0.0, bias=0.0), 1.0, calm.rate)
        # the rate is fused after the heading, whose part of it is known by then
        on_heading = (by_heading.psi, by_heading.rate, by_heading.bias)
        on_rate = (by_rate.psi, by_rate.rate, by_rate.bias)
        found = [(h - r * by_heading.rate, r) for h, r in zip(on_heading, on_rate, strict=True)]
        moved = max(map(math.dist, found, gains))
        state, gains = by_rate._replace(psi=0.0, rate=0.0, bias=0.0), found
        if moved < CONVERGED:
            break
    return SteadyFilter(interval, prediction(model, interval), tuple(gains), prediction(model, latency))
