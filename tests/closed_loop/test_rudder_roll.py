"""The roll law on the nonlinear ship in a seaway, under its schedule: it helps in bow seas, is off in stern seas."""

from __future__ import annotations

import math

import numpy as np

from autopilot.control.rudder_roll import (
    PAPER_ROLL,
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
from autopilot.control.sliding_heading import SwayYawGains, sway_yaw_law, sway_yaw_rudder
from autopilot.models.naval_vessel import (
    NAVAL_HULL,
    NAVAL_RUDDERS,
    SERVICE_SPEED,
    Load,
    Motion,
    inverse_mass,
    linear_motion,
    motion_step,
    rudder_load,
)
from autopilot.models.steering_gear import SteeringGear, gear_step
from autopilot.models.strip_forces import NAVAL_STRIPS, Sea, sea_forces

DT, SECONDS, SETTLED = 0.1, 360.0, 1500
MODEL = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
STEERING = [0, 2, 4]
GEAR = SteeringGear(math.radians(40.0), math.radians(20.0), 0.1)
PARTS = ScheduleParts(
    ScheduleSettings(),
    sway_yaw_law(MODEL.A[np.ix_(STEERING, STEERING)], MODEL.b[STEERING], SwayYawGains(0.05, 5.5, 0.11, 1.62)),
    roll_law(MODEL, RollGains(0.02, 0.92, 3.7, 1.85, 0.039, 1.58)),
    GEAR,
    linear_step_of(MODEL, DT),
)


def sailed(angle_deg: float, share: float, parts: ScheduleParts = PARTS) -> tuple[np.ndarray, float]:
    """Roll and heading [rad] over the settled part, and the weight at the end; share below 0: by the schedule."""
    phase = np.random.default_rng(7).uniform(0.0, 2.0 * math.pi, 60)
    time = DT * np.arange(round(SECONDS / DT))
    sea = Sea(3.0, 7.0, math.radians(angle_deg))
    load = sea_forces(NAVAL_STRIPS, sea, SERVICE_SPEED, np.linspace(0.35, 2.2, 60), phase, time).load
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
