"""A helm display's side of the link, shared by the page and the terminal: what comes, what goes, who is asked. Pure.

The line to the boat: opened, read, written, and opened again by itself for as long as it takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.firmware.metadata import FtpClient
from autopilot.firmware.protocol import Target
from autopilot.firmware.session import GROUND_STATION_COMPONENT, GROUND_STATION_SYSTEM
from autopilot.links.base import LinkError, Transport
from autopilot.links.mavlink.codec import MavlinkCodec, Message
from autopilot.links.mavlink.requests import station_heartbeat
from autopilot.links.mavlink.signing import Signing
from autopilot.links.url import accept_signed, open_transport, parse_url
from autopilot.web.alarm_board import AlarmBoard
from autopilot.web.journal import Journal
from autopilot.web.orders import Answer, Asked, Course, OnDone, Orders, Reasons
from autopilot.web.parameter_service import ParameterService
from autopilot.web.track import RouteBoard
from autopilot.web.view import BoatView

HEARTBEAT_S = 1.0
RATES_S = 5.0
"""The rates are asked for again after this while they do not come: the boat may have started again."""
WANTED_HZ = {
    int(dialect.MAVLINK_MSG_ID_ATTITUDE): 10.0,
    int(dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT): 5.0,
    int(dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT): 2.0,
}
SYSTEM, COMPONENT = GROUND_STATION_SYSTEM, int(GROUND_STATION_COMPONENT)

__all__ = ["COMPONENT", "SYSTEM", "Station"]


class Station:
    """Give `receive` every message and send what `due` returns.

    Attributes:
        view: what is known of the boat.  orders: the orders to it; `ask` gives one.  journal: who gave which.
        parameters, files, alarms, route, course: its services.
    """

    def __init__(self) -> None:
        self.view = BoatView()
        self.orders = Orders()
        self.files = FtpClient()
        self.parameters = ParameterService(self.files)
        self.alarms = AlarmBoard(self.files)
        self.route = RouteBoard(self.files)
        self.journal = Journal()
        self.course = Course(self.orders, self.view)
        self._reasons = Reasons(self.view.texts)
        self._next_heartbeat = -math.inf
        self._next_rates = -math.inf
        self._boot_ms = 0
        self._count = 0

    @property
    def target(self) -> Target | None:
        """Whom orders go to: a running Norrbin, or nobody."""
        vehicle = self.view.vehicle
        return vehicle.target if vehicle is not None and self.view.is_ours else None

    def ask(self, now: float, asked: Asked, on_done: OnDone, by: tuple[str, str] | None = None) -> None:
        """Give an order at `now` [s]; `on_done` hears how it ended, of a refusal with the boat's reason.

        by: who gives it, and what it is in words, for the journal.
        """
        number = self.journal.begin(now, *by) if by is not None else None

        def ended(answer: Answer, words: str) -> None:
            if number is not None:
                self.journal.end(number, bool(answer), words)
            on_done(answer, words)

        asked(now, self._reasons.explained(ended))

    def receive(self, now: float, message: Message) -> None:
        """Take a message that came at `now` [s]."""
        view = self.view
        view.take(now, message)
        target = self.target
        if target is None or (message.get_srcSystem(), message.get_srcComponent()) != target[:2]:
            return
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            self.orders.receive(now, message)
        elif kind == "FILE_TRANSFER_PROTOCOL":
            self.files.receive(now, message)
        elif kind in ("PARAM_VALUE", "PARAM_ERROR"):
            self.parameters.receive(now, message, target)
        elif kind == "ATTITUDE":
            self._watch_start(now, message.time_boot_ms)
            self._count += 1

    def due(self, now: float) -> list[Message]:
        """Return what to send at `now` [s]."""
        messages: list[Message] = []
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + HEARTBEAT_S
            messages.append(station_heartbeat())
        self.view.texts.update(now)
        self._reasons.update(now)
        target = self.target
        if target is None:
            return messages
        self.alarms.update(now, self.view)
        self.route.update(now, self.view)
        self.journal.update(now, self.view)
        self.course.update()
        if now >= self._next_rates:
            messages += self._rates(now, target)
        messages += self.orders.due(now, target)
        messages += self.parameters.due(now, target)
        messages += self.files.due(now, target)
        return messages

    def _rates(self, now: float, target: Target) -> list[Message]:
        """Ask for the rates we want, unless headings already come about as often."""
        is_slow = self._count < 0.7 * RATES_S * WANTED_HZ[int(dialect.MAVLINK_MSG_ID_ATTITUDE)]
        self._next_rates, self._count = now + RATES_S, 0
        if not is_slow:
            return []
        return [
            dialect.MAVLink_command_long_message(
                *target[:2], dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, identity, 1.0e6 / rate, 0, 0, 0, 0, 0
            )
            for identity, rate in WANTED_HZ.items()
        ]

    def _watch_start(self, now: float, boot_ms: int) -> None:
        """A boat whose clock goes backwards has started again: its parameters may be others, our rates are gone."""
        if boot_ms < self._boot_ms:
            self.parameters.forget()
            self.alarms.forget()
            self._next_rates = now
        self._boot_ms = boot_ms


REOPEN_S = 1.0
SILENCE_S = 3.0
"""After this a listening line lets another peer in: a boat that starts again speaks from another port."""
MESSAGES_PER_TURN = 2000


class BoatLine:
    """Moves bytes between one link and a `Station`. Call `turn` often, `close` at the end.

    Raises InputError for what is no MAVLink link, and LinkError where it cannot be opened at first.

    Attributes:
        trouble: why the line is down, "" while it is up.
    """

    def __init__(
        self,
        url: str,
        station: Station,
        signing: Signing | None = None,
        opens: Callable[[str], Transport] = open_transport,
    ) -> None:
        link = parse_url(url)
        if link.protocol != "mavlink":
            raise InputError(
                f"link {url!r}: a running pilot is watched over MAVLink; write it like udpin:127.0.0.1:14550"
            )
        self._url, self._station, self._signing, self._opens = url, station, signing, opens
        self.trouble = ""
        self._transport: Transport | None = None
        self._codec = MavlinkCodec()
        self._next_open = -math.inf
        self._received_time = -math.inf
        self._open()

    @property
    def name(self) -> str:
        """The URL as the user wrote it."""
        return self._url

    def fileno(self) -> int:
        """Return the descriptor to wait on, or -1."""
        return self._transport.fileno() if self._transport is not None else -1

    def turn(self, now: float) -> int:
        """Take what has come by `now` [s], send what is due; return how many messages came."""
        if self._transport is None and now >= self._next_open:
            self._next_open = now + REOPEN_S
            try:
                self._open()
            except LinkError as error:
                self.trouble = str(error)
        if self._transport is None:
            return 0
        try:
            count = self._receive(now, self._transport)
            for message in self._station.due(now):
                # a full line drops it: every question is asked again until it is answered
                self._transport.send(self._codec.encode(message))
        except LinkError as error:
            self.trouble = str(error)
            self.close()
            self._next_open = now + REOPEN_S
            return 0
        if now - self._received_time > SILENCE_S:
            self._received_time = now
            self._transport.forget_peer()
        return count

    def close(self) -> None:
        """Close the line."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def _open(self) -> None:
        self._transport = self._opens(self._url)
        ours = self._signing.link() if self._signing is not None else None
        accept_signed(self._transport, ours)
        self._codec = MavlinkCodec(SYSTEM, COMPONENT, self._transport.is_stream, ours)
        self._station.view.forget()
        self.trouble = ""

    def _receive(self, now: float, transport: Transport) -> int:
        count = 0
        for chunk in transport.receive():
            for message in self._codec.decode(chunk):
                self._received_time = now
                count += 1
                if count <= MESSAGES_PER_TURN:
                    self._station.receive(now, message)
        return count
