"""`--steer offboard` in lockstep with the simulated PX4: order, mode, proof, turn, human, silence, and the way out."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import BadLine, Lockstep, keep_packets
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.cli.run import with_offboard_speed
from autopilot.control.registry import TRIAL_LAW
from autopilot.errors import InputError
from autopilot.signals import Mode, Order
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.px4 import OFFBOARD_LOSS_S, Px4, Px4Mode

SPEED = 4.0


def offboard_vessel() -> Vessel:
    boat = load_vessel("lanxin")
    return dataclasses.replace(boat, helm=dataclasses.replace(boat.helm, method="offboard", offboard_speed_m_s=SPEED))


def lockstep(firmware: str = "px4-1.17", vessel: Vessel | None = None, **options: Any) -> Lockstep:
    return Lockstep(vessel or offboard_vessel(), law=TRIAL_LAW, vehicle={"firmware": firmware}, **options)


def px4(boat: Lockstep) -> Px4:
    assert isinstance(boat.firmware, Px4)
    return boat.firmware


def engaged(**options: Any) -> Lockstep:
    """A boat under way in Manual, whose human orders a heading and gives Offboard."""
    boat = lockstep(**options)
    boat.run(1.0)
    boat.engage(90.0)
    boat.run(1.5)
    assert px4(boat).set_mode(Px4Mode.OFFBOARD)
    assert boat.run(20.0, until=boat.engaged), words_of(boat.tick)
    boat.run(2.0)
    return boat


def velocities(kept: list[Any]) -> list[tuple[float, Any]]:
    return [(time, message) for time, message in kept if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"]


def pace(message: Any) -> float:
    return math.hypot(message.vx, message.vy)


def test_a_turn_is_led_and_the_heading_held_at_the_speed_ordered() -> None:
    boat = lockstep()
    kept = keep_packets(boat)
    boat.run(1.0)
    assert not velocities(kept), "nothing is sent before an order"
    assert not px4(boat).set_mode(Px4Mode.OFFBOARD), "and so PX4 refuses the mode"
    boat.engage(90.0)
    boat.run(1.5)
    assert "in mode Manual, where heading targets are not obeyed; switch it to Offboard" in words_of(boat.tick)[0]
    waiting = velocities(kept)
    assert {pace(message) < 1.0e-7 for _, message in waiting} == {True}
    assert math.atan2(waiting[-1][1].vy, waiting[-1][1].vx) == pytest.approx(0.0, abs=0.02), "the present heading"
    gaps = [later - sooner for sooner, later in itertools.pairwise(time for time, _ in waiting)]
    assert max(gaps) < 0.25
    assert px4(boat).set_mode(Px4Mode.OFFBOARD)
    assert boat.run(20.0, until=boat.engaged), words_of(boat.tick)
    boat.run(25.0)
    assert (boat.tick.mode, words_of(boat.tick)) == (Mode.ENGAGED, ())
    assert math.degrees(boat.world.boat.state.heading) == pytest.approx(90.0, abs=1.5)
    assert boat.world.boat.state.speed == pytest.approx(SPEED, rel=0.1)
    sent = velocities(kept)
    assert {(m.target_system, m.target_component, m.coordinate_frame, m.type_mask) for _, m in sent} == {
        (1, 1, dialect.MAV_FRAME_LOCAL_NED, 0xDC7)
    }
    gaps = [later - sooner for sooner, later in itertools.pairwise(time for time, _ in sent)]
    assert max(gaps) < 0.35
    kinds = {message.get_type() for _, message in kept if message.get_srcComponent() == 191}
    assert not kinds & {"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL", "SET_ATTITUDE_TARGET", "SET_MODE"}
    commands = {message.command for _, message in kept if message.get_type() == "COMMAND_LONG"}
    assert dialect.MAV_CMD_DO_SET_MODE not in commands, "the mode is a human's to change"


def test_not_engaged_on_a_vehicle_that_does_not_turn_to_our_velocities() -> None:
    boat = lockstep()
    boat.run(1.0)
    boat.engage(90.0)
    boat.run(1.5)
    assert px4(boat).set_mode(Px4Mode.OFFBOARD)
    px4(boat)._angle_max = math.inf  # no rudder comes of it
    boat.run(18.0)
    assert {tick.mode for tick in boat.ticks} == {Mode.STANDBY}
    assert "it does not turn to their side" in words_of(boat.tick)[0]
    boat.run(1.0)
    assert math.hypot(*px4(boat)._velocity) < 1.0e-7, "it is not driven on"


def test_a_boat_that_makes_no_way_is_not_engaged(monkeypatch: pytest.MonkeyPatch) -> None:
    boat = lockstep()
    boat.firmware.sticks[2] = 1500
    boat.run(20.0)
    boat.engage(0.0)
    boat.run(1.5)
    assert px4(boat).set_mode(Px4Mode.OFFBOARD)
    monkeypatch.setattr(Px4, "_follow_target", lambda *_: (0, 0))
    boat.run(8.0)
    px4(boat).set_mode(Px4Mode.MANUAL)
    boat.run(6.0)
    assert px4(boat).set_mode(Px4Mode.OFFBOARD)
    boat.run(3.0)
    assert "it makes way and swings" in words_of(boat.tick)[0], "the run up begins anew"
    boat.run(11.0)
    assert boat.tick.mode is Mode.STANDBY
    assert "makes no way on our velocities" in words_of(boat.tick)[0]


@pytest.mark.parametrize("taken", ["mode", "disarmed"])
def test_the_human_takes_the_helm_and_keeps_it(taken: str) -> None:
    boat = engaged()
    if taken == "mode":
        assert px4(boat).set_mode(Px4Mode.MANUAL)
    else:
        assert px4(boat).set_armed(False)
    assert boat.run(1.5, until=lambda tick: tick.mode is Mode.OVERRIDE)
    kept = keep_packets(boat)
    boat.run(3.0)
    assert not velocities(kept)
    assert not px4(boat).armed or not px4(boat).set_mode(Px4Mode.OFFBOARD), "no signal, no Offboard"
    boat.run(3.0)
    assert boat.tick.mode is Mode.OVERRIDE


def test_a_kill_switch_takes_the_helm_though_the_vehicle_counts_as_armed(monkeypatch: pytest.MonkeyPatch) -> None:
    boat = engaged()
    monkeypatch.setattr("sitl.telemetry._state", lambda firmware: dialect.MAV_STATE_FLIGHT_TERMINATION)
    assert boat.run(1.5, until=lambda tick: tick.mode is Mode.OVERRIDE)
    assert "kill switch" in words_of(boat.tick)[0]


def test_standing_by_orders_no_speed_first_and_then_ends_the_signal() -> None:
    boat = engaged()
    kept = keep_packets(boat)
    boat.order = Order(serial=9)
    boat.run(1.0)
    sent = velocities(kept)
    ended = [message for time, message in sent if pace(message) < 1.0e-7]
    assert len(ended) >= 3
    assert pace(sent[-1][1]) < 1.0e-7
    boat.run(OFFBOARD_LOSS_S + 0.5)
    assert px4(boat).custom_mode == Px4Mode.POSITION
    assert len(velocities(kept)) == len(sent)


def test_leaving_stops_the_boat_and_says_what_follows() -> None:
    boat = engaged()
    boat.link.release(boat.now)
    boat.carry(boat.now)
    assert math.hypot(*px4(boat)._velocity) < 1.0e-7
    released = boat.link.release_result(boat.now)
    assert released is not None
    assert "COM_OBL_RC_ACT" in released.lapse


def test_a_silent_line_ends_in_px4s_own_timeout_and_is_not_taken_up_again() -> None:
    up, down = BadLine(), BadLine()
    boat = engaged(lines=(up, down))
    carries = up.put, down.put
    up.put = down.put = lambda now, data: None  # type: ignore[method-assign]
    boat.run(OFFBOARD_LOSS_S + 0.3)
    assert px4(boat).custom_mode == Px4Mode.POSITION
    boat.run(6.0)
    assert boat.tick.mode is Mode.OVERRIDE
    up.put, down.put = carries  # type: ignore[method-assign]
    boat.run(6.0)
    assert (boat.tick.mode, px4(boat).custom_mode) == (Mode.OVERRIDE, Px4Mode.POSITION)


def test_ardurover_is_refused_and_nothing_is_sent() -> None:
    boat = lockstep("4.6")
    kept = keep_packets(boat)
    boat.engage(90.0)
    boat.run(4.0)
    assert boat.tick.mode is Mode.STANDBY
    assert "does not run PX4" in words_of(boat.tick)[0]
    assert not [message for _, message in velocities(kept) if message.get_srcComponent() == 191]


def test_a_vehicle_that_another_keeps_in_offboard_is_not_engaged() -> None:
    boat = lockstep()

    def drive(bench: Lockstep) -> None:
        px4(bench).go(1.0, 0.0, bench.now)

    boat.hooks.append(drive)
    boat.run(1.0)
    assert px4(boat).set_mode(Px4Mode.OFFBOARD)
    boat.run(1.5)
    kept = keep_packets(boat)
    boat.engage(90.0)
    boat.run(6.0)
    assert {tick.mode for tick in boat.ticks} == {Mode.STANDBY}
    assert "another companion or ground station sends setpoints" in words_of(boat.tick)[0]
    assert not velocities(kept)


def test_the_speed_to_go_at_must_be_given_and_is_of_offboard_alone() -> None:
    boat = load_vessel("lanxin")
    offboard = dataclasses.replace(boat, helm=dataclasses.replace(boat.helm, method="offboard"))
    with pytest.raises(InputError, match="add --offboard-speed-m-s"):
        with_offboard_speed(offboard, None)
    assert with_offboard_speed(offboard, 1.5).helm.offboard_speed_m_s == 1.5
    assert with_offboard_speed(offboard_vessel(), None) == offboard_vessel()
    with pytest.raises(InputError, match="only with --steer offboard"):
        with_offboard_speed(boat, 1.5)
    with pytest.raises(ValueError, match="offboard speed"):
        lockstep(vessel=offboard)
