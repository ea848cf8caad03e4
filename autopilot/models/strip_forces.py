"""First-order wave forces on a hull by strips, in sway, roll and yaw, and the waves that its motions radiate.

A long-crested wave of amplitude 1 m that travels at the angle beta to the heading accelerates the water at the strip
at x, averaged over the beam B and taken at half the draught T, by

    a(x) = j g k sin(beta) exp(-k T/2) sin(b)/b exp(-j k x cos(beta)),   b = k B |sin(beta)|/2

Froude-Krylov and diffraction forces follow from it with the mass m spread over parabolic section areas:

    Y = 1.585 m <a>,   K = 1.78 m <a> (metres),   N = 1.585 m <x a>,   <.> weighted by the section areas.

beta = 180 deg is head seas, 0 following seas. Where the boat meets the waves at w_e = w - w^2 U cos(beta)/g, the force
is the real part of Y exp(j (w_e t + phase)). Liu and Jin 2017, section 1.2, name strips and 60 components and print no
formula; these constants stand for their hull.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.models.naval_vessel import DENSITY, NAVAL_HULL
from autopilot.models.waves import GRAVITY, component_amplitudes, encounter_frequency, wave_number

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
STRIPS = 41
TABLE = 4096
"""Instants worked out at once, to keep the table of cosines small."""


class StripHull(NamedTuple):
    """What the strips need: mass [kg], length, beam, draught [m], middle of the section areas x [m] from the origin.

    sway_factor [-] and roll_arm [m] turn m <a> into Y and K.
    """

    mass: float
    length: float
    beam: float
    draught: float
    middle: float
    sway_factor: float
    roll_arm: float


NAVAL_STRIPS = StripHull(NAVAL_HULL.mass, NAVAL_HULL.length, NAVAL_HULL.beam, NAVAL_HULL.draught, -2.0, 1.585, 1.78)


class Sea(NamedTuple):
    """Long-crested ITTC sea: significant height [m], mean period [s], and the `angle` beta [rad] it travels at."""

    significant_height: float
    mean_period: float
    angle: float


class SeaForces(NamedTuple):
    """What one realisation of a sea does to the hull: at each instant Y [N], K, N [N m], shape (n, 3), and the water's
    transverse speed [m/s] at each strip, shape (n, STRIPS)."""

    load: Array
    drift: Array


def sections(hull: StripHull) -> tuple[Array, Array]:
    """Return the places x [m] of the strips' middles and their shares of the displacement, which sum to 1."""
    edge = hull.length / 2.0
    step = hull.length / STRIPS
    offset = -edge + step * (np.arange(STRIPS) + 0.5)
    areas = 1.0 - (offset / edge) ** 2
    return np.asarray(hull.middle + offset), np.asarray(areas / areas.sum())


def water_acceleration(hull: StripHull, frequency: Array, angle: float) -> Complex:
    """Return a(x) [m/s^2 per metre of amplitude], shape (len(frequency), STRIPS), at wave `frequency` w [rad/s]."""
    k = wave_number(frequency)
    across, along = math.sin(angle), math.cos(angle)
    x, _ = sections(hull)
    # numpy's sinc(t) is sin(pi t)/(pi t)
    beam_mean = np.sinc(k * hull.beam * abs(across) / (2.0 * math.pi))
    local = 1j * GRAVITY * k * across * np.exp(-k * hull.draught / 2.0) * beam_mean
    return np.asarray(local[:, None] * np.exp(-1j * np.outer(k, x) * along))


def strip_load(hull: StripHull, acceleration: Complex) -> Complex:
    """Return Y [N], K and N [N m] of the water's `acceleration` at the strips (last axis STRIPS), stacked last."""
    x, share = sections(hull)
    mean, turning = acceleration @ share, acceleration @ (share * x)
    return hull.mass * np.stack((hull.sway_factor * mean, hull.roll_arm * mean, hull.sway_factor * turning), axis=-1)


def sea_forces(hull: StripHull, sea: Sea, speed: float, frequency: Array, phase: Array, time: Array) -> SeaForces:
    """Return what a sea of components at `frequency` [rad/s] with `phase` [rad] does at each `time` [s].

    `speed` U [m/s] of the boat; `frequency` ascending, of the waves as a buoy sees them.
    """
    amplitude = component_amplitudes(frequency, sea.significant_height, sea.mean_period) * np.exp(1j * phase)
    acceleration = water_acceleration(hull, frequency, sea.angle) * amplitude[:, None]
    # the water itself oscillates at w, wherever it is looked at from
    velocity = acceleration / (1j * frequency[:, None])
    parts = np.concatenate((strip_load(hull, acceleration), velocity), axis=1)
    met = encounter_frequency(frequency, speed, sea.angle)
    out = np.empty((len(time), parts.shape[1]))
    for start in range(0, len(time), TABLE):
        rows = slice(start, start + TABLE)
        out[rows] = (np.exp(1j * np.outer(time[rows], met)) @ parts).real
    return SeaForces(out[:, :3], out[:, 3:])


def strip_damping(hull: StripHull, frequency: float) -> Array:
    """Return the wave damping [kg/s] of each strip that sways at `frequency` [rad/s], from the force it feels.

    A symmetric strip moving in one way can absorb at most half of the power that reaches it; that makes
    b = |X|^2 w/(rho g^2) per length, X the force per length and metre of amplitude in beam seas (Haskind's relation
    in two dimensions). So exciting force and radiated wave are two sides of one thing.
    """
    beam_sea = np.abs(water_acceleration(hull, np.array([frequency]), math.pi / 2.0)[0])
    _, share = sections(hull)
    step = hull.length / STRIPS
    force = hull.sway_factor * hull.mass * share * beam_sea / step
    return np.asarray(force**2 * step * frequency / (DENSITY * GRAVITY**2))
