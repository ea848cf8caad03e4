"""Heading targets by themselves: the message, when it is due, how the proof judges rudders and the watch bearings."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.links.guided_proof import GuidedProof, Shown, Verdict
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


def at_rest(share: float = 0.25) -> GuidedTargets:
    """Targets for a boat at rest whose throttle stick is neutral."""
    targets = GuidedTargets(HelmWatch(guided=True), share)
    targets.target = 7
    targets.outputs(True)
    targets.stick(False)
    targets.rudder(0.0, 0.0)
    return targets


def proven(heading: float = 0.3, echoes: bool = False) -> tuple[GuidedTargets, HelmWatch]:
    """Targets of a vehicle whose rudder goes to the side of each, and that may repeat them."""
    targets = at_rest()
    sent = heading
    for step in range(120):
        now = 0.05 * step
        targets.rudder(now, math.copysign(0.2, sent - heading))
        if echoes:
            targets.report(now, wrap(sent))
        message = targets.show(tick(now, Mode.STANDBY, heading, heading), True)
        if message is not None:
            sent = 2.0 * math.atan2(message.q[3], message.q[0])
            assert message.thrust == 0.0, "the proof drives nothing"
        if not targets.reason:
            return targets, targets._watch
    raise AssertionError(targets.reason)


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
    targets, watch = proven(echoes=True)
    for step in range(100):
        now = 5.0 + 0.1 * step
        targets.show(tick(now, Mode.ENGAGED, math.radians(179.9), math.pi), True)
        targets.report(now, math.radians(-179.0))
    assert not watch.disobeyed
    for step in range(20):
        now = 15.0 + 0.1 * step
        targets.show(tick(now, Mode.ENGAGED, math.radians(179.9), math.pi), True)
        targets.report(now, math.radians(-170.0))
    assert watch.disobeyed


def test_a_vehicle_that_repeats_no_heading_is_let_steer_and_one_that_leaves_for_a_place_is_not() -> None:
    targets, watch = proven()
    for step in range(50):
        targets.show(tick(5.0 + 0.1 * step, Mode.ENGAGED, 2.0, 2.0), True)
        targets.report(5.0 + 0.1 * step, 0.0, 0.0, 0.0)
    assert not watch.disobeyed
    for step in range(20):
        targets.show(tick(10.0 + 0.1 * step, Mode.ENGAGED, 2.0, 2.0), True)
        targets.report(10.0 + 0.1 * step, 1.0, 1.0, 12.0)
    assert watch.disobeyed


@pytest.mark.parametrize("period", [0.7, 1.0, 2.4, 3.0, 4.0, 6.0, 9.0, 20.0])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
def test_a_rudder_that_swings_by_itself_is_no_proof(period: float, phase: float) -> None:
    proof = GuidedProof(0.0, by_servo=True)
    verdict, step = Verdict.OPEN, 0
    while verdict is Verdict.OPEN:
        step += 1
        proof.take(0.1 * step, 0.5 * math.sin(phase + math.tau * 0.1 * step / period))
        verdict = proof.verdict(0.1 * step)
    assert verdict is Verdict.FAILED
    assert "does not take our heading targets" in proof.refusal


def test_a_rudder_that_always_lies_to_one_side_is_no_proof() -> None:
    targets = at_rest()
    for step in range(100):
        targets.rudder(0.05 * step, 0.3)
        targets.show(tick(0.05 * step, Mode.STANDBY, 0.3, 0.3), True)
    assert "its steering servo does not move" in targets.reason


@pytest.mark.parametrize("right", [True, False])
def test_without_a_steering_servo_the_turn_of_a_boat_under_way_is_the_proof(right: bool) -> None:
    proof = GuidedProof(0.0, by_servo=False)
    verdict, step = Verdict.OPEN, 0
    while verdict is Verdict.OPEN:
        step += 1
        side = proof.heading(0.0) if right else -proof.heading(0.0)
        proof.take(0.1 * step, math.copysign(math.radians(3.0), side))
        verdict = proof.verdict(0.1 * step)
    assert verdict is (Verdict.PASSED if right else Verdict.FAILED)


@pytest.mark.parametrize(
    ("shown", "sentence"),
    [
        (Shown(True, 10.0, stick_asks=True), "a heading would start the boat"),
        (Shown(True, 10.0, stick_asks=None), "waiting to see the throttle stick"),
        (Shown(False, stick_asks=False), "no servo output has the function 26"),
        (Shown(True, 8.0, stick_asks=False), "waiting for the vehicle to report its steering servo"),
        (Shown(True, 10.0, stick_asks=False, runs=True), "guides the vehicle already"),
        (Shown(True, 10.0, stick_asks=True, ran_time=8.0), ""),
        (Shown(False, stick_asks=True, ran_time=8.0), ""),
        (Shown(True, 10.0, stick_asks=False), ""),
    ],
)
def test_no_proof_begins_that_could_start_the_boat_or_that_nobody_could_see(shown: Shown, sentence: str) -> None:
    found = shown.obstacle(10.0)
    assert sentence in found if sentence else not found


def test_a_stick_that_is_pushed_ahead_during_the_proof_at_rest_ends_it() -> None:
    targets = at_rest()
    assert targets.show(tick(0.0, Mode.STANDBY, 0.3, 0.3), True) is not None
    targets.stick(True)
    assert targets.show(tick(0.5, Mode.STANDBY, 0.3, 0.3), True) is None
    assert "a heading would start the boat" in targets.reason


def test_nothing_leaves_without_leave_to_prove_without_an_order_or_without_reports() -> None:
    targets = GuidedTargets(HelmWatch(guided=True), 0.0)
    assert targets.show(tick(0.0, Mode.STANDBY, 0.3), True) is None, "nothing known yet"
    targets = at_rest()
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
