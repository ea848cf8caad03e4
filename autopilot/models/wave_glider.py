"""Yaw of a wave glider: a float on the surface, and a glider below it that pulls it along by a tether.

    glider  T_G r_G' + r_G + n3_G r_G^3 = K_G delta_r
    float   T_F r_F' + r_F + n3_F r_F^3 = K_F delta_F,      delta_F = delta_0 sin(psi_G - psi_F)

The glider has the real rudder delta_r. The float has none: the tether turns it towards the glider, with most effect at
right angles, which acts like a rudder of the equivalent angle delta_F. delta_0 is a fixed angle; only the product
K_F delta_0 is a property of the float. Source: patent application of Harbin Engineering University (Liao et al., 2019).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.models.norrbin import Norrbin, at_speed_ratio, yaw_acceleration


class WaveGlider(NamedTuple):
    """Models of float and glider at their reference speed, and the fixed angle delta_0 [rad]."""

    surface: Norrbin
    glider: Norrbin
    fixed_angle: float


class TwoBodies(NamedTuple):
    """Headings [rad] and rates [rad/s] of float and glider."""

    surface_heading: float = 0.0
    surface_rate: float = 0.0
    glider_heading: float = 0.0
    glider_rate: float = 0.0


def equivalent_rudder(fixed_angle: float, glider_heading: float, surface_heading: float) -> float:
    """Return delta_F = delta_0 sin(psi_G - psi_F) [rad], the rudder angle that the tether is worth to the float."""
    return fixed_angle * math.sin(glider_heading - surface_heading)


def derivative(craft: WaveGlider, bodies: TwoBodies, rudder: float) -> TwoBodies:
    """Return the rates [rad/s] and accelerations [rad/s^2] under the glider's `rudder` [rad]."""
    pull = equivalent_rudder(craft.fixed_angle, bodies.glider_heading, bodies.surface_heading)
    return TwoBodies(
        bodies.surface_rate,
        yaw_acceleration(craft.surface, bodies.surface_rate, pull),
        bodies.glider_rate,
        yaw_acceleration(craft.glider, bodies.glider_rate, rudder),
    )


def step(craft: WaveGlider, bodies: TwoBodies, rudder: float, dt: float) -> TwoBodies:
    """Return the bodies one classical Runge-Kutta step of `dt` [s] later, the rudder [rad] held."""
    k1 = derivative(craft, bodies, rudder)
    k2 = derivative(craft, _moved(bodies, k1, 0.5 * dt), rudder)
    k3 = derivative(craft, _moved(bodies, k2, 0.5 * dt), rudder)
    k4 = derivative(craft, _moved(bodies, k3, dt), rudder)
    mean = TwoBodies(*((a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)))
    return _moved(bodies, mean, dt)


def at_speed(craft: WaveGlider, ratio: float) -> WaveGlider:
    """Return the craft at `ratio` > 0 times its reference speed; both bodies scale like ships."""
    return craft._replace(surface=at_speed_ratio(craft.surface, ratio), glider=at_speed_ratio(craft.glider, ratio))


def _moved(bodies: TwoBodies, slope: TwoBodies, dt: float) -> TwoBodies:
    return TwoBodies(*(value + dt * change for value, change in zip(bodies, slope, strict=True)))
