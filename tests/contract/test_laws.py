"""What every heading law owes the pilot, asked of each law that ships."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from steersman import Steersman, asked, law_with

from autopilot.angles import wrap
from autopilot.control.backstepping import BacksteppingGains
from autopilot.control.law import LawBoat, LawInForce
from autopilot.control.limits import RudderLimits
from autopilot.control.pid import BoatPid, Pid, PidGains, PidMemory, boat_pid, feed_forward, gains_for
from autopilot.control.pid import step as pid_step
from autopilot.control.registry import LAWS as REGISTERED
from autopilot.control.registry import law_step, register
from autopilot.control.sliding_heading import SlidingGains
from autopilot.models.norrbin import Norrbin, at_speed
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import law_of
from autopilot.signals import NavState, Reference
from autopilot.vessel.file import load_vessel

LANXIN = Norrbin(0.701, 0.332, 3.2828, reference_speed=4.63)
ROLLING = law_of(load_vessel("naval_vessel"), "sliding_roll")
"""Ready in a tenth of a second."""


def steersman(law: LawInForce) -> Steersman:
    return Steersman(law, LANXIN.reference_speed)


def with_pid(*gains: float) -> Steersman:
    return steersman(law_with(PidGains(*gains)))


KNOWN = LANXIN.gain / LANXIN.reference_speed
LAWS: dict[str, Callable[[], Steersman]] = {
    "backstepping": lambda: steersman(law_with(BacksteppingGains(2.0, 2.0))),
    "backstepping that spares the rudder": lambda: steersman(law_with(BacksteppingGains(2.0, 2.0, 1.0, 0.3))),
    "pid": lambda: steersman(law_with(PidGains(2.4, 0.24, 0.47), KNOWN)),
    "pid without integral": lambda: steersman(law_with(PidGains(2.4, 0.0, 0.47), KNOWN)),
    "sliding": lambda: steersman(law_with(SlidingGains(2.0, 1.1, 0.55))),
    "sliding_roll": lambda: Steersman(ROLLING, ROLLING.gains.ship.reference_speed),
}
BOAT = LawBoat(LANXIN, SteeringGear(0.6, 0.3), RudderLimits(0.6, 0.3), 0.1)
NORTH = Reference(0.0)
DT = 0.05

small = st.floats(-1.0, 1.0)


@pytest.fixture(params=LAWS)
def make(request: pytest.FixtureRequest) -> Callable[[], Steersman]:
    return LAWS[request.param]


def state(heading: float = 0.0, rate: float = 0.0, rudder: float = 0.0) -> NavState:
    return NavState(0.0, heading, rate, 4.63, rudder, 0.0, 0.0, True)


def demand(law: Steersman, heading: float, rate: float = 0.0, reference: Reference = NORTH) -> float:
    law.reset(0.0)
    return law.update(LANXIN, reference, state(heading, rate), 0.0, DT)


def test_every_registered_law_that_steers_is_asked_here() -> None:
    assert {make().kind.name for make in LAWS.values()} == {
        name for name, law in REGISTERED.items() if law.linear is not None
    }


def test_no_two_laws_share_a_name_gains_or_the_names_of_their_parameters() -> None:
    laws = [law for law in REGISTERED.values() if law.section is not None]
    assert len({law.prefix for law in laws}) == len({law.title for law in laws}) == len(laws)
    for law in REGISTERED.values():
        with pytest.raises(ValueError, match="there is one of this name, or with gains of the type"):
            register(law._replace(name="another"))


def test_what_the_tick_calls_is_the_step_of_the_law_whose_gains_these_are(make: Callable[[], Steersman]) -> None:
    law = make().law
    given = asked(LANXIN, NORTH, 0.1, 0.02)
    assert law_step(law.gains, law.first(0.0), given) == law.step(law.first(0.0), given)


def test_on_course_and_still_it_asks_for_nothing(make: Callable[[], Steersman]) -> None:
    assert demand(make(), 0.0) == 0.0


def test_it_steers_back_and_against_the_turn(make: Callable[[], Steersman]) -> None:
    assert demand(make(), -0.1) > 0.0 > demand(make(), 0.1)
    assert demand(make(), 0.0, 0.1) < 0.0 < demand(make(), 0.0, -0.1)


@given(heading=small, rate=small, goal_rate=small)
@pytest.mark.parametrize("name", LAWS)
def test_port_mirrors_starboard(name: str, heading: float, rate: float, goal_rate: float) -> None:
    law = LAWS[name]()
    port = demand(law, heading, rate, Reference(0.0, goal_rate))
    assert demand(law, -heading, -rate, Reference(0.0, -goal_rate)) == pytest.approx(-port, abs=1e-12)


@given(course=st.floats(-math.pi, math.pi), error=small)
@pytest.mark.parametrize("name", LAWS)
def test_no_course_is_special_and_180_deg_least_of_all(name: str, course: float, error: float) -> None:
    law = LAWS[name]()
    turned = demand(law, wrap(course + error), 0.0, Reference(course))
    assert turned == pytest.approx(demand(law, error), abs=1e-9)


def test_the_same_inputs_after_reset_give_the_same_bits(make: Callable[[], Steersman]) -> None:
    law = make()

    def run() -> list[float]:
        law.reset(0.05)
        command, out = 0.05, []
        for index in range(50):
            out.append(law.update(LANXIN, NORTH, state(0.1 * math.sin(index), 0.02), command, DT))
            command = max(-0.3, min(0.3, out[-1]))
        return out

    assert run() == run()


def test_any_time_step_gives_a_finite_demand(make: Callable[[], Steersman]) -> None:
    law = make()
    law.reset(0.0)
    for dt in (0.0, 1.0e-9, 0.5, 1.0e6):
        assert math.isfinite(law.update(LANXIN, NORTH, state(3.0, -1.0), 0.5, dt))


def test_a_law_that_integrates_takes_over_the_rudder_that_is() -> None:
    law = LAWS["pid"]()
    law.reset(0.12)
    assert law.update(LANXIN, NORTH, state(), 0.12, DT) == pytest.approx(0.12)


def test_a_law_without_an_integral_does_not_keep_the_rudder_that_is() -> None:
    law = LAWS["pid without integral"]()
    law.reset(0.12)
    assert law.update(LANXIN, NORTH, state(), 0.12, DT) == 0.0


def test_a_law_that_spares_the_rudder_begins_at_the_rudder_that_is() -> None:
    law = LAWS["backstepping that spares the rudder"]()
    law.reset(0.12)
    assert law.update(LANXIN, NORTH, state(0.5), 0.12, 0.0) == 0.12
    assert law.update(LANXIN, NORTH, state(0.5), 0.12, 1.0e-5) == pytest.approx(0.12, abs=1e-3)


def test_a_planned_turn_gets_its_rudder_at_once() -> None:
    spared, plain = (LAWS[name]() for name in ("backstepping that spares the rudder", "backstepping"))
    turning = Reference(0.0, 0.1)
    assert spared.update(LANXIN, turning, state(), 0.0, DT) == plain.update(LANXIN, turning, state(), 0.0, DT)


def test_a_limited_rudder_is_nothing_to_unwind_from() -> None:
    within = 0.3 * (1.0 - math.exp(-DT / 0.3))
    # as long as nothing is known of the play, and later with it
    for ticks in (60, 1200):
        law, command = LAWS["backstepping that spares the rudder"](), 0.0
        law.reset(0.0)
        for _ in range(ticks):
            command = max(-0.3, min(0.3, law.update(LANXIN, NORTH, state(-1.0), command, DT)))
        assert command == 0.3
        demand = law.update(LANXIN, NORTH, state(0.0), command, DT)
        if ticks == 60:
            # but for what that rudder will have turned the boat by half a tick from now
            assert demand == pytest.approx(0.3 - within, abs=1.0e-3)
        else:
            assert demand < 0.3 - within


def test_at_half_speed_a_spared_rudder_takes_twice_the_time() -> None:
    law = LAWS["backstepping that spares the rudder"]()
    quick = law.update(LANXIN, NORTH, state(0.01), 0.0, DT)
    law.reset(0.0)
    slow = law.update(at_speed(LANXIN, 0.5 * 4.63), NORTH, state(0.01), 0.0, 2.0 * DT)
    assert slow == pytest.approx(quick, rel=1e-9)


@pytest.mark.parametrize("speed", [2.0, 4.63, 6.0])
def test_a_boat_that_answers_four_times_as_much_is_given_a_quarter_of_the_rudder(
    make: Callable[[], Steersman], speed: float
) -> None:
    at = at_speed(LANXIN, speed)
    for heading, rate in ((0.02, 0.0), (0.0, 0.03), (-0.02, 0.02)):
        law, command = make(), []
        for model in (at, at._replace(gain=4.0 * at.gain)):
            law.reset(0.0)
            # without a dt there is nothing yet for an integrator
            command.append(law.update(model, NORTH, state(heading, rate), 0.0, 1.0e-9))
        assert command[1] == pytest.approx(0.25 * command[0], rel=1e-3, abs=1e-12)


def test_pid_gains_for_a_livelier_boat_make_the_same_loop_slower() -> None:
    assert gains_for(PidGains(2.0, 0.8, 0.4), 4.0) == pytest.approx(PidGains(0.5, 0.1, 0.1))
    for bad in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(ValueError, match="K/U"):
            boat_pid(Pid(2.0), BOAT._replace(model=LANXIN._replace(gain=bad)))


def test_at_half_speed_backstepping_slows_its_error_dynamics_with_the_boat() -> None:
    slow = at_speed(LANXIN, 0.5 * 4.63)
    law = LAWS["backstepping"]()
    fast_demand = law.update(LANXIN, NORTH, state(0.01), 0.0, DT)
    # kp = (T/K)(gamma + k1 k2): T/K grows four times, gamma + k1 k2 falls to a quarter
    assert law.update(slow, NORTH, state(0.01), 0.0, DT) == pytest.approx(fast_demand, rel=1e-9)


def test_saturation_does_not_wind_the_integrator_up() -> None:
    """A minute hard over at an error that cannot be steered away: afterwards the demand follows the error at once."""
    law = with_pid(1.0, 0.5, 0.0)
    law.reset(0.0)
    command = 0.0
    for _ in range(1200):
        command = max(-0.3, min(0.3, law.update(LANXIN, NORTH, state(-1.0), command, DT)))
    assert command == 0.3
    for _ in range(20):
        command = max(-0.3, min(0.3, law.update(LANXIN, NORTH, state(0.0), command, DT)))
    assert abs(command) < 0.3
    free = with_pid(1.0, 0.5, 0.0)
    free.reset(0.0)
    wound = 0.0
    for _ in range(1200):
        # given what it wanted, the same law does wind up: to its ceiling and no further
        wound = free.update(LANXIN, NORTH, state(-1.0), wound, DT)
    assert wound == pytest.approx(1.0 + 1.0), "a radian of the integral, and one of the error"


def test_the_integrator_learns_a_standing_wind() -> None:
    law, command, heading, rate = with_pid(2.4, 0.24, 0.47), 0.0, 0.0, 0.0
    law.reset(0.0)
    for _ in range(6000):
        command = max(-0.5, min(0.5, law.update(LANXIN, NORTH, state(heading, rate), command, 0.02)))
        rate += 0.02 * (0.701 * (command + 0.05) - rate) / 0.332
        heading += 0.02 * rate
    assert command == pytest.approx(-0.05, abs=1e-3)
    assert abs(heading) < 1e-3


@pytest.mark.parametrize("bad", [(-1.0, 0.0, 0.0), (1.0, math.nan, 0.0), (1.0, 0.0, math.inf), (1.0, -1.0, 0.0)])
def test_pid_gains_are_finite_and_not_negative(bad: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="finite and not negative"):
        boat_pid(Pid(*bad), BOAT)


@given(heading=small, rate=small, acceleration=small, ratio=st.floats(0.3, 1.4))
@pytest.mark.parametrize("name", ["backstepping", "sliding"])
def test_at_another_speed_the_same_path_asks_for_the_same_rudder(
    name: str, heading: float, rate: float, acceleration: float, ratio: float
) -> None:
    """Rates go with U, accelerations with U^2: gains that follow the speed ask for the same angle in the same place."""
    law = LAWS[name]()
    reference = Reference(0.0, 0.5 * rate, acceleration)
    here = demand(law, heading, rate, reference)
    law.reset(0.0)
    faster = Reference(0.0, 0.5 * rate * ratio, acceleration * ratio * ratio)
    model = at_speed(LANXIN, LANXIN.reference_speed * ratio)
    there = law.update(model, faster, state(heading, rate * ratio), 0.0, DT)
    assert there == pytest.approx(here, rel=1e-9, abs=1e-9)


def test_the_pid_law_gives_its_equations_numbers() -> None:
    """delta = I - kp z1 - kd (r - r_d) + F, I' = -ki z1 + (command - wanted) ki/max(kp, ki)."""

    def run(
        gains: PidGains, memory: PidMemory, reference: Reference, heading: float, rate: float, command: float, dt: float
    ) -> tuple[float, PidMemory]:
        given = asked(LANXIN, reference, heading, rate, last_rudder=command, dt=dt)
        return pid_step(BoatPid(gains), memory, given)

    gains, north = PidGains(2.0, 0.5, 3.0), Reference(0.1, 0.02)
    turning = feed_forward(LANXIN, north)
    first, memory = run(gains, PidMemory(0.2), north, 0.4, 0.05, 0.9, 0.1)
    assert memory.integral == pytest.approx(0.2 - 0.5 * 0.3 * 0.1), "nothing was wanted before that could be missed"
    assert first == memory.wanted == pytest.approx(memory.integral - 2.0 * 0.3 - 3.0 * 0.03 + turning)
    second, after = run(gains, memory, north, 0.4, 0.05, first + 0.4, 0.1)
    assert after.integral == pytest.approx(memory.integral - 0.5 * 0.3 * 0.1 + 0.1 * (0.5 / 2.0) * 0.4)
    assert second == after.wanted
    _, strong = run(PidGains(0.1, 0.5), PidMemory(0.0, 0.0), Reference(0.0), 0.0, 0.0, 0.3, 0.1)
    assert strong.integral == pytest.approx(0.1 * 0.3), "an integrator stronger than kp is led back in a second"
    _, none = run(PidGains(2.0), PidMemory(0.2, 0.5), north, 0.4, 0.0, 0.0, 0.1)
    assert none.integral == 0.2
    for side in (-1.0, 1.0):
        _, most = run(gains, PidMemory(0.0), Reference(0.0), -side * 3.0, 0.0, 0.0, 60.0)
        assert most.integral == side * 1.0
    _, at_once = run(gains, PidMemory(0.0, 0.1), Reference(0.0), 0.0, 0.0, 0.4, 99.0)
    assert at_once.integral == pytest.approx(0.3), "no step leads it further than all the way"


def test_the_feed_forward_is_the_rudder_of_the_turn_less_that_of_a_straight_course() -> None:
    model = LANXIN._replace(n0=0.05)
    turn = Reference(0.0, 0.2, 0.1)
    steady = model.n1 * 0.2 + model.n2 * 0.04 + model.n3 * 0.008
    assert feed_forward(model, turn) == pytest.approx((model.time_constant * 0.1 + steady) / model.gain)
    assert feed_forward(model, Reference(1.0)) == 0.0
