"""Other vehicles on the boat's line: which one is the boat, and what is heard under its name."""

from __future__ import annotations

from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import Lockstep
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.signals import Mode
from autopilot.vessel.file import load_vessel

LANXIN = load_vessel("lanxin")
ROVER, BOAT, COPTER, STATION = 10, 11, 2, 6
ARDUPILOT, PX4, NONE = 3, 12, 8


def beat(system: int, kind: int, autopilot: int, armed: bool = True) -> bytes:
    flags = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
    return MavlinkCodec(system, 1).encode(dialect.MAVLink_heartbeat_message(kind, autopilot, flags, 0, 4, 3))


def engaged() -> Lockstep:
    boat = Lockstep(LANXIN)
    boat.run(2.0)
    boat.engage(40.0)
    assert boat.run(10.0, until=boat.engaged)
    boat.run(1.0)
    return boat


@pytest.mark.parametrize(
    "other", [(2, COPTER, ARDUPILOT), (9, BOAT, PX4), (1, BOAT, 0), (5, ROVER, ARDUPILOT)], ids=str
)
def test_a_vehicle_that_is_no_boat_or_falls_silent_at_once_gives_way_to_the_boat(other: Any) -> None:
    boat = Lockstep(LANXIN)
    boat.inject(beat(*other))
    boat.run(2.0)
    boat.engage(40.0)
    assert boat.run(20.0, until=boat.engaged), words_of(boat.tick)
    assert boat.link.session.vehicle == 1


def test_a_boat_of_ours_that_falls_silent_does_not_give_way_to_another() -> None:
    boat = engaged()
    boat.down._loss = 1.0
    for _ in range(30):
        boat.inject(beat(3, BOAT, ARDUPILOT))
        boat.run(1.0)
    assert boat.link.session.vehicle == 1 and boat.tick.mode is not Mode.ENGAGED


@pytest.mark.parametrize(("kind", "autopilot"), [(COPTER, ARDUPILOT), (BOAT, PX4)])
def test_another_kind_of_vehicle_with_the_same_id_ends_the_steering(kind: int, autopilot: int) -> None:
    boat = engaged()
    boat.inject(beat(1, kind, autopilot))
    boat.run(0.5)
    assert boat.tick.mode is Mode.OVERRIDE
    assert boat.firmware.servos[0] == 1500, "the stick's place"
    for _ in range(5):
        boat.inject(beat(1, kind, autopilot) + beat(3, BOAT, ARDUPILOT))
        boat.run(0.5)
    assert boat.link.session.vehicle == 1, "a neighbour's boat does not become ours by that"


@pytest.mark.parametrize("older", [5.0, 60.0])
def test_two_boats_with_one_id_are_named_and_neither_is_steered(older: float) -> None:
    """Another boat, switched on earlier, on the same radio channel with the id that all boats come with."""
    boat, other = engaged(), Lockstep(LANXIN)
    other.run(older)
    heard: list[bytes] = []
    put = other.down.put

    def overheard(now: float, data: bytes) -> None:
        heard.append(data)
        put(now, data)

    other.down.put = overheard  # type: ignore[method-assign]
    for second in range(6):
        if second == 3:
            boat.engage(60.0)
        for _ in range(20):
            other.run(0.05)
            boat.inject(b"".join(heard))
            heard.clear()
            boat.run(0.05)
            assert second < 1 or boat.tick.mode is not Mode.ENGAGED
    assert any("two vehicles with one system id" in each for each in words_of(boat.tick)), words_of(boat.tick)


def test_a_heartbeat_that_is_no_autopilot_s_says_nothing_of_the_vehicle() -> None:
    boat = engaged()
    for _ in range(5):
        boat.inject(beat(1, STATION, NONE, armed=False))
        boat.run(0.3)
    assert boat.tick.mode is Mode.ENGAGED
