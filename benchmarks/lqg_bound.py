"""The linear-quadratic-Gaussian law as a bound: the least heading rms for a rudder's rate, whatever filter and law.

For a linear boat in Gaussian waves of a spectrum that the controller knows, no controller between instruments and
rudder has less rms of heading for the same rms of rudder rate. It knows boat, sea, gusts and noise, and its rudder has
neither lag, delay nor limits, so that the real loop can only be worse. Of a Gaussian rudder rate the travel is
sqrt(2/pi) times its rms.

The sea as met on a straight course is fitted by oscillators whose powers are not negative (least squares on its
covariance), the boat's cubic damping by its slope in the mean, n1 + 3 n3 E[r^2]; the wind's moment goes with the
heading too. Of what goes beyond the rudder's stops, and of waves that push otherwise as the boat yaws, the bound knows
nothing: `lqg_sailed.py` sails the law.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from naval_vessel import encounter_frequency
from scipy.linalg import expm, solve_discrete_are, solve_discrete_lyapunov
from scipy.optimize import nnls
from study_boats import SEAS, StudyBoat, StudySea

from autopilot.models import wind
from autopilot.runtime.build import model_of
from sitl.scenario import IttcSection
from sitl.sea import ittc_waves, wave_forces

Floats = npt.NDArray[np.float64]

HZ = 10
REALISATIONS = 100
LAGS_S = np.arange(0.0, 60.0, 0.2)
WEIGHTS = np.logspace(-2.0, 3.0, 26)
FIRST_WAVE, LASTING_S, UNKNOWN = 5, 2000.0, math.radians(0.5)
TRAVEL_OF_RMS = math.sqrt(2.0 / math.pi)


class Point(NamedTuple):
    """Heading rms [deg] and rudder travel [deg/s]."""

    rms_deg: float
    travel_deg_s: float


def covariance_met(boat: StudyBoat, side: float, sea: StudySea = SEAS["state 5"]) -> Floats:
    """Return E[a(t) a(t + lag)] [rad^2/s^4] of the waves' yaw acceleration on a straight course, by LAGS_S."""
    speed = boat.vessel.model.reference_speed_m_s
    total = np.zeros(len(LAGS_S))
    for seed in range(REALISATIONS):
        waves = ittc_waves(IttcSection(sea.height, sea.period, side), boat.hull, np.random.default_rng(seed))
        yaw, _ = wave_forces(waves, 0.0)
        met = encounter_frequency(waves.frequency, speed, waves.towards)
        total += 0.5 * (yaw**2) @ np.cos(np.outer(met, LAGS_S))
    return np.asarray(total / REALISATIONS)


def worth_of(boat: StudyBoat, covariance: Floats) -> float:
    """Return the rms [deg] of the rudder angle that would push the boat as the waves do."""
    model = model_of(boat.vessel)
    return math.degrees(math.sqrt(covariance[0]) * model.time_constant / model.gain)


class Oscillator(NamedTuple):
    """x'' + 2 damping frequency x' + frequency^2 x = noise; what it gives is x', of this `power` E[x'^2] [rad^2/s^4].

    x' has no spectrum at zero frequency, where waves have none either and a slow ship would feel it most.
    """

    frequency: float
    damping: float
    power: float


def oscillators(covariance: Floats) -> list[Oscillator]:
    """Return oscillators whose covariances add up to this one."""
    kinds = [(w, z) for w in np.geomspace(0.05, 3.0, 80) for z in (0.01, 0.03, 0.06, 0.1, 0.2, 0.4)]
    columns = []
    for w, z in kinds:
        ringing = w * math.sqrt(1.0 - z * z)
        swing = np.cos(ringing * LAGS_S) - z * w / ringing * np.sin(ringing * LAGS_S)
        columns.append(np.exp(-z * w * LAGS_S) * swing)
    powers, _ = nnls(np.array(columns).T, covariance / covariance[0], maxiter=20_000)
    return [Oscillator(w, z, float(p * covariance[0])) for (w, z), p in zip(kinds, powers, strict=True) if p > 1.0e-3]


class Linear(NamedTuple):
    """The boat on a straight course by steps of 1/HZ s: x' = transition x + move u + what has the covariance `driven`,
    and instruments that show x with `noise`.

    x: psi, r, rudder, gust [m/s], what nobody knows as a lasting rudder angle [rad], and two of each oscillator,
    scaled; spread: what their variances are about. u: the rudder's movement [rad]. steady: the mean wind as a rudder
    angle [rad].
    """

    transition: Floats
    move: Floats
    driven: Floats
    shown: Floats
    noise: Floats
    spread: Floats
    steady: float


def linear_of(
    boat: StudyBoat,
    side: float,
    waves: list[Oscillator],
    rate_variance: float,
    sea: StudySea = SEAS["state 5"],
    has_gyro: bool = True,
    unknown: float = 0.0,
) -> Linear:
    """Return the boat about a course with the sea `side` deg off its bow, its damping that of E[r^2] [rad^2/s^2];
    `unknown` [rad] is the deviation of what nobody knows."""
    model, sensors = model_of(boat.vessel), boat.vessel.sensors
    n, dt, time = FIRST_WAVE + 2 * len(waves), 1.0 / HZ, model.time_constant
    load, speed, start = wind.WindLoad(math.radians(0.003)), model.reference_speed, math.radians(side)

    def moment(gust: float, heading: float) -> float:
        return wind.rudder_equivalent(load, wind.apparent_wind(sea.wind + gust, start, heading, speed, 0.0))

    a, noise = np.zeros((n, n)), np.zeros((n, n))
    a[0, 1] = 1.0
    # the speed is held towards the bow: what turns with the boat is the wind about it alone
    a[1, 0] = model.gain / time * (moment(0.0, 1.0e-3) - moment(0.0, -1.0e-3)) / 2.0e-3
    a[1, 1] = -(model.n1 + 3.0 * model.n3 * rate_variance) / time
    a[1, 2] = model.gain / time
    a[1, 3] = model.gain / time * (moment(1.0e-3, 0.0) - moment(-1.0e-3, 0.0)) / 2.0e-3
    a[3, 3], noise[3, 3] = -0.1, 0.2 * sea.gust**2
    a[1, 4] = model.gain / time
    a[4, 4], noise[4, 4] = -1.0 / LASTING_S, 2.0 / LASTING_S * unknown * unknown
    for place, one in enumerate(waves):
        # frequency x and x', both scaled to a variance of 1
        y = FIRST_WAVE + 2 * place
        a[1, y + 1] = math.sqrt(one.power)
        a[y, y + 1], a[y + 1, y] = one.frequency, -one.frequency
        a[y + 1, y + 1] = -2.0 * one.damping * one.frequency
        noise[y + 1, y + 1] = 4.0 * one.damping * one.frequency
    # van Loan: transition and noise of a step
    both = expm(dt * np.block([[-a, noise], [np.zeros((n, n)), a.T]]))
    f = both[n:, n:].T.copy()
    q = f @ both[:n, n:]
    q = 0.5 * (q + q.T)
    q[:3, :3] += 1.0e-18 * np.eye(3)
    shown = np.eye(2 if has_gyro else 1, n)
    noises = sensors.heading_noise_deg, sensors.rate_noise_deg_s
    r = np.diag(np.radians(noises[: len(shown)]) ** 2)
    spread = np.array([0.0, 0.0, 0.0, sea.gust**2, unknown * unknown, *np.ones(2 * len(waves))])
    # the rudder jumps at the beginning of a step
    return Linear(f, f[:, 2:3], q, shown, r, spread, moment(0.0, 0.0))


def _riccati(linear: Linear, weight: float) -> tuple[Floats, Floats] | None:
    cost = np.zeros_like(linear.transition)
    cost[0, 0] = 1.0
    # a rudder nobody needs goes amidships, which the equation must know to have a solution
    cost[2, 2] = cost[4, 4] = cost[2, 4] = cost[4, 2] = 1.0e-9
    input_cost = np.array([[(weight * HZ) ** 2]])
    try:
        return solve_discrete_are(linear.transition, linear.move, cost, input_cost), input_cost
    except ValueError:  # so heavy or light that the equation is too ill-conditioned
        return None


def regulator(linear: Linear, weight: float) -> Floats | None:
    """Return the feedback (1, states) of least psi^2 + weight^2 (rudder rate)^2; None where it cannot be worked out."""
    found = _riccati(linear, weight)
    if found is None:
        return None
    riccati, input_cost = found
    move = linear.move
    return np.asarray(np.linalg.solve(input_cost + move.T @ riccati @ move, move.T @ riccati @ linear.transition))


def bound(linear: Linear) -> tuple[list[Point], float]:
    """Return the best that can be, by weight, and the largest E[r^2] [rad^2/s^2] on the way."""
    f, q, shown, r = linear.transition, linear.driven, linear.shown, linear.noise
    before = solve_discrete_are(f.T, shown.T, q, r)
    total = shown @ before @ shown.T + r
    gain = before @ shown.T @ np.linalg.inv(total)
    left = before - gain @ shown @ before
    found, most = [], 0.0
    for weight in WEIGHTS:
        feedback = regulator(linear, weight)
        if feedback is None:
            continue
        closed = f - linear.move @ feedback
        known = solve_discrete_lyapunov(closed, gain @ total @ gain.T)
        moved = math.sqrt((feedback @ known @ feedback.T).item()) * HZ
        found.append(Point(math.degrees(math.sqrt(known[0, 0] + left[0, 0])), math.degrees(TRAVEL_OF_RMS * moved)))
        most = max(most, float(known[1, 1] + left[1, 1]))
    return found, most


def settled(
    boat: StudyBoat, side: float, sea: StudySea, waves: list[Oscillator], has_gyro: bool
) -> tuple[Linear, list[Point]]:
    """Return the bound, and the boat to sail with the law, its damping that of the rate it turns with."""
    points, rate_variance = list[Point](), 0.0
    for _ in range(2):
        points, most = bound(linear_of(boat, side, waves, rate_variance, sea, has_gyro))
        rate_variance = 0.5 * (rate_variance + most)
    return linear_of(boat, side, waves, rate_variance, sea, has_gyro, UNKNOWN), points


def least_travel(points: list[Point], rms_deg: float) -> float:
    """Return the least travel [deg/s] at this rms [deg], between the points by logarithms; nan: there is none."""
    points = sorted(points)
    if rms_deg < points[0].rms_deg:
        return math.nan
    rms, travel = np.log([p.rms_deg for p in points]), np.log([max(p.travel_deg_s, 1.0e-9) for p in points])
    return float(math.exp(np.interp(math.log(rms_deg), rms, travel)))
