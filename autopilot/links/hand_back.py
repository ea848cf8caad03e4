"""Hands the boat back to the flight controller in a fail-safe: orders it into a mode, sees whether it goes. Pure."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.companion_messages import AUTOPILOT_COMPONENT
from autopilot.links.mavlink_codec import Message
from autopilot.signals import ConditionSample, Mode

MODES = {"HOLD": 4, "LOITER": 5, "RTL": 11}
"""ArduRover's custom modes; source: ArduPilot, Rover/mode.h."""
REPEAT_S = 0.5
PATIENCE_S = 3.0
"""A vehicle that is not in the mode after this does not take it; it is asked on, but people must know."""
GIVE_UP_S = 30.0


class HandBack:
    """`tell` it the pilot's mode; `due` has what to send; `seen` tells of a vehicle that does not obey."""

    def __init__(self, mode: int) -> None:
        self._mode = mode
        self._since: float | None = None
        self._next = math.nan
        self._is_done = self._is_told = False

    def tell(self, now: float, mode: Mode) -> None:
        """Take the pilot's mode: a fail-safe or a fault begins to hand back. Who takes the helm then is not fought."""
        if mode not in (Mode.FAILSAFE, Mode.FAULT):
            self._since = None
        elif self._since is None:
            self._since, self._next, self._is_done = now, now, False

    def due(self, now: float, vehicle: int) -> list[Message]:
        """Return the command that is due: until the vehicle is in the mode, or half a minute has passed."""
        if self._since is None or self._is_done or now < self._next or now - self._since > GIVE_UP_S:
            return []
        self._next = now + REPEAT_S
        flags = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        command = dialect.MAV_CMD_DO_SET_MODE
        return [
            dialect.MAVLink_command_long_message(
                vehicle, AUTOPILOT_COMPONENT, command, 0, flags, self._mode, 0, 0, 0, 0, 0
            )
        ]

    def seen(self, now: float, mode: int, link: str) -> list[ConditionSample]:
        """Take the vehicle's mode; return what has changed in whether it refuses."""
        self._is_done = self._is_done or (self._since is not None and mode == self._mode)
        refuses = self._since is not None and not self._is_done and now - self._since > PATIENCE_S
        if refuses == self._is_told:
            return []
        self._is_told = refuses
        return [ConditionSample(now, "handback_refused", refuses, f"still in mode {mode}" if refuses else "", link)]
