"""PID heading law with the derivative on the rate error and anti-windup by the command that was really given.

    delta = -kp z1 - kd (r - psi_d') + I + F,   I' = -ki z1 + (delta_command - delta_wanted)/t_track

F is the rudder that the model needs for the planned turn, (T psi_d'' + n1 psi_d' + n2 psi_d'^2 + n3 psi_d'^3)/K, which
leaves to the gains only what the model does not know. The integrator is pulled towards the value that reproduces the
rudder the limits let through (back calculation, Astrom and Wittenmark 1997, section 8.5), so that saturation cannot
wind it up.

The gains are those of a boat with K/U, which no speed changes. For a model that answers n times as much kp and kd
become a share 1/n of them, and ki a share n^(-3/2), as the loop's pace goes down with sqrt(kp).
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from typing import Annotated, NamedTuple

from autopilot.angles import wrap
from autopilot.control.backstepping import BacksteppingGains, linear_gains_backstepping
from autopilot.control.law import Law, LawBoat, LawDesign, LawInput, LoopGains
from autopilot.files.typed import NOW, Bounds
from autopilot.models.norrbin import Norrbin, liveliness, rudder_for
from autopilot.models.steering_gear import clip
from autopilot.signals import Reference

INTEGRAL_MAX = 1.0
"""Largest rudder angle [rad] the integrator may hold: no trim on any boat needs more."""
INTEGRAL_TIME = 10.0
"""Integral time [s] of designed gains, or INTEGRAL_TIMES time constants if that is longer."""
INTEGRAL_TIMES = 3.0


@dataclass(frozen=True)
class Pid:
    """Gains of the PID heading law: rudder = kp e + ki * integral of e + kd e'."""

    kp: Annotated[float, NOW, Bounds(0.0, 1000.0, "rudder angle per heading error")]
    ki_1_s: Annotated[float, NOW, Bounds(0.0, 1000.0, "rudder angle per integral of the heading error")] = 0.0
    kd_s: Annotated[float, NOW, Bounds(0.0, 1.0e5, "rudder angle per rate error")] = 0.0


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


class BoatPid(NamedTuple):
    """The gains, and K/U [1/m] of the boat that they are for; nan: they count for any boat."""

    gains: PidGains
    gain_per_speed: float = math.nan


def boat_pid(section: Pid, boat: LawBoat) -> BoatPid:
    """Return the gains of a vessel file for the boat. ValueError where they are none."""
    gains = PidGains(*astuple(section))
    if not all(0.0 <= gain < math.inf for gain in gains):
        raise ValueError(f"gains must be finite and not negative, got {gains}")
    gain_per_speed = boat.model.gain / boat.model.reference_speed
    if not 0.0 < gain_per_speed < math.inf:
        raise ValueError(f"K/U must be positive and finite, got {gain_per_speed}")
    return BoatPid(gains, gain_per_speed)


def first(pid: BoatPid, rudder: float) -> PidMemory:
    """Return the memory that reproduces the present `rudder` [rad], so that engaging makes no bump."""
    return PidMemory(rudder if pid.gains.ki > 0.0 else 0.0, math.nan)


def step(pid: BoatPid, memory: PidMemory, given: LawInput) -> tuple[float, PidMemory]:
    """Return the unlimited demand [rad] and the new memory; the model serves the feed-forward, and says how much the
    boat answers."""
    gains = _for_liveliness(pid, given.model)
    state, reference, dt = given.state, given.reference, given.dt
    z1 = wrap(state.heading - reference.heading)
    integral = memory.integral
    if gains.ki > 0.0:
        excess = 0.0 if math.isnan(memory.wanted) else given.last_rudder - memory.wanted
        tracking = clip(dt * gains.ki / max(gains.kp, gains.ki), 0.0, 1.0)
        integral = clip(integral - gains.ki * z1 * dt + tracking * excess, -INTEGRAL_MAX, INTEGRAL_MAX)
    turning = feed_forward(given.model, reference)
    wanted = integral - gains.kp * z1 - gains.kd * (state.rate - reference.rate) + turning
    return wanted, PidMemory(integral, wanted)


def _for_liveliness(pid: BoatPid, model: Norrbin) -> PidGains:
    if math.isnan(pid.gain_per_speed):
        return pid.gains
    times = liveliness(model, pid.gain_per_speed)
    return pid.gains if times == 1.0 else gains_for(pid.gains, times)


def feed_forward(model: Norrbin, reference: Reference) -> float:
    """Return F [rad] of the module's docstring; what holds the boat straight is the integrator's to find."""
    return rudder_for(model, reference.rate, reference.acceleration) - rudder_for(model, 0.0, 0.0)


def equivalent_pid(model: Norrbin, gains: BacksteppingGains, integral_time: float = 0.0) -> PidGains:
    """Return the PID whose linear part equals the backstepping law's without smoothing; `integral_time` [s] 0: none."""
    linear = linear_gains_backstepping(model, gains)
    integral = linear.proportional / integral_time if integral_time > 0.0 else 0.0
    return PidGains(linear.proportional, integral, max(linear.derivative, 0.0))


def _linear(pid: BoatPid, model: Norrbin) -> LoopGains:
    return LoopGains(pid.gains.kp, pid.gains.ki, pid.gains.kd)


def _designed(boat: LawBoat, loop: BacksteppingGains) -> Pid:
    return Pid(*equivalent_pid(boat.model, loop, max(INTEGRAL_TIME, INTEGRAL_TIMES * boat.model.time_constant)))


def _quicker(section: Pid, factor: float) -> Pid:
    square = factor * factor
    return Pid(section.kp * square, section.ki_1_s * square * factor, section.kd_s * factor)


LAW = Law(
    name="pid",
    title="PID law",
    prefix="PID",
    section=Pid,
    numbers=BoatPid,
    gains=boat_pid,
    first=first,
    step=step,
    linear=_linear,
    design=LawDesign(_designed, _quicker),
    uses_bias=False,
)
