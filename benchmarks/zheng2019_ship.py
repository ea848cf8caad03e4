"""A ship under its thrusters at low speed: surge alone, and sway with yaw, in the bis system.

Surge, from two main thrusters:      X' = u,   M11 u' = k1 F1 + k2 F2 - Xu u
Sway and yaw, from a side thruster:  y' = v cos psi,   psi' = r,   (v, r) = M^-1 h,   h' = t k3 F3 - D M^-1 h,
    M = [[M22, M26], [M26, M66]],   D = [[Yv, Yr], [Nv, Nr]],   t = (1, lever)

Everything is made dimensionless in the bis system (Norrbin 1970): lengths by L, times by sqrt(L/g), masses by the
ship's own m, and so forces by m g. k is 1 where a thruster gives what it is commanded.

Source: Zheng et al. 2019, eqs (1)-(5), (12), (13), with X_u u where (12) prints X_u mu. Table 1 lists entries of D,
positive; it has no units, and in no standard scaling do all five numbers of D belong to one ship: in this one Nr
would make the yaw time constant 18 900 s. `TABLE_1` is as published; `REALISTIC` beside it steadies within a minute.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

GRAVITY_M_S2 = 9.81


class Hull(NamedTuple):
    """A ship: length [m], mass [kg], bis masses with what they carry of the water, side thruster's lever [m]."""

    length: float
    mass: float
    surge_mass: float
    sway_mass: float
    coupling_mass: float
    yaw_mass: float
    lever: float

    @property
    def time_unit(self) -> float:
        """sqrt(L/g) [s]."""
        return math.sqrt(self.length / GRAVITY_M_S2)

    @property
    def speed_unit(self) -> float:
        """sqrt(L g) [m/s]."""
        return math.sqrt(self.length * GRAVITY_M_S2)

    @property
    def force_unit(self) -> float:
        """m g [N]."""
        return self.mass * GRAVITY_M_S2


DREDGER = Hull(128.0, 1.9413e7, 1.05, 1.642, 0.0375, 0.0977, 50.0)
"""Zheng's dredger: 128 m by 25.6 m by 6.8 m as printed; mass for a block coefficient of 0.85, added masses and the
lever are assumed, for the paper gives none."""


class SurgeParameters(NamedTuple):
    """Xu and the two thrust coefficients, bis."""

    Xu: float
    k1: float
    k2: float


class SwayYawParameters(NamedTuple):
    """The thrust coefficient and the entries of D, bis."""

    k3: float
    Yv: float
    Yr: float
    Nv: float
    Nr: float


TABLE_1_SURGE = SurgeParameters(0.0112, 1.0011, 1.0031)
TABLE_1 = SwayYawParameters(1.0152, 2.764e-2, 1.6249e-4, 6.9226e-4, 1.8692e-5)
"""Zheng et al. 2019, table 1, as published."""

REALISTIC = SwayYawParameters(1.0152, 2.764e-2, -2.9e-3, -9.6e-4, 7.2e-3)
"""Table 1 with a yaw damping, and couplings of the sign and size, that a ship of this kind has."""


class SurgeDrive(NamedTuple):
    """What drives the surge: two thrusts and the mass M11, bis."""

    F1: float
    F2: float
    mass: float


class SwayYawDrive(NamedTuple):
    """What drives sway and yaw, bis: the thrust, its lever, and the inverse of M: v = a h2 + b h6, r = b h2 + c h6."""

    F3: float
    lever: float
    a: float
    b: float
    c: float


def surge_drive(hull: Hull, F1: float, F2: float) -> SurgeDrive:
    """Return the drive from thrusts in newton."""
    return SurgeDrive(F1 / hull.force_unit, F2 / hull.force_unit, hull.surge_mass)


def sway_yaw_drive(hull: Hull, F3: float) -> SwayYawDrive:
    """Return the drive from a thrust in newton."""
    determinant = hull.sway_mass * hull.yaw_mass - hull.coupling_mass**2
    return SwayYawDrive(
        F3 / hull.force_unit,
        hull.lever / hull.length,
        hull.yaw_mass / determinant,
        -hull.coupling_mass / determinant,
        hull.sway_mass / determinant,
    )


def surge_rates(state: Any, drive: SurgeDrive) -> tuple[Any, ...]:
    """Return the rates of (X, u, Xu, k1, k2): eq. (12), parameters constant. Also elementwise over numpy arrays."""
    u = state[1]
    thrust = state[3] * drive.F1 + state[4] * drive.F2
    return u, (thrust - state[2] * u) / drive.mass, 0.0, 0.0, 0.0


def surge_shown(state: Any) -> tuple[Any, ...]:
    """Return what is measured of (X, u, ...): X."""
    return (state[0],)


def sway_yaw_rates(state: Any, drive: SwayYawDrive) -> tuple[Any, ...]:
    """Return the rates of (y, psi, h2, h6, k3, Yv, Yr, Nv, Nr): eq. (13). Also elementwise over numpy arrays."""
    v = drive.a * state[2] + drive.b * state[3]
    r = drive.b * state[2] + drive.c * state[3]
    thrust = state[4] * drive.F3
    sway = thrust - state[5] * v - state[6] * r
    yaw = drive.lever * thrust - state[7] * v - state[8] * r
    return v * np.cos(state[1]), r, sway, yaw, 0.0, 0.0, 0.0, 0.0, 0.0


def sway_yaw_shown(state: Any) -> tuple[Any, ...]:
    """Return what is measured of (y, psi, ...): y and psi."""
    return state[0], state[1]
