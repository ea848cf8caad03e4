"""Ground stations see whether the loop keeps time."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.guidance.track import TrackGuide, TrackSettings
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.telemetry import Telemetry
from autopilot.signals import Mode, NavState, Order, Reference, RudderCommand, Tick

NAMED = dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT


def tick(now: float, age: float = 0.04) -> Tick:
    state = NavState(now, 1.0, 0.0, 3.0, 0.1, 0.0, age, math.isfinite(age))
    return Tick(0, now, (), Order(), state, Reference(1.0), 0.0, RudderCommand(now, 0.0, False), Mode.STANDBY, ())


def message_of(telemetry: Telemetry) -> dict[str, float]:
    return {message.name.rstrip("\0"): message.value for message in telemetry.make(NAMED)}


@pytest.fixture
def telemetry() -> Telemetry:
    return Telemetry(Mission(TrackGuide(TrackSettings())))


def test_rate_and_longest_gap_are_those_since_the_last_report(telemetry: Telemetry) -> None:
    now = 10.0
    for gap in [0.05] * 19 + [0.25] + [0.05] * 10:
        now += gap
        telemetry.take(tick(now))
    first = message_of(telemetry)
    assert first["gap_ms"] == pytest.approx(250.0, abs=0.1)
    assert first["ticks_hz"] == pytest.approx(30.0 / (now - 10.05), rel=0.01)
    assert first["hdg_age_ms"] == pytest.approx(40.0)
    for _ in range(20):
        now += 0.05
        telemetry.take(tick(now))
    second = message_of(telemetry)
    assert second["gap_ms"] == pytest.approx(50.0, abs=0.1)
    assert second["ticks_hz"] == pytest.approx(20.0)


def test_before_any_time_has_passed_the_rate_is_not_a_number(telemetry: Telemetry) -> None:
    telemetry.take(tick(5.0, math.inf))
    values = message_of(telemetry)
    assert math.isnan(values["ticks_hz"])
    assert values["hdg_age_ms"] == math.inf
    assert values["gap_ms"] == 0.0
