"""Another pilot on the same boat, known by what it says of itself every second: NAMED_VALUE_INT "PILOT". Pure.

Both pilots have the vehicle's system id and component 191. ArduPilot passes messages without a target on to its other
links, but no heartbeat to a link on which the same address was heard (libraries/GCS_MAVLink/MAVLink_routing.cpp), so a
heartbeat would not do. What we have sent ourselves, and comes back, is not another's.
"""

from __future__ import annotations

import math
from collections import deque
from enum import IntEnum

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message, message_id
from autopilot.safety import CANNOT_ENGAGE
from autopilot.signals import AlarmEvent, Mode

NAME = "PILOT"


class PilotState(IntEnum):
    """The value under that name."""

    IDLE = 0
    WAITS = 1
    STEERS = 2


PERIOD_S = 1.0
SILENT_S = 3.5
LISTENS_S = 1.2
"""Each speaks every second: so long it takes to know that nobody else is there."""
OWN_KEPT = 8

LISTENING = "listening for another pilot on this boat"
STEERED = "another pilot steers this boat; let it stand by, or start with --with-other-pilot"


class OtherPilot:
    """Says what we are, and hears what others say. `is_forced`: we engage though another steers."""

    def __init__(self, is_forced: bool = False) -> None:
        self._is_forced = is_forced
        self._own: deque[bytes] = deque(maxlen=OWN_KEPT)
        self._state = PilotState.IDLE
        self._next = -math.inf
        self._began: float | None = None
        self._steers_time = self._waits_time = -math.inf

    def tell(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Take our own mode and alarms; a change of what we are is said at once."""
        state = PilotState.IDLE
        if mode in (Mode.ENGAGED, Mode.FAILSAFE):
            state = PilotState.STEERS
        elif any(alarm.name == CANNOT_ENGAGE for alarm in alarms):
            state = PilotState.WAITS
        if state is not self._state:
            self._state, self._next = state, now

    def due(self, now: float) -> Message | None:
        """Return what we say of ourselves, when it is time to."""
        if now < self._next:
            return None
        self._next = now + PERIOD_S
        return dialect.MAVLink_named_value_int_message(int(now * 1000.0) & 0xFFFFFFFF, NAME.encode(), self._state)

    def sent(self, packet: bytes) -> None:
        """Take a packet of our own as it left, which may come back to us."""
        self._own.append(packet)

    def take(self, now: float, message: Message) -> None:
        """Take any message that arrived and is not the vehicle's."""
        if message_id(message) != dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT or bytes(message._msgbuf) in self._own:
            return
        if message.name != NAME:
            return
        self._steers_time = now if message.value == PilotState.STEERS else -math.inf
        self._waits_time = now if message.value == PilotState.WAITS else -math.inf

    def obstacle(self, now: float) -> str:
        """Return why we may not try to take the helm at `now` [s]; empty where nobody else is known to have it."""
        self._began = now if self._began is None else self._began
        return STEERED if self._steers(now) and not self._is_forced else ""

    def waiting(self, now: float) -> str:
        """Return that it is not yet known whether anybody else is there."""
        is_new = self._began is not None and now - self._began < LISTENS_S
        return LISTENING if is_new and not self._is_forced else ""

    def alarm(self, now: float, is_steering: bool) -> AlarmEvent | None:
        """Return what the skipper of a boat that we steer should know of another pilot."""
        if not is_steering:
            return None
        if self._steers(now):
            return AlarmEvent("other_pilot")
        return AlarmEvent("other_pilot_waits") if now - self._waits_time <= SILENT_S else None

    def _steers(self, now: float) -> bool:
        return now - self._steers_time <= SILENT_S
