"""Faults of rudder, rudder sensor and engine, and what pushes the boat from outside."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

from autopilot.models.steering_gear import clip
from sitl.boat import Disturbance
from sitl.fault_kind import Acting, Dice, Kind, Moved, Ordered

if TYPE_CHECKING:
    from sitl.sensors import Reading

TRAILING_S = 0.5
"""A rudder that nothing holds trails amidships with this time constant; assumed."""
UNLIMITED = math.radians(20.0)
"""Rate [rad/s] of which a slow rudder has a share, where the file knows no rate."""


def delayed(waiting: deque[tuple[float, float]], time: float, value: float, delay: float) -> float:
    """Return the value that was `delay` [s] ago, the first of all where `waiting` does not go back so far.

    `waiting` holds (time [s], value), the oldest first; `value` is added to it.
    """
    waiting.append((time, value))
    while len(waiting) > 1 and waiting[1][0] <= time - delay + 1.0e-9:
        waiting.popleft()
    return waiting[0][1]


def late(fault: Acting, given: Ordered) -> float:
    """Return the order of some time ago."""
    return delayed(fault.memory.setdefault("waiting", deque()), fault.time, given.order, fault.size)


def reversed_order(fault: Acting, given: Ordered) -> float:
    """Return the order to the other side."""
    return -given.order


def slipped(fault: Acting, given: Ordered) -> float:
    """Return the order beside which the rudder goes."""
    return given.order + math.radians(fault.size)


def hard_over(fault: Acting, given: Ordered) -> float:
    """Return the end stop."""
    return math.copysign(given.gear.angle_max, fault.size)


def play(fault: Acting, given: Ordered) -> float:
    """Return where the gear drags the rudder along at either end of the play."""
    half = math.radians(fault.size)
    return clip(given.rudder, given.order - half, given.order + half)


def slow(fault: Acting, moved: Moved) -> float:
    """Return as far as a share of the rate gets."""
    rate = moved.gear.rate_max if math.isfinite(moved.gear.rate_max) else UNLIMITED
    return clip(moved.after, moved.before - fault.size * rate * moved.dt, moved.before + fault.size * rate * moved.dt)


def limited(fault: Acting, moved: Moved) -> float:
    """Return what is within the stop."""
    return clip(moved.after, -math.radians(fault.size), math.radians(fault.size))


def trailing(fault: Acting, moved: Moved) -> float:
    """Return a rudder on its way amidships by itself."""
    return moved.before * math.exp(-moved.dt / TRAILING_S)


def stuck(fault: Acting, moved: Moved) -> float:
    """Return the rudder as it was."""
    return moved.before


def astern(fault: Acting, thrust: float, cruise: float) -> float:
    """Return a speed astern."""
    return -fault.size * cruise


def stopped(fault: Acting, thrust: float, cruise: float) -> float:
    """Return no speed."""
    return 0.0


def one_dead(fault: Acting, pair: tuple[float, float]) -> tuple[float, float]:
    """Return a pair of thrusters of which the left one, or for a positive size the right one, stands still."""
    return (pair[0], 0.0) if fault.size > 0.0 else (0.0, pair[1])


def one_fouled(fault: Acting, pair: tuple[float, float]) -> tuple[float, float]:
    """Return a pair of thrusters of which the right one, or for a negative size the left one, has weed on it, which
    takes such a share of its thrust."""
    left = math.sqrt(1.0 - max(-fault.size, 0.0))
    right = math.sqrt(1.0 - max(fault.size, 0.0))
    return left * pair[0], right * pair[1]


def turned(fault: Acting, heading: float, on: Disturbance) -> Disturbance:
    """Return what acts on the boat, with a yaw moment."""
    return on._replace(rudder=on.rudder + math.radians(fault.size))


def streamed(fault: Acting, heading: float, on: Disturbance) -> Disturbance:
    """Return what acts on the boat, with a stream along the heading at which it began."""
    towards = fault.memory.setdefault("towards", heading)
    return on._replace(
        current_north=on.current_north + fault.size * math.cos(towards),
        current_east=on.current_east + fault.size * math.sin(towards),
    )


def heeled(fault: Acting, heading: float, on: Disturbance) -> Disturbance:
    """Return what acts on the boat, with a slope of the water athwartships."""
    return on._replace(roll_slope=on.roll_slope + math.radians(fault.size))


def feedback_frozen(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show the rudder of the moment when it began."""
    return reading._replace(rudder=fault.memory.setdefault("rudder", reading.rudder))


def feedback_offset(fault: Acting, reading: Reading, dice: Dice) -> Reading:
    """Show a rudder beside the true one."""
    return reading._replace(rudder=reading.rudder + math.radians(fault.size))


KINDS = {
    "rudder_late": Kind("orders reach the steering gear late", "s", 0.3, 0.0, 10.0, order=late),
    "rudder_reversed": Kind("the rudder goes to the other side", order=reversed_order),
    "rudder_offset": Kind("the linkage has slipped", "deg", 8.0, -45.0, 45.0, order=slipped),
    "rudder_hard_over": Kind(
        "the rudder runs to a stop, starboard for a positive size", "sign", 1.0, -1.0, 1.0, order=hard_over
    ),
    "rudder_play": Kind("the linkage has play, each way", "deg", 3.0, 0.0, 45.0, order=play),
    "rudder_slow": Kind("the rudder moves at a share of its rate", "share of the rate", 0.1, 0.0, 1.0, reached=slow),
    "rudder_limited": Kind("the rudder meets a stop at this angle", "deg", 5.0, 0.0, 45.0, reached=limited),
    "rudder_free": Kind("the linkage is broken: the rudder trails amidships", reached=trailing),
    "rudder_stuck": Kind("the rudder stays where it is", reached=stuck),
    "feedback_lost": Kind(
        "the rudder sensor sends nothing",
        silences=(
            "SERVO_OUTPUT_RAW",
            "RC_CHANNELS",
            "RSA",
        ),
    ),
    "feedback_frozen": Kind("the rudder sensor repeats its last angle", reads=feedback_frozen),
    "feedback_offset": Kind("the rudder sensor is off by a constant", "deg", 8.0, -45.0, 45.0, reads=feedback_offset),
    "engine_astern": Kind(
        "the engine pushes astern, a share of the speed", "share of the speed", 0.5, 0.0, 1.0, thrust=astern
    ),
    "engine_stopped": Kind("the engine gives no thrust", thrust=stopped),
    "thruster_dead": Kind(
        "one of two thrusters stands still, the right one for a positive size", "sign", -1.0, -1.0, 1.0, motors=one_dead
    ),
    "thruster_weed": Kind(
        "weed takes a share of one thruster's thrust, of the right one's for a positive size",
        "share of the thrust",
        0.6,
        -1.0,
        1.0,
        motors=one_fouled,
    ),
    "yaw_push": Kind(
        "something turns the boat: a gust, a line in the water", "deg of rudder", 10.0, -90.0, 90.0, push=turned
    ),
    "stream": Kind(
        "a stream along the heading that was; against it for a negative size", "m/s", -2.0, -10.0, 10.0, push=streamed
    ),
    "heel": Kind("the boat heels, starboard down for a positive size", "deg", 35.0, -90.0, 90.0, push=heeled),
}
