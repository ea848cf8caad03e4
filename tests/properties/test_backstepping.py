"""The corrected law: Lyapunov decrease, symmetry, wrap, and the erratum of the printed equation."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jiang2016_heading_control import printed_equation_26
from steersman import asked

from autopilot.angles import wrap
from autopilot.control import backstepping
from autopilot.control.backstepping import (
    Backstepping,
    BacksteppingGains,
    BoundedGains,
    bounded_gains,
    error_max_at,
    error_max_of,
    errors,
    gains_at,
)
from autopilot.control.law import LawBoat
from autopilot.control.limits import RudderLimits
from autopilot.models.norrbin import Norrbin, at_speed_ratio, yaw_acceleration
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import Reference

LANXIN = Norrbin(0.701, 0.332, 3.2828)
MODELS = [LANXIN, Norrbin(0.1, 20.0), Norrbin(0.2, 5.0, 20.0, n1=-1.0), Norrbin(0.3, 2.0, 5.0, 0.4, 1.0, 0.05)]
GAINS = [BacksteppingGains(35.0, 15.0), BacksteppingGains(2.0, 2.0), BacksteppingGains(0.13, 0.13, 0.004)]

BOAT = LawBoat(LANXIN, SteeringGear(0.6, 0.3), RudderLimits(0.6, 0.3), 0.1)

angle = st.floats(-math.pi, math.pi)
rate = st.floats(-0.5, 0.5)


def backstepping_rudder(
    model: Norrbin, gains: BacksteppingGains, reference: Reference, heading: float, rate: float, bias: float = 0.0
) -> float:
    given = asked(model, reference, heading, rate, bias=bias)
    return backstepping.backstepping_rudder(BoundedGains(gains), given, rate)


def lyapunov_rate(
    model: Norrbin, gains: BacksteppingGains, reference: Reference, heading: float, rate: float, rudder: float
) -> float:
    """dV/dt of V = (gamma z1^2 + z2^2)/2 by the chain rule, from the plant and not from the law."""
    z1, z2 = errors(gains, heading, rate, reference)
    z1_dot = rate - reference.rate
    alpha_dot = -gains.k1 * z1_dot + reference.acceleration
    return gains.gamma * z1 * z1_dot + z2 * (yaw_acceleration(model, rate, rudder) - alpha_dot)


@pytest.mark.parametrize("gains", GAINS)
@pytest.mark.parametrize("model", MODELS)
def test_v_decreases_on_a_fine_grid(model: Norrbin, gains: BacksteppingGains) -> None:
    reference = Reference(0.4, 0.03, -0.02)
    for heading, yaw in itertools.product(np.linspace(-2.7, 3.5, 63), np.linspace(-0.5, 0.5, 41)):
        rudder = backstepping_rudder(model, gains, reference, heading, yaw)
        z1, z2 = errors(gains, heading, yaw, reference)
        promised = -gains.gamma * gains.k1 * z1**2 - gains.k2 * z2**2
        found = lyapunov_rate(model, gains, reference, heading, yaw, rudder)
        assert found == pytest.approx(promised, rel=1e-7, abs=1e-9)
        assert found <= 1e-9


@given(angle, rate, angle, st.floats(-0.3, 0.3), st.floats(-1.0, 1.0), st.sampled_from(MODELS), st.sampled_from(GAINS))
def test_v_decreases_anywhere(
    heading: float,
    yaw: float,
    goal: float,
    goal_rate: float,
    goal_acceleration: float,
    model: Norrbin,
    gains: BacksteppingGains,
) -> None:
    reference = Reference(goal, goal_rate, goal_acceleration)
    rudder = backstepping_rudder(model, gains, reference, heading, yaw)
    z1, z2 = errors(gains, heading, yaw, reference)
    promised = -gains.gamma * gains.k1 * z1**2 - gains.k2 * z2**2
    assert lyapunov_rate(model, gains, reference, heading, yaw, rudder) == pytest.approx(promised, rel=1e-6, abs=1e-8)


def test_the_printed_equation_lets_v_grow() -> None:
    """Jiang 2016 eq. (26) as printed: in a turn, close to the reference, V grows; so the print cannot be the law."""
    gains, reference = BacksteppingGains(35.0, 15.0), Reference(0.0, 0.2)
    printed = printed_equation_26(LANXIN, gains, reference, -0.001, 0.2)
    assert lyapunov_rate(LANXIN, gains, reference, -0.001, 0.2, printed) > 0.0
    corrected = backstepping_rudder(LANXIN, gains, reference, -0.001, 0.2)
    assert lyapunov_rate(LANXIN, gains, reference, -0.001, 0.2, corrected) < 0.0


@given(angle, rate, st.floats(-math.pi + 0.01, math.pi - 0.01), st.floats(-0.3, 0.3))
def test_the_expanded_form_is_the_same_law(heading: float, yaw: float, goal: float, goal_rate: float) -> None:
    k1, k2 = 2.0, 3.0
    gains, reference = BacksteppingGains(k1, k2), Reference(goal, goal_rate, 0.1)
    T, K, n3 = LANXIN.time_constant, LANXIN.gain, LANXIN.n3
    z1 = wrap(heading - goal)
    expanded = (T / K) * ((1 / T - k1 - k2) * yaw + n3 / T * yaw**3 - (1 + k1 * k2) * z1 + (k1 + k2) * goal_rate + 0.1)
    assert backstepping_rudder(LANXIN, gains, reference, heading, yaw) == pytest.approx(expanded, rel=1e-9, abs=1e-9)


@given(st.floats(-3.0, 3.0), rate, st.floats(-0.1, 0.1))
def test_the_law_is_odd(heading: float, yaw: float, goal_rate: float) -> None:
    for gains in GAINS:
        port = backstepping_rudder(LANXIN, gains, Reference(0.0, goal_rate, 0.2), heading, yaw, 0.01)
        starboard = backstepping_rudder(LANXIN, gains, Reference(0.0, -goal_rate, -0.2), -heading, -yaw, -0.01)
        assert starboard == pytest.approx(-port, abs=1e-12)


@given(st.floats(-0.5, 0.5), rate)
def test_the_law_does_not_see_the_seam_at_180_deg(offset: float, yaw: float) -> None:
    gains = GAINS[1]
    plain = backstepping_rudder(LANXIN, gains, Reference(0.0), offset, yaw)
    seam = backstepping_rudder(LANXIN, gains, Reference(math.pi), wrap(math.pi + offset), yaw)
    assert seam == pytest.approx(plain, abs=1e-9)


def test_the_error_dynamics_are_those_promised() -> None:
    """z1'' + (k1+k2) z1' + (gamma + k1 k2) z1 = 0, integrated on the plant without limits."""
    gains = BacksteppingGains(0.8, 1.1, 0.5)
    heading, yaw, dt, steps = 0.5, 0.0, 1.0e-4, 40000
    for _ in range(steps):
        rudder = backstepping_rudder(LANXIN, gains, Reference(0.0), heading, yaw)
        acceleration = yaw_acceleration(LANXIN, yaw, rudder)
        heading += dt * yaw + 0.5 * dt * dt * acceleration
        yaw += dt * acceleration
    b, c = gains.k1 + gains.k2, gains.gamma + gains.k1 * gains.k2
    w, t = math.sqrt(c - 0.25 * b * b), dt * steps
    exact = 0.5 * math.exp(-0.5 * b * t) * (math.cos(w * t) + 0.5 * b / w * math.sin(w * t))
    assert heading == pytest.approx(exact, abs=2e-4)


@pytest.mark.parametrize("bad", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, 0.0), (1.0, math.nan, 1.0)])
def test_gains_must_be_positive(bad: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="positive"):
        bounded_gains(Backstepping(*bad), BOAT)


@pytest.mark.parametrize("bad", [-0.1, math.nan, math.inf])
def test_smoothing_must_be_a_time(bad: float) -> None:
    with pytest.raises(ValueError, match="smoothing must be finite"):
        bounded_gains(Backstepping(1.0, 1.0, 1.0, bad), BOAT)


@given(st.floats(-3.0, 3.0), st.floats(-0.4, 0.4), st.floats(0.01, 0.5), st.sampled_from(MODELS))
def test_with_errors_that_count_as_less_the_energy_still_falls(
    error: float, yaw: float, most: float, model: Norrbin
) -> None:
    """V = e'^2/2 + W int sat falls as -S e'^2, by the chain rule, from the plant."""
    gains = GAINS[1]
    rudder = backstepping.backstepping_rudder(BoundedGains(gains, most), asked(model, Reference(0.0), error, yaw), yaw)
    square, total = gains.gamma + gains.k1 * gains.k2, gains.k1 + gains.k2
    counted = math.copysign(min(abs(error), most), error)
    found = yaw * (yaw_acceleration(model, yaw, rudder) + square * counted)
    assert found == pytest.approx(-total * yaw * yaw, rel=1e-7, abs=1e-9)


@given(
    st.floats(-3.0, 3.0),
    st.floats(-0.4, 0.4),
    st.floats(-0.2, 0.2),
    st.floats(-0.1, 0.1),
    st.sampled_from([model for model in MODELS if model.n2 == 0.0]),
)
def test_what_is_cancelled_at_the_planned_rate_leaves_the_boat_its_own_damping(
    error: float, yaw: float, planned: float, acceleration: float, model: Norrbin
) -> None:
    """V falls by the damping that the boat has beyond the plan faster than -S e'^2, on any plan."""
    gains, most = GAINS[1], 0.3
    given_ = asked(model, Reference(0.0, planned, acceleration), error, yaw)
    rudder = backstepping.backstepping_rudder(BoundedGains(gains, most), given_, planned)
    square, total = gains.gamma + gains.k1 * gains.k2, gains.k1 + gains.k2
    off = yaw - planned
    counted = math.copysign(min(abs(error), most), error)
    found = off * (yaw_acceleration(model, yaw, rudder) - acceleration + square * counted)
    left = off * model.n3 * (yaw**3 - planned**3) / model.time_constant
    assert left >= 0.0
    assert found == pytest.approx(-total * off * off - left, rel=1e-7, abs=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(0.0, 20.0), st.sampled_from(MODELS[:3]))
def test_a_course_is_held_alike_whatever_n3_the_file_has(
    error: float, yaw: float, times: float, model: Norrbin
) -> None:
    """A speed that is read wrong changes n3 by its square: the law in force does not go by it on a course."""
    bounded, ours = BoundedGains(GAINS[1], 0.3), model._replace(n3=times * model.n3)
    state = asked(ours, Reference(0.0), error, yaw)
    assert backstepping.step(bounded, backstepping.at_rest(bounded, 0.0), state) == backstepping.step(
        bounded, backstepping.at_rest(bounded, 0.0), asked(model, Reference(0.0), error, yaw)
    )


@pytest.mark.parametrize("model", MODELS[:3])
def test_the_largest_error_is_one_whose_swing_overtaxes_the_rudders_rate(model: Norrbin) -> None:
    """A swing at the loop's natural frequency, small enough for the damping to be linear, asked of the law itself."""
    gains, rate_max = BacksteppingGains(0.5, 0.6, 0.4), 20.0
    most, frequency = error_max_of(model, gains, rate_max), math.sqrt(gains.gamma + gains.k1 * gains.k2)
    small = 1.0e-6
    times = np.linspace(0.0, 2.0 * math.pi / frequency, 4001)
    asked = [
        backstepping_rudder(
            model, gains, Reference(0.0), small * math.sin(frequency * t), small * frequency * math.cos(frequency * t)
        )
        for t in times
    ]
    quickest = float(np.max(np.abs(np.gradient(asked, times)))) / small
    assert most * quickest == pytest.approx(1.7 * rate_max, rel=1e-4)


@pytest.mark.parametrize("ratio", [0.25, 0.7, 1.5])
def test_at_another_speed_it_is_that_of_the_gains_there(ratio: float) -> None:
    model, gains = Norrbin(0.1, 20.0, reference_speed=5.0), BacksteppingGains(0.06, 0.06, 0.001)
    there = error_max_of(at_speed_ratio(model, ratio), gains_at(gains, ratio), 0.1)
    assert there > math.radians(3.0)
    assert error_max_at(error_max_of(model, gains, 0.1), ratio) == pytest.approx(there)


def test_however_quick_the_loop_two_degrees_count_in_full() -> None:
    paper = GAINS[0]
    assert error_max_of(LANXIN, paper, 0.35) == math.radians(2.0)
    assert error_max_at(math.radians(2.1), 1.5) == math.radians(2.0)


def test_a_rudder_without_a_rate_bounds_no_error() -> None:
    assert error_max_of(LANXIN, GAINS[1], math.inf) == math.inf


def test_equation_26_is_as_printed_term_by_term() -> None:
    """Each term alone, by numbers that were worked out by hand: K/T = 2, k1 = 3, k2 = 5, n3/T = 8."""
    model, gains = Norrbin(1.0, 0.5, 4.0), BacksteppingGains(3.0, 5.0)
    alone = [
        (Reference(0.0), 0.0, 0.1, 2.0 * (-6.0 * 0.1 + 8.0 * 0.001)),
        (Reference(0.0), 0.2, 0.0, 2.0 * -14.0 * 0.2),
        (Reference(0.0, 0.3), 0.0, 0.0, 2.0 * -8.0 * 0.3),
        (Reference(0.0, 0.0, 0.7), 0.0, 0.0, 2.0 * 0.7),
    ]
    for reference, heading, rate, rudder in alone:
        assert printed_equation_26(model, gains, reference, heading, rate) == pytest.approx(rudder)


@pytest.mark.parametrize("tiny", [5.0e-324, 1.0e-200, 1.0e-100])
def test_gains_too_small_for_numbers_answer_every_error(tiny: float) -> None:
    gains = BacksteppingGains(tiny, tiny, tiny)
    assert error_max_of(LANXIN, gains, 0.3) > 1.0e50
