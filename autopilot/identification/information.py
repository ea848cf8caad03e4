"""What a trial can tell at best: Fisher's information and the bound of Cramer and Rao, before it is sailed.

With white noise on heading and yaw rate the information on the parameters theta is

    I = sum over samples of (dr/dtheta)'(dr/dtheta)/s_r^2 + (dpsi/dtheta)'(dpsi/dtheta)/s_psi^2

with each segment's unknown initial rate and heading projected out; no unbiased estimate has a covariance below
its inverse. Rudder and speed are taken as known. Source: Ljung 1999, sections 7.4 and 9.4; Goodwin and Payne 1977.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.guidance.trials import zigzag_side
from autopilot.identification.output_error import fit_steps
from autopilot.identification.residuals import Problem, initial_state, typical_rate, units
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.models.norrbin import Norrbin, at_speed, rate_step
from autopilot.models.race_and_wind import RaceAndWind
from autopilot.models.steering_gear import SteeringGear, gear_step

Helm = Callable[[float, float], float]
"""Rudder order [rad] at a time [s] and heading [rad]."""

TOLD = 1.0e-12
"""Directions of the parameters with less than this share of the largest information are not told at all."""


class InstrumentNoise(NamedTuple):
    """Standard deviations of white noise on yaw rate [rad/s] and heading [rad]; inf where not measured."""

    rate: float
    heading: float


def cramer_rao(
    runs: Sequence[Run],
    model: Norrbin,
    free: tuple[str, ...],
    noise: InstrumentNoise,
    around: RaceAndWind | None = None,
    train: RudderTrain = DIRECT,
) -> dict[str, float]:
    """Return the least standard error that an unbiased estimate from `runs` can have, by parameter in `free`.

    free: of gain [1/s], time_constant [s], n3 [s^2/rad^2], n0 [rad/s] and those of propeller, wind and the rudder's
    train; all of them unknown together. inf where the runs do not tell a parameter. What was measured does not count,
    only what rudder, speed and times say.
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    scale = typical_rate(segments)
    around = around or RaceAndWind()
    steps = fit_steps(segments, model, scale)
    problem = Problem(segments, steps, model, around, free, scale, units(model, around, scale, segments), train)
    z = problem.vector([initial_state(segment) for segment in segments])
    weight = np.array([1.0 / noise.rate, 1.0 / noise.heading])
    total = np.zeros((len(free), len(free)))
    for _, slope in problem.response(z):
        weighted = (slope * weight[:, None]).reshape(-1, len(free) + 2)
        total += _without_initial_state(weighted, len(free))
    return dict(zip(free, _least_errors(total) * problem.parameter_scale(z), strict=True))


def _without_initial_state(slope: FloatArray, F: int) -> FloatArray:
    """Return the information on the first F parameters with the others unknown: the Schur complement."""
    own = slope[:, F:]
    rest = slope[:, :F] - own @ np.linalg.lstsq(own, slope[:, :F], rcond=None)[0]
    return np.asarray(rest.T @ rest)


def _least_errors(information: FloatArray) -> FloatArray:
    """Return the roots of the inverse's diagonal, inf where a direction that matters holds no information."""
    size = np.sqrt(np.maximum(np.diag(information), 0.0))
    told = size > 0.0
    result = np.full(size.size, np.inf)
    if not told.any():
        return result
    scaled = information[np.ix_(told, told)] / np.outer(size[told], size[told])
    values, vectors = np.linalg.eigh(scaled)
    inverse = np.where(values > TOLD * values[-1], 1.0 / np.maximum(values, TOLD * values[-1]), np.inf)
    # 0 times inf: a direction without information counts only for the parameters it moves
    share = np.where(vectors**2 > TOLD, vectors**2, 0.0)
    parts = np.multiply(share, inverse, out=np.zeros_like(share), where=share > 0.0)
    result[told] = np.sqrt(parts.sum(axis=1)) / size[told]
    return result


def planned(model: Norrbin, gear: SteeringGear, helm: Helm, duration: float, spacing: float, speed: float) -> Run:
    """Return the run that a trial would be: the boat from rest in yaw, sampled every `spacing` [s], at `speed` [m/s].

    helm: who orders the rudder. Heading and rate are without noise.
    """
    boat = at_speed(model, speed)
    table = np.empty((max(round(duration / spacing), 8) + 1, 4))
    heading = rate = rudder = 0.0
    for k in range(table.shape[0]):
        table[k] = k * spacing, heading, rate, rudder
        moved = gear_step(gear, rudder, helm(k * spacing, heading), spacing)
        following = rate_step(boat, rate, 0.5 * (rudder + moved), spacing)
        heading += 0.5 * spacing * (rate + following)
        rate, rudder = following, moved
    time, headings, rates, rudders = table.T.copy()
    return Run("planned", (Segment(time, headings, rates, rudders, np.full(time.size, speed)),))


def zigzag_helm(rudder: float, heading_change: float) -> Helm:
    """Return the helm of a zigzag: `rudder` [rad] to starboard, over each time the heading has changed that much."""
    side = 1

    def order(time: float, heading: float) -> float:
        nonlocal side
        side = zigzag_side(side, 0.0, heading, heading_change)
        return side * rudder

    return order
