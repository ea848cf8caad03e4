"""Steering over bad lines: lost, doubled, overtaken, split, joined and damaged datagrams, and strangers on the line.

Everything is seeded, so each run is the same. What is asked of every line: the boat turns and holds its heading, no
value comes in that was not measured, the helm is not given up without a cause, and the rudder is free at the end.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import BadLine, Lockstep, StalledLine, StragglingLine, stick_follows
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import wrap
from autopilot.control.registry import TRIAL_LAW
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.nmea.link import NmeaLink
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.runtime.build import build_pilot
from autopilot.runtime.build_links import nmea_settings_of
from autopilot.signals import HeadingSample, HelmSample, Mode, Order, OrderKind, RudderSample, Tick
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.scenario import load_scenario
from sitl.wire_nmea import NmeaInstruments
from sitl.world import World

GAINS = {"ATC_STR_RAT_FF": 12.0, "ATC_STR_RAT_P": 1.0, "ATC_STR_RAT_I": 1.0, "ATC_STR_ANG_P": 1.0}
LINES: dict[str, dict[str, float]] = {
    "5 % lost": {"loss": 0.05},
    "30 % lost": {"loss": 0.3},
    "doubled": {"double": 0.5},
    "overtaken": {"delay": 0.15},
    "split": {"split": 0.2},
    "joined": {"join": 0.4},
    "cut short": {"cut": 0.2},
    "all at once": {"loss": 0.05, "double": 0.1, "delay": 0.08, "split": 0.05, "join": 0.1, "cut": 0.05},
}


def vessel_for(method: str) -> Vessel:
    boat = load_vessel("lanxin")
    return dataclasses.replace(boat, helm=dataclasses.replace(boat.helm, method=method))  # type: ignore[arg-type]


def bench(method: str, lines: Any = (), is_stream: bool = False, **settings: Any) -> Lockstep:
    boat = Lockstep(
        vessel_for(method),
        law=TRIAL_LAW if method == "guided" else None,
        vehicle={"mode": "GUIDED" if method == "guided" else "MANUAL"},
        parameters=GAINS,
        lines=lines,
        is_stream=is_stream,
        settings=settings,
    )
    if method == "guided":
        boat.hooks.append(stick_follows)
    return boat


class Truth:
    """The boat's heading over time, to compare what comes in with what was."""

    def __init__(self, boat: Lockstep) -> None:
        self.headings: list[float] = []
        boat.world.watchers.append(lambda time: self.headings.append(boat.world.boat.state.heading))

    def at(self, time: float) -> float:
        return self.headings[min(max(round(time / 0.01) - 1, 0), len(self.headings) - 1)]


def assert_only_what_was_measured(boat: Lockstep, truth: Truth, younger: float) -> int:
    """Each heading is the boat's of the time it claims: a line's delay makes a heading `younger` [s] at most."""
    fastest = max(abs(tick.state.rate) for tick in boat.ticks) + 0.02
    count = 0
    for tick in boat.ticks:
        for sample in tick.samples:
            if isinstance(sample, HeadingSample):
                count += 1
                error = abs(wrap(sample.heading - truth.at(sample.time)))
                assert error < math.radians(1.5) + younger * fastest
            elif isinstance(sample, RudderSample):
                assert abs(sample.angle) <= math.radians(30.1)
    return count


def assert_held(boat: Lockstep, heading_deg: float, since: float, within_deg: float = 3.0) -> None:
    late = [tick for tick in boat.ticks if tick.now > since]
    assert {tick.mode for tick in late} == {Mode.ENGAGED}, {words_of(tick) for tick in late}
    errors = [abs(wrap(tick.state.heading - math.radians(heading_deg))) for tick in late]
    assert math.degrees(max(errors)) < within_deg
    assert math.degrees(abs(wrap(boat.world.boat.state.heading - math.radians(heading_deg)))) < within_deg


def assert_released_at_the_end(boat: Lockstep, waits: float) -> None:
    """The way out: the session closes, what it sent still crosses the line, and the rudder is amidships."""
    boat.link.release(boat.now)
    for _ in range(round(waits / 0.1)):
        boat.clock.time = round(boat.clock.time + 0.1, 9)
        boat.carry(boat.now)
    assert boat.firmware.servos[0] == 1500
    assert not boat.firmware.overrides.active(boat.now, 3.0)


@pytest.mark.parametrize(
    ("name", "method"),
    [*((name, "rc_override") for name in LINES), ("30 % lost", "guided"), ("all at once", "guided")],
)
def test_a_heading_is_changed_and_held_over_a_bad_line(name: str, method: str) -> None:
    lines = (BadLine(11, **LINES[name]), BadLine(12, **LINES[name]))
    boat = bench(method, lines)
    truth = Truth(boat)
    boat.engage(50.0)
    assert boat.run(12.0, until=boat.engaged), words_of(boat.tick)
    boat.run(12.0)
    settled = boat.now
    boat.run(8.0)
    assert_held(boat, 50.0, settled)
    delay = LINES[name].get("delay", 0.0) + (0.3 if "join" in LINES[name] else 0.0)
    assert assert_only_what_was_measured(boat, truth, delay) > 200
    assert_released_at_the_end(boat, waits=3.6)
    if LINES[name].get("loss"):
        assert lines[1].lost > 20


@pytest.mark.parametrize(("share", "since"), [(0.1, 5.0), (0.3, 5.0), (0.1, 0.0)])
def test_datagrams_that_come_seconds_late_are_nobody_else_s_steering_and_no_restart(share: float, since: float) -> None:
    """Reports of old, and old orders of ours that the vehicle obeys for a moment: the rudder never stands still."""
    boat = bench("rc_override", (StragglingLine(1, share, since), StragglingLine(51, share, since)))
    boat.engage(50.0)
    assert boat.run(12.0, until=boat.engaged), words_of(boat.tick)
    begun = boat.now
    for turn in range(6):
        boat.engage(50.0 if turn % 2 == 0 else 90.0)
        boat.run(12.0)
    late = [tick for tick in boat.ticks if tick.now > begun]
    assert {tick.mode for tick in late} == {Mode.ENGAGED}, {words_of(tick) for tick in late}
    assert {alarm.name for tick in late for alarm in tick.alarms} == set()


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
def test_an_order_that_comes_behind_its_release_does_not_take_the_rudder_back(method: str) -> None:
    """The vehicle obeys it, and would for the three seconds of its timeout, with a hand on the stick."""
    for seed in range(4):
        boat = bench(method, (StragglingLine(seed, 0.1, 2.0), BadLine()))
        boat.engage(50.0)
        assert boat.run(12.0, until=boat.engaged), words_of(boat.tick)
        boat.run(6.0)
        boat.engage(170.0)
        boat.run(2.0)
        assert abs(boat.firmware.servos[0] - 1500) > 300
        boat.order = Order(OrderKind.STANDBY, serial=99)
        boat.run(0.3)
        over, longest, orders = 0.0, 0.0, 0
        for _ in range(280):
            boat.run(0.025)
            is_over = abs(boat.firmware.servos[0] - 1500) > 50
            orders += is_over and over == 0.0
            over = over + 0.025 if is_over else 0.0
            longest = max(longest, over)
        assert orders > 0, "one came"
        assert longest < 0.5


@pytest.mark.parametrize("method", ["manual_control"])
def test_the_release_gets_through_a_line_that_loses_a_third(method: str) -> None:
    """Five releases: all of them are lost once in 400 times, and then the vehicle's timeout helps."""
    for seed in (0, 1, 2, 3):  # with 0 the first requests for headings are lost as well
        boat = bench(method, (BadLine(seed, loss=0.3), BadLine(seed + 50, loss=0.3)))
        boat.engage(50.0)
        assert boat.run(10.0, until=boat.engaged)
        boat.run(2.0)
        assert boat.firmware.servos[0] != 1500
        assert_released_at_the_end(boat, waits=0.3)


def test_a_stream_in_pieces_loses_nothing() -> None:
    lines = (BadLine(3, split=0.9, join=0.6), BadLine(4, split=0.9, join=0.6))
    boat = bench("rc_override", lines, is_stream=True)
    truth = Truth(boat)
    boat.engage(50.0)
    boat.run(30.0)
    assert_held(boat, 50.0, 20.0)
    assert boat.link.session.bad_packets == 0
    assert_only_what_was_measured(boat, truth, 0.3)


class Stranger:
    """Somebody else on the line, heard by the companion and by the vehicle, who talks ten times a second."""

    def __init__(self, boat: Lockstep, system: int, component: int, make: Any) -> None:
        self.codec = MavlinkCodec(system, component)
        self.make = make
        self._step = 0
        boat.hooks.append(self.talk)

    def talk(self, boat: Lockstep) -> None:
        self._step += 1
        if self._step % 4:
            return
        for message in self.make(boat, self._step):
            data = self.codec.encode(message)
            boat.inject(data)
            boat.vehicle.receive(boat.now, data)


def second_vehicle(boat: Lockstep, step: int) -> list[Any]:
    """Another ArduRover: other heading, in HOLD, disarmed, restarting, with other parameters."""
    boot_ms = (step * 40) % 5000
    return [
        dialect.MAVLink_heartbeat_message(11, 3, 1, 4, 3, 3),
        dialect.MAVLink_attitude_message(boot_ms, 0.3, 0.0, -2.0, 0.0, 0.0, 1.0),
        dialect.MAVLink_global_position_int_message(boot_ms, 1, 1, 0, 0, 2000, 2000, 0, 0),
        dialect.MAVLink_rc_channels_message(boot_ms, 8, *[1100] * 18, 255),
        dialect.MAVLink_servo_output_raw_message(boot_ms * 1000, 0, *[1900] * 8),
        dialect.MAVLink_nav_controller_output_message(0.0, 0.0, -100, 0, 0, 0.0, 0.0, 0.0),
        dialect.MAVLink_param_value_message(b"RCMAP_ROLL", 3.0, 9, 700, 1),
        dialect.MAVLink_param_value_message(b"SYSID_MYGCS", 12.0, 9, 700, 1),
        dialect.MAVLink_param_value_message(b"RC1_REVERSED", 1.0, 9, 700, 1),
    ]


def other_companion(boat: Lockstep, step: int) -> list[Any]:
    """A companion of the same vehicle, with its system id: what it says of the vehicle is not the vehicle's word."""
    return [
        dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3),
        dialect.MAVLink_attitude_message(0, 0.3, 0.0, -2.0, 0.0, 0.0, 1.0),
        dialect.MAVLink_param_value_message(b"RC1_REVERSED", 1.0, 9, 700, 1),
        dialect.MAVLink_rc_channels_override_message(1, 1, *[1100] * 8),
        dialect.MAVLink_statustext_message(4, b"another companion"),
    ]


def ground_station(boat: Lockstep, step: int) -> list[Any]:
    """A stock ground station: heartbeats, parameter requests, stream rates of its own taste."""
    return [
        dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        dialect.MAVLink_param_request_read_message(1, 1, b"RC1_TRIM", -1),
        dialect.MAVLink_request_data_stream_message(1, 1, 10, 4 if step % 400 == 0 else 20, 1),
        dialect.MAVLink_timesync_message(0, step),
        dialect.MAVLink_param_value_message(b"RC1_REVERSED", 1.0, 9, 700, 1),
    ]


@pytest.mark.parametrize(
    ("method", "system", "component", "make"),
    [
        ("rc_override", 7, 1, second_vehicle),
        ("rc_override", 1, 191, other_companion),
        ("rc_override", 1, 194, other_companion),
        ("rc_override", 255, 190, ground_station),
        ("guided", 7, 1, second_vehicle),
        ("guided", 255, 190, ground_station),
    ],
)
def test_a_stranger_on_the_line_is_never_mixed_up_with_the_vehicle(
    method: str, system: int, component: int, make: Any
) -> None:
    boat = bench(method, (BadLine(5, loss=0.05), BadLine(6, loss=0.05)), vehicle_system=None)
    truth = Truth(boat)
    boat.run(1.1)
    assert boat.link.session.vehicle == 1
    Stranger(boat, system, component, make)
    boat.engage(50.0)
    assert boat.run(10.0, until=boat.engaged), words_of(boat.tick)
    boat.run(20.0)
    assert_held(boat, 50.0, 16.0)
    assert_only_what_was_measured(boat, truth, 0.05)
    channel = boat.link.session._output.channel
    assert channel is not None
    assert not channel.rc_reversed
    assert_released_at_the_end(boat, waits=3.6)


def test_the_chosen_vehicle_is_steered_though_another_was_there_first() -> None:
    boat = bench("rc_override", vehicle_system=1)
    Stranger(boat, 7, 1, second_vehicle)
    boat.run(0.1)
    boat.engage(50.0)
    boat.run(20.0)
    assert boat.link.session.vehicle == 1
    assert_held(boat, 50.0, 15.0)


def test_a_ground_station_that_steers_too_gets_the_helm() -> None:
    """Two hands on one rudder: ours lets go, and says who has it."""
    boat = bench("rc_override", (BadLine(1, delay=0.06), BadLine(2)))
    boat.engage(50.0)
    boat.run(10.0)
    assert boat.tick.mode is Mode.ENGAGED

    def joystick(boat: Lockstep, step: int) -> list[Any]:
        return [dialect.MAVLink_rc_channels_override_message(1, 1, 1650, *[65535] * 7)] * 3

    # forty times a second, twice as often as we: the vehicle obeys now one, now the other
    for phase in range(4):
        Stranger(boat, 255, 190, joystick)._step = phase

    def let_go(tick: Tick) -> bool:
        return tick.mode is Mode.OVERRIDE

    assert boat.run(10.0, until=let_go)
    assert "another ground station steers" in words_of(boat.tick)[0]
    servos = []
    for _ in range(60):
        boat.run(0.05)
        servos.append(boat.firmware.servos[0])
    assert boat.tick.mode is Mode.OVERRIDE
    # a release of ours is said five times, and each is in force until the joystick's next order
    assert all(max(three) > 1600 for three in zip(servos[2:], servos[3:], servos[4:], strict=False)), "the joystick's"
    assert all(servo > 1600 or abs(servo - 1500) <= 1 for servo in servos[4:]), "or nobody's"


def test_two_vehicles_of_one_id_are_not_steered() -> None:
    """Nothing tells them apart but their clocks, and those say that the vehicle restarts all the time."""
    boat = bench("rc_override")
    Stranger(boat, 1, 1, second_vehicle)
    boat.engage(50.0)
    boat.run(15.0)
    assert Mode.ENGAGED not in {tick.mode for tick in boat.ticks}
    reasons = {s.reason for tick in boat.ticks for s in tick.samples if isinstance(s, HelmSample)}
    assert any("rebooted" in reason or "mode HOLD" in reason for reason in reasons)


def test_a_rudder_behind_a_line_that_held_its_orders_for_two_seconds_is_not_reversed() -> None:
    """A drive and its instruments on one line: courses change, and the orders stay away and come late."""
    vessel, begun = load_vessel("lanxin"), 9.67
    line, said = StalledLine(begun, lasts=2.0, drained=1.3), set[str]()
    near, far = loopback_pair()
    near.is_stream = True
    link = NmeaLink(near, nmea_settings_of(vessel, parse_url("nmea:/dev/x:38400")))
    boat = NmeaInstruments(World(vessel, load_scenario("calm")), {"HDT": 10.0, "ROT": 10.0, "RSA": 5.0}, 38400)
    pilot = build_pilot(vessel)
    for step in range(round((begun + 7.0) / 0.02)):
        now, course = 0.02 * step, int(0.25 * 0.02 * step)
        for data in far.receive():
            line.put(now, data)
        for data in line.take(now):
            boat.receive(now, data)
        for data in boat.transmit(now):
            far.send(data)
        order = Order(OrderKind.HEADING, math.radians(25.0 if course % 2 else -25.0), serial=1 + course)
        tick = pilot.step(now, tuple(link.receive(now)), order)
        link.send(now, tick.command)
        link.poll(now)
        said |= {alarm.name for alarm in tick.alarms if alarm.name.startswith("rudder")}
    assert said == {"rudder_stuck"}
