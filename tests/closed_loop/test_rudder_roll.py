"""The roll law on the nonlinear ship in a seaway, under its schedule: it helps in bow seas, is off in stern seas."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from naval_vessel import (
    NAVAL_STRIPS,
    Sea,
    SeaForces,
    calm_resistance,
    extra_resistance,
    inverse_mass,
    linear_motion,
    motion_step,
    sea_forces,
    true_speed_ratio,
)

from autopilot.angles import wrap
from autopilot.control.rudder_roll import (
    PAPER_ROLL,
    Motion,
    RollGains,
    ScheduleParts,
    ScheduleSettings,
    begin_schedule,
    blended_rudder,
    linear_step_of,
    roll_law,
    roll_rudder,
    schedule_step,
)
from autopilot.control.sliding_heading import SwayYawGains, sway_yaw_rudder
from autopilot.control.sliding_roll import RollMemory, quiet_at
from autopilot.models.steering_gear import SteeringGear, gear_step
from autopilot.runtime.build import build_pilot
from autopilot.signals import HeadingSample, Order, OrderKind, RollSample, RudderSample
from autopilot.vessel.file import load_vessel
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED, Load, drag_coefficient, rudder_load

DT, SECONDS, SETTLED = 0.1, 360.0, 1500
PILOTED, PILOT_SETTLED = 2500, 1200
"""Steps of the runs with the whole pilot, and how many of them are left out."""
MODEL = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
GEAR = SteeringGear(math.radians(40.0), math.radians(20.0), 0.1)
PARTS = ScheduleParts(
    ScheduleSettings(),
    quiet_at(MODEL, SwayYawGains(0.05, 5.5, 0.11, 1.62)),
    roll_law(MODEL, RollGains(0.02, 0.92, 3.7, 1.85, 0.039, 1.58)),
    GEAR,
    linear_step_of(MODEL, DT),
)


def at_sea(angle_deg: float) -> SeaForces:
    phase = np.random.default_rng(7).uniform(0.0, 2.0 * math.pi, 60)
    time = DT * np.arange(round(SECONDS / DT))
    sea = Sea(3.0, 7.0, math.radians(angle_deg))
    return sea_forces(NAVAL_STRIPS, sea, SERVICE_SPEED, np.linspace(0.35, 2.2, 60), phase, time)


def sailed(angle_deg: float, share: float, parts: ScheduleParts = PARTS) -> tuple[np.ndarray, float]:
    """Roll and heading [rad] over the settled part, and the weight at the end; share below 0: by the schedule."""
    load = at_sea(angle_deg).load
    state, schedule, rudder, weight = Motion(0.0, 0.0, 0.0, 0.0, 0.0), begin_schedule(), 0.0, share
    inverse, motion = inverse_mass(NAVAL_HULL), []
    for push in load.tolist():
        if share < 0.0:
            schedule = schedule_step(parts, schedule, state, 0.0, rudder, DT)
            weight = schedule.weight
        quiet = sway_yaw_rudder(parts.quiet, state.v, state.r, state.psi)
        rudder = gear_step(GEAR, rudder, blended_rudder(weight, quiet, roll_rudder(parts.roll, state, 0.0)), DT)
        own = rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, rudder)
        outside = Load(own.Y + push[0], own.K + push[1], own.N + push[2])
        state = motion_step(NAVAL_HULL, inverse, SERVICE_SPEED, state, outside, DT)
        motion.append((state.phi, state.psi))
    return np.array(motion[SETTLED:]), weight


def test_bow_seas_roll_falls_by_a_third_and_the_course_is_held() -> None:
    quiet, _ = sailed(135.0, 0.0)
    scheduled, weight = sailed(135.0, -1.0)
    assert weight == 1.0
    assert scheduled[:, 0].std() < 0.67 * quiet[:, 0].std()
    assert math.degrees(np.sqrt(np.mean(scheduled[:, 1] ** 2))) < 1.5


def test_stern_quartering_seas_the_schedule_never_lets_it_amplify() -> None:
    """The paper's roll law: left on, it rolls the ship more than the quiet autopilot does."""
    parts = PARTS._replace(roll=roll_law(MODEL, PAPER_ROLL))
    quiet, _ = sailed(45.0, 0.0, parts)
    always, _ = sailed(45.0, 1.0, parts)
    scheduled, weight = sailed(45.0, -1.0, parts)
    assert always[:, 0].std() > 1.1 * quiet[:, 0].std()
    assert weight == 0.0
    assert scheduled[:, 0].std() <= 1.001 * quiet[:, 0].std()


@functools.cache
def piloted(angle_deg: float, law: str | None, hears_roll: bool = True) -> tuple[float, float, float]:
    """Under the whole pilot, law None: a rudder amidships. Roll and heading [deg rms], and speed as a share of that in
    calm water at the same power."""
    water, pilot = at_sea(angle_deg), build_pilot(load_vessel("naval_vessel"), law or "sliding")
    random, noise = np.random.default_rng(8), np.radians((0.3, 0.2, 0.3, 0.2))
    state, rudder, inverse, rows = Motion(0.0, 0.0, 0.0, 0.0, 0.0), 0.0, inverse_mass(NAVAL_HULL), []
    for index, push in enumerate(water.load[:PILOTED].tolist()):
        now, n = DT * index, (noise * random.standard_normal(4)).tolist()
        samples: tuple[HeadingSample | RollSample, ...]
        samples = (HeadingSample(now, wrap(state.psi + n[0]), state.r + n[1]),)
        if hears_roll:
            samples += (RollSample(now, state.phi + n[2], state.p + n[3]),)
        if law is not None:
            command = pilot.step(now, samples, Order(OrderKind.HEADING, 0.0, serial=1)).command
            rudder = gear_step(GEAR, rudder, command.angle, DT)
        own = rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, rudder)
        outside = Load(own.Y + push[0], own.K + push[1], own.N + push[2])
        state = motion_step(NAVAL_HULL, inverse, SERVICE_SPEED, state, outside, DT)
        rows.append((*state, drag_coefficient(NAVAL_RUDDERS, rudder)))
    motion = np.array(rows[PILOT_SETTLED:])
    sea = Sea(3.0, 7.0, math.radians(angle_deg))
    extra = extra_resistance(sea, SERVICE_SPEED, motion[:, :3], motion[:, 5], water.drift[PILOT_SETTLED:PILOTED]).total
    roll, heading = np.degrees(motion[:, 3].std()), np.degrees(np.sqrt(np.mean(motion[:, 4] ** 2)))
    return float(roll), float(heading), true_speed_ratio(extra / calm_resistance(SERVICE_SPEED))


def test_the_pilot_rolls_a_third_less_in_bow_seas_and_keeps_course_and_speed() -> None:
    """With noise on compass, gyro and roll, and without the sway speed."""
    (fixed, _, way), (heading_law, _, _) = piloted(135.0, None), piloted(135.0, "sliding")
    roll, heading, speed = piloted(135.0, "sliding_roll")
    assert roll < 0.67 * min(fixed, heading_law)
    assert heading < 1.5
    assert 1.0 - speed / way < 0.01


def test_the_pilot_does_not_roll_more_in_stern_quartering_seas() -> None:
    fixed, _, _ = piloted(45.0, None)
    quiet, _, _ = piloted(45.0, "sliding_roll", hears_roll=False)
    roll, _, _ = piloted(45.0, "sliding_roll")
    assert roll <= 1.01 * min(fixed, quiet)


LONG, SEEN = 9_000, 6_000
"""Steps of the runs with a slow rudder, and after how many the schedule has had its time."""
SLOW = GEAR._replace(rate_max=math.radians(5.0))


@functools.cache
def long_sea() -> SeaForces:
    phase = np.random.default_rng(5).uniform(0.0, 2.0 * math.pi, 240)
    sea, time = Sea(4.0, 7.0, math.radians(135.0)), DT * np.arange(LONG)
    return sea_forces(NAVAL_STRIPS, sea, SERVICE_SPEED, np.linspace(0.35, 2.2, 240), phase, time)


@functools.cache
def rolled(gear: SteeringGear, hears_roll: bool, has_sensor: bool) -> tuple[float, float]:
    """Roll [deg rms] once the schedule has had its time, the file's rate being 20 deg/s, and the weight at the end."""
    pilot, random = build_pilot(load_vessel("naval_vessel"), "sliding_roll"), np.random.default_rng(8)
    state, rudder, inverse, roll = Motion(0.0, 0.0, 0.0, 0.0, 0.0), 0.0, inverse_mass(NAVAL_HULL), []
    for index, push in enumerate(long_sea().load.tolist()):
        now, n = DT * index, np.radians((0.3, 0.2, 0.3, 0.2, 0.2) * random.standard_normal(5)).tolist()
        samples: tuple[HeadingSample | RollSample | RudderSample, ...]
        samples = (HeadingSample(now, wrap(state.psi + n[0]), state.r + n[1]),)
        if hears_roll:
            samples += (RollSample(now, state.phi + n[2], state.p + n[3]),)
        if has_sensor:
            samples += (RudderSample(now, rudder + n[4]),)
        command = pilot.step(now, samples, Order(OrderKind.HEADING, 0.0, serial=1)).command
        rudder = gear_step(gear, rudder, command.angle, DT)
        own = rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, rudder)
        outside = Load(own.Y + push[0], own.K + push[1], own.N + push[2])
        state = motion_step(NAVAL_HULL, inverse, SERVICE_SPEED, state, outside, DT)
        roll.append(state.phi)
    assert isinstance(pilot.state.control.law, RollMemory)
    return float(np.degrees(np.std(roll[SEEN:]))), pilot.state.control.law.schedule.weight


@pytest.mark.parametrize("has_sensor", [True, False], ids=["rudder sensor", "no rudder sensor"])
def test_a_rudder_slower_than_its_file_never_rolls_the_ship_more(has_sensor: bool) -> None:
    """5 deg/s where the file says 20: the law would roll the ship up to a tenth more than no damping at all."""
    quiet, _ = rolled(SLOW, hears_roll=False, has_sensor=False)
    roll, weight = rolled(SLOW, hears_roll=True, has_sensor=has_sensor)
    assert roll <= 1.02 * quiet
    assert weight == 0.0


@pytest.mark.parametrize("has_sensor", [True, False], ids=["rudder sensor", "no rudder sensor"])
def test_a_rudder_as_its_file_says_keeps_its_damping_in_the_long_run(has_sensor: bool) -> None:
    quiet, _ = rolled(GEAR, hears_roll=False, has_sensor=False)
    roll, weight = rolled(GEAR, hears_roll=True, has_sensor=has_sensor)
    assert roll < 0.70 * quiet
    assert weight == 1.0
