"""What sends here: every place at which a boat's instruments are usually found, listened to one after another.

Nothing is sent. Serial lines are tried at the rates that MAVLink and NMEA 0183 use; networks only on this machine's
own loopback, because whoever listens elsewhere decides who may steer: such a link is named by hand.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from autopilot.doctor.machine import serial_devices
from autopilot.links.arrivals import HEADING_SENTENCES, MAVLINK_HEADING, message_names, sentence_names
from autopilot.links.base import LinkError
from autopilot.links.url import open_transport

LISTENED_S = 2.5
"""Two heartbeats, and a slow compass's second sentence."""
PAUSE_S = 0.02
LOOPBACK = ("udpin:127.0.0.1:14550", "nmea-udp:127.0.0.1:10110")
SERIAL = (("serial", 115200), ("serial", 57600), ("nmea", 4800), ("nmea", 38400))
SHOWN = 8
ENOUGH_BYTES = 4096


class Sender(NamedTuple):
    """What was found: the link that reads it, the protocol, its messages by how often they came, and whether there is
    a heading among them."""

    url: str
    protocol: str
    names: tuple[str, ...]
    has_heading: bool

    @property
    def words(self) -> str:
        """The finding for a line of a list."""
        more = ", ..." if len(self.names) > SHOWN else ""
        heading = "with a heading" if self.has_heading else "NO heading among them"
        return f"{self.url}: {self.protocol} ({', '.join(self.names[:SHOWN])}{more}), {heading}"


def candidates(devices: Iterable[Path] | None = None) -> list[str]:
    """Return the links to try: the serial devices that are plugged in, at each usual rate, and the loopback."""
    plugged = sorted(serial_devices() if devices is None else devices)
    return [*LOOPBACK, *(f"{kind}:{device}:{baud}" for device in plugged for kind, baud in SERIAL)]


def sender_of(url: str, data: bytes) -> Sender | None:
    """Return who sent `data` to a link, None where it means nothing there."""
    if url.startswith("nmea"):
        sentences = sentence_names(data)
        heading = any(name in sentences for name in HEADING_SENTENCES)
        return Sender(url, "NMEA 0183", _by_count(sentences), heading) if sentences else None
    messages = message_names(data)
    return Sender(url, "MAVLink", _by_count(messages), MAVLINK_HEADING in messages) if messages else None


def _by_count(names: dict[str, int]) -> tuple[str, ...]:
    return tuple(sorted(names, key=lambda name: (-names[name], name)))


def listened(url: str, seconds: float = LISTENED_S) -> bytes:
    """Return what comes over a link in some seconds; nothing where it cannot be opened."""
    try:
        transport = open_transport(url)
    except LinkError:
        return b""
    came, ends = b"", time.monotonic() + seconds
    try:
        while time.monotonic() < ends and len(came) < ENOUGH_BYTES:
            came += b"".join(transport.receive())
            time.sleep(PAUSE_S)
    except LinkError:
        pass  # unplugged meanwhile: what came, came
    finally:
        transport.close()
    return came


def discover(
    urls: Sequence[str], listen: Callable[[str], bytes] = listened, tell: Callable[[str], None] = lambda url: None
) -> list[Sender]:
    """Return who sends to the links `urls`; a device that was understood is not tried at other rates."""
    found: list[Sender] = []
    for url in urls:
        if any(_device(url) == _device(sender.url) for sender in found):
            continue
        tell(url)
        sender = sender_of(url, listen(url))
        if sender is not None:
            found.append(sender)
    return found


def _device(url: str) -> str:
    """Return the device of a serial link, whatever is spoken on it; other links are each their own."""
    kind, _, rest = url.partition(":")
    return rest.rpartition(":")[0] if kind in ("serial", "nmea") else url
