"""Sine and cosine that numba compiles into the loop itself: no call, no branch, both for little more than one.

The angle is brought to r within pi/4 of a multiple k of pi/2, which is taken off in three parts so that no digit is
lost (Cody and Waite 1980), and the series of sin r and cos r go to r^15 and r^16: parts in 1e16, for angles up to
1e6, from where on the first two parts are no longer taken off exactly. The plain loop has the C library's.
"""

from __future__ import annotations

import math

PER_ANGLE = 2.0 / math.pi
FIRST = float.fromhex("0x1.921fb54400000p+0")
SECOND = float.fromhex("0x1.0b4611a600000p-34")
THIRD = float.fromhex("0x1.3198a2e037073p-69")
"""Half of pi to 33 binary digits, the next 33, and the rest."""


def sine(angle: float) -> float:
    """Return sin `angle` [rad]."""
    k = math.floor(angle * PER_ANGLE + 0.5)
    r = ((angle - k * FIRST) - k * SECOND) - k * THIRD
    value = _cosine_near(r * r) if k & 1 else _sine_near(r)
    return -value if k & 2 else value


def cosine(angle: float) -> float:
    """Return cos `angle` [rad]."""
    k = math.floor(angle * PER_ANGLE + 0.5)
    r = ((angle - k * FIRST) - k * SECOND) - k * THIRD
    value = _sine_near(r) if k & 1 else _cosine_near(r * r)
    return -value if (k + 1) & 2 else value


# both series are summed in pairs: one after the other, their terms would wait for each other


def _sine_near(r: float) -> float:
    q = r * r
    q2 = q * q
    low = (-1 / 6 + q * (1 / 120)) + q2 * (-1 / 5040 + q * (1 / 362880))
    high = (-1 / 39916800 + q * (1 / 6227020800)) - q2 * (1 / 1307674368000)
    return r + (r * q) * (low + (q2 * q2) * high)


def _cosine_near(q: float) -> float:
    q2 = q * q
    q4 = q2 * q2
    low = (-0.5 + q * (1 / 24)) + q2 * (-1 / 720 + q * (1 / 40320))
    high = (-1 / 3628800 + q * (1 / 479001600)) + q2 * (-1 / 87178291200 + q * (1 / 20922789888000))
    return 1.0 + q * (low + q4 * high)
