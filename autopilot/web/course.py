"""Changing course from a display: step by step, and aside for a while with the way back. Pure.

Every change is sent as a whole heading: an order that is repeated because its answer was lost must not turn twice.
"""

from __future__ import annotations

import math

from autopilot.links.boat.modes import HEADING, TRACK, TRIAL
from autopilot.web import orders
from autopilot.web.view import BoatView

ECHO_S = 1.5
"""So long after our own order [s] the heading that the boat tells may still be the one before it."""


class Course:
    """Turns the boat over `orders`.

    Attributes:
        before: the heading [deg] ordered before the first step aside, None where nobody dodges.
        was_route: whether a route was followed then.
    """

    def __init__(self, given: orders.Orders, view: BoatView) -> None:
        self._orders, self._view = given, view
        self._meant = math.nan
        self._meant_at = -math.inf
        self.before: float | None = None
        self.was_route = False

    def turn_by(self, now: float, degrees: float, told: orders.Told) -> None:
        """Change the heading ordered by so many degrees, positive to starboard."""
        base = self._base(now)
        if base is None:
            is_trial = self._view.mode == TRIAL
            told(
                orders.Answer.FAILED,
                "a trial is being sailed: end it first" if is_trial else "engage first: no course is being steered",
            )
            return
        self.turn_to(now, base + degrees, told)

    def turn_to(self, now: float, heading_deg: float, told: orders.Told) -> None:
        """Order a heading [deg]."""
        self._meant, self._meant_at = heading_deg % 360.0, now

        def noted(taken: orders.Answer, words: str) -> None:
            if not taken:
                self._meant_at = -math.inf
            told(taken, words)

        self._orders.give((orders.turn_to(heading_deg),), noted)

    def dodge(self, now: float, degrees: float, told: orders.Told) -> None:
        """Step aside by so many degrees; again: further. The course before the first step is kept."""
        base, was_route = self._base(now), self._view.mode == TRACK

        def noted(taken: orders.Answer, words: str) -> None:
            if taken and self.before is None:
                self.before, self.was_route = base, was_route
            told(taken, words)

        self.turn_by(now, degrees, noted)

    def back(self, now: float, told: orders.Told) -> None:
        """Go back to the course that was steered before, or to the route."""
        before = self.before
        if before is None:
            told(orders.Answer.FAILED, "nothing to go back to")
            return

        def noted(taken: orders.Answer, words: str) -> None:
            if taken:
                self.before = None
            told(taken, words)

        if self.was_route:
            self._orders.give(orders.FOLLOW, noted)
        else:
            self.turn_to(now, before, noted)

    def look(self) -> None:
        """Forget the way back when nobody steers any more."""
        if self._view.mode not in (HEADING, TRACK):
            self.before = None
            self._meant_at = -math.inf

    def _base(self, now: float) -> float | None:
        if self._view.mode not in (HEADING, TRACK):
            return None
        if now - self._meant_at < ECHO_S:
            return self._meant
        return self._view.value("order")
