"""Which messages the vehicle shall send and how often: asked for with SET_MESSAGE_INTERVAL until they come. Pure."""

from __future__ import annotations

CHECK_S = 2.0
ENOUGH = 0.6
"""A stream below this share of its rate is asked for again: requests get lost, and ground stations change rates."""


class MessageStreams:
    """Counts what arrives and names what must be asked for.

    Args:
        rates_hz: wanted rate by message id.
    """

    def __init__(self, rates_hz: dict[int, float]) -> None:
        self._rates = dict(rates_hz)
        self.reset()

    def reset(self) -> None:
        """Ask for everything anew, as after a reboot."""
        self._counts = dict.fromkeys(self._rates, 0)
        self._since: float | None = None

    def count(self, message_id: int) -> None:
        """Note that a message of a wanted id has come."""
        self._counts[message_id] += 1

    def due(self, now: float) -> list[tuple[int, int]]:
        """Return (message id, interval [us]) of the streams to ask for at `now` [s]."""
        if self._since is not None and now - self._since < CHECK_S:
            return []
        first = self._since is None
        needed = CHECK_S * ENOUGH
        wanted = [
            (identity, round(1.0e6 / rate))
            for identity, rate in self._rates.items()
            if first or self._counts[identity] < rate * needed
        ]
        self._since = now
        self._counts = dict.fromkeys(self._rates, 0)
        return wanted
