"""From a vessel file to boat and heading law: model, rudder and gains by name, degrees become radians."""

from __future__ import annotations

import math
from dataclasses import astuple
from typing import TYPE_CHECKING

from autopilot.control import backstepping, sliding_heading
from autopilot.control.backstepping import BacksteppingGains, BacksteppingLaw
from autopilot.control.design import (
    LoopGains,
    linear_gains_backstepping,
    linear_gains_pid,
    linear_gains_sliding,
)
from autopilot.control.pid import PidGains, PidLaw
from autopilot.control.sliding_heading import SlidingGains, SlidingLaw, SwayYawGains
from autopilot.errors import RefusedError
from autopilot.limits import RudderLimits
from autopilot.models.norrbin import Norrbin, at_speed_ratio
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.params.vessel import SlidingRoll, Vessel
from autopilot.pilot import HeadingLaw
from autopilot.signals import NavState, Reference

if TYPE_CHECKING:
    from autopilot.control.rudder_roll import RollGains
    from autopilot.control.sliding_roll import RollShip, SlidingRollLaw

ROLL_LAW = "sliding_roll"
"""It needs a linear model of sway, roll and yaw, and brings numpy along."""
TRIAL_LAW = "trial"
"""In place of a law's name: trials order rudder angles and need no gains."""


def model_of(vessel: Vessel) -> Norrbin:
    """Return the identified model of the vessel file."""
    model = vessel.model
    return Norrbin(
        gain=model.K_1_s,
        time_constant=model.T_s,
        n3=model.n3_s2_rad2,
        n2=model.n2_s_rad,
        n1=model.n1,
        n0=model.n0_rad_s,
        reference_speed=model.reference_speed_m_s,
    )


def gain_per_speed_of(vessel: Vessel) -> float:
    """Return K/U [1/m] of the vessel, which no speed changes."""
    return vessel.model.K_1_s / vessel.model.reference_speed_m_s


def gear_of(vessel: Vessel) -> SteeringGear:
    """Return the steering gear of the vessel file."""
    rudder = vessel.rudder
    return SteeringGear(
        angle_max=math.radians(rudder.angle_max_deg),
        rate_max=radians_or_unlimited(rudder.rate_max_deg_s),
        lag=rudder.lag_s,
        dead_band=math.radians(rudder.dead_band_deg),
        delay=rudder.delay_s,
    )


def limits_of(vessel: Vessel) -> RudderLimits:
    """Return what may be commanded: the file's limits, inside what the rudder can do."""
    gear = gear_of(vessel)
    limits = vessel.limits
    angle = gear.angle_max if limits.angle_max_deg is None else math.radians(limits.angle_max_deg)
    rate = radians_or_unlimited(limits.rate_max_deg_s)
    return RudderLimits(min(angle, gear.angle_max), min(rate, gear.rate_max))


class HoldRudder:
    """Stands where a law would, for trials: leaves the rudder where it was told to be."""

    name = TRIAL_LAW

    def reset(self, rudder: float) -> None:
        """Nothing to forget."""

    def update(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        """Return `last_rudder` [rad]."""
        return last_rudder


def law_of(vessel: Vessel, name: str | None = None) -> HeadingLaw:
    """Return the heading law `name` (the file's own choice when None) with the file's gains.

    Raises RefusedError where the file has no gains for it.
    """
    control = vessel.control
    chosen = name or control.law
    if chosen == TRIAL_LAW:
        return HoldRudder()
    if chosen == "backstepping" and control.backstepping is not None:
        gains = BacksteppingGains(*astuple(control.backstepping))
        bound = backstepping.error_max_of(model_of(vessel), gains, limits_of(vessel).rate_max)
        return BacksteppingLaw(gains, vessel.model.reference_speed_m_s, bound, limits_of(vessel).angle_max)
    if chosen == "pid" and control.pid is not None:
        gains_pid = PidGains(control.pid.kp, control.pid.ki_1_s, control.pid.kd_s)
        return PidLaw(gains_pid, gain_per_speed_of(vessel))
    if chosen == "sliding" and control.sliding is not None:
        sliding = control.sliding
        reach, boundary = math.radians(sliding.reach_deg_s2), math.radians(sliding.boundary_deg_s)
        surface = SlidingGains(sliding.slope_1_s, reach, boundary)
        return SlidingLaw(surface, vessel.model.reference_speed_m_s, limits_of(vessel).angle_max)
    if chosen == ROLL_LAW and control.sliding_roll is not None:
        return sliding_roll_of(vessel, control.sliding_roll)
    raise RefusedError(_no_gains(vessel, chosen))


def _no_gains(vessel: Vessel, law: str) -> str:
    cure = "docs/liu2017.md says how" if law == ROLL_LAW else "or let `autopilot gains` work them out"
    return f"vessel {vessel.name!r} has no gains for the law {law!r}: add control.{law} to the file, {cure}"


def sliding_roll_of(vessel: Vessel, section: SlidingRoll) -> SlidingRollLaw:
    """Return the heading and roll law of the vessel. Raises RefusedError where its numbers must not be engaged."""
    # numpy comes along, which pilots with other laws do without
    from autopilot.control.sliding_roll import SlidingRollLaw

    if vessel.control.roll is not None:
        raise RefusedError(
            f"vessel {vessel.name!r}: the law {ROLL_LAW!r} damps roll itself and excludes the section control.roll; "
            "leave one of them out"
        )
    try:
        return SlidingRollLaw(*roll_ship_of(vessel, section))
    except ValueError as error:
        raise RefusedError(f"vessel {vessel.name!r}: control.{ROLL_LAW}: {error}") from error


def roll_ship_of(vessel: Vessel, section: SlidingRoll) -> tuple[RollShip, SwayYawGains, RollGains]:
    """Return what the heading and roll law knows of the boat, the quiet law's gains and its own."""
    from autopilot.control.rudder_roll import RollGains
    from autopilot.control.sliding_roll import RollShip, linear_model

    gear, limits = gear_of(vessel), limits_of(vessel)
    ship = RollShip(
        linear_model((section.sway_row, section.roll_row, section.yaw_row)),
        vessel.model.reference_speed_m_s,
        gear._replace(angle_max=limits.angle_max, rate_max=limits.rate_max),
        vessel.sensors.heading_latency_s + vessel.control.loop_delay_s + gear.delay,
        gain_per_speed_of(vessel),
    )
    return (
        ship,
        SwayYawGains(*astuple(section.quiet)),
        RollGains(section.k_v_s_m, section.k_p_s, section.k_r_s, section.k_phi, section.reach, section.boundary),
    )


def gains_in_force(vessel: Vessel, name: str | None = None, ratio: float = 1.0) -> tuple[float, ...]:
    """Return the law's own gains at `ratio` times the speed of the trial; the PID's are the same at every speed.

    Of the heading and roll law: rudder per heading error and per yaw rate [s] of its quiet law.
    """
    if (name or vessel.control.law) == ROLL_LAW:
        quiet = quiet_gains_of(vessel, ratio)
        return quiet.proportional, quiet.derivative
    law = law_of(vessel, name)
    if isinstance(law, BacksteppingLaw):
        return backstepping.gains_at(law.gains, ratio)
    if isinstance(law, SlidingLaw):
        return sliding_heading.gains_at(law.gains, ratio)
    assert isinstance(law, PidLaw)
    return law.gains


def loop_gains_of(vessel: Vessel, name: str | None = None, ratio: float = 1.0) -> LoopGains:
    """Return the law's gains on heading error, rate and integral, about straight running.

    ratio: at so many times the speed of the trial.
    """
    if (name or vessel.control.law) == ROLL_LAW:
        return quiet_gains_of(vessel, ratio)
    model, gains = at_speed_ratio(model_of(vessel), ratio), gains_in_force(vessel, name, ratio)
    if isinstance(gains, BacksteppingGains):
        return linear_gains_backstepping(model, gains)
    if isinstance(gains, SlidingGains):
        return linear_gains_sliding(model, gains)
    assert isinstance(gains, PidGains)
    return linear_gains_pid(gains)


def quiet_gains_of(vessel: Vessel, ratio: float) -> LoopGains:
    """Return what the quiet part of the heading and roll law does about straight running.

    Raises RefusedError where the file has no such law or its numbers are not stable.
    """
    from autopilot.control.sliding_roll import laws_at, near_surface_quiet

    section = vessel.control.sliding_roll
    if section is None:
        raise RefusedError(_no_gains(vessel, ROLL_LAW))
    within = clip(ratio, *sliding_heading.SPEED_RANGE)
    try:
        at = laws_at(*roll_ship_of(vessel, section), within)
    except ValueError as error:
        raise RefusedError(f"vessel {vessel.name!r}: control.{ROLL_LAW}: {error}") from error
    _, _, rate, _, heading = near_surface_quiet(at.quiet)
    return LoopGains(float(heading), 0.0, float(rate))


def radians_or_unlimited(degrees: float | None) -> float:
    """Return `degrees` in radians; inf where there is no limit."""
    return math.inf if degrees is None else math.radians(degrees)
