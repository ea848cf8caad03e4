"""Pulse widths as ArduRover computes them; the measured pair 1560 in, 1531 out first of all."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.firmware_setup import Calibration, Overrides, input_angle, manual_control_pulse, output_pulse

INPUT = Calibration(1000, 1500, 2000, 30)
SERVO = Calibration(1000, 1500, 2000)


def through(pulse: int, channel: Calibration = INPUT, servo: Calibration = SERVO) -> int:
    return output_pulse(servo, input_angle(channel, pulse, 4500), 4500)


@pytest.mark.parametrize(
    ("pulse", "expected"),
    [(1560, 1531), (1500, 1500), (1530, 1500), (1470, 1500), (1531, 1501), (1440, 1469), (2000, 2000), (1000, 1000)],
)
def test_radio_pulses_are_scaled_with_dead_zone_and_truncation(pulse: int, expected: int) -> None:
    assert through(pulse) == expected


def test_pulses_beyond_the_calibration_are_held() -> None:
    assert through(2200) == 2000
    assert through(800) == 1000


def test_reversed_input_and_reversed_servo_cancel() -> None:
    mirrored = INPUT._replace(is_reversed=True)
    assert through(1700, mirrored) == 1000 + 2000 - through(1700)
    assert through(1700, mirrored, SERVO._replace(is_reversed=True)) == through(1700)


@given(
    low=st.integers(800, 1400),
    trim=st.integers(800, 2200),
    high=st.integers(1600, 2200),
    dead_zone=st.integers(0, 200),
    pulse=st.integers(0, 65535),
)
def test_any_calibration_stays_within_the_servo(low: int, trim: int, high: int, dead_zone: int, pulse: int) -> None:
    angle = input_angle(Calibration(low, trim, high, dead_zone), pulse, 4500)
    assert low <= output_pulse(Calibration(low, trim, high), angle, 4500) <= high


@given(first=st.integers(1000, 2000), second=st.integers(1000, 2000))
def test_more_stick_is_never_less_servo(first: int, second: int) -> None:
    low, high = sorted((first, second))
    assert through(low) <= through(high)


@pytest.mark.parametrize(("axis", "pulse"), [(0, 1500), (1000, 2000), (-1000, 1000), (1, 1500), (500, 1750)])
def test_manual_control_becomes_a_pulse(axis: int, pulse: int) -> None:
    assert manual_control_pulse(INPUT, axis) == pulse


def test_overrides_time_out_release_and_are_not_refreshed_by_others() -> None:
    overrides = Overrides()
    overrides.put(1, 1700, 10.0)
    overrides.put(3, 1600, 12.0)
    assert overrides.active(12.9, 3.0) == {1: 1700, 3: 1600}
    assert overrides.active(13.0, 3.0) == {3: 1600}
    assert overrides.active(1e6, -1.0) == {1: 1700, 3: 1600}, "a negative RC_OVERRIDE_TIME never ends"
    assert overrides.active(12.0, 0.0) == {}, "zero switches overrides off"
    overrides.put(3, 0, 12.5)
    assert overrides.active(12.6, 3.0) == {1: 1700}
