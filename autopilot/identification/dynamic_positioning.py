"""A ship's thrust and damping from trials under its thrusters: Zheng et al. 2019 as cases for `recursive`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.filters.kalman import Gaussian
from autopilot.filters.midpoint import FloatArray, midpoint_step
from autopilot.identification.recursive import Case, Steps
from autopilot.models.dynamic_positioning import (
    Hull,
    SurgeDrive,
    SurgeParameters,
    SwayYawDrive,
    SwayYawParameters,
    surge_drive,
    surge_rates,
    surge_shown,
    sway_yaw_drive,
    sway_yaw_rates,
    sway_yaw_shown,
)

START_SPEED_M_S = 0.01
"""A trial begins at rest, to within this standard deviation, and where the first position was measured."""

TRUTH_SUBSTEPS = 10
"""The simulated ship is integrated with steps this much shorter than the samples, noise in each."""


class Noise(NamedTuple):
    """Measurement noise: position [m], heading [rad]. Process noise on the momenta over mass: surge, sway, yaw, all
    [m/s/sqrt(s)], yaw's as a momentum over mass and length."""

    position: float = 0.1
    heading: float = math.radians(0.1)
    surge: float = 5.0e-4
    sway: float = 3.3e-4
    yaw: float = 2.5e-5


class Trial(NamedTuple):
    """A recorded trial, n samples: dt [s] to the sample before, shape (n,); thrust [N] since then, shape (n, 2) for the
    main thrusters, (n, 1) for the side thruster; measured X [m], shape (n, 1), or y [m] and heading [rad], (n, 2)."""

    dt: FloatArray
    thrust: FloatArray
    measured: FloatArray


def surge_case(hull: Hull, prior: SurgeParameters, deviation: Sequence[float], noise: Noise | None = None) -> Case:
    """Return the case of surge: Xu, k1, k2 believed to be `prior` with standard deviations `deviation`."""
    noise = noise or Noise()
    spread = (noise.position / hull.length, _rest(hull), *deviation)
    root = np.zeros((5, 1))
    root[1, 0] = _kick(hull, noise.surge) / hull.surge_mass
    R = np.array([[(noise.position / hull.length) ** 2]])
    return Case(SurgeParameters._fields, surge_rates, surge_shown, root, R, _belief(2, prior, spread))


def sway_yaw_case(hull: Hull, prior: SwayYawParameters, deviation: Sequence[float], noise: Noise | None = None) -> Case:
    """Return the case of sway and yaw: k3 and D believed to be `prior` with standard deviations `deviation`."""
    noise = noise or Noise()
    rest = (hull.sway_mass * _rest(hull), hull.yaw_mass * _rest(hull))
    spread = (noise.position / hull.length, noise.heading, *rest, *deviation)
    root = np.zeros((9, 2))
    root[2, 0], root[3, 1] = _kick(hull, noise.sway), _kick(hull, noise.yaw)
    R = np.diag([(noise.position / hull.length) ** 2, noise.heading**2])
    return Case(SwayYawParameters._fields, sway_yaw_rates, sway_yaw_shown, root, R, _belief(4, prior, spread))


def trial_steps(hull: Hull, trial: Trial) -> Steps:
    """Return the trial in bis units as the steps of a filter."""
    measured = trial.measured.copy()
    measured[:, 0] /= hull.length
    return Steps(trial.dt / hull.time_unit, _drives(hull, trial.thrust), measured)


def simulated_trial(
    hull: Hull, case: Case, truth: Sequence[float], dt: float, thrust: FloatArray, random: np.random.Generator
) -> tuple[Trial, FloatArray]:
    """Return a trial of the ship whose parameters are `truth`, begun at rest, and its states, bis, shape (n + 1, d).

    thrust [N], shape (n, 2) or (n, 1), held over dt [s]; integrated at dt/10 with the case's process noise in every
    step, measured with its measurement noise.
    """
    step = dt / hull.time_unit / TRUTH_SUBSTEPS
    state = np.concatenate([np.zeros(case.states), truth])[None]
    states = [state[0]]
    kick = case.noise * np.sqrt(step)
    for drive in _drives(hull, thrust):
        for _ in range(TRUTH_SUBSTEPS):
            noise = kick @ random.standard_normal(kick.shape[1])
            state = midpoint_step(case.drift, drive, state, step, noise[None])
        states.append(state[0])
    shown = np.array([case.observe(x) for x in states[1:]])
    shown = shown + random.standard_normal(shown.shape) @ np.linalg.cholesky(case.R).T
    shown[:, 0] *= hull.length
    return Trial(np.full(len(thrust), dt), thrust, shown), np.array(states)


def _drives(hull: Hull, thrust: FloatArray) -> list[SurgeDrive] | list[SwayYawDrive]:
    if thrust.shape[1] == 2:
        return [surge_drive(hull, float(F1), float(F2)) for F1, F2 in thrust]
    return [sway_yaw_drive(hull, float(F3)) for (F3,) in thrust]


def _belief(states: int, prior: Sequence[float], spread: Sequence[float]) -> Gaussian:
    return Gaussian(np.concatenate([np.zeros(states), prior]), np.diag(np.square(spread)))


def _rest(hull: Hull) -> float:
    return START_SPEED_M_S / hull.speed_unit


def _kick(hull: Hull, noise: float) -> float:
    """Return process noise [m/s/sqrt(s)] in bis units."""
    return noise / hull.speed_unit * math.sqrt(hull.time_unit)
