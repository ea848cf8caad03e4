"""Link URLs as the user writes them, turned into typed values and opened. Strict: a sentence for every error.

What came over a line on which no heading was found is kept until the first heading, and put into words where none
comes. So a skipper reads what is wrong: a silent port, another protocol, another baud rate, or messages without a
heading.
"""

from __future__ import annotations

import difflib
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib import import_module

from autopilot.errors import InputError
from autopilot.links.base import Transport
from autopilot.links.drives import DRIVES
from autopilot.links.mavlink.codec import MavlinkCodec, Message, is_mavlink
from autopilot.links.mavlink.signing import BEHIND, LinkSigning
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
    peer_of,
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
    if "/" in scheme:
        return f"write serial:{scheme}:57600 for MAVLink, nmea:{scheme}:4800 for instruments"
    if "." in scheme or scheme.casefold() == "localhost":
        return f"write udpin:{scheme}:14550, udpout:{scheme}:14550 or tcp:{scheme}:5760"
    near = difflib.get_close_matches(scheme.casefold(), list(EXAMPLES), n=3)
    if near:
        return f"write {'one of ' if near[1:] else ''}{', '.join(EXAMPLES[name] for name in near)}"
    shown = ", ".join(EXAMPLES[name] for name in COMMON)
    return f"write one of {shown}; there are {', '.join(name for name in SCHEMES if name not in COMMON)} as well"


def parse_url(text: str, also: tuple[str, ...] = ()) -> LinkUrl:
    """Return the link that `text` names; InputError with one sentence where it names none.

    also: options that are allowed beyond those of every link of its kind.
    """
    scheme, rest = split_scheme(text.strip())
    if ":" not in text or scheme not in SCHEMES:
        raise InputError(f"link {text!r}: unknown kind {scheme!r}; {_what_to_write(scheme)}")
    protocol, medium = SCHEMES[scheme]
    rest, mark, query = rest.partition("?")
    takes = (*OPTIONS.get(protocol, ()), *also, *(("allow",) if MEDIA[medium].listens else ()))
    options = parse_options(text, query, takes) if mark else UrlOptions()
    place, colon, number = rest.rpartition(":")
    usual = DEFAULTS.get(scheme, "")
    if usual and not (colon and number.isdecimal()):
        place, colon, number = rest, ":", usual
    if not colon or not place:
        raise InputError(f"link {text!r}: incomplete; write it like {EXAMPLES[scheme]}")
    where = MEDIA[medium].place(Written(text, EXAMPLES[scheme], place, number))
    return LinkUrl(text, protocol, medium, *where, options=options)


def open_transport(url: LinkUrl | str, allow: Sequence[Network] = ()) -> Transport:
    """Open the transport of `url`; LinkError with one sentence where that fails.

    allow: networks that may come to a listening transport whose URL names none; none at all: everybody. One that
    listens on every interface of the machine, or at a port that the system has chosen, says so on the terminal.
    """
    link = parse_url(url) if isinstance(url, str) else url
    medium = MEDIA[link.medium]
    transport = medium.open(link, _accepts(link.protocol), only_from(link.options.allow or allow))
    if medium.listens:
        _say_where(link, transport)
    return transport


def _accepts(protocol: str) -> Callable[[bytes], bool]:
    if protocol == "mavlink":
        return is_mavlink
    if protocol in NETWORKS:
        from autopilot.links.n2k.link import is_spoken

        return partial(is_spoken, protocol)
    from autopilot.links.nmea.sentences import is_nmea

    return is_nmea


def _say_where(link: LinkUrl, transport: Transport) -> None:
    if is_everywhere(link.host):
        print(
            f"link {link.text!r} listens on every network of this machine; "
            "name one interface or address instead, such as wlan0 or 127.0.0.1, unless that is meant",
            file=sys.stderr,
        )
    if link.port == 0:
        print(f"link {link.text!r} listens at port {getattr(transport, 'port', 0)}", file=sys.stderr)


def accept_signed(
    transport: Transport, signing: LinkSigning | None, hears: Callable[[Message], bool] | None = None
) -> None:
    """Let nobody become the peer of a listening MAVLink transport who does not sign with our key, where we have one.

    Who does, by a clock that is behind our time, is answered one datagram: from it a station learns the time, as one
    does that hears us anyway, and goes on from there.

    hears: says of a message whether its sender may become the peer; None: every valid one's may.
    """
    if signing is None and hears is None:
        return
    observer = signing.observer() if signing is not None else None

    was_behind = False

    def accepts(datagram: bytes) -> bool:
        nonlocal was_behind
        behind = signing.signing.refused[BEHIND] if signing is not None else 0
        messages = MavlinkCodec(signing=observer).decode(datagram)
        was_behind = signing is not None and signing.signing.refused[BEHIND] > behind
        return any(hears is None or hears(message) for message in messages)

    let_in(transport, accepts, lambda: was_behind)


def let_in(transport: Transport, accepts: Callable[[bytes], bool], answers: Callable[[], bool] = lambda: False) -> None:
    """Let only the sender of a datagram that `accepts` takes become the peer of a listening transport; `answers`:
    whether the sender of the last one that it did not take is sent one, once."""
    listening = transport
    while (inside := getattr(listening, "inside", None)) is not None:
        listening = inside
    if isinstance(listening, UdpInTransport):
        listening.accepts, listening.answers = accepts, answers


KEPT_BYTES = 30_000
NAMES_MOST = 8
SENTENCE = re.compile(rb"[$!][A-Z]{1,2}([A-Z]{3}),[\x20-\x7e]*")
SENTENCES_LEAST = 2
HEADING_SENTENCES = ("HDG", "HDM", "HDT", "THS")
MAGNETIC = ("HDG", "HDM")
MAVLINK_HEADING = "ATTITUDE"


class RecordingTransport:
    """A transport that keeps the beginning of what comes, until `forget`."""

    def __init__(self, inside: Transport, protocol: str) -> None:
        self.inside = inside
        self.protocol = protocol
        self.name = inside.name
        self.is_stream = inside.is_stream
        self.is_local = inside.is_local
        self.fileno, self.send = inside.fileno, inside.send
        self.forget_peer, self.close = inside.forget_peer, inside.close
        self.count = 0
        self.kept: list[bytes] = []
        self._room = KEPT_BYTES

    def receive(self) -> list[bytes]:
        """Return what waits. Raises LinkError."""
        chunks = self.inside.receive()
        for chunk in chunks if self._room > 0 else ():
            self.count += len(chunk)
            self._room -= len(chunk)
            self.kept.append(chunk)
        return chunks

    def forget(self) -> None:
        """Keep nothing any more."""
        self.kept, self._room = [], 0

    @property
    def words(self) -> str:
        """What came and what to do about it, as a part of a sentence."""
        data, sender = b"".join(self.kept), peer_of(self.inside)
        refused = self.inside.refused if isinstance(self.inside, UdpInTransport) and not data else None
        if refused is not None:
            data, sender = refused
        where = f" from {sender}" if sender else ""
        if not data:
            wiring = ", and the wiring (RX to TX)" if self._is_serial() else ""
            return f"nothing came over {self.name}: check that the other side is on and sends here{wiring}"
        sentences, messages = sentence_names(data), message_names(data, self.is_stream)
        if self.protocol == "mavlink" and messages:
            return _without_heading(self.name, f"MAVLink{where}", messages, _about_messages(messages))
        if self.protocol == "nmea" and sentences:
            return _without_heading(self.name, f"NMEA 0183{where}", sentences, _about_sentences(sentences))
        if self.protocol in NETWORKS and (groups := group_names(data, self.protocol)):
            return _without_heading(self.name, f"NMEA 2000{where}", groups, _about_groups(groups))
        if sentences and self.protocol != "nmea":
            return f"NMEA 0183 ({_listed(sentences)}) came over {self.name}{where}: {self._instead('nmea')}"
        if messages and self.protocol != "mavlink":
            return f"MAVLink ({_listed(messages)}) came over {self.name}{where}: {self._instead('mavlink')}"
        came = f"{max(self.count, len(data))} bytes that mean nothing came over {self.name}{where}"
        other = "what is plugged in there" if self._is_serial() else "which program sends there"
        return f"{came}: check {'the baud rate and ' if self._is_serial() else ''}{other}"

    def _is_serial(self) -> bool:
        return self.is_stream and hasattr(self.inside, "baud")

    def _instead(self, protocol: str) -> str:
        scheme, rest = split_scheme(self.name)
        medium = SCHEMES[scheme][1]
        same = [name for name, (speaks, over) in SCHEMES.items() if (speaks, over) == (protocol, medium)]
        return f"write --link {same[0]}:{rest}" if same else "give that line its own kind of link"


def sentence_names(data: bytes) -> Counter[str]:
    """Return the NMEA 0183 sentences in `data` by name, whatever their checksums; none where it is no text of them."""
    found = Counter(match[1].decode() for match in SENTENCE.finditer(data))
    return found if found.total() >= SENTENCES_LEAST or data.count(b"$") == found.total() > 0 else Counter()


def message_names(data: bytes, is_stream: bool = True) -> Counter[str]:
    """Return the MAVLink messages in `data` by name."""
    found = Counter(message.get_type() for message in MavlinkCodec(is_stream=True).decode(data))
    return Counter({name: count for name, count in found.items() if name != "BAD_DATA"})


def group_names(data: bytes, form: str) -> Counter[str]:
    """Return the groups of NMEA 2000 in `data`, of those that are read."""
    from autopilot.links.n2k.link import FORMS

    return Counter(str(message.group) for message in FORMS[form]().feed(0.0, data))


def came(transports: Iterable[RecordingTransport]) -> str:
    """Return what came over each line, as a sentence."""
    return "; ".join(each.words for each in transports)


def _listed(names: Counter[str]) -> str:
    shown = [name for name, _ in names.most_common(NAMES_MOST)]
    return ", ".join([*shown, *(["..."] if len(names) > len(shown) else [])])


def _without_heading(name: str, what: str, names: Counter[str], advice: str) -> str:
    return f"{names.total()} messages of {what} came over {name} ({_listed(names)}), no heading among them: {advice}"


def _about_sentences(names: Counter[str]) -> str:
    if any(name in names for name in ("HDT", "THS")):
        return "their fields are empty, marked invalid or simulated, or their checksums wrong; look at the compass"
    if any(name in names for name in MAGNETIC):
        return (
            "a magnetic heading needs the variation: set sensors.variation_deg, send RMC or HDG with it, or set "
            "sensors.magnetic: true to steer magnetic courses"
        )
    return f"let the compass send {', '.join(HEADING_SENTENCES)}"


def _about_groups(names: Counter[str]) -> str:
    if "127250" in names:
        return (
            "a magnetic heading needs the variation: set sensors.variation_deg, let the GPS send 127258, or set "
            "sensors.magnetic: true to steer magnetic courses"
        )
    return "let the compass send 127250"


def _about_messages(names: Counter[str]) -> str:
    if MAVLINK_HEADING in names:
        return "the vehicle's attitude is not valid yet, or it is another vehicle's; see --vehicle-system"
    if "HEARTBEAT" in names:
        return f"the vehicle sends no {MAVLINK_HEADING}; check its stream rates and that it hears us"
    return "there is no vehicle's HEARTBEAT; check which program sends there"
