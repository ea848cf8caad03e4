"""Serving the physics to ArduPilot's simulator over UDP, in lock-step with it."""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable

from autopilot.errors import InputError
from autopilot.links.base import LinkError
from autopilot.links.transports.sockets import is_everywhere
from sitl.wire_ardupilot_json import ArdupilotPhysics

DATAGRAM_LIMIT = 4096
WAIT_S = 0.2
"""How long a stop may have to wait for a packet."""


def open_socket(address: str) -> socket.socket:
    """Return a UDP socket listening at HOST:PORT. Raises InputError and LinkError."""
    host, _, digits = address.rpartition(":")
    port = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 5 else -1
    if not host or not 0 <= port <= 65535:
        raise InputError(f"--listen {address}: write HOST:PORT, such as 127.0.0.1:9002.")
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        line.bind((host, port))
    except OSError as error:
        line.close()
        raise LinkError(
            f"--listen {address}: cannot listen there: {error.strerror or error}; stop what uses the port, or choose "
            "another and give ArduPilot the same (--sim-port-out)"
        ) from error
    if is_everywhere(host):
        print(f"--listen {address} listens on every network of this machine; name one address instead", file=sys.stderr)
    line.settimeout(WAIT_S)
    return line


def serve_physics(
    line: socket.socket, physics: ArdupilotPhysics, duration: float | None, should_stop: Callable[[], bool]
) -> None:
    """Answer servo packets until `should_stop` or for `duration` simulated seconds; complain once of other packets."""
    while not should_stop() and (duration is None or physics.time < duration):
        try:
            data, sender = line.recvfrom(DATAGRAM_LIMIT)
        except (TimeoutError, ConnectionRefusedError):
            continue
        reply = physics.answer(data)
        if reply:
            line.sendto(reply, sender)
            if physics.frames == 1 and not physics.repeated:
                print(f"ArduPilot at {sender[0]}:{sender[1]} has connected", flush=True)
        elif physics.bad == 1:
            print(
                f"sitl: a datagram of {len(data)} bytes is no servo packet of ArduPilot; start ArduPilot with "
                "--model JSON:127.0.0.1",
                file=sys.stderr,
            )
