"""From a standstill to one and a half times the trial's speed: turns, wind, and a rudder that waits."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass

import boats
import pytest
from alarm_texts import words_of
from boats import vessel_of
from plant import Plant, sail

from autopilot.angles import wrap
from autopilot.models.norrbin import at_speed
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import AlarmEvent, HeadingSample, Mode, Order, OrderKind, Sample, SpeedSample
from autopilot.vessel.schema import Vessel

COURSE = Order(OrderKind.HEADING, 0.0, serial=1)


@dataclass
class Sailing(Plant):
    """A plant with a log that shows `speed` [m/s]."""

    speed: float = 0.0
    over_ground: bool = False

    def sense(self) -> list[Sample]:
        return [*super().sense(), SpeedSample(self.time, self.speed, self.over_ground)]


NO_STEERAGE = AlarmEvent("low_speed")


LANXIN, LAUNCH = vessel_of(boats.BOATS["lanxin"]), vessel_of(boats.LAUNCH)


@pytest.mark.parametrize("vessel", [LANXIN, LAUNCH])
@pytest.mark.parametrize("ratio", [0.2, 0.35, 0.6, 1.0, 1.5])
def test_turn_and_wind_at_every_speed(vessel: Vessel, ratio: float) -> None:
    speed = ratio * vessel.model.reference_speed_m_s
    model = at_speed(model_of(vessel), speed)
    wind_from = 60.0 + 12.0 * model.time_constant
    box = Sailing(
        model,
        gear_of(vessel),
        speed=speed,
        disturbance=lambda t: math.radians(4.0) if t > wind_from else 0.0,
    )
    goal = math.radians(60.0)
    seconds = 2.0 * wind_from + 60.0
    # a slow boat needs no quick ticks
    step = 0.05 if vessel is LANXIN else 0.1
    ticks = sail(build_pilot(vessel), box, lambda t: COURSE._replace(heading=0.0 if t < 5.0 else goal), seconds, step)
    errors = [(tick.now, wrap(tick.state.heading - goal)) for tick in ticks if tick.now > 5.0]
    assert math.degrees(max(error for now, error in errors if now < wind_from)) < 1.0
    assert abs(math.degrees(next(error for now, error in errors if now > wind_from - 1.0))) < 0.3
    late = [error for _, error in errors[-400:]]
    assert abs(math.degrees(sum(late) / len(late))) < 0.1
    assert max(abs(tick.command.angle) for tick in ticks[-400:]) < math.radians(8.0), "no hunting"


@pytest.mark.parametrize("speed", [0.0, 0.3, -2.0])
def test_without_steerage_the_rudder_waits_amidships_and_the_bias_stays(speed: float) -> None:
    """A boat that swings 20 deg off on its mooring and stays there; or astern, where the rudder works backwards."""
    pilot = build_pilot(LANXIN)
    for i in range(6000):
        now = 0.05 * i
        under_way = now < 60.0
        samples: tuple[Sample, ...] = (
            HeadingSample(now, math.radians(min(max(now - 75.0, 0.0), 20.0))),
            SpeedSample(now, 4.63 if under_way else speed),
        )
        tick = pilot.step(now, samples, COURSE)
        if under_way:
            learnt = tick.state.bias
    assert tick.mode is Mode.ENGAGED
    assert tick.command == tick.command._replace(angle=0.0, engaged=True)
    # it has stood for minutes, and nobody has acknowledged it
    assert tick.alarms == (NO_STEERAGE._replace(is_escalated=True),)
    assert abs(tick.state.bias - learnt) < math.radians(0.3)


def test_under_way_again_the_preset_course_is_taken_up_without_a_jump() -> None:
    box = Sailing(model_of(LANXIN), gear_of(LANXIN), speed=0.1)
    pilot, ticks = build_pilot(LANXIN), []
    box.heading = math.radians(-50.0)
    ticks += sail(pilot, box, COURSE, 30.0, 0.05)
    assert all(tick.command.angle == 0.0 for tick in ticks[20:])
    assert math.degrees(box.heading) == pytest.approx(-50.0, abs=0.1)
    box.speed = 4.63
    ticks += sail(pilot, box, COURSE, 40.0, 0.05)
    assert words_of(ticks[-1]) == ()
    assert abs(math.degrees(ticks[-1].state.heading)) < 0.2
    assert max(math.degrees(tick.state.heading) for tick in ticks) < 1.0, "no overshoot"
    steps = [abs(b.command.angle - a.command.angle) for a, b in itertools.pairwise(ticks[1:])]
    assert max(steps) <= math.radians(20.0) * 0.05 + 1e-9


def test_a_slow_speed_over_the_ground_is_no_standstill_unless_the_file_says_so() -> None:
    """Against a current a boat with a satellite receiver alone makes good nothing and steers all the same."""
    box = Sailing(model_of(LANXIN), gear_of(LANXIN), speed=0.1, over_ground=True)
    box.heading = math.radians(-10.0)
    ticks = sail(build_pilot(LANXIN), box, COURSE, 30.0, 0.05)
    assert words_of(ticks[-1]) == ()
    assert max(abs(tick.command.angle) for tick in ticks) > math.radians(1.0)
    said = dataclasses.replace(LANXIN, control=dataclasses.replace(LANXIN.control, steerage_m_s=0.5))
    box = Sailing(model_of(LANXIN), gear_of(LANXIN), speed=0.1, over_ground=True)
    box.heading = math.radians(-10.0)
    ticks = sail(build_pilot(said), box, COURSE, 10.0, 0.05)
    assert ticks[-1].alarms == (NO_STEERAGE,)
    assert ticks[-1].command.angle == 0.0
