"""What the vehicle says of battery, fence and depth becomes a condition once, and is over once."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.authority import RadioWatch
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.conditions import VehicleHealth
from autopilot.links.mavlink.requests import VehicleParameters
from autopilot.signals import ConditionSample
from autopilot.supervision.alarms import CATALOGUE

LASTS_S = 0.3
RECOVERED_PERCENT = 3.0
TEXT_LASTS_S = 60.0

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


def conditions_of(samples: list[Any]) -> list[tuple[str, bool]]:
    assert all(isinstance(sample, ConditionSample) and sample.name in CATALOGUE for sample in samples)
    return [(sample.name, sample.present) for sample in samples]


def test_a_low_charge_is_reported_once_and_is_over_when_it_has_recovered() -> None:
    health = VehicleHealth(20.0)
    assert conditions_of(health.take(0.0, system(21))) == []
    (low,) = health.take(1.0, system(19))
    assert (low.name, low.present, low.detail) == ("battery_low", True, "19 %")
    assert conditions_of(health.take(2.0, system(18))) == []
    assert conditions_of(health.take(3.0, battery(int(20 + RECOVERED_PERCENT) - 1))) == []
    assert conditions_of(health.take(4.0, battery(int(20 + RECOVERED_PERCENT)))) == [("battery_low", False)]


def test_a_charge_that_nobody_knows_is_no_news_and_a_bad_state_is() -> None:
    health = VehicleHealth(20.0)
    assert conditions_of(health.take(0.0, system(-1))) == []
    assert conditions_of(health.take(1.0, battery(-1, dialect.MAV_BATTERY_CHARGE_STATE_OK))) == []
    assert conditions_of(health.take(2.0, battery(-1, dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL))) == [
        ("battery_low", True)
    ]
    assert conditions_of(health.take(3.0, system(-1))) == []


def test_without_a_limit_the_battery_is_not_watched() -> None:
    health = VehicleHealth()
    assert conditions_of([*health.take(0.0, system(1)), *health.take(1.0, battery(1, 3))]) == []


def test_a_fence_counts_where_it_is_enabled() -> None:
    health = VehicleHealth()
    assert conditions_of(health.take(0.0, system(-1, 0, 0))) == []
    assert conditions_of(health.take(1.0, system(-1, FENCE, FENCE))) == []
    assert conditions_of(health.take(2.0, system(-1, FENCE, 0))) == [("geofence", True)]
    assert conditions_of(health.take(3.0, system(-1, FENCE, FENCE))) == [("geofence", False)]
    assert conditions_of(health.take(4.0, sent(dialect.MAVLink_fence_status_message(1, 1, 1, 0)))) == [
        ("geofence", True)
    ]
    assert conditions_of(health.take(5.0, sent(dialect.MAVLink_fence_status_message(0, 1, 1, 0)))) == [
        ("geofence", False)
    ]


@pytest.mark.parametrize("part", [dialect.MAV_SYS_STATUS_SENSOR_3D_MAG, dialect.MAV_SYS_STATUS_AHRS])
def test_a_compass_or_attitude_that_the_vehicle_calls_unhealthy_is_said_where_it_is_enabled(part: int) -> None:
    health = VehicleHealth()
    assert conditions_of(health.take(0.0, system(-1, 0, 0))) == []
    assert conditions_of(health.take(1.0, system(-1, part, part))) == []
    assert conditions_of(health.take(2.0, system(-1, part, 0))) == [("attitude_unhealthy", True)]
    assert conditions_of(health.take(3.0, system(-1, part, 0))) == []
    assert conditions_of(health.take(4.0, system(-1, part, part))) == [("attitude_unhealthy", False)]


@pytest.mark.parametrize(("words", "name"), [("Fence Breached", "geofence"), ("Shallow water ahead!", "shallow")])
def test_what_is_said_in_words_lasts_a_minute(words: str, name: str) -> None:
    health = VehicleHealth()
    assert conditions_of(health.take(0.0, text(words))) == [(name, True)]
    assert conditions_of(health.take(10.0, text(words))) == []
    assert conditions_of(health.take(11.0, system(-1, FENCE, FENCE))) == [], "said in words it lasts its time"
    assert conditions_of(health.pass_time(10.0 + TEXT_LASTS_S - 0.1)) == []
    assert conditions_of(health.pass_time(10.0 + TEXT_LASTS_S)) == [(name, False)]
    assert conditions_of(health.pass_time(1000.0)) == []


@given(st.text(max_size=40))
def test_status_texts_without_fence_or_shallow_raise_no_condition(words: str) -> None:
    if not any(word in words.lower() for word in ("fence", "shallow")):
        assert VehicleHealth().take(0.0, text(words.encode("ascii", "replace").decode())) == []


RECEIVER = int(dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER)


def channels(throttle: int = 1500, rssi: int = 255, count: int = 16) -> tuple[list[int], int]:
    return [count, 1500, 1500, throttle, *[1500] * 13, 0, 0], rssi


def parameters(**values: float) -> VehicleParameters:
    known = VehicleParameters()
    for name, value in {"FS_THR_VALUE": 910.0, **values}.items():
        assert known.take(name, value)
    return known


@pytest.mark.parametrize(
    ("well", "lost", "word"),
    [
        ({}, {"throttle": 909}, "909 us"),
        ({"rssi": 200}, {"rssi": 3}, "3 of 254"),
        ({"count": 8}, {"count": 0}, "no channels"),
    ],
)
def test_a_lost_radio_shows_in_rc_channels(well: dict[str, int], lost: dict[str, int], word: str) -> None:
    radio, known = RadioWatch(), parameters(FS_THR_ENABLE=1.0)
    radio.channels(0.0, *channels(**well), known)
    for n in range(4):
        radio.channels(1.0 + n * LASTS_S / 4, *channels(**lost), known)
    assert radio.reason(known) == "", "not for a moment"
    radio.channels(1.01 + LASTS_S, *channels(**lost), known)
    assert radio.reason(known).startswith("the radio is lost: ")
    assert word in radio.reason(known)
    assert radio.reason(parameters(FS_THR_ENABLE=0.0)) == ""
    radio.channels(2.0, *channels(**well), known)
    assert radio.reason(known) == ""


@pytest.mark.parametrize("never", [{"rssi": 0}, {"rssi": 255}, {"count": 0}, {"throttle": 0}, {"throttle": 910}])
def test_a_radio_that_never_was_is_not_lost(never: dict[str, int]) -> None:
    radio, known = RadioWatch(), parameters()
    for n in range(50):
        radio.channels(0.1 * n, *channels(**never), known)
        radio.status(0, 0)
        radio.status(RECEIVER, 0)
    assert radio.reason(known) == ""


def test_a_receiver_that_was_well_and_is_not_is_lost() -> None:
    radio, known = RadioWatch(), parameters()
    radio.status(RECEIVER, RECEIVER)
    radio.status(RECEIVER, 0)
    assert radio.reason(known)
    radio.status(RECEIVER, RECEIVER)
    assert radio.reason(known) == ""


def test_the_firmware_s_radio_failsafe_lasts_until_it_says_so_or_is_no_longer_critical() -> None:
    radio, known = RadioWatch(), parameters()
    radio.text(0.0, "GCS Failsafe")
    assert radio.reason(known) == ""
    radio.text(1.0, "Radio Failsafe")
    radio.heartbeat(1.1, dialect.MAV_STATE_ACTIVE)
    assert radio.reason(known), "a heartbeat from before"
    radio.heartbeat(60.0, dialect.MAV_STATE_CRITICAL)
    assert radio.reason(known)
    radio.text(61.0, "Radio Failsafe Cleared")
    assert radio.reason(known) == ""
    radio.text(62.0, "Radio Failsafe")
    radio.heartbeat(64.0, dialect.MAV_STATE_STANDBY)
    assert radio.reason(known) == "", "the text was lost"


@pytest.mark.parametrize("limit", [0.5, 20.0, 99.0])
def test_every_charge_from_0_to_100_is_judged_and_named_and_none_beyond(limit: float) -> None:
    for percent in (0, 1, 20, 99, 100):
        found = VehicleHealth(limit).take(0.0, battery(percent))
        assert [sample.detail for sample in found] == ([f"{percent} %"] if percent < limit else [])  # type: ignore[union-attr]
    for percent in (-1, 101):
        assert VehicleHealth(limit).take(0.0, battery(percent)) == []
        bad = VehicleHealth(limit).take(0.0, battery(percent, dialect.MAV_BATTERY_CHARGE_STATE_FAILED))
        assert [sample.detail for sample in bad] == [""]  # type: ignore[union-attr]


@pytest.mark.parametrize(("state", "is_bad"), [(0, False), (1, False), (2, True), (3, True), (4, True), (5, True),
                                               (6, True), (7, False)])  # fmt: skip
def test_which_charge_states_are_bad(state: int, is_bad: bool) -> None:
    assert conditions_of(VehicleHealth(20.0).take(0.0, battery(90, state))) == (
        [("battery_low", True)] if is_bad else []
    )


def test_words_last_sixty_seconds_from_when_they_were_said_last() -> None:
    health = VehicleHealth()
    (said,) = health.take(0.0, text("Fence Breached " + "x" * 35))
    assert (said.time, said.source) == (0.0, "vehicle")
    assert health.take(30.0, text("fence breached")) == []
    assert health.take(40.0, system(-1, FENCE, FENCE)) == [], "what was said in words lasts"
    assert health.pass_time(89.9) == []
    assert conditions_of(health.pass_time(90.0)) == [("geofence", False)]
    assert health.pass_time(200.0) == []


@pytest.mark.parametrize(
    ("before", "now_", "lost"),
    [
        ({"rssi": 26}, {"rssi": 5}, True),
        ({"rssi": 25}, {"rssi": 5}, False),
        ({"rssi": 254}, {"rssi": 6}, False),
        ({"rssi": 255}, {"rssi": 0}, False),
        ({"count": 1}, {"count": 0}, True),
        ({"count": 2}, {"count": 1}, False),
        ({"throttle": 1500}, {"throttle": 910}, False),
        ({"throttle": 1500}, {"throttle": 909}, True),
        ({"throttle": 1500}, {"throttle": 1}, True),
        ({"throttle": 1500}, {"throttle": 0}, False),
    ],
)
def test_a_radio_is_lost_beyond_its_limits_and_not_at_them(
    before: dict[str, int], now_: dict[str, int], lost: bool
) -> None:
    radio, known = RadioWatch(), parameters()
    radio.channels(-1.0, *channels(**before), known)
    for now in (0.0, 0.29):
        radio.channels(now, *channels(**now_), known)
        assert radio.reason(known) == "", "not for a moment"
    radio.channels(0.3, *channels(**now_), known)
    assert bool(radio.reason(known)) is lost


def test_a_radio_that_comes_and_goes_is_not_lost() -> None:
    radio, known = RadioWatch(), parameters()
    for step in range(20):
        radio.channels(0.2 * step, *channels(throttle=(1500, 900)[step % 2]), known)
        assert radio.reason(known) == ""


def test_a_heartbeat_within_one_and_a_half_seconds_of_the_text_may_be_older() -> None:
    radio, known = RadioWatch(), parameters()
    radio.text(1.0, "Radio Failsafe On")
    radio.heartbeat(2.5, dialect.MAV_STATE_ACTIVE)
    assert radio.reason(known).endswith("the vehicle is in its radio fail-safe")
    radio.heartbeat(2.51, dialect.MAV_STATE_ACTIVE)
    assert radio.reason(known) == ""


def heartbeat(state: int) -> Any:
    return sent(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, state, 3))


def test_a_fail_safe_and_a_failure_in_the_heartbeat_are_reported_as_long_as_they_last() -> None:
    health = VehicleHealth()
    assert conditions_of(health.take(0.0, heartbeat(4)) + health.take(1.0, heartbeat(3))) == []
    assert conditions_of(health.take(2.0, heartbeat(5))) == [("vehicle_failsafe", True)]
    assert conditions_of(health.take(3.0, heartbeat(5))) == []
    over, failed = health.take(4.0, heartbeat(6))
    assert (over.name, over.present) == ("vehicle_failsafe", False)
    assert (failed.name, failed.present, failed.detail) == ("vehicle_failed", True, "emergency")
    assert conditions_of(health.take(5.0, heartbeat(4))) == [("vehicle_failed", False)]
    for state in (7, 8):
        assert conditions_of(VehicleHealth().take(0.0, heartbeat(state))) == [("vehicle_failed", True)]


RUNS = 831
ALIGNS = 1024


def ekf(ratio: float, flags: int = RUNS) -> Any:
    return sent(dialect.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, ratio, 0.0, 0.0))


def test_a_compass_that_its_filter_doubts_for_3_s_is_reported_until_it_is_well_below() -> None:
    health = VehicleHealth()
    for now in range(3):
        assert conditions_of(health.take(float(now), ekf(0.8))) == []
    (found,) = health.take(3.0, ekf(1.3))
    assert (found.name, found.present, found.detail) == ("compass_doubtful", True, "1.3 of what its filter lets pass")
    assert conditions_of(health.take(4.0, ekf(0.6))) == [], "between the limits it stays"
    assert conditions_of(health.take(5.0, ekf(0.49))) == [("compass_doubtful", False)]
    for now in range(60):
        assert conditions_of(health.take(10.0 + now, ekf(0.79 if now % 3 else 2.0))) == [], "shorter than 3 s"


def test_a_filter_that_aligns_or_is_not_there_is_no_alarm_and_one_that_loses_the_attitude_is() -> None:
    health = VehicleHealth()
    for now in range(60):
        assert conditions_of(health.take(float(now), ekf(0.0, ALIGNS))) == []
        assert conditions_of(VehicleHealth().take(float(now), ekf(0.0, 0))) == []
    found = [condition for now in range(60, 70) for condition in health.take(float(now), ekf(math.nan, RUNS))]
    assert found == []
    found = [condition for now in range(70, 80) for condition in health.take(float(now), ekf(0.0, ALIGNS))]
    assert conditions_of(found) == [("compass_doubtful", True)]
    health.take(80.0, ekf(0.0))
    health.restart()
    found = [condition for now in range(81, 90) for condition in health.take(float(now), ekf(0.0, ALIGNS))]
    assert conditions_of(found) == []
