"""What a kind of transport says of itself: its URL schemes, how the place behind them is written, how it is opened."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from autopilot.links.base import LinkError, Transport
from autopilot.links.transports.sockets import Allows
from autopilot.links.url_options import UrlOptions

BAUD_MIN, BAUD_MAX = 300, 4_000_000


class LinkUrl(NamedTuple):
    """A link: what is spoken, over what, and where. host and port on networks, path and baud on serial lines.

    On a CAN bus `host` is python-can's interface and `path` its channel.
    """

    text: str
    protocol: str
    medium: str
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int = 0
    options: UrlOptions = UrlOptions()


class Place(NamedTuple):
    """Where a link goes, see `LinkUrl`."""

    host: str = ""
    port: int = 0
    path: str = ""
    baud: int = 0


class Written(NamedTuple):
    """A URL as somebody wrote it: all of it, an example of its scheme, and what stands before and behind the colon."""

    text: str
    example: str
    before: str
    behind: str

    def number(self, what: str, low: int, high: int) -> int:
        """Return what stands behind the colon as a whole number. LinkError where it is none from `low` to `high`."""
        digits = self.behind
        value = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 9 else -1
        if not low <= value <= high:
            raise LinkError(
                f"link {self.text!r}: {what} {digits!r} is not a whole number from {low} to {high}; "
                f"write it like {self.example}"
            )
        return value

    def host(self) -> str:
        """Return the host before the colon, of an IPv6 address without its brackets. LinkError where it is none."""
        place = self.before
        bracketed = place.startswith("[") and place.endswith("]")
        host = place[1:-1] if bracketed else place
        if not host or (":" in host and not bracketed) or any(c.isspace() or c in "/[]" for c in host):
            raise LinkError(f"link {self.text!r}: host {place!r} is not an address; write it like {self.example}")
        return host


Accepts = Callable[[bytes], bool]
"""Says of a datagram whether it is of the protocol that is spoken."""


class Scheme(NamedTuple):
    """The beginning of a URL, what is spoken over it, and an example."""

    name: str
    protocol: str
    example: str


class Medium(NamedTuple):
    """A kind of transport: its name, its schemes, how a place is read, how one is opened, and whether others come to
    it, who may be kept out by `allow`."""

    name: str
    schemes: tuple[Scheme, ...]
    place: Callable[[Written], Place]
    open: Callable[[LinkUrl, Accepts, Allows], Transport]
    listens: bool = False


def peer(written: Written) -> Place:
    """Return the host and port of somebody to go to."""
    return Place(port=written.number("port", 1, 65535), host=written.host())


def own_address(written: Written) -> Place:
    """Return the host and port to listen at; port 0: any that is free."""
    return Place(port=written.number("port", 0, 65535), host=written.host())


def line(written: Written) -> Place:
    """Return path and baud rate of a serial line."""
    return Place(path=written.before, baud=written.number("baud rate", BAUD_MIN, BAUD_MAX))
