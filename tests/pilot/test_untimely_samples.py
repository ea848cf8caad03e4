"""Samples without a time, and from clocks ahead of ours: a measurement is none, what happened has happened."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, get_args

import pytest
from alarm_texts import words_of
from plant import Plant

from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import AlarmEvent, HelmCause, Mode, Order, OrderKind, Sample, Tick, WindSample
from autopilot.tick import EVENTS
from autopilot.vessel.file import load_vessel

BOAT = load_vessel("lanxin")
VESSEL = replace(BOAT, failsafe=replace(BOAT.failsafe, action="windward"))
NORTH = Order(OrderKind.HEADING, 0.0, serial=1)
VALUES: dict[str, Any] = {
    "event": AlarmEvent("battery_low"),
    "ordered": False,
    "over_ground": False,
    "available": False,
    "present": True,
}
VALUES |= {"name": "shallow", "cause": HelmCause.TAKEN}
ODD_STEP = 30
TYPES = get_args(Sample)


def made(kind: Any, time: float) -> Sample:
    """Return a sample of every type with values that would show: half a radian or metre a second, an alarm, a helm."""
    values = {field: VALUES.get(field, 0.5) for field in kind._fields if field not in ("time", "source", "detail")}
    values |= {field: "taken" for field in ("reason",) if field in kind._fields}
    sample: Sample = kind(time=time, **values, source="odd")
    return sample


def sailed(odd: list[Sample]) -> list[Tick]:
    pilot, plant = build_pilot(VESSEL), Plant(model_of(VESSEL), gear_of(VESSEL), seed=3)
    ticks = []
    for step in range(160):
        wind = WindSample(plant.time, 0.3, 8.0, "vane")
        seen = [*plant.sense(), *([wind] if step < 20 else []), *(odd if step == ODD_STEP else [])]
        ticks.append(pilot.step(plant.time, tuple(seen), NORTH)._replace(samples=()))
        plant.step(ticks[-1].command.angle, 0.05)
    return ticks


NOW = sailed([])[ODD_STEP].now


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("kind", [kind for kind in TYPES if kind not in EVENTS], ids=lambda kind: kind.__name__)
def test_a_measurement_without_a_time_changes_nothing(kind: Any, time: float) -> None:
    assert sailed([made(kind, time)]) == sailed([])


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
def test_a_sample_of_a_clock_ahead_of_ours_is_of_now(kind: Any) -> None:
    assert sailed([made(kind, 1.0e9)]) == sailed([made(kind, NOW)])


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("kind", EVENTS, ids=lambda kind: kind.__name__)
def test_what_happened_counts_without_a_time_too(kind: Any, time: float) -> None:
    assert sailed([made(kind, time)]) == sailed([made(kind, NOW)])


def test_a_wind_without_a_time_does_not_stand_for_one() -> None:
    ticks = sailed([WindSample(math.nan, 0.3, 8.0, "vane"), WindSample(1.0e9, 0.3, 8.0, "vane")])
    assert ticks[-1].mode is Mode.ENGAGED
    assert any("wind is not known" in alarm for alarm in words_of(ticks[-1]))
