"""Between a running pilot and Signal K: deltas one way, orders the other. Without a thread and without waiting."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from autopilot.signalk.clients import LineClients
from autopilot.signalk.deltas import Deltas, delta_of, notifications_of, values_of
from autopilot.signalk.requests import BadRequestError, answer, line_of, parse
from autopilot.web.line import BoatLine
from autopilot.web.orders import Answer
from autopilot.web.requests import asked_of
from autopilot.web.station import Station

PERIOD_S = 0.2
REASON_S = 1.2
"""Why the boat refuses an order comes as a text of its own, after the refusal."""
REFUSED, SILENT = 409, 504
"""Status of an order that the boat refuses as things stand, and of one that it does not answer."""
MAGNETIC = "the boat steers magnetic courses (sensors.magnetic), and headingTrue is none: use adjustHeading"


class _Refused(NamedTuple):
    client: int
    id: str
    status: int
    words: str
    said: int
    until: float


class Bridge:
    """Call `turn` often. `token`: what an order must carry; "": no orders are taken. `say` takes news for people."""

    def __init__(
        self, station: Station, line: BoatLine, clients: LineClients, token: str, say: Callable[[str], None]
    ) -> None:
        self._station, self._line, self._clients, self._token, self._say = station, line, clients, token, say
        self._deltas = Deltas()
        self._next = -math.inf
        self._refused: list[_Refused] = []
        self._trouble = ""

    @property
    def descriptors(self) -> list[int]:
        """What to wait on."""
        return [fd for fd in (self._line.fileno(), *self._clients.descriptors) if fd >= 0]

    def turn(self, now: float) -> None:
        """Do what falls due at `now` [s]."""
        self._line.turn(now)
        new, heard = self._clients.turn()
        for client in new:
            self._clients.say(
                line_of(delta_of(values_of(self._station, now) | notifications_of(self._station))), client
            )
        for client, line in heard:
            self._take(now, client, line)
        if heard:
            self._line.turn(now)
        self._answer_refusals(now)
        if now >= self._next:
            self._next = now + PERIOD_S
            delta = self._deltas.due(self._station, now)
            if delta is not None:
                self._clients.say(line_of(delta))
        self._tell()

    def close(self) -> None:
        """Hang up on everybody."""
        self._clients.close()
        self._line.close()

    def _take(self, now: float, client: int, line: bytes) -> None:
        try:
            request = parse(line, self._token)
        except BadRequestError as error:
            self._clients.say(answer(error.id, error.status, str(error)), client)
            return
        self._clients.trust(client)
        if request.wish is None:
            self._clients.say(answer(request.id, 200), client)
            return
        if self._station.target is None:
            self._clients.say(answer(request.id, 503, "no pilot is heard"), client)
            return
        if request.wish["do"] == "heading" and self._station.view.value("magnetic"):
            self._clients.say(answer(request.id, REFUSED, MAGNETIC), client)
            return
        said = self._station.view.texts.said

        def told(answered: Answer, words: str) -> None:
            if answered:
                self._clients.say(answer(request.id, 200, words), client)
            else:
                until = now + REASON_S if answered is Answer.REFUSED else -math.inf
                status = SILENT if answered is Answer.SILENT else REFUSED
                self._refused.append(_Refused(client, request.id, status, words, said, until))

        asked_of(self._station, request.wish)(now, told)

    def _answer_refusals(self, now: float) -> None:
        for refused in list(self._refused):
            reasons = [text.words for text in self._station.view.texts.kept if text.number > refused.said]
            if reasons or now >= refused.until:
                self._refused.remove(refused)
                self._clients.say(answer(refused.id, refused.status, (reasons or [refused.words])[-1]), refused.client)

    def _tell(self) -> None:
        for news in self._clients.news:
            self._say(news)
        self._clients.news.clear()
        if self._line.trouble != self._trouble:
            self._trouble = self._line.trouble
            self._say(self._trouble or f"{self._line.name}: the line to the pilot is open again")
