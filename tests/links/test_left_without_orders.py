"""Rudder drives that have no say of their own: left without an order for too long, the helm is not ours any more."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from autopilot.links.drives import DriveLink, DriveLinkSettings
from autopilot.links.drives.pypilot_motor import FLAGS, NO_SENSOR, RUDDER, PypilotMotor, packet
from autopilot.links.nmea.link import NmeaLink
from autopilot.links.rudder_order import FollowSettings, RudderFollow
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.runtime.build import build_pilot, follow_of
from autopilot.runtime.build_links import drive_settings_of, nmea_settings_of
from autopilot.signals import (
    HeadingSample,
    HelmCause,
    HelmSample,
    Mode,
    Order,
    OrderKind,
    RateSample,
    RudderCommand,
    RudderSample,
    Sample,
    Tick,
)
from autopilot.vessel.file import load_vessel
from sitl.scenario import FaultSection, load_scenario
from sitl.wire_nmea import NmeaInstruments
from sitl.world import World

LANXIN = load_vessel("lanxin")
PATIENCE_S = 3.0
STUCK_S = 1.0


def opened(kind: str) -> NmeaLink | DriveLink:
    near, _ = loopback_pair()
    if kind == "drive":
        return DriveLink(near, PypilotMotor(drive_settings_of(LANXIN)), DriveLinkSettings(follow=follow_of(LANXIN)))
    steers = "" if kind == "nmea" else "?steer=no"
    return NmeaLink(near, nmea_settings_of(LANXIN, parse_url(f"nmea:udpin:127.0.0.1:10110{steers}")))


def helms(samples: list[Sample]) -> list[tuple[bool, HelmCause]]:
    return [(sample.available, sample.cause) for sample in samples if isinstance(sample, HelmSample)]


@pytest.mark.parametrize("kind", ["nmea", "drive"])
def test_the_helm_is_given_up_until_the_rudder_is_released(kind: str) -> None:
    link = opened(kind)
    link.receive(0.0)
    link.send(0.0, RudderCommand(0.0, 0.1, True))
    link.receive(0.6 * PATIENCE_S)  # nobody answers for the drive, which is said once it has been waited for
    assert helms(link.receive(0.9 * PATIENCE_S)) == []
    link.send(1.0, RudderCommand(1.0, 0.1, True))
    gone = 1.0 + 1.1 * PATIENCE_S
    assert helms(link.receive(gone)) == [(False, HelmCause.STOOD_STILL)]
    assert helms(link.receive(gone + 0.01)) == []
    link.send(gone, RudderCommand(gone, 0.0, False))
    ((_, cause),) = helms(link.receive(gone + 0.02))
    assert cause is HelmCause.TAKEN


def test_a_link_that_carries_no_orders_may_be_left_alone() -> None:
    link = opened("instruments")
    link.send(0.0, RudderCommand(0.0, 0.1, True))
    assert helms(link.receive(10.0 * PATIENCE_S)) == []


class StuckRudder:
    """A boat whose rudder sticks, steered over one NMEA line in lockstep."""

    def __init__(self, since: float) -> None:
        world = World(
            LANXIN, dataclasses.replace(load_scenario("calm"), faults=(FaultSection("rudder_stuck", since, 1e3),))
        )
        self.instruments = NmeaInstruments(world, {"HDT": 10.0, "ROT": 10.0, "RSA": 5.0}, 38400)
        near, self.far = loopback_pair()
        near.is_stream = True
        self.link = NmeaLink(near, nmea_settings_of(LANXIN, parse_url("nmea:/dev/x:38400")))
        self.pilot = build_pilot(LANXIN)

    def step(self, now: float, *lost: type, steps: bool = True) -> Tick | None:
        """Sail to `now` [s]; the pilot is not given samples of the `lost` types; None where its loop stands still."""
        for data in self.far.receive():
            self.instruments.receive(now, data)
        for data in self.instruments.transmit(now):
            self.far.send(data)
        if not steps:
            return None
        samples = tuple(each for each in self.link.receive(now) if not isinstance(each, lost))
        tick = self.pilot.step(now, samples, Order(OrderKind.HEADING, 2.5, serial=1))
        self.link.send(now, tick.command)
        self.link.poll(now)
        return tick


@given(st.floats(0.5, 4.0), st.floats(0.0, 2.4))
@example(1.63342, 0.43746)
@settings(max_examples=6, deadline=None)
def test_a_stuck_rudder_is_the_fail_safe_whenever_this_computer_stands_still(began: float, lasts: float) -> None:
    boat, tick = StuckRudder(0.0), None
    for step in range(600):
        now = 0.02 * step
        tick = boat.step(now, steps=not began <= now < began + lasts) or tick
        if tick is not None and tick.mode in (Mode.FAILSAFE, Mode.OVERRIDE):
            break
    assert tick is not None and tick.mode is Mode.FAILSAFE
    assert "rudder_stuck" in {alarm.name for alarm in tick.alarms}


def test_a_rudder_whose_sensor_is_not_the_selected_one_is_let_go() -> None:
    """The pilot goes by the drive's own sensor, which obeys; what the blade does only the line's sensor shows."""
    boat = StuckRudder(0.0)
    for step in range(400):
        tick = boat.step(0.02 * step, RudderSample)
        assert tick is not None
        if tick.mode is Mode.OVERRIDE:
            break
    assert tick.mode is Mode.OVERRIDE and not tick.command.engaged and step < 300


def test_a_rudder_that_sticks_while_a_fail_safe_steers_is_let_go() -> None:
    """The compass is lost in a turn, and the rudder sticks before the fail-safe has brought it amidships."""
    boat, was, let_go = StuckRudder(STUCK_S), Mode.STANDBY, math.nan
    for step in range(700):
        now = 0.02 * step
        tick = boat.step(now, *((HeadingSample, RateSample) if now > 1.0 else ()))
        assert tick is not None
        if was is Mode.FAILSAFE and not tick.command.engaged:
            let_go = now
            break
        was = tick.mode
    assert was is Mode.FAILSAFE and let_go < STUCK_S + 5.0


def test_no_more_is_said_than_what_the_standstill_was() -> None:
    follow = RudderFollow(FollowSettings(patience=1.0))
    follow.ordered(0.0, math.radians(10.0))
    for step in range(14):
        follow.measured(0.1 * step, 0.0, "rudder")  # stuck, and nearly found so
    follow.measured(2.5, 0.0, "rudder")
    assert "stood still for 2.5 s" in follow.reason(2.5)
    follow.released()
    assert (follow.reason(2.6), follow.cause) == ("", HelmCause.TAKEN)


def test_a_drive_that_nobody_asked_for_a_while_has_not_failed_to_answer() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, PypilotMotor(drive_settings_of(LANXIN)), DriveLinkSettings(follow=follow_of(LANXIN)))
    link.receive(0.0)
    far.send(3 * (packet(FLAGS, 0) + packet(RUDDER, 32768)))
    assert helms(link.receive(0.1)) == [(True, HelmCause.TAKEN)]
    link.send(0.1, RudderCommand(0.1, 0.1, True))
    assert helms(link.receive(1.65)) == [], "this computer stood still"
    far.send(packet(FLAGS, 0) + packet(RUDDER, 32768))
    assert helms(link.receive(1.8)) == []
    for step in range(1, 16):
        link.send(1.8 + 0.1 * step, RudderCommand(1.8 + 0.1 * step, 0.1, True))
        assert helms(link.receive(1.8 + 0.1 * step)) == []
    assert helms(link.receive(3.4)) == [(False, HelmCause.TAKEN)], "and now it is the drive that is silent"


def test_a_fault_that_a_drive_reports_outlasts_our_own_standstills() -> None:
    near, far = loopback_pair()
    link = DriveLink(near, PypilotMotor(drive_settings_of(LANXIN)), DriveLinkSettings(follow=follow_of(LANXIN)))
    link.receive(0.0)
    far.send(3 * (packet(FLAGS, 0) + packet(RUDDER, 32768)))
    assert helms(link.receive(0.1)) == [(True, HelmCause.TAKEN)]
    far.send(packet(FLAGS, 0) + packet(RUDDER, NO_SENSOR))
    assert helms(link.receive(0.3)) == [(False, HelmCause.TAKEN)]
    for step in range(1, 6):
        far.send(packet(FLAGS, 0) + packet(RUDDER, NO_SENSOR))
        assert helms(link.receive(0.3 + 1.2 * step)) == []
