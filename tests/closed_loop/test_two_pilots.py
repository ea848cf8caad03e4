"""Two pilots on one boat: the second does not engage, and both report it."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import BadLine, Lockstep
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.overrides import CHECKED_ON_ENGAGING
from autopilot.links.rudder_order import RELEASES
from autopilot.signals import HelmCause, HelmSample, Mode, Order, OrderKind
from autopilot.vessel.file import load_vessel
from sitl.wire_mavlink import MavlinkVehicle

VESSEL = load_vessel("lanxin")


def alarms_of(boat: Lockstep, since: float) -> str:
    return " | ".join(alarm for tick in boat.ticks if tick.now > since for alarm in words_of(tick))


class TwoPilots:
    """A first pilot that steers, and a second on a port of its own of the same vehicle."""

    def __init__(
        self,
        routed: bool,
        method: str = "rc_override",
        starts_later: bool = False,
        engages: bool = True,
        **settings: Any,
    ) -> None:
        boat = dataclasses.replace(VESSEL, helm=dataclasses.replace(VESSEL.helm, method=method))  # type: ignore[arg-type]
        self.first = Lockstep(boat)
        self.second = Lockstep(boat, settings=settings)
        self.second.world, self.second.firmware = self.first.world, self.first.firmware
        self.second.vehicle = MavlinkVehicle(self.first.firmware)
        if not routed:
            self.first.firmware.ports.clear()
        if engages:
            self.first.engage(60.0)
        if starts_later:
            self.first.run(10.0)
            self.second.clock.time = self.first.now
        else:
            self.sail(10.0)
        assert (self.first.tick.mode is Mode.ENGAGED) == engages

    def sail(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.025)):
            self.first.run(0.025)
            self.second.run(0.025)

    @property
    def engaged(self) -> set[str]:
        pilots = {"first": self.first, "second": self.second}
        return {name for name, pilot in pilots.items() if pilot.tick.mode is Mode.ENGAGED}


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
def test_the_second_does_not_engage_and_both_say_so(method: str) -> None:
    both = TwoPilots(True, method)
    begun = both.first.now
    both.second.engage(120.0)
    both.sail(25.0)
    assert {tick.mode for tick in both.second.ticks} == {Mode.STANDBY}
    assert {tick.mode for tick in both.first.ticks if tick.now > begun} == {Mode.ENGAGED}, "the first goes on"
    assert "another pilot steers this boat" in alarms_of(both.second, begun)
    assert "another pilot wants to engage on this boat" in alarms_of(both.first, begun)


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
def test_where_nothing_is_passed_on_a_second_that_starts_later_finds_the_input_taken(method: str) -> None:
    both = TwoPilots(False, method, starts_later=True)
    begun = both.first.now
    both.second.engage(120.0)
    both.sail(20.0)
    assert {tick.mode for tick in both.second.ticks} == {Mode.STANDBY}
    assert both.engaged == {"first"}
    said = alarms_of(both.second, begun)
    assert "overrides the steering input" in said or "does not take our steering" in said


def test_when_the_first_stands_by_the_second_takes_the_boat() -> None:
    both = TwoPilots(True)
    both.second.engage(120.0)
    both.sail(5.0)
    both.first.order = both.first.order._replace(kind=both.first.order.kind.STANDBY, serial=9)
    both.sail(15.0)
    assert both.engaged == {"second"}


def test_forced_the_second_takes_the_helm_and_the_first_says_what_happened() -> None:
    both = TwoPilots(True, with_other_pilot=True)
    begun = both.first.now
    both.second.engage(120.0)
    both.sail(8.0)
    assert any(tick.mode is Mode.ENGAGED for tick in both.second.ticks)
    assert "two helms fight" in alarms_of(both.first, begun)


STATION = MavlinkCodec(255, 190)


def joystick(bench: Lockstep) -> None:
    """A hook: a ground station overrides the steering input five times a second."""
    if round(bench.now / 0.025) % 8 == 0:
        message = dialect.MAVLink_rc_channels_override_message(1, 1, 1700, *[65535] * 7, *[0] * 10)
        bench.vehicle.receive(bench.now, STATION.encode(message))


def test_a_ground_station_s_joystick_is_another_source_too() -> None:
    boat = Lockstep(VESSEL)
    boat.hooks.append(joystick)
    boat.engage(60.0)
    boat.run(20.0)
    assert {tick.mode for tick in boat.ticks} == {Mode.STANDBY}
    assert "RC channel 1" in words_of(boat.tick)[0]


def test_a_joystick_that_has_left_is_reported_no_more() -> None:
    boat = Lockstep(VESSEL)
    boat.hooks.append(joystick)
    boat.engage(60.0)
    boat.run(10.0)
    assert "overrides the steering input" in boat.link.session._reason
    boat.order = Order(OrderKind.STANDBY, serial=9)
    boat.run(5.0)
    boat.hooks.clear()
    boat.run(10.0)
    assert boat.link.session._reason == CHECKED_ON_ENGAGING
    since = boat.now
    boat.engage(60.0)
    assert boat.run(2.0, until=boat.engaged)
    assert "overrides" not in alarms_of(boat, since)


def test_our_own_pulses_late_on_a_slow_line_are_nobody_else_s() -> None:
    boat = Lockstep(VESSEL, lines=(BadLine(5, delay=0.5), BadLine(6, delay=0.4)))
    boat.run(10.0)
    for heading in (60.0, 100.0):
        since = boat.now
        boat.engage(heading)
        assert boat.run(4.0, until=boat.engaged)
        boat.run(4.0)
        assert "overrides" not in alarms_of(boat, since)
        boat.order = Order(OrderKind.STANDBY, serial=boat.order.serial + 1)
        boat.run(1.0)


def test_our_own_words_that_come_back_are_nobody_else_s() -> None:
    boat = Lockstep(VESSEL)
    receive = boat.vehicle.receive

    def echo(now: float, data: bytes) -> None:
        receive(now, data)
        boat.inject(data)

    boat.vehicle.receive = echo  # type: ignore[method-assign]
    boat.engage(60.0)
    boat.run(12.0)
    assert boat.tick.mode is Mode.ENGAGED
    assert words_of(boat.tick) == ()


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
@pytest.mark.parametrize("later", [1.0, 5.0])
def test_the_second_of_two_proved_pilots_does_not_engage(method: str, later: float) -> None:
    both = TwoPilots(False, method, engages=False)
    for pilot in (both.first, both.second):
        helms = [sample for tick in pilot.ticks for sample in tick.samples if isinstance(sample, HelmSample)]
        assert (helms[-1].cause, helms[-1].reason) == (HelmCause.UNPROVEN, CHECKED_ON_ENGAGING), "proved once"
    begun = both.first.now
    both.first.engage(60.0)
    both.sail(later)
    both.second.engage(120.0)
    both.sail(30.0)
    assert {tick.mode for tick in both.second.ticks} == {Mode.STANDBY}
    assert {tick.mode for tick in both.first.ticks if tick.now > begun + 1.0} == {Mode.ENGAGED}
    assert abs(math.degrees(both.first.tick.state.heading) - 60.0) < 3.0
    assert "overrides the steering input" in alarms_of(both.second, begun)
    said = alarms_of(both.first, begun)
    assert "overrides the steering input now and then" in said
    assert "slow" not in said


def test_a_fail_safe_that_has_let_go_is_not_taken_for_a_lost_helm_and_resumes() -> None:
    boat = Lockstep(dataclasses.replace(VESSEL, failsafe=dataclasses.replace(VESSEL.failsafe, resume=True)))
    boat.engage(60.0)
    boat.run(15.0)
    assert boat.tick.mode is Mode.ENGAGED
    boat.down = BadLine(1, loss=1.0)
    assert boat.run(2.9, until=lambda tick: tick.mode is Mode.FAILSAFE)
    boat.down = BadLine()
    boat.run(10.0)
    assert boat.tick.mode is Mode.ENGAGED, boat.tick.alarms


@pytest.mark.parametrize("rate_hz", [5.3, 7.0, 9.0, 24.0])
def test_a_hand_at_a_ground_station_gets_the_rudder_within_five_seconds(rate_hz: float) -> None:
    """A joystick there, whose pulses come between ours, and at no whole share of the reports' rate."""
    boat = Lockstep(VESSEL)
    boat.engage(60.0)
    boat.run(20.0)
    assert boat.tick.mode is Mode.ENGAGED
    codec, advance, begun = MavlinkCodec(255, 190), boat.vehicle.advance, boat.now
    sent = 0

    def advance_after_the_hand(now: float) -> None:
        nonlocal sent
        if now >= begun + sent / rate_hz:
            sent += 1
            pulses = [1700, *[65535] * 7, *[0] * 10]
            boat.vehicle.receive(now, codec.encode(dialect.MAVLink_rc_channels_override_message(1, 1, *pulses)))
        advance(now)

    boat.vehicle.advance = advance_after_the_hand  # type: ignore[method-assign]
    assert boat.run(5.5, lambda tick: tick.mode is Mode.OVERRIDE)
    boat.run(10.0)
    assert boat.tick.mode is Mode.OVERRIDE and boat.firmware.channels[0] == 1700


def released_by(boat: Lockstep) -> list[float]:
    """Return a list of the times at which the boat's own pilot releases the steering input from now on."""
    times: list[float] = []
    receive, reader = boat.vehicle.receive, MavlinkCodec()

    def received(now: float, data: bytes) -> None:
        found = [message for message in reader.decode(data) if message.get_type() == "RC_CHANNELS_OVERRIDE"]
        times.extend(now for message in found if message.chan1_raw == 0)
        receive(now, data)

    boat.vehicle.receive = received  # type: ignore[method-assign]
    return times


@pytest.mark.parametrize("heading_deg", [60.0, 66.0])
def test_who_steers_after_the_first_stood_by_keeps_the_helm_though_its_orders_look_like_the_first_s(
    heading_deg: float,
) -> None:
    both = TwoPilots(True)
    both.sail(3.0)
    both.first.order = Order(OrderKind.STANDBY, serial=9)
    both.sail(0.6)
    times = released_by(both.first)
    both.second.engage(heading_deg)
    both.sail(6.0)
    assert both.engaged == {"second"}
    assert times == []


@pytest.mark.parametrize("heading_deg", [66.0, 75.0, 120.0])
def test_who_takes_the_helm_from_the_first_keeps_it(heading_deg: float) -> None:
    both = TwoPilots(True, with_other_pilot=True)
    times = released_by(both.first)
    both.second.engage(heading_deg)
    both.sail(10.0)
    assert both.engaged == {"second"}
    assert len(times) == RELEASES, "its own rudder, given back once"


def test_a_joystick_that_stands_where_our_rudder_stood_is_left_the_helm() -> None:
    """Its orders are taken for late ones of ours for a moment, as nobody says whose they are; then no more."""
    boat = Lockstep(VESSEL)
    boat.engage(60.0)
    assert boat.run(12.0, until=boat.engaged)
    boat.run(5.0)
    pulse = boat.link.session._output.commanded_pulse
    boat.order = Order(OrderKind.STANDBY, serial=9)
    boat.run(1.0)
    times, without, begun = released_by(boat), 0, boat.now

    def steers(bench: Lockstep) -> None:
        if round(bench.now / 0.025) % 4 == 0:
            message = dialect.MAVLink_rc_channels_override_message(1, 1, pulse, *[65535] * 7, *[0] * 10)
            bench.vehicle.receive(bench.now, STATION.encode(message))

    boat.hooks.append(steers)
    for _ in range(240):
        boat.run(0.025)
        without += not boat.firmware.overrides.active(boat.now, 3.0)
    assert times[-1] - begun < 2.0, "and no more"
    assert without * 0.025 < 1.0
