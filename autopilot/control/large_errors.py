"""What a law does with errors so large that the rudder's angle and rate saturate: the loop itself, simulated.

A describing function foretells whether a saturated rate leads to a limit cycle; with angle and rate both saturated, a
lag and a dead time the simulation of the very functions that steer says it more simply, and at which error it begins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from autopilot.angles import wrap
from autopilot.limits import RudderLimits, limit
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step
from autopilot.signals import NavState, Reference

STEPS_A_TICK = 4
SETTLED = 0.05
"""An error that has come down to this share of what it was, and stays, is corrected."""
LEAST_SETTLED = math.radians(0.5)
LONGEST_TIME_CONSTANTS = 40.0
FASTEST_LOOPS = 25.0
"""The simulation lasts this many of the loop's own times, and of the boat's time constants at most."""
MOST_TICKS = 100_000
"""What is not corrected by then is not called corrected."""


class Law(Protocol):
    """A heading law, as the pilot holds it."""

    def reset(self, rudder: float) -> None:
        """Start anew with the rudder at `rudder` [rad]."""

    def update(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        """Return the rudder demand [rad]."""


class Loop(NamedTuple):
    """The boat with its rudder: model, gear, limits of the command, dead time [s] on top of the gear's, and how often
    the law is asked [1/s]."""

    model: Norrbin
    gear: SteeringGear
    limits: RudderLimits
    delay: float
    rate_hz: float


class Recovery(NamedTuple):
    """An initial heading error [rad], whether the law corrects it, how far [rad] it goes past, how long [s] until it
    stays within a twentieth (inf: never), and how far [rad] it still swings at the end."""

    error: float
    corrected: bool
    overshoot: float
    settling: float
    swing: float


def recoveries(loop: Loop, law: Law, bandwidth: float, errors: Sequence[float]) -> list[Recovery]:
    """Return what becomes of each initial heading error [rad], the boat at rest in yaw and the rudder amidships.

    bandwidth [rad/s]: the loop's own, which says how long to look.
    """
    return [_recovery(error, trace(loop, law, error, _duration(loop, bandwidth))) for error in errors]


def _duration(loop: Loop, bandwidth: float) -> float:
    own = FASTEST_LOOPS / max(bandwidth, 1.0e-6)
    # the rudder can take the boat round no faster than this
    turning = 2.0 * math.pi / max(loop.model.gain * loop.limits.angle_max, 1.0e-6)
    lasting = max(own, min(LONGEST_TIME_CONSTANTS * loop.model.time_constant, 4.0 * own)) + turning
    return min(lasting, MOST_TICKS / loop.rate_hz)


class Trace(NamedTuple):
    """Times [s], heading errors [rad] and rudder angles [rad] of one recovery."""

    time: list[float]
    error: list[float]
    rudder: list[float]


def trace(loop: Loop, law: Law, error: float, duration: float) -> Trace:
    """Return the motion after an initial heading error [rad], towards the course 0, everything known exactly."""
    dt = 1.0 / loop.rate_hz
    h = dt / STEPS_A_TICK
    heading, rate, rudder, told = error, 0.0, 0.0, 0.0
    line = DelayLine(loop.delay + loop.gear.delay)
    law.reset(0.0)
    result = Trace([], [], [])
    for tick in range(round(duration / dt)):
        now = tick * dt
        state = NavState(now, wrap(heading), rate, loop.model.reference_speed, rudder, 0.0, 0.0, True)
        told = limit(loop.limits, told, law.update(loop.model, Reference(0.0), state, told, dt), dt)
        line.give(now, told)
        result.time.append(now)
        result.error.append(wrap(heading))
        result.rudder.append(rudder)
        for step in range(STEPS_A_TICK):
            moved = gear_step(loop.gear, rudder, line.effective(now + step * h), h)
            rate_after = rate_step(loop.model, rate, 0.5 * (rudder + moved), h)
            heading += 0.5 * h * (rate + rate_after)
            rate, rudder = rate_after, moved
    return result


def _recovery(error: float, motion: Trace) -> Recovery:
    sign = 1.0 if error >= 0.0 else -1.0
    within = max(SETTLED * abs(error), LEAST_SETTLED)
    outside = [k for k, value in enumerate(motion.error) if abs(value) > within]
    last = outside[-1] if outside else -1
    tail = motion.error[-max(len(motion.error) // 5, 1) :]
    corrected = last < len(motion.error) - len(tail)
    settling = (motion.time[last + 1] if last >= 0 else 0.0) if corrected else math.inf
    return Recovery(
        error, corrected, max(0.0, max(-sign * value for value in motion.error)), settling, max(map(abs, tail))
    )
