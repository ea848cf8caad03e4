"""Requests that may be lost: a window of them under way, each repeated until it is answered or given up.

No clock and no I/O: time is an argument, what is to be sent is a return value.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Generic, NamedTuple, TypeVar

Key = TypeVar("Key", int, str)

RESIDUAL = 1.0e-6
"""A key counts as unknown to the vehicle when so small a probability is left that its answers all got lost."""
TRIES_MIN = 3
CONTROLS = 3
"""So many questions that surely have an answer go with those that are repeated, to tell a bad link from a name
that the vehicle does not have."""
HURRY_S = 0.1
"""The least wait before a question is repeated, on a link that has shown that it answers faster."""
TIMED_MIN = 4
"""So many round trips must be timed before a link is taken for a fast one."""


class Patience(NamedTuple):
    """How long to wait for an answer, how often to ask at most, and how many questions at once.

    20 tries lose one of a million answers where 30 % of the packets get lost each way (0.51^20). ArduPilot
    queues 20 parameter requests and drops the rest, so the window stays well below.
    """

    interval_s: float = 0.4
    tries: int = 20
    window: int = 8


PATIENCE = Patience()


class LinkQuality:
    """How often a question stays unanswered on this link, as learnt from those that were answered.

    A name that the vehicle does not have stays unanswered as a lost one does: on a link that answers all the
    others at once it is given up after a few tries, on a bad one after many. Only tries count during which the
    vehicle was heard at all, so that a link that is down for a while tells nothing about names.
    """

    def __init__(self) -> None:
        self._asked = 0
        self._answered = 0
        self.round_trip_s = 0.0
        self._timed = 0
        self.last_heard = -math.inf

    def heard(self, now: float) -> None:
        """Note that the vehicle has just sent something, whatever it was."""
        self.last_heard = now

    def controls(self) -> int:
        """Return how many questions with a sure answer to send along with repeated ones, and count them."""
        self._asked += CONTROLS
        return CONTROLS

    def control_answered(self) -> None:
        """Count the answer to one of them."""
        self._answered += self._answered < self._asked

    def answered(self, tries: int, delay_s: float) -> None:
        """Count a question that took `tries`; the delay of an answer to a first try times the round trip."""
        self._asked += tries
        self._answered += 1
        if tries == 1:
            self._timed += 1
            self.round_trip_s = delay_s if self.round_trip_s == 0.0 else 0.8 * self.round_trip_s + 0.2 * delay_s

    def wait_s(self, tries: int, patience_s: float) -> float:
        """Return how long to wait for an answer: on a fast link a few round trips, twice as long at each try."""
        longest = max(patience_s, 2.0 * self.round_trip_s)
        if self._timed < TIMED_MIN:
            return longest
        return float(min(longest, max(HURRY_S, 4.0 * self.round_trip_s) * 2 ** (tries - 1)))

    @property
    def tries_needed(self) -> int:
        """After how many tries silence means no: (share of tries unanswered)^tries < `RESIDUAL`."""
        unanswered = (self._asked - self._answered + 1) / (self._asked + 2)  # Laplace's rule of succession
        return max(TRIES_MIN, math.ceil(math.log(RESIDUAL) / math.log(unanswered)))


class _Question(NamedTuple):
    """How often a key was asked, how often of these in vain though the vehicle was heard, and when last."""

    tries: int
    in_vain: int
    last: float


class Requests(Generic[Key]):
    """Open questions, by key. `given_up` holds the keys that were asked in vain often enough."""

    def __init__(self, keys: Iterable[Key], patience: Patience, quality: LinkQuality | None = None) -> None:
        self._patience = patience
        self._quality = quality or LinkQuality()
        self._waiting: deque[Key] = deque(keys)
        self._asked: dict[Key, _Question] = {}
        self._doubted: set[Key] = set()
        self.given_up: list[Key] = []

    @property
    def done(self) -> bool:
        """Whether every key is answered or given up."""
        return not self._waiting and not self._asked

    def answered(self, key: Key, now: float) -> None:
        """Close the question; answers to others are ignored."""
        asked = self._asked.pop(key, None)
        self._doubted.discard(key)
        if asked is None:
            if key in self._waiting:
                self._waiting.remove(key)
            return
        self._quality.answered(asked.tries, now - asked.last)

    def doubt(self, key: Key) -> None:
        """Ask again soon, as an answer came that may not be the last word."""
        self._doubted.add(key)

    def repeats(self, keys: Iterable[Key]) -> bool:
        """Return whether any of the `keys` just asked got no answer before."""
        return any(self.tries(key) > 1 and key not in self._doubted for key in keys)

    def refused(self, key: Key) -> None:
        """Close the question as the vehicle says that it knows no such key; others are ignored."""
        if self._asked.pop(key, None) is not None:
            self.given_up.append(key)

    def tries(self, key: Key) -> int:
        """Return how often the key has been asked so far."""
        return self._asked[key].tries if key in self._asked else 0

    def due(self, now: float) -> list[Key]:
        """Return the keys to ask now: those whose answer is overdue, then new ones up to the window."""
        due: list[Key] = []
        for key, (tries, in_vain, last) in list(self._asked.items()):
            wait_s = self._quality.wait_s(1 if key in self._doubted else tries, self._patience.interval_s)
            if now - last < wait_s:
                continue
            in_vain += self._quality.last_heard > last
            if tries >= self._patience.tries or in_vain >= self._quality.tries_needed:
                del self._asked[key]
                self.given_up.append(key)
            else:
                self._asked[key] = _Question(tries + 1, in_vain, now)
                due.append(key)
        while self._waiting and len(self._asked) < self._patience.window:
            key = self._waiting.popleft()
            self._asked[key] = _Question(1, 0, now)
            due.append(key)
        return due
