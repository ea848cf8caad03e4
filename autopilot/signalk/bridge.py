"""Between a running pilot and Signal K: deltas one way, orders the other. Without a thread and without waiting.

TCP clients that get every line we say and send lines of their own: several at once, none of them waited for.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Callable
from typing import NamedTuple

from autopilot.links.base import UNSEEN_S
from autopilot.links.ground_station.access import Budget
from autopilot.links.transports.medium import open_error, resolve
from autopilot.signalk.messages import (
    BEAT_S,
    HEADINGS,
    BadRequestError,
    Deltas,
    answer,
    beat_of,
    delta_of,
    line_of,
    notifications_of,
    parse,
    values_of,
)
from autopilot.web.hub import makes_room
from autopilot.web.journal import words_of
from autopilot.web.orders import Answer
from autopilot.web.requests import CAME_LATE, STOPS, GivenStops, asked_of
from autopilot.web.station import BoatLine, Station

CLIENTS_MOST = 8
"""Places. A newcomer gets the place of one who has not shown the token; where all have, it is hung up on."""
BEHIND_MOST = 65536
"""Bytes that may wait for one client; who does not keep up is hung up on, and comes back by itself."""
CHUNK = 4096
LINES_MOST = 20
"""Lines of one client in one turn."""
NEWS_S, NEWS_AT_ONCE = 1.0, 40.0
"""Lines for people a second, and how many may be saved up."""


class ReceivedLine(NamedTuple):
    """A line and who said it."""

    client: int
    line: bytes


class LineClients:
    """Listens at an address. Raises LinkError where it cannot.

    line_most: longer lines end the connection.

    Attributes:
        port: where it listens.  news: what happened since it was last emptied, for people.
    """

    def __init__(self, host: str, port: int, line_most: int) -> None:
        name = f"{host}:{port}"
        family, address = resolve(name, host, port, socket.SOCK_STREAM, passive=True)
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.setblocking(False)
        try:
            self._listener.bind(address)
            self._listener.listen(CLIENTS_MOST)
        except OSError as error:
            self._listener.close()
            raise open_error(name, error, "listen at", host, port) from error
        self.port = int(self._listener.getsockname()[1])
        self.news: list[str] = []
        self._line_most = line_most
        self._clients: dict[int, socket.socket] = {}
        self._received: dict[int, bytes] = {}
        self._unsent: dict[int, bytes] = {}
        self._addresses: dict[int, str] = {}
        self._trusted: set[int] = set()
        self._count = 0

    @property
    def descriptors(self) -> list[int]:
        """What to wait on."""
        return [self._listener.fileno(), *(client.fileno() for client in self._clients.values())]

    def turn(self) -> tuple[list[int], list[ReceivedLine]]:
        """Take who and what has come: new clients, and whole lines."""
        new = self._accept()
        received = [ReceivedLine(number, line) for number in list(self._clients) for line in self._lines_of(number)]
        return new, received

    def send(self, line: bytes, client: int | None = None) -> None:
        """Send a line to one client, or to all; what does not fit now goes with the next."""
        for number in list(self._clients) if client is None else [client]:
            if number in self._clients:
                self._push(number, line)

    def trust(self, client: int) -> None:
        """Keep the place of a client that has shown the token, however long it says nothing."""
        if client in self._clients:
            self._trusted.add(client)

    def close(self) -> None:
        """Hang up on all and stop listening."""
        for number in list(self._clients):
            self._drop(number, "")
        self._listener.close()

    def _accept(self) -> list[int]:
        new: list[int] = []
        # no more in a turn: who connects without end must not keep orders waiting
        for _ in range(CLIENTS_MOST):
            try:
                client, sender = self._listener.accept()
            except OSError:
                return new
            if len(self._clients) >= CLIENTS_MOST and not self._make_room():
                client.close()
                continue
            client.setblocking(False)
            self._count += 1
            self._clients[self._count] = client
            self._received[self._count] = self._unsent[self._count] = b""
            self._addresses[self._count] = str(sender[0])
            self.news.append(f"Signal K: {sender[0]} has connected")
            new.append(self._count)
        return new

    def _make_room(self) -> bool:
        """Hang up on one without the token; False where all have shown it."""
        goes = makes_room({number: self._addresses[number] for number in self._clients if number not in self._trusted})
        if goes is None:
            return False
        self._drop(goes, "made room for another")
        return True

    def _lines_of(self, number: int) -> list[bytes]:
        try:
            data = self._clients[number].recv(CHUNK)
        except BlockingIOError:
            data = None
        except OSError:
            data = b""
        if data == b"":
            self._drop(number, "has gone; waiting for it to come back")
            return []
        *lines, rest = (self._received[number] + (data or b"")).split(b"\n")
        if len(rest) > self._line_most or len(lines) > LINES_MOST:
            self._drop(number, "sent too much, and was hung up on")
            return []
        self._received[number] = rest
        return [line for line in lines if line.strip()]

    def _push(self, number: int, line: bytes) -> None:
        waiting = self._unsent[number] + line
        try:
            sent = self._clients[number].send(waiting)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._drop(number, "has gone; waiting for it to come back")
            return
        self._unsent[number] = waiting[sent:]
        if len(self._unsent[number]) > BEHIND_MOST:
            self._drop(number, "does not keep up, and was hung up on")

    def _drop(self, number: int, why: str) -> None:
        self._clients.pop(number).close()
        del self._received[number], self._unsent[number], self._addresses[number]
        self._trusted.discard(number)
        if why:
            self.news.append(f"Signal K: a client {why}")


PERIOD_S = 0.2
REFUSED, SILENT = 409, 504
"""Status of an order that the boat refuses as things stand, and of one that it does not answer."""
OTHER_NORTH = (
    "the boat steers true courses: give headingTrue",
    "the boat steers magnetic courses (sensors.magnetic): give headingMagnetic",
)


class Bridge:
    """Call `turn` often. `token`: what an order must carry; "": no orders are taken. `print_line` takes news for
    people."""

    def __init__(
        self, station: Station, line: BoatLine, clients: LineClients, token: str, print_line: Callable[[str], None]
    ) -> None:
        self._station, self._line, self._clients, self._token, self._print = station, line, clients, token, print_line
        self._deltas = Deltas()
        self._stops, self._stood_by = GivenStops(station.view), -math.inf
        self._now = self._next = self._next_beat = -math.inf
        self._trouble = ""
        self._words = Budget(NEWS_S, NEWS_AT_ONCE)

    @property
    def descriptors(self) -> list[int]:
        """What to wait on."""
        return [fd for fd in (self._line.fileno(), *self._clients.descriptors) if fd >= 0]

    def turn(self, now: float) -> None:
        """Do what falls due at `now` [s]."""
        self._line.turn(now)
        new, received = self._clients.turn()
        self._now = now
        if self._stood_by != self._station.view.stood_by:
            self._stood_by = self._station.view.stood_by
            self._next_beat = -math.inf  # who has this beat has the state before it
            self._tell(now)
        if now >= self._next_beat or new:
            self._next_beat = now + BEAT_S
            self._clients.send(beat_of(now))
        for client in new:
            self._clients.send(
                line_of(delta_of(values_of(self._station, now) | notifications_of(self._station))), client
            )
        for client, line in received:
            self._take(now, client, line)
        if received:
            self._line.turn(now)
        if now >= self._next:
            self._tell(now)
        self._publish()

    def _tell(self, now: float) -> None:
        self._next = now + PERIOD_S
        delta = self._deltas.due(self._station, now)
        if delta is not None:
            self._clients.send(line_of(delta))

    def close(self) -> None:
        """Hang up on everybody."""
        self._clients.close()
        self._line.close()

    def _take(self, now: float, client: int, line: bytes) -> None:
        try:
            request = parse(line, self._token)
        except BadRequestError as error:
            self._clients.send(answer(error.id, error.status, str(error)), client)
            return
        self._clients.trust(client)
        if request.order is None:
            self._clients.send(answer(request.id, 200), client)
            return
        since = self._stops.seen_since(now)
        # the beat is the plugin's: what a dashboard behind it has shown is later still
        late = request.why_late(now, since if now >= since + UNSEEN_S else math.inf)
        if late:
            self._clients.send(answer(request.id, SILENT if late == CAME_LATE else REFUSED, late), client)
            return
        if self._station.target is None:
            self._clients.send(answer(request.id, 503, "no pilot is heard"), client)
            return
        is_magnetic = bool(self._station.view.value("magnetic"))
        if request.path in HEADINGS and request.path != HEADINGS[is_magnetic]:
            self._clients.send(answer(request.id, REFUSED, OTHER_NORTH[is_magnetic]), client)
            return

        is_stop = request.order["do"] in STOPS
        if is_stop:
            self._stops.begin(now)

        def on_done(answered: Answer, words: str) -> None:
            if is_stop:
                self._stops.end(self._now)
            status = 200 if answered else SILENT if answered is Answer.SILENT else REFUSED
            self._clients.send(answer(request.id, status, words), client)

        by = ("Signal K", words_of(request.order))
        self._station.ask(now, asked_of(self._station, request.order), on_done, by)

    def _publish(self) -> None:
        for news in self._clients.news:
            if self._words.spend(self._now, 1.0):
                self._print(news)
        self._clients.news.clear()
        if self._line.trouble != self._trouble:
            self._trouble = self._line.trouble
            self._print(self._trouble or f"{self._line.name}: the line to the pilot is open again")
