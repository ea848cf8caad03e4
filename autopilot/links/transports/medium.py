"""What a kind of transport says of itself: its URL schemes, how the place behind them is written, how it is opened.

And what may stand behind the `?` of a URL: `nmea:/dev/ttyUSB1:4800?steer=no&send=HDT:5,ROT:5`.

What UDP and TCP share is here, too: turning a host into an address, who may come in, and a refusal into a sentence; and
a CAN bus, which NMEA 2000 goes over: no stream of bytes, so that `autopilot.links.n2k.link` opens it itself.
"""

from __future__ import annotations

import errno
import fcntl
import ipaddress
import math
import socket
import struct
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

from autopilot.errors import InputError
from autopilot.links.base import LinkError, NotThereError, Transport

Network: TypeAlias = ipaddress.IPv4Network | ipaddress.IPv6Network
Allows: TypeAlias = Callable[[str], bool]
"""Says of an address whether it may come in."""
MAY_COME = (
    *(errno.EADDRNOTAVAIL, errno.ECONNREFUSED, errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ETIMEDOUT),
    *(errno.ENETDOWN, errno.EHOSTDOWN, errno.ECONNRESET),
)
"""Errors of an address that is not there yet: a program that is about to start, a network that comes up."""
SIOCGIFADDR = 0x8915
"""Linux's ioctl for the IPv4 address of an interface (linux/sockios.h)."""
IFREQ = struct.Struct("16s2s2x4s16x")


def everyone(address: str) -> bool:
    """Let every address in."""
    return True


def only_from(networks: Sequence[Network]) -> Allows:
    """Return what lets in the addresses of `networks` alone; every address where none is named."""
    if not networks:
        return everyone

    def allows(address: str) -> bool:
        found = ipaddress.ip_address(address.partition("%")[0])
        mapped = getattr(found, "ipv4_mapped", None)
        return any((mapped or found) in network for network in networks)

    return allows


def network_of(text: str) -> Network:
    """Return the network that `text` names: an address, or an address and a prefix length. Raises ValueError."""
    return ipaddress.ip_network(text)


def is_everywhere(host: str) -> bool:
    """Return whether listening on `host` means listening on every interface."""
    try:
        return ipaddress.ip_address(host.partition("%")[0]).is_unspecified
    except ValueError:
        return False


def is_loopback(address: str) -> bool:
    """Return whether only programs of this machine can be at an address: 127.0.0.0/8, ::1."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    return (getattr(found, "ipv4_mapped", None) or found).is_loopback


def interface_address(name: str) -> str | None:
    """Return the IPv4 address of a network interface such as wlan0; None where there is none of that name."""
    if name not in (interface for _, interface in socket.if_nameindex()):
        return None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        try:
            answer = fcntl.ioctl(asking.fileno(), SIOCGIFADDR, IFREQ.pack(name.encode(), b"", b""))
        except OSError:
            return None
    return socket.inet_ntoa(answer[20:24])


def peer_of(transport: object) -> str:
    """Return the address of who is, or was last, at the other end of a listening transport; '' where none is known."""
    peer = getattr(transport, "peer", None)
    if not peer:
        return ""
    host, port = peer[:2]
    return f"[{host}]:{port}" if ":" in str(host) else f"{host}:{port}"


def disconnect(sock: socket.socket) -> None:
    """Let a connected UDP socket hear everybody again, at the port it has. Python itself has no way to say so."""
    bound = sock.getsockname()
    import ctypes

    ctypes.CDLL(None).connect(sock.fileno(), bytes(16), 16)  # 16 zeros: an address of the family AF_UNSPEC, see udp(7)
    if sock.getsockname()[1] != bound[1]:
        sock.bind(bound)  # Linux forgets a port that it chose itself


def resolve(name: str, host: str, port: int, kind: int, passive: bool) -> tuple[int, Any]:
    """Return (family, address) of `host` and `port`; LinkError where the host cannot be found.

    `name` is the link's URL for the message, `kind` the socket type; `passive` addresses are listened on, and may be
    given by the name of an interface.
    """
    if passive:
        host = interface_address(host) or host
    try:
        found = socket.getaddrinfo(host, port, type=kind)
    except (OSError, UnicodeError) as error:
        raise LinkError(f"{name}: host {host!r} is not known ({error}); write an address such as 127.0.0.1") from error
    family, _, _, _, address = found[0]
    return family, address


def open_error(name: str, error: OSError, doing: str, host: str, port: int) -> LinkError:
    """Return the sentence for an `error` met while trying to listen at or reach (`doing`) host and port."""
    advice = {
        errno.EADDRINUSE: "the port is in use by another program; stop that program or choose another port",
        errno.EADDRNOTAVAIL: "this machine does not have that address; use one of its own, or an interface (wlan0)",
        errno.EACCES: "permission denied; choose a port above 1023 and an address you may use",
        errno.ECONNREFUSED: "connection refused, nothing listens there; start the other side first or correct the port",
        errno.ENETUNREACH: "the network cannot be reached; check cable, Wi-Fi and address",
        errno.EHOSTUNREACH: "the host cannot be reached; check cable, Wi-Fi and address",
        errno.ETIMEDOUT: "no answer in time; check that the host is on and the address is right",
    }
    code = errno.ETIMEDOUT if isinstance(error, TimeoutError) else error.errno
    reason = advice.get(code or 0, f"{error.strerror or error}; check the address")
    kind = NotThereError if code in MAY_COME else LinkError
    return kind(f"{name}: cannot {doing} {host} port {port}: {reason}")


SENTENCES = ("HDG", "HDT", "HTD", "ROT", "RSA", "XDR")
"""Sentences that a link can be asked to send, by their types."""
RATE_MIN, RATE_MAX = 0.1, 50.0
FORWARD_RATE_MIN, FORWARD_RATE_MAX = 0.01, 1000.0
"""Of a message that is passed on [Hz]; 0 stands for never."""
DEFAULT_RATE = 1.0
BAUD_MIN, BAUD_MAX = 300, 4_000_000


class UrlOptions(NamedTuple):
    """steers: whether rudder orders leave on this link.  sends: sentence type and rate [Hz] of what is repeated.

    talker: the two letters before the type of what is repeated.  allow: who may come in; empty: everybody.
    orders: whether other nodes of an NMEA 2000 network may engage the pilot and change its course.
    rates: MAVLink message and rate [Hz] at which it is passed on at most.  sources: system and component ids whose
    messages are passed on, 0: any component; empty: everybody's.
    """

    steers: bool = True
    sends: tuple[tuple[str, float], ...] = ()
    talker: str = "AG"
    allow: tuple[Network, ...] = ()
    orders: bool = False
    rates: tuple[tuple[str, float], ...] = ()
    sources: tuple[tuple[int, int], ...] = ()


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
        """Return what stands behind the colon as a whole number. InputError where it is none from `low` to `high`."""
        digits = self.behind
        value = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 9 else -1
        if not low <= value <= high:
            raise InputError(
                f"link {self.text!r}: {what} {digits!r} is not a whole number from {low} to {high}; "
                f"write it like {self.example}"
            )
        return value

    def host(self) -> str:
        """Return the host before the colon, of an IPv6 address without its brackets. InputError where it is none."""
        place = self.before
        bracketed = place.startswith("[") and place.endswith("]")
        host = place[1:-1] if bracketed else place
        if not host or (":" in host and not bracketed) or any(c.isspace() or c in "/[]" for c in host):
            raise InputError(f"link {self.text!r}: host {place!r} is not an address; write it like {self.example}")
        return host


Accepts = Callable[[bytes], bool]
"""Says of a datagram whether it is of the protocol that is spoken."""


class Scheme(NamedTuple):
    """The beginning of a URL, what is spoken over it, an example, and the baud rate where none is written."""

    name: str
    protocol: str
    example: str
    usual: str = ""


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


class WholeChunks:
    """Sends all of a chunk or nothing on a stream that may take a part: its rest goes before the next.

    `push` returns how many bytes were taken.
    """

    def __init__(self, push: Callable[[bytes], int]) -> None:
        self._push = push
        self.unsent = b""

    def send(self, data: bytes) -> bool:
        """Send `data`; False where nothing of it was taken."""
        if self.unsent:
            self.unsent = self.unsent[self._push(self.unsent) :]
            if self.unsent:
                return False
        sent = self._push(data)
        if sent == 0:
            return not data
        self.unsent = bytes(data[sent:])
        return True


def parse_options(text: str, query: str, allowed: tuple[str, ...]) -> UrlOptions:
    """Return the options of `query`, the part of the URL `text` behind its `?`. Raises InputError."""
    options = UrlOptions()
    seen: set[str] = set()
    for item in query.split("&"):
        name, _, value = item.partition("=")
        if name not in allowed or name in seen:
            offer = f"allowed here, once each, are {', '.join(allowed)}" if allowed else "this kind of link takes none"
            raise InputError(f"link {text!r}: option {name!r} behind the ? is unknown or repeated; {offer}")
        seen.add(name)
        if name in ("steer", "orders"):
            if value not in ("yes", "no"):
                raise InputError(f"link {text!r}: {name} is {value!r}; write {name}=yes or {name}=no")
            is_wanted = value == "yes"
            options = options._replace(steers=is_wanted) if name == "steer" else options._replace(orders=is_wanted)
        elif name == "talker":
            if not (len(value) == 2 and value.isascii() and value.isalpha() and value.isupper()):
                raise InputError(f"link {text!r}: talker is {value!r}; write two capital letters, such as talker=II")
            options = options._replace(talker=value)
        elif name == "allow":
            options = options._replace(allow=tuple(_network(text, item) for item in value.split(",")))
        elif name == "rate":
            options = options._replace(rates=_forward_rates(text, value))
        elif name == "from":
            options = options._replace(sources=tuple(_source(text, item) for item in value.split(",")))
        else:
            options = options._replace(sends=_sends(text, value))
    return options


def _network(text: str, value: str) -> Network:
    try:
        return network_of(value)
    except ValueError as error:
        raise InputError(
            f"link {text!r}: {value!r} is no network ({error}); write addresses or networks, such as "
            "allow=192.168.1.20,10.0.0.0/24"
        ) from None


def _forward_rates(text: str, value: str) -> tuple[tuple[str, float], ...]:
    rates: dict[str, float] = {}
    for item in value.split(","):
        name, _, digits = item.partition(":")
        rate = _plain_number(digits)
        if not name or name in rates or not (rate == 0.0 or FORWARD_RATE_MIN <= rate <= FORWARD_RATE_MAX):
            raise InputError(
                f"link {text!r}: {item!r} is no message with its rate, or is named twice; write rate= and "
                f"messages, each with 0 (never) or {FORWARD_RATE_MIN:g} to {FORWARD_RATE_MAX:g} Hz, such as "
                "rate=ATTITUDE:2,others:1"
            )
        rates[name] = rate
    return tuple(rates.items())


def _source(text: str, value: str) -> tuple[int, int]:
    system, colon, component = value.partition(":")
    ids = [int(digits) if _plain_number(digits) <= 255.0 and digits.isdigit() else 0 for digits in (system, component)]
    if not ids[0] or (colon and not ids[1]):
        raise InputError(
            f"link {text!r}: {value!r} is no sender; write system ids, with a component id or without, from 1 to 255, "
            "such as from=1:191,2"
        )
    return ids[0], ids[1]


def _plain_number(digits: str) -> float:
    """Return what the digits say, nan where they are none."""
    is_plain = digits.isascii() and digits.replace(".", "", 1).isdigit() and len(digits) <= 8
    return float(digits) if is_plain else math.nan


def _sends(text: str, value: str) -> tuple[tuple[str, float], ...]:
    sends: dict[str, float] = {}
    for item in value.split(","):
        name, colon, rate = item.partition(":")
        if name not in SENTENCES or name in sends:
            raise InputError(
                f"link {text!r}: sentence {name!r} cannot be sent or is named twice; "
                f"write send= and some of {', '.join(SENTENCES)}, each with its rate in Hz, such as send=HDT:5,RSA:2"
            )
        sends[name] = _rate(text, name, rate) if colon else DEFAULT_RATE
    return tuple(sends.items())


def _rate(text: str, name: str, digits: str) -> float:
    rate = _plain_number(digits)
    if not RATE_MIN <= rate <= RATE_MAX:
        raise InputError(
            f"link {text!r}: the rate {digits!r} of {name} is not a number from {RATE_MIN:g} to {RATE_MAX:g} (Hz)"
        )
    return rate


def _bus(written: Written) -> Place:
    """Return python-can's interface and channel."""
    if not written.behind or any(c.isspace() for c in written.before + written.behind):
        raise InputError(f"link {written.text!r}: incomplete; write it like {written.example}")
    if ":" in written.before:
        raise InputError(
            f"link {written.text!r}: {written.before.partition(':')[0]!r} is no kind of NMEA 2000 gateway; write it "
            f"like n2k:ydwg-tcp:HOST:PORT, n2k:actisense:/dev/ttyUSB0, or {written.example} for a CAN bus"
        )
    return Place(host=written.before, path=written.behind)


def _refuse(link: LinkUrl, accepts: Accepts, allows: Allows) -> Transport:
    raise InputError(f"link {link.text!r}: a CAN bus is no stream of bytes; use it with autopilot run")


MEDIA = (Medium("can", (Scheme("n2k", "n2k", "n2k:socketcan:can0"),), _bus, _refuse),)
