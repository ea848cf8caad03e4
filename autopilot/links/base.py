"""The contracts of the links: transports move bytes, links turn them into samples and commands.

Nothing here or below blocks, sleeps or reads a clock: time is an argument.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from typing import Protocol, runtime_checkable

from autopilot.files.printable import brief
from autopilot.links.release import Release
from autopilot.signals import AlarmEvent, Mode, RudderCommand, Sample, Tick


class LinkError(Exception):
    """A link could not be opened or has been lost. The message, which is short, names it, what happened, what to do."""

    def __init__(self, message: str = "") -> None:
        super().__init__(brief(message))


def parted(sentence: str) -> tuple[str, str]:
    """Return what a link says has happened, and what to do about it, which stands behind a semicolon."""
    happened, _, remedy = sentence.partition("; ")
    return happened, remedy


class NotThereError(LinkError):
    """A device or the other end of a connection is not there, but may come."""


class Transport(Protocol):
    """Moves bytes. A new transport writes these methods and passes `tests/contract/test_transports.py`."""

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

    def close(self) -> None:
        """Give the descriptor back; further calls do nothing."""


@runtime_checkable
class TickListener(Protocol):
    """A link that can pass on what the pilot knows, beside what every `Link` does."""

    def publish_tick(self, tick: Tick) -> None:
        """Send on what falls due with `tick`; called after the command has left."""


@runtime_checkable
class ConfirmsRelease(Protocol):
    """A link to a rudder, which knows what became of it after `release`, beside what every `Link` does."""

    def release_result(self, now: float) -> Release | None:
        """Return what became of the rudder, None while reports may still show it.

        Called after `release` and each `receive` until it answers; sends what it takes to find out. Never raises.
        """


class Link(Protocol):
    """Turns the bytes of one transport into samples, and commands into bytes."""

    name: str

    def fileno(self) -> int:
        """Return the transport's descriptor, or -1."""

    def receive(self, now: float) -> list[Sample]:
        """Return the samples that have arrived by `now` [s]. Bad packets are counted and dropped.

        Raises LinkError when the transport is gone.
        """

    def send(self, now: float, command: RudderCommand) -> None:
        """Send the rudder command, or the release where it is not engaged. The command leaves first."""

    def publish_status(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Pass on who has the rudder and what is wrong, where the link has a way to say it."""

    def poll(self, now: float) -> None:
        """Do what falls due in the slack: heartbeats, stream and parameter requests, reconnection."""

    def release(self, now: float) -> None:
        """Give the rudder back, several times over; called on every way out. Never raises."""

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return and forget the raw MAVLink packets received and sent since the last call ([] on other links)."""

    def close(self) -> None:
        """Release and close the transport."""


class SilentLink:
    """A `Link` to nobody, and what other links inherit: each writes only what it does."""

    name = "nobody"

    def fileno(self) -> int:
        """Return -1: there is nothing to wait for."""
        return -1

    def receive(self, now: float) -> list[Sample]:
        """Return nothing."""
        return []

    def send(self, now: float, command: RudderCommand) -> None:
        """Do nothing."""

    def publish_status(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Do nothing."""

    def poll(self, now: float) -> None:
        """Do nothing."""

    def release(self, now: float) -> None:
        """Do nothing."""

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return nothing."""
        return []

    def close(self) -> None:
        """Do nothing."""


def close_all(links: Iterable[Link]) -> None:
    """Close every link, each even if another fails."""
    with ExitStack() as closing:
        for link in links:
            closing.callback(link.close)
