"""Paper 1's heading control experiment, measured with the product's own functions and printed beside its claims.

    python benchmarks/jiang2016_heading_control.py [--json]

The boat follows psi_d = 30 deg sin(2 pi t/60 s) on the identified Lanxin model, with true heading and rate fed
back. The first period is left out: the boat starts at rest, the sine does not.
Source: Jiang et al. 2016, tables 1 and 2, eqs (5), (26), (29)-(31), figures 4 to 7.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from autopilot.angles import wrap
from autopilot.control.backstepping import BacksteppingGains, BoundedGains, backstepping_rudder
from autopilot.control.law import NO_ROLL, LawInput
from autopilot.control.pid import BoatPid, PidGains, PidMemory
from autopilot.control.pid import step as pid_step
from autopilot.identification.two_stage import cubic_damping_stage
from autopilot.models.norrbin import Norrbin, rate_step, steady_rate
from autopilot.models.steering_gear import DelayLine, SteeringGear, clip, gear_step
from autopilot.models.weather import JIANG_DEG, discretise, stationary_state, wave_step
from autopilot.runtime.build import gear_of, model_of
from autopilot.signals import NavState, Reference
from autopilot.vessel.file import load_vessel

KNOT = 1852.0 / 3600.0
AMPLITUDE, PERIOD_S = math.radians(30.0), 60.0
SECONDS, SETTLED_S = 180.0, 60.0
PLANT_HZ = 400
SEED = 2016
TABLE_2_DEG = ((5, 3.38), (8, 3.461), (10, 6.043), (15, 9.774), (20, 12.203), (25, 14.486), (35, 18.351))
"""Rudder [deg] and steady yaw rate [deg/s], Jiang et al. 2016, table 2."""

LawStep = Callable[[Reference, float, float, float], float]
"""Reference, heading [rad], rate [rad/s], last rudder order [rad] -> rudder demand [rad]."""


def printed_equation_26(
    model: Norrbin, gains: BacksteppingGains, reference: Reference, heading: float, rate: float
) -> float:
    """Return the rudder [rad] that eq. (26) gives as printed, misprints and all: to show what they do."""
    z1 = wrap(heading - reference.heading)
    k1, k2 = gains.k1, gains.k2
    return (model.gain / model.time_constant) * (
        (-k1 - k2 + 1.0 / model.time_constant) * rate
        + model.n3 / model.time_constant * rate**3
        + (1.0 - k1 * k2) * z1
        - (k1 + k2) * reference.rate
        + reference.acceleration
    )


class Trial(NamedTuple):
    """One row: a law with its gains, run at `rate_hz` on a rudder."""

    name: str
    law: str
    gains: BacksteppingGains | PidGains
    rate_hz: int
    rudder: str


class Result(NamedTuple):
    """What is measured after the first period; lost: a heading error beyond 90 deg was seen."""

    heading_rms_deg: float
    travel_deg_s: float
    worst_rate_deg_s: float
    lost: bool


def sine(time: float) -> Reference:
    """Return the heading sine with its rate and acceleration at `time` [s]."""
    w = 2.0 * math.pi / PERIOD_S
    s, c = math.sin(w * time), math.cos(w * time)
    return Reference(AMPLITUDE * s, AMPLITUDE * w * c, -AMPLITUDE * w * w * s)


def law_step(trial: Trial, model: Norrbin) -> LawStep:
    """Return the law of a trial as one function, with a fresh memory."""
    gains = trial.gains

    def given_of(reference: Reference, heading: float, rate: float, last: float) -> LawInput:
        state = NavState(0.0, heading, rate, model.reference_speed, 0.0, 0.0, 0.0, True)
        return LawInput(model, 1.0, reference, state, NO_ROLL, last, math.inf, 1.0 / trial.rate_hz)

    if isinstance(gains, PidGains):
        memory = PidMemory()

        def pid(reference: Reference, heading: float, rate: float, last: float) -> float:
            nonlocal memory
            demand, memory = pid_step(BoatPid(gains), memory, given_of(reference, heading, rate, last))
            return demand

        return pid
    if trial.law == "eq. (26) as printed":
        return lambda reference, heading, rate, last: printed_equation_26(model, gains, reference, heading, rate)
    bounded = BoundedGains(gains)
    return lambda reference, heading, rate, last: backstepping_rudder(
        bounded, given_of(reference, heading, rate, last), rate
    )


def sea_of(seed: int | None) -> list[float]:
    """Return the paper's sea as equivalent rudder [rad] at every plant step; zeros where `seed` is None."""
    steps = round(SECONDS * PLANT_HZ)
    if seed is None:
        return [0.0] * steps
    deviates = np.random.default_rng(seed).standard_normal((steps + 1, 2)).tolist()
    state = stationary_state(JIANG_DEG, *deviates[0])
    transition = discretise(JIANG_DEG, 1.0 / PLANT_HZ)
    angles = []
    for pair in deviates[1:]:
        state = wave_step(transition, state, *pair)
        angles.append(math.radians(state.value))
    return angles


def curves(trial: Trial, model: Norrbin, gear: SteeringGear, sea: list[float]) -> tuple[list[float], list[float]]:
    """Return heading and rudder [rad] of a trial at every plant step."""
    shown: tuple[list[float], list[float]] = ([], [])
    simulate(trial, model, gear, sea, shown)
    return shown


def simulate(
    trial: Trial,
    model: Norrbin,
    gear: SteeringGear,
    sea: list[float],
    shown: tuple[list[float], list[float]] | None = None,
) -> Result:
    """Run one trial and measure it; `shown` is given heading and rudder of every step."""
    law, line = law_step(trial, model), DelayLine(gear.delay)
    every, dt = PLANT_HZ // trial.rate_hz, 1.0 / PLANT_HZ
    heading = rate = rudder = order = rudder_before = 0.0
    squares, travel, worst, lost, ticks = 0.0, 0.0, 0.0, False, 0
    for step, disturbance in enumerate(sea):
        time = step * dt
        if step % every == 0:
            reference = sine(time)
            order = clip(law(reference, heading, rate, order), -gear.angle_max, gear.angle_max)
            line.give(time, order)
            error = wrap(heading - reference.heading)
            lost = lost or abs(error) > math.pi / 2.0
            if time >= SETTLED_S:
                ticks += 1
                squares += error * error
                travel += abs(rudder - rudder_before)
                worst = max(worst, abs(rudder - rudder_before) * trial.rate_hz)
            rudder_before = rudder
        rudder = gear_step(gear, rudder, line.effective(time), dt)
        rate_before = rate
        rate = rate_step(model, rate, rudder + disturbance, dt)
        heading += 0.5 * dt * (rate + rate_before)
        if shown is not None:
            shown[0].append(heading)
            shown[1].append(rudder)
    rms = math.degrees(math.sqrt(squares / ticks))
    return Result(rms, math.degrees(travel) / (SECONDS - SETTLED_S), math.degrees(worst), lost)


def trials(shipped: BacksteppingGains) -> list[Trial]:
    """Return the rows: the paper's laws on three rudders and two rates, its erratum, and gains that can be steered."""
    pid, paper = PidGains(40.0, 0.0, 0.1), BacksteppingGains(35.0, 15.0)
    ideal, limited, real = "ideal", "20 deg/s", "20 deg/s, lag, delay"
    rows = [Trial("paper's PID 40/0/0.1", "pid", pid, 200, ideal)]
    rows.append(Trial("paper's k1 35, k2 15", "backstepping", paper, 200, ideal))
    rows.append(Trial("the same, eq. (26) as printed", "eq. (26) as printed", paper, 200, ideal))
    for rate_hz, rudder in ((20, ideal), (200, limited), (200, real), (20, real)):
        rows.append(Trial("paper's PID 40/0/0.1", "pid", pid, rate_hz, rudder))
        rows.append(Trial("paper's k1 35, k2 15", "backstepping", paper, rate_hz, rudder))
    rows.append(Trial("k1 2, k2 2", "backstepping", BacksteppingGains(2.0, 2.0), 20, real))
    name = f"lanxin.yaml: k1 {shipped.k1:g}, k2 {shipped.k2:g}, gamma {shipped.gamma:g}"
    rows.append(Trial(name, "backstepping", shipped, 20, real))
    return rows


def identification_claims(model: Norrbin) -> list[tuple[str, str, float]]:
    """Return (what, the paper's figure, ours) of the model itself."""
    rudder, rate = np.radians(np.asarray(TABLE_2_DEG, dtype=float)).T
    n3_deg = cubic_damping_stage(rudder, rate, model.gain).n3 * math.radians(1.0) ** 2
    rows = [("n3 of table 2, K = 0.701 held [(s/deg)^2]", "0.001", n3_deg)]
    for angle_deg, rate_deg_s in TABLE_2_DEG:
        ours = math.degrees(steady_rate(model, math.radians(angle_deg)))
        rows.append((f"table 2: yaw rate at {angle_deg} deg of rudder [deg/s]", f"{rate_deg_s:g}", ours))
    for speed_kn, angle_deg in ((9.65, 4.9), (9.1, 5.0)):
        radius = speed_kn * KNOT / steady_rate(model, math.radians(angle_deg))
        rows.append(
            (f"turning radius at {speed_kn:g} kn, rudder {angle_deg:g} deg [m]", "85.76 sim, 84.97 boat", radius)
        )
    return rows


def measure() -> tuple[list[tuple[str, str, float]], list[tuple[Trial, Result, Result]]]:
    """Return the model's figures, and each trial with its results in calm and in the paper's sea."""
    vessel = load_vessel("lanxin")
    model, real = model_of(vessel), gear_of(vessel)
    limited = SteeringGear(real.angle_max, real.rate_max)
    rudders = {
        "ideal": SteeringGear(real.angle_max, math.inf),
        "20 deg/s": limited,
        "20 deg/s, lag, delay": real,
    }
    block = vessel.control.backstepping
    shipped = BacksteppingGains(block.k1_1_s, block.k2_1_s, block.gamma_1_s2)
    calm, sea = sea_of(None), sea_of(SEED)
    rows = [
        (trial, simulate(trial, model, rudders[trial.rudder], calm), simulate(trial, model, rudders[trial.rudder], sea))
        for trial in trials(shipped)
    ]
    return identification_claims(model), rows


CLAIMS = (
    "The paper's claims, from its figures 6 and 7 (it prints no numbers): in the same wind and waves both laws",
    "follow the sine, backstepping more closely than PID, and with less movement of the rudder.",
)


def print_table(model_rows: list[tuple[str, str, float]], rows: list[tuple[Trial, Result, Result]]) -> None:
    """Print everything measured beside what the paper prints."""
    print(f"{'model':52s} {'paper':>22s} {'here':>10s}")
    for what, paper, here in model_rows:
        print(f"{what:52s} {paper:>22s} {here:10.4g}")
    print()
    print("\n".join(CLAIMS))
    print()
    print(f"{'':74s} {'calm':^26s}   {'sea of eq. (31)':^26s}")
    columns = f"{'rms':>8s} {'travel':>8s} {'worst':>8s}"
    print(f"{'law':38s} {'Hz':>4s}  {'rudder':20s} {'':8s} {columns}   {columns}")
    print(f"{'':74s} {'deg':>8s} {'deg/s':>8s} {'deg/s':>8s}   {'deg':>8s} {'deg/s':>8s} {'deg/s':>8s}")
    for trial, *results in rows:
        cells = "   ".join(f"{r.heading_rms_deg:8.3f} {r.travel_deg_s:8.2f} {r.worst_rate_deg_s:8.1f}" for r in results)
        lost = "LOST" if any(result.lost for result in results) else ""
        print(f"{trial.name:38s} {trial.rate_hz:4d}  {trial.rudder:20s} {lost:8s} {cells}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    arguments = parser.parse_args()
    model_rows, rows = measure()
    if not arguments.json:
        print_table(model_rows, rows)
        return
    document = {
        "model": [{"what": what, "paper": paper, "here": here} for what, paper, here in model_rows],
        "trials": [
            {**trial._asdict(), "gains": trial.gains._asdict(), "calm": calm._asdict(), "sea": sea._asdict()}
            for trial, calm, sea in rows
        ],
    }
    print(json.dumps(document, indent=2))


if __name__ == "__main__":
    main()
