"""How often the 95 % intervals of `autopilot identify` hold the truth where propeller and wind are found, too.

    python benchmarks/surroundings_intervals.py [--seeds 40] [--first-seed 0] [--gust 1.0] [--noise 0.2]

Three 20/20 zigzags of a boat that gets under way at 8, 12 and 16 revolutions per second, its rudder in the propeller's
race, in a wind that the log holds and in gusts [deg of rudder, rms] that nobody recorded; the rudder has so much noise
[deg], compass 0.3 deg, gyro 0.1 deg/s, the log 1 %. The boat is moved by Runge and Kutta's second order in steps of
10 ms and shares no code.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.interval import interval_of
from autopilot.identification.runs import Run, run_from_columns

U0, N0, RACE, WIND = 0.25, 10.0, 8.0e-4, 4.0e-4
REVOLUTIONS, SECONDS, STEP_S, ANGLE = (8.0, 12.0, 16.0), 150.0, 0.01, 0.35
NAMES = (
    "time_s",
    "heading_rad",
    "yaw_rate_rad_s",
    "rudder_rad",
    "speed_m_s",
    "propeller_rps",
    "wind_speed_m_s",
    "wind_direction_rad",
)


def inflow(speed: float, propeller: float) -> float:
    """Return the flow past the rudder, squared, as a share of that at U0 and N0."""
    return max((speed**2 + RACE * propeller**2) / (U0**2 + RACE * N0**2), 0.0025)


def trial(seed: int, number: int, gust_deg: float, noise_deg: float) -> Run:
    """Return the recording of a zigzag."""
    dt, random, propeller = STEP_S, np.random.default_rng([seed, number]), REVOLUTIONS[number]
    rate = heading = rudder = speed = 0.0
    order, blow, rows, push = ANGLE, 3.0, [], random.normal()
    keep = math.exp(-dt / 5.0)
    for i, (blown, pushed) in enumerate(random.normal(size=(round(SECONDS / dt), 2)).tolist()):
        blow += dt / 10.0 * (3.0 - blow) + math.sqrt(dt) * 0.3 * blown
        push = keep * push + math.sqrt(1.0 - keep * keep) * pushed
        off = 2.0 - heading
        if i % 10 == 0:
            rows.append((i * dt, heading, rate, rudder, speed, propeller, abs(blow), off % (2.0 * math.pi)))
        if heading * math.copysign(1.0, order) >= ANGLE and speed > 0.1:
            order = -order
        moved = min(max(order - rudder, -0.4 * dt), 0.4 * dt)
        # halfway, from where the boat is, and then the whole step
        middle, fast = rate, speed
        for h in (0.5 * dt, dt):
            flow, off = inflow(fast, propeller), 2.0 - heading - (h - 0.5 * dt) * rate
            turning = 0.01 * flow * (rudder + (h / dt - 0.5) * moved + math.radians(gust_deg) * push)
            turning -= middle / 12.0 * flow**0.5 + 20.0 * middle**3 / flow**0.5
            turning += WIND * (math.sin(off) - 0.5 * math.sin(2.0 * off)) * blow**2
            ahead = 0.2 * (0.025 * propeller - fast - 3.0 * abs(middle))
            if h < dt:
                middle, fast = rate + h * turning, speed + h * ahead
        heading += dt * middle
        rate, speed, rudder = rate + dt * turning, speed + dt * ahead, rudder + moved
    table = np.array(rows)
    size = np.radians([0.3, 0.1, noise_deg])
    table[:, 1:4] += size * random.standard_normal((len(table), 3))
    table[:, 4] *= 1.0 + 0.01 * random.standard_normal(len(table))
    return run_from_columns(f"trial {number}", dict(zip(NAMES, table.T, strict=True)))


def errors_of(seed: int, gust_deg: float, noise_deg: float) -> dict[str, tuple[float, float, bool]]:
    """Return of each number that was found its error, in standard errors and in % of the truth (n0: of K times a
    degree), and whether its printed interval holds the truth; nothing where neither race nor wind was found."""
    runs = [trial(seed, number, gust_deg, noise_deg) for number in range(len(REVOLUTIONS))]
    found = identify(runs, Question(reference_speed=U0))
    if found.around is None:
        return {}
    flow = inflow(U0, found.around.reference_propeller)
    a, b, d = 0.01 * flow, flow**0.5 / 12.0, 20.0 / flow**0.5
    truth = {"gain": a / b, "time_constant": 1.0 / b, "n3": d / b, "n0": 0.0}
    values = {name: float(getattr(found.model, name)) for name in truth}
    truth |= {"race": RACE, "wind_beam": WIND, "wind_quarter": -0.5 * WIND}
    values |= {name: float(getattr(found.around, name)) for name in tuple(truth)[4:]}
    size, result = {**truth, "n0": truth["gain"] * math.radians(1.0)}, {}
    for name, value in values.items():
        if std := found.standard_errors.get(name):
            (low, high), off = interval_of(name, value, std), value - truth[name]
            result[name] = (off / std, 100.0 * off / abs(size[name]), low <= truth[name] <= high)
    return result


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--gust", type=float, default=1.0)
    parser.add_argument("--noise", type=float, default=0.2)
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    rows = [errors_of(seed, given.gust, given.noise) for seed in seeds]
    print("| | held in % | rms of error over standard error | rms error % |\n|---|---|---|---|")
    for name in max(rows, key=len):
        known = np.array([row[name] for row in rows if name in row])
        (rms, size), held = np.sqrt(np.mean(known[:, :2] ** 2, axis=0)), 100.0 * float(np.mean(known[:, 2]))
        print(f"| {name} | {held:.0f} of {len(known)} | {rms:.2f} | {size:.1f} |")


if __name__ == "__main__":
    main()
