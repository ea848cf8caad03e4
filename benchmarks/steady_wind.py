"""Steady wind with gusts, then a minute of more wind than the rudder can hold: mean error and the way back; a table.

    python benchmarks/steady_wind.py [--seeds 40] [--rudder-rate 2] [--pilot]
    python benchmarks/steady_wind.py --pushes

Boats and gains of `turns.py`, the course-unstable one apart: more wind than its rudder holds turns it round and round.
10 Hz compass with 0.3 deg of noise, without a gyro and with one of 0.2 deg/s. The wind is worth 5 deg of rudder, its
gusts 1 deg rms with a memory of 10 s; the mean error is that of the true heading over the last two thirds of this part.
Then it is worth 1.03 times the whole rudder for 60 s, and then nothing. Past: how far the boat leads past its course on
the way back; second: how far it then comes back to the side that the wind had blown it to. Medians over the seeds,
and the worst of them: the largest mean error to either side, the largest second. By the pilot's tick as campaigns have
it, compiled (`norrbin[fast]`); with --pilot by `Pilot.step` itself, one seed being minutes.
--rudder-rate: the rudder moves so many times as fast, the gains being the same.

--pushes: another table, six boats in 216 runs each: calm water, with compass noise of 0.3 deg or none, with a gyro or
none, K right, 30 % less, 40 % more; 10 or 60 s after the start a push of 0.5, 1 or 2 deg more than the whole rudder,
for 40, 60 or 61.5 s. How often a boat then goes past its course a second time by more than 1 deg, how far, and how far
the first time; and when it is within 1 deg for good, in time constants.
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from turns import BOATS, CONTROL_S, SETTLED, STEPS_A_TICK, Boat, gusts, swiftly, vessel_of

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.models.steering_gear import DelayLine, gear_step
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import HeadingSample, Order, OrderKind
from autopilot.vessel.schema import Vessel

WIND, GUST_DEG = math.radians(5.0), 1.0
BEYOND, SATURATED_S = 1.03, 60.0
COMPASS_NOISE, GYRO_NOISE = math.radians(0.3), math.radians(0.2)
NORTH = Order(OrderKind.HEADING, 0.0, serial=1)
FIRST_SEED = 5

PUSHED_BOATS = {
    **{name: boat for name, boat in BOATS.items() if boat.model.n1 > 0.0},
    "launch": Boat(Norrbin(0.4, 1.5, 2.0, reference_speed=4.0), 30.0, 10.0),
    "middle": Boat(Norrbin(0.2, 5.0, 5.0, reference_speed=3.0), 30.0, 5.0),
    "ferry": Boat(Norrbin(0.15, 8.0, 10.0, reference_speed=5.0), 35.0, 4.0),
}
"""The last three were made up, to lie between the others."""
FACTORS = (1.0, 0.7, 1.4)

Push = Callable[[float], float]
Sailed = Callable[[Vessel, float, Push, float, np.random.Generator, bool], list[float]]


class Held(NamedTuple):
    """mean error in the wind, furthest off in saturation, past and second on the way back: all [deg]."""

    mean: float
    off: float
    past: float
    second: float


def sailed(
    vessel: Vessel, factor: float, push: Push, seconds: float, random: np.random.Generator, has_gyro: bool
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


def sailed_compiled(
    vessel: Vessel, factor: float, push: Push, seconds: float, random: np.random.Generator, has_gyro: bool
) -> list[float]:
    """Return the same by the campaigns' tick, compiled, for the backstepping law."""
    ticks = round(seconds / CONTROL_S)
    noise = random.standard_normal((ticks, 2)) * (COMPASS_NOISE, GYRO_NOISE if has_gyro else math.nan)
    pushed = np.array([push(index * CONTROL_S) for index in range(ticks)])
    return list(swiftly(vessel, factor, np.zeros(ticks), noise, pushed))


def held(
    boat: Boat, factor: float, seed: int, has_gyro: bool, sails: Sailed = sailed, rudder_rate: float = 1.0
) -> Held:
    """Return how the pilot holds a boat: K `factor` times the model's, the rudder `rudder_rate` times as fast."""
    random, vessel = np.random.default_rng(seed), vessel_of(boat)
    vessel = replace(vessel, rudder=replace(vessel.rudder, rate_max_deg_s=rudder_rate * boat.rate_deg_s))
    windy, after = 300.0 + 30.0 * boat.model.time_constant, 120.0 + 15.0 * boat.model.time_constant
    blown, most = gusts(round(windy / CONTROL_S), GUST_DEG, random), BEYOND * math.radians(boat.angle_deg)

    def push(now: float) -> float:
        if now < windy - 0.5 * CONTROL_S:
            return WIND + blown[round(now / CONTROL_S)]
        return most if now < windy + SATURATED_S else 0.0

    headings = np.degrees(sails(vessel, factor, push, windy + SATURATED_S + after, random, has_gyro))
    ends, free = round(windy / CONTROL_S), round((windy + SATURATED_S) / CONTROL_S)
    past, second = swings(headings[free:].tolist())
    return Held(float(np.mean(headings[ends // 3 : ends])), float(np.max(headings[ends:])), past, second)


def swings(errors: Sequence[float]) -> tuple[float, float]:
    """Return how far the errors, positive at first, go below zero, and how far above it they come afterwards."""
    lowest = int(np.argmin(errors))
    return max(-float(errors[lowest]), 0.0), max(float(np.max(errors[lowest:])), 0.0)


class Pushed(NamedTuple):
    """A push: when it begins [s], for how long [s], and how much more it is worth [deg] than the whole rudder."""

    begins: float
    lasts: float
    over_deg: float


def pushed(boat: Boat, factor: float, noise_deg: float, has_gyro: bool, push: Pushed) -> tuple[float, float, float]:
    """Return how far past [deg] the boat goes on the way back, how far a second time, and when [T] it is back."""
    constant, ends = boat.model.time_constant, push.begins + push.lasts
    times = np.arange(round((ends + 200.0 + 40.0 * constant) / CONTROL_S)) * CONTROL_S
    worth = np.where((times >= push.begins) & (times < ends), math.radians(boat.angle_deg + push.over_deg), 0.0)
    deviations = math.radians(noise_deg), 2.0 / 3.0 * math.radians(noise_deg) if has_gyro else math.nan
    noise = np.random.default_rng(FIRST_SEED).standard_normal((len(times), 2)) * deviations
    headings = swiftly(vessel_of(boat), factor, np.zeros(len(times)), noise, worth)[round(ends / CONTROL_S) :]
    outside = np.flatnonzero(np.abs(headings) > SETTLED)
    return *swings(np.degrees(headings).tolist()), float(outside[-1] + 1) * CONTROL_S / constant


def pushes_table() -> None:
    """Push every boat and print."""
    print("boat       runs   second beyond 1   worst   past   worst [deg]   back after   worst [T]")
    pushes = [Pushed(*push) for push in itertools.product((10.0, 60.0), (40.0, 60.0, 61.5), (0.5, 1.0, 2.0))]
    for name, boat in PUSHED_BOATS.items():
        cases = itertools.product(FACTORS, (0.0, 0.3), (False, True), pushes)
        past, second, back = np.array([pushed(boat, *case) for case in cases]).T
        print(
            f"{name:9s}{len(past):6d}{np.count_nonzero(second > 1.0):18d}{np.max(second):8.1f}{np.median(past):7.1f}"
            f"{np.max(past):8.1f}{np.median(back):19.1f}{np.max(back):12.1f}",
            flush=True,
        )


def main() -> None:
    """Sail every boat and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--rudder-rate", type=float, default=1.0)
    parser.add_argument("--pilot", action="store_true", help="by Pilot.step itself, which is slow")
    parser.add_argument("--pushes", action="store_true", help="the other table")
    arguments = parser.parse_args()
    if arguments.pushes:
        pushes_table()
        return
    sails, seeds = sailed if arguments.pilot else sailed_compiled, range(FIRST_SEED, FIRST_SEED + arguments.seeds)
    print("boat     gyro     K    mean error  worst   blown off   past   second  worst  [deg]")
    for (name, boat), has_gyro, factor in itertools.product(BOATS.items(), (False, True), FACTORS):
        if boat.model.n1 < 0.0:
            continue
        found = np.array([held(boat, factor, seed, has_gyro, sails, arguments.rudder_rate) for seed in seeds])
        mean, off, past, second = np.median(found, axis=0)
        print(
            f"{name:9s}{'yes' if has_gyro else 'no':4s}{factor:6.1f}{mean:14.2f}{np.max(np.abs(found[:, 0])):7.2f}"
            f"{off:12.1f}{past:7.1f}{second:9.1f}{np.max(found[:, 3]):7.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
