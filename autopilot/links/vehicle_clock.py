"""The vehicle's clock mapped to ours, from nothing but arrival times. Pure.

    local = boot + min over the last 10 to 20 s of (arrival - boot)

The message that came quickest tells the offset best, because delay only ever adds; what came slower keeps its
true age. The minimum is taken over two windows in turn, so that clock drift and a paused vehicle are followed.
"""

from __future__ import annotations

import math

WINDOW_S = 10.0
REBOOT_S = 1.0
"""Boot time this much behind the newest seen is a reboot; less is a message that came out of order."""
WRAP_S = 2.0**32 / 1000.0
"""time_boot_ms is 32 bits wide and begins again after 49.7 days."""


class VehicleClock:
    """Maps the vehicle's time since boot [s] to the local monotonic clock [s]."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the offset, as after a reboot."""
        self._newest = -math.inf
        self._heard = math.inf
        self._previous = math.inf
        self._current = math.inf
        self._window_end = -math.inf

    @property
    def known(self) -> bool:
        """Whether a message has been timed yet."""
        return self._newest > -math.inf

    @property
    def offset(self) -> float | None:
        """Local time less the vehicle's time since boot [s], None before the first message."""
        return min(self._previous, self._current) if self.known else None

    def rebooted(self, now: float, boot: float) -> bool:
        """Return whether `boot` [s], arrived at `now` [s], can only come from a vehicle that has started anew.

        Either it lies behind what was seen, or the vehicle started after it was last heard.
        """
        behind = self._newest - boot
        if behind > WRAP_S / 2.0:
            return False
        return behind > REBOOT_S or boot < now - self._heard

    def unheard(self) -> None:
        """Take that nobody listened for a while: the silence until the next message is ours, not the vehicle's."""
        self._heard = math.inf

    def local(self, now: float, boot: float) -> float:
        """Return the local time [s], never after `now`, at which the vehicle's clock showed `boot` [s].

        `now` [s] is when the message arrived.
        """
        if self._newest - boot > WRAP_S / 2.0:
            self.reset()  # the counter began again: so does the offset
        self._newest = max(self._newest, boot)
        self._heard = now
        offset = now - boot
        if now >= self._window_end:
            # After a silence longer than a window nothing old is worth keeping.
            self._previous = self._current if now < self._window_end + WINDOW_S else math.inf
            self._current = offset
            self._window_end = now + WINDOW_S
        elif offset < self._current:
            self._current = offset
        # the sum may round to a hair after the time it came from
        return min(now, boot + min(self._previous, self._current))
