"""Who gets the helm back, and when: hands on it during a fail-safe, serials, resuming, unlimited rudders."""

from __future__ import annotations

import math

import pytest
from watches import said_by

from autopilot.control.limits import RudderLimits, limit
from autopilot.signals import HelmSample, Mode, NavState, Order, OrderKind
from autopilot.supervision.envelope import Envelope
from autopilot.supervision.panel import sentences_of
from autopilot.supervision.supervisor import RESUME_AFTER, FailsafeAction, Supervisor

ENVELOPE_LIMITS = Envelope(0.5, 0.35)
COURSE = Order(OrderKind.HEADING, 1.0, serial=1)
STANDBY = Order()
DT = 0.1


def state(age: float = 0.0, heading: float = 0.3, valid: bool = True) -> NavState:
    return NavState(0.0, heading, 0.0, 4.0, 0.1, 0.0, age, valid)


def supervisor(action: str = "amidships", release_after: float = 3.0, resume: bool = False) -> Supervisor:
    return Supervisor(ENVELOPE_LIMITS, FailsafeAction(1.0, action, release_after, resume))


def engaged(action: str = "amidships", release_after: float = 3.0, resume: bool = False) -> Supervisor:
    made = supervisor(action, release_after, resume)
    assert made.decide(0.0, COURSE, state()) is Mode.ENGAGED
    return made


def lost(made: Supervisor, now: float = 1.0, order: Order = COURSE) -> Mode:
    return made.decide(now, order, state(age=1.5))


def human(available: bool, source: str = "link") -> HelmSample:
    return HelmSample(0.0, available, "" if available else "mode HOLD", source)


def test_standby_is_obeyed_from_everywhere() -> None:
    for made in (engaged(), engaged(), engaged()):
        assert made.decide(1.0, STANDBY, state()) is Mode.STANDBY
    failed = engaged()
    assert lost(failed) is Mode.FAILSAFE
    assert failed.decide(1.1, STANDBY, state()) is Mode.STANDBY
    overridden = engaged()
    overridden.on_sample(human(False))
    assert overridden.decide(0.1, COURSE, state()) is Mode.OVERRIDE
    assert overridden.decide(0.2, STANDBY, state()) is Mode.STANDBY
    assert said_by(overridden) == ()


def test_an_override_releases_and_only_a_new_serial_engages_again() -> None:
    made = engaged()
    made.on_sample(human(False))
    assert made.decide(0.1, COURSE, state()) is Mode.OVERRIDE
    assert sentences_of(said_by(made))[0].startswith("overridden: mode HOLD; the helm is yours")
    assert not made.check(0.1, 0.2, 0.3, 0.2, DT).engaged
    made.on_sample(human(True))
    for now in (0.2, 10.0, 100.0):
        assert made.decide(now, COURSE, state()) is Mode.OVERRIDE
    # another heading under the same serial is no request to engage again
    assert made.decide(101.0, COURSE._replace(heading=2.0), state()) is Mode.OVERRIDE
    assert made.decide(102.0, COURSE._replace(serial=2), state()) is Mode.ENGAGED


def test_the_timeout_itself_is_still_fresh_and_beyond_it_is_stale() -> None:
    made = engaged()
    assert made.decide(0.1, COURSE, state(age=1.0)) is Mode.ENGAGED
    assert made.decide(0.2, COURSE, state(age=1.0 + 1e-9)) is Mode.FAILSAFE


@pytest.mark.parametrize("action", ["amidships", "hold"])
def test_a_hand_on_the_helm_ends_a_fail_safe_that_still_steers(action: str) -> None:
    made = engaged(action)
    lost(made)
    made.on_sample(human(False))
    assert made.decide(1.2, COURSE, state(age=2.0)) is Mode.OVERRIDE
    assert not made.check(1.2, 0.2, 0.0, 0.0, DT).engaged


def test_an_interrupted_heading_starts_the_wait_again() -> None:
    made = engaged(resume=True)
    lost(made, now=1.0)
    made.decide(2.0, COURSE, state())
    lost(made, now=3.0)
    made.decide(3.5, COURSE, state())
    assert made.decide(4.5, COURSE, state()) is Mode.FAILSAFE
    assert made.decide(3.5 + RESUME_AFTER, COURSE, state()) is Mode.ENGAGED


def test_only_a_lost_heading_heals_by_itself() -> None:
    made = engaged(resume=True)
    made.decide(5.0, COURSE, state())
    made.check(5.0, 0.0, math.nan, 0.0, DT)
    for now in (5.1, 10.0, 100.0):
        assert made.decide(now, COURSE, state()) is Mode.FAULT


@pytest.mark.parametrize("action", ["amidships", "hold"])
def test_a_rudder_of_unlimited_rate_survives_two_ticks_at_one_moment(action: str) -> None:
    limits = RudderLimits(0.5, math.inf)
    made = Supervisor(Envelope(limits.angle_max, limits.rate_max), FailsafeAction(1.0, action, 3.0, False))
    made.decide(0.0, COURSE, state())
    command = limit(limits, 0.1, 0.4, 0.0)
    assert made.check(0.0, 0.1, 0.4, command, 0.0).engaged
    assert made.mode is Mode.ENGAGED
    lost(made)
    assert math.isfinite(made.check(1.0, 0.4, 0.0, 0.0, 0.0).angle)


def test_a_new_one_knows_nothing_of_helm_and_serials_and_one_with_the_memory_does() -> None:
    before = engaged()
    before.on_sample(human(False))
    before.decide(0.1, COURSE, state())
    limits = Envelope(*ENVELOPE_LIMITS), FailsafeAction(1.0, "hold", 3.0, False)
    again = Supervisor(*limits, before.memory)
    assert again.memory == before.memory
    assert again.decide(0.2, COURSE, state()) is Mode.OVERRIDE
    made = Supervisor(*limits)
    assert made.decide(0.2, COURSE, state()) is Mode.ENGAGED
