"""The access policy: which ground stations are heard, and how much of them: allowed system ids, and rates. Pure.

Behind the signature, which says who holds the key: a station that does, or a boat without a key, is held to this. What
gives the rudder back is never held to a rate. Over a link that others than this machine's programs can reach, a serial
line among them, no order is taken without a key, unless the skipper has said so; but to stand by, within `Stops`.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.base import CarriedLink, LinkError, Transport
from autopilot.links.ground_station.orders import (
    ORDERS_KEPT,
    SENDERS_KEPT,
    Orders,
    gives_rudder_back,
    only_looks,
    sender_of,
)
from autopilot.links.mavlink.codec import MavlinkCodec, Message
from autopilot.signals import AlarmEvent, AlarmSample, ConditionSample, Sample

STATION_SILENT_S = 5.0
"""A ground station beats once a second. One that has been silent for so long holds its place no more."""
BURST_S = 4.0
"""What was not used for so long may be used at once: a ground station asks for much when it connects."""
BYTES_S = 50_000.0
BYTES_AT_ONCE = 8_000.0
"""Of one ground station, in all: a hundred times what one sends, and a twentieth of a core to look at."""
COMMANDS = frozenset(
    {
        *("COMMAND_LONG", "COMMAND_INT", "COMMAND_CANCEL", "SET_MODE"),
        *("MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_SET_CURRENT", "MISSION_WRITE_PARTIAL_LIST"),
    }
)
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
        sender = sender_of(message)
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
        systems, sender = self._policy.rules.systems, sender_of(message)
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


def refused_senders_of(transport: Transport) -> int:
    """Return how many datagrams or connections of others than the peer a transport has dropped so far."""
    found: int = getattr(transport, "refused_senders", 0)
    return found
