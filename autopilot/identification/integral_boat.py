"""The boat that is simulated beside the real one: its motion is what the integral method takes for instruments."""

from __future__ import annotations

import math

from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, rate_step, rudder_for
from autopilot.signals import Reference

RATE_BOUND_RAD_S = 3.0


class BoatBeside:
    """Heading [rad] and rate [rad/s] of a boat that knows the rudder and no noise.

    Args:
        longest_gap: after a silence longer than this [s] it begins anew.  led_back: a course-unstable boat left to
        itself would soon turn the other way than the real one, so it is led back to it.

    Attributes: moved_by, the rudder [rad] as far as nothing that disturbs the boat moves it; followed, when it followed
    a reference last [s]; lead_time, the time constant [s] of leading it back.
    """

    def __init__(self, longest_gap: float, *, led_back: bool) -> None:
        self._longest_gap, self._led_back = longest_gap, led_back
        self.lead_time = 1.0
        self.heading = self.rate = self.moved_by = 0.0
        self.followed = self._at = -math.inf
        self._rudder, self._measured = 0.0, math.nan

    def simulate(
        self, model: Norrbin, time: float, rudder: float, ratio: float, heading: float | None, rate: float | None
    ) -> None:
        """Carry it on to `time` [s] under the rudder [rad] at `ratio` times the reference speed; heading [rad] and rate
        [rad/s] are the real boat's. Where the samples begin anew, it begins with the measured rate."""
        dt = time - self._at
        if dt > self._longest_gap:
            self.rate = 0.0 if rate is None or not math.isfinite(rate) else rate
            self._measured = math.nan
        elif dt > 0.0 and math.isfinite(rudder):
            self._move(at_speed_ratio(model, max(ratio, SPEED_FLOOR_RATIO)), dt, rudder)
            if self._led_back:
                self._lead_back(dt, heading, rate)
        self._at = max(time, self._at)
        self._rudder = self.moved_by = rudder if math.isfinite(rudder) else self._rudder
        self._measured = math.nan if heading is None else heading

    def _move(self, model: Norrbin, dt: float, rudder: float) -> None:
        steps = math.ceil(2.0 * dt / model.time_constant)
        for step in range(steps):
            angle = self._rudder + (rudder - self._rudder) * (step + 0.5) / steps
            before = self.rate
            moved = rate_step(model, before, angle, dt / steps)
            self.rate = min(max(moved, -RATE_BOUND_RAD_S), RATE_BOUND_RAD_S)
            self.heading += 0.5 * dt / steps * (before + self.rate)

    def _lead_back(self, dt: float, heading: float | None, rate: float | None) -> None:
        share = min(dt / self.lead_time, 1.0)
        if rate is not None and math.isfinite(rate):
            self.rate += share * (rate - self.rate)
        elif heading is not None and math.isfinite(heading - self._measured):
            turned = math.remainder(heading - self._measured, 2.0 * math.pi)
            self.rate += share * (turned / dt - self.rate)

    def follow(self, model: Norrbin, time: float, ratio: float, reference: Reference) -> None:
        """Go where a law is told to go; its rudder is what that takes without any waves."""
        dt = time - self._at
        if 0.0 < dt <= self._longest_gap:
            self.heading += 0.5 * dt * (self.rate + reference.rate)
        self.rate = reference.rate
        scaled = at_speed_ratio(model, max(ratio, SPEED_FLOOR_RATIO))
        self.moved_by = rudder_for(scaled, reference.rate, reference.acceleration)
        self._at = self.followed = max(time, self._at)
        self._rudder, self._measured = self.moved_by, math.nan
