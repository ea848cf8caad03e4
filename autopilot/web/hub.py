"""Between the boat's line and the browsers: one task keeps the line, one tells every browser ten times a second.

What is told is put into words once for all browsers; one that does not keep up is let go, and comes back by itself.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable
from typing import Any

from autopilot.web.access import makes_room
from autopilot.web.line import BoatLine
from autopilot.web.orders import Answer, Told
from autopilot.web.station import Station

UPDATES_HZ = 10.0
TURN_S = 0.05
BEHIND_MOST = 50
"""Events that may wait for one browser: five seconds."""
CLIENTS_MOST = 32
"""Places. Where they are full who has the token gets one, and keeps it, before who only looks."""
ANSWER_S = 8.0
REASON_S = 1.2
"""Why something was refused comes as a text of its own, after the refusal, in pieces."""

Asked = Callable[[float, Told], None]
"""What carries an order out at a time [s], and is told how it ended."""


class Hub:
    """Start `run` in the event loop; `follow` gives one browser its events, `ask` carries an order out."""

    def __init__(self, station: Station, line: BoatLine, clock: Callable[[], float] = time.monotonic) -> None:
        self.station, self.line, self.clock = station, line, clock
        self._queues: dict[asyncio.Queue[bytes | None], str] = {}
        """What waits for each browser, by the address of who only looks, "" of who has the token; the oldest first."""
        self._told: dict[str, bytes] = {}
        self._texts = 0
        self._closed = False

    async def run(self) -> None:
        """Keep the line and tell the browsers, until cancelled."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        watched = -1
        try:
            while True:
                descriptor = self.line.fileno()
                if descriptor != watched:
                    if watched >= 0:
                        loop.remove_reader(watched)
                    watched = descriptor
                    if watched >= 0:
                        loop.add_reader(watched, self._turn)
                self._turn()
                if loop.time() >= due:
                    due = max(due + 1.0 / UPDATES_HZ, loop.time())
                    self.tell()
                await asyncio.sleep(min(TURN_S, max(0.0, due - loop.time())))
        finally:
            if watched >= 0:
                loop.remove_reader(watched)
            self.line.close()

    def tell(self) -> None:
        """Tell every browser what is known now, and what has changed of what changes seldom."""
        now = self.clock()
        row = self.station.view.keep_history(now)
        if not self._queues:
            return
        events = self._changes()
        if row is not None:
            events += event("row", row)
        events += event("state", self._state(now))
        for queue in list(self._queues):
            try:
                queue.put_nowait(events)
            except asyncio.QueueFull:
                del self._queues[queue]

    def first(self) -> bytes:
        """Return all that is known, as events."""
        events = event("state", self._state(self.clock()))
        events += b"".join(event(name, content) for name, content in self._seldom().items())
        return events + b"".join(event("text", text) for text in self._texts_after(0))

    def follow(self, address: str = "") -> AsyncIterator[bytes] | None:
        """Return the events for one browser: all that is known at first, then what changes; None: there is no place.

        address: where one comes from that only looks; "": it has the token.
        """
        if self._closed:
            return None
        if len(self._queues) >= CLIENTS_MOST:
            goes = makes_room({queue: place for queue, place in self._queues.items() if place})
            if goes is None:
                return None
            self._let_go(goes)
        queue: asyncio.Queue[bytes | None] = asyncio.Queue(BEHIND_MOST)
        queue.put_nowait(self.first())
        self._queues[queue] = address
        return self._events(queue)

    async def _events(self, queue: asyncio.Queue[bytes | None]) -> AsyncIterator[bytes]:
        try:
            while queue in self._queues or not queue.empty():
                data = await queue.get()
                if data is None:
                    return
                yield data
        finally:
            self._queues.pop(queue, None)

    async def ask(self, asked: Asked) -> tuple[bool, str]:
        """Give an order; return whether it was taken, and in words why not."""
        done: asyncio.Future[tuple[Answer, str]] = asyncio.get_running_loop().create_future()
        said = self.station.view.texts.said

        def told(answer: Answer, words: str) -> None:
            if not done.done():
                done.set_result((answer, words))

        asked(self.clock(), told)
        self._turn()
        try:
            answer, words = await asyncio.wait_for(done, ANSWER_S)
        except TimeoutError:
            return False, "the boat does not answer"
        return bool(answer), words if answer is not Answer.REFUSED else await self._reason(said, words)

    def close(self) -> None:
        """Let every browser go, and take no more."""
        self._closed = True
        for queue in list(self._queues):
            self._let_go(queue)

    def _let_go(self, queue: asyncio.Queue[bytes | None]) -> None:
        del self._queues[queue]
        while not queue.empty():
            queue.get_nowait()
        queue.put_nowait(None)

    async def _reason(self, said: int, words: str) -> str:
        """Return the boat's own words for a refusal where they come soon, `words` where not."""
        texts = self.station.view.texts
        until = self.clock() + REASON_S
        while self.clock() < until:
            new = [text.words for text in texts.kept if text.number > said]
            if new:
                return new[-1]
            await asyncio.sleep(TURN_S)
        return words

    def _turn(self) -> None:
        self.line.turn(self.clock())

    def _state(self, now: float) -> dict[str, Any]:
        return {**self.station.view.snapshot(now), "line": self.line.trouble}

    def _seldom(self) -> dict[str, Any]:
        """What changes seldom, by the name of its event."""
        station = self.station
        trial = station.view.trial
        return {
            "alarms": station.alarms.shown,
            "learning": station.view.learning(),
            "dodge": station.course.before,
            "trial": None if trial is None else trial._asdict(),
        }

    def _changes(self) -> bytes:
        events = b""
        for name, content in self._seldom().items():
            data = event(name, content)
            if self._told.get(name) != data:
                self._told[name] = data
                events += data
        new = self._texts_after(self._texts)
        self._texts = self.station.view.texts.said
        return events + b"".join(event("text", text) for text in new)

    def _texts_after(self, number: int) -> list[dict[str, Any]]:
        return [text._asdict() for text in self.station.view.texts.kept if text.number > number]


def event(name: str, content: Any) -> bytes:
    """Return one server-sent event with JSON in it."""
    data = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return f"event: {name}\ndata: {data}\n\n".encode()
