"""Hours of steering with healthy instruments, from calm to sea state 5: how often an alarm comes without a reason."""

from __future__ import annotations

import math
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from boats import BOATS, vessel_of
from boats import Boat as TestBoat
from study_boats import SEAS, StudyBoat, StudySea
from study_boats import boats as study_boats

from autopilot.angles import shortest_turn, wrap
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, RollSample, RudderSample, Sample, SpeedSample
from autopilot.supervision.tuning import AT_THE_STOP
from sitl.boat import Boat, BoatState, Hull, Plant
from sitl.scenario import IttcSection, Scenario, WavesSection, WindSection
from sitl.sea import Sea

COMPASS_HZ, PLANT_HZ = 10, 20
COURSE_S = 300.0
TURNS_DEG = (10.0, 20.0, 45.0, 90.0, 150.0)
HOUR_S = 3600.0
AGAIN_S = 60.0
"""An engagement that ended is begun anew after this time [s]."""
RUDDER_NOISE = math.radians(0.2)
SPEED_NOISE = 0.05
OFF_COURSE = math.radians(10.0)
AGAINST_S = 5.0
"""It has been overpowered where it turned by OFF_COURSE against its rudder at the stop no longer ago than this [s]."""
ROUND = 2.0 * math.pi
ABILITY = 0.3
"""The least turning ability P = K'/(2 T') of a ship that handles well, Norrbin 1965."""
MOST_FALSE = 1
"""False alarms in 24 hours; fail-safes: none."""


class Hour(NamedTuple):
    """Names of false alarms, and of those that said what was so; endings of the engagement, by what was said."""

    false: Counter[str]
    true: Counter[str]
    ended: Counter[str]


class Truth(NamedTuple):
    """What the boat really does. away [rad]: how far it has turned from the heading ordered, whole turns counted;
    against [rad]: how far against its rudder at the stop; against_time [s]: when that was OFF_COURSE or more."""

    away: float = 0.0
    against: float = 0.0
    against_time: float = -math.inf


@cache
def plants() -> dict[str, StudyBoat]:
    """Return the plants of the tests and of the steering studies."""
    tested = {f"tests' {name}": StudyBoat(vessel_of(boat), hull_of(boat)) for name, boat in BOATS.items()}
    return {**study_boats(), **tested}


def hull_of(boat: TestBoat) -> Hull:
    """Return a hull that turns as this boat of the tests, which has none there: as long as P = ABILITY makes it, by
    K' = K L/U and T' = T U/L the length L = U sqrt(2 P T/K), the default one at least, which it is like by Froude."""
    hull = Hull()
    scale = max(boat.speed * math.sqrt(2.0 * ABILITY * boat.T / boat.K) / hull.length, 1.0)
    lengths = ("length", "beam", "draught", "drift_lever", "roll_lever")
    times = ("speed_time", "sway_time", "roll_period")
    grown = {name: getattr(hull, name) * scale for name in lengths}
    return hull._replace(**grown, **{name: getattr(hull, name) * math.sqrt(scale) for name in times})


def hour_of(boat: StudyBoat, number: int, seed: int, seconds: float = HOUR_S) -> tuple[str, Hour]:
    """Return the name of the sea and what came of the hour `number`: seas in turn, their side and the turns drawn from
    the seed; every second hour with a rudder sensor."""
    random = np.random.default_rng((seed, number))
    name = list(SEAS)[number % len(SEAS)]
    return name, sailed(boat, SEAS[name], random, seconds, has_sensor=number // len(SEAS) % 2 == 1)


def sailed(boat: StudyBoat, sea: StudySea, random: np.random.Generator, seconds: float, *, has_sensor: bool) -> Hour:
    """Return what the monitors and the supervisor made of a run in a sea from a random side."""
    side = float(random.uniform(0.0, 360.0))
    waves = WavesSection(ittc=IttcSection(sea.height, sea.period, side) if sea.height > 0.0 else None)
    scenario = Scenario(1, "alarms", waves=waves, wind=WindSection(sea.wind, side, sea.gust))
    dt, speed = 1.0 / PLANT_HZ, boat.vessel.model.reference_speed_m_s
    water = Sea(scenario, boat.hull, np.random.SeedSequence(int(random.integers(2**32))), dt)
    vessel = Boat(Plant(model_of(boat.vessel), gear_of(boat.vessel), boat.hull), BoatState(speed=speed))
    pilot, hour = build_pilot(boat.vessel), Hour(Counter(), Counter(), Counter())
    order, on, ended = Order(OrderKind.HEADING, 0.0, serial=1), frozenset[str](), -math.inf
    truth, before = Truth(), vessel.state
    for index in range(round(seconds * COMPASS_HZ)):
        now = index / COMPASS_HZ
        if index and index % round(COURSE_S * COMPASS_HZ) == 0:
            turn = math.radians(float(random.choice(TURNS_DEG)) * random.choice((-1.0, 1.0)))
            order, truth = order._replace(heading=wrap(order.heading + turn)), Truth()
        tick = pilot.step(now, measured(boat, vessel.state, now, random, has_sensor), order)
        truth = moved(truth, pilot, before, vessel.state, now, shortest_turn(order.heading, vessel.state.heading))
        before = vessel.state
        found = frozenset(pilot.state.findings)
        for alarm in found - on:
            (hour.true if is_so(alarm, pilot, before, truth, now) else hour.false)[alarm] += 1
        on = found
        if tick.mode not in (Mode.ENGAGED, Mode.STANDBY) and math.isinf(ended):
            hour.ended[ended.name if (ended := pilot.state.supervisor.alarm) is not None else ""] += 1
            ended = now
        if AGAIN_S < now - ended < math.inf:
            order, ended = order._replace(serial=order.serial + 1), -math.inf
        facts = tick.command.angle if tick.command.engaged else 0.0
        for part in range(PLANT_HZ // COMPASS_HZ):
            vessel.step(now + part * dt, facts, speed, water.step(now + part * dt, vessel.state), dt)
    return hour


def measured(
    boat: StudyBoat, state: BoatState, now: float, random: np.random.Generator, has_sensor: bool
) -> tuple[Sample, ...]:
    """Return what healthy instruments say, with the noise that the file has of them."""
    sensors, noise = boat.vessel.sensors, random.standard_normal(5)
    heading = wrap(state.heading + math.radians(sensors.heading_noise_deg) * noise[0])
    rate_noise = math.radians(sensors.rate_noise_deg_s)
    samples: list[Sample] = [HeadingSample(now, heading, state.rate + rate_noise * noise[1], "compass")]
    samples.append(RollSample(now, state.roll, state.roll_rate + rate_noise * noise[2], "compass"))
    if now % 1.0 < 1.0e-6:
        samples.append(SpeedSample(now, state.speed + SPEED_NOISE * noise[3], False, "log"))
    if has_sensor:
        samples.append(RudderSample(now, state.rudder + RUDDER_NOISE * noise[4], False, "sensor"))
    return tuple(samples)


def moved(truth: Truth, pilot: Pilot, before: BoatState, state: BoatState, now: float, off: float) -> Truth:
    """Return the truth after a step from one state to the next, the boat `off` [rad] from the heading ordered."""
    turned = state.heading - before.heading
    away = truth.away + turned if abs(truth.away) > OFF_COURSE else off
    # the same heading with the whole turns that it is away
    away = off + ROUND * round((away - off) / ROUND)
    is_at_stop = abs(state.rudder) >= AT_THE_STOP * pilot.config.limits.angle_max
    against = max(truth.against - math.copysign(turned, turned * state.rudder), 0.0) if is_at_stop else 0.0
    return Truth(away, against, now if against >= OFF_COURSE else truth.against_time)


def is_so(alarm: str, pilot: Pilot, state: BoatState, truth: Truth, now: float) -> bool:
    """Return whether an alarm says what is the case: the boat off heading indeed, or round by a whole turn, the rudder
    at its stop; overpowered is a boat off heading with the true rudder at its stop against it, or one that turned on
    against it."""
    off, config = wrap(truth.away), pilot.config
    if alarm == "off_course":
        return abs(off) > 0.9 * config.alarms.off_course
    if alarm == "circling":
        return abs(truth.away) > 0.9 * ROUND
    is_against = -math.copysign(1.0, off) * state.rudder >= AT_THE_STOP * config.limits.angle_max
    is_overpowered = (is_against and abs(off) > OFF_COURSE) or now - truth.against_time <= AGAINST_S
    return alarm == "rudder_at_stop" or (alarm == "overpowered" and is_overpowered)


def watched(name: str, hours: int, seed: int) -> bool:
    """Print the line of a plant; return whether its alarms and fail-safes are within what is borne."""
    boat, total = plants()[name], Hour(Counter(), Counter(), Counter())
    for number in range(hours):
        sea, hour = hour_of(boat, number, seed)
        for sums, each in zip(total, hour, strict=True):
            sums.update(each)
        if hour.false or hour.ended:
            print(f"  {name}, hour {number}, {sea}: {dict(hour.false)}, ended by {dict(hour.ended)}", file=sys.stderr)
    is_borne = total.false.total() <= MOST_FALSE * max(1.0, hours / 24.0) and not total.ended
    said = "; ".join(f"{count} {alarm}" for alarm, count in sorted((total.false + total.ended).items())) or "none"
    so = "; ".join(f"{count} {alarm}" for alarm, count in sorted(total.true.items())) or "none"
    print(
        f"| {name} | {hours} h | {total.false.total()} | {total.ended.total()} | {said} | {so} |"
        f"{'' if is_borne else ' TOO MANY'}",
        flush=True,
    )
    return is_borne
