"""Whether the steering gear is the one in the vessel file: a check that goes before any good word about a model.

Where a sensor shows the rudder, its angles at rest stand beside those ordered: their ratio is the scale, and where only
the large orders fall short there is the end stop; how fast it slews is measured. Where nothing shows it, the angles
cannot be checked: K counts degrees as they are ordered, and orders go out by the same scale. Its rate then shows in how
the boat turns (`autopilot.identification.ordered_rudder`), if half of it would have been noticed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.ordered_rudder import shows_rate
from autopilot.identification.rudder_path import RudderRate
from autopilot.identification.runs import FloatArray, Orders, Run

SCALE_OFF = 0.15
"""An angle off by more than this share contradicts its order: half of the 30 % that designed gains bear."""
LEAST_OFF = math.radians(1.5)
"""Less than this [rad] a drive's dead band or a sensor's zero may be."""
RATE_OFF = 0.15
"""A measured rate slower than the file's by more than this share, and by three standard errors, contradicts it."""
STANDS_S, LOOKED_AT_S = 2.0, 1.0
"""An order has to stand so long [s]; angles at rest are medians over the other [s], the last two of it."""
STANDS, RESTS = math.radians(0.1), math.radians(0.5)
"""Orders within the one are the same, angles within the other at rest."""
LARGE, SMALL = 0.9, 0.7
"""Shares of the largest order: from the one on an end stop may be met, below the other none is."""
UNKNOWN_RATE = (
    "nothing shows how quick the rudder is: time it from stop to stop for rudder.rate_max_deg_s, or record its angle"
)
AS_TYPED = (
    "No sensor shows the rudder: its angles are as the vessel file says, and K counts degrees as they are ordered. If "
    "the rudder really goes f times as far, K is f times too large, n0/K, end stop and rate are f times too small, and "
    "the boat is steered just the same, since orders go out by the same scale. Wrong by f are then the degrees that "
    "are shown, and K beside other boats'. To know, order 10 deg at the dock and measure the angle."
)


class Rest(NamedTuple):
    """What was ordered [rad], and where the rudder came to rest [rad]."""

    order: float
    angle: float


class GearCheck(NamedTuple):
    """What contradicts the vessel file, a clause each, the worst first; what a good word needs beside it, and what
    there is to know about it: sentences, empty where a sensor and the file agree."""

    against: tuple[str, ...] = ()
    beside: str = ""
    note: str = ""


def rests_of(orders: Orders) -> list[Rest]:
    """Return where the rudder came to rest under orders that stood still."""
    found = []
    pauses = np.flatnonzero((np.abs(np.diff(orders.order)) > STANDS) | (np.diff(orders.order_time) > STANDS_S)) + 1
    for part in np.split(np.arange(orders.order.size), pauses):
        end = float(orders.order_time[part[-1]])
        if end - float(orders.order_time[part[0]]) < STANDS_S:
            continue
        last = orders.angle[(orders.time > end - LOOKED_AT_S) & (orders.time <= end)]
        before = orders.angle[(orders.time > end - 2.0 * LOOKED_AT_S) & (orders.time <= end - LOOKED_AT_S)]
        if min(last.size, before.size) >= 2 and abs(float(np.median(last) - np.median(before))) < RESTS:
            found.append(Rest(float(orders.order[part[-1]]), float(np.median(last))))
    return found


def angles_against(rests: Sequence[Rest]) -> list[str]:
    """Return how the angles at rest contradict the orders, a clause each."""
    largest = max((abs(rest.order) for rest in rests), default=0.0)
    small = [rest for rest in rests if LEAST_OFF < abs(rest.order) < SMALL * largest]
    large = [rest for rest in rests if abs(rest.order) > LARGE * largest]
    scale = _scale(small or large)
    if scale is None:
        return []
    against = []
    if _is_off(scale, max(abs(rest.order) for rest in small or large)):
        against.append(
            f"the rudder's sensor shows {scale:.2g} deg for each degree ordered: one of them has the wrong scale "
            "(helm.rudder_at_full_pwm_deg, drive.angle_at_full_deg, or the sensor's), or there is an end stop"
        )
    reached = _scale(large)
    if small and reached is not None and reached < scale and _is_off(1.0 + reached - scale, largest):
        stop = math.degrees(min(abs(rest.angle) for rest in large))
        against.append(
            f"the rudder stops at {stop:.0f} deg where {math.degrees(largest):.0f} were ordered: set "
            "rudder.angle_max_deg lower"
        )
    return against


def _scale(rests: Sequence[Rest]) -> float | None:
    """Return the angle for each radian ordered, the sensor's zero left out where both sides were ordered."""
    orders, angles = (np.array([getattr(rest, name) for rest in rests]) for name in ("order", "angle"))
    if orders.size < 2 or float(np.ptp(orders)) < 2.0 * LEAST_OFF:
        return None
    return float(np.polyfit(orders, angles, 1)[0])


def _is_off(scale: float, order: float) -> bool:
    return abs(scale - 1.0) > SCALE_OFF and abs(scale - 1.0) * order > LEAST_OFF


def rate_against(measured: RudderRate | None, filed: float, orders: Sequence[Orders]) -> list[str]:
    """Return how the measured rate contradicts the filed one [rad/s], where more was ordered than came."""
    if measured is None or not measured.rate < (1.0 - RATE_OFF) * filed - 3.0 * measured.standard_error:
        return []
    if not any(_quickest(each.order_time, each.order) > (1.0 + RATE_OFF) * measured.rate for each in orders):
        return []
    return [
        f"the rudder moves at {math.degrees(measured.rate):.3g} deg/s where the file says {math.degrees(filed):.3g}: "
        "correct rudder.rate_max_deg_s"
    ]


def _quickest(time: FloatArray, order: FloatArray) -> float:
    """Return the fastest change of the order [rad/s] over LOOKED_AT_S."""
    if time.size < 2:
        return 0.0
    later = np.interp(time + LOOKED_AT_S, time, order)
    return float(np.max(np.abs(later - order))) / LOOKED_AT_S


def gear_check(runs: Sequence[Run], filed: float, measured: RudderRate | None) -> GearCheck:
    """Return whether the runs' rudder is that of the vessel file, of the `filed` rate [rad/s], inf where none is known.

    measured: the rate that a sensor, or the boat's turning, shows.
    """
    if any(run.rudder == "measured" for run in runs):
        orders = [run.orders for run in runs if run.orders is not None]
        angles = angles_against([rest for each in orders for rest in rests_of(each)])
        return GearCheck((*angles, *rate_against(measured, filed, orders)))
    if measured is not None:
        rates = f"{math.degrees(measured.rate):.3g} deg/s" + (
            f" in place of {math.degrees(filed):.3g}" if math.isfinite(filed) else ""
        )
        return GearCheck((), f"its rudder turns out to move at {rates}, its angles are as typed", AS_TYPED)
    if not math.isfinite(filed):
        return GearCheck((), "the rudder's angles and rate are as ordered", AS_TYPED)
    if not shows_rate(runs, filed):
        return GearCheck((UNKNOWN_RATE,), "", AS_TYPED)
    return GearCheck((), "it turns as with a rudder of the typed rate, whose angles are as typed", AS_TYPED)
