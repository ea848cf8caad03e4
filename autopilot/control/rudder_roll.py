"""Heading and roll with the rudder alone: the sliding mode law of Liu and Jin 2017, and when to leave it off.

    delta = -k' x~ - eta/(h'b) tanh(s/W),   s = h' x~,   (A - b k')' h = 0,   x~ = (v, p, r, phi, psi - psi_d)

eqs (32)-(34). The paper's k are degrees of rudder per SI unit and for a rudder positive to port, its eta is for
radians; (34) writes h4 b4, which is zero.

What the rudder can do about roll ends near the zero of the right half plane of rudder to roll (+0.418 rad/s for the
naval vessel at 15 knots): there the loop's sensitivity is 1 whatever the law, and reducing roll at its natural
frequency raises it below. In stern-quartering seas, met at such frequencies, any roll law amplifies. So
`RollSchedule` weighs the roll law by what it would do to the present roll:

    x_free   = x - (response of the linear model to the rudder as it stood): the roll with the rudder amidships
    x_shadow = x_free + (response of the linear model to a rudder under the roll law, through the steering gear)

Both go on all the time, whoever steers. The weight rises where the shadow rolls less than the free boat over the last
minutes and falls to zero where it does not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from autopilot.control.sliding_heading import SMALL, sliding_surface
from autopilot.models.naval_vessel import LinearMotion, Motion
from autopilot.models.steering_gear import SteeringGear, clip, gear_step

Array = NDArray[np.float64]


class RollGains(NamedTuple):
    """k [rad rudder per SI unit] on v, p, r and phi; eta and boundary W as the paper has them."""

    k_v: float
    k_p: float
    k_r: float
    k_phi: float
    reach: float
    boundary: float


class RollLaw(NamedTuple):
    """The law made ready: feedback k, surface h, `switching` eta/(h'b) [rad], boundary W."""

    k_v: float
    k_p: float
    k_r: float
    k_phi: float
    h_v: float
    h_p: float
    h_r: float
    h_phi: float
    h_psi: float
    switching: float
    boundary: float


PAPER_ROLL = RollGains(math.radians(5.0), math.radians(200.0), math.radians(100.0), math.radians(10.0), 0.0751, 0.5)
"""Liu and Jin 2017, section 4: k = (-5, -200, -100, -10, 0) degrees per SI unit, rudder positive to port there."""


def roll_law(model: LinearMotion, gains: RollGains) -> RollLaw:
    """Return the law for the linear model of (v, p, r, phi, psi). ValueError for gains that do not stabilise it."""
    k = np.array([gains.k_v, gains.k_p, gains.k_r, gains.k_phi, 0.0])
    h = sliding_surface(model.A, model.b, k)
    through = float(h @ model.b)
    if abs(through) < SMALL:
        raise ValueError("rudder roll: the rudder does not move s: h'b is zero")
    return RollLaw(*(float(value) for value in (*k[:4], *h, gains.reach / through, gains.boundary)))


def roll_rudder(law: RollLaw, state: Motion, heading_goal: float) -> float:
    """Return the unlimited rudder demand [rad] at `state` for the heading psi_d `heading_goal` [rad], unwrapped."""
    error = state.psi - heading_goal
    surface = law.h_v * state.v + law.h_p * state.p + law.h_r * state.r + law.h_phi * state.phi + law.h_psi * error
    feedback = law.k_v * state.v + law.k_p * state.p + law.k_r * state.r + law.k_phi * state.phi
    return -feedback - law.switching * math.tanh(surface / law.boundary)


class LinearStep(NamedTuple):
    """x' = F x + g delta over one step, delta held; F (5, 5), g (5,)."""

    F: Array
    g: Array


FORGET = 300.0
"""Time [s] in which the two responses forget their heading, so that what the model lacks does not pile up there."""


def linear_step_of(model: LinearMotion, dt: float) -> LinearStep:
    """Return the exact step over `dt` [s] of the linear model whose heading leaks with the time constant FORGET."""
    block = np.zeros((6, 6))
    block[:5, :5], block[:5, 5] = model.A, model.b
    block[4, 4] = -1.0 / FORGET
    over = expm(block * dt)
    return LinearStep(np.ascontiguousarray(over[:5, :5]), np.ascontiguousarray(over[:5, 5]))


def linear_response(step: LinearStep, x: Motion, rudder: float) -> Motion:
    """Return the response one step later, from `x` under `rudder` [rad]."""
    F, g = step
    return Motion(
        F[0, 0] * x.v + F[0, 1] * x.p + F[0, 2] * x.r + F[0, 3] * x.phi + F[0, 4] * x.psi + g[0] * rudder,
        F[1, 0] * x.v + F[1, 1] * x.p + F[1, 2] * x.r + F[1, 3] * x.phi + F[1, 4] * x.psi + g[1] * rudder,
        F[2, 0] * x.v + F[2, 1] * x.p + F[2, 2] * x.r + F[2, 3] * x.phi + F[2, 4] * x.psi + g[2] * rudder,
        F[3, 0] * x.v + F[3, 1] * x.p + F[3, 2] * x.r + F[3, 3] * x.phi + F[3, 4] * x.psi + g[3] * rudder,
        F[4, 0] * x.v + F[4, 1] * x.p + F[4, 2] * x.r + F[4, 3] * x.phi + F[4, 4] * x.psi + g[4] * rudder,
    )


class ScheduleSettings(NamedTuple):
    """memory [s] of the two variances; the weight goes to 0 where the shadow's reduction of roll is `none` [-], to 1
    where it is `full` [-], at most `slew` [1/s]; nothing is decided before `wait` [s]."""

    memory: float = 120.0
    none: float = 0.05
    full: float = 0.15
    slew: float = 1.0 / 30.0
    wait: float = 60.0


class RollSchedule(NamedTuple):
    """Memory of the schedule: time [s] it has run, the two responses, the shadow's rudder [rad], mean and variance of
    the roll [rad, rad^2] free and in the shadow, and the weight [-] of the roll law."""

    time: float
    own: Motion
    shadow: Motion
    shadow_rudder: float
    free_mean: float
    free_variance: float
    shadow_mean: float
    shadow_variance: float
    weight: float


def begin_schedule() -> RollSchedule:
    """Return a schedule that knows nothing and has the roll law off."""
    rest = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
    return RollSchedule(0.0, rest, rest, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _minus(x: Motion, y: Motion) -> Motion:
    return Motion(x.v - y.v, x.p - y.p, x.r - y.r, x.phi - y.phi, x.psi - y.psi)


def _plus(x: Motion, y: Motion) -> Motion:
    return Motion(x.v + y.v, x.p + y.p, x.r + y.r, x.phi + y.phi, x.psi + y.psi)


def roll_reduction(schedule: RollSchedule) -> float:
    """Return by how much the roll law would reduce the roll's deviation, as a share of it with the rudder amidships."""
    return _reduction(schedule.free_variance, schedule.shadow_variance)


def _reduction(free: float, shadow: float) -> float:
    return 1.0 - math.sqrt(shadow / free) if free > 0.0 else 0.0


def schedule_step(
    settings: ScheduleSettings,
    law: RollLaw,
    gear: SteeringGear,
    step: LinearStep,
    schedule: RollSchedule,
    state: Motion,
    heading_goal: float,
    rudder: float,
    dt: float,
) -> RollSchedule:
    """Return the schedule after one step: `state` measured now, `rudder` [rad] as it stands until the next.

    `step` is that of `linear_step_of` for the same `dt` [s].
    """
    free = _minus(state, schedule.own)
    shadow = _plus(free, schedule.shadow)
    demand = roll_rudder(law, shadow, heading_goal)
    shadow_rudder = gear_step(gear, schedule.shadow_rudder, demand, dt)
    time = schedule.time + dt
    share = dt / min(settings.memory, time)
    free_off, shadow_off = free.phi - schedule.free_mean, shadow.phi - schedule.shadow_mean
    free_variance = schedule.free_variance + share * (free_off * free_off - schedule.free_variance)
    shadow_variance = schedule.shadow_variance + share * (shadow_off * shadow_off - schedule.shadow_variance)
    seen = _reduction(free_variance, shadow_variance)
    goal = clip((seen - settings.none) / (settings.full - settings.none), 0.0, 1.0) if time > settings.wait else 0.0
    reach = settings.slew * dt
    return RollSchedule(
        time,
        linear_response(step, schedule.own, rudder),
        linear_response(step, schedule.shadow, shadow_rudder),
        shadow_rudder,
        schedule.free_mean + share * free_off,
        free_variance,
        schedule.shadow_mean + share * shadow_off,
        shadow_variance,
        schedule.weight + clip(goal - schedule.weight, -reach, reach),
    )


def blended_rudder(weight: float, quiet: float, roll: float) -> float:
    """Return the rudder demand [rad]: `weight` of the roll law's, the rest of a quiet heading law's."""
    return (1.0 - weight) * quiet + weight * roll
