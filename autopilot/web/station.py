"""A helm display's side of the link, shared by the page and the terminal: what comes, what goes, who is asked.

`ParameterService`: the boat's parameters, read when asked for, and set. `Station`: all of a display's services; both
are pure. `BoatLine`: the line to the boat, opened, read, written, and opened again by itself for as long as it takes.
"""

from __future__ import annotations

import contextlib
import math
import secrets
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.files.outside import SHOWN, parse_json
from autopilot.files.printable import printable
from autopilot.firmware.download import Download
from autopilot.firmware.metadata import expanded
from autopilot.firmware.protocol import Target, parameter_value, refused_value, set_value
from autopilot.firmware.session import GROUND_STATION_SYSTEM, FtpClient
from autopilot.links.base import LinkError, Transport
from autopilot.links.ground_station.file_server import COMPASSES, PARAMETERS, ROUTE
from autopilot.links.mavlink.codec import MavlinkCodec, Message
from autopilot.links.mavlink.requests import station_heartbeat
from autopilot.links.mavlink.signing import Signing
from autopilot.links.mavlink.vehicle_clock import Belongs, VehicleClock
from autopilot.links.url import accept_signed, open_transport, parse_url
from autopilot.web.journal import AlarmBoard, Journal, ListBoard, compasses_from, route_from
from autopilot.web.orders import LATE_S, NO_ANSWER, Answer, Asked, Course, OnDone, Orders, Reasons
from autopilot.web.view import BoatView

AGAIN_S, TRIES = 0.5, 4
EXPANDED_MOST = 1_000_000
"""Bytes of the descriptions; ours have 16 kB."""
UNPACKING_MOST = 64 << 20
"""Bytes of memory that unpacking may take; ours takes 9 MB. What is packed may ask for gigabytes."""


class _Setting(NamedTuple):
    name: str
    value: float
    on_done: OnDone


UNANSWERED, KEPT = (Answer.SILENT, NO_ANSWER), (Answer.REFUSED, "refused; the old value stays")
OTHER_VALUE = (Answer.FAILED, "the boat has another value, and does not say why: look what counts")
SAME = 1.0e-6
"""A value that was set is in force where it is so near, relative: it travels in 32 bits."""


class ParameterService:
    """`read` begins to fetch; `table` is what is there so far.

    A value is set where the boat says so, and refused where it says that. Another value that comes meanwhile may have
    been on its way before ours was, and what a value set before comes to may come behind it.
    """

    def __init__(self, files: FtpClient) -> None:
        self._files = files
        self._download: Download | None = None
        self._wanted = False
        self._described: dict[str, dict[str, Any]] = {}
        self._settings: deque[_Setting] = deque()
        self._tries, self._next = 0, -math.inf
        self._sent: deque[tuple[float, _Setting]] = deque()
        """When what was sent that is not answered yet; of one that was repeated each time is."""
        self._seen = UNANSWERED

    def read(self) -> None:
        """Fetch table and description, unless they are here or on their way."""
        if self._download is not None and self._download.finished and not self._download.values:
            self._download = None
        if self._download is None and not self._wanted:
            self._wanted = True
        if not self._described:
            self._files.fetch(PARAMETERS, self._describe)

    def forget(self) -> None:
        """Forget the table: the boat may have started again with another file."""
        self._download, self._described, self._wanted = None, {}, False

    def table(self) -> dict[str, Any]:
        """Return the rows that have come, whether that is all, and how far it is."""
        download = self._download
        if download is None:
            return {"complete": False, "done": 0, "total": 0, "rows": []}
        done, total = download.progress
        rows = [
            {"name": name, "value": _plain(float(each.value)), **self._described.get(name, {})}
            for name, each in download.values.items()
        ]
        return {"complete": download.finished and done == total > 0, "done": done, "total": total, "rows": rows}

    def set(self, name: str, value: float, on_done: OnDone) -> None:
        """Set a parameter; `on_done` hears whether the boat took it."""
        self._settings.append(_Setting(name, value, on_done))

    def give_up(self) -> None:
        """End what waits to be set: there is no boat to set it."""
        for _ in range(len(self._settings)):
            self._end(*UNANSWERED)

    def receive(self, now: float, message: Message, target: Target) -> None:
        """Take a message of the boat."""
        if self._download is not None:
            if not self._download.finished:
                self._download.receive(now, message)
            elif (value := parameter_value(message, target)) is not None:
                self._download.update(value)  # finished it takes nothing more; a value by name is kept all the same
        answer, refused = parameter_value(message, target), refused_value(message, target)
        name = refused[0] if refused is not None else answer.name if answer is not None else ""
        said = [each for each in self._sent if each[1].name == name]
        if answer is not None:
            said = [each for each in said if math.isclose(answer.value, each[1].value, rel_tol=SAME)]
        if said:
            self._sent.remove(said[0])
        if not self._settings or self._tries == 0 or name != self._settings[0].name:
            return
        setting = self._settings[0]
        is_taken = answer is not None and math.isclose(answer.value, setting.value, rel_tol=SAME)
        self._seen = (Answer.TAKEN, "") if is_taken else KEPT if refused is not None else OTHER_VALUE
        if said and said[0][1] is setting:
            self._end(*self._seen)

    def due(self, now: float, target: Target) -> list[Message]:
        """Return what to send at `now` [s]."""
        if self._wanted:
            self._download, self._wanted = Download(target), False
        messages = list(self._download.due(now)) if self._download is not None else []
        while self._sent and now - self._sent[0][0] > LATE_S:
            self._sent.popleft()
        if not self._settings or now < self._next:
            return messages
        setting = self._settings[0]
        if self._tries >= TRIES:
            self._end(*self._seen)
            return messages
        self._tries, self._next, self._seen = self._tries + 1, now + AGAIN_S, UNANSWERED
        self._sent.append((now, setting))
        messages.append(set_value(target, setting.name, setting.value, dialect.MAV_PARAM_TYPE_REAL32))
        return messages

    def _end(self, answer: Answer, words: str) -> None:
        setting = self._settings.popleft()
        self._tries, self._next = 0, -math.inf
        setting.on_done(answer, words)

    def _describe(self, content: bytes | None) -> None:
        self._described = {}
        with contextlib.suppress(InputError):  # a boat without descriptions: the table shows names and values alone
            self._described = descriptions_from(content or b"")


def descriptions_from(content: bytes) -> dict[str, dict[str, Any]]:
    """Return what a boat's packed component metadata says of each parameter, by name. Raises InputError."""
    origin = "the boat's description of parameters"
    text = expanded(content, origin, EXPANDED_MOST, UNPACKING_MOST)
    found = parse_json(text, origin, EXPANDED_MOST)
    entries = found.get("parameters") if isinstance(found, dict) else None
    if not isinstance(entries, list):
        raise InputError(f"{origin}: a list `parameters` is needed")
    return dict(_description_from(entry, f"{origin}: entry {number}") for number, entry in enumerate(entries, 1))


def _description_from(entry: Any, origin: str) -> tuple[str, dict[str, Any]]:
    if not (isinstance(entry, dict) and isinstance(entry.get("name"), str)):
        raise InputError(f"{origin}: an object with a name is needed")
    for key, is_fit in DESCRIBED.items():
        if key in entry and not is_fit(entry[key]):
            raise InputError(f"{origin}: {key} {printable(repr(entry[key]), SHOWN)} is not of its kind")
    return entry["name"], {key: entry[key] for key in DESCRIBED if key in entry}


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are_choices(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(each, dict) and _is_number(each.get("value")) and _is_text(each.get("description")) for each in value
    )


DESCRIBED: dict[str, Callable[[Any], bool]] = {
    **dict.fromkeys(("shortDesc", "group", "units"), _is_text),
    **dict.fromkeys(("min", "max"), _is_number),
    "values": _are_choices,
    "rebootRequired": lambda value: isinstance(value, bool),
}
"""What is shown of a parameter, and whether a value of it is of the right kind."""


def _plain(value: float) -> float | None:
    """The fewest digits that give the 32-bit float that travelled."""
    return float(f"{value:.7g}") if math.isfinite(value) else None


HEARTBEAT_S = 1.0
RATES_S = 5.0
"""The rates are asked for again after this while they do not come: the boat may have started again."""
WANTED_HZ = {
    int(dialect.MAVLINK_MSG_ID_ATTITUDE): 10.0,
    int(dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT): 5.0,
    int(dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT): 2.0,
}


def own_component() -> int:
    """Return a component id for this process: of two displays under one, or of a display and a ground station, each
    takes what is answered to the other, and the boat takes both for one sender."""
    return secrets.choice(range(dialect.MAV_COMP_ID_USER1, dialect.MAV_COMP_ID_USER75 + 1))


SYSTEM, COMPONENT = GROUND_STATION_SYSTEM, own_component()


class Station:
    """Give `receive` every message and send what `due` returns.

    Attributes:
        view: what is known of the boat.  orders: the orders to it; `ask` gives one.  journal: who gave which.
        parameters, files, alarms, route, compasses, course: its services.
    """

    def __init__(self) -> None:
        self.view = BoatView()
        self.orders = Orders()
        self.files = FtpClient()
        self.parameters = ParameterService(self.files)
        self.alarms = AlarmBoard(self.files)
        self.route = ListBoard(self.files, ROUTE, ("waypoints",), route_from)
        self.compasses = ListBoard(self.files, COMPASSES, ("compasses",), compasses_from)
        self._boards = (self.alarms, self.route, self.compasses)
        self.journal = Journal()
        self.course = Course(self.orders, self.view)
        self._reasons = Reasons(self.view.texts)
        self._next_heartbeat = -math.inf
        self._next_rates = -math.inf
        self._clock = VehicleClock()
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
        to = getattr(message, "target_system", 0), getattr(message, "target_component", 0)
        if to[0] not in (0, SYSTEM) or to[1] not in (0, COMPONENT):
            return  # an answer to another station
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            self.orders.receive(now, message)
        elif kind == "FILE_TRANSFER_PROTOCOL":
            self.files.receive(now, message)
        elif kind in ("PARAM_VALUE", "PARAM_ERROR"):
            self.parameters.receive(now, message, target)
        elif kind == "ATTITUDE":
            self._watch_start(now, message.time_boot_ms * 1.0e-3)
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
            self.give_up()
            return messages
        for board in self._boards:
            board.update(now, self.view)
        self.journal.update(now, self.view)
        self.course.update(now)
        if now >= self._next_rates:
            messages += self._rates(now, target)
        messages += self.orders.due(now, target)
        messages += self.parameters.due(now, target)
        messages += self.files.due(now, target)
        return messages

    def give_up(self) -> None:
        """End every order: nobody hears it, and a course that was meant a while ago may lead anywhere now."""
        self.orders.give_up()
        self.course.give_up()
        self.parameters.give_up()

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

    def _watch_start(self, now: float, boot: float) -> None:
        """Of a boat that has started again parameters and lists may be others, and our rates are gone."""
        belongs = self._clock.judge(now, boot)
        if belongs is Belongs.REBOOTED:
            self._clock.reset()
            self.parameters.forget()
            for board in self._boards:
                board.forget()
            self._next_rates = now
        if belongs is not Belongs.STRANGE:
            self._clock.local(now, boot)


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
            self._station.give_up()
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
