"""Dead reckoning, number by number: what a fail-safe takes for the heading while it has none."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.models.norrbin import Norrbin, steady_rate
from autopilot.signals import HeadingSample, NavState, RateSample, WindSample
from autopilot.supervision.failsafe import RATE_FRESH, RATE_MOST, FailsafeSteering

BOAT = Norrbin(0.7, 0.3, 3.3)
STATE = NavState(10.0, 1.0, 0.2, 4.6, 0.0, 0.05, 0.3, True, 0.02, 0.03, 0.01, 0.8)


def reckoning(state: NavState = STATE) -> FailsafeSteering:
    steering = FailsafeSteering()
    steering.begin(state)
    return steering


@given(rate=st.floats(-1.0, 1.0), step=st.floats(0.01, RATE_FRESH))
def test_a_measured_rate_turns_the_heading_by_the_trapezoid(rate: float, step: float) -> None:
    steering = reckoning()
    steering.on_sample((RateSample(10.0 + step, rate),))
    state, reference = steering.reckon(10.0 + step, BOAT, 0.1)
    assert state.heading == pytest.approx(1.0 + 0.5 * (0.2 + rate) * step, abs=1e-12)
    assert (state.rate, state.rudder, reference.heading) == (rate, 0.1, 1.0)
    assert state.heading_age == pytest.approx(0.3 + step)
    assert (state.wave_heading, state.wave_rate, state.wave_deviation) == (0.0, 0.0, 0.0)


def test_without_a_rate_the_boat_turns_as_the_model_does_under_rudder_and_bias() -> None:
    steering = reckoning()
    for number in range(1, 101):
        state, _ = steering.reckon(10.0 + 0.05 * number, BOAT, 0.1)
    assert state.rate == pytest.approx(steady_rate(BOAT, 0.1 + STATE.bias), rel=1e-3)
    assert state.heading_age == pytest.approx(5.3)


@pytest.mark.parametrize(("age", "is_used"), [(-0.01, False), (0.0, True), (0.49, True), (0.5, True), (0.51, False)])
def test_a_rate_is_used_for_half_a_second(age: float, is_used: bool) -> None:
    steering = reckoning()
    steering.on_sample((HeadingSample(10.5 - age, 2.0, -0.3),))
    assert (steering.reckon(10.5, BOAT, 0.0)[0].rate == -0.3) is is_used


@pytest.mark.parametrize("rate", [math.nan, math.inf, -math.inf, 1.01 * RATE_MOST])
def test_impossible_rates_are_not_used_for_dead_reckoning(rate: float) -> None:
    steering = reckoning()
    steering.on_sample((RateSample(10.1, rate), RateSample(math.nan, 0.1)))
    assert abs(steering.reckon(10.1, BOAT, 0.0)[0].rate) < 1.0


def test_impossible_samples_leave_the_last_good_rate() -> None:
    steering = reckoning()
    wrong = (RateSample(math.nan, 0.3), RateSample(10.1, math.inf), HeadingSample(10.1, 0.0), RateSample(math.inf, 0.3))
    steering.on_sample((RateSample(10.1, -0.15), *wrong))
    assert steering.reckon(10.1, BOAT, 0.0)[0].rate == -0.15


def test_a_pause_turns_the_heading_no_further_than_half_a_second_does() -> None:
    """Ticks that stop are no turn: the model is not run on over a pause that nobody has seen."""
    steering = reckoning()
    steering.on_sample((RateSample(13.0, 0.2),))
    state, _ = steering.reckon(13.0, BOAT, 0.0)
    assert state.heading == pytest.approx(1.0 + 0.2 * RATE_FRESH)
    assert state.heading_age == pytest.approx(3.3), "but the heading is as old as it is"
    back, _ = steering.reckon(12.0, BOAT, 0.0)
    assert back.heading == state.heading, "and a clock that goes back turns nothing"
    assert back.heading_age == state.heading_age


@pytest.mark.parametrize(
    ("angle_deg", "share"), [(0.0, 0.0), (15.0, 0.5), (30.0, 1.0), (90.0, 1.0), (-15.0, -0.5), (-170.0, -1.0)]
)
def test_the_slow_turn_to_windward_goes_to_the_winds_side(angle_deg: float, share: float) -> None:
    steering = reckoning()
    steering.on_sample((WindSample(10.0, math.radians(angle_deg), 8.0),))
    assert steering.windward(10.0, 0.2) == pytest.approx(0.2 * share, abs=1e-9)
    assert steering.windward(15.0, 0.2) is not None
    assert steering.windward(15.1, 0.2) is None
    assert steering.windward(9.9, 0.2) is None


def test_to_reckon_before_the_beginning_is_refused() -> None:
    with pytest.raises(ValueError, match="begin first"):
        FailsafeSteering().reckon(0.0, BOAT, 0.0)


@pytest.mark.parametrize("rate", [RATE_MOST, -RATE_MOST])
def test_a_rate_of_ten_rad_s_may_be_one(rate: float) -> None:
    steering = reckoning()
    steering.on_sample((RateSample(10.1, rate),))
    assert RATE_MOST == 10.0
    assert steering.reckon(10.1, BOAT, 0.0)[0].rate == rate


@pytest.mark.parametrize(
    ("later", "share"),
    [(-0.1, 1.0), (0.0, 0.0), (1.0, 1.0 - math.exp(-0.5)), (5.0, 1.0 - math.exp(-2.5)), (5.1, 1.0)],
)
def test_the_wind_is_smoothed_over_two_seconds_and_begins_anew_after_five(later: float, share: float) -> None:
    """Ahead at first, then 20 deg to starboard: both components go a share of the way there."""
    steering, angle = reckoning(), math.radians(20.0)
    steering.on_sample((WindSample(10.0, 0.0, 8.0), WindSample(10.0 + later, angle, 8.0)))
    seen = math.atan2(share * math.sin(angle), 1.0 - share + share * math.cos(angle))
    assert steering.windward(10.0 + later, 0.3) == pytest.approx(0.3 * seen / math.radians(30.0))


@pytest.mark.parametrize(("time", "angle"), [(math.nan, 0.1), (math.inf, 0.1), (10.0, math.nan), (10.0, math.inf)])
def test_a_wind_that_is_not_finite_leaves_the_last_wind(time: float, angle: float) -> None:
    steering = reckoning()
    steering.on_sample((WindSample(10.0, 0.2, 8.0), WindSample(time, angle, 8.0)))
    assert steering.windward(10.0, 0.3) == pytest.approx(0.3 * 0.2 / math.radians(30.0))
