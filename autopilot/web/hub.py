"""Between the boat's line and the browsers: one task keeps the line, one tells every browser ten times a second.

What is sent is put into words once for all browsers; one that does not keep up is let go, and comes back by itself.

Who may give orders over the page: who has the token. Everybody else only looks.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import secrets
import stat
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from autopilot.errors import InputError
from autopilot.files.outside import is_same_token, read_regular
from autopilot.files.saving import replace_file
from autopilot.runtime.machine import running_time
from autopilot.web.journal import Track
from autopilot.web.orders import Answer, Asked
from autopilot.web.station import BoatLine, Station

TOKEN_BYTES = 18
SHORTEST = 16
TOKEN_FILE_MOST = 1024
TICKET_S = 120.0

Client = TypeVar("Client")


class Access:
    """Compares tokens in constant time, and gives out tickets for one download each of which a link can carry."""

    def __init__(self, token: str) -> None:
        if len(token) < SHORTEST:
            raise ValueError(f"a token has at least {SHORTEST} characters")
        self.token = token

    def allows(self, authorization: str) -> bool:
        """Return whether a request's Authorization header carries the token."""
        scheme, _, given = authorization.partition(" ")
        return scheme.lower() == "bearer" and is_same_token(given.strip(), self.token)

    def ticket(self, name: str, now: float) -> str:
        """Return a ticket for the file `name`, good for two minutes from `now` [s]."""
        until = f"{now + TICKET_S:.0f}"
        return f"{until}.{self._sign(name, until)}"

    def admits(self, ticket: str, name: str, now: float) -> bool:
        """Return whether a ticket is for this file and still good at `now` [s]."""
        until, _, signature = ticket.partition(".")
        if not (until.isascii() and until.isdecimal() and len(until) < 16) or now > float(until):
            return False
        return is_same_token(signature, self._sign(name, until))

    def _sign(self, name: str, until: str) -> str:
        return hmac.new(self.token.encode(), f"{until}\n{name}".encode(), hashlib.sha256).hexdigest()


def makes_room(unauthenticated: Mapping[Client, str]) -> Client | None:
    """Return which client goes where the places are full and another comes; None: the newcomer has to.

    unauthenticated: the address of each client that has not shown the token, the oldest first. The oldest of the
    address from which most come goes; who has shown the token keeps its place.
    """
    crowd = Counter(unauthenticated.values())
    return max(unauthenticated, key=lambda client: crowd[unauthenticated[client]], default=None)


def token_of(path: Path | None) -> str:
    """Return the token kept in a file, made at first use and for its owner alone; without a file a new one.

    Raises InputError where the file cannot be used.
    """
    if path is None:
        return secrets.token_urlsafe(TOKEN_BYTES)
    try:
        if not path.exists():
            token = secrets.token_urlsafe(TOKEN_BYTES)
            replace_file(path, token + "\n", private=True)
            return token
        if stat.S_ISREG(mode := path.stat().st_mode) and mode & 0o077:
            raise InputError(f"--token-file {path}: others can read it; run chmod 600 {path}")
        token = read_regular(path, TOKEN_FILE_MOST).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text in ASCII"
        raise InputError(f"--token-file {path}: {reason}; give a file that only you can read and write") from error
    if len(token) < SHORTEST or any(not (character.isalnum() or character in "-_") for character in token):
        raise InputError(
            f"--token-file {path}: a token is one word of at least {SHORTEST} letters, digits, - and _; "
            "delete the file and a new one is made"
        )
    return token


UPDATES_HZ = 10.0
TURN_S = 0.05
BEHIND_MOST = 50
"""Events that may wait for one browser: five seconds."""
CLIENTS_MOST = 32
"""Places. Where they are full who has the token gets one, and keeps it, before who only looks."""
ANSWER_S = 8.0


class Hub:
    """Start `run` in the event loop; `follow` gives one browser its events, `ask` carries an order out."""

    def __init__(self, station: Station, line: BoatLine, clock: Callable[[], float] = running_time) -> None:
        self.station, self.line, self.clock = station, line, clock
        self._queues: dict[asyncio.Queue[bytes | None], str] = {}
        """What waits for each browser, by the address of who only looks, "" of who has the token; the oldest first."""
        self.track = Track()
        self._sent: dict[str, bytes] = {}
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
                    self.publish()
                await asyncio.sleep(min(TURN_S, max(0.0, due - loop.time())))
        finally:
            if watched >= 0:
                loop.remove_reader(watched)
            self.line.close()

    def publish(self) -> None:
        """Tell every browser what is known now, and what has changed of what changes seldom."""
        now = self.clock()
        row = self.station.view.keep_history(now)
        point = self.track.update(now, self.station.view)
        if not self._queues:
            return
        events = self._changes()
        if row is not None:
            events += event("row", row)
        if point is not None:
            events += event("point", point)
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

    async def ask(self, asked: Asked, by: tuple[str, str] | None = None) -> tuple[bool, str]:
        """Give an order; return whether it was taken, and in words why not. by: who gives it, and what it is."""
        done: asyncio.Future[tuple[Answer, str]] = asyncio.get_running_loop().create_future()

        def on_done(answer: Answer, words: str) -> None:
            if not done.done():
                done.set_result((answer, words))

        self.station.ask(self.clock(), asked, on_done, by)
        self._turn()
        try:
            answer, words = await asyncio.wait_for(done, ANSWER_S)
        except TimeoutError:
            return False, "the boat does not answer"
        return bool(answer), words

    def close(self) -> None:
        """Let every browser go with a word, and take no more."""
        self._closed = True
        for queue in list(self._queues):
            self._let_go(queue, event("end", True))

    def _let_go(self, queue: asyncio.Queue[bytes | None], word: bytes = b"") -> None:
        del self._queues[queue]
        while not queue.empty():
            queue.get_nowait()
        if word:
            queue.put_nowait(word)
        queue.put_nowait(None)

    def _turn(self) -> None:
        self.line.turn(self.clock())

    def _state(self, now: float) -> dict[str, Any]:
        return {**self.station.view.snapshot(now), "line": self.line.trouble}

    def _seldom(self) -> dict[str, Any]:
        station = self.station
        trial = station.view.trial
        return {
            "alarms": station.alarms.active,
            "sound": station.alarms.sound,
            "history": [record._asdict() for record in station.alarms.history],
            "orders": [given._asdict() for given in station.journal.entries],
            "route": station.route.entries,
            "compasses": [each._asdict() for each in station.compasses.entries],
            "learning": station.view.learning(),
            "dodge": station.course.before,
            "trial": None if trial is None else trial._asdict(),
        }

    def _changes(self) -> bytes:
        events = b""
        for name, content in self._seldom().items():
            data = event(name, content)
            if self._sent.get(name) != data:
                self._sent[name] = data
                events += data
        new = self._texts_after(self._texts)
        self._texts = self.station.view.texts.count
        return events + b"".join(event("text", text) for text in new)

    def _texts_after(self, number: int) -> list[dict[str, Any]]:
        return [text._asdict() for text in self.station.view.texts.kept if text.number > number]


def event(name: str, content: Any) -> bytes:
    """Return one server-sent event with JSON in it."""
    data = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return f"event: {name}\ndata: {data}\n\n".encode()
