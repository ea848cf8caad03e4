"""The contracts of the links: transports move bytes, links turn them into samples and commands.

Nothing here or below blocks, sleeps or reads a clock: time is an argument.

`SessionLink`: a session, which knows what is said, carried over a line, which knows how bytes travel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import Generic, Protocol, TypeVar, runtime_checkable

from autopilot.errors import LinkError as LinkError  # the links' own word, which their users import from here
from autopilot.links.rudder_order import Release
from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    HelmCause,
    HelmSample,
    Mode,
    OrderKind,
    RudderCommand,
    Sample,
    Tick,
)


def parted(sentence: str) -> tuple[str, str]:
    """Return what a link says has happened, and what to do about it, which stands behind a semicolon."""
    happened, _, remedy = sentence.partition("; ")
    return happened, remedy


class NotThereError(LinkError):
    """A device or the other end of a connection is not there, but may come."""


class Transport(Protocol):
    """Moves bytes. A new transport inherits this, writes the methods and passes `tests/contract/test_transports.py`."""

    name: str
    """The URL as the user wrote it, for messages."""

    is_stream: bool
    """True where chunks may split or join packets anywhere (TCP, serial); False where each is a datagram."""

    is_local: bool
    """Whether nobody but programs of this machine can be at the other end."""

    def fileno(self) -> int:
        """Return the descriptor to wait on, or -1 where there is none (loopback, replay, not yet connected)."""

    def receive(self) -> list[bytes]:
        """Return every chunk that waits, oldest first, datagram boundaries kept; [] when none.

        Raises LinkError when the other side is gone for good (unplugged adapter, closed TCP connection).
        """

    def send(self, data: bytes) -> bool:
        """Send all of `data` or nothing: False when it would block or no peer is known yet.

        Raises LinkError when the link is gone.
        """

    def forget_peer(self) -> None:
        """Let go of a peer that was latched on to, so that another may take its place; elsewhere does nothing."""
        return

    def close(self) -> None:
        """Give the descriptor back; further calls do nothing."""


@runtime_checkable
class ConfirmsRelease(Protocol):
    """A link to a rudder, which knows what became of it after `release`, beside what every `Link` does."""

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder, None while reports may still show it.

        Called after `release` and each `receive` until it answers; sends what it takes to find out. Never raises.
        """


class Link(Protocol):
    """Turns the bytes of one transport into samples, and commands into bytes.

    As it stands a link to nobody: who inherits it writes only what it does.
    """

    name: str = "nobody"

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1 where there is nothing to wait for."""
        return -1

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that have arrived by `now` [s]. Bad packets are counted and dropped.

        Raises LinkError when the transport is gone.
        """
        return []

    def send(self, now: float, command: RudderCommand) -> None:
        """Send the rudder command, or the release where it is not engaged. The command leaves first."""
        return

    def publish_tick(self, tick: Tick) -> None:
        """Pass on who has the rudder, what is wrong, and what else falls due, where the link has a way to say it.

        Called after the command has left.
        """
        return

    def poll(self, now: float) -> None:
        """Do what falls due in the slack: heartbeats, stream and parameter requests, reconnection."""
        return

    def release(self, now: float) -> None:
        """Give the rudder back, several times over; called on every way out. Never raises."""
        return

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return and forget the raw MAVLink packets received and sent since the last call ([] on other links)."""
        return []

    def close(self) -> None:
        """Release and close the transport."""
        return


class CarriedLink(Link):
    """A link over a transport of its own."""

    def __init__(self, transport: Transport) -> None:
        self.name = transport.name
        self._transport = transport

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""
        return self._transport.fileno()

    def close(self) -> None:
        """Close the transport; call `release` first."""
        self._transport.close()


STOOD_STILL_S, CAUGHT_UP_S = 3.0, 0.5


class Backlog:
    """Tells orders that have waited here while this computer stood still: what has waited for STOOD_STILL_S, and is
    read within CAUGHT_UP_S, was given up by who sent it, or sent again. By then a vehicle has taken its rudder back.

    Attributes:
        looked: when [s] the line was read last, nan before.
    """

    def __init__(self) -> None:
        self.looked, self._until = math.nan, -math.inf

    def on_receive(self, now: float) -> None:
        """Take that the line is read at `now` [s]."""
        self._until = now + CAUGHT_UP_S if now - self.looked > STOOD_STILL_S else self._until
        self.looked = now

    def has(self, now: float) -> bool:
        """Return whether what is read at `now` [s] may be of the backlog."""
        return now <= self._until


UNSEEN_S = 0.8
"""So long after the pilot has left the helm [s] an order may come from before its giver could see that: there and back
over a slow radio, and a human's eye and hand between."""
UNSEEN = "the pilot stands by since before you could see it: order again if you still want it"
SAID_AGAIN_S = 3.0
"""So long at most [s] a station waits for an answer before it says its order again, by itself (QGroundControl)."""
REPEATED_S = 10.0
"""So long an order may be said again, or be held by a line."""


class LastStop:
    """Tells orders whose giver cannot have seen that the pilot left the helm. For all links together; who let the pilot
    stand by knows it, and may engage it again at once."""

    def __init__(self) -> None:
        self._time = -math.inf
        self._givers: set[object] = set()
        self._steers, self._ends = False, True

    def ordered(self, now: float, giver: object) -> None:
        """Take that `giver` lets the pilot stand by at `now` [s]: nothing new to others where it does already."""
        if self._ends:
            self._time, self._givers, self._ends = now, set(), False
        self._givers.add(giver)

    def on_tick(self, tick: Tick) -> None:
        """Take who has the helm: that it was taken on board, or lost, is nobody's order."""
        if self._steers and tick.mode not in (Mode.ENGAGED, Mode.STANDBY):
            self._time, self._givers = tick.now, set()
        self._steers = tick.mode is Mode.ENGAGED
        self._ends = self._steers or tick.order.kind is not OrderKind.STANDBY

    def is_unseen(self, now: float, giver: object, said: int = 0) -> bool:
        """Return whether an order of `giver` that comes at `now` [s], said so many times before, may be from before."""
        since = min(UNSEEN_S + SAID_AGAIN_S * said, REPEATED_S)
        return giver not in self._givers and now - self._time < since


PLOTTER = "chart plotter"
OTHER_PILOT_S = 2.0
"""An autopilot that has ordered no rudder on a line for so long orders it no more: drives let go then."""
OFF_HEADING = math.radians(10.0)
"""From here on a line is said that the boat is off its heading."""


class AlarmNews:
    """Says an alarm under `source` when it begins, becomes another, or ends."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._said: AlarmEvent | None = None

    def of(self, now: float, alarm: AlarmEvent | None) -> list[Sample]:
        """Return what is to be said of the alarm of `now` [s]."""
        if alarm == self._said:
            return []
        self._said = alarm
        return [AlarmSample(now, alarm, self._source)]


class Guide(Protocol):
    """Who has something to say."""

    @property
    def alarm(self) -> AlarmEvent | None:
        """What the skipper should know, None while all is well."""


class GuideAlarms(AlarmNews, Link):
    """Word of `guide`, under `name`, whenever it changes."""

    def __init__(self, guide: Guide, name: str) -> None:
        super().__init__(name)
        self.name = name
        self._guide = guide

    def receive(self, now: float) -> list[Sample]:
        """Return what is new."""
        alarm = self._guide.alarm
        return [] if alarm is self._said else self.of(now, alarm)


class HelmNews:
    """Says why the rudder cannot be steered over the link `name`, or that it can, whenever that changes.

    steers: whether the link has the rudder; one that has not says only what is wrong, and its end.
    """

    def __init__(self, name: str, steers: bool = True) -> None:
        self._name, self._steers = name, steers
        self._said: str | None = None

    def of(self, now: float, reason: str, cause: HelmCause) -> list[Sample]:
        """Return what is to be said of the reason of `now` [s], "" where the rudder can be steered."""
        if reason == self._said or not (self._steers or reason or self._said):
            return []
        self._said = reason
        return [HelmSample(now, not reason, reason, self._name, cause)]


def close_all(links: Iterable[Link]) -> None:
    """Close every link, each even if another fails."""
    with ExitStack() as closing:
        for link in links:
            closing.callback(link.close)


P = TypeVar("P")
SentP = TypeVar("SentP", contravariant=True)

SILENT_PEER_S = 5.0
"""Time without anything that the session understands after which another peer may take the place on a listening
socket: an instrument that starts again speaks from another port."""


class Line(Protocol[SentP]):
    """What carries packets of one kind: sentences, messages."""

    name: str

    def fileno(self) -> int:
        """Return the descriptor to wait on, or -1."""

    def send(self, packet: SentP, /) -> bool:
        """Send a packet; False where the line does not take it. Raises LinkError when it is gone."""

    def forget_peer(self) -> None:
        """Let go of a peer that was latched on to, where there is one."""

    def close(self) -> None:
        """Close it."""


class LineSession(Protocol[P]):
    """What is said over one line. It owns no line and no clock, and never raises.

    received_time: when something that it understands last came [s], -inf before the first.
    """

    received_time: float

    def receive(self, now: float, packets: list[P]) -> list[Sample]:
        """Take what has arrived by `now` [s] and return the samples in it."""

    def send(self, now: float, command: RudderCommand) -> None:
        """Take the rudder command of `now` [s]; one that is not engaged, or not finite, is a release."""

    def poll(self, now: float) -> None:
        """Have said what falls due at `now` [s]."""

    def on_tick(self, tick: Tick) -> None:
        """Have said what falls due with `tick`."""

    def due(self, now: float) -> list[P]:
        """Return what may leave at `now` [s], oldest first."""

    def sent(self, now: float, packets: list[P]) -> None:
        """Take that the first of what was `due` have left at `now` [s]; the rest the line did not take."""

    def release(self, now: float) -> list[P]:
        """Return what gives the rudder back at once; nothing where it was never taken."""

    def released(self, now: float, is_gone: bool) -> None:
        """Take that the releases have left at `now` [s]; `is_gone`: they could not."""

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while it is on its way."""


class SessionLink(Link, Generic[P]):
    """A `Link`: `session` over `line`."""

    def __init__(self, line: Line[P], session: LineSession[P], arrived: Callable[[float], list[P]]) -> None:
        """arrived: returns what has arrived over the line by a time [s]. Raises LinkError when the line is gone."""
        self.name = line.name
        self._line, self._session, self._arrived = line, session, arrived
        self._vacant_since = -math.inf

    def fileno(self) -> int:
        """Return the line's descriptor, or -1."""
        return self._line.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that have arrived by `now` [s]; LinkError when the line is gone."""
        samples = self._session.receive(now, self._arrived(now))
        if now - max(self._vacant_since, self._session.received_time) > SILENT_PEER_S:
            self._vacant_since = now
            self._line.forget_peer()
        return samples

    def send(self, now: float, command: RudderCommand) -> None:
        """Send the rudder order; a line still busy takes the newest one as soon as it is free."""
        self._session.send(now, command)
        self._write(now)

    def poll(self, now: float) -> None:
        """Send what is due: the newest order or its repetition, the releases that are left, answers."""
        self._session.poll(now)
        self._write(now)

    def publish_tick(self, tick: Tick) -> None:
        """Send what falls due with `tick`, where the line has room for it."""
        self._session.on_tick(tick)
        self._write(tick.now)

    def release(self, now: float) -> None:
        """Give the rudder back, several times over; never raises."""
        if not (releases := self._session.release(now)):
            return
        is_gone = False
        try:
            for packet in releases:
                self._line.send(packet)
        except LinkError:
            is_gone = True  # the drive releases by its own timeout
        self._session.released(now, is_gone)

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder after `release`, None while it is on its way."""
        return self._session.release_result(now)

    def close(self) -> None:
        """Close the line; call `release` first."""
        self._line.close()

    def _write(self, now: float) -> None:
        left: list[P] = []
        for packet in self._session.due(now):
            if not self._line.send(packet):
                break
            left.append(packet)
        if left:
            self._session.sent(now, left)
