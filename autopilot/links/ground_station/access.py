"""The access policy: which ground stations are heard, and how much of them: allowed system ids, and rates. Pure.

Behind the signature, which says who holds the key: a station that does, or a boat without a key, is held to this. What
gives the rudder back is never held to a rate. Over a link that others than this machine's programs can reach, a serial
line among them, no order is taken without a key, unless the skipper has said so; but to stand by, within `Stops`.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from itertools import pairwise
from typing import NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.base import REPEATED_S, CarriedLink, LinkError, Transport
from autopilot.links.mavlink.codec import MavlinkCodec, Message
from autopilot.signals import AlarmEvent, AlarmSample, ConditionSample, Sample

STATION_SILENT_S = 5.0
"""A ground station beats once a second. One that has been silent for so long holds its place no more."""
BURST_S = 4.0
"""What was not used for so long may be used at once: a ground station asks for much when it connects."""
BYTES_S = 50_000.0
BYTES_AT_ONCE = 8_000.0
"""Of one ground station, in all: a hundred times what one sends, and a twentieth of a core to look at."""
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
COMMANDS = frozenset(
    {
        *("COMMAND_LONG", "COMMAND_INT", "COMMAND_CANCEL", "SET_MODE"),
        *("MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_SET_CURRENT", "MISSION_WRITE_PARTIAL_LIST"),
    }
)
SENDERS_KEPT, ORDERS_KEPT = 32, 32
Orders: TypeAlias = deque[tuple[float, bool, tuple[int, int], int, str]]
REFUSED_AT_ONCE = 20
PACKETS_KEPT = 5000
STOP_LASTS_S = 2.0
"""What follows an order to stand by within this belongs to it: a station sets mode MANUAL, then disarms."""
KEPT_FIRST_S, KEPT_MOST_S = 60.0, 3600.0
"""So long who has engaged anew is not stopped again without a key: at first, twice as long each time, at most."""
STOP_FORGOTTEN_S = 2.0 * KEPT_MOST_S
"""Behind so long without another stop the next one is the first again."""
LOOKING_ONLY = (
    "whoever is there can look and give no orders: no signing key is set. Give --signing-key FILE, or "
    "--orders-without-key to obey everybody who reaches it"
)
NOT_THE_PEER = "datagrams from others than the station that is heard"
NO_KEY = "orders without a key over a link that others can reach"
ACKNOWLEDGE = int(dialect.MAV_CMD_SPATIAL_USER_5)
"""SPATIAL_USER_5: acknowledge the alarm of a number, `AlarmKind.number`, or with 0 all that sound.

MAVLink has no command for it, and the USER ones are taken."""
MANUAL = 0
"""Our custom mode in which the rudder is free, as ArduRover numbers it."""
NOT_ALLOWED, TOO_MANY_COMMANDS, TOO_MANY_WRITES = "from system ids not allowed", "commands too many", "writes too many"


class Budget:
    """Bytes or messages that may pass: `rate` a second, saved up to `most`."""

    def __init__(self, rate: float, most: float) -> None:
        self._rate = rate
        self._most = self._left = most
        self._since = math.inf

    def spend(self, now: float, size: float) -> bool:
        """Return whether `size` may pass at `now` [s], and take it off."""
        self._gain(now)
        if size > self._left:
            return False
        self._left -= size
        return True

    def part(self, now: float, size: int) -> int:
        """Return how much of `size` may pass at `now` [s], and take it off."""
        self._gain(now)
        part = min(size, int(self._left))
        self._left -= part
        return part

    def _gain(self, now: float) -> None:
        if now > self._since:
            self._left = min(self._left + (now - self._since) * self._rate, self._most)
        self._since = now


class Stops:
    """Orders to stand by over links that take no others: the first is obeyed, whoever sends it; who has engaged since
    is not stopped again so soon.

    For all links together: addresses and system ids can be forged.
    """

    def __init__(self) -> None:
        self._is_steering = False
        self._stopped = self._kept_until = -math.inf
        self._keeps = 0.0
        self._is_stopped = False

    def ticked(self, now: float, is_steering: bool) -> None:
        """Note whether an order to steer is in force at `now` [s]."""
        if is_steering and not self._is_steering and self._is_stopped:
            self._is_stopped, self._kept_until = False, now + self._keeps
        self._is_steering = is_steering

    def obeys(self, now: float) -> bool:
        """Return whether an order to stand by ends the steering at `now` [s], and note that it does."""
        if not self._is_steering or self.keeps(now):
            return False
        if not self._is_stopped:
            is_again = now - self._stopped < STOP_FORGOTTEN_S
            self._keeps = min(2.0 * self._keeps, KEPT_MOST_S) if is_again else KEPT_FIRST_S
            self._stopped, self._is_stopped = now, True
        return True

    def keeps(self, now: float) -> bool:
        """Return whether the skipper steers, and is not stopped because of having engaged anew."""
        return self._is_steering and now < self._kept_until

    def has_just_obeyed(self, now: float) -> bool:
        """Return whether what is ordered now belongs to an order to stand by that has been obeyed."""
        return self._is_stopped and now - self._stopped < STOP_LASTS_S


class AccessRules(NamedTuple):
    """What is let in. systems: MAVLink system ids of ground stations, all where empty.

    commands_hz, writes_hz: commands and parameter writes a second over one link, four seconds' worth at once.
    orders_without_key: whether orders are taken, and passed on, from other machines and serial lines without a key.
    """

    systems: frozenset[int] = frozenset()
    commands_hz: float = 10.0
    writes_hz: float = 25.0
    orders_without_key: bool = False


class AccessPolicy:
    """The one access policy of all links to ground stations of this process.

    Attributes:
        refused: counts what was not let in, by reason.  stops: which orders to stand by are obeyed without a key.
        orders: the last that were carried out, over whichever link, as (time [s], whether its sender's numbers go on,
            sender, number on the line, words).
    """

    def __init__(self, rules: AccessRules = AccessRules()) -> None:  # noqa: B008 - a tuple that nobody can change
        self.rules = rules
        self.refused: Counter[str] = Counter()
        self.stops = Stops()
        self.orders: Orders = deque(maxlen=ORDERS_KEPT)

    def link(self) -> LinkAccess:
        """Return what is let in over one more link."""
        return LinkAccess(self)

    @property
    def summary(self) -> str:
        """Say in half a sentence what was not let in; '' where nothing was."""
        counts = (f"{count} {reason}" for reason, count in self.refused.most_common())
        return f"{self.refused.total()} MAVLink messages were not let in: " + ", ".join(counts) if self.refused else ""


class LinkAccess:
    """What is let in over one link.

    Attributes:
        crowded: more came than is looked at since it was last set to False.  stops, orders: those of all links.
    """

    def __init__(self, policy: AccessPolicy) -> None:
        self.crowded = False
        self.stops, self.orders = policy.stops, policy.orders
        self._policy = policy
        self._vehicles: dict[tuple[int, int], None] = {}
        rules = policy.rules
        self._bytes = Budget(BYTES_S, BYTES_AT_ONCE)
        self._commands = Budget(rules.commands_hz, max(1.0, BURST_S * rules.commands_hz))
        self._writes = Budget(rules.writes_hz, max(1.0, BURST_S * rules.writes_hz))

    def taken(self, now: float, chunks: list[bytes]) -> list[bytes]:
        """Return as much of what has arrived by `now` [s] as is looked at; the rest of a flood is dropped unseen."""
        taken: list[bytes] = []
        for chunk in chunks:
            part = self._bytes.part(now, len(chunk))
            if part < len(chunk):
                self.crowded = True
                self._policy.refused["in chunks beyond what one link may bring"] += 1
            if part:
                taken.append(chunk[:part])
        return taken

    def count_refused_senders(self, datagrams: int) -> None:
        """Count datagrams of others than the peer; many at a time crowd the link."""
        if datagrams:
            self._policy.refused[NOT_THE_PEER] += datagrams
            self.crowded = self.crowded or datagrams > REFUSED_AT_ONCE

    def heard(self, message: Message) -> None:
        """Take note of who beats as a vehicle; `message` may be anything that came."""
        if message.get_type() != "HEARTBEAT":
            return
        sender = _name(message)
        self._vehicles.pop(sender, None)
        if not is_from_station(message):
            self._vehicles[sender] = None
            while len(self._vehicles) > SENDERS_KEPT:
                del self._vehicles[next(iter(self._vehicles))]

    def accepts(self, message: Message) -> bool:
        """Return whether a ground station that is heard may have sent `message`; notes and counts nothing.

        Who was `heard` beating as a vehicle is none, whatever else it says: of two pilots that listen, one forged
        datagram would make each hold the other's line for good.
        """
        systems, sender = self._policy.rules.systems, _name(message)
        is_vehicle = self.is_vehicle(sender) and message.get_type() != "HEARTBEAT"
        return is_from_station(message) and not is_vehicle and (not systems or sender[0] in systems)

    def is_vehicle(self, sender: tuple[int, int]) -> bool:
        """Return whether a sender (system, component) has beaten as a vehicle last."""
        return sender in self._vehicles

    def lets_in_system(self, system: int) -> bool:
        """Return whether a sender's system id is heard; counts it where it is not."""
        systems = self._policy.rules.systems
        if not systems or system in systems:
            return True
        self._policy.refused[NOT_ALLOWED] += 1
        return False

    def takes_orders(self, transport: Transport, has_key: bool) -> bool:
        """Return whether what comes over `transport` may be an order, and not only a question."""
        return has_key or transport.is_local or self._policy.rules.orders_without_key

    def passes_on(self, frame: bytes) -> bool:
        """Return whether a frame for a flight controller is passed on over a link that takes no orders; counts it."""
        messages = MavlinkCodec().decode(frame)
        if messages and all(map(only_looks, messages)):
            return True
        self._policy.refused[NO_KEY] += 1
        return False

    def refusal(self, now: float, message: Message) -> str:
        """Return '' where `message`, of a system that is heard, is let in at `now` [s]; else the sentence why not."""
        kind = message.get_type()
        rules = self._policy.rules
        if kind == "PARAM_SET" and not self._writes.spend(now, 1.0):
            self._policy.refused[TOO_MANY_WRITES] += 1
            return f"dropped: parameter writes beyond {rules.writes_hz:g} a second"
        if kind in COMMANDS and not gives_rudder_back(message) and not self._commands.spend(now, 1.0):
            self._policy.refused[TOO_MANY_COMMANDS] += 1
            return f"dropped: commands beyond {rules.commands_hz:g} a second"
        return ""


class Presence:
    """Whether the ground station of one link is there. A silent one is let go of: another may take its place."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._received: float | None = None
        self._let_go = -math.inf
        self._beats = self._is_silent = False

    def on_packet(self, now: float, is_heartbeat: bool) -> None:
        """Note that a station that is heard has spoken at `now` [s]; only who beats is missed when it is silent."""
        self._received = now
        self._beats = self._beats or is_heartbeat

    def update(self, now: float) -> list[Sample]:
        """Let go of a station that is silent at `now` [s]; return word of its silence, and of the end of it."""
        since = self._let_go if self._received is None else max(self._received, self._let_go)
        if now - since > STATION_SILENT_S:
            self._let_go = now
            self._transport.forget_peer()
        return self._silence_event(
            now, self._received is not None and self._beats and now - self._received > STATION_SILENT_S
        )

    def gone(self, now: float) -> list[Sample]:
        """Return the end of a silence: the line itself is gone, which is reported apart."""
        return self._silence_event(now, False)

    def _silence_event(self, now: float, is_silent: bool) -> list[Sample]:
        if is_silent == self._is_silent:
            return []
        self._is_silent = is_silent
        name = self._transport.name
        return [ConditionSample(now, "station_silent", is_silent, name if is_silent else "", name)]


class StationLink(CarriedLink):
    """What the links to a ground station share: it may fall silent, be gone, or say more than is heeded.

    Attributes:
        takes_orders: whether what comes over the link may be an order.
        lost: why the line is gone, None while it is there; steering goes on without it.
        dropped: what the transport could not take, and what is beyond what a turn heeds.
    """

    def __init__(self, transport: Transport, has_key: bool, access: LinkAccess | None) -> None:
        super().__init__(transport)
        self.dropped = 0
        self.lost: AlarmEvent | None = None
        self._access = access or AccessPolicy().link()
        self.takes_orders = self._access.takes_orders(transport, has_key)
        self._presence = Presence(transport)
        self._packets: deque[tuple[float, bytes]] = deque(maxlen=PACKETS_KEPT)

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return -1 if self.lost or self._access.crowded else self._transport.fileno()

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return and forget the raw packets kept since the last call."""
        packets = list(self._packets)
        self._packets.clear()
        return packets

    def _hears(self, message: Message) -> bool:
        """Take note of who says what; return whether it may be a ground station's, who may become the peer."""
        self._access.heard(message)
        return self._access.accepts(message)

    def _arrived(self, now: float, alarm: str) -> tuple[list[bytes], list[Sample]]:
        """Return what has arrived; where the line turns out to be gone nothing, and word of it under `alarm`."""
        try:
            return self._transport.receive() if not self.lost else [], []
        except LinkError as error:
            self.lost = AlarmEvent(alarm, str(error))
            return [], [AlarmSample(now, self.lost, self.name), *self._presence.gone(now)]

    def _sent(self, packet: bytes) -> bool:
        """A ground station that is gone is no reason to stop steering: `receive` tells of it."""
        try:
            return not self.lost and self._transport.send(packet)
        except LinkError:
            return False


def is_from_station(message: Message) -> bool:
    """Return whether a ground station may have sent `message`: a system id, and no vehicle's heartbeat.

    A companion that fills in an autopilot, which it should not, is none: pilots are component 1.
    """
    if message.get_srcSystem() == 0:
        return False
    is_pilot = message.get_srcComponent() == dialect.MAV_COMP_ID_AUTOPILOT1
    is_vehicle = is_pilot and message.get_type() == "HEARTBEAT" and message.autopilot != dialect.MAV_AUTOPILOT_INVALID
    return not is_vehicle or message.type == dialect.MAV_TYPE_GCS


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
        itself = _name(message), message.get_seq(), words
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
            self._orders.append((now, sender.counts, _name(message), message.get_seq(), _words(message)))

    def _sender(self, message: Message) -> _Sender:
        name = _name(message)
        sender = self._senders.pop(name, None) or _Sender(message.get_seq())
        while len(self._senders) >= SENDERS_KEPT:
            del self._senders[next(iter(self._senders))]
        self._senders[name] = sender  # the last to speak is the last to be forgotten
        return sender


def _name(message: Message) -> tuple[int, int]:
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


def refused_senders_of(transport: Transport) -> int:
    """Return how many datagrams or connections of others than the peer a transport has dropped so far."""
    found: int = getattr(transport, "refused_senders", 0)
    return found


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
