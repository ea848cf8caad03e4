"""STATUSTEXT put together from its pieces of 50 characters, the newest kept. Pure."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from autopilot.links.mavlink_codec import Message
from autopilot.links.status_text import PIECE

KEPT = 50
PIECES_MOST = 20
PATIENCE_S = 3.0
"""A text whose next piece does not come within this time is shown as far as it came."""


class Text(NamedTuple):
    """What was said: number of the text in this session, when [s], MAV_SEVERITY, words."""

    number: int
    time: float
    severity: int
    words: str


class TextPieces:
    """Takes STATUSTEXT messages; `kept` are the whole texts, oldest first."""

    def __init__(self) -> None:
        self.kept: deque[Text] = deque(maxlen=KEPT)
        self.said = 0
        self._parts: dict[int, dict[int, str]] = {}
        self._heads: dict[int, tuple[float, int]] = {}

    def take(self, now: float, message: Message) -> None:
        """Take one piece. A piece shorter than 50 characters, or a text without id, ends a text."""
        words = message.text if isinstance(message.text, str) else message.text.decode("utf-8", "replace")
        words = words.rstrip("\0")
        if message.id == 0:
            self._keep(now, int(message.severity), words)
            return
        self.look(now)
        parts = self._parts.setdefault(message.id, {})
        self._heads[message.id] = (now, int(message.severity))
        parts[min(int(message.chunk_seq), PIECES_MOST)] = words
        last = max(parts)
        if len(parts[last]) < PIECE and len(parts) == last + 1:
            self._finish(now, message.id)

    def look(self, now: float) -> None:
        """Keep what has waited too long for its next piece."""
        for identity, (since, _) in list(self._heads.items()):
            if now - since > PATIENCE_S:
                self._finish(now, identity)

    def _finish(self, now: float, identity: int) -> None:
        parts, (_, severity) = self._parts.pop(identity), self._heads.pop(identity)
        self._keep(now, severity, "".join(parts[number] for number in sorted(parts)))

    def _keep(self, now: float, severity: int, words: str) -> None:
        if words:
            self.said += 1
            self.kept.append(Text(self.said, now, severity, words))
