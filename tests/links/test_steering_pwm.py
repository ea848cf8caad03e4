"""The way from a rudder angle to a pulse and back, against numbers measured on ArduRover and over random trims."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.links.mavlink.steering import (
    SteeringChannel,
    manual_table,
    pulse_from_manual,
    pulse_table,
    reach,
    servo_from_steering,
    share_from_servo,
    steering_from_pulse,
)

WIDE = SteeringChannel(1000, 1500, 2000, 30, False, 1000, 1500, 2000)


@st.composite
def channels(draw) -> SteeringChannel:
    """Any channel that a boat could have been calibrated to."""
    rc_trim, servo_trim = draw(st.integers(1400, 1600)), draw(st.integers(1400, 1600))
    return SteeringChannel(
        draw(st.integers(900, 1200)),
        rc_trim,
        draw(st.integers(1800, 2100)),
        draw(st.integers(0, 100)),
        draw(st.booleans()),
        draw(st.integers(900, 1200)),
        servo_trim,
        draw(st.integers(1800, 2100)),
        draw(st.booleans()),
        draw(st.floats(-0.4, 0.6)),
    )


def servo(channel: SteeringChannel, pulse: int) -> int:
    return servo_from_steering(channel, steering_from_pulse(channel, pulse))


@pytest.mark.parametrize(
    ("pulse", "out"), [(1560, 1531), (1530, 1500), (1470, 1500), (1500, 1500), (2000, 2000), (1000, 1000), (2200, 2000)]
)
def test_pulses_become_the_servo_outputs_that_were_measured(pulse, out) -> None:
    assert servo(WIDE, pulse) == out


@pytest.mark.parametrize("degrees", [-29.0, -1.0, -0.1, 0.0, 0.1, 1.0, 17.3])
def test_one_degree_demanded_is_one_degree_moved(degrees) -> None:
    share = degrees / 30.0
    moved = share_from_servo(WIDE, servo(WIDE, pulse_table(WIDE).nearest(share))) * 30.0
    assert moved == pytest.approx(degrees, abs=0.07), "one microsecond of 500 is 0.06 deg"


@given(channels(), st.floats(-1.0, 1.0))
def test_the_pulse_chosen_for_a_rudder_is_the_nearest_there_is(channel, share) -> None:
    best = min(abs(share_from_servo(channel, servo(channel, p)) - share) for p in range(channel.rc_min, channel.rc_max))
    chosen = pulse_table(channel).nearest(share)
    assert channel.rc_min <= chosen <= channel.rc_max
    assert abs(share_from_servo(channel, servo(channel, chosen)) - share) <= best + 1e-12


@given(channels(), st.floats(-1.0, 1.0))
def test_the_stick_reaches_as_near_as_its_steps_allow(channel, share) -> None:
    y = manual_table(channel).nearest(share)
    assert -1000 <= y <= 1000
    moved = share_from_servo(channel, servo(channel, pulse_from_manual(channel, y)))
    # One step of the stick is at most 0.6 us of input, which the exponent can stretch by 1 - expo + 3 expo.
    assert abs(moved - share) < 0.012


@given(channels(), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_more_to_starboard_is_never_more_to_port(channel, one, other) -> None:
    low, high = sorted((one, other))
    table = pulse_table(channel)
    assert share_from_servo(channel, servo(channel, table.nearest(low))) <= share_from_servo(
        channel, servo(channel, table.nearest(high))
    )


def test_amidships_can_be_distinguished_from_a_stick_at_rest_and_moves_nothing() -> None:
    pulse, by_stick = pulse_table(WIDE).nearest(0.0), pulse_from_manual(WIDE, manual_table(WIDE).nearest(0.0))
    for asked in (pulse, by_stick):
        assert asked - WIDE.rc_trim == pytest.approx(WIDE.rc_dead_zone / 2, abs=1.0)
        assert servo(WIDE, asked) == WIDE.servo_trim
    without = WIDE._replace(rc_dead_zone=0)
    assert pulse_table(without).nearest(0.0) == without.rc_trim
    assert manual_table(without).nearest(0.0) == 0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rc_max": 1520}, "steering input"),
        ({"rc_min": 1600}, "steering input"),
        ({"servo_max": 1500}, "steering servo"),
    ],
)
def test_a_channel_without_room_is_refused(changes, words) -> None:
    with pytest.raises(ValueError, match=words):
        pulse_table(WIDE._replace(**changes))


def test_beyond_the_end_stops_is_the_end_stop() -> None:
    assert pulse_table(WIDE).nearest(5.0) == 2000
    assert pulse_table(WIDE).nearest(-5.0) == 1000
    assert math.isclose(share_from_servo(WIDE, 2300), 1.0)


@pytest.mark.parametrize(
    ("rc_reversed", "servo_reversed"), [(False, False), (True, False), (False, True), (True, True)]
)
def test_each_reversal_turns_its_own_end_round(rc_reversed: bool, servo_reversed: bool) -> None:
    """RC1_REVERSED turns the input round and SERVO1_REVERSED the pulse; the rudder's share follows the steering."""
    channel = SteeringChannel(1100, 1480, 1900, 30, rc_reversed, 1200, 1520, 1850, servo_reversed)
    stick = -1 if rc_reversed else 1
    assert [steering_from_pulse(channel, pulse) for pulse in (1100, 1480, 1900)] == [-stick * 4500, 0, stick * 4500]
    ends = (1850, 1520, 1200) if servo_reversed else (1200, 1520, 1850)
    assert tuple(servo_from_steering(channel, steering) for steering in (-4500, 0, 4500)) == ends
    assert [share_from_servo(channel, pulse) for pulse in ends] == [-1.0, 0.0, 1.0]


@pytest.mark.parametrize(("low", "high"), [(1100, 1900), (1000, 2000), (1200, 2100)])
@pytest.mark.parametrize("is_reversed", [False, True])
def test_a_scale_of_its_own_keeps_the_rudder_right_whatever_the_servo_s_end_points_are(
    low: int, high: int, is_reversed: bool
) -> None:
    scale = (1000.0, 1500.0, 2000.0)
    channel = SteeringChannel(servo_min=low, servo_max=high, servo_reversed=is_reversed, scale=scale)
    for share in (-0.5, -0.1, 0.0, 0.2, 0.55):
        pulse = servo_from_steering(channel, steering_from_pulse(channel, pulse_table(channel).nearest(share)))
        assert pulse == pytest.approx(1500 + (-500 if is_reversed else 500) * share, abs=2)
        assert share_from_servo(channel, pulse) == pytest.approx(share, abs=0.004)
    assert reach(channel) == pytest.approx(min(1500 - low, high - 1500) / 500)
    assert reach(channel._replace(scale=None)) == 1.0
