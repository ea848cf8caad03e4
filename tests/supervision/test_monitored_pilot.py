"""The whole pilot with a compass that freezes, a rudder wired the wrong way, and wind that is too much."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from alarm_texts import words_of
from plant import Plant, sail

from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    HeadingSample,
    Mode,
    Order,
    OrderKind,
    Sample,
    SupervisorState,
    Tick,
)
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")
DT = 0.05


def course(heading: float, serial: int = 1) -> Order:
    return Order(OrderKind.HEADING, heading, serial=serial)


def boat(disturbance: Callable[[float], float] = lambda _: 0.0) -> Plant:
    return Plant(model_of(VESSEL), gear_of(VESSEL), disturbance=disturbance, heading_noise=math.radians(0.1))


def sail_altered(
    pilot: Pilot, plant: Plant, seconds: float, altered: Callable[[Sample], Sample], rudder_sign: float = 1.0
) -> list[Tick]:
    """Sail on with what the compass says altered, and the rudder's sign."""
    ticks = []
    for _ in range(round(seconds / DT)):
        tick = pilot.step(plant.time, tuple(altered(sample) for sample in plant.sense()), course(0.0))
        ticks.append(tick)
        plant.step(rudder_sign * tick.command.angle if tick.command.engaged else 0.0, DT)
    return ticks


@pytest.mark.parametrize("has_rate", [True, False])
def test_a_compass_that_freezes_ends_in_the_fail_safe(has_rate: bool) -> None:
    """Frozen a little off the course: the law turns the boat to take out an error that never goes away."""
    pilot, plant = build_pilot(VESSEL), boat()
    assert sail(pilot, plant, course(0.0), 20.0, DT)[-1].mode is Mode.ENGAGED

    def frozen(sample: Sample) -> Sample:
        assert isinstance(sample, HeadingSample)
        return sample._replace(heading=math.radians(1.0), rate=sample.rate if has_rate else None)

    ticks = sail_altered(pilot, plant, 60.0, frozen)
    ended = next(tick for tick in ticks if tick.mode is Mode.FAILSAFE)
    assert ended.alarms[0] == AlarmEvent("heading_frozen")
    assert ended.now - ticks[0].now < 30.0
    # a new order does not engage while the compass is still frozen
    again = pilot.step(plant.time, tuple(frozen(sample) for sample in plant.sense()), course(0.0, serial=2))
    assert again.mode is not Mode.ENGAGED


@pytest.mark.parametrize("has_rate", [True, False])
def test_a_rudder_of_the_wrong_sign_is_given_up(has_rate: bool) -> None:
    """Within a few degrees, whether a gyro tells the rate or the compass is alone."""
    pilot, plant = build_pilot(VESSEL), boat()
    plant.heading = math.radians(3.0)

    def seen(sample: Sample) -> Sample:
        assert isinstance(sample, HeadingSample)
        return sample if has_rate else sample._replace(rate=None)

    ticks = sail_altered(pilot, plant, 120.0, seen, rudder_sign=-1.0)
    ended = [tick for tick in ticks if tick.mode is Mode.FAILSAFE]
    assert ended
    assert words_of(ended[0])[0].startswith("steering gear: rudder moves the wrong way")
    assert not ended[0].command.engaged


def test_wind_that_is_too_much_is_an_alarm_and_steering_goes_on() -> None:
    def gale(now: float) -> float:
        return math.radians(45.0) if 20.0 < now < 80.0 else 0.0

    pilot, plant = build_pilot(VESSEL), boat(gale)
    ticks = sail(pilot, plant, course(0.0), 140.0, DT)
    said = [tick for tick in ticks if any("off heading" in alarm for alarm in words_of(tick))]
    assert said
    assert all(tick.mode is Mode.ENGAGED for tick in ticks)
    assert abs(ticks[-1].state.heading) < math.radians(2.0)


def test_turns_gusts_and_noise_raise_no_alarm() -> None:
    def gusts(now: float) -> float:
        return math.radians(5.0) * math.sin(0.7 * now) * math.sin(0.11 * now)

    pilot, plant = build_pilot(VESSEL), boat(gusts)

    def orders(now: float) -> Order:
        return course(0.0) if now < 30.0 else course(math.radians(170.0)) if now < 90.0 else course(math.radians(-60.0))

    ticks = sail(pilot, plant, orders, 150.0, DT)
    assert ticks[-1].mode is Mode.ENGAGED
    assert not any("off heading" in alarm or "frozen" in alarm for tick in ticks for alarm in words_of(tick))


def test_a_doubt_that_a_link_tells_of_degrades_and_nothing_else_that_it_says_ends_steering() -> None:
    pilot, plant = build_pilot(VESSEL), boat()

    def state_after(*events: AlarmEvent | None) -> SupervisorState:
        notes = tuple(AlarmSample(plant.time, event, str(place)) for place, event in enumerate(events))
        tick = pilot.step(plant.time, (*plant.sense(), *notes), course(0.0))
        plant.step(tick.command.angle, DT)
        assert tick.mode is Mode.ENGAGED
        return tick.supervisor

    assert state_after(None, None) is SupervisorState.HEADING
    assert state_after(AlarmEvent("heading_disagrees"), AlarmEvent("heading_lost")) is SupervisorState.DEGRADED
    assert state_after(None, AlarmEvent("heading_lost")) is SupervisorState.HEADING
