"""Orders of ground stations: which messages are any, what they let the pilot do, and whether they are new. Pure."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise
from typing import NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.base import REPEATED_S
from autopilot.links.mavlink.codec import Message

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
