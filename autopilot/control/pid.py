"""PID heading law with the derivative on the rate error and anti-windup by what was really told.

    delta = -kp z1 - kd (r - psi_d') + I + F,   I' = -ki z1 + (delta_told - delta_wanted)/t_track

F is the rudder that the model needs for the planned turn, (T psi_d'' + n1 psi_d' + n2 psi_d'^2 + n3 psi_d'^3)/K, which
leaves to the gains only what the model does not know. The integrator is pulled towards the value that reproduces the
rudder the limits let through (back calculation, Astrom and Wittenmark 1997, section 8.5), so that saturation cannot
wind it up.

The gains are those of a boat with K/U, which no speed changes. For a model that answers n times as much kp and kd
become a share 1/n of them, and ki a share n^(-3/2), as the loop's pace goes down with sqrt(kp).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, liveliness, rudder_for
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState, Reference

INTEGRAL_MAX = 1.0
"""Largest rudder angle [rad] the integrator may hold: no trim on any boat needs more."""


class PidGains(NamedTuple):
    """kp [rad rudder per rad], ki [1/s], kd [s]; none negative."""

    kp: float
    ki: float = 0.0
    kd: float = 0.0


def gains_for(gains: PidGains, times: float) -> PidGains:
    """Return the gains for a boat that answers `times` as much as the one that they were worked out for."""
    return PidGains(gains.kp / times, gains.ki / (times * math.sqrt(times)), gains.kd / times)


class PidMemory(NamedTuple):
    """Integrator [rad of rudder] and the demand [rad] of the tick before (nan: none yet)."""

    integral: float = 0.0
    wanted: float = math.nan


def pid_step(
    gains: PidGains,
    memory: PidMemory,
    reference: Reference,
    heading: float,
    rate: float,
    last_rudder: float,
    dt: float,
    turning: float = 0.0,
) -> tuple[float, PidMemory]:
    """Return the unlimited demand [rad] and the new memory; `last_rudder` [rad] is what was really told before.

    `turning` [rad] is F of the module's docstring.
    """
    z1 = wrap(heading - reference.heading)
    integral = memory.integral
    if gains.ki > 0.0:
        excess = 0.0 if math.isnan(memory.wanted) else last_rudder - memory.wanted
        tracking = clip(dt * gains.ki / max(gains.kp, gains.ki), 0.0, 1.0)
        integral = clip(integral - gains.ki * z1 * dt + tracking * excess, -INTEGRAL_MAX, INTEGRAL_MAX)
    wanted = integral - gains.kp * z1 - gains.kd * (rate - reference.rate) + turning
    return wanted, PidMemory(integral, wanted)


def feed_forward(model: Norrbin, reference: Reference) -> float:
    """Return F [rad] of the module's docstring; what holds the boat straight is the integrator's to find."""
    return rudder_for(model, reference.rate, reference.acceleration) - rudder_for(model, 0.0, 0.0)


class PidLaw:
    """The law as the pilot holds it; its memory is the integrator alone.

    gain_per_speed: K/U [1/m] of the boat that the gains are for; None: they count for any boat.
    """

    name = "pid"

    def __init__(self, gains: PidGains, gain_per_speed: float | None = None) -> None:
        if not all(0.0 <= gain < math.inf for gain in gains):
            raise ValueError(f"pid: gains must be finite and not negative, got {gains}")
        if gain_per_speed is not None and not 0.0 < gain_per_speed < math.inf:
            raise ValueError(f"pid: K/U must be positive and finite, got {gain_per_speed}")
        self.gains, self._gain_per_speed = gains, gain_per_speed
        self._memory = PidMemory()

    def reset(self, rudder: float) -> None:
        """Start from the present `rudder` [rad], so that engaging makes no bump."""
        self._memory = PidMemory(integral=rudder if self.gains.ki > 0.0 else 0.0)

    def update(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        """Return the rudder demand [rad]; the model serves the feed-forward, and says how much the boat answers."""
        turning = feed_forward(model, reference)
        demand, self._memory = pid_step(
            self._gains_for(model), self._memory, reference, state.heading, state.rate, last_rudder, dt, turning
        )
        return demand

    def _gains_for(self, model: Norrbin) -> PidGains:
        if self._gain_per_speed is None:
            return self.gains
        times = liveliness(model, self._gain_per_speed)
        return self.gains if times == 1.0 else gains_for(self.gains, times)
