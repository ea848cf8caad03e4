"""Link URLs as the user writes them, turned into typed values and opened. Strict: a sentence for every error."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module

from autopilot.links.base import LinkError, Transport
from autopilot.links.drives import DRIVES
from autopilot.links.mavlink.codec import MavlinkCodec, Message, is_mavlink
from autopilot.links.mavlink.signing import LinkSigning
from autopilot.links.transports import UdpInTransport
from autopilot.links.transports.medium import BAUD_MAX as BAUD_MAX
from autopilot.links.transports.medium import BAUD_MIN as BAUD_MIN
from autopilot.links.transports.medium import LinkUrl as LinkUrl
from autopilot.links.transports.medium import (
    Medium,
    Network,
    Scheme,
    UrlOptions,
    Written,
    is_everywhere,
    only_from,
    parse_options,
)

MODULES = (
    "sockets",
    "serial_line",
    "medium",
)
"""Modules of `autopilot.links.transports` with a tuple MEDIA: one line for every kind of transport."""
MEDIA: dict[str, Medium] = {
    medium.name: medium for module in MODULES for medium in import_module(f"autopilot.links.transports.{module}").MEDIA
}


def _schemes() -> dict[str, tuple[Scheme, str]]:
    """Return every scheme with its medium: what speaks MAVLink first; rudder drives are on serial lines."""
    of_media = [(scheme, medium.name) for medium in MEDIA.values() for scheme in medium.schemes]
    of_drives = [(Scheme(name, name, drive.example), "serial") for name, drive in DRIVES.items()]
    order = ["mavlink", "nmea", *DRIVES]
    found = sorted([*of_media, *of_drives], key=lambda each: [*order, each[0].protocol].index(each[0].protocol))
    return {scheme.name: (scheme, medium) for scheme, medium in found}


EXAMPLES = {name: scheme.example for name, (scheme, _) in _schemes().items()}
DEFAULTS = {name: scheme.usual for name, (scheme, _) in _schemes().items() if scheme.usual}
SCHEMES: dict[str, tuple[str, str]] = {name: (scheme.protocol, over) for name, (scheme, over) in _schemes().items()}
"""What is spoken, and over which medium, by the beginning of a URL."""
COMMON = ("udpin", "tcp", "serial", "nmea")
NETWORKS = ("n2k", "ydwg", "actisense", "n2k-ascii")
"""What is spoken on NMEA 2000: frames on a CAN bus, and what gateways make of them."""
OPTIONS: dict[str, tuple[str, ...]] = {
    "nmea": ("steer", "send", "talker"),
    **dict.fromkeys(NETWORKS, ("steer", "orders")),
}
"""What may stand behind the `?`, by what is spoken; a medium that others come to also takes `allow`."""
FORWARD_OPTIONS = ("rate", "from")
"""What may stand there as well where MAVLink is passed on."""


def split_scheme(text: str) -> tuple[str, str]:
    """Return the kind of link that a URL begins with, of one word or of two (n2k:ydwg-tcp), and what is behind it."""
    first, _, rest = text.partition(":")
    second, _, behind = rest.partition(":")
    both = f"{first}:{second}"
    return (both, behind) if both in SCHEMES else (first, rest)


def _what_to_write(scheme: str) -> str:
    """Return examples of the kinds that come nearest, or of those that most boats have and the names of the others."""
    near = difflib.get_close_matches(scheme.casefold(), list(EXAMPLES), n=3)
    if near:
        return f"write one of {', '.join(EXAMPLES[name] for name in near)}"
    shown = ", ".join(EXAMPLES[name] for name in COMMON)
    return f"write one of {shown}; there are {', '.join(name for name in SCHEMES if name not in COMMON)} as well"


def parse_url(text: str, also: tuple[str, ...] = ()) -> LinkUrl:
    """Return the link that `text` names; LinkError with one sentence where it names none.

    also: options that are allowed beyond those of every link of its kind.
    """
    scheme, rest = split_scheme(text.strip())
    if ":" not in text or scheme not in SCHEMES:
        raise LinkError(f"link {text!r}: unknown kind {scheme!r}; {_what_to_write(scheme)}")
    protocol, medium = SCHEMES[scheme]
    rest, mark, query = rest.partition("?")
    takes = (*OPTIONS.get(protocol, ()), *also, *(("allow",) if MEDIA[medium].listens else ()))
    options = parse_options(text, query, takes) if mark else UrlOptions()
    place, colon, number = rest.rpartition(":")
    usual = DEFAULTS.get(scheme, "")
    if usual and not (colon and number.isdecimal()):
        place, colon, number = rest, ":", usual
    if not colon or not place:
        raise LinkError(f"link {text!r}: incomplete; write it like {EXAMPLES[scheme]}")
    where = MEDIA[medium].place(Written(text, EXAMPLES[scheme], place, number))
    return LinkUrl(text, protocol, medium, *where, options=options)


def open_transport(url: LinkUrl | str, allow: Sequence[Network] = ()) -> Transport:
    """Open the transport of `url`; LinkError with one sentence where that fails.

    allow: networks that may come to a listening transport whose URL names none; none at all: everybody. One that
    listens on every interface of the machine says so on the terminal.
    """
    link = parse_url(url) if isinstance(url, str) else url
    medium = MEDIA[link.medium]
    transport = medium.open(link, _accepts(link.protocol), only_from(link.options.allow or allow))
    return _exposed(link, transport) if medium.listens else transport


def _accepts(protocol: str) -> Callable[[bytes], bool]:
    """Return what tells a datagram of the protocol from noise."""
    if protocol == "mavlink":
        return is_mavlink
    if protocol in NETWORKS:
        from autopilot.links.n2k.link import is_spoken

        return partial(is_spoken, protocol)
    from autopilot.links.nmea.sentences import is_nmea

    return is_nmea


def _exposed(link: LinkUrl, transport: Transport) -> Transport:
    if is_everywhere(link.host):
        print(
            f"link {link.text!r} listens on every network of this machine; "
            "name one interface or address instead, such as wlan0 or 127.0.0.1, unless that is meant",
            file=sys.stderr,
        )
    return transport


def accept_signed(
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
