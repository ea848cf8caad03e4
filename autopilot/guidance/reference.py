"""How an order becomes a reference: the planned turn, carried from tick to tick by a virtual boat.

Scalar functions over one value, `Guide`, which the loop calls as they are and campaigns compile.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import shortest_turn, wrap
from autopilot.guidance.effectiveness import NO_EVIDENCE
from autopilot.guidance.stop import TurnLimits, relaxed
from autopilot.guidance.trials import zigzag_side
from autopilot.guidance.turn import (
    VirtualBoat,
    advance,
    couple,
    hold_back,
    reset_reference,
    reset_threshold,
    turn_step,
    turning_time,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState, Order, OrderKind

RESET_BEYOND_GUIDED = math.radians(90.0)
"""A firmware that steers by itself turns in its own time: it is only never led the wrong way round."""


class Guide(NamedTuple):
    """The turn to the heading that is ordered: heading [rad], the virtual boat that leads there, and a zigzag's side.

    turning_until [s]: an ordered turn may last so long. free_time [s]: when the rudder was last not at its stop.
    """

    heading: float = 0.0
    boat: VirtualBoat = VirtualBoat(0.0)
    side: int = 1
    turning_until: float = -math.inf
    free_time: float = -math.inf

    def is_late(self, now: float) -> bool:
        """Return whether the turn to the ordered heading has had the time [s] it may take."""
        return now >= self.turning_until


class Steering(NamedTuple):
    """What leads depends on: on which side the rudder is at its stop, see `side_hard_over`; whether the rudder is ours;
    whether the law goes by the estimated bias. An integrator needs the error that a plan keeps from it."""

    hard_over: int
    is_ours: bool
    by_bias: bool


def started(guide: Guide, limits: TurnLimits, state: NavState) -> Guide:
    """Return the guide with a plan from where the boat is, turning no faster than it may."""
    boat = VirtualBoat(state.heading, clip(state.rate, -limits.rate_max, limits.rate_max), 0.0, NO_EVIDENCE)
    return Guide(guide.heading, boat, guide.side, guide.turning_until, state.time)


def heading_ordered(guide: Guide, model: Norrbin, limits: TurnLimits, state: NavState, heading: float) -> Guide:
    """Return the guide on its way to another `heading` [rad]; nan adopts the present one."""
    adopted = heading if math.isfinite(heading) else state.heading
    may_take = turning_time(model, limits, shortest_turn(state.heading, adopted))
    until = max(guide.turning_until, state.time + may_take)
    return Guide(adopted, guide.boat, 1, until, guide.free_time)


def led(guide: Guide, model: Norrbin, limits: TurnLimits, state: NavState, steering: Steering, dt: float) -> Guide:
    """Return the guide `dt` [s] on. model and limits are those at the speed that is."""
    boat, heading, rate, now = guide.boat, state.heading, state.rate, state.time
    is_late = now >= guide.turning_until
    free_time = now if steering.hard_over == 0 else guide.free_time
    beyond = reset_threshold(model, limits, is_late, now - free_time) if steering.is_ours else RESET_BEYOND_GUIDED
    if abs(shortest_turn(boat.heading, heading)) > beyond:
        boat = reset_reference(model, limits, heading, rate, state.rudder + state.bias)
    pace = relaxed(limits) if is_late else limits
    if steering.is_ours and steering.by_bias and is_late:
        boat = advance(model, limits, boat, heading, guide.heading)
    if steering.is_ours and (steering.by_bias or not is_late):
        boat = hold_back(boat, heading, rate, steering.hard_over)
    if limits.watches and steering.is_ours:
        boat = couple(model, limits, boat, state, dt)
    boat = turn_step(model, pace, boat, guide.heading, dt)
    if not math.isfinite(boat.heading + boat.rate + boat.rudder):
        # far quicker than the model of a boat that has lost its way allows: the turn is planned anew
        return started(guide, limits, state)
    return Guide(guide.heading, boat, guide.side, guide.turning_until, free_time)


def zigzag_divergence(guide: Guide, order: Order, heading: float) -> float:
    """Return how far [rad] beyond its swing a zigzag is off to the side that its rudder turns away from.

    0 or less where the boat sails it, and where no zigzag is sailed.
    """
    if order.kind is not OrderKind.ZIGZAG:
        return 0.0
    return -guide.side * wrap(heading - guide.heading) - order.heading_change


def zigzag(guide: Guide, order: Order, heading: float) -> Guide:
    """Return the guide on the zigzag's side at this `heading` [rad], about the heading that was adopted."""
    return guide._replace(side=zigzag_side(guide.side, guide.heading, heading, order.heading_change))
