"""Orders of ground stations: which messages are any, what they let the pilot do, and whether they are new. Pure.

The boat's modes: their numbers and names, which of them steers now, and the messages that list them. Numbered as the
ArduRover modes nearest to them (MANUAL, GUIDED, AUTO, STEERING, ACRO), because ground stations name the modes of every
surface boat by that list. Who asks for AVAILABLE_MODES gets names of our own.

Commands that take a while: IN_PROGRESS with the percentage while they last, the result at their end.
Source: https://mavlink.io/en/services/command.html, long running commands.

What ground stations may have changed of the law and the model: a response level, what was learnt, and back.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import NamedTuple, Protocol, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.links.base import REPEATED_S
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.frames import AvailableModes, CurrentMode
from autopilot.signals import Mode, OrderKind, Tick

QUESTIONS = frozenset(
    {
        int(dialect.MAV_CMD_REQUEST_MESSAGE),
        int(dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES),
        int(dialect.MAV_CMD_SET_MESSAGE_INTERVAL),
    }
)
"""Commands that order nothing: they ask for messages."""
LOOKS = frozenset(
    {
        *("HEARTBEAT", "PING", "TIMESYNC", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "AUTOPILOT_VERSION_REQUEST"),
        *("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_REQUEST_LIST", "MISSION_ACK"),
    }
)
"""What a station that only looks says to a flight controller. The rates of its streams are ours: it shares our line."""
ORDERS = frozenset(
    {
        *("COMMAND_LONG", "COMMAND_INT", "COMMAND_CANCEL", "SET_MODE", "PARAM_SET"),
        *("MISSION_COUNT", "MISSION_ITEM", "MISSION_ITEM_INT", "MISSION_CLEAR_ALL"),
        *("MISSION_SET_CURRENT", "MISSION_WRITE_PARTIAL_LIST"),
    }
)
ACKNOWLEDGE = int(dialect.MAV_CMD_SPATIAL_USER_5)
"""SPATIAL_USER_5: acknowledge the alarm of a number, `AlarmKind.number`, or with 0 all that sound.

MAVLink has no command for it, and the USER ones are taken."""
MANUAL = 0
"""Our custom mode in which the rudder is free, as ArduRover numbers it."""
SENDERS_KEPT, ORDERS_KEPT = 32, 32
Orders: TypeAlias = deque[tuple[float, bool, tuple[int, int], int, str]]
OVERTAKEN = 32
"""So many of its sender's messages may have come before one that was sent ahead of them."""
SHARED_BEATS, SHARED_WITHIN_S, BEATS_KEPT = 4, 10.0, 32
"""So many heartbeats of each, by turns, within this time [s] are two stations'; so many are kept."""
LOST_TOO = 3
"""Numbers go on by so much for each message that comes, on a line that loses two of three; farther off it is another
station's count, which lies there by chance once in 85."""
RESTARTED_S = 2.0
"""A sender whose numbers have only come from behind for so long has begun anew: one that goes on beats each second."""
ONCE = frozenset({"COMMAND_LONG", "COMMAND_INT", "SET_MODE"})
OF_A_ROUTE = frozenset({"MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_SET_CURRENT"})
"""What a later one of them, or an item of a route, makes void."""
VOIDING = frozenset({"PARAM_SET", *OF_A_ROUTE, "MISSION_ITEM", "MISSION_ITEM_INT"})


class _Taken(NamedTuple):
    """An order that was taken: when [s], under which number, how often it had been said, and its words."""

    time: float
    number: int
    confirmation: int
    command: int
    words: str


class _Sender:
    """What is known of one sender: the numbers of the first message that was heard of it and of its newest, that go on
    where the one on the line begins again behind 255; whether its numbers go on at all; what it ordered of late, the
    newest last; and time [s], number and words of the last that made what was sent before it void, by the name that
    `_voids` gives."""

    def __init__(self, number: int) -> None:
        self.first = self.newest = number
        self.counts = False
        self.behind = math.inf
        """Since when [s] none has come that goes on from the newest, but others have."""
        self.taken: deque[_Taken] = deque(maxlen=ORDERS_KEPT)
        self.beats: deque[tuple[float, int, bool]] = deque(maxlen=BEATS_KEPT)
        """Its heartbeats of late: when [s], number, and whether that lay far behind the newest."""
        self.last: dict[str, tuple[float, int, str]] = {}
        self.stop: int | None = None
        """The number of its last order that gave the rudder back."""
        self.since_stop = 0
        """How many messages came since that."""

    def number_of(self, message: Message) -> int:
        """Return the number of a message, as it goes on: the nearest to the newest."""
        ahead: int = (message.get_seq() - self.newest) % 256
        return self.newest + (ahead if ahead < 128 else ahead - 256)


class OrderSequence:
    """Tells new orders from those that a line brings twice, or behind a later one. Pure.

    A sender that had no answer says its order again, with the next `confirmation`; a line may double a datagram, whose
    sequence number is the same then. To do it again would turn twice as far, or engage a boat that somebody has let
    stand by meanwhile. So would an order that a line held until the order to stand by, sent after it, had come, and a
    value or a change of the route that it held until the one sent after it had.

    A router that has two ways to the boat passes the same datagram on over both: `orders` are those of all links.
    """

    def __init__(self, orders: Orders) -> None:
        self._orders = orders
        self._senders: dict[tuple[int, int], _Sender] = {}

    def heard(self, now: float, message: Message) -> None:
        """Take the number of any message that came at `now` [s]."""
        sender = self._sender(message)
        number = sender.number_of(message)
        sender.counts = sender.counts or number != sender.newest
        sender.since_stop += 1
        is_far = sender.first <= number < sender.newest - OVERTAKEN
        is_beat = message.get_type() == "HEARTBEAT" and (is_far or number > sender.newest)
        if is_beat and all(number != each for _, each, _ in sender.beats):
            sender.beats.append((now, number, is_far))
        sender.behind = min(sender.behind, now) if number < sender.newest else math.inf
        if now - sender.behind > RESTARTED_S:
            # its values and routes are new ones; an order to stand by stays the last word for a while
            sender.last = {name: each for name, each in sender.last.items() if name == ""}
            sender.behind = math.inf
        sender.newest = max(sender.newest, number)

    def are_two(self, now: float, message: Message) -> bool:
        """Return whether two count their messages under the id of this one's sender: heartbeats go on from the newest,
        and others from far behind it, by turns. One that began anew did the former before, and a line that doubles
        brings the same numbers."""
        recent = [is_far for time, _, is_far in self._sender(message).beats if now - time <= SHARED_WITHIN_S]
        turns = sum(before is not after for before, after in pairwise(recent))
        return min(recent.count(True), recent.count(False), turns) >= SHARED_BEATS

    def has_seen_stop(self, now: float, message: Message) -> bool:
        """Return whether who sends this gave the rudder back last under its id, and so knows it: its numbers go on from
        there, by no more than came since and were lost meanwhile. Another station under that id counts by itself."""
        sender = self._sender(message)
        if sender.stop is None or self.are_two(now, message):
            return False
        return 0 <= sender.number_of(message) - sender.stop <= LOST_TOO * sender.since_stop

    def is_again(self, now: float, message: Message) -> bool:
        """Return whether an order has been taken already: this very one, the same said once more, or before, and late.

        To be said once more it is its sender's last of that command; who begins with a `confirmation`, and gives the
        same each time, orders anew.
        """
        if message.get_type() not in ONCE:
            return False
        sender, words, said = self._sender(message), _words(message), confirmation_of(message)
        itself = sender_of(message), message.get_seq(), words
        for time, counted, *rest in self._orders:
            if now - time <= REPEATED_S and (counted or sender.counts) and tuple(rest) == itself:
                return True
        number, of_command = sender.number_of(message), None
        for order in sender.taken:
            if now - order.time > REPEATED_S:
                continue
            if order.command == _command(message):
                of_command = order
            is_first = said < order.confirmation and number < order.number
            if sender.counts and is_first and order.words == words:
                return True
        return of_command is not None and of_command.words == words and said > of_command.confirmation

    def is_overtaken(self, now: float, message: Message) -> bool:
        """Return whether what the sender sent after this, and what makes it void, has come already: an order to stand
        by, another value of the same parameter, or the next change of the route."""
        sender = self._sender(message)
        if message.get_type() not in (*ONCE, "PARAM_SET", *OF_A_ROUTE) or _voids(message) not in sender.last:
            return False
        time, number, words = sender.last[_voids(message)]
        is_behind = now - time <= REPEATED_S and 0 < number - sender.number_of(message) <= OVERTAKEN
        return is_behind and words != _words(message)

    def stopped(self, message: Message) -> None:
        """Take that the sender of this gives the rudder back by it."""
        sender = self._sender(message)
        number = sender.number_of(message)
        # a line that doubles it brings nothing new
        sender.since_stop = sender.since_stop if number == sender.stop else 0
        sender.stop = number

    def taken(self, now: float, message: Message) -> None:
        """Take an order that is carried out."""
        sender = self._sender(message)
        number = sender.number_of(message)
        if stands_by(message):
            sender.taken.clear()  # what is ordered from now on is meant to end it, however often it is said
        if stands_by(message) or message.get_type() in VOIDING:
            sender.last = {name: each for name, each in sender.last.items() if now - each[0] <= REPEATED_S}
            name = _voids(message)
            # one that comes again, and late, is not its sender's last
            newest = max(number, sender.last[name][1]) if name in sender.last else number
            sender.last[name] = now, newest, _words(message)
        if message.get_type() in ONCE:
            sender.taken.append(_Taken(now, number, confirmation_of(message), _command(message), _words(message)))
            self._orders.append((now, sender.counts, sender_of(message), message.get_seq(), _words(message)))

    def _sender(self, message: Message) -> _Sender:
        name = sender_of(message)
        sender = self._senders.pop(name, None) or _Sender(message.get_seq())
        while len(self._senders) >= SENDERS_KEPT:
            del self._senders[next(iter(self._senders))]
        self._senders[name] = sender  # the last to speak is the last to be forgotten
        return sender


def sender_of(message: Message) -> tuple[int, int]:
    """Return the system and the component that sent a message."""
    return message.get_srcSystem(), message.get_srcComponent()


def confirmation_of(message: Message) -> int:
    """Return how often an order has been said before."""
    return int(getattr(message, "confirmation", 0))


def _command(message: Message) -> int:
    """Return the command of a message; -1 for one that is no command."""
    return int(getattr(message, "command", -1))


def _voids(message: Message) -> str:
    """Return the name of what makes a message void that was sent before it: "" for an order to stand by, or that of
    the parameter, or the route of its kind."""
    if message.get_type() == "PARAM_SET":
        return f"={message.param_id}"
    kind = getattr(message, "mission_type", dialect.MAV_MISSION_TYPE_MISSION)
    kind = dialect.MAV_MISSION_TYPE_MISSION if kind == dialect.MAV_MISSION_TYPE_ALL else kind
    return f"route {kind}" if message.get_type() in VOIDING else ""


def _words(message: Message) -> str:
    """Return all that an order says but how often it was said."""
    return repr([value for name, value in message.to_dict().items() if name != "confirmation"])


def is_order(message: Message) -> bool:
    """Return whether a message asks for anything to be done or changed aboard, and not only to be informed."""
    kind = message.get_type()
    if kind in ("COMMAND_LONG", "COMMAND_INT"):
        return message.command not in QUESTIONS
    return kind in ORDERS


def may_engage(message: Message) -> bool:
    """Return whether an order may be one to steer: every command and mode, but to acknowledge an alarm."""
    return message.get_type() in ONCE and _command(message) != ACKNOWLEDGE


def only_looks(message: Message) -> bool:
    """Return whether a message to a flight controller changes nothing there, nor on the line to it."""
    kind = message.get_type()
    if kind in ("COMMAND_LONG", "COMMAND_INT"):
        return message.command in QUESTIONS and message.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL
    return kind in LOOKS


def disarms(message: Message) -> bool:
    """Return whether a message is the order to disarm."""
    is_command = message.get_type() in ("COMMAND_LONG", "COMMAND_INT")
    return is_command and bool(message.command == dialect.MAV_CMD_COMPONENT_ARM_DISARM and message.param1 == 0.0)


def gives_rudder_back(message: Message) -> bool:
    """Return whether a message takes the pilot from the helm: disarm, mode MANUAL, the end of a trial."""
    return message.get_type() == "COMMAND_CANCEL" or stands_by(message)


def stands_by(message: Message) -> bool:
    """Return whether a message lets the pilot stand by: disarm, mode MANUAL. Behind the end of a trial it steers on."""
    kind = message.get_type()
    if kind == "SET_MODE":
        return _is_custom(message.base_mode) and bool(message.custom_mode == MANUAL)
    if kind not in ("COMMAND_LONG", "COMMAND_INT"):
        return False
    is_mode = message.command == dialect.MAV_CMD_DO_SET_MODE and message.param2 == MANUAL
    return disarms(message) or (bool(is_mode) and _is_custom(message.param1))


def _is_custom(base_mode: float) -> bool:
    return math.isfinite(base_mode) and bool(int(base_mode) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)


HEADING, TRACK, TRIAL, WIND = 15, 10, 3, 1
NON_STANDARD, MISSION = 0, 6
"""MAV_STANDARD_MODE."""
NOT_SELECTABLE = 2
"""MAV_MODE_PROPERTY: a trial is begun by its command."""


class BoatMode(NamedTuple):
    """Our number, what people read, the standard mode it is, and MAV_MODE_PROPERTY bits."""

    number: int
    name: str
    standard: int = NON_STANDARD
    properties: int = 0


MODES = (
    BoatMode(MANUAL, "Manual"),
    BoatMode(HEADING, "Heading"),
    BoatMode(TRACK, "Track", MISSION),
    BoatMode(TRIAL, "Trial", NON_STANDARD, NOT_SELECTABLE),
    BoatMode(WIND, "Wind"),
)


def mode_of(tick: Tick, follows_route: bool = False, follows_wind: bool = False) -> int:
    """Return our custom mode: who steers, and what to."""
    if tick.mode is not Mode.ENGAGED:
        return MANUAL
    if tick.order.kind is not OrderKind.HEADING:
        return TRIAL
    return TRACK if follows_route else WIND if follows_wind else HEADING


def available_modes(index: float) -> list[AvailableModes]:
    """Return AVAILABLE_MODES of the mode `index`, counted from 1, or of all of them for 0; [] for another."""
    return [
        AvailableModes(len(MODES), number, mode.standard, mode.number, mode.properties, mode.name.encode())
        for number, mode in enumerate(MODES, 1)
        if index in (0.0, float(number))
    ]


def current_mode(number: int) -> CurrentMode:
    """Return CURRENT_MODE: we take a mode or refuse it, so that none is ever only intended."""
    standard = next(mode.standard for mode in MODES if mode.number == number)
    return CurrentMode(standard, number, number)


CANCELLED = 6
"""MAV_RESULT_CANCELLED, which the dialect does not have."""
PROGRESS_S = 1.0


class Run(Protocol):
    """Something that takes a while; progress from 0 to 1."""

    is_over: bool
    is_complete: bool

    @property
    def progress(self) -> float:
        """Share that is done."""


class LongCommand:
    """A command that is being carried out."""

    def __init__(self, command: int, parameters: tuple[float, ...], run: Run) -> None:
        self.command, self.parameters, self.run = command, parameters, run
        self.is_cancelled = False

    @property
    def percent(self) -> int:
        """How much of it is done."""
        return round(100.0 * self.run.progress)

    @property
    def result(self) -> int:
        """MAV_RESULT as of now."""
        if not self.run.is_over:
            return int(dialect.MAV_RESULT_IN_PROGRESS)
        if self.is_cancelled:
            return CANCELLED
        return int(dialect.MAV_RESULT_ACCEPTED if self.run.is_complete else dialect.MAV_RESULT_FAILED)


class ProgressReports:
    """What one link tells of the command that came over it."""

    def __init__(self) -> None:
        self._reported: tuple[LongCommand, tuple[int, int]] | None = None
        self._next = math.inf

    def begin(self, now: float, command: LongCommand, sender: tuple[int, int]) -> None:
        """Report to `sender` (system, component) from now [s] on."""
        self._reported, self._next = (command, sender), now + PROGRESS_S

    def is_for(self, sender: tuple[int, int]) -> bool:
        """Return whether `sender` is reported to."""
        return self._reported is not None and sender == self._reported[1]

    def due(self, now: float) -> list[Message]:
        """Return the acknowledgement that falls due, and the last one at once."""
        if self._reported is None:
            return []
        command, sender = self._reported
        if now < self._next and not command.run.is_over:
            return []
        self._next = now + PROGRESS_S
        if command.run.is_over:
            self._reported = None
        return [acknowledgement(command.command, command.result, sender, command.percent)]


def acknowledgement(command: int, result: int, sender: tuple[int, int], percent: int = 0) -> Message:
    """Return COMMAND_ACK."""
    return dialect.MAVLink_command_ack_message(command, result, percent, 0, *sender)


LEARNING, LEVEL = int(dialect.MAV_CMD_USER_4), int(dialect.MAV_CMD_USER_5)
"""USER_4: learning; 1 adopts the proved model, 2 goes back to the one before.
USER_5: response level, 1 calm to 9 quick."""
ADOPT, REVERT = 1.0, 2.0


class Tuning(Run, Protocol):
    """A change that is being worked out, and how it ended, in words for people."""

    @property
    def said(self) -> str:
        """What people should know at its end."""


class Tuner(Protocol):
    """Who works changes out beside the loop and puts them in force between two ticks."""

    level: float
    """The response level put in force last, not a number before."""

    def set_level(self, level: int) -> Tuning:
        """Begin to put a response level (1 calm to 9 quick) in force. Raises InputError."""

    def adopt(self) -> Tuning:
        """Begin to put the proved model in force. Raises InputError."""

    def revert(self) -> Tuning:
        """Put back in force what was before the latest adoption. Raises InputError."""

    def learnt(self) -> dict[str, float]:
        """Return what was learnt by names of at most ten characters; empty where nothing is learnt."""


class TuningCommands:
    """The commands that tune, on the way to `tuner`; without one they are not known."""

    def __init__(self, tuner: Tuner | None) -> None:
        self._tuner = tuner
        self._begun: Tuning | None = None

    def begin(self, command: int, value: float) -> Tuning | None:
        """Begin what a command with its first parameter asks for; None where that is not known. Raises InputError."""
        tuner = self._tuner
        if tuner is None or (command == LEARNING and value not in (ADOPT, REVERT)):
            return None
        if command == LEARNING:
            self._begun = tuner.adopt() if value == ADOPT else tuner.revert()
        elif math.isfinite(value) and value == int(value):
            self._begun = tuner.set_level(int(value))
        else:
            raise InputError(f"response level {value:g}: allowed is a whole number from 1 (calm) to 9 (quick)")
        return self._begun

    def outcome(self) -> str:
        """Return what a change that has ended came to, once."""
        begun = self._begun
        if begun is None or not begun.is_over:
            return ""
        self._begun = None
        return begun.said
