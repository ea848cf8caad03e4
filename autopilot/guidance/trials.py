"""Zigzag manoeuvre: the rudder goes over each time the heading has swung past the execute angle.

ITTC 7.5-04-02-01: rudder to one side; when the heading has changed by psi_e from the base course, rudder to
the other side; and so on. Pure: the memory is the side the rudder is on.
"""

from __future__ import annotations

from autopilot.angles import wrap


def zigzag_side(side: int, base: float, heading: float, heading_change: float) -> int:
    """Return the side (+1 starboard, -1 port) the rudder belongs on; angles in rad, `heading_change` > 0."""
    swing = wrap(heading - base)
    if side * swing >= heading_change:
        return -side
    return side
