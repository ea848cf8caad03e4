"""A ship's thrust and damping from trials under its thrusters: Zheng et al. 2019 as cases for `augmented_state`.

Trials of Zheng's dredger to try the identification on: the paper's 60 s, and the length that it takes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from zheng2019_ship import (
    DREDGER,
    REALISTIC,
    TABLE_1,
    TABLE_1_SURGE,
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

from autopilot.filters.kalman import FloatArray, Gaussian, midpoint_step
from autopilot.identification.augmented_state import Case, Steps

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


SAMPLES = 600
PRIOR_SHARE = 0.5
"""The prior's standard deviation, and how far at most its mean is drawn from the truth, as a share of the truth."""


class Scenario(NamedTuple):
    """A trial to simulate: the ship's parameters, sample spacing [s], thrust [N] of shape (600, 2) or (600, 1)."""

    name: str
    summary: str
    truth: SurgeParameters | SwayYawParameters
    dt: float
    thrust: FloatArray


def pseudo_random_binary(length: int, shift: int = 0) -> FloatArray:
    """Return `length` values of +1 and -1: the maximum-length sequence of x^4 + x^3 + 1, period 15, from `shift` on."""
    register, period = 1, []
    for _ in range(15):
        period.append(1.0 if register & 1 else -1.0)
        register = (register >> 1) | (((register ^ (register >> 1)) & 1) << 3)
    return np.array([period[(shift + k) % 15] for k in range(length)])


def _main_thrusters() -> FloatArray:
    """300 kN +- 200 kN, each on a sequence of its own, every value held over 50 samples."""
    levels = np.stack([pseudo_random_binary(12), pseudo_random_binary(12, shift=7)], axis=1)
    return np.asarray(300.0e3 + 200.0e3 * np.repeat(levels, 50, axis=0))


def _side_thruster() -> FloatArray:
    """+-150 kN in turn, each held over 100 samples."""
    return np.where(np.arange(SAMPLES) // 100 % 2 == 0, 150.0e3, -150.0e3)[:, None]


SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        Scenario("S1", "surge, table 1, 60 s as in the paper", TABLE_1_SURGE, 0.1, _main_thrusters()),
        Scenario("S2", "surge, table 1, 600 s", TABLE_1_SURGE, 1.0, _main_thrusters()),
        Scenario("S3", "sway and yaw, table 1, 60 s as in the paper", TABLE_1, 0.1, _side_thruster()),
        Scenario("S4", "sway and yaw, realistic damping, 600 s", REALISTIC, 1.0, _side_thruster()),
    )
}


class Simulated(NamedTuple):
    """A simulated trial: what is believed before, what was measured, where the ship was (bis), shape (n + 1, d)."""

    case: Case
    trial: Trial
    states: FloatArray


def simulate_scenario(scenario: Scenario, random: np.random.Generator) -> Simulated:
    """Return the scenario's trial; the prior's mean is theta (1 + 0.5 U(-1, 1)), its deviation 0.5 |theta|."""
    truth = np.array(scenario.truth)
    mean = truth * (1.0 + PRIOR_SHARE * random.uniform(-1.0, 1.0, truth.size))
    deviation = [float(value) for value in PRIOR_SHARE * np.abs(truth)]
    if isinstance(scenario.truth, SurgeParameters):
        case = surge_case(DREDGER, SurgeParameters(*mean), deviation)
    else:
        case = sway_yaw_case(DREDGER, SwayYawParameters(*mean), deviation)
    trial, states = simulated_trial(DREDGER, case, scenario.truth, scenario.dt, scenario.thrust, random)
    return Simulated(case, trial, states)
