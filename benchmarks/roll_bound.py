"""How much roll any linear law can take from the naval vessel: LQG that knows the ship and the spectrum of the waves.

    python benchmarks/roll_bound.py [--seeds 3] [--case "as filed"]     the rows in benchmarks/results/liu2017.md

Ship, seas, gear, instruments and delay are those of `roll_in_the_loop.py`, without pilot and link. The law knows the
linear model of the ship, the gear's lag, and amplitude and phase of roll moment and yaw moment at each frequency of
encounter; it does not know the waves to come. With x = (v, p, r, phi, psi, rudder, order, z) it minimises

    J = mean(phi^2 + WEIGHT_COURSE psi^2 + WEIGHT_ANGLE delta^2 + rho (d order/dt)^2)

over `rho`: the smaller it is, the more roll is taken and the more speed it costs. The order is held to the gear's rate
and angle, and the filter knows what was given. The sea is COMPONENTS oscillators z of white noise

    z' = (-d + j w_e) z + noise,   slope = a_roll Im z,   yaw acceleration = a_yaw Re z

each as broad as the next one is away, so that none of them foretells a wave by its clockwork.
"""

from __future__ import annotations

import argparse
import json
import math

import numpy as np
from naval_vessel import encounter_frequency, linear_motion, mass_matrix
from numpy.typing import NDArray
from roll_in_the_loop import CASES, FILED_RATE_DEG_S, FRESH, LASTS_S, SETTLED_S, Case, SlowHelm, scenario_of
from scipy.linalg import expm

from autopilot.models import weather
from autopilot.vessel.file import load_vessel
from sitl.roll_ship import GEAR, NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED
from sitl.sea import IttcWaves, wave_forces
from sitl.sensors import Reading
from sitl.world import Orders, Pace, World

Array = NDArray[np.float64]

DT = 0.05
"""The law's period [s]; its order takes effect one of them after the measurement, as the vessel file has it."""
COMPONENTS = 30
BREADTH = 0.5
"""Damping of an oscillator in distances to the next frequency."""
WEIGHT_COURSE, WEIGHT_ANGLE = 0.1, 0.03
RATE_WEIGHTS = (0.003, 0.01, 0.03, 0.1)
NOISE_DEG = (0.3, 0.2, 0.2, 0.1, 0.1)
"""Of heading [deg], yaw rate, roll rate [deg/s], roll and rudder [deg]."""
STATES, ORDER = 7, 6
"""States of ship and gear, v p r phi psi rudder order, and the place of the order."""


def sea_of(case: Case) -> tuple[Array, Array, Array]:
    """Return frequency of encounter [rad/s], roll slope [rad] and yaw acceleration [rad/s^2] of each component."""
    section = scenario_of(case).waves.ittc
    assert section is not None
    # the middles of the bands in which the simulator draws its own
    peak = 2.0 * math.pi / section.peak_period_s
    frequency = 0.5 * peak + 2.5 * peak / COMPONENTS * (np.arange(COMPONENTS) + 0.5)
    number = weather.wave_number(frequency)
    period = weather.mean_period_of(section.peak_period_s)
    slope = weather.component_amplitudes(frequency, section.significant_height_m, period) * number
    slope = slope * np.exp(-0.5 * number * NAVAL_HULL.draught)
    towards = math.radians(section.from_deg) + math.pi
    hull = IttcWaves(frequency, number, slope, 0.0 * slope, towards, NAVAL_HULL.length, NAVAL_HULL.beam)
    yaw, roll = wave_forces(hull, 0.0)
    return encounter_frequency(frequency, SERVICE_SPEED, towards), roll, yaw


def plant_of(case: Case) -> tuple[Array, Array, Array]:
    """Return F, G and the intensity Q of x' = F x + G d order/dt + noise."""
    ship = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
    met, roll, yaw = sea_of(case)
    width = BREADTH * np.abs(np.gradient(met))
    size = STATES + 2 * COMPONENTS
    F, G, Q = np.zeros((size, size)), np.zeros((size, 1)), np.zeros((size, size))
    F[:5, :5], F[:5, 5] = ship.A, ship.b
    F[5, 5], F[5, ORDER], G[ORDER, 0] = -1.0 / GEAR.lag, 1.0 / GEAR.lag, 1.0
    # what the model lacks: a little, so that the filter does not trust it blindly
    Q[0, 0], Q[1, 1], Q[2, 2] = 1.0e-6, 1.0e-8, 1.0e-9
    by_slope = np.linalg.inv(mass_matrix(NAVAL_HULL))[:, 1] * NAVAL_HULL.roll.restoring
    for number in range(COMPONENTS):
        cosine = STATES + 2 * number
        sine = cosine + 1
        F[cosine, cosine] = F[sine, sine] = -width[number]
        F[cosine, sine], F[sine, cosine] = met[number], -met[number]
        Q[cosine, cosine] = Q[sine, sine] = width[number]
        F[:3, sine], F[2, cosine] = by_slope * roll[number], yaw[number]
    return F, G, Q


def sampled(F: Array, G: Array, Q: Array) -> tuple[Array, Array, Array]:
    """Return the exact step of DT: Van Loan 1978."""
    size = len(F)
    step = expm(DT * np.block([[F, G], [np.zeros((1, size + 1))]]))
    noise = expm(DT * np.block([[-F, Q], [np.zeros((size, size)), F.T]]))
    covariance = noise[size:, size:].T @ noise[:size, size:]
    return step[:size, :size], step[:size, size:], 0.5 * (covariance + covariance.T)


def riccati(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """Return the stabilising solution by doubling (Anderson 1978), which bears modes next to the unit circle."""
    G, H, eye = B @ np.linalg.solve(R, B.T), Q.copy(), np.eye(len(A))
    for _ in range(60):
        inner = np.linalg.inv(eye + G @ H)
        grown = H + A.T @ H @ inner @ A
        A, G, before, H = A @ inner @ A, G + A @ inner @ G @ A.T, H, 0.5 * (grown + grown.T)
        if np.linalg.norm(H - before) < 1.0e-12 * np.linalg.norm(H):
            return H
    raise ValueError("the Riccati equation has not converged")


class Lqg:
    """The law: a filter of ship and sea, and feedback on both. A helm of the world, asked at each of its steps."""

    def __init__(self, world: World, case: Case, rate_weight: float) -> None:
        A, B, Q = sampled(*plant_of(case))
        cost, rate = np.zeros_like(A), np.array([[rate_weight]])
        cost[3, 3], cost[4, 4], cost[5, 5] = 1.0, WEIGHT_COURSE, WEIGHT_ANGLE
        P = riccati(A, B, cost, rate)
        self.K = np.linalg.solve(rate + B.T @ P @ B, B.T @ P @ A)[0]
        C = np.zeros((5, len(A)))
        for row, place in enumerate((4, 2, 1, 3, 5)):
            C[row, place] = 1.0
        noise = np.diag(np.radians(NOISE_DEG) ** 2)
        S = riccati(A.T, C.T, Q + 1.0e-14 * np.eye(len(A)), noise)
        self.L = S @ C.T @ np.linalg.inv(C @ S @ C.T + noise)
        self.A, self.B, self.C = A, B[:, 0], C
        self.x, self.order, self.given, self.in_force = np.zeros(len(A)), 0.0, 0.0, 0.0
        self.rate = math.radians(FILED_RATE_DEG_S) * case.rate
        world.helms.append(self)

    def step(self, shown: Reading) -> None:
        """Take what is measured; the order that was worked out last takes effect."""
        self.in_force = self.order
        heading = math.remainder(shown.heading, 2.0 * math.pi)
        seen = np.array([heading, shown.rate, shown.roll_rate, shown.roll, shown.rudder])
        self.x = self.x + self.L @ (seen - self.C @ self.x)
        # the order of now counts from the next measurement on
        self.x = self.A @ self.x + self.B * self.given
        wanted = self.order + DT * min(max(float(-self.K @ self.x), -self.rate), self.rate)
        held = min(max(wanted, -GEAR.angle_max), GEAR.angle_max)
        self.given, self.order = (held - self.order) / DT, held

    def orders(self, time: float) -> Orders:
        """Return the order in force."""
        return Orders(rudder=self.in_force)


def sail(case: Case, seed: int, steers: str, rate_weight: float = 0.0) -> Array:
    """Return roll, heading, speed and rudder, a row for each DT: `steers` is fixed, course or lqg."""
    world = World(load_vessel("naval_vessel"), scenario_of(case), seed, pace=Pace(5, 2))
    law = Lqg(world, case, rate_weight) if steers == "lqg" else None
    if steers == "course":
        world.helms.append(SlowHelm(world))
    rows = []
    for number in range(1, round(LASTS_S / DT) + 1):
        now = round(number * DT, 9)
        world.advance(now)
        shown, state = world.sensors.latest(now), world.boat.state
        if law is not None and shown is not None:
            law.step(shown)
        if now > SETTLED_S:
            rows.append((state.roll, math.remainder(state.heading, 2.0 * math.pi), state.speed, state.rudder))
    return np.array(rows)


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=FRESH)
    parser.add_argument("--case", action="append", choices=("as filed", "2.5 m"))
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    for case in CASES[:2]:
        if given.case and case.name not in given.case:
            continue
        runs = {name: np.array([sail(case, seed, name) for seed in seeds]) for name in ("fixed", "course")}
        for weight in RATE_WEIGHTS:
            lqg = np.array([sail(case, seed, "lqg", weight) for seed in seeds])
            roll = {name: np.std(run[:, :, 0], axis=1) for name, run in {**runs, "lqg": lqg}.items()}
            less = {name: round(float(np.mean(1.0 - roll["lqg"] / roll[name])), 3) for name in ("fixed", "course")}
            loss = 1.0 - np.mean(lqg[:, :, 2]) / np.mean(runs["course"][:, :, 2])
            row = {
                "case": case.name,
                "rho": weight,
                "roll_deg": [round(math.degrees(float(np.mean(roll[name]))), 2) for name in ("fixed", "course", "lqg")],
                "less_than_fixed": less["fixed"],
                "less_than_on_course": less["course"],
                "speed_loss_on_course": round(float(loss), 4),
                "heading_deg": round(math.degrees(float(np.sqrt(np.mean(lqg[:, :, 1] ** 2)))), 2),
                "rudder_deg": round(math.degrees(float(np.std(lqg[:, :, 3]))), 1),
                "travel_deg_s": round(math.degrees(float(np.mean(np.abs(np.diff(lqg[:, :, 3]))))) / DT, 1),
            }
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
