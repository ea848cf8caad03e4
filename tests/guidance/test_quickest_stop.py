"""The planned turn of a course-unstable boat: its stop looked ahead, and what the plan keeps to on the way."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import pytest
import turns
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.guidance.stop import UNSTOPPED, TurnLimits, stop_angle, turn_limits
from autopilot.guidance.tuning import PLANNED_SHARE
from autopilot.guidance.turn import NO_EVIDENCE, VirtualBoat, reference_of, turn_step
from autopilot.models.norrbin import Norrbin, rate_step, rudder_for, yaw_acceleration
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.runtime.build import planned_share
from autopilot.vessel.schema import StandardErrors

NAMES = ("unstable", *turns.MORE, *(f"drawn{number}" for number in range(1, 6)))
SHARE = 0.7
TARGET = math.radians(170.0)


@cache
def boats() -> dict[str, turns.Boat]:
    """Return the boats of NAMES; those drawn are designed for as they are drawn."""
    return {"unstable": turns.BOATS["unstable"], **turns.MORE, **turns.drawn(5, 20250101)}


def gear_of(boat: turns.Boat) -> SteeringGear:
    return SteeringGear(math.radians(boat.angle_deg), math.radians(boat.rate_deg_s), 0.1, 0.0, 0.05)


def limits_of(boat: turns.Boat, rate_max: float = math.inf) -> TurnLimits:
    return turn_limits(boat.model, gear_of(boat), SHARE, rate_max)


def stopped(model: Norrbin, limits: TurnLimits, rate: float, rudder: float) -> float:
    """Return the angle [rad] of the stop by the rule of its docstring, in fine steps."""
    turned, dt, jerk, kappa = 0.0, 2.0e-3 * model.time_constant, limits.jerk, limits.kappa
    near = jerk / (kappa * kappa)
    for _ in range(20_000):
        eased = kappa * rate if abs(rate) <= near else math.sqrt(2.0 * jerk * (abs(rate) - 0.5 * near))
        wanted = -eased if abs(rate) <= near else -math.copysign(eased, rate)
        order = clip(rudder_for(model, rate, wanted), -limits.rudder_max, limits.rudder_max)
        reach = limits.rudder_rate * dt
        rudder += clip(order - rudder, -reach, reach)
        before, rate = rate, rate_step(model, rate, rudder, dt)
        turned += 0.5 * dt * (before + rate)
        if abs(rate) < 1.0e-3 * near:
            break
    return turned


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("rate_share", "rudder_share"), [(0.05, 0.0), (0.3, 1.0), (0.6, 0.2), (0.9, -1.0), (0.6, -1.0)]
)
def test_the_angle_looked_ahead_is_that_of_the_stop(name: str, rate_share: float, rudder_share: float) -> None:
    boat = boats()[name]
    limits = limits_of(boat)
    rate, rudder = rate_share * limits.rate_max, rudder_share * limits.rudder_max
    ahead = stop_angle(boat.model, limits, rate, rudder)
    if ahead < UNSTOPPED:
        assert ahead == pytest.approx(stopped(boat.model, limits, rate, rudder), rel=0.05, abs=math.radians(0.3))


@pytest.mark.parametrize("name", NAMES)
def test_a_boat_that_its_rudder_does_not_stop_turns_beyond_any_angle(name: str) -> None:
    boat = boats()[name]
    model, limits = boat.model, limits_of(boat)
    peak = math.sqrt(-model.n1 / (3.0 * model.n3))
    holds = -yaw_acceleration(model, peak, -limits.rudder_max) > 0.0
    assert (stop_angle(model, limits, 0.99 * peak, -limits.rudder_max) >= UNSTOPPED) is not holds
    assert (stop_angle(model, limits, -0.99 * peak, limits.rudder_max) <= -UNSTOPPED) is not holds


STATES = st.tuples(st.sampled_from(NAMES), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))


@given(STATES)
@settings(deadline=None)
def test_both_sides_are_alike(state: tuple[str, float, float]) -> None:
    name, rate_share, rudder_share = state
    limits, model = limits_of(boats()[name]), boats()[name].model
    rate, rudder = rate_share * limits.rate_max, rudder_share * limits.rudder_max
    assert stop_angle(model, limits, -rate, -rudder) == pytest.approx(
        -stop_angle(model, limits, rate, rudder), abs=1.0e-9
    )


@given(STATES, st.floats(0.02, 0.3))
@settings(deadline=None)
def test_more_rate_or_rudder_takes_more_angle(state: tuple[str, float, float], more: float) -> None:
    name, rate_share, rudder_share = state
    limits, model = limits_of(boats()[name]), boats()[name].model
    rate, rudder = rate_share * limits.rate_max, rudder_share * limits.rudder_max
    here, slack = stop_angle(model, limits, rate, rudder), math.radians(0.2)
    assert stop_angle(model, limits, rate + more * limits.rate_max, rudder) > here - slack
    assert stop_angle(model, limits, rate, min(rudder + more * limits.rudder_max, limits.rudder_max)) > here - slack


def sailed(boat: turns.Boat, turn: float, dt: float, begun: tuple[float, float] = (0.0, 0.0)) -> list[VirtualBoat]:
    """Return the plan of a turn that ends at TARGET, tick by tick."""
    model, limits = boat.model, limits_of(boat)
    virtual, found = VirtualBoat(wrap(TARGET - turn), *begun), list[VirtualBoat]()
    for _ in range(round((6.0 * abs(turn) / limits.rate_max + 30.0 * model.time_constant) / dt)):
        virtual = turn_step(model, limits, virtual, TARGET, dt)
        found.append(virtual)
        if abs(wrap(TARGET - virtual.heading)) + abs(virtual.rate) < 1.0e-4:
            break
    return found


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("turn_deg", "dt"), [(4.0, 0.05), (-25.0, 0.1), (90.0, 0.05), (-179.0, 0.1), (90.0, 0.25)])
def test_a_plan_leads_to_the_course_and_not_past_it(name: str, turn_deg: float, dt: float) -> None:
    boat, side = boats()[name], math.copysign(1.0, turn_deg)
    limits, plan = limits_of(boat), sailed(boats()[name], math.radians(turn_deg), dt)
    assert max(side * wrap(each.heading - TARGET) for each in plan if abs(wrap(each.heading - TARGET)) < 1.0) < 0.01
    assert wrap(plan[-1].heading - TARGET) == pytest.approx(0.0, abs=1.0e-3)
    assert max(side * each.rate for each in plan) < 1.02 * limits.rate_max
    assert max(abs(each.rudder) for each in plan) <= PLANNED_SHARE * SHARE * math.radians(boat.angle_deg) * (
        1.0 + 1.0e-9
    )
    fastest = max(abs(after.rudder - here.rudder) for here, after in pairwise(plan)) / dt
    assert fastest <= PLANNED_SHARE * SHARE * math.radians(boat.rate_deg_s) * (1.0 + 1.0e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_trim_and_asymmetry_are_planned_with(side: float) -> None:
    boat = boats()["unstable"]
    model = boat.model._replace(n0=side * 0.01, n2=side * 2.0)
    plan = sailed(boat._replace(model=model), math.radians(90.0), 0.05)
    assert max(wrap(each.heading - TARGET) for each in plan if abs(wrap(each.heading - TARGET)) < 1.0) < 0.01
    assert plan[-1].rudder == pytest.approx(rudder_for(model, 0.0, 0.0), abs=3.0e-3)


@pytest.mark.parametrize("name", NAMES)
def test_planned_anew_in_mid_turn_it_still_ends_at_the_course(name: str) -> None:
    boat = boats()[name]
    limits = limits_of(boat)
    begun = 0.7 * limits.rate_max, 0.5 * limits.rudder_max
    left = 1.05 * stop_angle(boat.model, limits, *begun) + math.radians(1.0)
    if left < math.radians(175.0):
        plan = sailed(boat, left, 0.05, begun)
        assert max(wrap(each.heading - TARGET) for each in plan if abs(wrap(each.heading - TARGET)) < 1.0) < 0.02


def test_a_preset_rate_is_kept_to() -> None:
    boat = boats()["unstable2"]
    assert limits_of(boat, math.radians(1.0)).rate_max == math.radians(1.0)
    assert limits_of(boat).rate_max > math.radians(1.0)


def test_the_boat_is_led_by_as_much_later_as_its_rudder_is_late() -> None:
    boat = boats()["unstable"]
    limits, plan = limits_of(boat), VirtualBoat(1.0, 0.04, 0.1, NO_EVIDENCE)
    led, a = reference_of(boat.model, limits, plan), yaw_acceleration(boat.model, 0.04, 0.1)
    assert limits.late == pytest.approx(0.15)
    assert led.rate == pytest.approx(0.04 - 0.15 * a)
    assert led.heading == pytest.approx(1.0 - 0.15 * 0.04 + 0.5 * 0.15**2 * a)
    assert led.acceleration == pytest.approx(a)


def test_more_doubt_in_the_rudder_makes_a_slower_plan() -> None:
    boat = boats()["unstable"]
    tops = [turn_limits(boat.model, gear_of(boat), share).rate_max for share in (0.5, 0.6, 0.7, 0.8, 0.9)]
    assert tops == sorted(tops)


@pytest.mark.parametrize(("n1", "n3"), [(0.0, 0.0), (0.0, 20.0), (-0.5, 0.0), (-1.0e-4, 5.0)])
def test_a_boat_without_damping_or_next_to_it_is_planned_for(n1: float, n3: float) -> None:
    boat = turns.Boat(Norrbin(0.2, 5.0, n3, n1=n1, reference_speed=3.0), 30.0, 5.0)
    plan = sailed(boat, math.radians(60.0), 0.1)
    assert max(wrap(each.heading - TARGET) for each in plan if abs(wrap(each.heading - TARGET)) < 1.0) < 0.01
    assert wrap(plan[-1].heading - TARGET) == pytest.approx(0.0, abs=1.0e-3)


@pytest.mark.parametrize(
    ("n1", "error", "share"), [(-0.5, 0.02, 0.7), (-0.5, 0.05, 0.5), (-0.5, 0.2, 0.3), (1.0, 0.05, 0.7)]
)
def test_a_k_that_is_not_sure_leaves_less_of_the_rudder_to_the_plan(n1: float, error: float, share: float) -> None:
    vessel = turns.vessel_of(boats()["unstable"])
    model = replace(vessel.model, n1=n1, standard_errors=StandardErrors(K_1_s=error))
    assert vessel.model.K_1_s == 0.2
    assert planned_share(replace(vessel, model=model)) == pytest.approx(share)
    assert planned_share(vessel) == vessel.guidance.rudder_share
