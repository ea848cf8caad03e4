"""Steering messages field by field, when each is repeated, and how often it is taken back."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest

from autopilot.links.mavlink.requests import VehicleParameters
from autopilot.links.mavlink.steering import (
    SteeringChannel,
    SteeringOutput,
    manual_table,
    pulse_from_manual,
    pulse_table,
    reach,
    servo_from_steering,
    share_from_servo,
    steering_from_pulse,
)

FULL = math.radians(30.0)
EVEN = {"MIN": 1000.0, "TRIM": 1500.0, "MAX": 2000.0, "REVERSED": 0.0}


def known(number: int = 1, **changes: float) -> VehicleParameters:
    parameters = VehicleParameters()
    values = {"RCMAP_ROLL": float(number), "SERVO1_FUNCTION": 26.0, f"RC{number}_DZ": 0.0}
    values |= {f"{what}_{name}": value for what in (f"RC{number}", "SERVO1") for name, value in EVEN.items()}
    for name, value in {**values, **changes}.items():
        parameters.take(name, value)
    return parameters


def output(method: Any = "rc_override", number: int = 1, reversed_: bool = False, **changes: float) -> SteeringOutput:
    found = SteeringOutput(method, FULL, reversed_)
    found.target = 7
    assert found.use(known(number, **changes)) == ""
    return found


def channels(message: Any) -> list[int]:
    assert (message.get_type(), message.target_system, message.target_component) == ("RC_CHANNELS_OVERRIDE", 7, 1)
    return [getattr(message, f"chan{number}_raw") for number in range(1, 19)]


def axes(message: Any) -> tuple[int, ...]:
    assert (message.get_type(), message.target) == ("MANUAL_CONTROL", 7)
    return message.x, message.y, message.z, message.r, message.buttons


def spaces(times: list[int]) -> list[int]:
    return [after - before for before, after in pairwise(times)]


@pytest.mark.parametrize(("degrees", "pulse"), [(30.0, 2000), (-30.0, 1000), (15.0, 1750), (-6.0, 1400), (90.0, 2000)])
@pytest.mark.parametrize("number", [1, 8, 9, 16])
def test_an_override_touches_the_steering_channel_alone(number: int, degrees: float, pulse: int) -> None:
    steering = output(number=number)
    expected = [65535] * 8 + [0] * 10
    expected[number - 1] = pulse
    assert channels(steering.steer(0.0, math.radians(degrees))) == expected
    assert steering.commanded_pulse == pulse
    expected[number - 1] = 0 if number <= 8 else 65534
    assert channels(steering.release(0.0)) == expected
    mirror = output(number=number, reversed_=True)
    assert channels(mirror.steer(0.0, -math.radians(degrees)))[number - 1] == pulse


@pytest.mark.parametrize(("degrees", "y"), [(30.0, 1000), (-30.0, -1000), (15.0, 500), (-6.0, -200), (-90.0, -1000)])
def test_a_stick_moves_its_axis_alone(degrees: float, y: int) -> None:
    steering = output("manual_control")
    sent = axes(steering.steer(0.0, math.radians(degrees)))
    assert sent == (32767, pytest.approx(y, abs=1), 32767, 32767, 0)
    assert steering.commanded_pulse == 1500 + y // 2
    assert axes(steering.release(0.0)) == (32767, 32767, 32767, 32767, 0)


def test_an_order_is_repeated_at_its_rate_for_a_second() -> None:
    steering = output()
    assert steering.repeat(0.0, 10.0) is None
    steering.steer(10.0, 0.1)
    times = [step for step in range(1, 200) if steering.repeat(10.0 + 0.01 * step + 1e-6, 10.0) is not None]
    assert times[0] in (10, 11) and set(spaces(times)) <= {10, 11} and times[-1] > 90
    steering.steer(20.0, 0.1)
    assert steering.repeat(20.24, 4.0) is None
    again = steering.repeat(20.26, 4.0)
    assert channels(again)[0] == steering.commanded_pulse
    assert steering.repeat(20.4, 4.0) is None
    steering.steer(30.0, 0.1)
    assert steering.repeat(30.25, 4.0) is not None and steering.repeat(31.0, 4.0) is not None, "to the bit"
    steering.steer(40.0, 0.1)
    assert steering.repeat(41.001, 4.0) is None


def test_releases_are_a_tenth_of_a_second_apart_to_the_bit() -> None:
    steering = output()
    steering.steer(-1.0, 0.1)
    assert [steering.release(now) is not None for now in (0.0, 0.0999, 0.1)] == [True, False, True]


def test_five_releases_follow_an_order_a_tenth_of_a_second_apart() -> None:
    steering = output()
    assert steering.release(0.0) is None and steering.release_burst() == []
    steering.steer(10.0, 0.1)
    times = [step for step in range(200) if steering.release(10.0 + 0.01 * step + 1e-6) is not None]
    assert times[0] == 0 and len(times) == 5 and set(spaces(times)) <= {10, 11}
    steering.steer(20.0, 0.1)
    steering.release(20.0)
    times = [step for step in range(1, 200) if steering.repeat(20.0 + 0.01 * step + 1e-6, 99.0) is not None]
    assert times[0] in (10, 11) and len(times) == 4 and set(spaces(times)) <= {10, 11}, "also without a command"


@pytest.mark.parametrize("number", [1, 11])
def test_what_was_overridden_is_released_whatever_is_known_of_the_vehicle_since(number: int) -> None:
    steering = output(number=number)
    steering.steer(0.0, 0.1)
    steering.forget()
    released = [65535] * 8 + [0] * 10
    released[number - 1] = 0 if number <= 8 else 65534
    assert channels(steering.release(1.0)) == released
    assert [channels(message) for message in steering.release_burst()] == [released] * 5


def test_another_input_is_overridden_only_when_the_one_before_is_released() -> None:
    steering = output()
    steering.steer(0.0, 0.1)
    steering.use(known(number=2))
    assert steering.unmoving(1500) is None and steering.amidships() is None
    times = [step for step in range(100) if steering.release(0.01 * step + 1e-6) is not None]
    assert len(times) == 5
    assert steering.unmoving(1500) is not None and steering.release_burst()
    assert channels(steering.release_burst()[0])[:2] == [65535, 0]


def test_the_way_out_releases_five_times_at_once_whatever_was_released_before() -> None:
    steering = output()
    steering.steer(0.0, 0.1)
    for _ in range(2):
        burst = steering.release_burst()
        assert [channels(message)[0] for message in burst] == [0] * 5
        assert steering.release(9.0) is None and steering.repeat(9.0, 10.0) is None
    unmoved = output()
    assert unmoved.unmoving(1500) is not None
    assert unmoved.release(-9.0) is not None, "at once"
    assert len(unmoved.release_burst()) == 5, "the proof is an override too"


def test_what_is_not_known_steers_nothing() -> None:
    unknown = SteeringOutput("rc_override", FULL, False)
    assert unknown.use(VehicleParameters()) == ""
    assert (unknown.steer(0.0, 0.1), unknown.unmoving(1500), unknown.amidships()) == (None, None, None)
    steering = output()
    assert steering.steer(0.0, math.nan) is None and steering.steer(0.0, math.inf) is None
    steering.forget()
    assert (steering.steer(0.0, 0.1), steering.channel) == (None, None)
    for bad in (0.0, -0.1, math.inf, math.nan):
        with pytest.raises(ValueError, match="positive angle"):
            SteeringOutput("rc_override", bad, False)


def test_parameters_that_change_are_taken_and_those_that_leave_no_room_are_said() -> None:
    steering = output()
    steering.steer(0.0, FULL)
    assert steering.use(known()) == "" and steering.repeat(0.5, 10.0) is not None, "nothing has changed"
    assert steering.use(known(RC1_MAX=1900.0)) == ""
    assert channels(steering.repeat(0.9, 10.0))[0] == 0, "what was made for another boat is not repeated"
    assert channels(steering.steer(1.0, FULL))[0] == 1900
    assert steering.use(known(2)) == ""
    assert channels(steering.steer(2.0, FULL))[:2] == [65535, 2000]
    said = steering.use(known(RC1_TRIM=2000.0))
    assert said.startswith("the vehicle's parameters leave no room to steer (steering input")
    assert steering.steer(3.0, FULL) is None


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
@pytest.mark.parametrize("stick", [0, 1000, 1100, 1496, 1500, 1730, 2000])
def test_the_proof_s_input_differs_by_more_than_three_microseconds_and_moves_least(method: str, stick: int) -> None:
    steering = output(method, RC1_DZ=30.0)
    found = steering.unmoving(stick)
    assert found is not None and steering.channel is not None
    message, asked = found
    held = stick or 1500
    assert abs(asked - stick) > 3
    there, here = (
        servo_from_steering(steering.channel, steering_from_pulse(steering.channel, pulse)) for pulse in (asked, held)
    )
    inside = abs(held - 1500) <= 20
    assert abs(there - here) <= (0 if inside or stick == 0 else 6)
    sent = channels(message)[0] if method == "rc_override" else 1000 + (axes(message)[1] + 1000) // 2
    assert sent == pytest.approx(asked, abs=1)


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
def test_amidships_leaves_the_servo_at_its_trim_off_the_stick_s(method: str) -> None:
    steering = output(method, RC1_DZ=30.0, SERVO1_TRIM=1480.0)
    found = steering.amidships()
    assert found is not None and steering.channel is not None
    assert servo_from_steering(steering.channel, steering_from_pulse(steering.channel, found[1])) == 1480
    assert found[1] == pytest.approx(1515, abs=1)
    shown = channels(found[0])[0] if method == "rc_override" else axes(found[0])[1]
    assert shown == (found[1] if method == "rc_override" else pytest.approx(30, abs=2))


@pytest.mark.parametrize(("low", "high", "short"), [(1167, 1833, False), (1176, 1833, True), (1167, 1824, True)])
def test_end_points_short_of_what_may_be_ordered_are_said(low: int, high: int, short: bool) -> None:
    steering = SteeringOutput("rc_override", FULL, False, (1000.0, 1500.0, 2000.0), math.radians(20.0))
    said = steering.use(known(SERVO1_MIN=float(low), SERVO1_MAX=float(high)))
    assert (said == "") is not short
    assert steering.use(known(SERVO1_MIN=float(low), SERVO1_MAX=float(high))) == said, "and again"
    if short:
        assert said.startswith(f"SERVO1_MIN to _MAX, {low} to {high} us, is 19 deg of rudder by helm.servo_us")
        assert "[1000, 1500, 2000], and rudder.angle_max_deg is 20;" in said
        assert "set SERVO1_MIN to 1167 and SERVO1_MAX to 1833, or rudder.angle_max_deg to 19" in said


@pytest.mark.parametrize(
    ("pulse", "steering"),
    [(1100, -4500), (1000, -4500), (1285, -2250), (1470, 0), (1500, 0), (1530, 0), (1531, 12), (1469, -13),
     (1715, 2250), (1900, 4500), (2000, 4500)],
)  # fmt: skip
def test_the_firmware_reads_a_pulse_in_whole_numbers(pulse: int, steering: int) -> None:
    channel = SteeringChannel()
    read = steering_from_pulse(channel, pulse)
    assert read == pytest.approx(steering, abs=1)
    assert steering_from_pulse(channel._replace(rc_reversed=True), pulse) == -read


@pytest.mark.parametrize(
    ("expo", "steering", "servo"),
    [(0.0, 2250, 1700), (0.0, -2250, 1300), (0.5, 2250, 1633), (0.5, -2250, 1367), (0.8, 3600, 1678),
     (0.95, 2250, 1700),
     (0.5, 4500, 1900), (-0.5, 2250, 1740)],
)  # fmt: skip
def test_the_exponent_weakens_small_sticks(expo: float, steering: int, servo: int) -> None:
    channel = SteeringChannel(expo=expo)
    assert servo_from_steering(channel, steering) == pytest.approx(servo, abs=1)
    mirrored = servo_from_steering(channel._replace(servo_reversed=True), steering)
    assert mirrored == pytest.approx(3000 - servo, abs=1)


def test_a_servo_s_share_goes_from_its_trim_to_either_end() -> None:
    channel = SteeringChannel(servo_min=1200, servo_trim=1450, servo_max=1950)
    for pulse, share in ((1200, -1.0), (1325, -0.5), (1450, 0.0), (1700, 0.5), (1950, 1.0), (1000, -1.0), (2100, 1.0)):
        assert share_from_servo(channel, pulse) == share
        assert share_from_servo(channel._replace(servo_reversed=True), pulse) == -share
    scaled = channel._replace(scale=(1000.0, 1500.0, 2000.0))
    assert [share_from_servo(scaled, pulse) for pulse in (900, 1250, 1500, 2100)] == [-1.2, -0.5, 0.0, 1.2]
    assert (reach(scaled), reach(channel)) == (0.6, 1.0)


def test_a_stick_s_thousandths_are_pulses_between_the_end_points() -> None:
    channel = SteeringChannel(rc_min=1100, rc_max=1900)
    assert [pulse_from_manual(channel, y) for y in (-1000, -500, 0, 1, 2, 500, 1000)] == [
        *(1100, 1300, 1500, 1500, 1500, 1700, 1900)
    ]
    table = manual_table(channel)
    assert [table.nearest(share) for share in (-1.0, 1.0)] == pytest.approx([-1000, 1000], abs=1)
    assert table.nearest(0.0) == pytest.approx(38, abs=1), "half a dead zone off the trim"
    assert pulse_table(channel).nearest(0.0) == 1515


@pytest.mark.parametrize(
    ("changes", "is_refused"),
    [
        ({"rc_min": 500}, False),
        ({"rc_min": 499}, True),
        ({"servo_max": 2500}, False),
        ({"servo_max": 2501}, True),
        ({"rc_dead_zone": -1}, True),
        ({"rc_dead_zone": 0}, False),
        ({"rc_dead_zone": 399}, False),
        ({"rc_dead_zone": 400}, True),
        ({"servo_trim": 1101}, False),
        ({"servo_trim": 1100}, True),
        ({"servo_trim": 1899}, False),
        ({"servo_trim": 1900}, True),
        ({"scale": (1000.0, 1000.0, 2000.0)}, True),
        ({"scale": (1000.0, 1500.0, 2000.0)}, False),
    ],
)
def test_a_calibration_is_taken_up_to_its_limits(changes: dict[str, Any], is_refused: bool) -> None:
    channel = SteeringChannel()._replace(**changes)
    if is_refused:
        with pytest.raises(ValueError, match=r"do not rise|pulses go from 500 to 2500"):
            channel.check()
    else:
        channel.check()
