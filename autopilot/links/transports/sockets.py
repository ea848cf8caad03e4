"""What UDP and TCP share: turning a host into an address, and a refusal into a sentence."""

from __future__ import annotations

import errno
import socket
from typing import Any

from autopilot.links.base import LinkError


def resolve(name: str, host: str, port: int, kind: int, passive: bool) -> tuple[int, Any]:
    """Return (family, address) of `host` and `port`; LinkError where the host cannot be found.

    `name` is the link's URL for the message, `kind` the socket type; `passive` addresses are listened on.
    """
    flags = socket.AI_PASSIVE if passive else 0
    try:
        found = socket.getaddrinfo(host, port, type=kind, flags=flags)
    except (OSError, UnicodeError) as error:
        raise LinkError(f"{name}: host {host!r} is not known ({error}); write an address such as 127.0.0.1") from error
    family, _, _, _, address = found[0]
    return family, address


def open_error(name: str, error: OSError, doing: str, host: str, port: int) -> LinkError:
    """Return the sentence for an `error` met while trying to listen at or reach (`doing`) host and port."""
    advice = {
        errno.EADDRINUSE: "the port is in use by another program; stop that program or choose another port",
        errno.EADDRNOTAVAIL: "this machine does not have that address; use 0.0.0.0 or one of its own addresses",
        errno.EACCES: "permission denied; choose a port above 1023 and an address you may use",
        errno.ECONNREFUSED: "connection refused, nothing listens there; start the other side first or correct the port",
        errno.ENETUNREACH: "the network cannot be reached; check cable, Wi-Fi and address",
        errno.EHOSTUNREACH: "the host cannot be reached; check cable, Wi-Fi and address",
        errno.ETIMEDOUT: "no answer in time; check that the host is on and the address is right",
    }
    code = errno.ETIMEDOUT if isinstance(error, TimeoutError) else error.errno
    reason = advice.get(code or 0, f"{error.strerror or error}; check the address")
    return LinkError(f"{name}: cannot {doing} {host} port {port}: {reason}")
