"""Rudder drives that have no say of their own: left without an order for too long, the helm is not ours any more."""

from __future__ import annotations

import math

import pytest

from autopilot.links.drives import DriveLink, DriveLinkSettings
from autopilot.links.drives.pypilot_motor import FLAGS, NO_SENSOR, RUDDER, PypilotMotor, packet
from autopilot.links.nmea.link import NmeaLink
from autopilot.links.rudder_order import FollowSettings, RudderFollow
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.runtime.build import follow_of
from autopilot.runtime.build_links import drive_settings_of, nmea_settings_of
from autopilot.signals import HelmCause, HelmSample, RudderCommand, Sample
from autopilot.vessel.file import load_vessel

LANXIN = load_vessel("lanxin")
PATIENCE_S = 3.0


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
