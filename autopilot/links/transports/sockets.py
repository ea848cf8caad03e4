"""What UDP and TCP share: turning a host into an address, who may come in, and a refusal into a sentence."""

from __future__ import annotations

import errno
import fcntl
import ipaddress
import socket
import struct
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from autopilot.links.base import LinkError, NotThereError

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
