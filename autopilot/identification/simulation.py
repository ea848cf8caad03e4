"""Models driven by recorded rudder and speed: the open-loop simulation behind every fit.

The equation is `autopilot.models.norrbin`, evaluated elementwise over all steps of all segments at once. What is
left is a recurrence, r_k+1 = F_k(r_k) with F_k a Runge-Kutta step; Newton's method on all of it together needs
three or four rounds, each one evaluation of every step and one bidiagonal system, where a loop over time would need
as many calls as there are steps. The same system gives the derivatives by the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtbsv

from autopilot.identification.rudder_path import DIRECT, RudderTrain, behind_train, corners
from autopilot.identification.runs import FloatArray, Segment
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, yaw_acceleration
from autopilot.models.race_and_wind import RaceAndWind, inflow_ratio, wind_acceleration

RATE_BOUND_RAD_S = 100.0
"""Simulated rates are held inside this, so that a model which runs away gives a large number, not inf or nan."""

SLOPE_BOUND = 1.0e8
"""Derivatives of a model that runs away are held inside this, in units of rad/s and rad by the parameter's."""

NEWTON_ROUNDS = 20
"""Rounds after which the recurrence is stepped through one by one: a model that runs away does not settle."""
SETTLED = 1.0e-12
"""Change of the rates, as a share of the largest, below which Newton's method has arrived."""
NEARLY = 1.0e-6
"""A defect, as a share of the largest rate, from which one round more leads to rounding errors: they square."""
PROBE = 1.0e-6
"""Step of the finite differences inside one integration step, as a share of the largest rate."""

BESIDE_RUDDER = ("speed", "propeller", "beam_wind", "quarter_wind")


IntArray = NDArray[np.intp]


class SamplePlaces(NamedTuple):
    """Where the N samples of a segment lie: after node `left` by `share` of the way to the next, shapes (N,)."""

    left: IntArray
    share: FloatArray


class Forcing(NamedTuple):
    """The integration steps of S segments, one segment after the other: M steps between M + S nodes in all.

    step [s], shape (M,); begin: the node at which each step begins, shape (M,), its end is the next node; first:
    the node at which each segment begins, shape (S,). rudder [rad] and speed [m/s], shape (3, M), at the beginning,
    middle and end of each step, as are propeller [1/s], beam_wind and quarter_wind [m^2/s^2], 0 where the recording
    has none. samples: per segment, at which nodes its samples lie. moments [s]: per segment its steps' beginnings,
    middles and ends, shape (3, its steps); paths: per segment time [s] and angle [rad] of the recorded rudder.
    """

    step: FloatArray
    begin: IntArray
    first: IntArray
    rudder: FloatArray
    speed: FloatArray
    propeller: FloatArray
    beam_wind: FloatArray
    quarter_wind: FloatArray
    samples: tuple[SamplePlaces, ...]
    moments: tuple[FloatArray, ...]
    paths: tuple[tuple[FloatArray, FloatArray], ...]


class Trajectory(NamedTuple):
    """Yaw rate [rad/s] and angle turned through since the segment's beginning [rad] at the nodes, shape (M+S,)."""

    rate: FloatArray
    turned: FloatArray


def forcing(segments: Sequence[Segment], longest_step: float, together: float | None = None) -> Forcing:
    """Return the segments' rudder and speed on steps of at most about `longest_step` [s].

    Samples further apart than that are subdivided; those that lie within `together` [s], by default the same, are
    stepped over in one. Between samples rudder and speed move linearly.
    """
    reach = longest_step if together is None else together
    turns = [corners(segment.time, segment.rudder) for segment in segments]
    knots = [
        _knots(np.union1d(segment.time, times), longest_step, reach)
        for segment, (times, _) in zip(segments, turns, strict=True)
    ]
    first = np.cumsum([0, *(times.size for times in knots[:-1])])
    begin = np.concatenate([start + np.arange(times.size - 1) for start, times in zip(first, knots, strict=True)])
    moments = tuple(np.stack([t[:-1], 0.5 * (t[:-1] + t[1:]), t[1:]]) for t in knots)
    paths = tuple(_with_corners(segment, turn) for segment, turn in zip(segments, turns, strict=True))
    driven = {
        "rudder": np.concatenate([np.interp(m, *path) for m, path in zip(moments, paths, strict=True)], axis=1)
    } | {
        name: np.concatenate(
            [_recorded(segment, name, times) for segment, times in zip(segments, moments, strict=True)], axis=1
        )
        for name in BESIDE_RUDDER
    }
    samples = tuple(
        _places(segment.time, times, int(start)) for segment, times, start in zip(segments, knots, first, strict=True)
    )
    step = np.concatenate([np.diff(times) for times in knots])
    return Forcing(step, begin, first, **driven, samples=samples, moments=moments, paths=paths)


def rudder_behind(train: RudderTrain, forcing: Forcing) -> FloatArray:
    """Return what the recorded rudder [rad] has become behind `train`, shape (3, M) as in Forcing."""
    if train == DIRECT:
        return forcing.rudder
    parts = []
    for moments, (time, angle) in zip(forcing.moments, forcing.paths, strict=True):
        in_order = np.append(moments[:2].T.ravel(), moments[2, -1])
        there = behind_train(train, time, angle, in_order)
        parts.append(np.stack([there[:-1:2], there[1::2], there[2::2]]))
    return np.concatenate(parts, axis=1)


def _with_corners(segment: Segment, turns: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the rudder's path: the samples and the corners between them, in order of time."""
    time = np.concatenate([segment.time, turns[0]])
    order = np.argsort(time)
    return time[order], np.concatenate([segment.rudder, turns[1]])[order]


def _recorded(segment: Segment, name: str, moments: FloatArray) -> FloatArray:
    values = getattr(segment, name)
    return np.interp(moments, segment.time, values) if values.size else np.zeros_like(moments)


def _places(time: FloatArray, knots: FloatArray, start: int) -> SamplePlaces:
    right = np.clip(np.searchsorted(knots, time), 1, knots.size - 1)
    return SamplePlaces(start + right - 1, (time - knots[right - 1]) / (knots[right] - knots[right - 1]))


def _knots(time: FloatArray, longest_step: float, together: float) -> FloatArray:
    """Return the ends of the integration steps [s]: every few samples, or several within a sample spacing."""
    within = np.searchsorted(time, time + together * (1.0 + 1.0e-9), side="right") - 1
    # the last sample within reach, and the next one where none is
    following = np.maximum(within, np.arange(1, time.size + 1)).tolist()
    chosen = [0]
    while chosen[-1] < time.size - 1:
        chosen.append(following[chosen[-1]])
    coarse = time[chosen]
    pieces = np.maximum(np.ceil(np.diff(coarse) / longest_step - 1e-9), 1.0).astype(int)
    return np.interp(np.arange(pieces.sum() + 1), np.concatenate([[0], np.cumsum(pieces)]), coarse)


@np.errstate(over="ignore", invalid="ignore")  # a model that runs away is bounded, not an accident
def simulate(
    model: Norrbin,
    forcing: Forcing,
    initial_rate: FloatArray,
    around: RaceAndWind | None = None,
    guess: FloatArray | None = None,
) -> Trajectory:
    """Return the open-loop motion in S segments that begin with `initial_rate` [rad/s], shape (S,).

    Classical Runge-Kutta steps of r' = yaw_acceleration(r, delta) with the parameters scaled to the speed of the
    moment, and of psi' = r. `around` is what propeller and wind add; without it they do not count. guess: rates at
    the nodes to begin the search with, those of a similar model for instance; it does not change the result.
    """
    drive = _drive(model, forcing, around)
    rate = _by_newton(drive, forcing, initial_rate, guess)
    if rate is None:
        rate = _one_by_one(drive, forcing, initial_rate)
    return Trajectory(rate, _turned(_runge_kutta(drive, rate[forcing.begin])[1], forcing))


@np.errstate(over="ignore", invalid="ignore")
def slopes(
    model: Norrbin,
    forcing: Forcing,
    motion: Trajectory,
    shifted: Sequence[tuple[Norrbin, RaceAndWind | None, FloatArray]],
    by: float,
    around: RaceAndWind | None = None,
) -> list[Trajectory]:
    """Return the derivatives of `motion` by each parameter that was shifted, and last by the initial rates.

    shifted: model, surroundings and rudder with one parameter moved, `by` that much in the derivative's unit.
    Differences are taken within each step and carried on by the linearised recurrence: exact but for rounding, however
    long the record is.
    """
    start = motion.rate[forcing.begin]
    drive = _drive(model, forcing, around)
    ahead, advance = _runge_kutta(drive, start)
    probe = PROBE * max(float(np.max(np.abs(start))), PROBE)
    beside, advance_beside = _runge_kutta(drive, start + probe)
    memory, turning = (beside - ahead) / probe, (advance_beside - advance) / probe
    result = []
    for other, beside_it, rudder in shifted:
        moved, moved_advance = _runge_kutta(_drive(other, forcing._replace(rudder=rudder), beside_it), start)
        rate = _finite(_recurrence(memory, (moved - ahead) / by, np.zeros(forcing.first.size), forcing))
        result.append(_derivative(rate, (moved_advance - advance) / by + turning * rate[forcing.begin], forcing))
    rate = _finite(_recurrence(memory, np.zeros(start.size), np.ones(forcing.first.size), forcing))
    return [*result, _derivative(rate, turning * rate[forcing.begin], forcing)]


def _derivative(rate: FloatArray, advance: FloatArray, forcing: Forcing) -> Trajectory:
    return Trajectory(rate, _finite(_turned(_finite(advance), forcing)))


def _finite(slope: FloatArray) -> FloatArray:
    """Return derivatives held inside the bound: one that overflowed says as much as a large one."""
    return np.fmax(np.fmin(slope, SLOPE_BOUND), -SLOPE_BOUND)


class _Drive(NamedTuple):
    """Parameters at the speed of the beginning, middle and end of each step, the rudder there, and the steps."""

    begin: Norrbin
    middle: Norrbin
    end: Norrbin
    rudder: FloatArray
    step: FloatArray


def _drive(model: Norrbin, forcing: Forcing, around: RaceAndWind | None) -> _Drive:
    ratio = np.maximum(np.abs(forcing.speed) / model.reference_speed, SPEED_FLOOR_RATIO)
    begin, middle, end = (at_speed_ratio(model, cast(float, moment)) for moment in ratio)
    rudder = forcing.rudder
    if around is not None:
        inflow = inflow_ratio(around, model.reference_speed, ratio, forcing.propeller)
        wind = wind_acceleration(around, forcing.beam_wind, forcing.quarter_wind)
        # the rudder angle that would do without race and wind what the rudder does with them
        rudder = rudder * inflow + wind * model.time_constant / (ratio * ratio * model.gain)
    return _Drive(begin, middle, end, rudder, forcing.step)


def _runge_kutta(drive: _Drive, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rates [rad/s] one step after `rate`, and the angles [rad] turned meanwhile."""
    h, (d0, d1, d2) = drive.step, drive.rudder
    k1 = _acceleration(drive.begin, rate, d0)
    k2 = _acceleration(drive.middle, rate + 0.5 * h * k1, d1)
    k3 = _acceleration(drive.middle, rate + 0.5 * h * k2, d1)
    k4 = _acceleration(drive.end, rate + h * k3, d2)
    between = k1 + k2 + k3
    return rate + h / 6.0 * (between + k2 + k3 + k4), h * (rate + h / 6.0 * between)


def _acceleration(model: Norrbin, rate: FloatArray, rudder: FloatArray) -> FloatArray:
    """The scalar equation of `models.norrbin`, elementwise."""
    return cast(FloatArray, yaw_acceleration(model, cast(float, rate), cast(float, rudder)))


def _by_newton(
    drive: _Drive, forcing: Forcing, initial_rate: FloatArray, guess: FloatArray | None
) -> FloatArray | None:
    """Return the rates at the nodes that follow from one another, None where Newton's method does not arrive."""
    rate = np.zeros(forcing.step.size + forcing.first.size) if guess is None else guess.copy()
    rate[forcing.first] = initial_rate
    for _ in range(NEWTON_ROUNDS):
        start = rate[forcing.begin]
        largest = float(np.max(np.abs(rate)))
        if not largest < RATE_BOUND_RAD_S:
            return None
        ahead = _runge_kutta(drive, start)[0]
        defect = ahead - rate[forcing.begin + 1]
        error = float(np.max(np.abs(defect))) / max(largest, SETTLED)
        if error <= SETTLED:
            return rate
        probe = PROBE * max(largest, PROBE)
        memory = (_runge_kutta(drive, start + probe)[0] - ahead) / probe
        rate = rate + _recurrence(memory, defect, np.zeros(forcing.first.size), forcing)
        if error <= NEARLY:
            return rate
    return None


def _recurrence(memory: FloatArray, source: FloatArray, initial: FloatArray, forcing: Forcing) -> FloatArray:
    """Return x at the nodes with x = `initial` at each segment's first and x_k+1 = memory_k x_k + source_k."""
    nodes = forcing.step.size + forcing.first.size
    band = np.zeros((2, nodes), order="F")
    band[1, forcing.begin] = -memory
    x = np.empty(nodes)
    x[forcing.first] = initial
    x[forcing.begin + 1] = source
    return np.asarray(dtbsv(1, band, x, lower=1, diag=1, overwrite_x=1))


def _one_by_one(drive: _Drive, forcing: Forcing, initial_rate: FloatArray) -> FloatArray:
    """Return the rates at the nodes, step after step in plain numbers, held inside the bound."""
    rate = np.empty(forcing.step.size + forcing.first.size)
    rate[forcing.first] = initial_rate
    models = [[np.broadcast_to(values, drive.step.shape).tolist() for values in model] for model in drive[:3]]
    begin, middle, end = ([Norrbin(*row) for row in zip(*model, strict=True)] for model in models)
    rows = zip(begin, middle, end, drive.rudder.T.tolist(), drive.step.tolist(), forcing.begin.tolist(), strict=True)
    for first, second, third, rudder, step, node in rows:
        following = float(_runge_kutta(_Drive(first, second, third, rudder, step), rate[node])[0])
        # overflow on overflow is not a number: the bound is as good
        rate[node + 1] = max(-RATE_BOUND_RAD_S, min(RATE_BOUND_RAD_S, following))
    return rate


def _turned(advance: FloatArray, forcing: Forcing) -> FloatArray:
    """Return the angle turned since each segment's beginning at the nodes, from what each step adds."""
    turned = np.zeros(forcing.step.size + forcing.first.size)
    turned[forcing.begin + 1] = advance
    turned = np.cumsum(turned)
    lengths = np.diff(np.append(forcing.first, turned.size))
    return np.asarray(turned - np.repeat(turned[forcing.first], lengths))


def at_samples(values: FloatArray, forcing: Forcing, s: int) -> FloatArray:
    """Return `values` at the nodes, shape (M+S,), at the N samples of segment `s`, linear between nodes."""
    left, share = forcing.samples[s]
    return np.asarray(values[left] * (1.0 - share) + values[left + 1] * share)
