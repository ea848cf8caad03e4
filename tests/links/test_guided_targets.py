"""Heading targets by themselves: the message, when it is due, how the proof and the watch judge bearings."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.links.guided_targets import GuidedTargets
from autopilot.links.helm_watch import HelmWatch
from autopilot.signals import Mode, NavState, Order, OrderKind, Reference, RudderCommand, Tick

WAITS = ("cannot engage: checking that the vehicle takes heading targets",)


def tick(now: float, mode: Mode, reference: float, heading: float = 0.0, kind: OrderKind = OrderKind.HEADING) -> Tick:
    state = NavState(now, heading, 0.0, 4.0, 0.0, 0.0, 0.1, True)
    engaged = mode is Mode.ENGAGED
    order = Order(kind, reference, serial=1)
    alarms = () if engaged else WAITS
    return Tick(1, now, (), order, state, Reference(reference), 0.0, RudderCommand(now, 0.0, engaged), mode, alarms)


def proven(heading: float = 0.3) -> tuple[GuidedTargets, HelmWatch]:
    watch = HelmWatch(guided=True)
    targets = GuidedTargets(watch, 0.25)
    targets.target = 7
    targets.report(0.0, wrap(heading + 2.0))
    assert targets.show(tick(0.0, Mode.STANDBY, heading, heading), True) is not None
    for number in range(3):
        targets.report(0.2 * number, heading)
    assert targets.reason == ""
    return targets, watch


@pytest.mark.parametrize("share", [-0.1, 1.1, math.nan, math.inf])
def test_a_share_of_speed_that_is_none_is_refused(share: float) -> None:
    with pytest.raises(ValueError, match="allowed is 0 to 1"):
        GuidedTargets(HelmWatch(guided=True), share)


@given(st.floats(-math.pi, math.pi))
def test_the_quaternion_s_yaw_is_the_heading(heading: float) -> None:
    targets, _ = proven()
    message = targets.show(tick(5.0, Mode.ENGAGED, heading), True)
    assert message is not None
    w, x, y, z = message.q
    assert wrap(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)) - heading) == pytest.approx(
        0.0, abs=1e-9
    )
    assert (message.target_system, message.target_component, message.thrust) == (7, 1, 0.25)
    assert message.type_mask & 64 == 0, "ArduRover ignores a target without its thrust"
    assert message.type_mask & 4, "and takes the yaw rate for what is wanted unless it is masked"


def test_a_held_heading_leaves_five_times_a_second_and_a_turning_one_ten() -> None:
    targets, _ = proven()
    for rate, least, most in ((0.0, 23, 27), (0.2, 45, 52)):
        start = 10.0 if rate == 0.0 else 30.0
        sent = [
            targets.show(tick(start + 0.02 * step, Mode.ENGAGED, 1.0 + rate * 0.02 * step), True) for step in range(250)
        ]
        assert least <= sum(message is not None for message in sent) <= most


def test_bearings_near_south_are_compared_round_the_card() -> None:
    targets, watch = proven()
    for step in range(100):
        now = 5.0 + 0.1 * step
        targets.show(tick(now, Mode.ENGAGED, math.radians(179.9)), True)
        targets.report(now, math.radians(-179.0))
    assert not watch.disobeyed
    for step in range(20):
        now = 15.0 + 0.1 * step
        targets.show(tick(now, Mode.ENGAGED, math.radians(179.9)), True)
        targets.report(now, math.radians(-170.0))
    assert watch.disobeyed


def test_a_bearing_that_passes_by_is_no_proof() -> None:
    targets = GuidedTargets(HelmWatch(guided=True), 0.0)
    targets.report(0.0, 2.0)
    targets.show(tick(0.0, Mode.STANDBY, 0.3, 0.3), True)
    for number, bearing in enumerate((0.3, 0.9, 0.3, 1.5)):
        targets.report(0.1 * number, bearing)
    assert targets.reason


def test_nothing_leaves_without_leave_to_prove_without_an_order_or_without_reports() -> None:
    targets = GuidedTargets(HelmWatch(guided=True), 0.0)
    assert targets.show(tick(0.0, Mode.STANDBY, 0.3), True) is None, "no report yet"
    assert "NAV_CONTROLLER_OUTPUT" in targets.reason
    targets.report(0.0, 2.0)
    assert targets.show(tick(0.1, Mode.STANDBY, 0.3), False) is None
    assert targets.show(tick(0.1, Mode.STANDBY, 0.3)._replace(alarms=()), True) is None
    assert targets.show(tick(0.1, Mode.STANDBY, 0.3, kind=OrderKind.STANDBY), True) is None
    assert targets.show(tick(0.1, Mode.STANDBY, 0.3), True) is not None


def test_a_reference_that_is_no_number_is_never_sent() -> None:
    targets, _ = proven()
    assert targets.show(tick(5.0, Mode.ENGAGED, 0.5), True) is not None
    message = targets.show(tick(5.5, Mode.ENGAGED, math.nan), True)
    assert message is not None
    assert all(math.isfinite(part) for part in message.q)
    assert 2.0 * math.atan2(message.q[3], message.q[0]) == pytest.approx(0.5), "the last one that was"
