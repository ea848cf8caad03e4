"""Link URLs as the user writes them, turned into typed values and opened. Strict: a sentence for every error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from autopilot.links.base import LinkError, Transport
from autopilot.links.mavlink.codec import MavlinkCodec, Message, is_mavlink
from autopilot.links.mavlink.signing import LinkSigning
from autopilot.links.nmea.sentences import is_nmea
from autopilot.links.transports import (
    SerialTransport,
    TcpClientTransport,
    TcpServerTransport,
    UdpInTransport,
    UdpOutTransport,
)
from autopilot.links.transports.sockets import Network, is_everywhere, only_from
from autopilot.links.url_options import UrlOptions, parse_options

Protocol = Literal["mavlink", "nmea", "pypilot", "jrk", "maestro", "n2k"]
Medium = Literal["udpin", "udpout", "tcp", "tcpin", "serial", "can"]

EXAMPLES = {
    "udpin": "udpin:127.0.0.1:14550",
    "udpout": "udpout:192.168.1.10:14550",
    "tcp": "tcp:127.0.0.1:5760",
    "tcpin": "tcpin:127.0.0.1:5760",
    "serial": "serial:/dev/ttyUSB0:115200",
    "nmea": "nmea:/dev/ttyUSB1:4800",
    "nmea-udp": "nmea-udp:127.0.0.1:10110",
    "nmea-udpout": "nmea-udpout:192.168.1.20:10110",
    "nmea-tcp": "nmea-tcp:192.168.1.20:10110",
    "nmea-tcpin": "nmea-tcpin:wlan0:10110",
    "pypilot": "pypilot:/dev/ttyUSB2:38400",
    "jrk": "jrk:/dev/ttyACM0:115200",
    "maestro": "maestro:/dev/ttyACM0:115200",
    "n2k": "n2k:socketcan:can0",
}
SCHEMES: dict[str, tuple[Protocol, Medium]] = {
    "udpin": ("mavlink", "udpin"),
    "udpout": ("mavlink", "udpout"),
    "tcp": ("mavlink", "tcp"),
    "tcpin": ("mavlink", "tcpin"),
    "serial": ("mavlink", "serial"),
    "nmea": ("nmea", "serial"),
    "nmea-udp": ("nmea", "udpin"),
    "nmea-udpout": ("nmea", "udpout"),
    "nmea-tcp": ("nmea", "tcp"),
    "nmea-tcpin": ("nmea", "tcpin"),
    "pypilot": ("pypilot", "serial"),
    "jrk": ("jrk", "serial"),
    "maestro": ("maestro", "serial"),
    "n2k": ("n2k", "can"),
}
OPTIONS: dict[Protocol, tuple[str, ...]] = {"nmea": ("steer", "send", "talker"), "n2k": ("steer",)}
"""What may stand behind the `?`, by what is spoken."""
LISTENING = ("udpin", "tcpin")
"""Media that others come to; these also take `allow`."""
BAUD_MIN, BAUD_MAX = 300, 4_000_000


class LinkUrl(NamedTuple):
    """A link: what is spoken, over what, and where. host and port on networks, path and baud on serial lines.

    On a CAN bus `host` is python-can's interface and `path` its channel.
    """

    text: str
    protocol: Protocol
    medium: Medium
    host: str = ""
    port: int = 0
    path: str = ""
    baud: int = 0
    options: UrlOptions = UrlOptions()


def parse_url(text: str) -> LinkUrl:
    """Return the link that `text` names; LinkError with one sentence where it names none."""
    scheme, colon, rest = text.strip().partition(":")
    if not colon or scheme not in SCHEMES:
        allowed = ", ".join(EXAMPLES.values())
        raise LinkError(f"link {text!r}: unknown kind {scheme!r}; write one of {allowed}")
    protocol, medium = SCHEMES[scheme]
    rest, mark, query = rest.partition("?")
    takes = (*OPTIONS.get(protocol, ()), *(("allow",) if medium in LISTENING else ()))
    options = parse_options(text, query, takes) if mark else UrlOptions()
    place, colon, number = rest.rpartition(":")
    if not colon or not place:
        raise LinkError(f"link {text!r}: incomplete; write it like {EXAMPLES[scheme]}")
    if medium == "serial":
        baud = _number(text, scheme, "baud rate", number, BAUD_MIN, BAUD_MAX)
        return LinkUrl(text, protocol, medium, path=place, baud=baud, options=options)
    if medium == "can":
        if not number or any(c.isspace() for c in place + number):
            raise LinkError(f"link {text!r}: incomplete; write it like {EXAMPLES[scheme]}")
        return LinkUrl(text, protocol, medium, host=place, path=number, options=options)
    port = _number(text, scheme, "port", number, 0 if medium in LISTENING else 1, 65535)
    return LinkUrl(text, protocol, medium, host=_host(text, scheme, place), port=port, options=options)


def open_transport(url: LinkUrl | str, allow: Sequence[Network] = ()) -> Transport:
    """Open the transport of `url`; LinkError with one sentence where that fails.

    allow: networks that may come to a listening transport whose URL names none; none at all: everybody. One that
    listens on every interface of the machine says so on the terminal.
    """
    link = parse_url(url) if isinstance(url, str) else url
    if link.medium == "serial":
        return SerialTransport(link.text, link.path, link.baud)
    if link.medium == "can":
        raise LinkError(f"link {link.text!r}: NMEA 2000 is no stream of bytes; use it with autopilot run")
    allows = only_from(link.options.allow or allow)
    if link.medium == "udpin":
        accepts: Callable[[bytes], bool] = is_mavlink if link.protocol == "mavlink" else is_nmea
        return _exposed(link, UdpInTransport(link.text, link.host, link.port, accepts, allows))
    if link.medium == "udpout":
        return UdpOutTransport(link.text, link.host, link.port)
    if link.medium == "tcp":
        return TcpClientTransport(link.text, link.host, link.port)
    return _exposed(link, TcpServerTransport(link.text, link.host, link.port, allows))


def _exposed(link: LinkUrl, transport: Transport) -> Transport:
    if is_everywhere(link.host):
        print(
            f"link {link.text!r} listens on every network of this machine; "
            "name one interface or address instead, such as wlan0 or 127.0.0.1, unless that is meant",
            file=sys.stderr,
        )
    return transport


def believe_signed(
    transport: Transport, signing: LinkSigning | None, hears: Callable[[Message], bool] | None = None
) -> None:
    """Let nobody become the peer of a listening MAVLink transport who does not sign with our key, where we have one.

    hears: says of a message whether its sender may become the peer; None: every valid one's may.
    """
    if signing is None and hears is None:
        return
    observer = signing.observer() if signing is not None else None

    def accepts(datagram: bytes) -> bool:
        messages = MavlinkCodec(signing=observer).decode(datagram)
        return any(hears is None or hears(message) for message in messages)

    let_in(transport, accepts)


def let_in(transport: Transport, accepts: Callable[[bytes], bool]) -> None:
    """Let only the sender of a datagram that `accepts` takes become the peer of a listening transport."""
    listening = transport
    while (inside := getattr(listening, "inside", None)) is not None:
        listening = inside
    if isinstance(listening, UdpInTransport):
        listening.accepts = accepts


def _number(text: str, scheme: str, what: str, digits: str, low: int, high: int) -> int:
    value = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 9 else -1
    if not low <= value <= high:
        raise LinkError(
            f"link {text!r}: {what} {digits!r} is not a whole number from {low} to {high}; "
            f"write it like {EXAMPLES[scheme]}"
        )
    return value


def _host(text: str, scheme: str, place: str) -> str:
    bracketed = place.startswith("[") and place.endswith("]")
    host = place[1:-1] if bracketed else place
    if not host or (":" in host and not bracketed) or any(c.isspace() or c in "/[]" for c in host):
        raise LinkError(f"link {text!r}: host {place!r} is not an address; write it like {EXAMPLES[scheme]}")
    return host
