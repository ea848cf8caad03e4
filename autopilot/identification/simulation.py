"""Many models driven by recorded rudder and speed at once: the open-loop simulation behind every fit.

The equation is `autopilot.models.norrbin`, evaluated elementwise. Segments of different length lie side by
side, padded with steps of no duration, so that one loop over time serves all segments and all models.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from autopilot.identification.runs import FloatArray, Segment
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, yaw_acceleration
from autopilot.models.race_and_wind import RaceAndWind, inflow_ratio, wind_acceleration

RATE_BOUND_RAD_S = 100.0
"""Simulated rates are held inside this, so that a model which runs away gives a large number, not inf or nan."""


DRIVING = ("rudder", "speed", "propeller", "beam_wind", "quarter_wind")


class Forcing(NamedTuple):
    """S segments on their integration steps, at most M of them.

    step [s], shape (M, S, 1), 0 where a segment has ended. rudder [rad] and speed [m/s], shape (2M+1, S, 1), at
    the beginning, middle and end of each step, as are propeller [1/s], beam_wind and quarter_wind [m^2/s^2], 0
    where the recording has none. knots: per segment the times [s] between its steps.
    """

    step: FloatArray
    rudder: FloatArray
    speed: FloatArray
    knots: tuple[FloatArray, ...]
    propeller: FloatArray
    beam_wind: FloatArray
    quarter_wind: FloatArray


class Trajectory(NamedTuple):
    """Yaw rate [rad/s] and angle turned through since the beginning [rad], both of shape (M+1, S, P)."""

    rate: FloatArray
    turned: FloatArray


def stack(models: Sequence[Norrbin]) -> Norrbin:
    """Return P models as one whose parameters are arrays of shape (P,), for elementwise evaluation."""
    return Norrbin(*_side_by_side(models))


def stack_around(around: Sequence[RaceAndWind]) -> RaceAndWind:
    """Return P of them as one whose parameters are arrays of shape (P,)."""
    return RaceAndWind(*_side_by_side(around))


def _side_by_side(rows: Sequence[tuple[float, ...]]) -> list[float]:
    return [cast(float, np.array(values, dtype=np.float64)) for values in zip(*rows, strict=True)]


def forcing(segments: Sequence[Segment], longest_step: float) -> Forcing:
    """Return the segments' rudder and speed on steps of at most about `longest_step` [s].

    Samples closer together than that are stepped over in groups, samples further apart are subdivided; between
    samples rudder and speed move linearly.
    """
    knots = tuple(_knots(segment.time, longest_step) for segment in segments)
    M = max(times.size for times in knots) - 1
    step = np.zeros((M, len(segments), 1))
    driven = {name: np.zeros((2 * M + 1, len(segments), 1)) for name in DRIVING}
    for s, (segment, times) in enumerate(zip(segments, knots, strict=True)):
        halves = np.interp(np.arange(2 * M + 1) / 2.0, np.arange(times.size), times)
        step[: times.size - 1, s, 0] = np.diff(times)
        for name, values in driven.items():
            recorded = getattr(segment, name)
            if recorded.size:
                values[:, s, 0] = np.interp(halves, segment.time, recorded)
    return Forcing(step=step, knots=knots, **driven)


def _knots(time: FloatArray, longest_step: float) -> FloatArray:
    """Return the ends of the integration steps [s]: every few samples, or several within a sample spacing."""
    chosen = [0]
    for index in range(1, time.size):
        if time[index] - time[chosen[-1]] > longest_step and index - 1 > chosen[-1]:
            chosen.append(index - 1)
    chosen.append(time.size - 1)
    coarse = time[np.unique(chosen)]
    pieces = np.maximum(np.ceil(np.diff(coarse) / longest_step - 1e-9), 1.0).astype(int)
    return np.interp(np.arange(pieces.sum() + 1), np.concatenate([[0], np.cumsum(pieces)]), coarse)


@np.errstate(over="ignore", invalid="ignore")  # a model that runs away is bounded, not an accident
def simulate(
    models: Norrbin, forcing: Forcing, initial_rate: FloatArray, around: RaceAndWind | None = None
) -> Trajectory:
    """Return the open-loop motion of P models (parameters of shape (P,)) in S segments.

    initial_rate [rad/s] has shape (S, P) or (S, 1). Classical Runge-Kutta steps of r' = yaw_acceleration(r, delta)
    with the parameters scaled to the speed of the moment, and of psi' = r. `around`, parameters of shape (P,) too,
    is what propeller and wind add; without it they do not count.
    """
    M, S, _ = forcing.step.shape
    P = np.size(models.gain)
    ratio = np.maximum(np.abs(forcing.speed) / models.reference_speed, SPEED_FLOOR_RATIO)
    # every parameter at every moment at once: the loop below is too hot to scale them step by step
    everywhere = _everywhere(models, ratio)
    rudder = forcing.rudder if around is None else _effective_rudder(models, around, forcing, ratio, everywhere)
    scaled = [Norrbin(*moment) for moment in zip(*everywhere, strict=True)]
    rate = np.empty((M + 1, S, P))
    turned = np.zeros((M + 1, S, P))
    rate[0] = initial_rate
    for k in range(M):
        h = forcing.step[k]
        begin, middle, end = scaled[2 * k : 2 * k + 3]
        d0, d1, d2 = rudder[2 * k : 2 * k + 3]
        r = rate[k]
        k1 = yaw_acceleration(begin, r, d0)
        k2 = yaw_acceleration(middle, r + 0.5 * h * k1, d1)
        k3 = yaw_acceleration(middle, r + 0.5 * h * k2, d1)
        k4 = yaw_acceleration(end, r + h * k3, d2)
        _bounded(r + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4), rate[k + 1])
        _bounded(r + h / 6.0 * (k1 + k2 + k3), turned[k + 1])
    turned[1:] = np.cumsum(turned[1:] * forcing.step, axis=0)
    return Trajectory(rate, turned)


def _effective_rudder(
    models: Norrbin, around: RaceAndWind, forcing: Forcing, ratio: FloatArray, scaled: Sequence[FloatArray]
) -> FloatArray:
    """Return the rudder angle [rad] that would do without race and wind what the rudder does with them."""
    gain, time_constant = scaled[0], scaled[1]
    inflow = inflow_ratio(around, models.reference_speed, ratio, forcing.propeller)
    wind = wind_acceleration(around, forcing.beam_wind, forcing.quarter_wind)
    return forcing.rudder * inflow + wind * time_constant / gain


def _everywhere(models: Norrbin, ratio: FloatArray) -> list[FloatArray]:
    """Return the parameters of P models at each speed `ratio`, shape (..., P), as arrays of that shape."""
    scaled = at_speed_ratio(models, cast(float, ratio))
    return [np.broadcast_to(np.asarray(values), ratio.shape) for values in scaled]


def _bounded(rate: FloatArray, out: FloatArray) -> None:
    """Write `rate` into `out`, held inside the bound; nan (overflow on overflow) becomes the bound."""
    np.fmax(rate, -RATE_BOUND_RAD_S, out=out)
    np.fmin(out, RATE_BOUND_RAD_S, out=out)


def at_samples(trajectory: FloatArray, forcing: Forcing, segments: Sequence[Segment], s: int) -> FloatArray:
    """Return segment `s` of a (M+1, S, P) trajectory at its N sample times, linear between steps: shape (N, P)."""
    knots, time = forcing.knots[s], segments[s].time
    right = np.clip(np.searchsorted(knots, time), 1, knots.size - 1)
    share = ((time - knots[right - 1]) / (knots[right] - knots[right - 1]))[:, None]
    column = trajectory[:, s]
    return np.asarray(column[right - 1] * (1.0 - share) + column[right] * share)
