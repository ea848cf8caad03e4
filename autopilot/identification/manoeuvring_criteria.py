"""The yardsticks of ship manoeuvrability beside a boat's measures. They are made for ships of 100 m and more.

IMO MSC.137(76), annex, section 5.3, and for the loop of the spiral MSC/Circ.1053, the explanatory notes to it.
L is the length [m], V the speed [m/s] at which the trial began.
"""

from __future__ import annotations

import math

SHIPS = "criteria of IMO MSC.137(76), made for ships of 100 m and more: a yardstick here, no verdict"
ADVANCE_LENGTHS = 4.5
TACTICAL_LENGTHS = 5.0
INITIAL_LENGTHS = 2.5
FIRST_OVERSHOOT_20 = math.radians(25.0)
TEN, TWENTY = math.radians(10.0), math.radians(20.0)
NEAR = math.radians(1.5)
"""A zigzag counts as 10/10 or 20/20 within this."""


def first_overshoot_10(length: float, speed: float) -> float:
    """Return the largest first overshoot [rad] of a 10/10 zigzag: 10 deg, 5 + L/V / 2, 20 deg."""
    return math.radians(min(max(5.0 + 0.5 * length / speed, 10.0), 20.0))


def second_overshoot_10(length: float, speed: float) -> float:
    """Return the largest second overshoot [rad] of a 10/10 zigzag: 25 deg, 17.5 + 0.75 L/V, 40 deg."""
    return math.radians(min(max(17.5 + 0.75 * length / speed, 25.0), 40.0))


def loop_width(length: float, speed: float) -> float:
    """Return the largest width [rad] of an unstable boat's loop: 0 below L/V of 9 s, (L/V)/3 - 3, 12 deg from 45 s."""
    return math.radians(min(max(length / speed / 3.0 - 3.0, 0.0), 12.0))


def zigzag_kind(rudder: float, execute: float) -> int:
    """Return 10 or 20 for a 10/10 or 20/20 zigzag (angles [rad]), 0 for others, which have no criterion."""
    for degrees, angle in ((10, TEN), (20, TWENTY)):
        if abs(rudder - angle) < NEAR and abs(execute - angle) < NEAR:
            return degrees
    return 0
