"""The schedule of the roll law: what it foresees is what happens, and it stays off where roll would grow."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autopilot.control.rudder_roll import (
    PAPER_ROLL,
    RollSchedule,
    ScheduleParts,
    ScheduleSettings,
    begin_schedule,
    blended_rudder,
    linear_response,
    linear_step_of,
    roll_law,
    roll_reduction,
    roll_rudder,
    schedule_step,
)
from autopilot.control.sliding_heading import SwayYawGains
from autopilot.control.sliding_roll import quiet_at
from autopilot.models.naval_vessel import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED, Motion, linear_motion
from autopilot.models.steering_gear import SteeringGear, gear_step

SHIP = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
DT = 0.1
STEP = linear_step_of(SHIP, DT)
GEAR = SteeringGear(math.radians(40.0), math.radians(20.0), 0.1)
LAW = roll_law(SHIP, PAPER_ROLL)
REST = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
SETTINGS = ScheduleSettings()
QUIET = quiet_at(SHIP, SwayYawGains(0.05, 5.5, 0.11, 1.62))
PARTS = ScheduleParts(SETTINGS, QUIET, LAW, GEAR, STEP)


def sailed(frequency: float, seconds: float, steers: bool, moment: float = 0.01) -> tuple[RollSchedule, list[float]]:
    """A linear ship in a swell of one frequency [rad/s] that heels it; the schedule's weight decides who steers."""
    state, schedule, rudder, roll = REST, begin_schedule(), 0.0, []
    for index in range(round(seconds / DT)):
        schedule = schedule_step(PARTS, schedule, state, 0.0, rudder, DT)
        weight = schedule.weight if steers else 0.0
        rudder = gear_step(GEAR, rudder, blended_rudder(weight, 0.0, roll_rudder(LAW, state, 0.0)), DT)
        state = linear_response(STEP, state, rudder)
        state = state._replace(p=state.p + DT * moment * math.sin(frequency * index * DT))
        roll.append(state.phi)
    return schedule, roll


def test_near_the_natural_frequency_it_switches_on_and_foresaw_how_much_it_helps() -> None:
    free, without = sailed(1.1, 450.0, steers=False)
    used, with_law = sailed(1.1, 450.0, steers=True)
    assert used.weight == 1.0
    last = slice(-2000, None)
    reduction = 1.0 - np.std(with_law[last]) / np.std(without[last])
    assert reduction > 0.3
    # both knew it, the one that never turned it on and the one that did
    assert roll_reduction(free) == pytest.approx(reduction, abs=0.02)
    assert roll_reduction(used) == pytest.approx(reduction, abs=0.02)


@pytest.mark.parametrize("frequency", [0.25, 0.45])
def test_at_the_frequencies_of_stern_quartering_seas_it_stays_off(frequency: float) -> None:
    used, _ = sailed(frequency, 450.0, steers=True)
    assert used.weight == 0.0
    assert roll_reduction(used) < SETTINGS.none


def test_it_switches_off_when_the_sea_comes_round() -> None:
    """Six minutes of roll near its natural frequency, then of a swell near the zero: the weight goes to 1 and back."""
    state, schedule, rudder, weights = REST, begin_schedule(), 0.0, []
    for index in range(8000):
        schedule = schedule_step(PARTS, schedule, state, 0.0, rudder, DT)
        demand = blended_rudder(schedule.weight, 0.0, roll_rudder(LAW, state, 0.0))
        rudder = gear_step(GEAR, rudder, demand, DT)
        frequency = 1.1 if index < 3500 else 0.42
        state = linear_response(STEP, state, rudder)
        state = state._replace(p=state.p + DT * 0.01 * math.sin(frequency * index * DT))
        weights.append(schedule.weight)
    assert weights[3499] == 1.0
    assert weights[-1] == 0.0
    assert np.max(np.abs(np.diff(weights))) <= SETTINGS.slew * DT + 1e-12


def test_nothing_is_decided_before_there_is_evidence() -> None:
    schedule, _ = sailed(1.1, SETTINGS.wait - 1.0, steers=True)
    assert schedule.weight == 0.0


def test_flat_water_asks_for_no_roll_law() -> None:
    schedule, _ = sailed(1.1, 200.0, steers=True, moment=0.0)
    assert schedule.weight == 0.0
    assert roll_reduction(schedule) == 0.0


def test_the_weight_blends() -> None:
    assert blended_rudder(0.0, 0.1, 0.5) == 0.1
    assert blended_rudder(1.0, 0.1, 0.5) == 0.5
    assert blended_rudder(0.25, 0.1, 0.5) == pytest.approx(0.2)
