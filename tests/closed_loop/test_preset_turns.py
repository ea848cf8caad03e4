"""Turns by a preset rate or radius: what is sailed is what was asked for, as far as the rudder goes."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import boats
import pytest
from boats import vessel_of
from plant import Plant, sail

from autopilot.angles import wrap
from autopilot.cli.main import main
from autopilot.cli.run import turning_as_asked
from autopilot.errors import InputError
from autopilot.models.norrbin import at_speed
from autopilot.runtime.build import build_pilot, gear_of, model_of, pilot_config, track_settings_of
from autopilot.signals import Order, OrderKind, Sample, SpeedSample, Tick
from autopilot.vessel.schema import Sensors, Vessel

DT = 0.05
BEFORE = 10.0
TURN = math.radians(150.0)


SENSORS = Sensors(heading_noise_deg=0.3, rate_noise_deg_s=0.2)
LANXIN = dataclasses.replace(vessel_of(boats.BOATS["lanxin"]), sensors=SENSORS)
LAUNCH = dataclasses.replace(vessel_of(boats.LAUNCH), sensors=SENSORS)


@dataclasses.dataclass
class Sailing(Plant):
    """A plant with a log that shows `speed` [m/s]."""

    speed: float = 0.0

    def sense(self) -> list[Sample]:
        return [*super().sense(), SpeedSample(self.time, self.speed)]


def preset(vessel: Vessel, **turns: float) -> Vessel:
    return dataclasses.replace(vessel, guidance=dataclasses.replace(vessel.guidance, **turns))


def turned(vessel: Vessel, speed: float, seconds: float, gain_factor: float = 1.0, goal: float = TURN) -> list[Tick]:
    """The pilot's ticks of one turn; the boat's K is `gain_factor` times the model's."""
    model = at_speed(model_of(vessel), speed)
    box = Sailing(
        model._replace(gain=gain_factor * model.gain),
        gear_of(vessel),
        heading_noise=math.radians(0.3),
        rate_noise=math.radians(0.2),
        speed=speed,
    )

    def order(now: float) -> Order:
        return Order(OrderKind.HEADING, 0.0 if now < BEFORE else goal, serial=1)

    return sail(build_pilot(vessel), box, order, BEFORE + seconds, DT, 2)


def middle_rate(ticks: list[Tick]) -> float:
    """The mean rate [rad/s] through the middle half of the turn, from heading and time alone."""
    inside = [(tick.now, tick.state.heading) for tick in ticks if 0.25 * TURN < abs(tick.state.heading) < 0.75 * TURN]
    (began, first), (ended, last) = inside[0], inside[-1]
    return wrap(last - first) / (ended - began)


@pytest.mark.parametrize(
    ("vessel", "radius", "share", "gain_factor"),
    [
        (LANXIN, 40.0, 1.0, 1.0),
        (LANXIN, 40.0, 0.5, 1.0),
        (LANXIN, 40.0, 1.0, 0.7),
        (LANXIN, 100.0, 1.4, 1.3),
        (LAUNCH, 60.0, 1.0, 1.0),
        (LAUNCH, 120.0, 0.6, 0.7),
    ],
)
def test_the_radius_sailed_is_the_preset_one(vessel: Vessel, radius: float, share: float, gain_factor: float) -> None:
    speed = share * vessel.model.reference_speed_m_s
    seconds = TURN * radius / speed + 10.0 * vessel.model.T_s / share + 10.0
    ticks = turned(preset(vessel, turn_radius_m=radius), speed, seconds, gain_factor)
    assert speed / middle_rate(ticks) == pytest.approx(radius, rel=0.1)
    assert math.degrees(max(tick.state.heading for tick in ticks) - TURN) < 2.0
    assert math.degrees(abs(ticks[-1].state.heading - TURN)) < 1.5


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_rate_sailed_is_the_preset_one_to_either_side(side: float) -> None:
    vessel = preset(LAUNCH, turn_rate_max_deg_s=2.0)
    rate = middle_rate(turned(vessel, 4.0, 100.0, goal=side * TURN))
    assert math.degrees(rate) == pytest.approx(side * 2.0, rel=0.1)


def test_of_rate_and_radius_the_slower_turn_holds_and_the_rudder_has_the_last_word() -> None:
    both = preset(LAUNCH, turn_rate_max_deg_s=2.0, turn_radius_m=60.0)
    assert math.degrees(middle_rate(turned(both, 4.0, 110.0))) == pytest.approx(2.0, rel=0.1)
    slow = preset(LAUNCH, turn_rate_max_deg_s=9.0, turn_radius_m=200.0)
    assert 4.0 / middle_rate(turned(slow, 4.0, 170.0)) == pytest.approx(200.0, rel=0.1)
    free, tight = turned(LAUNCH, 4.0, 90.0), turned(preset(LAUNCH, turn_radius_m=1.0), 4.0, 90.0)
    assert [tick.command for tick in tight] == [tick.command for tick in free], "no more than the rudder allows"


def test_a_boat_that_slows_down_in_the_turn_keeps_to_the_circle() -> None:
    """Radius = speed/rate: at half the speed the preset rate is half as large."""
    vessel, radius = preset(LAUNCH, turn_radius_m=100.0), 100.0
    pilot, box = build_pilot(vessel), Sailing(model_of(vessel), gear_of(vessel), speed=4.0)
    sail(pilot, box, Order(OrderKind.HEADING, 0.0, serial=1), BEFORE, DT)
    goal = Order(OrderKind.HEADING, math.radians(170.0), serial=1)
    sail(pilot, box, goal, 25.0, DT)
    assert box.speed / box.rate == pytest.approx(radius, rel=0.1)
    box.speed = 2.0
    box.model = at_speed(model_of(vessel), 2.0)
    sail(pilot, box, goal, 30.0, DT)
    assert 0.0 < box.heading < math.radians(150.0), "still in the turn"
    assert box.speed / box.rate == pytest.approx(radius, rel=0.1)


def test_a_route_is_planned_with_the_preset_circle() -> None:
    free = track_settings_of(LANXIN).turn_radius
    assert track_settings_of(preset(LANXIN, turn_radius_m=80.0)).turn_radius == pytest.approx(80.0)
    assert track_settings_of(preset(LANXIN, turn_radius_m=1.0)).turn_radius == free
    rate = preset(LANXIN, turn_rate_max_deg_s=3.0)
    assert track_settings_of(rate).turn_radius == pytest.approx(4.63 / math.radians(3.0))


def test_the_command_line_presets_rate_and_radius() -> None:
    asked = turning_as_asked(preset(LAUNCH, turn_radius_m=60.0), 2.0, None)
    assert (asked.guidance.turn_rate_max_deg_s, asked.guidance.turn_radius_m) == (2.0, 60.0)
    asked = turning_as_asked(asked, None, 30.0)
    assert pilot_config(asked).turn_curvature_max == pytest.approx(1.0 / 30.0)
    assert pilot_config(asked).turn_rate_max == pytest.approx(math.radians(2.0))
    assert turning_as_asked(LAUNCH, None, None) == LAUNCH


@pytest.mark.parametrize("value", [0.0, -3.0, math.nan, math.inf, 1.0e6])
def test_what_is_no_turn_is_refused_in_one_sentence(value: float, capsys: pytest.CaptureFixture[str]) -> None:
    asked: tuple[dict[str, Any], ...] = (
        {"rate_deg_s": value, "radius_m": None},
        {"rate_deg_s": None, "radius_m": value},
    )
    for each in asked:
        with pytest.raises(InputError, match="allowed is 0"):
            turning_as_asked(LAUNCH, **each)
    assert main(["run", "lanxin", "--link", "udpin:127.0.0.1:0", f"--turn-radius-m={value}"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "--turn-radius-m" in lines[0]
