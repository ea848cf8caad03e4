"""What a service manager is told: ready, alive, why not well, leaving. Without one nothing is sent.

The protocol is sd_notify(3) of systemd: datagrams of VARIABLE=value lines to the socket named in NOTIFY_SOCKET. Signs
of life come from the tick and from no other place: when it hangs they stop, and after WatchdogSec the manager aborts
the process and starts another.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Callable, Mapping

from autopilot.alarm_words import sentences_of
from autopilot.signals import Tick

FEEDS_A_PERIOD = 4
"""Signs of life in the time that the manager waits for one: systemd asks for two."""


class ServiceManager:
    """Tells the service manager of `environ` how the loop is. Nothing here raises or waits.

    Args:
        environ: NOTIFY_SOCKET names the socket; WATCHDOG_USEC how often life must be shown, WATCHDOG_PID by whom.
        clock: seconds of a clock that never goes backwards.
    """

    def __init__(self, environ: Mapping[str, str] = os.environ, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._address = _address(environ.get("NOTIFY_SOCKET", ""))
        period = _microseconds(environ.get("WATCHDOG_USEC", ""))
        is_for_us = environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.feeding_s = period / FEEDS_A_PERIOD if is_for_us else 0.0
        self._next = 0.0
        self._status = ""
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def ticked(self, tick: Tick) -> None:
        """Show that the loop lives, at the first tick that it is ready, and its mode and alarms when they change."""
        if self._socket is None:
            return
        lines = []
        status = "; ".join((tick.mode.name, *sentences_of(tick.alarms)))
        if not self._status:
            lines.append("READY=1")
        if status != self._status:
            self._status = status
            lines.append(f"STATUS={' '.join(status.split())}")
        now = self._clock()
        if self.feeding_s and now >= self._next:
            self._next = now + self.feeding_s
            lines.append("WATCHDOG=1")
        self._send(lines)

    def close(self) -> None:
        """Say that the process ends; further calls do nothing."""
        self._send(["STOPPING=1"])
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, lines: list[str]) -> None:
        if self._socket is not None and lines:
            # a manager that does not listen will abort us; that is its part
            with contextlib.suppress(OSError):
                self._socket.sendto("\n".join(lines).encode(), self._address)


def _address(name: str) -> str:
    """Return the socket's address: a path, or a name in the abstract namespace, which begins with @."""
    if name.startswith("@"):
        return "\0" + name[1:]
    return name if name.startswith("/") else ""


def _microseconds(text: str) -> float:
    return int(text) * 1.0e-6 if text.isascii() and text.isdigit() and len(text) < 19 else 0.0
