"""Heading targets by themselves: the message, when it is due, how the proof judges rudders and the watch bearings."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.links.mavlink.authority import ControlAuthority
from autopilot.links.mavlink.guided import GuidedProof, GuidedTargets, Shown, Verdict, stray_bearing
from autopilot.links.rudder_order import ReleaseState
from autopilot.signals import AlarmEvent, Mode, NavState, Order, OrderKind, Reference, RudderCommand, Tick

WAITS = (AlarmEvent("cannot_engage", "checking that the vehicle takes heading targets"),)


def tick(now: float, mode: Mode, reference: float, heading: float = 0.0, kind: OrderKind = OrderKind.HEADING) -> Tick:
    state = NavState(now, heading, 0.0, 4.0, 0.0, 0.0, 0.1, True)
    engaged = mode is Mode.ENGAGED
    order = Order(kind, reference, serial=1)
    alarms = () if engaged else WAITS
    return Tick(1, now, (), order, state, Reference(reference), 0.0, RudderCommand(now, 0.0, engaged), mode, alarms)


def at_rest(share: float = 0.25) -> GuidedTargets:
    """Targets for a boat at rest whose throttle stick is neutral."""
    targets = GuidedTargets(ControlAuthority(guided=True), share)
    targets.target = 7
    targets.outputs(True)
    targets.stick(False)
    targets.rudder(0.0, 0.0)
    return targets


def proven(heading: float = 0.3, echoes: bool = False) -> tuple[GuidedTargets, ControlAuthority]:
    """Targets of a vehicle whose rudder goes to the side of each, and that may repeat them."""
    targets = at_rest()
    sent = heading
    for step in range(120):
        now = 0.05 * step
        targets.rudder(now, math.copysign(0.2, sent - heading))
        if echoes:
            targets.report(now, wrap(sent))
        message = targets.next_target(tick(now, Mode.STANDBY, heading, heading), True)
        if message is not None:
            sent = 2.0 * math.atan2(message.q[3], message.q[0])
            assert message.thrust == 0.0, "the proof drives nothing"
        if not targets.reason:
            return targets, targets._authority
    raise AssertionError(targets.reason)


def test_what_kept_the_proof_from_beginning_is_not_said_once_it_has_begun() -> None:
    targets = at_rest()
    targets.stick(True)
    assert targets.next_target(tick(0.0, Mode.STANDBY, 0.3, 0.3), True) is None
    assert "throttle stick" in targets.reason
    targets.stick(False)
    targets.rudder(0.1, 0.0)
    assert targets.next_target(tick(0.1, Mode.STANDBY, 0.3, 0.3), True) is not None
    assert "throttle stick" not in targets.reason


@pytest.mark.parametrize(("answers", "passes"), [(1.0, True), (0.0, False), (-1.0, False)])
def test_without_a_steering_servo_the_rate_of_turn_is_the_proof(answers: float, passes: bool) -> None:
    """Two motors: the boat makes way, and turns to the side of each heading."""
    targets, sent, passed = GuidedTargets(ControlAuthority(guided=True), 0.25), 0.3, False
    targets.target = 7
    targets.outputs(False)
    targets.stick(False)
    targets.engine(0.0, True, False)
    for step in range(400):
        now = 0.05 * step
        at = tick(now, Mode.STANDBY, 0.3, 0.3)
        at = at._replace(state=at.state._replace(rate=answers * math.copysign(0.05, sent - 0.3)))
        message = targets.next_target(at, True)
        if message is not None:
            sent = 2.0 * math.atan2(message.q[3], message.q[0])
        passed = passed or not targets.reason
    assert passed is passes


@pytest.mark.parametrize("share", [-0.1, 1.1, math.nan, math.inf])
def test_a_share_of_speed_that_is_none_is_refused(share: float) -> None:
    with pytest.raises(ValueError, match="allowed is 0 to 1"):
        GuidedTargets(ControlAuthority(guided=True), share)


@given(st.floats(-math.pi, math.pi))
def test_the_quaternion_s_yaw_is_the_heading(heading: float) -> None:
    targets, _ = proven()
    message = targets.next_target(tick(5.0, Mode.ENGAGED, heading), True)
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
            targets.next_target(tick(start + 0.02 * step, Mode.ENGAGED, 1.0 + rate * 0.02 * step), True)
            for step in range(250)
        ]
        assert least <= sum(message is not None for message in sent) <= most


def test_bearings_near_south_are_compared_round_the_card() -> None:
    targets, watch = proven(echoes=True)
    for step in range(100):
        now = 5.0 + 0.1 * step
        targets.next_target(tick(now, Mode.ENGAGED, math.radians(179.9), math.pi), True)
        targets.report(now, math.radians(-179.0))
    assert not watch.disobeyed
    for step in range(20):
        now = 15.0 + 0.1 * step
        targets.next_target(tick(now, Mode.ENGAGED, math.radians(179.9), math.pi), True)
        targets.report(now, math.radians(-170.0))
    assert watch.disobeyed


def test_a_vehicle_that_heads_for_a_place_ends_guided_steering() -> None:
    targets, watch = proven()
    for step in range(50):
        targets.next_target(tick(5.0 + 0.1 * step, Mode.ENGAGED, 2.0, 2.0), True)
        targets.report(5.0 + 0.1 * step, 0.0, 0.0, 0.0)
    assert not watch.disobeyed
    for step in range(20):
        targets.next_target(tick(10.0 + 0.1 * step, Mode.ENGAGED, 2.0, 2.0), True)
        targets.report(10.0 + 0.1 * step, 1.0, 1.0, 12.0)
    assert watch.disobeyed
    targets, watch = proven()
    for step in range(20):
        targets.next_target(tick(10.0 + 0.1 * step, Mode.ENGAGED, 2.0, 2.0), True)
        targets.report(10.0 + 0.1 * step, 1.0, 1.0, 12.0)
    assert watch.disobeyed, "from the beginning, too"


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
        targets.next_target(tick(0.05 * step, Mode.STANDBY, 0.3, 0.3), True)
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
    assert targets.next_target(tick(0.0, Mode.STANDBY, 0.3, 0.3), True) is not None
    targets.stick(True)
    assert targets.next_target(tick(0.5, Mode.STANDBY, 0.3, 0.3), True) is None
    assert "a heading would start the boat" in targets.reason


def test_nothing_leaves_without_leave_to_prove_without_an_order_or_without_reports() -> None:
    targets = GuidedTargets(ControlAuthority(guided=True), 0.0)
    assert targets.next_target(tick(0.0, Mode.STANDBY, 0.3), True) is None, "nothing known yet"
    targets = at_rest()
    assert targets.next_target(tick(0.1, Mode.STANDBY, 0.3), False) is None
    assert targets.next_target(tick(0.1, Mode.STANDBY, 0.3)._replace(alarms=()), True) is None
    assert targets.next_target(tick(0.1, Mode.STANDBY, 0.3, kind=OrderKind.STANDBY), True) is None
    assert targets.next_target(tick(0.1, Mode.STANDBY, 0.3), True) is not None


def test_a_reference_that_is_no_number_is_never_sent() -> None:
    targets, _ = proven()
    assert targets.next_target(tick(5.0, Mode.ENGAGED, 0.5), True) is not None
    message = targets.next_target(tick(5.5, Mode.ENGAGED, math.nan), True)
    assert message is not None
    assert all(math.isfinite(part) for part in message.q)
    assert 2.0 * math.atan2(message.q[3], message.q[0]) == pytest.approx(0.5), "the last one that was"


def judged(
    values: list[float], by_servo: bool = True, spacing: float = 0.1, late: float = 0.0
) -> tuple[Verdict, float]:
    """Return the verdict, and when, over reports of one value for each side, as late as the link makes them."""
    proof, sides, before = GuidedProof(0.0, by_servo), [0], 1.0
    while True:
        now = spacing * len(sides) + 1e-6
        proof.take(now, values[sides[max(len(sides) - 1 - round(late / spacing), 0)]])
        verdict = proof.verdict(now)
        if verdict is not Verdict.OPEN:
            return verdict, now
        side = math.copysign(1.0, proof.heading(0.0))
        sides.append(sides[-1] + (side != before))
        before = side


@pytest.mark.parametrize("offset", [0.0, 0.4, -0.4])
@pytest.mark.parametrize(
    ("by_servo", "swing", "is_passed"),
    [(True, 0.021, True), (True, 0.019, False), (True, -0.5, False), (True, 0.0, False),
     (False, math.radians(1.1), True), (False, math.radians(0.9), False), (False, math.radians(-9.0), False)],
)  # fmt: skip
def test_five_sides_of_enough_swing_pass_and_less_fails(
    by_servo: bool, swing: float, is_passed: bool, offset: float
) -> None:
    values = [offset + swing * (side % 2 == 0) for side in range(5)]
    verdict, when = judged(values, by_servo)
    assert verdict is (Verdict.PASSED if is_passed else Verdict.FAILED)
    assert when == pytest.approx(4.0 if by_servo else 15.0, abs=0.6)


@pytest.mark.parametrize(("by_servo", "swing"), [(True, 0.02), (False, math.radians(1.0))])
def test_the_least_swing_to_the_bit_passes(by_servo: bool, swing: float) -> None:
    assert judged([swing * (side % 2 == 0) for side in range(5)], by_servo)[0] is Verdict.PASSED


@pytest.mark.parametrize("odd", range(5))
def test_one_side_that_does_not_follow_fails_the_proof(odd: int) -> None:
    values = [0.2 if side % 2 == 0 else -0.2 for side in range(5)]
    values[odd] = -values[odd]
    assert judged(values)[0] is Verdict.FAILED


def test_what_was_reported_in_the_first_part_of_a_side_does_not_count() -> None:
    values = [0.2 if side % 2 == 0 else -0.2 for side in range(5)]
    assert judged(values, spacing=0.05, late=0.5)[0] is Verdict.PASSED, "as old as the link"
    proof = GuidedProof(0.0, by_servo=True)
    proof.take(0.51, 0.3)
    assert proof.verdict(0.85) is Verdict.OPEN and proof.heading(0.0) > 0.0, "still to starboard: no report counts"
    proof.take(0.86, 0.3)
    assert proof.verdict(0.87) is Verdict.OPEN and proof.heading(0.0) < 0.0


def test_a_side_waits_for_a_late_report_for_one_and_a_half_seconds() -> None:
    for now, verdict in ((2.29, Verdict.OPEN), (0.8 + 1.5, Verdict.FAILED)):
        proof = GuidedProof(0.0, by_servo=True)
        assert proof.verdict(now) is verdict
    assert proof.refusal.startswith("the vehicle reports its steering servo too seldom")
    assert GuidedProof(0.0, by_servo=False).verdict(4.49) is Verdict.OPEN
    assert GuidedProof(0.0, by_servo=False).verdict(4.51) is Verdict.FAILED


def test_the_sides_lie_ten_degrees_off_a_heading_that_may_swing_by_five() -> None:
    proof = GuidedProof(0.0, by_servo=True)
    headings = (3.0, 8.0, 9.0, 4.0, 3.0, -2.0, -12.0)
    targets = [math.degrees(proof.heading(math.radians(heading))) for heading in headings]
    assert targets == pytest.approx([13.0, 13.0, 14.0, 14.0, 14.0, 13.0, 3.0])
    proof.take(0.8, 0.0)
    proof.verdict(0.8)
    assert math.degrees(proof.heading(math.radians(-12.0))) == pytest.approx(-17.0)


@pytest.mark.parametrize(("off", "is_echo"), [(0.0, True), (1.0, True), (-1.0, True), (1.2, False), (-1.2, False)])
def test_a_vehicle_that_repeats_both_sides_within_a_degree_has_passed(off: float, is_echo: bool) -> None:
    proof = GuidedProof(0.0, by_servo=True)
    proof.bearing(0.6, 0.1, 0.1 + math.radians(off))
    proof.take(0.6, 0.0)
    assert proof.verdict(0.81) is Verdict.OPEN and not proof.echoes, "one side is not enough"
    proof.bearing(1.0, 3.1, 3.1 + math.radians(off))
    assert proof.verdict(1.1) is Verdict.OPEN, "too early in its side"
    proof.bearing(1.4, 3.14, wrap(3.14 + math.radians(off)))
    assert proof.verdict(1.5) is (Verdict.PASSED if is_echo else Verdict.OPEN)


@pytest.mark.parametrize(
    ("shown", "is_free"),
    [
        (Shown(True, 9.0, False), True),
        (Shown(True, 8.9, False), False),
        (Shown(True, 10.0, True, ran_time=7.0), True),
        (Shown(True, 10.0, True, ran_time=6.9), False),
        (Shown(True, 10.0, False, True, ours_time=7.0), True),
        (Shown(True, 10.0, False, True, ours_time=6.9), False),
        (Shown(True, 10.0, False, True, ran_time=7.0), True),
    ],
)
def test_how_old_what_is_shown_may_be(shown: Shown, is_free: bool) -> None:
    assert (shown.obstacle(10.0) == "") is is_free


@pytest.mark.parametrize(
    ("bearing", "target", "distance", "said"),
    [(0.0, 0.0, 0.0, ""), (2.0, 0.0, 0.0, ""), (math.pi / 2, 0.1, 12.4, "12 m off in 090 deg"),
     (-math.pi / 2, 0.0, 0.6, "1 m off in 270 deg"), (0.0, -0.1, 0.0, "0 m off in 000 deg")],
)  # fmt: skip
def test_a_place_of_its_own_shows_in_bearing_or_distance(
    bearing: float, target: float, distance: float, said: str
) -> None:
    found = stray_bearing(bearing, target, distance)
    assert said in found if said else found == ""


def turned(**steps: Any) -> tuple[GuidedTargets, ControlAuthority]:
    """A boat engaged on heading 0.0, for `seconds`, its heading and rate [deg, deg/s] and rudder's share as given."""
    targets, watch = proven()
    for step in range(round(steps["seconds"] * 10) + 1):
        now = 10.0 + 0.1 * step
        targets.rudder(now, steps.get("share", 0.0))
        found = tick(now, Mode.ENGAGED, 0.0, math.radians(steps["heading"]))
        rate = math.radians(steps.get("rate", 0.0))
        targets.next_target(found._replace(state=found.state._replace(rate=rate)), True)
    return targets, watch


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("boat", "is_given_up"),
    [
        ({"heading": 31.0, "rate": 1.0, "seconds": 2.4}, True),
        ({"heading": 31.0, "rate": 1.0, "seconds": 2.0}, False),
        ({"heading": 30.0, "rate": 1.0, "seconds": 9.0}, False),
        ({"heading": 31.0, "rate": -1.0, "seconds": 9.0}, False),
        ({"heading": 31.0, "rate": 0.0, "seconds": 9.0}, False),
        ({"heading": 21.0, "share": 0.11, "seconds": 2.4}, True),
        ({"heading": 21.0, "share": 0.11, "seconds": 2.0}, False),
        ({"heading": 21.0, "share": 0.1, "seconds": 9.0}, False),
        ({"heading": 21.0, "share": -0.5, "seconds": 9.0}, False),
        ({"heading": 20.0, "share": 0.5, "seconds": 9.0}, False),
    ],
)
def test_a_boat_that_turns_away_for_two_seconds_follows_another(
    boat: dict[str, float], is_given_up: bool, side: float
) -> None:
    mirrored = {name: value if name == "seconds" else side * value for name, value in boat.items()}
    _, watch = turned(**mirrored)
    assert bool(watch.disobeyed) is is_given_up


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("off", "gain", "seconds", "lags"),
    [(21.0, 0.0, 15.5, True), (21.0, 0.0, 15.1, False), (20.0, 0.0, 60.0, False), (60.0, 0.2, 60.0, False),
     (90.0, 0.1, 60.0, True), (40.0, -2.0, 14.0, False)],
)  # fmt: skip
def test_a_boat_far_off_that_comes_no_two_degrees_nearer_in_fifteen_seconds_lags(
    off: float, gain: float, seconds: float, lags: bool, side: float
) -> None:
    targets, _ = proven()
    found = False
    for step in range(round(10 * seconds)):
        now = 10.0 + 0.1 * step
        heading = math.radians(side * (off - gain * 0.1 * step))
        targets.next_target(tick(now, Mode.ENGAGED, 0.0, heading), True)
        found = found or bool(targets.alarm)
    assert found is lags
    targets.next_target(tick(200.0, Mode.ENGAGED, 0.0, 0.0), True)
    assert targets.alarm is None


@pytest.mark.parametrize(
    ("moved_deg", "lags"), [(-2.0, True), (-2.001, False), (20.0, True), (20.001, False), (5.0, True)]
)
def test_a_boat_that_lags_begins_anew_with_two_degrees_nearer_or_twenty_further_off(
    moved_deg: float, lags: bool
) -> None:
    targets, _ = proven()
    far = math.radians(25.0)
    targets.next_target(tick(10.0, Mode.ENGAGED, 0.0, far), True)
    targets.next_target(tick(25.5, Mode.ENGAGED, 0.0, far), True)
    assert targets.alarm == AlarmEvent("targets_lag")
    moved = math.copysign(math.radians(abs(moved_deg)), moved_deg)
    targets.next_target(tick(25.6, Mode.ENGAGED, 0.0, far + moved), True)
    assert bool(targets.alarm) is lags


@pytest.mark.parametrize(
    ("turned_deg", "later", "leaves"),
    [
        (0.11, 0.11, True),
        (-0.11, 0.11, True),
        (0.11, 0.09, False),
        (0.09, 0.11, False),
        (-0.09, 0.19, False),
        (0.0, 0.21, True),
    ],
)
def test_a_tenth_of_a_degree_is_a_heading_that_changes(turned_deg: float, later: float, leaves: bool) -> None:
    targets, _ = proven()
    assert targets.next_target(tick(100.0, Mode.ENGAGED, 1.0, 1.0), True) is not None
    again = targets.next_target(tick(100.0 + later, Mode.ENGAGED, 1.0 + math.radians(turned_deg), 1.0), True)
    assert (again is not None) is leaves


@pytest.mark.parametrize(("later", "runs"), [(3.0, False), (3.001, True)])
def test_an_engine_that_runs_three_seconds_after_our_last_heading_runs_by_it(later: float, runs: bool) -> None:
    targets, _ = proven()
    targets.next_target(tick(20.0, Mode.ENGAGED, 0.3, 0.3), True)
    targets.engine(20.0 + later, is_running=True, is_guided=True)
    assert targets._shown.runs is runs and (targets._shown.ran_time == 20.0 + later) is not runs


def test_who_follows_other_headings_is_said_with_both_of_them() -> None:
    targets, watch = proven(echoes=True)
    for step in range(40):
        targets.next_target(tick(10.0 + 0.1 * step, Mode.ENGAGED, math.radians(60.0), math.radians(60.0)), True)
        targets.report(10.0 + 0.1 * step, math.radians(75.0))
    assert "it steers 075 deg while 060 is sent" in watch.disobeyed


@pytest.mark.parametrize(("off", "follows"), [(3.9, True), (-3.9, True), (4.1, False), (-4.1, False)])
def test_a_vehicle_that_repeats_headings_steers_one_of_the_last_1_2_seconds(off: float, follows: bool) -> None:
    targets, watch = proven(echoes=True)
    for step in range(40):
        now = 10.0 + 0.1 * step
        targets.next_target(tick(now, Mode.ENGAGED, 1.0, 1.0), True)
        targets.report(now, 1.0 + math.radians(off))
    assert bool(watch.disobeyed) is not follows
    for age, is_known in ((1.7, True), (2.1, False)):
        targets, watch = proven(echoes=True)
        for step in range(120):
            now = 10.0 + 0.1 * step
            targets.next_target(tick(now, Mode.ENGAGED, 0.1 * 0.1 * step, 0.01 * step), True)
            if step > 30:
                targets.report(now, 0.1 * (0.1 * step - age))
        assert bool(watch.disobeyed) is not is_known


def test_a_try_that_failed_is_made_again_after_four_seconds_and_stays_said() -> None:
    targets = at_rest()
    sent = []
    for step in range(200):
        now = 0.05 * step
        targets.rudder(now, 0.0)
        if targets.next_target(tick(now, Mode.STANDBY, 0.3, 0.3), True) is not None:
            sent.append(now)
    (end, again), *others = [(a, b) for a, b in pairwise(sent) if b - a > 1.0]
    assert (end, again - end, others) == (pytest.approx(4.0, abs=0.3), pytest.approx(4.1, abs=0.2), [])
    assert targets.reason.startswith("the vehicle does not take our heading targets")


def test_targets_end_three_seconds_after_the_last_of_them() -> None:
    targets, _ = proven()
    targets.next_target(tick(20.0, Mode.ENGAGED, 0.5), True)
    assert targets.release(23.0, "x").state is ReleaseState.UNSHOWN
    assert targets.release(23.1, "x").state is ReleaseState.NOT_HELD
    assert at_rest().release(0.0, "x").state is ReleaseState.NOT_HELD


def test_time_in_a_target_counts_milliseconds_from_the_first() -> None:
    targets = at_rest()
    first = targets.next_target(tick(0.5, Mode.STANDBY, 0.3), True)
    later = targets.next_target(tick(0.75, Mode.STANDBY, 0.3), True)
    assert first is not None and later is not None
    assert (first.time_boot_ms, later.time_boot_ms, first.type_mask) == (0, 250, 7)
    rates = (later.body_roll_rate, later.body_pitch_rate, later.body_yaw_rate)
    assert (rates, later.q[1], later.q[2]) == ((0.0, 0.0, 0.0), 0.0, 0.0)


def test_a_proof_soon_after_steering_goes_on_with_the_speed_and_later_with_none() -> None:
    for pause, thrust in ((2.9, 0.25), (3.2, 0.0)):
        targets, _ = proven()
        targets.next_target(tick(20.0, Mode.ENGAGED, 0.3, 0.3), True)
        targets.reset()
        targets.rudder(20.0 + pause, 0.0)
        message = targets.next_target(tick(20.0 + pause, Mode.STANDBY, 0.3, 0.3), True)
        assert message is not None and message.thrust == thrust
