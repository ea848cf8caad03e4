"""Sway, roll and yaw of a 51.5 m naval vessel at constant speed: hull, two rudders, and the linear model of both.

    M (v', p', r')' = (Y, K, N)_hull + (0 - m u r, m z_G u r, -m x_G u r) + (Y, K, N)_outside
    phi' = p,  psi' = r cos(phi)

about the origin of the towing tank tests: 3.38 m ahead of the centre of gravity, in the waterline; x forward, y to
starboard, z down. Surge is left out: the speed u is an argument, and what it loses is worked out below.

The hull and its rudders, and where their numbers come from, are those of `sitl/roll_ship.py`.

First-order wave forces on a hull by strips, in sway, roll and yaw, and the waves that its motions radiate.

A long-crested wave of amplitude 1 m that travels at the angle beta to the heading accelerates the water at the strip
at x, averaged over the beam B and taken at half the draught T, by

    a(x) = j g k sin(beta) exp(-k T/2) sin(b)/b exp(-j k x cos(beta)),   b = k B |sin(beta)|/2

Froude-Krylov and diffraction forces follow from it with the mass m spread over parabolic section areas:

    Y = 1.585 m <a>,   K = 1.78 m <a> (metres),   N = 1.585 m <x a>,   <.> weighted by the section areas.

beta = 180 deg is head seas, 0 following seas. Where the boat meets the waves at w_e = w - w^2 U cos(beta)/g, the force
is the real part of Y exp(j (w_e t + phase)). Liu and Jin 2017, section 1.2, name strips and 60 components and print no
formula; these constants stand for their hull.

What a seaway and steering cost in resistance, and the speed they cost at constant power.

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

from autopilot.control.rudder_roll import LinearMotion, Motion
from autopilot.models.weather import GRAVITY, component_amplitudes, wave_number
from sitl.roll_ship import (
    CALM_WATER,
    DENSITY,
    NAVAL_HULL,
    NAVAL_RUDDERS,
    Hull,
    Load,
    Rudders,
    drag_coefficient,
    hull_load,
)

Array = NDArray[np.float64]


class InverseMass(NamedTuple):
    """Rows of the inverse of the 3 x 3 mass matrix (v, p, r)."""

    vv: float
    vp: float
    vr: float
    pv: float
    pp: float
    pr: float
    rv: float
    rp: float
    rr: float


def mass_matrix(hull: Hull) -> Array:
    """Return the 3 x 3 matrix of mass and added mass for (v, p, r), in kg, kg m and kg m^2."""
    m, sway, roll, yaw = hull.mass, hull.sway, hull.roll, hull.yaw
    return np.array(
        [
            [m - sway.v_dot, -(m * hull.z_g + sway.p_dot), m * hull.x_g - sway.r_dot],
            [-(m * hull.z_g + roll.v_dot), hull.inertia_x - roll.p_dot, 0.0],
            [m * hull.x_g - yaw.v_dot, 0.0, hull.inertia_z - yaw.r_dot],
        ]
    )


def inverse_mass(hull: Hull) -> InverseMass:
    """Return the inverse of `mass_matrix` as plain numbers."""
    return InverseMass(*(float(value) for value in np.linalg.inv(mass_matrix(hull)).ravel()))


def rudder_drag(rudders: Rudders, speed: float, angle: float) -> float:
    """Return the resistance [N] of the rudders at `angle` [rad] and `speed` [m/s], above that amidships."""
    return 0.5 * DENSITY * rudders.area * drag_coefficient(rudders, angle) * speed * speed


def motion_rate(hull: Hull, inverse: InverseMass, speed: float, state: Motion, outside: Load) -> Motion:
    """Return the derivative of `state` at `speed` [m/s] under the load from `outside` (rudders and waves)."""
    own = hull_load(hull, speed, state.v, state.p, state.r, state.phi)
    y, k, n = own.Y + outside.Y, own.K + outside.K, own.N + outside.N
    return Motion(
        inverse.vv * y + inverse.vp * k + inverse.vr * n,
        inverse.pv * y + inverse.pp * k + inverse.pr * n,
        inverse.rv * y + inverse.rp * k + inverse.rr * n,
        state.p,
        state.r * math.cos(state.phi),
    )


def _moved(state: Motion, rate: Motion, dt: float) -> Motion:
    return Motion(
        state.v + dt * rate.v,
        state.p + dt * rate.p,
        state.r + dt * rate.r,
        state.phi + dt * rate.phi,
        state.psi + dt * rate.psi,
    )


def motion_step(hull: Hull, inverse: InverseMass, speed: float, state: Motion, outside: Load, dt: float) -> Motion:
    """Return the state `dt` [s] later by one classical Runge-Kutta step, the load from outside held."""
    k1 = motion_rate(hull, inverse, speed, state, outside)
    k2 = motion_rate(hull, inverse, speed, _moved(state, k1, 0.5 * dt), outside)
    k3 = motion_rate(hull, inverse, speed, _moved(state, k2, 0.5 * dt), outside)
    k4 = motion_rate(hull, inverse, speed, _moved(state, k3, dt), outside)
    half = _moved(_moved(state, k1, dt / 6.0), k2, dt / 3.0)
    return _moved(_moved(half, k3, dt / 3.0), k4, dt / 6.0)


def linear_motion(hull: Hull, rudders: Rudders, speed: float) -> LinearMotion:
    """Return A (5 x 5) and b (5) of x = (v, p, r, phi, psi) about straight running at `speed` [m/s]: eq. (32).

    Analytic, not by differences: the terms with |v|, |r| and the products with phi vanish at the origin.
    """
    y, k, n, u, m = hull.sway, hull.roll, hull.yaw, speed, hull.mass
    forces = np.array(
        [
            [y.uv * abs(u), 0.0, (y.ur - m) * u, y.buu * u * abs(u)],
            [k.uv * abs(u), k.up * abs(u) + k.p, (k.ur + m * hull.z_g) * u, k.buu * u * abs(u) - k.restoring],
            [n.uv * abs(u), 0.0, n.ur * abs(u) - m * hull.x_g * u, n.buu * u * abs(u)],
        ]
    )
    inverse = np.linalg.inv(mass_matrix(hull))
    A, b = np.zeros((5, 5)), np.zeros(5)
    A[:3, :4] = inverse @ forces
    A[3, 1] = A[4, 2] = 1.0
    sway = -0.5 * DENSITY * rudders.area * rudders.lift_slope * u * u
    b[:3] = inverse @ np.array([sway, -rudders.z * sway, rudders.x * sway])
    return LinearMotion(A, b)


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


def encounter_frequency(frequency: Array, speed: float, angle: float) -> Array:
    """Return the frequency [rad/s] at which a boat meets the waves: w - w^2 U cos(beta)/g.

    `speed` U [m/s], `angle` beta [rad] from the boat's heading to the direction in which the waves travel:
    0 following seas, pi head seas. Negative where the boat overtakes the waves. Liu and Jin 2017.
    """
    return np.asarray(frequency - wave_number(frequency) * speed * math.cos(angle))


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
