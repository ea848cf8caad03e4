"""Trials of Zheng's dredger to try the identification on: the paper's 60 s, and the length that it takes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from autopilot.filters.midpoint import FloatArray
from autopilot.identification.dynamic_positioning import Noise, Trial, simulated_trial, surge_case, sway_yaw_case
from autopilot.identification.recursive import Case
from autopilot.models.dynamic_positioning import (
    DREDGER,
    REALISTIC,
    TABLE_1,
    TABLE_1_SURGE,
    SurgeParameters,
    SwayYawParameters,
)

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


def simulate_scenario(scenario: Scenario, random: np.random.Generator, noise: Noise | None = None) -> Simulated:
    """Return the scenario's trial; the prior's mean is theta (1 + 0.5 U(-1, 1)), its deviation 0.5 |theta|."""
    truth = np.array(scenario.truth)
    mean = truth * (1.0 + PRIOR_SHARE * random.uniform(-1.0, 1.0, truth.size))
    deviation = [float(value) for value in PRIOR_SHARE * np.abs(truth)]
    if isinstance(scenario.truth, SurgeParameters):
        case = surge_case(DREDGER, SurgeParameters(*mean), deviation, noise)
    else:
        case = sway_yaw_case(DREDGER, SwayYawParameters(*mean), deviation, noise)
    trial, states = simulated_trial(DREDGER, case, scenario.truth, scenario.dt, scenario.thrust, random)
    return Simulated(case, trial, states)
