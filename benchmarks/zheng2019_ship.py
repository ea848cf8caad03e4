"""A ship under its thrusters at low speed: surge alone, and sway with yaw, in the bis system.

Surge, from two main thrusters:      X' = u,   M11 u' = k1 F1 + k2 F2 - Xu u
Sway and yaw, from a side thruster:  y' = v cos psi,   psi' = r,   (v, r) = M^-1 h,   h' = t k3 F3 - D M^-1 h,
    M = [[M22, M26], [M26, M66]],   D = [[Yv, Yr], [Nv, Nr]],   t = (1, lever)

Everything is made dimensionless in the bis system (Norrbin 1970): lengths by L, times by sqrt(L/g), masses by the
ship's own m, and so forces by m g. k is 1 where a thruster gives what it is commanded.

Source: Zheng et al. 2019, eqs (1)-(5), (12), (13), with X_u u where (12) prints X_u mu. Table 1 lists entries of D,
positive; it has no units, and in no standard scaling do all five numbers of D belong to one ship: in this one Nr
would make the yaw time constant 18 900 s. `TABLE_1` is as published; `REALISTIC` beside it steadies within a minute.

Trials of Zheng's dredger stand below, the paper's 60 s and the length that it takes, as cases for `feedback_particle`;
and their batch fit: for fixed parameters a Kalman filter follows the state alone, and its innovations e_k with
covariances S_k are white where the parameters are right. Minimised is

    sum e_k' S_k^-1 e_k + (theta - theta_0)' P_0^-1 (theta - theta_0)

by Gauss and Newton with the damping of Levenberg and Marquardt. Where there is no process noise this is the
output-error fit. Source: Ljung 1999, chapter 7. The logarithm of det S_k, which hardly moves with the parameters, is
left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from extended_kalman import prior_deviation
from scipy.optimize import least_squares

from autopilot.identification.feedback_particle import Case, FloatArray, Gaussian, Steps, midpoint_step, observed

GRAVITY_M_S2 = 9.81


class Hull(NamedTuple):
    """A ship: length [m], mass [kg], bis masses with what they carry of the water, side thruster's lever [m]."""

    length: float
    mass: float
    surge_mass: float
    sway_mass: float
    coupling_mass: float
    yaw_mass: float
    lever: float

    @property
    def time_unit(self) -> float:
        """sqrt(L/g) [s]."""
        return math.sqrt(self.length / GRAVITY_M_S2)

    @property
    def speed_unit(self) -> float:
        """sqrt(L g) [m/s]."""
        return math.sqrt(self.length * GRAVITY_M_S2)

    @property
    def force_unit(self) -> float:
        """m g [N]."""
        return self.mass * GRAVITY_M_S2


DREDGER = Hull(128.0, 1.9413e7, 1.05, 1.642, 0.0375, 0.0977, 50.0)
"""Zheng's dredger: 128 m by 25.6 m by 6.8 m as printed; mass for a block coefficient of 0.85, added masses and the
lever are assumed, for the paper gives none."""


class SurgeParameters(NamedTuple):
    """Xu and the two thrust coefficients, bis."""

    Xu: float
    k1: float
    k2: float


class SwayYawParameters(NamedTuple):
    """The thrust coefficient and the entries of D, bis."""

    k3: float
    Yv: float
    Yr: float
    Nv: float
    Nr: float


TABLE_1_SURGE = SurgeParameters(0.0112, 1.0011, 1.0031)
TABLE_1 = SwayYawParameters(1.0152, 2.764e-2, 1.6249e-4, 6.9226e-4, 1.8692e-5)
"""Zheng et al. 2019, table 1, as published."""

REALISTIC = SwayYawParameters(1.0152, 2.764e-2, -2.9e-3, -9.6e-4, 7.2e-3)
"""Table 1 with a yaw damping, and couplings of the sign and size, that a ship of this kind has."""


class SurgeDrive(NamedTuple):
    """What drives the surge: two thrusts and the mass M11, bis."""

    F1: float
    F2: float
    mass: float


class SwayYawDrive(NamedTuple):
    """What drives sway and yaw, bis: the thrust, its lever, and the inverse of M: v = a h2 + b h6, r = b h2 + c h6."""

    F3: float
    lever: float
    a: float
    b: float
    c: float


def surge_drive(hull: Hull, F1: float, F2: float) -> SurgeDrive:
    """Return the drive from thrusts in newton."""
    return SurgeDrive(F1 / hull.force_unit, F2 / hull.force_unit, hull.surge_mass)


def sway_yaw_drive(hull: Hull, F3: float) -> SwayYawDrive:
    """Return the drive from a thrust in newton."""
    determinant = hull.sway_mass * hull.yaw_mass - hull.coupling_mass**2
    return SwayYawDrive(
        F3 / hull.force_unit,
        hull.lever / hull.length,
        hull.yaw_mass / determinant,
        -hull.coupling_mass / determinant,
        hull.sway_mass / determinant,
    )


def surge_rates(state: Any, drive: SurgeDrive) -> tuple[Any, ...]:
    """Return the rates of (X, u, Xu, k1, k2): eq. (12), parameters constant. Also elementwise over numpy arrays."""
    u = state[1]
    thrust = state[3] * drive.F1 + state[4] * drive.F2
    return u, (thrust - state[2] * u) / drive.mass, 0.0, 0.0, 0.0


def surge_shown(state: Any) -> tuple[Any, ...]:
    """Return what is measured of (X, u, ...): X."""
    return (state[0],)


def sway_yaw_rates(state: Any, drive: SwayYawDrive) -> tuple[Any, ...]:
    """Return the rates of (y, psi, h2, h6, k3, Yv, Yr, Nv, Nr): eq. (13). Also elementwise over numpy arrays."""
    v = drive.a * state[2] + drive.b * state[3]
    r = drive.b * state[2] + drive.c * state[3]
    thrust = state[4] * drive.F3
    sway = thrust - state[5] * v - state[6] * r
    yaw = drive.lever * thrust - state[7] * v - state[8] * r
    return v * np.cos(state[1]), r, sway, yaw, 0.0, 0.0, 0.0, 0.0, 0.0


def sway_yaw_shown(state: Any) -> tuple[Any, ...]:
    """Return what is measured of (y, psi, ...): y and psi."""
    return state[0], state[1]


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


UNIDENTIFIED = 0.8
"""A parameter of which more than this share of the prior standard deviation is left has not been identified."""


SLOPE_SHARE = 1.0e-4
"""Part of a parameter's prior deviation over which the innovations' slope is taken."""

STATE_STEP = 1.0e-6
"""The same for the state, of the deviation that the filter's own covariance gives."""


class BatchFit(NamedTuple):
    """Parameters by the fit, shape (p,), and their covariance from the slopes of the innovations, shape (p, p).

    misfit: mean square of the whitened innovations; 1 where the noise is what the case says it is.
    """

    names: tuple[str, ...]
    estimate: FloatArray
    covariance: FloatArray
    misfit: float


def by_prediction_errors(case: Case, steps: Steps, start: FloatArray | None = None) -> BatchFit:
    """Return the parameters that minimise the whitened prediction errors of the whole record, prior included.

    start: where the search begins, shape (p,); by default at the prior's mean.
    """
    first = case.states
    theta = case.prior.mean[first:]
    scale = prior_deviation(case)
    root = np.linalg.inv(np.linalg.cholesky(case.prior.covariance[first:, first:]))

    nudge = SLOPE_SHARE * np.vstack([np.zeros(theta.size), np.eye(theta.size), -np.eye(theta.size)])
    known: dict[bytes, FloatArray] = {}

    def errors(z: FloatArray) -> FloatArray:
        """Innovations at z and beside it, all in one pass over the record."""
        if z.tobytes() not in known:
            known.clear()
            known[z.tobytes()] = _innovations(case, steps, theta + scale * (z + nudge))
        return known[z.tobytes()]

    def residual(z: FloatArray) -> FloatArray:
        return np.concatenate([errors(z)[0], root @ (scale * z)])

    def slope(z: FloatArray) -> FloatArray:
        up, down = errors(z)[1 : 1 + z.size], errors(z)[1 + z.size :]
        return np.vstack([(up - down).T / (2.0 * SLOPE_SHARE), root * scale])

    begin = np.zeros(theta.size) if start is None else (start - theta) / scale
    found = least_squares(residual, begin, jac=slope, method="lm", xtol=1.0e-5, ftol=1.0e-7)
    J = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.inv(J.T @ J) * np.outer(scale, scale)
    innovations = np.asarray(found.fun)[: -theta.size]
    misfit = float(innovations @ innovations) / max(int(np.isfinite(steps.measured).sum()), 1)
    return BatchFit(case.names, theta + scale * np.asarray(found.x), np.asarray(covariance), misfit)


def _innovations(case: Case, steps: Steps, thetas: FloatArray) -> FloatArray:
    """Return the whitened innovations of B Kalman filters, each with parameters of its own, shape (B, p): (B, n m)."""
    B, first = thetas.shape[0], case.states
    mean = np.hstack([np.tile(case.prior.mean[:first], (B, 1)), thetas])
    P = np.tile(case.prior.covariance[:first, :first], (B, 1, 1))
    errors = np.zeros((B, *steps.measured.shape))
    for k, (dt, inputs, z) in enumerate(zip(steps.dt, steps.inputs, steps.measured, strict=True)):
        mean, P = _predicted(case, mean, P, inputs, float(dt))
        there = np.isfinite(z)
        if there.any():
            mean, P, errors[:, k, there] = _corrected(case, mean, P, z, there)
    return errors.reshape(B, -1)


def _predicted(case: Case, mean: FloatArray, P: FloatArray, inputs: object, dt: float) -> tuple[FloatArray, FloatArray]:
    B, first, q = mean.shape[0], case.states, case.noise.shape[1]
    points, nudge = _around(mean, P)
    states = np.concatenate([points, np.repeat(mean[:, None], 2 * q, axis=1)], axis=1)
    kicks = np.zeros_like(states)
    kicks[:, 1 + 2 * first :] = np.concatenate([case.noise.T, -case.noise.T]) * np.sqrt(dt)
    d = mean.shape[1]
    moved = midpoint_step(case.drift, inputs, states.reshape(-1, d), dt, kicks.reshape(-1, d), case.substeps).reshape(
        B, -1, d
    )[:, :, :first]
    slope = (moved[:, 1 : 1 + first] - moved[:, 1 + first : 1 + 2 * first]) / (2.0 * nudge[:, :, None])
    root = 0.5 * (moved[:, 1 + 2 * first : 1 + 2 * first + q] - moved[:, 1 + 2 * first + q :])
    # slope and root hold their columns as rows here
    P = slope.transpose(0, 2, 1) @ P @ slope + root.transpose(0, 2, 1) @ root
    return np.hstack([moved[:, 0], mean[:, first:]]), P


def _corrected(
    case: Case, mean: FloatArray, P: FloatArray, z: FloatArray, there: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean and covariance after a measurement, and its whitened innovations."""
    B, first = mean.shape[0], case.states
    points, nudge = _around(mean, P)
    shown = observed(case.observe, points.reshape(-1, mean.shape[1])).reshape(B, -1, z.size)[:, :, there]
    H = ((shown[:, 1 : 1 + first] - shown[:, 1 + first :]) / (2.0 * nudge[:, :, None])).transpose(0, 2, 1)
    PH = P @ H.transpose(0, 2, 1)
    S = H @ PH + case.R[np.ix_(there, there)]
    innovation = z[there] - shown[:, 0]
    gain = np.linalg.solve(S, PH.transpose(0, 2, 1)).transpose(0, 2, 1)
    moved = mean.copy()
    moved[:, :first] += (gain @ innovation[:, :, None])[:, :, 0]
    P = P - gain @ S @ gain.transpose(0, 2, 1)
    whitened = np.linalg.solve(np.linalg.cholesky(S), innovation[:, :, None])[:, :, 0]
    return moved, 0.5 * (P + P.transpose(0, 2, 1)), whitened


def _around(mean: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the means and, beside them, each component of the state nudged up and down: (B, 1 + 2 s, d), (B, s)."""
    first = P.shape[1]
    nudge = STATE_STEP + 1.0e-3 * np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), 0.0))
    points = np.repeat(mean[:, None], 1 + 2 * first, axis=1)
    for i in range(first):
        points[:, 1 + i, i] += nudge[:, i]
        points[:, 1 + first + i, i] -= nudge[:, i]
    return points, nudge
