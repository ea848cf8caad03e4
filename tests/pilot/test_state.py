"""The pilot's state is one value: printed, saved, compared and restored, and the tick is a function of it."""

from __future__ import annotations

import math
import pickle

import pytest
from plant import Plant

from autopilot.pilot import Pilot
from autopilot.pilot_state import configured, first_state
from autopilot.runtime.build import build_pilot, gear_of, law_of, model_of, pilot_config
from autopilot.signals import AlarmEvent, AlarmSample, HeadingSample, Mode, Order, OrderKind, Sample, SpeedSample
from autopilot.tick import Inputs, step
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")
LAWS = ("backstepping", "pid", "sliding")


def sailed(law: str, seconds: float) -> list[Inputs]:
    """What a pilot is given on a turn, with a spike, a note and a silence of the compass on the way."""
    pilot, plant = build_pilot(VESSEL, law), Plant(model_of(VESSEL), gear_of(VESSEL))
    given = []
    while plant.time < seconds:
        now, order = plant.time, Order(OrderKind.HEADING, 0.5 if plant.time < 20.0 else -1.0, serial=1)
        heading = plant.heading + (1.0 if math.isclose(now, 15.0) else 0.0)
        samples: tuple[Sample, ...] = (HeadingSample(now, heading, plant.rate), SpeedSample(now, 4.0))
        if 12.0 < now < 12.5:
            samples = (AlarmSample(now, AlarmEvent("other", "warm"), "gear"),)
        given.append((now, samples, order))
        tick = pilot.step(*given[-1])
        plant.step(tick.command.angle, 0.1)
    assert tick.mode is Mode.ENGAGED
    return given


@pytest.mark.parametrize("law", LAWS)
def test_a_state_that_was_saved_goes_on_as_the_one_that_sailed_on(law: str) -> None:
    given, config = sailed(law, 40.0), configured(pilot_config(VESSEL, law), law_of(VESSEL, law))
    state, kept, ticks = first_state(config), [], []
    for number, inputs in enumerate(given):
        if number in (0, 1, 125, 200):
            kept.append((number, pickle.dumps(state), repr(state)))
        state, tick = step(config, state, inputs)
        ticks.append(tick)
    for number, saved, printed in kept:
        again = pickle.loads(saved)
        assert repr(again) == printed
        for place in range(number, len(given)):
            again, tick = step(config, again, given[place])
            assert repr(tick) == repr(ticks[place])
        assert repr(again) == repr(state)


def test_a_copy_is_left_alone_by_who_goes_on() -> None:
    given, config = sailed("backstepping", 20.0), configured(pilot_config(VESSEL), law_of(VESSEL))
    state = first_state(config)
    for inputs in given[:100]:
        state, _ = step(config, state, inputs)
    kept = state.copied
    printed = repr(kept)
    for inputs in given[100:]:
        state, _ = step(config, state, inputs)
    assert repr(kept) == printed != repr(state)


def test_the_pilot_is_its_config_and_its_state() -> None:
    given = sailed("backstepping", 30.0)
    first, second = build_pilot(VESSEL), build_pilot(VESSEL)
    for inputs in given[:150]:
        first.step(*inputs)
    assert isinstance(second, Pilot)
    second.state = first.state.copied
    for inputs in given[150:]:
        assert repr(first.step(*inputs)) == repr(second.step(*inputs))


def test_what_is_left_of_a_turn_grows_with_the_turn_that_is_ordered_and_goes_with_time_or_with_the_order() -> None:
    pilot, plant, rolling = build_pilot(VESSEL), Plant(model_of(VESSEL), gear_of(VESSEL)), math.radians(2.0)
    plant.disturbance = lambda now: rolling * math.sin(2.0 * now)
    goal, found = 0.0, []
    for until in (3.0, 3.5, 24.0, 24.5):
        order = Order(OrderKind.HEADING, goal, serial=1)
        while plant.time < until:
            tick = pilot.step(plant.time, (*plant.sense(), SpeedSample(plant.time, 4.0)), order)
            plant.step(tick.command.angle, 0.1)
        found.append(pilot.state.way.guide)
        goal += 1.0 if until in (3.0, 24.0) else 0.0
    pilot.step(plant.time, (), Order())
    straight, turning, settled, back = found
    assert straight.slide == straight.unknown == settled.unknown == 0.0 < turning.unknown
    assert pilot.state.way.guide.slide == pilot.state.way.guide.unknown == 0.0
    assert abs(settled.slide) < math.radians(0.01)
    assert turning.slide < -math.radians(1.0), "it brakes"
    assert back.slide < -math.radians(1.0)
