"""Output error weighed by its residuals and by prediction errors, on boats in gusts and without.

    python benchmarks/identification_gusts.py [--seeds 50]

The zigzag of `identification_accuracy.py` for K 0.2 1/s and T 5 s, a linear boat, with white noise of intensity q^2 on
the yaw acceleration besides that of the instruments. Prints rms errors of K and T in % and how often 95 % intervals
hold.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
from identification_accuracy import BOATS, GEAR, HEADING_NOISE, RATE_NOISE, SPACING, SPEED

from autopilot.guidance.manoeuvres import zigzag_side
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.interval import interval_of
from autopilot.identification.output_error import Weighting
from autopilot.identification.runs import Run, run_from_columns
from autopilot.models.norrbin import at_speed, rate_step
from autopilot.models.steering_gear import gear_step

BOAT = BOATS[1]._replace(model=BOATS[1].model._replace(n3=0.0))
FINE = 0.02
WEIGHTINGS: tuple[Weighting, ...] = ("residuals", "prediction-error")


def gusty(q: float, seed: int) -> Run:
    """Return a recording of the zigzag in gusts of `q` [rad/s/sqrt(s)]."""
    random, model = np.random.default_rng(seed), at_speed(BOAT.model, SPEED)
    angle, side, every = math.radians(BOAT.angle_deg), 1, round(SPACING / FINE)
    heading = rate = rudder = 0.0
    rows = []
    for k in range(round(BOAT.seconds / FINE)):
        if k % every == 0:
            seen = heading + HEADING_NOISE * random.normal(), rate + RATE_NOISE * random.normal()
            rows.append((k * FINE, *seen, rudder, SPEED))
        side = zigzag_side(side, 0.0, heading, angle)
        moved = gear_step(GEAR, rudder, side * angle, FINE)
        following = rate_step(model, rate, 0.5 * (rudder + moved), FINE) + q * math.sqrt(FINE) * random.normal()
        heading += 0.5 * FINE * (rate + following)
        rate, rudder = following, moved
    names = ("time_s", "heading_rad", "yaw_rate_rad_s", "rudder_rad", "speed_m_s")
    return run_from_columns("gusty", dict(zip(names, np.array(rows).T, strict=True)))


def errors(weighting: Weighting, q: float, seed: int) -> list[float]:
    """Return errors of K and T as shares of the truth, and whether each lies inside its interval."""
    found = identify([gusty(q, seed)], Question("nomoto", SPEED, weighting=weighting))
    result = []
    for name in ("gain", "time_constant"):
        truth, value = getattr(BOAT.model, name), getattr(found.model, name)
        low, high = interval_of(name, value, found.standard_errors[name] or 0.0)
        result += [value / truth - 1.0, float(low <= truth <= high)]
    return result


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    seeds = parser.parse_args().seeds
    print("| gusts q [deg/s/sqrt(s)] | weighting | rms of K % | rms of T % | cover of K | cover of T |")
    print("|---|---|---|---|---|---|")
    with ProcessPoolExecutor() as pool:
        for q_deg in (0.0, 0.03, 0.1, 0.3):
            for weighting in WEIGHTINGS:
                rows = np.array(list(pool.map(partial(errors, weighting, math.radians(q_deg)), range(seeds))))
                rms, cover = 100.0 * np.sqrt(np.mean(rows[:, ::2] ** 2, axis=0)), 100.0 * np.mean(rows[:, 1::2], axis=0)
                numbers = " | ".join([*(f"{value:.2f}" for value in rms), *(f"{value:.0f} %" for value in cover)])
                print(f"| {q_deg:g} | {weighting} | {numbers} |", flush=True)


if __name__ == "__main__":
    main()
