"""The flight controller's TCP server: what it has not worked off when the other side hangs up is lost.

ArduPilot takes bytes from a socket into a buffer and works that off in its own loop; a connection that breaks is closed
at once, with all that still waits (libraries/AP_HAL_SITL/UARTDriver.cpp). So what arrives here is handed over a moment
later, and not at all where the connection no longer stands by then.
"""

from __future__ import annotations

from collections.abc import Callable

from autopilot.links.transports import TcpServerTransport

WAITS_S = 0.02
"""From the arrival of a byte to its turn."""


class FirmwareTcpServer:
    """A `Transport` round a TCP server that forgets what a client left behind; `clock`: the firmware's time [s]."""

    is_stream = True

    def __init__(self, inside: TcpServerTransport, clock: Callable[[], float]) -> None:
        self.name = inside.name
        self.is_local = inside.is_local
        self._inside = inside
        self._clock = clock
        self._waiting: list[tuple[float, bytes]] = []

    def fileno(self) -> int:
        """Return the descriptor of the server inside."""
        return self._inside.fileno()

    def receive(self) -> list[bytes]:
        """Return what the client, still connected, sent a moment ago. LinkError when closed."""
        now = self._clock()
        self._waiting += [(now + WAITS_S, chunk) for chunk in self._inside.receive()]
        if not self._inside.connected:
            self._waiting = []
        ready = [chunk for due, chunk in self._waiting if due <= now]
        del self._waiting[: len(ready)]
        return ready

    def send(self, data: bytes) -> bool:
        """Pass on."""
        return self._inside.send(data)

    def forget_peer(self) -> None:
        """Hang up, and drop what came from there."""
        self._waiting = []
        self._inside.forget_peer()

    def close(self) -> None:
        """Pass on."""
        self._inside.close()
