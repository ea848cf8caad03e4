"""Three endings on a flight controller set up by the shipped file: left in good order, killed, radio dead."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import STEP, BadLine, Lockstep

from autopilot.firmware.file import load_firmware, wanted_parameters
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.signals import Mode
from autopilot.vessel.file import load_vessel
from sitl.scenario import FaultSection, Scenario

VESSEL = load_vessel("lanxin")
SHIPPED = {wanted.name: float(wanted.value) for wanted in wanted_parameters(load_firmware("ardurover-boat"))}
MANUAL, HOLD = 0, 4


def engaged(vehicle: dict[str, Any] | None = None, **parameters: float) -> Lockstep:
    """Return a boat with the shipped parameters, held on a course for some seconds."""
    run = Lockstep(VESSEL, parameters={**SHIPPED, **parameters}, vehicle=vehicle)
    run.engage(20.0)
    assert run.run(20.0, run.engaged)
    assert not run.run(12.0, lambda tick: tick.mode is not Mode.ENGAGED)
    return run


def without_us(run: Lockstep, seconds: float) -> None:
    """Go on with a vehicle to which nobody speaks any more."""
    for _ in range(round(seconds / STEP)):
        run.clock.time = round(run.clock.time + STEP, 9)
        run.far.receive()
        run.vehicle.advance(run.now)
        run.vehicle.transmit(run.now)


def said(run: Lockstep) -> list[str]:
    return [text for _, text in run.firmware.notices]


def test_left_in_good_order_a_hand_in_manual_goes_on_steering() -> None:
    run = engaged()
    before = said(run)
    run.link.release(run.now)
    run.carry(run.now)
    for stick in (1800, 1200):
        run.firmware.sticks[0] = stick
        without_us(run, 20.0)
        assert run.firmware.channels[0] == stick
    assert (run.firmware.mode, run.firmware.armed, run.firmware.failsafe) == (MANUAL, True, "")
    assert said(run) == before


def test_killed_the_stick_has_the_rudder_after_the_override_s_time_and_keeps_it() -> None:
    run = engaged()
    run.firmware.sticks[0] = 1700
    without_us(run, 0.9)
    assert run.firmware.channels[0] != 1700
    without_us(run, 0.3)
    assert run.firmware.channels[0] == 1700
    without_us(run, 20.0)
    assert (run.firmware.mode, run.firmware.armed, run.firmware.channels[0]) == (MANUAL, True, 1700)


def test_killed_without_a_receiver_the_boat_stops() -> None:
    run = Lockstep(VESSEL, parameters=SHIPPED, vehicle={"receiver": False})
    run.engage(20.0)
    assert run.run(20.0, run.engaged)
    without_us(run, 6.0)
    assert (run.firmware.mode, run.firmware.armed, run.firmware.throttle) == (HOLD, True, 0)
    assert run.firmware.servos[0] == 1500


def test_killed_where_nobody_holds_the_radio_the_station_s_failsafe_stops_the_boat() -> None:
    run = engaged(FS_GCS_ENABLE=1)
    without_us(run, 8.0)
    assert (run.firmware.mode, run.firmware.throttle) == (HOLD, 0)


def lost_radio(run: Lockstep, seconds: float) -> bool:
    ended: bool = run.run(seconds, lambda tick: tick.mode is not Mode.ENGAGED)
    return ended


def test_low_throttle_from_a_lost_radio_releases_at_once_and_stops() -> None:
    run = engaged()
    run.firmware.sticks[2] = 900
    assert lost_radio(run, 1.0)
    assert run.tick.mode is Mode.OVERRIDE
    assert words_of(run.tick)[0].startswith("overridden: the radio is lost: ")
    assert "FS_THR_VALUE" in words_of(run.tick)[0]
    run.run(5.0)
    assert (run.firmware.mode, run.firmware.throttle) == (HOLD, 0)
    assert "Radio Failsafe" in said(run)
    run.engage(40.0)
    assert not run.run(10.0, run.engaged), "no engaging without a radio"
    run.firmware.sticks[2] = 1750
    run.run(3.0)
    run.firmware.set_mode(MANUAL)
    run.engage(40.0)
    assert run.run(20.0, run.engaged), "the radio is back"


def test_an_rssi_that_falls_to_nothing_releases_and_the_firmware_stops_the_boat() -> None:
    run = engaged(RSSI_TYPE=1)
    run.firmware.receiver = run.firmware.has_receiver = False
    assert lost_radio(run, 2.5)
    assert "the radio is lost" in words_of(run.tick)[0]
    run.run(6.0)
    assert (run.firmware.mode, run.firmware.throttle) == (HOLD, 0)


def test_a_receiver_that_just_falls_silent_cannot_be_seen_while_we_steer() -> None:
    """The page says so: the firmware neither acts nor shows anything."""
    run = engaged()
    run.firmware.receiver = run.firmware.has_receiver = False
    assert not lost_radio(run, 30.0)
    assert run.firmware.mode == MANUAL
    run.link.release(run.now)
    without_us(run, 5.0)
    assert run.firmware.mode == HOLD, "it acts as soon as nobody steers"


def test_with_the_radio_s_failsafe_off_its_loss_is_nobody_s_business() -> None:
    run = engaged(FS_THR_ENABLE=0, RSSI_TYPE=1)
    run.firmware.receiver = run.firmware.has_receiver = False
    assert not lost_radio(run, 10.0)


@pytest.mark.parametrize(("version", "options", "ends"), [("4.6", 32, False), ("4.8", 32 + (1 << 14), True)])
def test_the_steering_stick_takes_the_helm_where_the_firmware_lets_it(version: str, options: int, ends: bool) -> None:
    run = engaged({"firmware": version}, RC_OPTIONS=options, RC7_OPTION=46)
    run.firmware.sticks[0] = 2000
    assert lost_radio(run, 0.5) is ends
    run.run(3.0)
    if not ends:
        assert run.tick.mode is Mode.ENGAGED, "an overridden stick is not seen: the page says so"
        return
    assert run.tick.mode is Mode.OVERRIDE
    assert "the stick was moved" in words_of(run.tick)[0]
    assert "switch" in words_of(run.tick)[0]
    assert run.firmware.channels[0] == 2000
    run.firmware.sticks[0], run.firmware.sticks[6] = 1500, 1000
    run.run(1.0)
    run.firmware.sticks[6] = 2000
    run.engage(40.0)
    assert run.run(20.0, run.engaged), "the switch gives the helm back"


def test_a_steering_stick_mixed_into_the_yaw_channel_takes_the_helm() -> None:
    """What the page recommends for firmware before 4.8: the transmitter sends the stick on RCMAP_YAW's channel too."""
    run = engaged()
    run.firmware.sticks[0] = run.firmware.sticks[3] = 1800
    assert lost_radio(run, 0.5)
    assert "the stick on RC channel 4 was moved" in words_of(run.tick)[0]


def test_hard_to_port_at_rest_does_not_disarm() -> None:
    run = engaged()
    run.firmware.sticks[2] = 1500
    run.engage(-150.0)
    run.run(30.0)
    assert run.firmware.armed


@pytest.mark.parametrize("ends", [(1000, 2000), (1100, 1900), (1200, 2000)])
def test_the_rudder_is_what_is_believed_whatever_the_servo_s_end_points_are(ends: tuple[int, int]) -> None:
    boat = replace(VESSEL, rudder=replace(VESSEL.rudder, angle_max_deg=15.0))
    servo = {"SERVO1_MIN": float(ends[0]), "SERVO1_MAX": float(ends[1])}
    run = Lockstep(boat, parameters={**SHIPPED, **servo})
    run.engage(60.0)
    apart: list[float] = []
    run.hooks.append(lambda it: apart.append(it.world.boat.state.rudder - it.ticks[-1].state.rudder if it.ticks else 0))
    assert run.run(20.0, run.engaged)
    run.run(10.0)
    orders = [tick.command.angle for tick in run.ticks]
    assert max(orders) > math.radians(10.0), "it turned"
    assert max(map(abs, apart)) < math.radians(2.0)


def test_a_servo_that_stops_short_of_what_may_be_ordered_is_not_steered() -> None:
    run = Lockstep(VESSEL, parameters={**SHIPPED, "SERVO1_MIN": 1100.0, "SERVO1_MAX": 1900.0})
    run.engage(20.0)
    assert not run.run(20.0, run.engaged)
    assert any("is 24 deg of rudder" in alarm for alarm in words_of(run.tick)), words_of(run.tick)


def test_a_compass_that_the_vehicle_doubts_is_an_alarm_while_steering_goes_on() -> None:
    scenario = Scenario(1, "iron", faults=(FaultSection("compass_variance", 20.0, 35.0, size=1.4),))
    run = Lockstep(VESSEL, parameters=SHIPPED, scenario=scenario)
    run.engage(20.0)
    run.run(50.0)
    shown = [tick.now for tick in run.ticks if "compass_doubtful" in {alarm.name for alarm in tick.alarms}]
    assert 23.0 <= shown[0] <= 24.6 and 35.0 <= shown[-1] <= 36.5
    assert {tick.mode for tick in run.ticks if tick.now > 20.0} == {Mode.ENGAGED}


def test_a_vehicle_in_its_fail_safe_is_an_alarm_as_long_as_it_is() -> None:
    run = engaged(FS_ACTION=0.0)
    run.firmware.failsafe = "battery"
    run.run(2.0)
    assert [alarm.name for alarm in run.tick.alarms] == ["vehicle_failsafe"]
    assert run.tick.mode is Mode.ENGAGED
    run.firmware.failsafe = ""
    run.run(2.0)
    assert words_of(run.tick) == ()


class WithoutHeadings(BadLine):
    """Loses every ATTITUDE from a time [s] on until another; behind that all but one of so many."""

    def __init__(self, since: float, until: float = math.inf, one_of: int = 1) -> None:
        super().__init__()
        self._since, self._until, self._one_of = since, until, one_of
        self._come = 0

    def put(self, now: float, data: bytes) -> None:
        """Send a datagram at `now` [s]."""
        if now >= self._since and "ATTITUDE" in {message.get_type() for message in MavlinkCodec().decode(data)}:
            self._come += 1
            if now < self._until or self._come % self._one_of:
                return
        super().put(now, data)


def test_an_order_behind_a_fail_safe_proves_the_helm_and_takes_it_from_nobody() -> None:
    run = Lockstep(VESSEL, parameters=SHIPPED, lines=(BadLine(), WithoutHeadings(10.0)))
    run.engage(20.0)
    assert run.run(20.0, run.engaged)
    assert run.run(20.0, lambda tick: tick.mode is Mode.FAILSAFE)
    run.run(VESSEL.failsafe.release_after_s + 2.0)
    assert not run.firmware.overrides.active(run.now, 3.0), "the fail-safe has let go"
    run.engage(30.0)
    assert not run.run(10.0, lambda tick: tick.mode is Mode.OVERRIDE), words_of(run.tick)


@pytest.mark.parametrize("one_of", [1, 20])
def test_an_order_behind_a_fail_safe_waits_for_headings_that_come_back(one_of: int) -> None:
    run = Lockstep(VESSEL, parameters=SHIPPED, lines=(BadLine(), WithoutHeadings(10.0, 24.1, one_of)))
    run.engage(20.0)
    assert run.run(20.0, run.engaged)
    assert run.run(20.0, lambda tick: tick.mode is Mode.FAILSAFE)
    run.run(22.0 - run.now)
    run.engage(30.0)
    assert run.run(10.0, run.engaged) is (one_of == 1), words_of(run.tick)
    assert run.tick.mode is not Mode.OVERRIDE, words_of(run.tick)
