"""How often the 95 % intervals of `autopilot identify` hold the truth of a boat that steers by thrust.

    python benchmarks/thrust_intervals.py [--seeds 40] [--first-seed 0] [--gust 1.0] [--blind]

Zigzags of 60 s at 0.6, 1 and 1.9 times a thrust (`independent_boat.py`, which imports nothing of the project), gusts
[deg of rudder, rms, at 1] that nobody recorded; gyro 0.2 deg/s, compass 0.3 deg, the log 1 %. --blind: the helm steers
as in a calm, and rudder and gusts have nothing to do with each other.
"""

from __future__ import annotations

import argparse

import numpy as np
from independent_boat import Sea, ThrustBoat, thrust_zigzag

from autopilot.identification.drive_effect import fit_drive
from autopilot.identification.runs import run_from_columns
from autopilot.models.drives import DRIVES

BOAT, SHARES, HALF = ThrustBoat(), (0.6, 1.0, 1.9), 0.5
OUTBOARD = DRIVES["outboard"]
"""Its thrust is turned."""


def off_by(seed: int, gust_deg: float, answers: bool = True) -> dict[str, tuple[float, float]]:
    """Return of each number that was found its error, in standard errors and in % of the truth."""
    sea = Sea("", gust_deg=gust_deg, gyro_deg_s=0.2, speed_share=0.01)
    runs = [
        run_from_columns(f"{share}", thrust_zigzag(BOAT, share, sea, [seed, number], answers=answers))._replace(
            throttle=HALF * share
        )
        for number, share in enumerate(SHARES)
    ]
    found = fit_drive(runs, OUTBOARD.usual, OUTBOARD.needs)
    model, law, errors, speed = found.model, found.law, found.errors, found.model.reference_speed
    beta, a = BOAT.beta * (law.throttle / HALF) ** BOAT.q, BOAT.a + BOAT.c * (speed - 1.0)
    b = 1.0 / model.time_constant
    rows = {
        "K": (model.gain, beta / a, errors["gain"]),
        "T": (model.time_constant, 1.0 / a, errors["time_constant"]),
        "K/T": (model.gain * b, beta, errors["strength"]),
        "n1/T": (b, a, errors["damping"]),
        "n3/T": (model.n3 * b, BOAT.d, errors["cubic"]),
        "q": (law.throttle_exponent, BOAT.q, errors["exponent"]),
        "w": (law.damping_share, BOAT.c * speed / a, errors["damping_share"]),
    }
    return {
        name: ((value - truth) / error, 100.0 * (value / truth - 1.0)) for name, (value, truth, error) in rows.items()
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--gust", type=float, default=1.0)
    parser.add_argument("--blind", action="store_true")
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    rows = [off_by(seed, given.gust, not given.blind) for seed in seeds]
    print("| | held in % | mean and rms of error over standard error | mean and rms error % |\n|---|---|---|---|")
    for name in rows[0]:
        z, size = np.array([row[name] for row in rows]).T
        held, rms = 100.0 * float(np.mean(np.abs(z) < 1.96)), np.sqrt(np.mean(np.square([z, size]), axis=1))
        leans = f"{np.mean(z):+.2f}, {rms[0]:.2f} | {np.mean(size):+.1f}, {rms[1]:.1f}"
        print(f"| {name} | {held:.0f} of {z.size} | {leans} |")


if __name__ == "__main__":
    main()
