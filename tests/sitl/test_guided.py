"""The simulated ArduRover in GUIDED mode: what it takes for a target, from whom, how it steers, and when it stops."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

MakeBench = Callable[..., Any]
RATES_IGNORED = 7
THROTTLE_IGNORED = 64
GOOD_GAINS = {"ATC_STR_RAT_FF": 12.0, "ATC_STR_RAT_P": 1.0, "ATC_STR_RAT_I": 1.0, "ATC_STR_ANG_P": 1.0}


def target(heading_deg: float, mask: int = RATES_IGNORED, rate: float = 0.0, thrust: float = 0.0) -> Any:
    half = 0.5 * math.radians(heading_deg)
    turn = [math.cos(half), 0.0, 0.0, math.sin(half)]
    return dialect.MAVLink_set_attitude_target_message(0, 1, 1, mask, turn, 0.0, 0.0, rate, thrust)


def steer(boat: Any, seconds: float, message: Any, system: int | None = None) -> None:
    for _ in range(round(seconds / 0.5)):
        boat.send(message, system)
        boat.run(0.5)


def guided(bench: MakeBench, **sections: Any) -> Any:
    boat = bench(vehicle={"mode": "GUIDED"}, **sections)
    for name, value in GOOD_GAINS.items():
        boat.parameter_set(name, value)
    return boat


def reported(boat: Any) -> tuple[int, int]:
    last = boat.last("NAV_CONTROLLER_OUTPUT")
    return last.nav_bearing, last.target_bearing


@pytest.mark.parametrize(("firmware", "echo"), [("4.5", 0), ("4.6", 0), ("4.7", 0), ("4.8", 60)])
def test_only_the_newest_firmware_reports_the_heading_that_it_holds(bench: MakeBench, firmware: str, echo: int) -> None:
    boat = bench(vehicle={"mode": "GUIDED", "firmware": firmware}, start={"heading_deg": 200.0})
    boat.run(1.5)
    assert reported(boat) == (200, 200), "without a target the boat loiters"
    steer(boat, 1.5, target(60.0))
    nav, place = reported(boat)
    assert nav == pytest.approx(echo, abs=1)
    assert place == 0
    boat.run(4.5)
    texts = [message.text for message in boat.of("STATUSTEXT")]
    assert texts == [f"target not received last {'3.0 ' if echo else '3'}secs, stopping"]
    assert reported(boat)[1] != 0


@pytest.mark.parametrize("system", [1, 77, 255])
@pytest.mark.parametrize("heading", [60.0, -100.0])
def test_a_heading_target_of_anybody_is_steered(bench: MakeBench, system: int, heading: float) -> None:
    boat = guided(bench)
    steer(boat, 20.0, target(heading), system)
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(heading, abs=1.5)
    assert reported(boat) == (0, 0)
    assert boat.world.boat.state.speed == pytest.approx(boat.world.cruise_speed, rel=0.05), "the stick's speed"


def test_only_the_ground_station_is_heard_where_that_is_enforced(bench: MakeBench) -> None:
    boat = guided(bench)
    boat.parameter_set("SYSID_ENFORCE", 1)
    steer(boat, 10.0, target(60.0), system=1)
    assert abs(math.degrees(boat.world.boat.state.heading)) < 2.0
    steer(boat, 20.0, target(60.0), system=255)
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(60.0, abs=1.5)


@pytest.mark.parametrize(
    "message", [target(60.0, mask=RATES_IGNORED | THROTTLE_IGNORED), target(math.nan), target(60.0, thrust=math.inf)]
)
def test_what_is_no_target_is_ignored_in_silence(bench: MakeBench, message: Any) -> None:
    boat = guided(bench)
    steer(boat, 5.0, message)
    assert boat.firmware.guided.target is None
    assert boat.steering_pulse == 1500
    assert not boat.of("COMMAND_ACK")


def test_no_target_counts_in_another_mode_or_survives_a_change_of_mode(bench: MakeBench) -> None:
    boat = bench()
    steer(boat, 3.0, target(60.0))
    assert boat.firmware.guided.target is None
    assert not boat.of("NAV_CONTROLLER_OUTPUT")
    boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, 15)
    steer(boat, 1.0, target(60.0))
    assert boat.firmware.guided.target is not None
    boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, 4)
    boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, 15)
    assert boat.firmware.guided.target is None


def test_an_armed_boat_without_a_position_does_not_go_guided(bench: MakeBench) -> None:
    boat = bench(vehicle={"position_after_s": 5.0})
    assert boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, 15).result == dialect.MAV_RESULT_FAILED
    boat.run(5.0)
    assert boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, 15).result == dialect.MAV_RESULT_ACCEPTED


def test_after_three_seconds_without_a_target_the_boat_stops(bench: MakeBench) -> None:
    boat = guided(bench)
    steer(boat, 4.0, target(90.0))
    boat.run(2.4)
    assert boat.steering_pulse != 1500
    boat.run(0.8)
    assert boat.steering_pulse == 1500
    assert [m.text for m in boat.of("STATUSTEXT")] == ["target not received last 3secs, stopping"]
    boat.run(20.0)
    assert boat.world.boat.state.speed < 0.2
    assert boat.last("HEARTBEAT").custom_mode == 15


@pytest.mark.parametrize(("stick", "thrust", "share"), [(1530, 0.5, 0.5), (2000, 0.5, 2.0), (1530, 0.0, 0.0)])
def test_the_speed_is_the_thrust_s_or_the_stick_s_whichever_is_more(
    bench: MakeBench, stick: int, thrust: float, share: float
) -> None:
    boat = guided(bench)
    boat.firmware.sticks[2] = stick
    steer(boat, 40.0, target(0.0, thrust=thrust))
    assert boat.world.boat.state.speed == pytest.approx(share * boat.world.cruise_speed, abs=0.1)


def test_without_the_mask_of_the_yaw_rate_a_turn_rate_is_steered(bench: MakeBench) -> None:
    boat = guided(bench)
    steer(boat, 10.0, target(0.0, mask=3, rate=-0.1))
    assert boat.world.boat.state.rate == pytest.approx(-0.1, rel=0.1)
    assert boat.last("NAV_CONTROLLER_OUTPUT").nav_bearing == 0


def test_the_rate_limits_of_the_parameters_hold(bench: MakeBench) -> None:
    boat = guided(bench)
    boat.parameter_set("ATC_STR_RAT_MAX", 5.0)
    steer(boat, 8.0, target(170.0))
    assert math.degrees(boat.world.boat.state.rate) == pytest.approx(5.0, abs=0.7)


def test_the_integral_finds_the_rudder_that_a_crooked_boat_needs(bench: MakeBench) -> None:
    boat = guided(bench, wind={"speed_m_s": 12.0, "from_deg": 50.0})
    steer(boat, 40.0, target(0.0))
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(0.0, abs=1.5)
    assert abs(boat.steering_pulse - 1500) > 5
