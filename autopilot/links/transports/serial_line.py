"""A serial port, or any terminal that behaves like one (a pseudo-terminal), opened exclusively, never blocking.

Serial devices by what does not change: the adapter's USB serial number, or a pattern (/dev/serial/by-id/*GPS*).

The kernel numbers ttyUSB0, ttyUSB1 in the order of plugging in; an adapter that was pulled may come back as another.
"""

from __future__ import annotations

import errno
import glob
import math
import os
import select
import termios
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import serial

from autopilot.links.base import LinkError, NotThereError, Transport
from autopilot.links.transports.medium import Medium, Scheme, WholeChunks, line

USB = "usb="


def device_of(name: str, path: str, ports: Callable[[], Iterable[Any]] | None = None) -> str:
    """Return the device that `path` of the link `name` means now: usb=SERIAL, a pattern, or itself. LinkError.

    ports: returns pyserial's view of what is plugged in, None: as it is now.
    """
    if path.startswith(USB):
        from serial.tools.list_ports import comports

        return _by_serial_number(name, path.removeprefix(USB), list((ports or comports)()))
    if "*" not in path and "[" not in path:
        return path
    found = sorted(glob.glob(path))  # noqa: PTH207 - a pattern of whole paths
    if len(found) == 1:
        (only,) = found
        return only
    if found:
        raise LinkError(f"{name}: {path} is {len(found)} devices ({', '.join(found)}); write more of the one meant")
    raise NotThereError(f"{name}: there is no device {path}; plug it in, or list the ports with `ls /dev/serial/by-id`")


def _by_serial_number(name: str, number: str, present: Sequence[Any]) -> str:
    """Return the first port of the adapter: some (flight controllers) have a second one for other purposes."""
    found = sorted(port.device for port in present if port.serial_number == number)
    if found:
        return str(found[0])
    there = ", ".join(sorted({port.serial_number for port in present if port.serial_number})) or "none"
    raise NotThereError(f"{name}: no adapter with USB serial number {number}; plug it in (present are: {there})")


BITS_A_BYTE = 10.0
"""Start bit, eight of data, stop bit."""
BY_USB = ("ttyACM", "cu.usbmodem", "tty.usbmodem")
"""What a board's own USB is called: no line is behind it, and whatever baud rate is typed means nothing."""
CHUNK_LIMIT = 4096
RECEIVE_LIMIT = 64


def carried(path: str, baud: int) -> float:
    """Return how many bytes a second the device `path` carries at most, inf where its `baud` rate does not tell."""
    device = os.path.realpath(path).rpartition("/")[2]
    return math.inf if device.startswith(BY_USB) else baud / BITS_A_BYTE


class SerialTransport(Transport):
    """Eight data bits, no parity, one stop bit, no flow control, at `baud`.

    `path` may be usb=SERIAL or a pattern, see `device_of`. Raises LinkError with the way out where the device is
    missing, forbidden, in use, or no serial port.
    """

    is_stream = True
    is_local = False
    """Nobody knows what is plugged in: a telemetry radio is open to everybody in its range."""

    bytes_per_s: float
    """What the line carries at most, inf where nobody knows."""

    def __init__(self, name: str, path: str, baud: int) -> None:
        self.name = name
        self.baud = baud
        self._path = path = device_of(name, path)
        self.bytes_per_s = carried(path, baud)
        self._closed = False
        self._chunks = WholeChunks(self._push)
        try:
            self._port = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise _open_error(name, path, baud, error) from error
        self._fd = int(self._port.fileno())
        self._poll = select.poll()
        self._poll.register(self._fd, 0)

    def fileno(self) -> int:
        """Return the port's descriptor, -1 when closed."""
        return -1 if self._closed else self._fd

    def receive(self) -> list[bytes]:
        """Return what has arrived; LinkError when the device is gone and nothing is left to read."""
        if self._closed:
            raise self._gone()
        chunks: list[bytes] = []
        for _ in range(RECEIVE_LIMIT):
            try:
                data = os.read(self._fd, CHUNK_LIMIT)
            except BlockingIOError:
                break
            except OSError as error:
                if not chunks:
                    raise self._gone() from error
                break
            if not data:
                # A terminal in raw mode answers "no bytes" both when it is idle and when it is gone.
                if not chunks and self._hung_up():
                    raise self._gone()
                break
            chunks.append(data)
        return chunks

    def send(self, data: bytes) -> bool:
        """Hand all of `data` to the driver or nothing; LinkError when the device is gone."""
        if self._closed or self._hung_up():
            raise self._gone()
        return self._chunks.send(data)

    def close(self) -> None:
        """Give the port back."""
        if not self._closed:
            self._closed = True
            self._port.close()

    def _push(self, data: bytes) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._gone() from error

    def _hung_up(self) -> bool:
        return bool(self._poll.poll(0))

    def _gone(self) -> LinkError:
        if self._closed:
            return LinkError(f"{self.name}: the link is closed; open it again")
        return LinkError(f"{self.name}: {self._path} is gone (unplugged?); plug it in again and restart")


def _open_error(name: str, path: str, baud: int, error: Exception) -> LinkError:
    code = getattr(error, "errno", None)
    if isinstance(error, termios.error):
        code = error.args[0]
    text = str(error)
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return NotThereError(f"{name}: there is no device {path}; plug it in, or list the ports with `ls /dev/tty*`")
    if code in (errno.EACCES, errno.EPERM):
        return LinkError(
            f"{name}: permission denied on {path}; add your user to the group dialout "
            "(sudo usermod -aG dialout $USER) and log in again"
        )
    if code in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK) or "exclusively lock" in text:
        return LinkError(f"{name}: {path} is in use by another program; stop that program first")
    if isinstance(error, ValueError):
        return LinkError(f"{name}: {baud} baud is not possible on {path}; use for example 4800, 38400 or 115200")
    if code in (errno.ENOTTY, errno.EINVAL, errno.EISDIR) or isinstance(error, termios.error) or "configure" in text:
        return LinkError(f"{name}: {path} is not a serial port; name a device such as /dev/ttyUSB0")
    return LinkError(f"{name}: cannot open {path}: {text}; check the device")


MEDIA = (
    Medium(
        "serial",
        (
            Scheme("serial", "mavlink", "serial:/dev/ttyUSB0:115200"),
            Scheme("nmea", "nmea", "nmea:/dev/ttyUSB1:4800"),
            Scheme("n2k:ydwg", "ydwg", "n2k:ydwg:/dev/ttyACM0", usual="115200"),
            Scheme("n2k:actisense", "actisense", "n2k:actisense:/dev/ttyUSB0", usual="115200"),
        ),
        line,
        lambda link, *_: SerialTransport(link.text, link.path, link.baud),
    ),
)
