"""How an order becomes a reference: the planned turn, carried from tick to tick by a virtual boat."""

from __future__ import annotations

import math

from autopilot.angles import shortest_turn, wrap
from autopilot.guidance.trials import zigzag_side
from autopilot.guidance.turn import (
    TurnLimits,
    VirtualBoat,
    caught_up,
    in_company,
    is_turning,
    reference_of,
    replan_beyond,
    replanned,
    turn_step,
    turning_time,
    within_reach,
    without_haste,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState, Order, OrderKind, Reference

REPLAN_GUIDED = math.radians(90.0)
"""A firmware that steers by itself turns in its own time: it is only never led the wrong way round."""


class HeadingGuide:
    """The order in force, the heading it stands for and the turn towards it.

    model and limits are those of the tick, at the speed that is.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything since power-on."""
        self.order = Order()
        self.heading = 0.0
        """The heading that is ordered [rad]."""
        self._boat = VirtualBoat(0.0)
        self._side = 1
        self._turning_until = -math.inf
        self._free_time = -math.inf

    def is_late(self, now: float) -> bool:
        """Return whether the turn to the ordered heading has had the time [s] it may take."""
        return now >= self._turning_until

    def is_turning(self, model: Norrbin, limits: TurnLimits) -> bool:
        """Return whether the planned turn keeps the rudder busy."""
        return is_turning(model, limits, self._boat)

    def start(self, state: NavState, limits: TurnLimits) -> None:
        """Plan anew from where the boat is, turning no faster than it may."""
        self._boat = VirtualBoat(state.heading, clip(state.rate, -limits.rate_max, limits.rate_max), 0.0)
        self._free_time = state.time

    def forget_order(self) -> None:
        """Take the next order for a new one."""
        self.order = Order()

    def begin(self, order: Order, state: NavState, model: Norrbin, limits: TurnLimits) -> None:
        """An order that is new: adopt the present heading where it names none."""
        if self.order.kind is not OrderKind.HEADING:
            self.start(state, limits)
        self.order = order
        self.heading = order.heading if math.isfinite(order.heading) else state.heading
        self._side = 1
        may_take = turning_time(model, limits, shortest_turn(state.heading, self.heading))
        self._turning_until = max(self._turning_until, state.time + may_take)

    def lead(
        self,
        state: NavState,
        model: Norrbin,
        limits: TurnLimits,
        hard_over: int,
        steers: bool,
        by_bias: bool,
        dt: float,
    ) -> Reference:
        """Return the reference `dt` [s] on; hard_over: see `side_hard_over`. steers: whether the rudder is ours.

        by_bias: whether the law goes by the estimated bias. An integrator needs the error that a plan keeps from it.
        """
        is_late = self.is_late(state.time)
        if hard_over == 0:
            self._free_time = state.time
        stuck = state.time - self._free_time
        beyond = replan_beyond(model, limits, is_late, stuck) if steers else REPLAN_GUIDED
        if abs(shortest_turn(self._boat.heading, state.heading)) > beyond:
            self._boat = replanned(model, limits, state.heading, state.rate, state.rudder + state.bias)
        led, pace = self._boat, limits
        if is_late:
            pace = without_haste(limits)
        if steers and by_bias and is_late:
            led = caught_up(model, limits, led, state.heading, self.heading)
        if steers and (by_bias or not is_late):
            led = within_reach(led, state.heading, state.rate, hard_over)
        if limits.watches and steers:
            led = in_company(model, limits, led, state.heading, state.rate, state.rudder + state.bias, dt)
        self._boat = turn_step(model, pace, led, self.heading, dt)
        if not math.isfinite(self._boat.heading + self._boat.rate + self._boat.rudder):
            # far quicker than the model of a boat that has lost its way allows: the turn is planned anew
            self.start(state, limits)
        return reference_of(model, limits, self._boat)

    def astray(self, heading: float) -> float:
        """Return how far [rad] beyond its swing a zigzag is off to the side that its rudder turns away from.

        0 or less where the boat sails it, and where no zigzag is sailed.
        """
        if self.order.kind is not OrderKind.ZIGZAG:
            return 0.0
        return -self._side * wrap(heading - self.heading) - self.order.heading_change

    def zigzag_rudder(self, state: NavState, order: Order) -> float:
        """Return the rudder [rad] of a zigzag about the heading that was adopted."""
        self._side = zigzag_side(self._side, self.heading, state.heading, order.heading_change)
        return self._side * order.rudder
