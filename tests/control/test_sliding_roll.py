"""The heading and roll law as the pilot holds it: what it hears, when it helps, when it is off, and what it refuses."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from importlib import resources
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naval_vessel import linear_motion
from steersman import Steersman

from autopilot.control.rudder_roll import Motion, RollGains, linear_response, linear_step_of, roll_rudder
from autopilot.control.sliding_heading import SwayYawGains, sway_yaw_rudder
from autopilot.control.sliding_roll import (
    LIST_TIME,
    OLD,
    AtSpeed,
    QuietHeading,
    RollShip,
    laws_at,
    near_surface_quiet,
    near_surface_roll,
    place_of,
    scaled_model,
    slowest,
)
from autopilot.errors import InputError, RefusedError
from autopilot.models.norrbin import at_speed, rudder_for
from autopilot.models.steering_gear import gear_step
from autopilot.runtime.build import build_pilot, law_of, model_of
from autopilot.signals import HeadingSample, NavState, Order, OrderKind, Reference, RollSample
from autopilot.vessel.file import load_vessel, parse_vessel
from autopilot.vessel.schema import Roll, Vessel
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED

DT = 0.1
VESSEL = load_vessel("naval_vessel")
SHIP = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
MODEL = model_of(VESSEL)
NORTH = Reference(0.0)
REST = Motion(0.0, 0.0, 0.0, 0.0, 0.0)


def made(vessel: Vessel) -> Steersman:
    return Steersman(law_of(vessel, "sliding_roll"), SERVICE_SPEED)


def at_ratio(ratio: float) -> AtSpeed:
    """The laws in force at `ratio` times the reference speed."""
    found: AtSpeed = LAW.gains.speeds[place_of(ratio)]
    return found


LAW = made(VESSEL)


@pytest.fixture
def law() -> Steersman:
    LAW.reset(0.0)
    return LAW


def state(time: float, heading: float = 0.0, rate: float = 0.0, rudder: float = 0.0, bias: float = 0.0) -> NavState:
    return NavState(time, heading, rate, SERVICE_SPEED, rudder, bias, 0.0, True)


def sailed(law: Steersman, seconds: float, frequency: float, start: float = 0.0, hears: bool = True) -> list[float]:
    """The linear ship in a swell of one frequency [rad/s] that heels it; returns the roll angles [rad]."""
    step, gear, x, rudder, roll = linear_step_of(SHIP, DT), law.gains.ship.gear, REST, 0.0, []
    for index in range(round(seconds / DT)):
        now = start + DT * index
        if hears:
            law.on_sample(RollSample(now, x.phi, x.p))
        demand = law.update(MODEL, NORTH, state(now, x.psi, x.r, rudder), rudder, DT)
        rudder = gear_step(gear, rudder, demand, DT)
        x = linear_response(step, x, rudder)
        x = x._replace(p=x.p + DT * 0.01 * math.sin(frequency * now))
        roll.append(x.phi)
    return roll


def test_the_shipped_ship_is_the_published_one() -> None:
    section = VESSEL.control.sliding_roll
    assert section is not None
    rows = np.array((section.sway_row, section.roll_row, section.yaw_row))
    assert rows[:, :4] == pytest.approx(SHIP.A[:3, :4], rel=1e-5)
    assert rows[:, 4] == pytest.approx(SHIP.b[:3], rel=1e-5)
    assert VESSEL.model.reference_speed_m_s == pytest.approx(SERVICE_SPEED)


def test_near_the_natural_frequency_it_comes_on_and_lessens_the_roll(law: Steersman) -> None:
    deaf = sailed(law, 140.0, 1.1, hears=False)
    assert law.weight == 0.0
    law.reset(0.0)
    sailed(law, LAW.gains.settings.wait - 1.0, 1.1)
    assert law.weight == 0.0
    law.reset(0.0)
    heard = sailed(law, 140.0, 1.1)
    assert law.weight == 1.0
    assert np.std(heard[-400:]) < 0.75 * np.std(deaf[-400:])


def test_where_it_would_amplify_it_stays_off(law: Steersman) -> None:
    sailed(law, 150.0, 0.42)
    assert law.weight == 0.0


@pytest.fixture(scope="module")
def weighed() -> Steersman:
    """The law after 100 s near the natural frequency, when it steers with its full weight."""
    found = made(VESSEL)
    sailed(found, LAST + DT, 1.1)
    assert found.weight == 1.0
    return found


@pytest.fixture
def rolling(weighed: Steersman) -> Steersman:
    return copy.copy(weighed)


LAST = 100.0 - DT
"""Time [s] of the last tick that `rolling` has seen."""


def quiet_demand(at: NavState) -> float:
    LAW.reset(0.0)
    return LAW.update(MODEL, NORTH, at, 0.0, DT)


BAD = [(math.nan, 0.0), (0.0, math.inf), (-math.inf, 0.0), (1.0e300, 0.0), (0.1, -1.0e9)]


@pytest.mark.parametrize("bad", BAD)
def test_roll_that_is_no_roll_ends_it_at_once(rolling: Steersman, bad: tuple[float, float]) -> None:
    law, now = rolling, LAST + DT
    law.on_sample(RollSample(now, 0.05, 0.05))
    with_roll = law.update(MODEL, NORTH, at := state(now, 0.05, 0.01), 0.0, DT)
    assert law.weight == 1.0
    law.on_sample(RollSample(now, *bad))
    without = law.update(MODEL, NORTH, at, 0.0, DT)
    assert law.weight == 0.0
    assert without == quiet_demand(at)
    assert abs(with_roll - without) > 0.02


def test_old_roll_ends_it_and_the_sea_is_weighed_anew(rolling: Steersman) -> None:
    rolling.update(MODEL, NORTH, state(LAST + 0.4, 0.05), 0.0, DT)
    assert rolling.weight > 0.99
    rolling.update(MODEL, NORTH, state(LAST + OLD + 0.05, 0.05), 0.0, DT)
    assert rolling.weight == 0.0
    sailed(rolling, 30.0, 1.1, start=LAST + 1.0)
    assert rolling.weight == 0.0


def test_a_heading_that_is_reckoned_leaves_it_to_the_quiet_law(rolling: Steersman) -> None:
    law, now = rolling, LAST + DT
    law.on_sample(RollSample(now, 0.05, 0.05))
    reckoned = state(now, 0.05)._replace(heading_age=5.0)
    assert law.update(MODEL, NORTH, reckoned, 0.0, DT) == quiet_demand(reckoned)


def test_roll_of_an_instrument_without_a_rate_is_left_aside(rolling: Steersman) -> None:
    law, now = rolling, LAST + DT
    law.on_sample(RollSample(now, 0.05, 0.05))
    law.on_sample(RollSample(now, math.nan, None))
    law.update(MODEL, NORTH, state(now), 0.0, DT)
    assert law.weight == 1.0


def test_after_a_trial_the_sea_is_weighed_anew(rolling: Steersman) -> None:
    law, now = rolling, LAST + 20.0
    law.on_sample(RollSample(now, 0.05, 0.05))
    law.update(MODEL, NORTH, state(now), 0.0, DT)
    assert law.weight == 0.0


def test_a_list_is_not_steered_against(law: Steersman) -> None:
    heel = math.radians(5.0)
    for index in range(round(5.0 * LIST_TIME / DT)):
        law.on_sample(RollSample(DT * index, heel, 0.0))
        demand = law.update(MODEL, NORTH, state(DT * index), 0.0, DT)
    assert abs(demand) < 1e-3


def test_bias_is_taken_off_the_demand(rolling: Steersman) -> None:
    law, now = rolling, LAST + DT
    law.on_sample(RollSample(now, 0.05, 0.05))
    plain = law.update(MODEL, NORTH, state(now, 0.05), 0.0, 0.0)
    assert law.update(MODEL, NORTH, state(now, 0.05, bias=0.03), 0.0, 0.0) == pytest.approx(plain - 0.03)


@given(rate=st.floats(-0.05, 0.05))
def test_in_a_steady_turn_it_asks_for_the_turns_rudder_and_no_more(rate: float) -> None:
    LAW.reset(0.0)
    turn, at = Reference(0.3, rate), at_ratio(1.0)
    LAW.on_sample(RollSample(0.0, at.roll_per_rate * rate, 0.0))
    demand = LAW.update(MODEL, turn, state(0.0, 0.3, rate), 0.0, DT)
    assert demand == pytest.approx(rudder_for(MODEL, rate, 0.0), abs=1e-9)
    hull = at.model.A @ np.array([at.sway_per_rate * rate, 0.0, rate, at.roll_per_rate * rate, 0.0])
    # one rudder angle makes good what v', p' and r' would be
    assert hull[:3] == pytest.approx(hull[2] / at.model.b[2] * at.model.b[:3], abs=1e-9)


@given(roll=st.floats(-3.2, 3.2), rate=st.floats(-10.0, 10.0), dt=st.sampled_from([0.0, 1e-9, 0.05, 0.5, 1e6]))
def test_whatever_it_hears_port_mirrors_starboard_and_all_is_finite(roll: float, rate: float, dt: float) -> None:
    found = []
    for side in (1.0, -1.0):
        LAW.reset(0.0)
        for index in range(5):
            now = 0.1 * index
            LAW.on_sample(RollSample(now, side * roll * (index + 1), side * rate))
            found.append(side * LAW.update(MODEL, NORTH, state(now, side * 0.1 * index), 0.0, dt))
    assert all(map(math.isfinite, found))
    assert found[:5] == pytest.approx(found[5:], abs=1e-12)


@pytest.mark.parametrize("ratio", [0.5, 0.75, 1.25, 1.5])
def test_the_model_goes_with_the_speed_as_the_published_ship_does(ratio: float) -> None:
    real = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, ratio * SERVICE_SPEED)
    ours = scaled_model(SHIP, ratio)
    assert ours.b == pytest.approx(real.b)
    poles, theirs = (np.sort_complex(np.linalg.eigvals(A[:4, :4])) for A in (ours.A, real.A))
    assert np.all(np.abs(poles - theirs) < 0.02)


def test_gains_follow_the_speed_within_the_range_of_all_laws(law: Steersman) -> None:
    here, slow = at_ratio(1.0), at_ratio(0.5)
    assert slow.roll.k_p == pytest.approx(2.0 * here.roll.k_p, rel=0.06)
    assert slow.roll.k_phi / here.roll.k_phi == pytest.approx(slow.roll.k_p / here.roll.k_p)
    # rudder per heading error near the surface stays
    of = lambda quiet: quiet.switching * quiet.h_psi / quiet.boundary  # noqa: E731
    assert of(slow.quiet) == pytest.approx(of(here.quiet), rel=1e-6)
    assert at_ratio(0.01) == at_ratio(0.2)
    assert at_ratio(9.0) == at_ratio(1.5)
    asked = law.update(at_speed(MODEL, 0.5 * SERVICE_SPEED), NORTH, state(0.0, 0.0, 0.01), 0.0, DT)
    assert asked == pytest.approx(2.0 * law.update(MODEL, NORTH, state(0.0, 0.0, 0.01), 0.0, DT), rel=0.07)


def with_roll_law(**changes: Any) -> Vessel:
    section = VESSEL.control.sliding_roll
    assert section is not None
    return replace(VESSEL, control=replace(VESSEL.control, sliding_roll=replace(section, **changes)))


ZERO = {"sway_row": (-0.12, 0.0, -2.1, 0.1, 0.0), "roll_row": (0.0, -0.2, -1.1, -1.3, 0.0)}


@pytest.mark.parametrize(
    ("vessel", "sentence"),
    [
        (with_roll_law(k_p_s=-20.0), r"control\.sliding_roll: at 0\.2 times .*leave A - b k' with an eigenvalue"),
        (with_roll_law(k_phi=-60.0), "times the reference speed: .*leave A - b k'"),
        (with_roll_law(**ZERO, yaw_row=(-0.01, 0.0, -0.35, 0.0, 0.0)), "h'b is zero|has no steady turn"),
        (with_roll_law(roll_row=(0.03, 0.2, -1.13, -1.27, 0.15)), "rudder amidships must be stable"),
        (with_roll_law(boundary=1e-4), "the roll law swings with the rudder's lag of 0.1 s and 0.05 s of dead time"),
        (with_roll_law(quiet=QuietHeading(0.0741, 3.41, 0.0352, 1e-4)), "the quiet law swings"),
        (replace(VESSEL, control=replace(VESSEL.control, sliding_roll=None)), r"add control\.sliding_roll to the file"),
        (replace(VESSEL, control=replace(VESSEL.control, roll=Roll(0.5))), r"excludes the section control\.roll"),
    ],
)
def test_what_must_not_be_engaged_is_refused_with_the_reason(vessel: Vessel, sentence: str) -> None:
    with pytest.raises(RefusedError, match=sentence):
        law_of(vessel)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("yaw_row: [-0.0106578, ", "yaw_row: [", "control.sliding_roll.yaw_row has 4 entries, 5 are needed."),
        ("[0.0260555,", "[.nan,", "control.sliding_roll.roll_row[0] is nan, needed is a finite number."),
        ("    k_phi: 4.442\n", "", "the key control.sliding_roll.k_phi is missing"),
        ("reach: 0.08", "reach: 0", "control.sliding_roll.reach is 0, needed is a finite number from 1e-09"),
        (
            "k_p_s: 2.618",
            "k_p: 2.618",
            "control.sliding_roll.k_p is not a known key: the unit is in the key, use k_p_s.",
        ),
    ],
)
def test_each_mistake_in_the_section_is_named(old: str, new: str, sentence: str) -> None:
    text = (resources.files("firmware_params") / "vessels" / "naval_vessel.yaml").read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(InputError) as caught:
        parse_vessel(text.replace(old, new, 1))
    assert sentence in str(caught.value)


def commanded(kind: OrderKind, seconds: float) -> list[float]:
    """The whole pilot on a ship that lies dead on course and rolls; returns the rudder command [rad]."""
    # nobody may take the ship for one whose compass is frozen
    still = replace(VESSEL, alarms=replace(VESSEL.alarms, frozen_heading=False))
    pilot, commands = build_pilot(still), []
    for index in range(round(seconds / DT)):
        now = DT * index
        roll = RollSample(now, 0.05 / 1.1 * math.sin(1.1 * now), 0.05 * math.cos(1.1 * now))
        tick = pilot.step(now, (HeadingSample(now, 0.0, 0.0), roll), Order(kind, 0.0, 0.05, serial=1))
        commands.append(tick.command.angle)
    return commands


def test_the_pilot_engages_without_a_bump_and_the_law_comes_on_by_itself() -> None:
    commands = commanded(OrderKind.HEADING, LAW.gains.settings.wait + 20.0)
    assert max(map(abs, commands[: round(LAW.gains.settings.wait / DT)])) < 1e-9
    assert max(map(abs, commands)) > 0.01


def test_trials_keep_the_rudder_they_order() -> None:
    assert commanded(OrderKind.RUDDER, LAW.gains.settings.wait + 20.0)[-1] == pytest.approx(0.05)


@pytest.mark.parametrize("k", [-0.5, 0.0, 2.0, 20.0])
@pytest.mark.parametrize(("lag", "delay"), [(0.1, 0.2), (0.5, 0.05), (0.0, 0.0)])
def test_the_slowest_pole_is_that_of_the_loop_s_polynomial(k: float, lag: float, delay: float) -> None:
    """x' = -x + 3 u beside modes that nobody feels; u + lag u' = -k x (1 - delay s/2)/(1 + delay s/2), each of at
    least a millisecond: (s + 1)(1 + lag s)(1 + delay s/2) + 3 k (1 - delay s/2) = 0."""
    model = SHIP._replace(A=np.diag([-1.0, -90.0, -91.0, -92.0, -93.0]), b=np.array([3.0, 0.0, 0.0, 0.0, 0.0]))
    ship = RollShip(model, 7.0, LAW.gains.ship.gear._replace(lag=lag), delay)
    tau, half = max(lag, 0.001), max(0.5 * delay, 0.001)
    open_loop = np.polymul(np.polymul([1.0, 1.0], [tau, 1.0]), [half, 1.0])
    poles = np.roots(np.polyadd(open_loop, 3.0 * k * np.array([-half, 1.0])))
    wanted = max(float(poles.real.max()), -90.0)
    assert slowest(ship, model, np.array([k, 0.0, 0.0, 0.0, 0.0])) == pytest.approx(wanted)


def sections() -> tuple[Any, Any]:
    """Gains of the quiet law and of the roll law that the published ship's file has."""
    at = at_ratio(1.0)
    quiet = SwayYawGains(
        at.quiet.k_v, at.quiet.k_r, through(at.quiet, "vr", LAW.gains.ship.model.b[[0, 2, 4]]), at.quiet.boundary
    )
    k = (at.roll.k_v, at.roll.k_p, at.roll.k_r, at.roll.k_phi)
    return quiet, RollGains(*k, through(at.roll, ("v", "p", "r", "phi"), LAW.gains.ship.model.b), at.roll.boundary)


def through(law: Any, names: Any, b: Any) -> float:
    """eta of a law: its switching times h'b."""
    return float(law.switching * (np.array([getattr(law, f"h_{name}") for name in (*names, "psi")]) @ b))


@pytest.mark.parametrize("ratio", [0.3, 1.0, 1.4])
def test_gains_go_with_the_speed_and_surfaces_are_those_of_the_model_there(ratio: float) -> None:
    """k with 1/ratio; counted in heading, eta goes with the ratio and the boundary stays."""
    quiet, roll = sections()
    ship = LAW.gains.ship
    at, here = laws_at(ship, quiet, roll, ratio), laws_at(ship, quiet, roll, 1.0)
    b = LAW.gains.ship.model.b * ratio * ratio
    for law, base, names, bs, b0 in (
        (at.quiet, here.quiet, "vr", b[[0, 2, 4]], LAW.gains.ship.model.b[[0, 2, 4]]),
        (at.roll, here.roll, ("v", "p", "r", "phi"), b, LAW.gains.ship.model.b),
    ):
        for name in names:
            assert getattr(law, f"k_{name}") == pytest.approx(getattr(base, f"k_{name}") / ratio)
        assert through(law, names, bs) / law.h_psi == pytest.approx(ratio * through(base, names, b0) / base.h_psi)
        assert law.boundary / law.h_psi == pytest.approx(base.boundary / base.h_psi)
    h = np.array([at.roll.h_v, at.roll.h_p, at.roll.h_r, at.roll.h_phi, at.roll.h_psi])
    k = np.array([at.roll.k_v, at.roll.k_p, at.roll.k_r, at.roll.k_phi, 0.0])
    model = scaled_model(ship.model, ratio)
    assert (model.A - np.outer(model.b, k)).T @ h == pytest.approx(np.zeros(5), abs=1e-12), "the surface"
    turn = np.array([at.sway_per_rate, 0.0, 1.0, at.roll_per_rate, 0.0])
    held = model.A @ turn
    assert np.linalg.matrix_rank(np.column_stack((held[:3], model.b[:3])), tol=1e-9) == 1, "a rudder holds the turn"


def test_near_its_surface_a_law_is_the_slope_of_its_demand() -> None:
    at, small = at_ratio(0.7), 1.0e-6
    for place in range(5):
        x = np.zeros(5)
        x[place] = small
        slope = -roll_rudder(at.roll, Motion(*x), 0.0) / small if place else 0.0
        assert near_surface_roll(at.roll)[place] == pytest.approx(slope, rel=1e-6, abs=1e-9), (
            "sway counts as the turn's"
        )
        slope = -sway_yaw_rudder(at.quiet, 0.0, x[2], x[4]) / small
        assert near_surface_quiet(at.quiet)[place] == pytest.approx(slope, rel=1e-6, abs=1e-9)


def test_what_the_schedule_hears_and_what_is_made_of_its_weight(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a planned turn at 0.01 rad/s, with 0.03 rad of bias; a step of the shadows has whole milliseconds."""
    law, heard = copy.copy(LAW), []
    law.reset(0.0)

    def step(parts: Any, schedule: Any, *given: Any) -> Any:
        heard.append((parts, *given))
        return schedule._replace(weight=0.3)

    monkeypatch.setattr("autopilot.control.sliding_roll.schedule_step", step)
    reference = Reference(0.2, 0.01, 0.001)
    planned = rudder_for(MODEL, 0.01, 0.001)
    at = at_ratio(MODEL.reference_speed / SERVICE_SPEED)
    rolls, rates, listed = (0.05, 0.02, -0.04), (0.01, -0.02, 0.03), 0.0
    for number, (roll, rate) in enumerate(zip(rolls, rates, strict=True), 1):
        now = 5.0 + 0.1004 * number
        law.on_sample(RollSample(now, roll, rate))
        seen = state(now, 0.25, 0.012, rudder=0.08, bias=0.03)
        demand = law.update(MODEL, reference, seen, 0.08, 0.1004)
        heel = roll - at.roll_per_rate * 0.01
        listed += (heel - listed) / number
        off = Motion(0.0, rate, 0.002, heel - listed, 0.05)
        parts, motion, goal, rudder, dt = heard[-1]
        assert motion == pytest.approx(off)
        assert (goal, dt) == (0.0, 0.101 if number == 2 else 0.1)
        assert rudder == pytest.approx(0.08 + 0.03 - planned)
        assert (parts.quiet, parts.roll) == (at.quiet, at.roll)
        quiet = sway_yaw_rudder(at.quiet, 0.0, 0.002, 0.05)
        wanted = planned + 0.7 * quiet + 0.3 * roll_rudder(at.roll, off, 0.0) - 0.03
        assert demand == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("change", "keeps"),
    [
        ({"gap": 0.5}, True),
        ({"gap": 0.51}, False),
        ({"gap": -0.5}, True),
        ({"gap": -0.51}, False),
        ({"age": 0.5}, True),
        ({"age": 0.51}, False),
        ({"age": -0.5}, True),
        ({"age": -0.51}, False),
        ({"heading_age": 2.0}, True),
        ({"heading_age": 2.01}, False),
        ({"roll": math.pi}, True),
        ({"roll": -3.15}, False),
        ({"rate": -math.pi}, True),
        ({"rate": 3.15}, False),
    ],
)
def test_roll_and_heading_are_fresh_for_so_long_and_a_pause_is_half_a_second(
    rolling: Steersman, change: dict[str, float], keeps: bool
) -> None:
    before = 128.0
    rolling.memory = rolling.memory._replace(time=before)  # an exact number, so that the limits are
    now = before + change.get("gap", 0.125)
    rolling.on_sample(RollSample(now - change.get("age", 0.0), change.get("roll", 0.05), change.get("rate", 0.05)))
    seen = state(now, 0.05)._replace(heading_age=change.get("heading_age", 0.0))
    rolling.update(MODEL, NORTH, seen, 0.0, 0.125)
    assert (rolling.weight > 0.9) is keeps


def test_the_list_is_a_15_s_mean_with_steps_capped_at_0_5_s(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    law, heard = copy.copy(LAW), []
    law.reset(0.0)
    monkeypatch.setattr(
        "autopilot.control.sliding_roll.schedule_step",
        lambda _, schedule, off, goal, rudder, dt: [heard.append((off.phi, dt)), schedule][1],
    )

    def look(now: float, roll: float, dt: float) -> tuple[float, float]:
        law.on_sample(RollSample(now, roll, 0.0))
        law.update(MODEL, NORTH, state(now), 0.0, dt)
        return heard[-1]

    for number in range(200):
        look(0.1 * number, 0.1, 0.1)
    assert look(20.0, 0.4, 0.1)[0] == pytest.approx(0.3 * (1.0 - 0.1 / 15.0))
    assert look(20.1, 0.4, 0.9)[1] == pytest.approx(0.5)
    assert look(20.2, 0.4, 0.1)[1] == pytest.approx(0.1), "and the rest of it is dropped"


@pytest.mark.parametrize(("pole", "is_refused"), [(-1.0e-9, False), (0.0, True), (0.01, True)])
def test_a_loop_that_does_not_die_away_is_refused(
    monkeypatch: pytest.MonkeyPatch, pole: float, is_refused: bool
) -> None:
    monkeypatch.setattr("autopilot.control.sliding_roll.slowest", lambda *_: pole)
    quiet, roll = sections()
    if is_refused:
        with pytest.raises(ValueError, match="the quiet law swings with the rudder's lag"):
            laws_at(LAW.gains.ship, quiet, roll, 1.0)
    else:
        assert laws_at(LAW.gains.ship, quiet, roll, 1.0).quiet.k_r > 0.0
