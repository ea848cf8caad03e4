"""What a companion sends, field by field: what is not ours to say is 0."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.requests import (
    VehicleParameters,
    companion_heartbeat,
    interval_request,
    obstacle_of,
    parameter_request,
    station_heartbeat,
)

BURST = 8
RETRY_S = 0.5


def test_an_interval_is_asked_of_the_autopilot_with_nothing_else_set() -> None:
    message = interval_request(7, 30, 50_000)
    assert (message.target_system, message.target_component, message.command) == (7, 1, 511)
    assert (message.confirmation, message.param1, message.param2) == (0, 30, 50_000)
    assert [getattr(message, f"param{number}") for number in range(3, 8)] == [0] * 5


def test_a_parameter_is_asked_for_by_its_name_and_no_number() -> None:
    message = parameter_request(7, "SERVO1_MIN")
    assert (message.target_system, message.target_component, message.param_id) == (7, 1, "SERVO1_MIN")
    assert message.param_index == -1


def test_neither_heartbeat_can_be_taken_for_the_vehicles() -> None:
    ours, station = companion_heartbeat(dialect.MAV_STATE_STANDBY), station_heartbeat()
    assert (ours.type, ours.autopilot, ours.base_mode, ours.custom_mode, ours.system_status) == (18, 8, 0, 0, 3)
    assert (station.type, station.autopilot, station.base_mode, station.custom_mode) == (6, 8, 0, 0)
    assert station.system_status == dialect.MAV_STATE_ACTIVE


@pytest.mark.parametrize(
    ("autopilot", "kind", "words"),
    [
        (3, 11, ""),
        (3, 10, ""),
        (12, 11, "start with --steer offboard"),
        (13, 11, "does not run ArduPilot"),
        (3, 2, "MAV_TYPE 2, not a boat"),
        (8, 2, "ArduPilot"),
    ],
)
def test_only_ardupilots_boats_and_rovers_can_be_steered(autopilot: int, kind: int, words: str) -> None:
    said = obstacle_of(autopilot, kind)
    assert (words in said) if words else said == ""


@pytest.mark.parametrize(
    ("autopilot", "kind", "words"), [(12, 11, ""), (3, 11, "does not run PX4"), (12, 2, "MAV_TYPE 2")]
)
def test_only_px4s_boats_and_rovers_can_be_steered_in_offboard(autopilot: int, kind: int, words: str) -> None:
    said = obstacle_of(autopilot, kind, offboard=True)
    assert (words in said) if words else said == ""


def test_parameters_are_asked_for_in_bursts_with_pauses_and_again_after_half_a_second() -> None:
    parameters = VehicleParameters()
    first = parameters.due(0.0)
    assert len(first) == BURST
    assert parameters.due(0.05) == [], "a slow radio is not flooded"
    second = parameters.due(0.1)
    assert second and not set(first) & set(second)
    for name in second:
        parameters.take(name, 1.0)
    again = parameters.due(RETRY_S + 0.01)
    assert set(first) & set(again)
    assert not set(second) & set(again), "what has come is not asked for"


def test_heartbeats_are_of_the_third_version_and_carry_the_state() -> None:
    for state in range(9):
        assert companion_heartbeat(state).system_status == state
    assert companion_heartbeat(4).mavlink_version == station_heartbeat().mavlink_version == 3
