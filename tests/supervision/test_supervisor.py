"""The supervisor's table: who has the rudder, and what is commanded when things fail."""

from __future__ import annotations

import math

import pytest
from alarm_texts import other
from watches import said_by

from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    HelmCause,
    HelmSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    RudderCommand,
    SupervisorState,
)
from autopilot.supervision.envelope import Envelope
from autopilot.supervision.panel import sentences_of
from autopilot.supervision.supervisor import RESUME_AFTER, FailsafeAction, Supervisor

ENVELOPE = Envelope(0.5, 0.3)
ENGAGE = Order(OrderKind.HEADING, 1.0, serial=1)


def supervisor(action: str = "amidships", resume: bool = False, release_after: float = 5.0) -> Supervisor:
    return Supervisor(ENVELOPE, FailsafeAction(1.0, action, release_after, resume))


def state(now: float, age: float = 0.0, heading: float = 0.0) -> NavState:
    return NavState(now, heading, 0.0, 4.0, 0.0, 0.0, age, math.isfinite(age))


def engaged() -> Supervisor:
    tested = supervisor()
    assert tested.decide(0.0, ENGAGE, state(0.0)) is Mode.ENGAGED
    return tested


def test_the_supervisor_stands_by_without_an_order() -> None:
    tested = supervisor()
    assert tested.decide(0.0, Order(), state(0.0)) is Mode.STANDBY
    assert tested.check(0.0, 0.0, 0.2, 0.2, 0.1) == RudderCommand(0.0, 0.0, False)
    assert said_by(tested) == ()


def test_it_waits_for_a_heading_and_says_so() -> None:
    tested = supervisor()
    assert tested.decide(0.0, ENGAGE, state(0.0, math.inf)) is Mode.STANDBY
    assert "waiting for a heading" in sentences_of(said_by(tested))[0]
    assert tested.decide(1.0, ENGAGE, state(1.0)) is Mode.ENGAGED
    assert said_by(tested) == ()


@pytest.mark.parametrize("cause", list(HelmCause))
def test_a_helm_that_goes_away_ends_steering_whatever_the_cause(cause: HelmCause) -> None:
    tested = engaged()
    tested.on_sample(HelmSample(0.1, False, "in words of its own", "rc", cause))
    assert tested.decide(0.1, ENGAGE, state(0.1)) is Mode.OVERRIDE


def test_a_note_is_an_alarm_that_changes_nothing_until_its_source_takes_it_back() -> None:
    tested = engaged()
    tested.note(AlarmSample(1.0, other("the rudder motor draws 9 A"), "drive"))
    tested.note(AlarmSample(1.0, other("heading monitor: two compasses disagree"), "heading monitor"))
    assert tested.decide(1.0, ENGAGE, state(1.0)) is Mode.ENGAGED
    assert tested.check(1.0, 0.1, 0.1, 0.1, 0.1).engaged
    assert sentences_of(said_by(tested)) == ("the rudder motor draws 9 A", "heading monitor: two compasses disagree")
    tested.note(AlarmSample(2.0, None, "drive"))
    tested.on_sample(HelmSample(2.0, False, "mode HOLD was chosen", "link"))
    tested.decide(2.0, ENGAGE, state(2.0))
    overridden, note = sentences_of(said_by(tested))
    assert overridden.startswith("overridden: mode HOLD was chosen")
    assert note == "heading monitor: two compasses disagree"
    tested.note(AlarmSample(2.0, None, "heading monitor"))
    assert sentences_of(said_by(tested)) == (overridden,)


def test_standby_ends_an_engagement() -> None:
    assert engaged().decide(1.0, Order(), state(1.0)) is Mode.STANDBY


def test_a_human_takes_over_at_once_and_keeps_the_helm() -> None:
    tested = engaged()
    tested.on_sample(HelmSample(1.0, False, "mode HOLD was chosen", "link"))
    assert tested.decide(1.0, ENGAGE, state(1.0)) is Mode.OVERRIDE
    assert not tested.check(1.0, 0.1, 0.2, 0.1, 0.1).engaged
    assert "mode HOLD" in sentences_of(said_by(tested))[0]
    tested.on_sample(HelmSample(2.0, True, "", "link"))
    assert tested.decide(2.0, ENGAGE, state(2.0)) is Mode.OVERRIDE, "the same order does not engage again"
    assert tested.decide(3.0, ENGAGE._replace(serial=2), state(3.0)) is Mode.ENGAGED


def test_a_helm_that_is_away_and_back_within_a_tick_was_taken() -> None:
    tested = engaged()
    tested.on_sample(HelmSample(1.0, False, "mode HOLD was chosen", "link"))
    tested.on_sample(HelmSample(1.02, True, "", "link"))
    assert tested.decide(1.03, ENGAGE, state(1.03)) is Mode.OVERRIDE
    assert tested.decide(1.1, ENGAGE, state(1.1)) is Mode.OVERRIDE
    assert tested.decide(1.2, ENGAGE._replace(serial=ENGAGE.serial + 1), state(1.2)) is Mode.ENGAGED


def test_it_does_not_engage_against_a_human() -> None:
    tested = supervisor()
    tested.on_sample(HelmSample(0.0, False, "disarmed", "link"))
    assert tested.decide(0.0, ENGAGE, state(0.0)) is Mode.STANDBY
    assert sentences_of(said_by(tested)) == ("not engaged: disarmed",)


def test_another_link_cannot_free_the_helm_that_one_has_taken() -> None:
    tested = supervisor()
    tested.on_sample(HelmSample(0.0, False, "disarmed", "one"))
    tested.on_sample(HelmSample(0.0, True, "", "two"))
    assert tested.decide(0.0, ENGAGE, state(0.0)) is Mode.STANDBY


@pytest.mark.parametrize("age", [1.01, math.inf, math.nan])
def test_a_stale_heading_is_a_fail_safe(age: float) -> None:
    tested = engaged()
    assert tested.decide(1.0, ENGAGE, state(1.0, 0.99)) is Mode.ENGAGED
    assert tested.decide(2.0, ENGAGE, state(2.0, age)) is Mode.FAILSAFE
    assert "heading lost" in sentences_of(said_by(tested))[0]
    assert tested.decide(3.0, ENGAGE, state(3.0)) is Mode.FAILSAFE, "only a new order engages again"
    assert tested.decide(4.0, ENGAGE._replace(serial=2), state(4.0)) is Mode.ENGAGED


def test_a_heading_that_is_not_finite_is_a_fault() -> None:
    tested = engaged()
    assert tested.decide(1.0, ENGAGE, state(1.0, heading=math.nan)) is Mode.FAULT


@pytest.mark.parametrize("demand", [math.nan, math.inf, -math.inf])
def test_a_demand_that_is_not_finite_never_leaves(demand: float) -> None:
    tested = engaged()
    command = tested.check(1.0, 0.1, demand, 0.1, 0.1)
    assert tested.mode is Mode.FAULT
    assert math.isfinite(command.angle)


@pytest.mark.parametrize(("previous", "limited"), [(0.49, 0.51), (0.0, 0.1), (0.0, -0.1), (0.0, math.nan)])
def test_a_command_outside_the_envelope_never_leaves(previous: float, limited: float) -> None:
    tested = engaged()
    command = tested.check(1.0, previous, limited, limited, 0.1)
    assert tested.mode is Mode.FAULT
    assert abs(command.angle - previous) <= ENVELOPE.rate_max * 0.1 + 1e-9


def fail(tested: Supervisor) -> None:
    tested.decide(0.0, ENGAGE, state(0.0))
    assert tested.decide(10.0, ENGAGE, state(10.0, 9.0)) is Mode.FAILSAFE


def test_amidships_slews_and_then_releases() -> None:
    tested = supervisor("amidships")
    fail(tested)
    commanded, angles = -0.2, []
    for i in range(10):
        command = tested.check(10.0 + 0.1 * i, commanded, 0.0, commanded, 0.1)
        angles.append(command.angle)
        commanded = command.angle
    assert angles[0] == pytest.approx(-0.17)
    assert angles[-1] == 0.0
    assert tested.check(14.99, commanded, 0.0, commanded, 0.1).engaged
    assert not tested.check(15.0, commanded, 0.0, commanded, 0.1).engaged


def test_hold_keeps_the_rudder_and_then_releases() -> None:
    tested = supervisor("hold")
    fail(tested)
    assert tested.check(12.0, -0.2, 0.0, -0.2, 0.1) == RudderCommand(12.0, -0.2, True)
    assert not tested.check(15.0, -0.2, 0.0, -0.2, 0.1).engaged


def test_release_lets_go_at_once() -> None:
    tested = supervisor("release")
    fail(tested)
    assert not tested.check(10.0, 0.2, 0.0, 0.2, 0.1).engaged


def test_it_resumes_by_itself_only_where_the_file_says_so() -> None:
    for resume, mode in ((True, Mode.ENGAGED), (False, Mode.FAILSAFE)):
        tested = supervisor(resume=resume)
        fail(tested)
        assert tested.decide(11.0, ENGAGE, state(11.0)) is Mode.FAILSAFE
        assert tested.decide(11.0 + RESUME_AFTER, ENGAGE, state(13.0)) is mode


def test_a_fault_holds_the_rudder_for_a_while_and_then_lets_go() -> None:
    tested = engaged()
    assert tested.check(1.0, 0.1, math.nan, 0.1, 0.1) == RudderCommand(1.0, 0.1, True)
    assert "not finite" in sentences_of(said_by(tested))[0]
    assert tested.check(5.9, 0.1, 0.0, 0.1, 0.1) == RudderCommand(5.9, 0.1, True)
    assert not tested.check(6.0, 0.1, 0.0, 0.1, 0.1).engaged
    assert tested.decide(6.1, ENGAGE, state(6.1)) is Mode.FAULT, "nothing but a new order ends it"
    assert tested.decide(7.0, ENGAGE._replace(serial=2), state(7.0)) is Mode.ENGAGED


def test_an_order_that_meets_a_taken_helm_waits_half_a_minute_and_is_dropped() -> None:
    tested = supervisor()
    tested.on_sample(HelmSample(0.0, False, "disarmed; arm it", "link"))
    assert tested.decide(0.0, ENGAGE, state(0.0)) is Mode.STANDBY
    assert tested.decide(29.0, ENGAGE, state(29.0)) is Mode.STANDBY
    assert sentences_of(said_by(tested)) == ("not engaged: disarmed; arm it",)
    tested.decide(30.0, ENGAGE, state(30.0))
    assert sentences_of(said_by(tested)) == ("the order to engage was dropped: disarmed; arm it; order again",)
    tested.on_sample(HelmSample(31.0, True, "", "link"))
    assert tested.decide(31.0, ENGAGE, state(31.0)) is Mode.STANDBY, "nobody expects to be obeyed by now"
    assert tested.decide(32.0, ENGAGE._replace(serial=2), state(32.0)) is Mode.ENGAGED


def test_a_trouble_of_the_rudder_lets_go_at_once() -> None:
    tested = engaged()
    assert tested.decide(1.0, ENGAGE, state(1.0), {"rudder_stuck": AlarmEvent("rudder_stuck")}) is Mode.FAILSAFE
    assert not tested.check(1.0, 0.2, 0.2, 0.2, 0.1).engaged


def test_a_doubt_degrades_and_its_end_gives_back_what_was_ordered() -> None:
    tested = engaged()
    track = ENGAGE._replace(is_led=True)
    assert tested.decide(0.5, track, state(0.5)) is Mode.ENGAGED
    assert tested.memory.state is SupervisorState.TRACK
    assert tested.decide(1.0, track, state(1.0), {"rate_disagrees": AlarmEvent("rate_disagrees")}) is Mode.ENGAGED
    assert tested.memory.state is SupervisorState.DEGRADED
    assert tested.check(1.0, 0.1, 0.1, 0.1, 0.1).engaged
    tested.decide(2.0, track, state(2.0))
    assert tested.memory.state is SupervisorState.TRACK
