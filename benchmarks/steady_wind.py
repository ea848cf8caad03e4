"""Steady wind with gusts, then a minute of more wind than the rudder can hold: mean error and the way back; a table.

    python benchmarks/steady_wind.py [--seed 5]

Boats and gains of `turns.py`, the course-unstable one apart: more wind than her rudder holds turns her round and round.
10 Hz compass with 0.3 deg of noise, without a gyro and with one of 0.2 deg/s. The wind is worth 5 deg of rudder, its
gusts 1 deg rms with a memory of 10 s; the mean error is that of the true heading over the last two thirds of this part.
Then it is worth 1.03 times the whole rudder for 60 s, and then nothing. Past: how far the boat leads past her course on
the way back; second: how far she then comes back to the side that the wind had blown her to.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from turns import BOATS, CONTROL_S, STEPS_A_TICK, Boat, vessel_of

from autopilot.angles import wrap
from autopilot.build import build_pilot, gear_of, model_of
from autopilot.models.norrbin import rate_step
from autopilot.models.steering_gear import DelayLine, gear_step
from autopilot.params.vessel import Vessel
from autopilot.signals import HeadingSample, Order, OrderKind

WIND, GUST, GUST_TIME = math.radians(5.0), math.radians(1.0), 10.0
BEYOND, SATURATED_S = 1.03, 60.0
COMPASS_NOISE, GYRO_NOISE = math.radians(0.3), math.radians(0.2)
NORTH = Order(OrderKind.HEADING, 0.0, serial=1)


class Held(NamedTuple):
    """mean error in the wind, furthest off in saturation, past and second on the way back: all [deg]."""

    mean: float
    off: float
    past: float
    second: float


def sailed(
    vessel: Vessel,
    factor: float,
    push: Callable[[float], float],
    seconds: float,
    random: np.random.Generator,
    has_gyro: bool,
) -> list[float]:
    """Return the true heading [rad] tick by tick, K `factor` times the model's; push: rudder [rad] by time [s]."""
    true, gear = model_of(vessel), gear_of(vessel)
    true = true._replace(gain=factor * true.gain)
    pilot, line, h = build_pilot(vessel), DelayLine(gear.delay), CONTROL_S / STEPS_A_TICK
    heading = rate = rudder = 0.0
    headings = []
    for index in range(round(seconds / CONTROL_S)):
        now = index * CONTROL_S
        noise = random.standard_normal(2)
        turning = rate + GYRO_NOISE * noise[1] if has_gyro else None
        seen = HeadingSample(now, wrap(heading + COMPASS_NOISE * noise[0]), turning)
        line.give(now, pilot.step(now, (seen,) if index % 2 == 0 else (), NORTH).command.angle)
        for step in range(STEPS_A_TICK):
            rudder = gear_step(gear, rudder, line.effective(now + step * h), h)
            before, rate = rate, rate_step(true, rate, rudder + push(now), h)
            heading += 0.5 * h * (before + rate)
        headings.append(heading)
    return headings


def gusts(seconds: float, random: np.random.Generator) -> list[float]:
    """Return gusts [rad] tick by tick."""
    share, value, found = math.exp(-CONTROL_S / GUST_TIME), 0.0, []
    for _ in range(round(seconds / CONTROL_S)):
        value = share * value + GUST * math.sqrt(1.0 - share * share) * random.standard_normal()
        found.append(value)
    return found


def held(boat: Boat, factor: float, seed: int, has_gyro: bool) -> Held:
    """Return how the pilot holds a boat whose K is `factor` times the model's."""
    random, vessel = np.random.default_rng(seed), vessel_of(boat)
    windy, after = 300.0 + 30.0 * boat.model.time_constant, 120.0 + 15.0 * boat.model.time_constant
    blown, most = gusts(windy, random), BEYOND * math.radians(boat.angle_deg)

    def push(now: float) -> float:
        if now < windy - 0.5 * CONTROL_S:
            return WIND + blown[round(now / CONTROL_S)]
        return most if now < windy + SATURATED_S else 0.0

    headings = np.degrees(sailed(vessel, factor, push, windy + SATURATED_S + after, random, has_gyro))
    ends, free = round(windy / CONTROL_S), round((windy + SATURATED_S) / CONTROL_S)
    past, second = swings(headings[free:])
    return Held(float(np.mean(headings[ends // 3 : ends])), float(np.max(headings[ends:])), past, second)


def swings(errors: Sequence[float]) -> tuple[float, float]:
    """Return how far the errors, positive at first, go below zero, and how far above it they come afterwards."""
    lowest = int(np.argmin(errors))
    return max(-float(errors[lowest]), 0.0), max(float(np.max(errors[lowest:])), 0.0)


def main() -> None:
    """Sail every boat and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=5)
    seed = parser.parse_args().seed
    print("boat     gyro     K    mean error   blown off   past   second  [deg]")
    for (name, boat), has_gyro, factor in itertools.product(BOATS.items(), (False, True), (1.0, 0.7, 1.4)):
        if boat.model.n1 < 0.0:
            continue
        found = held(boat, factor, seed, has_gyro)
        print(
            f"{name:9s}{'yes' if has_gyro else 'no':4s}{factor:6.1f}"
            f"{found.mean:14.2f}{found.off:12.1f}{found.past:7.1f}{found.second:9.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
