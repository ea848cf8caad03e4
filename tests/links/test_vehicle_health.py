"""What the vehicle says of battery, fence and depth becomes a condition once, and is over once."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.alarms import CATALOGUE
from autopilot.links.mavlink_codec import MavlinkCodec
from autopilot.links.vehicle_health import RECOVERED_PERCENT, TEXT_LASTS_S, VehicleHealth
from autopilot.signals import ConditionSample

FENCE = int(dialect.MAV_SYS_STATUS_GEOFENCE)


def sent(message: Any) -> Any:
    """Return a message as it arrives."""
    (received,) = MavlinkCodec(1, 0).decode(MavlinkCodec(1, 1).encode(message))
    return received


def system(percent: int, enabled: int = 0, health: int = 0) -> Any:
    return sent(dialect.MAVLink_sys_status_message(enabled, enabled, health, 0, 0, 0, percent, 0, 0, 0, 0, 0, 0))


def battery(percent: int, state: int = 0) -> Any:
    volts = [65535] * 10
    return sent(dialect.MAVLink_battery_status_message(0, 0, 0, 0, volts, -1, -1, -1, percent, 0, state))


def text(words: str) -> Any:
    return sent(dialect.MAVLink_statustext_message(3, words.encode()))


def told(samples: list[Any]) -> list[tuple[str, bool]]:
    assert all(isinstance(sample, ConditionSample) and sample.name in CATALOGUE for sample in samples)
    return [(sample.name, sample.present) for sample in samples]


def test_a_low_charge_is_told_once_and_is_over_when_it_has_recovered() -> None:
    health = VehicleHealth(20.0)
    assert told(health.take(0.0, system(21))) == []
    (low,) = health.take(1.0, system(19))
    assert (low.name, low.present, low.detail) == ("battery_low", True, "19 %")
    assert told(health.take(2.0, system(18))) == []
    assert told(health.take(3.0, battery(int(20 + RECOVERED_PERCENT) - 1))) == []
    assert told(health.take(4.0, battery(int(20 + RECOVERED_PERCENT)))) == [("battery_low", False)]


def test_a_charge_that_nobody_knows_is_no_news_and_a_bad_state_is() -> None:
    health = VehicleHealth(20.0)
    assert told(health.take(0.0, system(-1))) == []
    assert told(health.take(1.0, battery(-1, dialect.MAV_BATTERY_CHARGE_STATE_OK))) == []
    assert told(health.take(2.0, battery(-1, dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL))) == [("battery_low", True)]
    assert told(health.take(3.0, system(-1))) == []


def test_without_a_limit_the_battery_is_not_watched() -> None:
    health = VehicleHealth()
    assert told([*health.take(0.0, system(1)), *health.take(1.0, battery(1, 3))]) == []


def test_a_fence_counts_where_it_is_enabled() -> None:
    health = VehicleHealth()
    assert told(health.take(0.0, system(-1, 0, 0))) == []
    assert told(health.take(1.0, system(-1, FENCE, FENCE))) == []
    assert told(health.take(2.0, system(-1, FENCE, 0))) == [("geofence", True)]
    assert told(health.take(3.0, system(-1, FENCE, FENCE))) == [("geofence", False)]
    assert told(health.take(4.0, sent(dialect.MAVLink_fence_status_message(1, 1, 1, 0)))) == [("geofence", True)]
    assert told(health.take(5.0, sent(dialect.MAVLink_fence_status_message(0, 1, 1, 0)))) == [("geofence", False)]


@pytest.mark.parametrize(("words", "name"), [("Fence Breached", "geofence"), ("Shallow water ahead!", "shallow")])
def test_what_is_said_in_words_lasts_a_minute(words: str, name: str) -> None:
    health = VehicleHealth()
    assert told(health.take(0.0, text(words))) == [(name, True)]
    assert told(health.take(10.0, text(words))) == []
    assert told(health.take(11.0, system(-1, FENCE, FENCE))) == [], "said in words it lasts its time"
    assert told(health.pass_time(10.0 + TEXT_LASTS_S - 0.1)) == []
    assert told(health.pass_time(10.0 + TEXT_LASTS_S)) == [(name, False)]
    assert told(health.pass_time(1000.0)) == []


@given(st.text(max_size=40))
def test_other_words_mean_nothing(words: str) -> None:
    if not any(word in words.lower() for word in ("fence", "shallow")):
        assert VehicleHealth().take(0.0, text(words.encode("ascii", "replace").decode())) == []
