"""What two pilots on one boat say of themselves, and what each makes of it."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.conditions import LISTENING, STEERED, OtherPilot
from autopilot.signals import AlarmEvent, Mode

BOTH, WAITS = AlarmEvent("other_pilot"), AlarmEvent("other_pilot_waits")


def arrived(name: bytes, value: int, codec: MavlinkCodec | None = None) -> Any:
    packet = (codec or MavlinkCodec(1, 191)).encode(dialect.MAVLink_named_value_int_message(5, name, value))
    (message,) = MavlinkCodec(1, 0).decode(packet)
    return message


@pytest.mark.parametrize(
    ("mode", "alarms", "value"),
    [
        (Mode.STANDBY, (), 0),
        (Mode.OVERRIDE, (), 0),
        (Mode.FAULT, (), 0),
        (Mode.STANDBY, (AlarmEvent("waiting_heading"),), 0),
        (Mode.STANDBY, (AlarmEvent("roll"), AlarmEvent("cannot_engage", "y")), 1),
        (Mode.ENGAGED, (), 2),
        (Mode.FAILSAFE, (), 2),
    ],
)
def test_each_says_every_second_what_it_is_and_a_change_at_once(
    mode: Mode, alarms: tuple[AlarmEvent, ...], value: int
) -> None:
    pilot = OtherPilot()
    said = [(step, message.name, message.value) for step in range(25) if (message := pilot.due(0.1 * step + 1e-6))]
    assert said == [(0, "PILOT", 0), (10, "PILOT", 0), (20, "PILOT", 0)]
    pilot.publish_status(2.5, mode, alarms)
    pilot.publish_status(2.6, mode, alarms)
    message = pilot.due(2.7)
    if value:
        assert message is not None and (message.value, message.time_boot_ms) == (value, 2700)
        assert pilot.due(3.69) is None and pilot.due(3.7) is not None
    else:
        assert message is None


@pytest.mark.parametrize("is_forced", [False, True])
def test_who_hears_another_steer_does_not_engage_for_three_and_a_half_seconds(is_forced: bool) -> None:
    pilot = OtherPilot(is_forced)
    assert (pilot.waiting(10.0), pilot.obstacle(10.0)) == ("", "")
    expected = "" if is_forced else LISTENING
    assert (pilot.waiting(10.0), pilot.waiting(11.1), pilot.waiting(11.3)) == (expected, expected, "")
    pilot.take(20.0, arrived(b"PILOT", 2))
    for now, steers in ((20.0, True), (23.5, True), (23.6, False)):
        assert pilot.obstacle(now) == (STEERED if steers and not is_forced else "")
        assert (pilot.alarm(now, True), pilot.alarm(now, False)) == (BOTH if steers else None, None)
    pilot.take(30.0, arrived(b"PILOT", 2))
    pilot.take(30.1, arrived(b"PILOT", 0))
    assert (pilot.obstacle(30.1), pilot.alarm(30.1, True)) == ("", None)


def test_one_that_waits_is_an_alarm_to_who_steers_alone() -> None:
    pilot = OtherPilot()
    pilot.take(20.0, arrived(b"PILOT", 1))
    assert (pilot.obstacle(20.0), pilot.alarm(20.0, False)) == ("", None)
    assert (pilot.alarm(23.5, True), pilot.alarm(23.6, True)) == (WAITS, None)
    pilot.take(24.0, arrived(b"PILOT", 1))
    pilot.take(24.0, arrived(b"PILOT", 2))
    assert pilot.alarm(24.0, True) == BOTH


def test_other_names_and_what_we_said_ourselves_are_nothing() -> None:
    pilot = OtherPilot()
    pilot.take(0.0, arrived(b"PILOTS", 2))
    pilot.take(0.0, MavlinkCodec().decode(MavlinkCodec().encode(dialect.MAVLink_named_value_float_message(
        0, b"PILOT", 2.0)))[0])  # fmt: skip
    codec = MavlinkCodec(1, 191)
    messages = [arrived(b"PILOT", 2, codec) for _ in range(8)]
    for message in messages:
        pilot.sent(bytes(message.get_msgbuf()))
    first = messages[0]
    pilot.take(0.0, first)
    assert pilot.obstacle(0.0) == ""
    pilot.sent(b"one more")
    pilot.take(0.0, first)
    assert pilot.obstacle(0.0) == STEERED, "eight are kept"


def test_who_has_listened_for_1_2_seconds_knows() -> None:
    pilot = OtherPilot()
    pilot.obstacle(0.0)
    assert (pilot.waiting(1.1999), pilot.waiting(1.2)) == (LISTENING, "")
