"""The vehicle's clock, mapped to ours from nothing but arrival times. Pure.

    local = boot + min over the last 10 to 20 s of (arrival - boot)

The message that came quickest tells the offset best, because delay only ever adds; what came slower keeps its
true age. The minimum is taken over two windows in turn, so that clock drift and a paused vehicle are followed.
"""

from __future__ import annotations

import math
from collections import deque
from enum import Enum

from autopilot.links.mavlink.overrides import STRAGGLER_S

WINDOW_S = 10.0
REBOOT_S = 1.0
"""A message this much behind the newest seen is none that other messages have merely overtaken."""
AHEAD_S = 10.0
"""A message that seems to come from so far in the future is not of the clock that is followed."""
STRANGE_MESSAGES, STRANGE_WITHIN_S = 5, 2.0
"""So many messages of another clock within this time: it is the vehicle's now. Fewer are stragglers, such as doubles
that came by a slower way."""
STRANGE_ALIKE_S, STRANGE_AMONG = 0.1, 3
"""Clocks run: five messages of one tell the same of it, to within what a quick way differs by. Stragglers came each by
a way of its own, and few among many: the five are not one in more than so many."""
STRANGE_ALONE_S = 3.0
"""Where nothing else has come for so long, five are another clock's however unlike: a line brings them in bursts, and
holds none of before for longer than 2.5 s."""
WRAP_S = 2.0**32 / 1000.0
"""time_boot_ms is 32 bits wide and begins again after 49.7 days."""
WRAPPED_S = WRAP_S - 60.0
"""Less than this behind is none that began again, but a vehicle that has started anew."""


class Belongs(Enum):
    """What a message's time since boot tells of the vehicle."""

    OURS = "the clock that is followed"
    STRANGE = "another clock's, or far too late: of no use"
    REBOOTED = "the vehicle has started anew"


class VehicleClock:
    """Maps the vehicle's time since boot [s] to the local monotonic clock [s].

    Attributes:
        offset: local time less the vehicle's time since boot [s], None before the first message.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the offset, as after a reboot."""
        self._newest = -math.inf
        self._strange: deque[tuple[float, float, int]] = deque(maxlen=STRANGE_MESSAGES)
        self._judged = 0
        self._alone_since = math.inf
        self._received = math.inf
        self._previous = self._current = self._least = math.inf
        self._window_end = -math.inf
        self.offset: float | None = None

    def judge(self, now: float, boot: float) -> Belongs:
        """Return whether a message of `boot` [s], arrived at `now` [s], is of the clock that is followed.

        One that lies far behind what was seen is of a vehicle that has started anew where it can have started since it
        was last heard. Else it is a straggler, unless more like it follow. So is one from before the counter began
        again that those since then have overtaken.
        """
        self._judged += 1
        behind = self._newest - boot
        if behind > WRAPPED_S:
            return Belongs.OURS
        if -WRAP_S <= behind < AHEAD_S - WRAP_S:
            return Belongs.STRANGE
        silence = now - self._received
        is_behind, least = behind > REBOOT_S, self._least
        if boot < silence and (is_behind or now - boot - least > REBOOT_S):
            return Belongs.REBOOTED
        if not is_behind and (self._newest == -math.inf or boot + least <= now + AHEAD_S):
            return Belongs.OURS
        self._strange.append((now, now - boot, self._judged))
        self._alone_since = min(self._alone_since, now)
        is_new = behind > STRAGGLER_S and boot < silence + REBOOT_S
        return Belongs.REBOOTED if is_new or self._is_another_clock() else Belongs.STRANGE

    def _is_another_clock(self) -> bool:
        """Whether the newest strange messages are of one clock that runs."""
        if len(self._strange) < STRANGE_MESSAGES:
            return False
        times, offsets, numbers = zip(*self._strange, strict=True)
        if times[-1] - self._alone_since > STRANGE_ALONE_S and times[0] >= self._alone_since:
            return True
        return bool(
            times[-1] - times[0] <= STRANGE_WITHIN_S
            and max(offsets) - min(offsets) <= STRANGE_ALIKE_S
            and numbers[-1] - numbers[0] <= STRANGE_AMONG * STRANGE_MESSAGES
        )

    def silence(self) -> None:
        """Take that nobody listened for a while: the silence until the next message is ours, not the vehicle's."""
        self._received = math.inf

    def local(self, now: float, boot: float) -> float:
        """Return the local time [s], never after `now`, at which the vehicle's clock showed `boot` [s].

        `now` [s] is when the message arrived.
        """
        if self._newest - boot > WRAPPED_S:
            self.reset()  # the counter began again: so does the offset
        if boot > self._newest:
            self._newest = boot
        self._received, self._alone_since = now, math.inf
        offset = now - boot
        if now >= self._window_end:
            # After a silence longer than a window nothing old is worth keeping.
            self._previous = self._current if now < self._window_end + WINDOW_S else math.inf
            self._current = offset
            self._window_end = now + WINDOW_S
        elif offset < self._current:
            self._current = offset
        self.offset = self._least = self._previous if self._previous < self._current else self._current
        # the sum may round to a hair after the time it came from
        time = boot + self._least
        return time if time < now else now
