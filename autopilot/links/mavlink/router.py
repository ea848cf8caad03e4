"""Where a MAVLink frame goes: by the addresses that were heard at each endpoint. Pure, but for the senders given to it.

Rules of https://mavlink.io/en/guide/routing.html, of ArduPilot's libraries/GCS_MAVLink/MAVLink_routing.cpp and of
mavlink-router ("Message Routing" in its README.md): what is for everybody goes to every other endpoint; what has an
address goes where that address has been heard; nothing goes back where it came from, or where its sender has been
heard; each endpoint has its filter. Frames pass unchanged.

Two departures: what is for a component that nobody has heard goes to its system, as ArduPilot does it; and a ground
station reaches the flight controller though another with its id has been heard there, as most have 255.

The router's ends: the flight controller's transport with a tap on it, and links to ground stations behind us.

`OutgoingFilter`: what of all that is passed on leaves over one link, which senders' messages and how often each: for a
ground station or a logger behind a slow radio, while the flight controller's own link runs at full rate.
"""

from __future__ import annotations

import difflib
import math
from collections import Counter, deque
from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.dialects.v20.ardupilotmega import MAVLINK_MSG_ID_HEARTBEAT

from autopilot.errors import InputError
from autopilot.links.base import LinkError, Transport
from autopilot.links.ground_station.access import Budget, LinkAccess, StationLink, refused_senders_of
from autopilot.links.mavlink.codec import MavlinkCodec, is_mavlink
from autopilot.links.mavlink.frames import (
    EVERYBODY,
    KNOWN,
    Address,
    Framer,
    identity_of,
    instance_of,
    source_of,
    target_of,
)
from autopilot.links.mavlink.requests import AUTOPILOT_COMPONENT
from autopilot.links.mavlink.signing import LinkSigning
from autopilot.links.transports.medium import LinkUrl
from autopilot.links.url import accept_signed
from autopilot.signals import Sample, Tick

OTHERS = "others"
"""Stands for every stream that is not named."""
EACH_COUNTS = frozenset(
    int(getattr(dialect, f"MAVLINK_MSG_ID_{name}"))
    for name in (
        *("HEARTBEAT", "STATUSTEXT", "PING", "TIMESYNC", "AUTOPILOT_VERSION", "COMMAND_ACK", "MAG_CAL_REPORT"),
        *("PARAM_VALUE", "PARAM_EXT_VALUE", "MISSION_ITEM_REACHED", "LOG_ENTRY", "LOG_DATA"),
    )
)
"""No stream of which the newest is enough: who misses one misses something. They are held back only by name."""
COMMANDS = (int(dialect.MAVLINK_MSG_ID_COMMAND_LONG), int(dialect.MAVLINK_MSG_ID_COMMAND_INT))
SAVED, SAVED_AT_FIRST = 2.0, 0.5
"""Messages saved up, at most and behind the first: jitter of half a period costs none, and the mean is the rate."""
MOST_STREAMS = 512
"""Streams whose rate is watched: a flood of invented ones fills no memory."""
HIGHEST = 1 << 24


class OutgoingFilter:
    """Says frame by frame what leaves over a link; every stream (sender, message, instance) has a rate of its own.

    Args:
        rates: at most so many [Hz] of a message, by its id; 0: none.
        others: the same for every stream that is not named, and whose messages do not each count.
        sources: whose messages leave, component 0: those of the whole system; empty: everybody's.
    """

    def __init__(
        self, rates: Mapping[int, float], others: float = math.inf, sources: frozenset[Address] = frozenset()
    ) -> None:
        self._rates, self._others, self._sources = dict(rates), others, sources
        self._streams: dict[tuple[Address, int, bytes], Budget] = {}

    @property
    def sets_rates(self) -> bool:
        """Whether any message has a rate here."""
        return bool(self._rates) or math.isfinite(self._others)

    def passes(self, now: float, frame: bytes) -> bool:
        """Return whether a frame leaves at `now` [s]; it is taken to leave then."""
        source = source_of(frame)
        if self._sources and self._sources.isdisjoint((source, Address(source.system, 0))):
            return False
        identity = identity_of(frame)
        rate = self._rates.get(identity)
        if rate is None:
            if math.isinf(self._others) or identity in EACH_COUNTS or target_of(frame) != EVERYBODY:
                return True
            rate = self._others
        if rate == 0.0:
            return False
        stream = (source, identity, instance_of(frame))
        budget = self._streams.get(stream)
        if budget is not None:
            return budget.spend(now, 1.0)
        if len(self._streams) >= MOST_STREAMS:
            del self._streams[next(iter(self._streams))]
        self._streams[stream] = budget = Budget(rate, SAVED)
        return budget.spend(now, SAVED - SAVED_AT_FIRST)


def asks_for_streams(frame: bytes) -> bool:
    """Return whether a frame asks a flight controller to send a message more or less often."""
    identity = identity_of(frame)
    if identity == dialect.MAVLINK_MSG_ID_REQUEST_DATA_STREAM:
        return True
    if identity not in COMMANDS:
        return False
    return any(message.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL for message in MavlinkCodec().decode(frame))


def filter_of(url: LinkUrl) -> OutgoingFilter | None:
    """Return what the URL of a link says of what leaves there; None where it says nothing. Raises InputError."""
    options = url.options
    if not options.rates and not options.sources:
        return None
    rates = {_identity_of(url.text, name): rate for name, rate in options.rates if name != OTHERS}
    sources = frozenset(Address(*source) for source in options.sources)
    return OutgoingFilter(rates, dict(options.rates).get(OTHERS, math.inf), sources)


def _identity_of(text: str, name: str) -> int:
    if name.isascii() and name.isdigit() and len(name) <= 8 and int(name) < HIGHEST:
        return int(name)
    ids = {kind.msgname: identity for identity, kind in KNOWN.items()}
    if name in ids:
        return ids[name]
    near = difflib.get_close_matches(name.upper(), ids, n=3) or ["ATTITUDE"]
    raise InputError(
        f"link {text!r}: there is no MAVLink message {name!r}; write a name such as {', '.join(near)}, a message's "
        f"number, or {OTHERS}"
    )


OURSELVES = -1
"""Stands for an endpoint where our own addresses live."""
REMEMBERED = 512
"""So many frames are remembered, to know one that comes round by another way."""
ROUND_S = 2.0
"""Within this time the same bytes at another endpoint have come round."""
AGAIN_S = 0.25
"""Within this time at the same endpoint too; later they are from a sender that does not count its packets."""
MOST_ADDRESSES = 64
"""Addresses learnt at one endpoint: a flood of invented ones fills no memory."""
STAYS = frozenset(
    {
        int(dialect.MAVLINK_MSG_ID_RADIO_STATUS),
        int(dialect.MAVLINK_MSG_ID_RADIO),
        int(dialect.MAVLINK_MSG_ID_SETUP_SIGNING),
    }
)
"""Never passed on: what a radio says of its own link, and a key that may have come over a safe one."""
OWN_COMPONENT = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER: what we send as a ground station (`--as-gcs`) is shown to no other one."""

Sender = Callable[[bytes], bool]


class Router:
    """Passes frames between the endpoints that have joined.

    Attributes:
        now: the time [s], kept by whoever turns the loop.
        counts: frames passed on, and those that were not, by reason.
    """

    def __init__(self) -> None:
        self.now = 0.0
        self.counts: Counter[str] = Counter()
        self._senders: list[Sender] = []
        self._filters: list[OutgoingFilter | None] = []
        self._left: list[int] = []
        self._vehicles: set[int] = set()
        self._received: dict[int, set[Address]] = {OURSELVES: set()}
        self._order: deque[bytes] = deque()
        self._recent: dict[bytes, tuple[int, float]] = {}

    def join(self, send: Sender, has_vehicle: bool = False, outgoing: OutgoingFilter | None = None) -> int:
        """Add an endpoint; return its number. `send` sends a frame without ever blocking, False where it cannot.

        `has_vehicle`: the flight controller is there, and nobody elsewhere may speak in its name.
        `outgoing`: what of that which is for the endpoint is sent there; None: all.
        """
        if self._left:
            number = self._left.pop()
            self._senders[number], self._filters[number] = send, outgoing
        else:
            number = len(self._senders)
            self._senders.append(send)
            self._filters.append(outgoing)
        self._received[number] = set()
        if has_vehicle:
            self._vehicles.add(number)
        return number

    def leave(self, number: int) -> None:
        """Send nothing more to an endpoint, and forget who was there: its line is closed."""
        if number not in self._left:
            self._left.append(number)
        self._senders[number] = lambda _: False
        self._received[number] = set()
        self._vehicles.discard(number)

    def take(self, endpoint: int, frame: bytes) -> None:
        """Pass on a frame that arrived at `endpoint`."""
        source = source_of(frame)
        if not self._may_come(endpoint, source):
            self.counts["pretended to be the vehicle or us"] += 1
            return
        if self._has_come_round(endpoint, frame):
            self.counts["came round in a loop"] += 1
            return
        self._remember(endpoint, frame)
        self._learn(endpoint, source)
        if identity_of(frame) in STAYS:
            self.counts["not for other links"] += 1
            return
        places = self._places_of(target_of(frame))
        # two links to flight controllers are no bridge between them
        self._pass_on(endpoint, frame, places - self._vehicles if endpoint in self._vehicles else places)

    def show_own(self, sent_to: int, frame: bytes) -> None:
        """Show what we have just sent to endpoint `sent_to` to the others too, where it is for everybody."""
        self._learn(OURSELVES, source_of(frame))
        self._remember(OURSELVES, frame)
        if target_of(frame).system == 0:
            self._pass_on(sent_to, frame, set(range(len(self._senders))) - self._vehicles)

    def _may_come(self, endpoint: int, source: Address) -> bool:
        if endpoint in self._vehicles:
            return True
        if source in self._received[OURSELVES]:
            return False
        return source.component != AUTOPILOT_COMPONENT or not any(
            source in self._received[vehicle] for vehicle in self._vehicles
        )

    def _learn(self, endpoint: int, source: Address) -> None:
        heard = self._received[endpoint]
        if source.system == 0 or source in heard or len(heard) >= MOST_ADDRESSES:
            return
        heard.add(source)
        if endpoint == OURSELVES or endpoint in self._vehicles:
            # who spoke in its name before it was heard does not cut a station off from it
            for place, others in self._received.items():
                if place != OURSELVES and place not in self._vehicles:
                    others.discard(source)

    def _is_beyond(self, place: int, source: Address) -> bool:
        """Return whether what `source` says comes from beyond `place`, so that it is not sent there."""
        heard = self._received[place]
        if source not in heard:
            return False
        return place not in self._vehicles or Address(source.system, AUTOPILOT_COMPONENT) in heard

    def _places_of(self, target: Address) -> set[int]:
        if target.system == 0:
            return set(range(len(self._senders)))
        if target.component != 0 and (exact := self._where(lambda address: address == target)):
            return exact
        return self._where(lambda address: address.system == target.system) - {OURSELVES}

    def _where(self, fits: Callable[[Address], bool]) -> set[int]:
        return {endpoint for endpoint, heard in self._received.items() if any(map(fits, heard))}

    def _pass_on(self, source: int, frame: bytes, places: set[int]) -> None:
        places = places - {source}
        if not places:
            self.counts["for nobody we know"] += 1
        sender = source_of(frame)
        for place in sorted(places - {OURSELVES}):
            outgoing = self._filters[place]
            if self._is_beyond(place, sender):
                self.counts["its sender is there"] += 1
            elif outgoing is not None and not outgoing.passes(self.now, frame):
                self.counts["held back by the filter of a link"] += 1
            else:
                self.counts["passed on" if self._senders[place](frame) else "dropped: endpoint full or away"] += 1

    def _has_come_round(self, endpoint: int, frame: bytes) -> bool:
        if frame not in self._recent:
            return False
        before, when = self._recent[frame]
        return self.now - when < (AGAIN_S if before == endpoint else ROUND_S)

    def _remember(self, endpoint: int, frame: bytes) -> None:
        if frame not in self._recent:
            if len(self._order) >= REMEMBERED:
                del self._recent[self._order.popleft()]
            self._order.append(frame)
        self._recent[frame] = (endpoint, self.now)


FRAMES_PER_TURN = 200
"""Frames of one ground station passed on in one turn of the loop; what a flood brings beyond them is dropped."""
BYTES_PER_TURN = 16_000
NETWORK_BYTES_S = 200_000.0
BURST_S = 0.5
LINE_SHARE = 0.5
"""Of a serial line to the flight controller, for all ground stations together: our steering needs the rest."""
BITS_A_BYTE = 10


def budget_for(baud: int) -> Budget:
    """Return what ground stations may send to a flight controller on a line of `baud`, 0 for a network."""
    rate = LINE_SHARE * baud / BITS_A_BYTE if baud else NETWORK_BYTES_S
    return Budget(rate, rate * BURST_S)


class RoutedTransport:
    """A flight controller's transport that shows the router what comes in and what we send ourselves.

    signing: what is not signed with our key is not passed on.
    """

    def __init__(self, inside: Transport, router: Router, signing: LinkSigning | None = None) -> None:
        self.inside = inside
        self.name = inside.name
        self.is_stream = inside.is_stream
        self.is_local = inside.is_local
        self.fileno, self.forget_peer = inside.fileno, inside.forget_peer
        self._router = router
        self._framer = Framer(inside.is_stream)
        # an observer: whoever reads the transport judges the same frames again
        self._judge = signing.observer() if signing is not None else None
        self._number = router.join(self._forwarded, has_vehicle=True)

    def receive(self) -> list[bytes]:
        """Return what waits, unchanged; the router has seen it. Raises LinkError."""
        chunks = self.inside.receive()
        for chunk in chunks:
            for frame in self._framer.frames(chunk):
                if self._judge is None or not self._judge.refuses(frame):
                    self._router.take(self._number, frame)
        return chunks

    def send(self, data: bytes) -> bool:
        """Send a packet of our own; what is for everybody the router shows to ground stations. Raises LinkError."""
        sent = self.inside.send(data)
        if source_of(data).component == OWN_COMPONENT:
            self._router.show_own(self._number, data)
        return sent

    def _forwarded(self, frame: bytes) -> bool:
        """A broken line is reported by the next `receive` or `send`, not to the ground station's link."""
        try:
            return self.inside.send(frame)
        except LinkError:
            return False

    def close(self) -> None:
        """Leave the router, and pass on."""
        self._router.leave(self._number)
        self.inside.close()


class ForwardLink(StationLink):
    """A `Link` to a ground station that sees the flight controller through us. It brings no samples, moves no rudder.

    budget: shared by all such links of a flight controller.  access: which system ids are heard; None: all.
    outgoing: what of that which is for the station is sent to it; None: all. Where it sets rates the station's own
    requests for streams go no further: they would change ours.
    """

    def __init__(
        self,
        transport: Transport,
        router: Router,
        budget: Budget,
        signing: LinkSigning | None = None,
        access: LinkAccess | None = None,
        outgoing: OutgoingFilter | None = None,
    ) -> None:
        super().__init__(transport, signing is not None, access)
        self._router = router
        self._budget = budget
        self._signing = signing
        self._framer = Framer(transport.is_stream)
        self._number = router.join(self._sent, outgoing=outgoing)
        self._has_rates = outgoing is not None and outgoing.sets_rates
        accept_signed(transport, signing, self._hears)

    def receive(self, now: float) -> list[Sample]:
        """Pass on what has arrived by `now` [s]. Nothing comes of it but word of a station that is lost or silent."""
        self._router.now = now
        if self.lost or self._access.crowded:
            return []
        dropped = refused_senders_of(self._transport)
        chunks, word = self._arrived(now, "forwarding_ended")
        if word:
            return word
        taken, room = 0, BYTES_PER_TURN
        for chunk in chunks:
            frames = self._framer.frames(chunk[:room])
            room = max(0, room - len(chunk))
            for frame in frames:
                taken += 1
                if taken > FRAMES_PER_TURN or not self._budget.spend(now, len(frame)):
                    self.dropped += 1
                elif not self._access.lets_in_system(source_of(frame).system):
                    continue
                elif (self._signing is None or not self._signing.refuses(frame)) and (
                    self.takes_orders or self._access.passes_on(frame)
                ):
                    is_beat = identity_of(frame) == MAVLINK_MSG_ID_HEARTBEAT
                    for message in MavlinkCodec().decode(frame) if is_beat else ():
                        self._access.heard(message)
                    if not self._access.is_vehicle(source_of(frame)):
                        self._presence.on_packet(now, is_beat)
                    if is_mavlink(frame):  # the log's readers know no other messages
                        self._packets.append((now, frame))
                    if self._has_rates and asks_for_streams(frame):
                        self._router.counts["requests for streams, of a link with rates"] += 1
                        continue
                    self._router.take(self._number, frame)
        self._access.count_refused_senders(refused_senders_of(self._transport) - dropped)
        self._access.crowded = self._access.crowded or taken > FRAMES_PER_TURN or not room
        return self._presence.update(now)

    def publish_tick(self, tick: Tick) -> None:
        """Say nothing: what is wrong goes out as STATUSTEXT over the flight controller's link, which is shown here.

        A station that floods us has been looked away from since; a tick has passed, it may wake the loop again.
        """
        self._access.crowded = False

    def close(self) -> None:
        """Leave the router, and close the transport."""
        self._router.leave(self._number)
        self._transport.close()
