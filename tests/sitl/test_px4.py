"""The simulated PX4 rover: its modes over MAVLink, when Offboard is taken and when left, and what steers there."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sitl.px4 import OFFBOARD_LOSS_S, Px4Mode

MakeBench = Callable[..., Any]
VELOCITY_ALONE = 0xDC7
PLACE_TOO = 0xDC0


def made(bench: MakeBench, **vehicle: Any) -> Any:
    boat = bench(vehicle={"firmware": "px4-1.17", **vehicle})
    boat.run(1.1)
    return boat


def setpoint(heading_deg: float, speed: float, mask: int = VELOCITY_ALONE, frame: int = 1) -> Any:
    heading = math.radians(heading_deg)
    moved = speed * math.cos(heading), speed * math.sin(heading), 0.0
    return dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, 0, 0, 0, *moved, 0, 0, 0, 0, 0)


def stream(boat: Any, seconds: float, message: Any, every: float = 0.2) -> None:
    for _ in range(round(seconds / every)):
        boat.send(message)
        boat.run(every)


def wish(boat: Any, mode: Px4Mode) -> int:
    answer = boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, mode >> 16 & 0xFF, mode >> 24)
    return int(answer.result)


def mode(boat: Any) -> Px4Mode:
    return Px4Mode(boat.last("HEARTBEAT").custom_mode)


def offboard(bench: MakeBench, speed: float = 4.0, **vehicle: Any) -> Any:
    boat = made(bench, **vehicle)
    stream(boat, 1.0, setpoint(0.0, speed))
    assert wish(boat, Px4Mode.OFFBOARD) == dialect.MAV_RESULT_ACCEPTED
    return boat


def test_its_heartbeat_is_px4s(bench: MakeBench) -> None:
    boat = made(bench)
    beat = boat.last("HEARTBEAT")
    assert (beat.autopilot, beat.custom_mode) == (dialect.MAV_AUTOPILOT_PX4, 1 << 16)
    assert wish(boat, Px4Mode.HOLD) == dialect.MAV_RESULT_ACCEPTED
    boat.run(1.1)
    assert boat.last("HEARTBEAT").custom_mode == 4 << 16 | 3 << 24


@pytest.mark.parametrize(
    "message", [None, setpoint(0.0, 1.0, PLACE_TOO), setpoint(0.0, 1.0, frame=dialect.MAV_FRAME_BODY_NED)]
)
def test_offboard_is_refused_without_a_signal_that_is_understood(bench: MakeBench, message: Any) -> None:
    boat = made(bench)
    if message is not None:
        stream(boat, 1.5, message)
    assert wish(boat, Px4Mode.OFFBOARD) == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    boat.run(1.1)
    assert mode(boat) is Px4Mode.MANUAL


def test_a_velocity_is_steered_as_heading_and_speed_whatever_the_sticks_say(bench: MakeBench) -> None:
    boat = offboard(bench)
    boat.firmware.sticks[0], boat.firmware.sticks[2] = 1900, 1100
    stream(boat, 25.0, setpoint(80.0, 3.0))
    state = boat.world.boat.state
    assert math.degrees(state.heading) == pytest.approx(80.0, abs=2.0)
    assert state.speed == pytest.approx(3.0, rel=0.1)
    stream(boat, 3.0, setpoint(-90.0, 1.0e-8))
    assert boat.firmware.throttle == 0
    assert boat.steering_pulse == 1500, "without throttle no rudder is laid"


@pytest.mark.parametrize(("receiver", "lost"), [(True, Px4Mode.POSITION), (False, Px4Mode.HOLD)])
def test_a_lost_signal_leads_out_and_one_that_is_back_leads_in_again(
    bench: MakeBench, receiver: bool, lost: Px4Mode
) -> None:
    boat = offboard(bench, receiver=receiver)
    boat.run(OFFBOARD_LOSS_S + 1.2)
    assert mode(boat) is lost
    assert boat.last("HEARTBEAT").system_status == dialect.MAV_STATE_CRITICAL
    stream(boat, 1.2, setpoint(0.0, 4.0))
    assert mode(boat) is Px4Mode.OFFBOARD
    assert wish(boat, Px4Mode.MANUAL) == dialect.MAV_RESULT_ACCEPTED
    stream(boat, 1.2, setpoint(0.0, 4.0))
    assert mode(boat) is Px4Mode.MANUAL, "a human's mode stays"
