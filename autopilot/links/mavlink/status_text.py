"""Texts for the people who watch: STATUSTEXT in pieces of 50 characters, never faster than a radio can bear. Pure."""

from __future__ import annotations

import math
from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import Message
from autopilot.signals import AlarmEvent
from autopilot.supervision.alarms import kind_of

PIECE = 50
SPACING_S = 0.2
WAITING_LIMIT = 40
REPEAT_S = 10.0
"""The same text is sent again only after this."""


def severity_of(alarm: AlarmEvent, usual: int) -> int:
    """Return the MAV_SEVERITY of an alarm: its own in the table or `usual`, whichever is worse, and the worst but one
    for what nobody has acknowledged."""
    own = dialect.MAV_SEVERITY_ALERT if alarm.is_escalated else kind_of(alarm).severity
    return min(usual, int(own))


class StatusTexts:
    """A short queue of texts, the pieces that wait in `waiting`; when it is full the newest are dropped and counted."""

    def __init__(self) -> None:
        self.dropped = 0
        self.waiting: deque[Message] = deque()
        self._next = -math.inf
        self._identity = 0
        self._last = ("", math.nan)

    def send_text(self, now: float, severity: int, text: str) -> None:
        """Queue `text` with MAV_SEVERITY `severity` (0 emergency to 7 debug)."""
        if text == self._last[0] and now - self._last[1] < REPEAT_S:
            return
        raw = text.encode("ascii", errors="replace")
        pieces = [raw[start : start + PIECE] for start in range(0, len(raw), PIECE)]
        if not pieces or len(self.waiting) + len(pieces) > WAITING_LIMIT:
            self.dropped += bool(pieces)
            return
        self._last = (text, now)
        identity = 0
        if len(pieces) > 1:
            # Pieces of one text share an id; 0 is for texts of one piece.
            self._identity = self._identity % 65535 + 1
            identity = self._identity
        for number, piece in enumerate(pieces):
            self.waiting.append(dialect.MAVLink_statustext_message(severity, piece, identity, number))

    def due(self, now: float) -> list[Message]:
        """Return the piece whose turn it is at `now` [s], or none."""
        if not self.waiting or now < self._next:
            return []
        self._next = now + SPACING_S
        return [self.waiting.popleft()]
