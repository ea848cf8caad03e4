"""Which messages leave one port, and when: ArduPilot's stream groups and message intervals."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from sitl.firmware_parameters import ParameterTable
from sitl.telemetry import BUILDERS

GROUPS: dict[str, tuple[int, ...]] = {
    "SR0_EXT_STAT": (
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_MISSION_CURRENT,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
    ),
    "SR0_POSITION": (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED),
    "SR0_RC_CHAN": (dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, dialect.MAVLINK_MSG_ID_RC_CHANNELS),
    "SR0_EXTRA1": (dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_SIMSTATE),
    "SR0_EXTRA2": (dialect.MAVLINK_MSG_ID_VFR_HUD,),
    "SR0_EXTRA3": (dialect.MAVLINK_MSG_ID_SYSTEM_TIME,),
}
REQUESTS: dict[int, tuple[str, ...]] = {
    dialect.MAV_DATA_STREAM_ALL: (*GROUPS, "SR0_RAW_SENS", "SR0_RAW_CTRL"),
    dialect.MAV_DATA_STREAM_RAW_SENSORS: ("SR0_RAW_SENS",),
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: ("SR0_EXT_STAT",),
    dialect.MAV_DATA_STREAM_RC_CHANNELS: ("SR0_RC_CHAN",),
    dialect.MAV_DATA_STREAM_RAW_CONTROLLER: ("SR0_RAW_CTRL",),
    dialect.MAV_DATA_STREAM_POSITION: ("SR0_POSITION",),
    dialect.MAV_DATA_STREAM_EXTRA1: ("SR0_EXTRA1",),
    dialect.MAV_DATA_STREAM_EXTRA2: ("SR0_EXTRA2",),
    dialect.MAV_DATA_STREAM_EXTRA3: ("SR0_EXTRA3",),
}
"""The stream-rate parameters that REQUEST_DATA_STREAM sets, by its stream id."""

INTERVAL_MAX = 60.0
"""Longest interval [s] that the firmware keeps."""


class Streams:
    """Interval and next due time of every message of one port."""

    def __init__(self, parameters: ParameterTable, time: float) -> None:
        self._parameters = parameters
        self._interval: dict[int, float] = {}
        self._due: dict[int, float] = {}
        self.next_due = time
        self.reset(time)

    def reset(self, time: float) -> None:
        """Set every message to its default: HEARTBEAT at 1 Hz, the rest by its group's SR0_ parameter."""
        self._interval.clear()
        self._due.clear()
        self.set_interval(dialect.MAVLINK_MSG_ID_HEARTBEAT, 1.0, time)
        for message in BUILDERS:
            self.set_default(message, time)

    def default_interval(self, message: int) -> float:
        """Return the default interval [s], 0 where the message is not streamed."""
        if message == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            return 1.0
        for name, messages in GROUPS.items():
            if message in messages and self._parameters[name] > 0.0:
                return 1.0 / self._parameters[name]
        return 0.0

    def set_default(self, message: int, time: float) -> None:
        """Give one message its default interval."""
        self.set_interval(message, self.default_interval(message), time)

    def set_group(self, name: str, time: float) -> None:
        """Give the messages of an SR0_ parameter the interval it says now."""
        for message in GROUPS.get(name, ()):
            self.set_default(message, time)

    def set_interval(self, message: int, interval: float, time: float) -> None:
        """Stream a message every `interval` [s], no faster than the main loop; 0 or less stops it."""
        if interval <= 0.0:
            self._interval.pop(message, None)
            self._due.pop(message, None)
        else:
            shortest = 1.0 / max(self._parameters["SCHED_LOOP_RATE"], 1.0)
            self._interval[message] = min(max(interval, shortest), INTERVAL_MAX)
            self._due[message] = time
        self.next_due = min(self._due.values(), default=float("inf"))

    def interval(self, message: int) -> float:
        """Return the interval [s] of a message, 0 where it is not streamed."""
        return self._interval.get(message, 0.0)

    def take_due(self, time: float) -> list[int]:
        """Return the messages that are due at `time` [s], in a fixed order, and set their next times."""
        if time + 1.0e-9 < self.next_due:
            return []
        due = [message for message, when in self._due.items() if when <= time + 1.0e-9]
        for message in due:
            following = self._due[message] + self._interval[message]
            # after a pause the stream goes on from now: no burst to catch up
            self._due[message] = following if following > time else time + self._interval[message]
        self.next_due = min(self._due.values(), default=float("inf"))
        return due
