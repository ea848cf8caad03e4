"""How K and T go with speed and throttle, and what two thrusters make of steering and throttle."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.models.drives import (
    BEYOND,
    DRIVES,
    RUDDER_LAW,
    DriveLaw,
    Mixing,
    at_point,
    effect_of,
    mixed,
    moment,
    quickness,
    reach,
    steering_for,
    thrust,
    unmixed,
    way_of,
)
from autopilot.models.norrbin import Norrbin, at_speed
from sitl.firmware_setup import MotorSetup, by_hand, skid_outputs

BOAT = Norrbin(2.0, 0.5, n3=4.0, n0=0.01, reference_speed=1.0)
OUTBOARD = DriveLaw(0.0, 2.0, -0.5, throttle=0.5)
shares = st.floats(-1.0, 1.0)
mixings = st.builds(
    Mixing,
    st.floats(1.0, 3.0),
    st.floats(-0.9, 0.9),
    st.floats(0.2, 1.0),
    st.one_of(st.just(math.nan), st.floats(1.0, 2.5)),
    st.just(math.nan),
)


def test_at_the_trials_speed_and_throttle_the_model_is_the_trials() -> None:
    assert at_point(OUTBOARD, BOAT, 1.0, 0.5) == BOAT


def test_four_times_the_thrust_turns_four_times_as_hard_whatever_the_speed() -> None:
    found = at_point(OUTBOARD, BOAT, 1.0, 1.0)
    assert found.gain == pytest.approx(4.0 * BOAT.gain)
    assert found.time_constant == BOAT.time_constant
    assert found.n0 / found.gain == pytest.approx(BOAT.n0 / BOAT.gain), "the trim as an angle stays"


def test_without_a_known_throttle_that_of_the_trial_counts() -> None:
    assert effect_of(OUTBOARD, 1.0, math.nan) == 1.0
    assert way_of(OUTBOARD, 1.5, math.nan) == 1.5


def test_a_boat_at_rest_has_a_model() -> None:
    found = at_point(DriveLaw(-0.5, 0.0, -1.0), BOAT, 0.0, math.nan)
    assert all(math.isfinite(value) for value in found)
    assert found.reference_speed > 0.0


def test_no_law_goes_on_for_ever_beyond_what_trials_have_seen() -> None:
    law = DriveLaw(1.0, 0.0, -1.0, fastest=2.0)
    assert at_point(law, BOAT, 2.0 * BEYOND, math.nan)[:6] == at_point(law, BOAT, 20.0, math.nan)[:6]


def test_a_boat_of_which_no_n3_is_known_keeps_a_steady_turn() -> None:
    assert at_point(DriveLaw(0.0, 0.0, -3.0), BOAT._replace(n3=0.0), 2.0, math.nan).n1 > 0.0


def test_a_rudders_loop_is_as_quick_as_the_speed() -> None:
    assert quickness(RUDDER_LAW, BOAT, at_speed(BOAT, 0.5)) == pytest.approx(0.5)


def test_a_loop_on_thrust_asks_for_the_same_angle_at_every_thrust() -> None:
    here = at_point(OUTBOARD, BOAT, 1.0, 0.25)
    asked = quickness(OUTBOARD, BOAT, here) ** 2 * here.time_constant / here.gain
    assert asked == pytest.approx(BOAT.time_constant / BOAT.gain)


@given(mixings, shares, shares)
def test_mixing_is_that_of_the_simulated_firmware(mixing: Mixing, steering: float, throttle: float) -> None:
    setup = MotorSetup(mixing.asymmetry, mixing.expo, mixing.priority, 0.0, 100.0, 0.0, 3, 0.0, False, 1.0)
    by_firmware = skid_outputs(setup, *by_hand(setup, steering, throttle, is_skid=True))
    assert mixed(mixing, steering, throttle) == pytest.approx(by_firmware, abs=1.0e-9)


def test_mixing_is_as_the_firmwares_source_has_it() -> None:
    """Worked out by hand from output_skid_steering: with 1.6 the bottom is -0.625, and 0.1875 is best for steering."""
    blueboat = Mixing(asymmetry=1.6, priority=0.6)
    assert mixed(blueboat, 0.0, 0.5) == (0.5, 0.5)
    assert mixed(blueboat, 1.0, 0.0) == pytest.approx((0.625, -1.0)), "the mixer never adds throttle"
    assert mixed(blueboat, 0.2, 0.3) == pytest.approx((0.5, 0.1))
    assert mixed(blueboat, 0.5, 1.0) == pytest.approx((1.0, 1.0 / 3.0)), "both held to two thirds, which fits"


@given(mixings, shares, shares)
def test_what_was_mixed_and_fits_is_found_again(mixing: Mixing, steering: float, throttle: float) -> None:
    left, right = mixed(mixing, steering, throttle)
    found, thrust_found, is_limited = unmixed(mixing, left, right)
    if not is_limited:
        assert found == pytest.approx(steering, abs=1.0e-6)
        assert thrust_found == pytest.approx(throttle, abs=1.0e-6)
    else:
        assert abs(found) <= abs(steering) + 1.0e-9


@given(mixings, shares, st.floats(0.0, 1.0))
def test_steering_is_found_that_makes_the_moment_wanted(mixing: Mixing, share: float, throttle: float) -> None:
    most = reach(mixing, throttle)
    wanted = share * most
    found = moment(mixing, *mixed(mixing, steering_for(mixing, wanted, throttle), throttle))
    assert found == pytest.approx(wanted, abs=4.0e-3)


@pytest.mark.parametrize("exponent", [1.5, 2.0])
def test_a_firmware_that_knows_the_asymmetry_turns_the_boat_where_it_lies(exponent: float) -> None:
    mixing = Mixing(asymmetry=1.4, exponent=exponent)
    left, right = mixed(mixing, 1.0, 0.0)
    assert thrust(mixing, left) == pytest.approx(-thrust(mixing, right))


def test_every_kind_of_drive_says_what_to_set() -> None:
    assert all(kind.advice and kind.outputs for kind in DRIVES.values())
    assert DRIVES["rudder"].usual == RUDDER_LAW
