"""A link is a session, which knows what is said, carried over a line, which knows how bytes travel."""

from __future__ import annotations

import math
from typing import Generic, Protocol, TypeVar

from autopilot.links.base import LinkError, SilentLink
from autopilot.links.release import Release
from autopilot.signals import RudderCommand, Sample, Tick

P = TypeVar("P")

SILENT_PEER_S = 5.0
"""Time without anything that the session understands after which another peer may take the place on a listening
socket: an instrument that starts again speaks from another port."""


class Line(Protocol[P]):
    """What carries packets of one kind: sentences, messages."""

    name: str

    def fileno(self) -> int:
        """Return the descriptor to wait on, or -1."""

    def receive(self, now: float) -> list[P]:
        """Return what has arrived by `now` [s]. Raises LinkError when the line is gone."""

    def send(self, packet: P, /) -> bool:
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


class SessionLink(SilentLink, Generic[P]):
    """A `Link`: `session` over `line`."""

    def __init__(self, line: Line[P], session: LineSession[P]) -> None:
        self.name = line.name
        self._line, self._session = line, session
        self._vacant_since = -math.inf

    def fileno(self) -> int:
        """Return the line's descriptor, or -1."""
        return self._line.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that have arrived by `now` [s]; LinkError when the line is gone."""
        samples = self._session.receive(now, self._line.receive(now))
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
