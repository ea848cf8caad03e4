"""Requests that may be lost: a window of them under way, each repeated until it is answered or given up.

No clock and no I/O: time is an argument, what is to be sent is a return value.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Generic, NamedTuple, TypeVar

Key = TypeVar("Key", int, str)


class Patience(NamedTuple):
    """How long to wait for an answer, how often to ask, and how many questions at once.

    20 tries lose one of a million answers where 30 % of the packets get lost each way (0.51^20). ArduPilot
    queues 20 parameter requests and drops the rest, so the window stays well below.
    """

    interval_s: float = 0.4
    tries: int = 20
    window: int = 8


PATIENCE = Patience()


class Requests(Generic[Key]):
    """Open questions, by key. `given_up` holds the keys that were asked `patience.tries` times in vain."""

    def __init__(self, keys: Iterable[Key], patience: Patience) -> None:
        self._patience = patience
        self._waiting: deque[Key] = deque(keys)
        self._asked: dict[Key, tuple[int, float]] = {}
        self._round_trip_s = 0.0
        self.given_up: list[Key] = []

    @property
    def done(self) -> bool:
        """Whether every key is answered or given up."""
        return not self._waiting and not self._asked

    def answered(self, key: Key, now: float) -> None:
        """Close the question; answers to others are ignored. First answers to first tries time the round trip."""
        asked = self._asked.pop(key, None)
        if asked is None:
            if key in self._waiting:
                self._waiting.remove(key)
            return
        tries, last = asked
        if tries == 1:
            sample = now - last
            self._round_trip_s = sample if self._round_trip_s == 0.0 else 0.8 * self._round_trip_s + 0.2 * sample

    def tries(self, key: Key) -> int:
        """Return how often the key has been asked so far."""
        return self._asked.get(key, (0, 0.0))[0]

    def due(self, now: float) -> list[Key]:
        """Return the keys to ask now: those whose answer is overdue, then new ones up to the window."""
        due: list[Key] = []
        interval = max(self._patience.interval_s, 2.0 * self._round_trip_s)
        for key, (tries, last) in list(self._asked.items()):
            if now - last < interval:
                continue
            if tries >= self._patience.tries:
                del self._asked[key]
                self.given_up.append(key)
            else:
                self._asked[key] = (tries + 1, now)
                due.append(key)
        while self._waiting and len(self._asked) < self._patience.window:
            key = self._waiting.popleft()
            self._asked[key] = (1, now)
            due.append(key)
        return due
