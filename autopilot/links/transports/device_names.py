"""Serial devices by what does not change: the adapter's USB serial number, or a pattern (/dev/serial/by-id/*GPS*).

The kernel numbers ttyUSB0, ttyUSB1 in the order of plugging in; an adapter that was pulled may come back as another.
"""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable
from typing import Protocol

from autopilot.links.base import LinkError, NotThereError

USB = "usb="


class Port(Protocol):
    """What pyserial tells of a port."""

    device: str
    serial_number: str | None


def device_of(name: str, path: str, ports: Callable[[], Iterable[Port]] | None = None) -> str:
    """Return the device that `path` of the link `name` means now: usb=SERIAL, a pattern, or itself. LinkError."""
    if path.startswith(USB):
        return _by_serial_number(name, path.removeprefix(USB), ports or _ports)
    if "*" not in path and "[" not in path:
        return path
    found = sorted(glob.glob(path))  # noqa: PTH207 - a pattern of whole paths
    if len(found) == 1:
        (only,) = found
        return only
    if found:
        raise LinkError(f"{name}: {path} is {len(found)} devices ({', '.join(found)}); write more of the one meant")
    raise NotThereError(f"{name}: there is no device {path}; plug it in, or list the ports with `ls /dev/serial/by-id`")


def _by_serial_number(name: str, number: str, ports: Callable[[], Iterable[Port]]) -> str:
    """Return the first port of the adapter: some (flight controllers) have a second one for other purposes."""
    present = list(ports())
    found = sorted(port.device for port in present if port.serial_number == number)
    if found:
        return found[0]
    there = ", ".join(sorted({port.serial_number for port in present if port.serial_number})) or "none"
    raise NotThereError(f"{name}: no adapter with USB serial number {number}; plug it in (present are: {there})")


def _ports() -> Iterable[Port]:
    from serial.tools.list_ports import comports

    ports: Iterable[Port] = comports()
    return ports
