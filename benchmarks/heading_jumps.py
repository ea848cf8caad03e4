"""A compass that jumps beside a rate gyro: false alarms of healthy instruments, and which jumps are found.

    python benchmarks/heading_jumps.py --hours 0.5 --seed 20261128

Boats of the steering studies and of the tests are sailed by the pilot in four seas, with turns. Their true headings and
rates are then read by many kinds of compasses and gyros, and the compass watch is asked alone: it changes nothing of
how the boat is steered as long as it says nothing. Each jump comes at a random moment of each run, turns included.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import endurance_alarms as alarms
import numpy as np
import numpy.typing as npt
from study_boats import SEAS, StudyBoat, StudySea

from autopilot.angles import wrap
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, RateSample
from autopilot.supervision import heading_and_rate
from sitl.boat import Boat, BoatState, Plant
from sitl.scenario import IttcSection, Scenario, WavesSection, WindSection
from sitl.sea import Sea

ROUGH = {**SEAS, "state 6": StudySea(5.0, 12.4, 16.0, 2.5)}
HZ, COURSE_S = 20, 150.0
JUMPS_DEG = (3, 5, 6, 7, 8, 10, 12, 15, 20, 24)
JUMP, APART = math.radians(25.0), math.radians(15.0)
SEEN_S, KNOWN_S = 10.0, 50.0

Floats = npt.NDArray[np.float64]


class Instruments(NamedTuple):
    """Compass: rate [Hz], noise [deg], lag and delay [s], share of headings lost, and a deviation that rolls with the
    boat [deg]. Gyro: noise and the amplitude of a bias that drifts [deg/s], and its own rate [Hz], nan: the compass's,
    0: there is none.
    """

    hz: float = 10.0
    noise: float = 0.3
    rate_noise: float = 0.2
    bias: float = 0.3
    lag: float = 0.0
    delay: float = 0.0
    lost: float = 0.0
    deviation: float = 0.0
    rate_hz: float = math.nan


INSTRUMENTS = {
    "10 Hz, 0.3 deg": Instruments(),
    "10 Hz, 1 deg": Instruments(noise=1.0, rate_noise=0.5),
    "20 Hz, 0.1 deg": Instruments(20.0, 0.1, 0.1, 0.1),
    "1 Hz, 0.5 deg": Instruments(1.0, 0.5),
    "1 Hz, 1 deg, lag 1 s": Instruments(1.0, 1.0, 0.3, lag=1.0),
    "5 Hz, lag 1 s": Instruments(5.0, lag=1.0),
    "10 Hz, lag 2 s": Instruments(lag=2.0),
    "10 Hz, 0.5 s late": Instruments(delay=0.5),
    "10 Hz, gyro 2.5 Hz": Instruments(noise=0.5, rate_noise=0.3, rate_hz=2.5),
    "10 Hz, gyro 1 Hz": Instruments(noise=0.5, rate_noise=0.3, rate_hz=1.0),
    "10 Hz, 20 % lost": Instruments(noise=0.5, rate_noise=0.3, lag=0.3, lost=0.2),
    "2 Hz, 50 % lost": Instruments(2.0, 0.5, 0.3, lag=0.5, lost=0.5),
    "10 Hz, deviation 5 deg in roll": Instruments(noise=0.5, rate_noise=0.3, lag=0.5, deviation=5.0),
    "5 Hz, gyro 1 deg/s off": Instruments(5.0, 0.5, 1.0, 1.0, 0.5),
    "10 Hz, no gyro": Instruments(noise=0.5, rate_hz=0.0),
    "10 Hz, 2 deg, no gyro": Instruments(noise=2.0, rate_hz=0.0),
    "5 Hz, lag 1 s, no gyro": Instruments(5.0, lag=1.0, rate_hz=0.0),
}


def sailed(boat: StudyBoat, sea: StudySea, random: np.random.Generator, seconds: float) -> Floats:
    """Return rows of time [s], true heading [rad] and rate [rad/s], HZ a second."""
    side = float(random.uniform(0.0, 360.0))
    waves = WavesSection(ittc=IttcSection(sea.height, sea.period, side) if sea.height > 0.0 else None)
    scenario = Scenario(1, "jumps", waves=waves, wind=WindSection(sea.wind, side, sea.gust))
    dt, speed = 1.0 / HZ, boat.vessel.model.reference_speed_m_s
    water = Sea(scenario, boat.hull, np.random.SeedSequence(int(random.integers(2**32))), dt)
    vessel = Boat(Plant(model_of(boat.vessel), gear_of(boat.vessel), boat.hull), BoatState(speed=speed))
    pilot, order, rows = build_pilot(boat.vessel), Order(OrderKind.HEADING, 0.0, serial=1), []
    for index in range(round(seconds * alarms.COMPASS_HZ)):
        now = index / alarms.COMPASS_HZ
        if index and index % round(COURSE_S * alarms.COMPASS_HZ) == 0:
            turn = math.radians(float(random.choice(alarms.TURNS_DEG)) * random.choice((-1.0, 1.0)))
            order = order._replace(heading=wrap(order.heading + turn))
        tick = pilot.step(now, alarms.measured(boat, vessel.state, now, random, has_sensor=False), order)
        if tick.mode not in (Mode.ENGAGED, Mode.STANDBY):
            order = order._replace(serial=order.serial + 1)
        angle = tick.command.angle if tick.command.engaged else 0.0
        for part in range(HZ // alarms.COMPASS_HZ):
            rows.append((now + part * dt, vessel.state.heading, vessel.state.rate))
            vessel.step(now + part * dt, angle, speed, water.step(now + part * dt, vessel.state), dt)
    return np.array(rows)


def read(rows: Floats, kind: Instruments, random: np.random.Generator) -> Iterator[HeadingSample | RateSample]:
    """Yield what instruments say of a run."""
    time, heading = rows[:, 0], np.unwrap(rows[:, 1])
    if kind.lag > 0.0:
        seen, share = float(heading[0]), -math.expm1(-1.0 / (HZ * kind.lag))
        heading = np.array([seen := seen + share * (each - seen) for each in heading])
    late = round(kind.delay * HZ)
    heading = np.concatenate((np.full(late, heading[0]), heading[: len(heading) - late]))
    heading = heading + math.radians(kind.deviation) * np.sin(1.1 * time) * np.sin(0.07 * time)
    every = round(HZ / kind.hz)
    noise, lost = random.standard_normal((2, len(time))), random.uniform(size=len(time)) < kind.lost
    drift = kind.bias * np.sin(2.0 * math.pi * time / 900.0 + random.uniform(0.0, 6.0))
    rate = rows[:, 2] + np.radians(kind.rate_noise * noise[0] + drift)
    heading = heading + np.radians(kind.noise * noise[1])
    for index in range(0, len(time), every):
        now, turns, own = float(time[index]), float(rate[index]), math.isnan(kind.rate_hz)
        if kind.rate_hz > 0.0 and index % round(HZ / kind.rate_hz) == 0:
            yield RateSample(now, turns, "gyro")
        if not lost[index]:
            yield HeadingSample(now, wrap(float(heading[index])), turns if own else None, "compass")


def watched(
    samples: Iterator[HeadingSample | RateSample], quickest: float, at: float = math.inf, jump: float = 0.0
) -> tuple[list[float], float]:
    """Return when the alarm came [s], a compass being off by a `jump` [rad] from `at` [s] on, and what is held; the
    boat turns by `quickest` [rad/s] at most."""
    watch, said, was = heading_and_rate.Consistency(), list[float](), False
    for sample in samples:
        if isinstance(sample, HeadingSample) and sample.time >= at:
            sample = sample._replace(heading=wrap(sample.heading + jump))
        watch = heading_and_rate.consistency_step(watch, sample, APART, quickest, JUMP)
        if watch.held.offset:
            watch = watch._replace(held=heading_and_rate.followed(watch.held, sample.time, 1.0 / HZ, True)[0])
        is_said = bool(heading_and_rate.held_events(watch.held, sample.time))
        said += [sample.time] if is_said and not was else []
        was = is_said
    return said, watch.held.offset


def main() -> None:
    """Sail, and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=0.5, help="of each boat in each sea")
    parser.add_argument("--seed", type=int, default=20261128)
    asked = parser.parse_args()
    runs = [
        (
            build_pilot(boat.vessel)._config.steering.estimator.noises.rate_most,
            sailed(boat, sea, np.random.default_rng((asked.seed, place, number)), 3600.0 * asked.hours),
        )
        for place, boat in enumerate(alarms.plants().values())
        for number, sea in enumerate(ROUGH.values())
    ]
    hours = asked.hours * len(runs)
    print(f"{hours:g} h of {len(runs)} runs for each kind of instruments.\n")
    print("| instruments | false alarms | an hour |", *(f"{jump} deg |" for jump in JUMPS_DEG))
    print("|---|---|---|", "---|" * len(JUMPS_DEG), sep="")
    for place, (name, kind) in enumerate(INSTRUMENTS.items()):
        dice = np.random.default_rng((asked.seed, 7, place))
        false = sum(len(watched(read(rows, kind, dice), quickest)[0]) for quickest, rows in runs)
        cells = [of_jump(runs, kind, math.radians(jump), dice) for jump in JUMPS_DEG]
        print(f"| {name} | {false} | {false / hours:.3f} |", *(f"{cell} |" for cell in cells), flush=True)


def of_jump(runs: list[tuple[float, Floats]], kind: Instruments, jump: float, dice: np.random.Generator) -> str:
    """Return the share of jumps that are found, how soon, and by how much what is held is off then, at the median."""
    found = Counter[bool]()
    soon, off = list[float](), list[float]()
    for quickest, rows in runs * 2:
        at = float(dice.uniform(KNOWN_S, rows[-1, 0] - SEEN_S))
        part = rows[(rows[:, 0] >= at - KNOWN_S) & (rows[:, 0] < at + SEEN_S)]
        signed = math.copysign(jump, float(dice.uniform(-1.0, 1.0)))
        said, held = watched(read(part, kind, dice), quickest, at, signed)
        said = [time - at for time in said if time >= at]
        found[bool(said)] += 1
        if said:
            soon.append(said[0])
            off.append(abs(math.degrees(held - signed)))
    if not soon:
        return "0 %"
    return f"{100.0 * found[True] / found.total():.0f} %, {np.median(soon):.1f} s, {np.median(off):.1f}"


if __name__ == "__main__":
    main()
