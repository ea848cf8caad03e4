"""Whether the flight controller shows the order that it was given: where it does not, somebody else steers, too."""

from __future__ import annotations

import math
from collections import deque

from autopilot.signals import RudderSample

REMEMBERED_S = 1.5
"""A report is of one of the orders of this time [s]: it comes at 5 to 10 Hz and is as old as the link."""
TOLERANCE = math.radians(3.0)
"""Dead zone and whole microseconds move an order by less [rad]."""
BELIEVED_S = 1.0
"""A report that is older [s] proves nothing."""


class ShownOrder:
    """Compares what the steering gear was told, as reported, with what we told it of late."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._told: deque[tuple[float, float]] = deque()
        self._shown: RudderSample | None = None

    def hear(self, sample: RudderSample) -> None:
        """Take a report of an order."""
        self._shown = sample

    def is_anothers(self, now: float, told: float) -> bool:
        """Return whether the report in force at `now` [s] is of no order of ours; `told` [rad]: the latest of these."""
        orders = self._told
        orders.append((now, told))
        while orders[0][0] < now - REMEMBERED_S:
            orders.popleft()
        if self._shown is None or now - self._shown.time > BELIEVED_S:
            return False
        angles = [angle for _, angle in orders]
        return not min(angles) - TOLERANCE <= self._shown.angle <= max(angles) + TOLERANCE
