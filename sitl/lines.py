"""Lines that end at the simulator: a pseudo-terminal as a serial port, and the flight controller's TCP server.

The flight controller's TCP server: what it has not worked off when the other side hangs up is lost.

ArduPilot takes bytes from a socket into a buffer and works that off in its own loop; a connection that breaks is closed
at once, with all that still waits (libraries/AP_HAL_SITL/UARTDriver.cpp). So what arrives here is handed over a moment
later, and not at all where the connection no longer stands by then.

A pseudo-terminal that stands for a serial port, found by a link at a path of the user's choice.
"""

from __future__ import annotations

import fcntl
import os
import struct
import termios
import tty
import zlib
from collections.abc import Callable
from pathlib import Path

from autopilot.links.base import LinkError, Transport
from autopilot.links.transports import TcpServerTransport

CHUNK_LIMIT = 4096


class PtyTransport(Transport):
    """The instrument's end of a pseudo-terminal; the other end opens `path` as if it were /dev/ttyUSB0.

    A path that exists is refused, unless it is a link that a run which was killed has left: it leads nowhere, or, as
    numbers of terminals are given again, to somebody else's.
    """

    is_stream = True
    is_local = True

    def __init__(self, path: str) -> None:
        self.name = path
        self.dropped = 0
        self._path = Path(path)
        if _is_left_over(self._path):
            self._path.unlink()
        self._master, self._slave = os.openpty()
        os.set_blocking(self._master, False)
        tty.setraw(self._slave, termios.TCSANOW)
        _lock(self._slave, self._path)
        try:
            self._path.symlink_to(OURS + Path(os.ttyname(self._slave)).name)
        except OSError as error:
            self._close_descriptors()
            raise LinkError(
                f"{path}: cannot put the pseudo-terminal there: {error.strerror}; "
                "name a path that does not exist yet, in a folder you may write to"
            ) from error

    def fileno(self) -> int:
        """Return the descriptor to wait on, -1 when closed."""
        return self._master

    def receive(self) -> list[bytes]:
        """Return the bytes that wait, as one chunk; [] when none."""
        try:
            data = os.read(self._master, CHUNK_LIMIT)
        except BlockingIOError:
            return []
        except OSError as error:
            raise LinkError(f"{self.name}: the pseudo-terminal is gone: {error.strerror}; start again") from error
        return [data] if data else []

    def send(self, data: bytes) -> bool:
        """Send `data`; with nobody reading at the other end, what does not fit is lost, as on a wire."""
        try:
            sent = os.write(self._master, data)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise LinkError(f"{self.name}: the pseudo-terminal is gone: {error.strerror}; start again") from error
        self.dropped += len(data) - sent
        return sent == len(data)

    def close(self) -> None:
        """Remove the link and close both ends."""
        if self._master < 0:
            return
        self._path.unlink(missing_ok=True)
        self._close_descriptors()

    def _close_descriptors(self) -> None:
        os.close(self._master)
        os.close(self._slave)
        self._master = -1


OURS = "/dev/pts/./"
"""How a link of ours is spelled: another program's stays, whoever holds the terminal."""


def _lock(terminal: int, path: Path) -> None:
    """Show others that this open terminal is in use as `path` (fcntl(2), F_OFD_SETLK, at a place of the path's own;
    flock is for who opens the terminal as a port). Raises OSError."""
    # one link, by whatever way to its folder somebody writes it
    folder = os.path.realpath(path.parent)
    place = zlib.crc32(os.fsencode(Path(folder, path.name)))
    fcntl.fcntl(terminal, fcntl.F_OFD_SETLK, struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, place, 1, 0))


def _is_left_over(path: Path) -> bool:
    if not path.is_symlink():
        return False
    if not path.exists():
        return True
    if not os.readlink(path).startswith(OURS):  # noqa: PTH115 - a Path would lose how it is spelled
        return False
    try:
        terminal = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        _lock(terminal, path)
    except OSError:
        return False
    finally:
        os.close(terminal)
    return True


WAITS_S = 0.02
"""From the arrival of a byte to its turn."""


class FirmwareTcpServer:
    """A `Transport` round a TCP server that forgets what a client left behind; `clock`: the firmware's time [s]."""

    is_stream = True

    def __init__(self, inside: TcpServerTransport, clock: Callable[[], float]) -> None:
        self.name = inside.name
        self.is_local = inside.is_local
        self._inside, self._clock = inside, clock
        self.fileno, self.send, self.close = inside.fileno, inside.send, inside.close
        self._waiting: list[tuple[float, bytes]] = []

    def receive(self) -> list[bytes]:
        """Return what the client, still connected, sent a moment ago. LinkError when closed."""
        now = self._clock()
        self._waiting += [(now + WAITS_S, chunk) for chunk in self._inside.receive()]
        if not self._inside.connected:
            self._waiting = []
        ready = [chunk for due, chunk in self._waiting if due <= now]
        del self._waiting[: len(ready)]
        return ready

    def forget_peer(self) -> None:
        """Hang up, and drop what came from there."""
        self._waiting = []
        self._inside.forget_peer()
