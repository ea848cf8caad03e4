"""What a seaway and steering cost in resistance, and the speed they cost at constant power.

Extra resistance over calm water, each a mean over time:

    rudders       their drag, the largest part that steering changes
    centrifugal   -(m + a22) <v_G r>, v_G the sway of the centre of gravity: eqs (22)-(23)
    radiated      what sway, roll and yaw relative to the water send away as waves, P, along the wave's direction:
                  R_T = P k/w_e, R_x = R_T |cos(beta)|: eqs (13)-(21)

Heave and pitch radiate too; the rudder does not change them, and they are left out. At constant power R_t(U) U with
R_t = 1960 U^2 N the speed y U solves

    y^3 + (dR/R_t) y = 1

Liu and Jin 2017, eq. (26), hold R_t at its calm value and get y = 1/(1 + dR/R_t), about three times the loss.
Eq. (19) prints k for k/(2 pi); the paper leaves the rudders' drag out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.models.naval_vessel import (
    DENSITY,
    NAVAL_HULL,
    NAVAL_RUDDERS,
    NAVAL_STRIPS,
    Hull,
    Rudders,
    Sea,
    StripHull,
    sections,
    strip_damping,
)
from autopilot.models.waves import encounter_frequency, wave_number

Array = NDArray[np.float64]

CALM_WATER = 1960.0
"""R_t/U^2 [N s^2/m^2] of the naval vessel: the coefficient X_|u|u of the published model."""
CONVERGED = 1.0e-15


class ExtraResistance(NamedTuple):
    """Means over time [N], each above calm water with the rudders amidships."""

    rudders: float
    centrifugal: float
    radiated: float

    @property
    def total(self) -> float:
        """The sum [N]."""
        return self.rudders + self.centrifugal + self.radiated


def calm_resistance(speed: float) -> float:
    """Return R_t [N] of the naval vessel at `speed` [m/s]."""
    return CALM_WATER * speed * speed


def true_speed_ratio(extra: float) -> float:
    """Return y = U0/U, the positive root of y^3 + q y = 1, at constant power; `extra` q = dR/R_t [-].

    Newton's method from above the root, where the cubic is convex. ValueError for q that is not finite.
    """
    if not math.isfinite(extra):
        raise ValueError(f"true_speed_ratio: the extra resistance must be finite, got {extra}")
    y = 1.0 if extra >= 0.0 else 1.0 - extra
    while True:
        slope = 3.0 * y * y + extra
        step = ((y * y + extra) * y - 1.0) / slope
        if abs(step) <= CONVERGED * y or step < 0.0:
            return y - step
        y -= step


def printed_speed_ratio(extra: float) -> float:
    """Return y = 1/(1 + dR/R_t) as eq. (26) of Liu and Jin 2017 has it: to show what it overstates."""
    return 1.0 / (1.0 + extra)


def rudder_resistance(rudders: Rudders, speed: float, drag: Array) -> float:
    """Return the mean drag [N] of rudders whose drag coefficient [-] was `drag` at each instant, at `speed` [m/s]."""
    return float(0.5 * DENSITY * rudders.area * speed * speed * np.mean(drag))


def centrifugal_resistance(hull: Hull, sway: Array, yaw_rate: Array) -> float:
    """Return -(m + a22) <v_G r> [N] from sway v [m/s] at the origin and yaw rate r [rad/s] at the same instants."""
    at_gravity = sway + hull.x_g * yaw_rate
    return float(-(hull.mass - hull.sway.v_dot) * np.mean(at_gravity * yaw_rate))


def radiated_power(hull: StripHull, frequency: float, motion: Array, water: Array) -> float:
    """Return the mean power [W] that leaves as waves of `frequency` [rad/s].

    `motion` (n, 3): v [m/s], p, r [rad/s]; `water` (n, STRIPS): the water's transverse speed [m/s] at each strip. By
    Haskind's relation roll radiates like sway at the arm roll_arm/sway_factor.
    """
    x, _ = sections(hull)
    arm = hull.roll_arm / hull.sway_factor
    relative = motion @ np.stack((np.ones_like(x), np.full_like(x, arm), x)) - water
    return float(np.einsum("ij,ij,j->", relative, relative, strip_damping(hull, frequency)) / len(motion))


def radiated_resistance(hull: StripHull, sea: Sea, speed: float, power: float) -> float:
    """Return R_x [N] of a radiated mean `power` [W]: all of it at the sea's mean frequency 2 pi/T1."""
    frequency = np.array([2.0 * math.pi / sea.mean_period])
    met = abs(float(encounter_frequency(frequency, speed, sea.angle)[0]))
    return power * float(wave_number(frequency)[0]) / met * abs(math.cos(sea.angle))


def extra_resistance(sea: Sea, speed: float, motion: Array, drag: Array, water: Array) -> ExtraResistance:
    """Return the naval vessel's extra resistance over a run; `drag` (n,) as in `rudder_resistance`, the rest as in
    `radiated_power`."""
    frequency = 2.0 * math.pi / sea.mean_period
    met = abs(float(encounter_frequency(np.array([frequency]), speed, sea.angle)[0]))
    power = radiated_power(NAVAL_STRIPS, met, motion, water)
    return ExtraResistance(
        rudder_resistance(NAVAL_RUDDERS, speed, drag),
        centrifugal_resistance(NAVAL_HULL, motion[:, 0], motion[:, 2]),
        radiated_resistance(NAVAL_STRIPS, sea, speed, power),
    )
