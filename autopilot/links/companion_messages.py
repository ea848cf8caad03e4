"""What a companion sends besides steering: heartbeats and requests. Pure."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message

AUTOPILOT_COMPONENT = 1
BOATS = (dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_TYPE_GROUND_ROVER)


def companion_heartbeat(state: int) -> Message:
    """Return our own heartbeat, with MAV_STATE `state`."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
    )


def station_heartbeat() -> Message:
    """Return the heartbeat of the ground station in whose name we steer."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
    )


def interval_request(vehicle: int, identity: int, interval_us: int) -> Message:
    """Return the request to stream the message `identity` every `interval_us`."""
    return dialect.MAVLink_command_long_message(
        vehicle,
        AUTOPILOT_COMPONENT,
        dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
        0,
        identity,
        interval_us,
        0,
        0,
        0,
        0,
        0,
    )


def parameter_request(vehicle: int, name: str) -> Message:
    """Return the request for one parameter by its name."""
    return dialect.MAVLink_param_request_read_message(vehicle, AUTOPILOT_COMPONENT, name.encode(), -1)


def obstacle_of(autopilot: int, kind: int) -> str:
    """Return why a vehicle of this MAV_AUTOPILOT and MAV_TYPE cannot be steered; '' where it can."""
    if autopilot != dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return "the vehicle does not run ArduPilot, whose steering input is the only one known so far; use ArduRover"
    if kind not in BOATS:
        return f"the vehicle is of MAV_TYPE {kind}, not a boat or rover; connect to the boat's flight controller"
    return ""
