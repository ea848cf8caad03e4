"""The vehicle's parameters: what is asked for and how often, when all is known, and what each says."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from autopilot.links.mavlink.requests import VehicleParameters
from autopilot.links.mavlink.steering import SteeringChannel, channel_of

NEEDED = ["RCMAP_ROLL", "MANUAL_STR_EXPO", "RC_OVERRIDE_TIME", "MAV_GCS_SYSID_HI"]


def known(throttle: bool = False, **values: float) -> VehicleParameters:
    parameters = VehicleParameters(throttle)
    for name, value in values.items():
        assert parameters.take(name, value)
    return parameters


def tries(parameters: VehicleParameters, seconds: float) -> dict[str, list[float]]:
    """Return when each name is asked for."""
    times: dict[str, list[float]] = {}
    for step in range(round(seconds * 20)):
        for name in parameters.due(0.05 * step):
            times.setdefault(name, []).append(0.05 * step)
    return times


def test_what_steering_needs_is_asked_for_first_and_eight_at_a_time() -> None:
    parameters = known()
    assert parameters.due(0.0) == ["SYSID_MYGCS", "MAV_GCS_SYSID", *NEEDED, "SERVO1_FUNCTION", "SERVO2_FUNCTION"]
    assert parameters.due(0.09) == []
    assert parameters.due(0.1) == [f"SERVO{number}_FUNCTION" for number in range(3, 11)]
    assert parameters.due(0.21) == [*(f"SERVO{number}_FUNCTION" for number in range(11, 17)), "RCMAP_PITCH",
                                    "RCMAP_THROTTLE"]  # fmt: skip
    missing = parameters.missing
    assert len(missing) == 2 + 4 + 16 + 3 + 9 + 16 == len(set(missing))
    assert missing[-1] == "RC16_OPTION" and "RC1_OPTION" in missing


def test_what_is_known_of_the_channels_says_what_else_is_needed() -> None:
    parameters = known(MAV_GCS_SYSID=255.0, RCMAP_ROLL=4.0, SERVO16_FUNCTION=26.0)
    assert parameters.missing[:12] == [
        *NEEDED[1:],
        *("RC4_MIN", "RC4_TRIM", "RC4_MAX", "RC4_DZ", "RC4_REVERSED"),
        *("SERVO16_MIN", "SERVO16_TRIM", "SERVO16_MAX", "SERVO16_REVERSED"),
    ]
    with_throttle = known(True, MAV_GCS_SYSID=255.0)
    assert {"RC3_TRIM", "RC3_DZ"} <= set(with_throttle.missing)
    with_throttle.take("RCMAP_THROTTLE", 5.0)
    assert {"RC5_TRIM", "RC5_DZ"} <= set(with_throttle.missing)
    assert "RC3_TRIM" not in with_throttle.missing


def test_each_parameter_is_requested_every_half_second_until_given_up() -> None:
    times = tries(known(MAV_GCS_SYSID=255.0), 12.0)
    assert {name: len(times[name]) for name in ("MANUAL_STR_EXPO", "RC_OVERRIDE_TIME", "MAV_GCS_SYSID_HI")} == {
        "MANUAL_STR_EXPO": 3,
        "RC_OVERRIDE_TIME": 3,
        "MAV_GCS_SYSID_HI": 3,
    }
    assert {len(asked) for name, asked in times.items() if name.endswith(("_OPTION", "_ENABLE"))} == {3}
    assert {len(asked) for name, asked in times.items() if name.endswith("_FUNCTION")} == {10}
    assert len(times["RCMAP_ROLL"]) >= 15
    for asked in times.values():
        assert min((b - a for a, b in pairwise(asked)), default=1.0) >= 0.5 - 1e-9


@pytest.mark.parametrize(("later", "is_asked"), [(0.4999, False), (0.5, True)])
def test_half_a_second_to_the_bit_is_waited_for_an_answer(later: float, is_asked: bool) -> None:
    parameters = known()
    assert "SYSID_MYGCS" in parameters.due(0.0)
    assert ("SYSID_MYGCS" in parameters.due(later)) is is_asked


def test_a_name_that_six_questions_did_not_bring_is_unanswered_while_it_is_needed() -> None:
    parameters = known(MAV_GCS_SYSID=255.0)
    named: list[tuple[int, bool]] = []
    asked = 0
    for step in range(200):
        asked += "RCMAP_ROLL" in parameters.due(0.05 * step)
        named.append((asked, "RCMAP_ROLL" in parameters.unanswered))
    assert all(is_named is (count >= 6) for count, is_named in named)
    assert named[-1][1]
    assert "MANUAL_STR_EXPO" not in parameters.unanswered, "given up: old firmware has none"
    assert "SERVO9_FUNCTION" not in parameters.unanswered
    parameters.take("RCMAP_ROLL", 1.0)
    assert "RCMAP_ROLL" not in parameters.unanswered


def test_all_is_known_when_what_steering_needs_has_come() -> None:
    parameters = known(RCMAP_ROLL=1.0, SERVO2_FUNCTION=26.0)
    names = [f"RC1_{name}" for name in ("MIN", "TRIM", "MAX", "DZ", "REVERSED")]
    names += [f"SERVO2_{name}" for name in ("MIN", "TRIM", "MAX", "REVERSED")]
    for name in ("MANUAL_STR_EXPO", *names, "MAV_GCS_SYSID"):
        assert not parameters.complete
        parameters.take(name, 1.0)
    assert parameters.complete
    parameters.reset()
    assert not parameters.complete and parameters.get("RC1_MIN") is None


def test_the_exponent_is_waited_for_until_it_was_asked_for_three_times() -> None:
    parameters = known(MAV_GCS_SYSID=255.0, RCMAP_ROLL=1.0, SERVO2_FUNCTION=26.0)
    for number, names in ((1, ("MIN", "TRIM", "MAX", "DZ", "REVERSED")), (2, ())):
        for name in names:
            parameters.take(f"RC{number}_{name}", 1.0)
    for name in ("MIN", "TRIM", "MAX", "REVERSED"):
        parameters.take(f"SERVO2_{name}", 1.0)
    asked = 0
    for step in range(60):
        assert parameters.complete is (asked >= 3)
        asked += "MANUAL_STR_EXPO" in parameters.due(0.05 * step)
    assert asked == 3 and parameters.complete


@pytest.mark.parametrize(
    ("value", "system"),
    [(1.0, 1), (255.0, 255), (0.0, None), (0.99, None), (256.0, None), (255.5, None), (-1.0, None), (87.0, 87)],
)
@pytest.mark.parametrize("name", ["SYSID_MYGCS", "MAV_GCS_SYSID"])
def test_a_ground_station_s_id_is_1_to_255(name: str, value: float, system: int | None) -> None:
    parameters = known(**{name: value})
    assert (parameters.gcs_name, parameters.gcs_system, parameters.gcs_impossible) == (name, system, system is None)


def test_before_the_id_has_come_nobody_is_obeyed() -> None:
    parameters = known(MAV_GCS_SYSID_HI=255.0)
    assert not any(parameters.obeys(system) for system in range(256))
    assert (parameters.gcs_name, parameters.gcs_impossible) == ("SYSID_MYGCS", False)


@pytest.mark.parametrize(
    ("high", "obeyed"), [(None, {200}), (0.0, {200}), (199.0, {200}), (203.0, {200, 201, 202, 203})]
)
def test_the_vehicle_obeys_one_system_or_a_range(high: float | None, obeyed: set[int]) -> None:
    parameters = known(MAV_GCS_SYSID=200.0, **({} if high is None else {"MAV_GCS_SYSID_HI": high}))
    assert {system for system in range(256) if parameters.obeys(system)} == obeyed


@pytest.mark.parametrize(("value", "number"), [(0.0, None), (1.0, 1), (16.0, 16), (17.0, None), (-1.0, None)])
def test_input_channels_are_1_to_16(value: float, number: int | None) -> None:
    assert known(RCMAP_ROLL=value).steering_input == number
    assert known(RCMAP_THROTTLE=value).throttle_input == (3 if number is None else number)


def test_the_first_of_the_outputs_and_switches_is_taken_up_to_the_last() -> None:
    for number in range(1, 17):
        parameters = known(**{f"SERVO{number}_FUNCTION": 26.0, f"RC{number}_OPTION": 46.0})
        assert (parameters.steering_servo, parameters.override_switch) == (number, number)
        assert known(**{f"SERVO{number}_FUNCTION": 27.0, f"RC{number}_OPTION": 45.0}).steering_servo is None
        assert known(**{f"RC{number}_OPTION": 47.0}).override_switch is None
    assert known(SERVO2_FUNCTION=26.0, SERVO1_FUNCTION=26.0).steering_servo == 1
    none = VehicleParameters()
    for number in (0, 17):
        none.take(f"SERVO{number}_FUNCTION", 26.0)
        none.take(f"RC{number}_OPTION", 46.0)
    assert (none.steering_servo, none.override_switch) == (None, None)


@pytest.mark.parametrize(
    ("values", "free"),
    [
        ({}, (2, 4)),
        ({"RCMAP_ROLL": 1.0}, (2, 4)),
        ({"RCMAP_ROLL": 4.0}, (2,)),
        ({"RCMAP_THROTTLE": 2.0}, (4,)),
        ({"RCMAP_PITCH": 16.0, "RCMAP_YAW": 17.0}, (16,)),
        ({"RCMAP_PITCH": 0.0, "RCMAP_YAW": 1.0}, (1,)),
        ({"RCMAP_PITCH": 5.0, "RCMAP_YAW": 6.0}, (5, 6)),
    ],
)
def test_free_sticks_neither_steer_nor_give_throttle(values: dict[str, float], free: tuple[int, ...]) -> None:
    assert known(**values).free_sticks == free


def test_the_throttle_s_neutral_reaches_a_dead_zone_to_both_sides() -> None:
    assert known(RC3_TRIM=1510.0).throttle_neutral is None
    assert known(RC3_DZ=30.0).throttle_neutral is None
    assert known(RC3_TRIM=1510.0, RC3_DZ=30.0).throttle_neutral == (3, 1480, 1540)
    assert known(RCMAP_THROTTLE=8.0, RC8_TRIM=1100.0, RC8_DZ=20.0).throttle_neutral == (8, 1080, 1120)


def test_the_steering_channel_has_every_value_in_its_place() -> None:
    values = {
        "RCMAP_ROLL": 2.0,
        "RC2_MIN": 1001.0,
        "RC2_TRIM": 1502.0,
        "RC2_MAX": 2003.0,
        "RC2_DZ": 24.0,
        "RC2_REVERSED": 1.0,
        "SERVO5_FUNCTION": 26.0,
        "SERVO5_MIN": 1105.0,
        "SERVO5_TRIM": 1506.0,
        "SERVO5_MAX": 1907.0,
        "SERVO5_REVERSED": 0.0,
    }
    for left_out in values:
        assert channel_of(known(**{name: value for name, value in values.items() if name != left_out})) is None
    plain = SteeringChannel(1001, 1502, 2003, 24, True, 1105, 1506, 1907, False, 0.0)
    assert channel_of(known(**values)) == plain
    other = {**values, "RC2_REVERSED": 0.0, "SERVO5_REVERSED": 1.0, "MANUAL_STR_EXPO": 0.3}
    assert channel_of(known(**other)) == plain._replace(rc_reversed=False, servo_reversed=True, expo=0.3)


def test_a_change_is_counted_and_what_is_no_change_is_not() -> None:
    parameters = known()
    seen = {parameters.revision}
    assert parameters.take("RC1_MIN", 1000.0)
    seen.add(parameters.revision)
    for name, value in (("RC1_MIN", 1000.0), ("RC1_MAX", math.nan), ("RC1_MAX", math.inf), ("CRUISE_SPEED", 2.0)):
        assert not parameters.take(name, value)
        assert parameters.revision in seen and len(seen) == 2
    parameters.reset()
    assert parameters.revision not in seen
    before = parameters.revision
    assert parameters.due(0.0)
    assert parameters.revision > before, "what is unanswered may have changed"
    assert not parameters.take("RC17_MIN", 1.0) and not parameters.take("SERVO17_FUNCTION", 26.0)
    assert parameters.take("RC16_MIN", 1.0) and parameters.take("SERVO16_FUNCTION", 25.0)


def in_use() -> VehicleParameters:
    """Return a vehicle's of which everything has come."""
    parameters = known(MAV_GCS_SYSID=255.0, RCMAP_ROLL=1.0, SERVO2_FUNCTION=26.0)
    for name in parameters.missing:
        if name != "SYSID_MYGCS":
            parameters.take(name, 0.0 if name.endswith("_FUNCTION") else 1.0)
    assert not parameters.to_ask
    return parameters


STEERED_BY = {
    *("MAV_GCS_SYSID", "RCMAP_ROLL", "MANUAL_STR_EXPO", "RC_OVERRIDE_TIME"),
    *("RC_OPTIONS", "PILOT_STEER_TYPE", "MANUAL_OPTIONS"),
    *(f"RC1_{suffix}" for suffix in ("MIN", "TRIM", "MAX", "DZ", "REVERSED")),
    *(f"SERVO2_{suffix}" for suffix in ("MIN", "TRIM", "MAX", "REVERSED", "FUNCTION")),
}


def test_once_all_has_come_each_parameter_in_use_is_asked_for_again_in_turn() -> None:
    parameters, asked = in_use(), []
    for step in range(round(3.0 * len(STEERED_BY) * 20)):
        asked += parameters.again(0.05 * step)
    assert sorted(asked) == sorted(STEERED_BY)


def test_doubt_has_all_in_use_asked_for_in_bursts_and_not_again_for_ten_seconds() -> None:
    parameters = in_use()
    parameters.again(0.0)
    parameters.doubt(1.0)
    first, pause, second = parameters.again(1.0), parameters.again(1.05), parameters.again(1.1)
    assert (len(first), pause, len(second)) == (8, [], 8)
    assert len({*first, *second, *parameters.again(1.25)}) == len(STEERED_BY)
    parameters.doubt(11.0)
    assert len(parameters.again(11.0)) == 1, "its turn"
    parameters.doubt(11.05)
    assert len(parameters.again(11.1)) == 8
