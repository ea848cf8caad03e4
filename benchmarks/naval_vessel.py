"""Sway, roll and yaw of a 51.5 m naval vessel at constant speed: hull, two rudders, and the linear model of both.

    M (v', p', r')' = (Y, K, N)_hull + (0 - m u r, m z_G u r, -m x_G u r) + (Y, K, N)_outside
    phi' = p,  psi' = r cos(phi)

about the origin of the towing tank tests: 3.38 m ahead of the centre of gravity, in the waterline; x forward, y to
starboard, z down. Surge is left out: the speed u is an argument, and what it loses is worked out below.

Sources: Liu and Jin 2017, eqs (1)-(11), after Perez 2005; the coefficients are those that Perez published with the
model `navalvessel` of the Marine Systems Simulator (hull without rudders; from Blanke and Christensen 1993).
Two of them are corrected here. Y_pdot is printed -296e3: +296e3 makes added mass symmetric with K_vdot, as the
potential theory behind it demands. The yaw term phi |u phi| must be phi |u v|, as in sway and roll.

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

from autopilot.models.motion import LinearMotion, Motion
from autopilot.models.waves import GRAVITY, component_amplitudes, wave_number

Array = NDArray[np.float64]

KNOT = 1852.0 / 3600.0
DENSITY = 1014.0
"""Water density [kg/m^3] of the published model."""
GRAVITY_OF_MODEL = 9.81
"""Gravity [m/s^2] of the published model."""
SERVICE_SPEED = 15.0 * KNOT
"""Speed [m/s] of Liu and Jin 2017."""


class SwayForce(NamedTuple):
    """Derivatives of Y in SI units: added masses, then u|v, ur, ..., and those with the roll angle (b)."""

    v_dot: float
    p_dot: float
    r_dot: float
    uv: float
    ur: float
    vv: float
    vr: float
    rv: float
    buv: float
    bur: float
    buu: float


class RollMoment(NamedTuple):
    """Derivatives of K in SI units; up, pp and p damp the roll, `restoring` is rho g GM displacement [N m/rad]."""

    v_dot: float
    p_dot: float
    uv: float
    ur: float
    vv: float
    vr: float
    rv: float
    buv: float
    bur: float
    buu: float
    up: float
    pp: float
    p: float
    bbb: float
    restoring: float


class YawMoment(NamedTuple):
    """Derivatives of N in SI units."""

    v_dot: float
    r_dot: float
    uv: float
    ur: float
    rr: float
    rv: float
    buv: float
    bur: float
    buu: float


class Hull(NamedTuple):
    """mass [kg], inertia about x and z [kg m^2] of the origin, centre of gravity [m], length, beam, draught [m]."""

    mass: float
    inertia_x: float
    inertia_z: float
    x_g: float
    z_g: float
    length: float
    beam: float
    draught: float
    sway: SwayForce
    roll: RollMoment
    yaw: YawMoment


class Rudders(NamedTuple):
    """Rudders side by side: total area [m^2], lift slope [1/rad], stall angle [rad], aspect ratio of one, and the
    point where they pull, x and z [m] from the origin."""

    area: float
    lift_slope: float
    stall: float
    aspect: float
    x: float
    z: float


class Load(NamedTuple):
    """Sway force Y [N], roll moment K and yaw moment N [N m] about the origin."""

    Y: float
    K: float
    N: float


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


_MASS = 357.0 * DENSITY

NAVAL_HULL = Hull(
    mass=_MASS,
    inertia_x=2.3763e6,
    inertia_z=47.934e6,
    x_g=-3.38,
    z_g=-1.06,
    length=51.5,
    beam=8.6,
    draught=2.3,
    sway=SwayForce(-393e3, 296e3, -1.4e6, -11.8e3, 131e3, -3.7e3, -794e3, -182e3, 10.8e3, 251e3, -74.0),
    roll=RollMoment(
        v_dot=296e3,
        p_dot=-774e3,
        uv=9260.0,
        ur=-102e3,
        vv=29.3e3,
        vr=621e3,
        rv=142e3,
        buv=-8400.0,
        bur=-196e3,
        buu=-1180.0,
        up=-15.5e3,
        pp=-416e3,
        p=-500e3,
        bbb=-0.325 * _MASS * GRAVITY_OF_MODEL,
        restoring=_MASS * GRAVITY_OF_MODEL * 1.1,
    ),
    yaw=YawMoment(538e3, -38.7e6, -92e3, -4.71e6, -202e6, -15.6e6, -214e3, -4.98e6, -8e3),
)
"""The published hull, with the two corrections of this module's docstring."""

NAVAL_RUDDERS = Rudders(
    area=2.0 * 1.5, lift_slope=math.degrees(0.054), stall=math.radians(23.0), aspect=1.5, x=-23.79, z=1.55
)
"""Two rudders of 1.5 m span and 1.0 m chord (Liu and Jin 2017 swap the two), 20.41 m abaft the centre of gravity,
their middle 1.55 m under water: K = -1.55 Y, N = -23.79 Y."""


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


def hull_load(hull: Hull, speed: float, state: Motion) -> Load:
    """Return hull forces without added mass, and the centripetal terms, at `speed` u [m/s]: eqs (1)-(3), (6)-(8)."""
    v, p, r, b, _ = state
    u = speed
    uv, ur, vr, rv = abs(u) * v, u * r, v * abs(r), r * abs(v)
    buv, bur, buu = b * abs(u * v), b * abs(u * r), b * u * abs(u)
    y, k, n = hull.sway, hull.roll, hull.yaw
    m = hull.mass
    sway = y.uv * uv + (y.ur - m) * ur + y.vv * v * abs(v) + y.vr * vr + y.rv * rv
    sway += y.buv * buv + y.bur * bur + y.buu * buu
    roll = k.uv * uv + (k.ur + m * hull.z_g) * ur + k.vv * v * abs(v) + k.vr * vr + k.rv * rv
    roll += k.buv * buv + k.bur * bur + k.buu * buu
    roll += (k.up * abs(u) + k.pp * abs(p) + k.p) * p + k.bbb * b * b * b - k.restoring * b
    yaw = n.uv * uv + n.ur * abs(u) * r - m * hull.x_g * ur + n.rr * r * abs(r) + n.rv * rv
    yaw += n.buv * buv + n.bur * b * u * abs(r) + n.buu * buu
    return Load(sway, roll, yaw)


def lift_coefficient(rudders: Rudders, angle: float) -> float:
    """Return C_L [-] of one rudder at `angle` [rad]: straight up to the stall, held there beyond it."""
    return rudders.lift_slope * max(-rudders.stall, min(rudders.stall, angle))


def drag_coefficient(rudders: Rudders, angle: float) -> float:
    """Return C_D [-] induced by the lift: C_L^2/(0.9 pi aspect), and past the stall no less than C_L |sin(angle)|.

    Aspect ratio 1.5, doubled by the hull above it, gives the 2.7 pi of a wing of aspect 3 with 0.9 efficiency.
    """
    lift = lift_coefficient(rudders, angle)
    induced = lift * lift / (0.9 * math.pi * 2.0 * rudders.aspect)
    if abs(angle) <= rudders.stall:
        return induced
    return max(induced, abs(lift * math.sin(angle)))


def rudder_load(rudders: Rudders, speed: float, angle: float) -> Load:
    """Return what the rudders do at `angle` [rad], positive to starboard: eqs (9)-(11) with moments in this frame.

    A rudder to starboard pushes the stern to port, Y < 0, and since it pulls below the origin it first heels the
    vessel to starboard, into the turn; the turn then heels it outwards. Rudder to roll is non-minimum phase.
    """
    sway = -0.5 * DENSITY * rudders.area * lift_coefficient(rudders, angle) * speed * speed
    return Load(sway, -rudders.z * sway, rudders.x * sway)


def rudder_drag(rudders: Rudders, speed: float, angle: float) -> float:
    """Return the resistance [N] of the rudders at `angle` [rad] and `speed` [m/s], above that amidships."""
    return 0.5 * DENSITY * rudders.area * drag_coefficient(rudders, angle) * speed * speed


def motion_rate(hull: Hull, inverse: InverseMass, speed: float, state: Motion, outside: Load) -> Motion:
    """Return the derivative of `state` at `speed` [m/s] under the load from `outside` (rudders and waves)."""
    own = hull_load(hull, speed, state)
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
