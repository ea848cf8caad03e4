"""KVLCC2, a tanker, by the MMG standard method: hull, propeller and rudder in surge, sway and yaw.

Yasukawa and Yoshimura 2015, J Mar Sci Technol 20:37-52, equations and coefficients of the free-running model of 7 m,
L7. With v the sway and r the yaw rate amidships, U^2 = u^2 + v^2, v' = v/U, r' = r L/U, b = -atan(v/u):

    (m + mx) u' - (m + my) v r - xG m r^2         = X_H + X_R + X_P
    (m + my) v' + (m + mx) u r + xG m r'          = Y_H + Y_R
    (I + xG^2 m + J) r'   + xG m (v' + u r)       = N_H + N_R

Everything is divided by L^2 d rho/2, so that forces are accelerations and the density of the water drops out. A `scale`
enlarges the model by Froude's law: lengths by the scale, times and speeds by its root. The wake of the full-scale ship
is smaller, as the paper has it.

Three things go beyond the paper: polynomials in v/U and r L/U are held where a boat turns on the spot; the propeller
has thrust and drag at any speed, by the same polynomial with signs; a rudder under sternway works the other way round.
Not modelled: sinkage and trim, and a propeller astern that throws the stern to a side.

Shallow water of a depth h at a draught T multiplies the coefficients. Ankudinov, Miller, Jakobsen and Daggett 1990
(MARSIM), with F = h/T - 1 and b = C_b (B/T) (1 + B/L)^2:

    K0 = 1 + 0.0775/F^2 - 0.0110/F^3 + 0.000068/F^5,   K2 = 0.0342/F
    K1 = -0.0643/F + 0.0724/F^2 - 0.0113/F^3 + 0.0000767/F^5
    added mass of sway K0 + 2/3 K1 b + 8/15 K2 b^2,    added inertia K0 + 8/15 K1 b + 40/105 K2 b^2
    n_r: K0 + 1/2 K1 b + 1/3 K2 b^2,                   y_r: K0 + 2/5 K1 b + 24/105 K2 b^2
    n_v: K0 + K1 b + K2 b^2,                           y_v: 3/2 that of n_r - 1/2

The wake is 1 + (-4.932 + 0.6425 C_b L/T - 0.0165 (C_b L/T)^2) (T/h)^1.655 times as large (Taimuri et al. 2020, Ocean
Eng 218), the resistance 1 + 0.388 (T/h)^2 times (Furukawa et al. 2016, MASHCON). Those sources have squares where this
hull has cubes: here a term takes the factor of the motion that it begins with, y_vrr that of y_v; and surge those of
y_v, y_r and n_r. Added mass of surge, thrust deduction and the flow's straightening stay as they are in deep water.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from autopilot.models.steering_gear import SteeringGear
from autopilot.vessel.schema import Vessel
from sitl.boat import Disturbance, Hull, PlantKind, roll_acceleration
from sitl.craft import WATER_DENSITY, Motion, Windage, gear_of, step_by, turning, wind_force

if TYPE_CHECKING:
    from sitl.scenario import Scenario

LENGTH, BEAM, DRAUGHT = 7.0, 1.27, 0.46
"""Of the model L7 [m]; paper, table 2."""
SERVICE_SPEED = 1.179
"""[m/s]: 15.5 kn of the ship."""
FULL_SCALE_FROM = 10.0
"""Scale from which the wake is the ship's."""
TURN_ON_THE_SPOT = 1.5
"""The largest r L/U that the polynomials are given; the tests behind them went to 0.8."""


class HullForces(NamedTuple):
    """Resistance and derivatives of the bare hull; paper, table 3."""

    resistance: float = 0.022
    x_vv: float = -0.040
    x_vr: float = 0.002
    x_rr: float = 0.011
    x_vvvv: float = 0.771
    y_v: float = -0.315
    y_r: float = 0.083
    y_vvv: float = -1.607
    y_vvr: float = 0.379
    y_vrr: float = -0.391
    y_rrr: float = 0.008
    n_v: float = -0.137
    n_r: float = -0.049
    n_vvv: float = -0.030
    n_vvr: float = -0.294
    n_vrr: float = 0.055
    n_rrr: float = -0.013


class Mass(NamedTuple):
    """Mass, added masses, centre of gravity and moments of inertia, in lengths and L^2 d rho/2; tables 2 and 3."""

    mass: float = 3.27 / (0.5 * LENGTH * LENGTH * DRAUGHT)
    surge: float = 0.022
    sway: float = 0.223
    yaw: float = 0.011
    centre: float = 0.25 / LENGTH
    gyration: float = 0.25
    """Radius of gyration, in lengths."""


class Propeller(NamedTuple):
    """Diameter in lengths; thrust k0 + k1 J + k2 J^2; thrust deduction; wake amidships and how it changes in a turn."""

    diameter: float = 0.216 / LENGTH
    k0: float = 0.2931
    k1: float = -0.2753
    k2: float = -0.1385
    deduction: float = 0.220
    wake: float = 0.40
    place: float = -0.48
    c1: float = 2.0
    c2_starboard: float = 1.6
    c2_port: float = 1.1


class Rudder(NamedTuple):
    """Area in L d, span in propeller diameters, lift slope; interaction with the hull; inflow; tables 2 and 3."""

    area: float = 0.0539 / (LENGTH * DRAUGHT)
    diameter_to_span: float = 0.216 / 0.345
    lift_slope: float = 2.747
    deduction: float = 0.387
    increase: float = 0.312
    increase_at: float = -0.464
    place: float = -0.5
    straightening_starboard: float = 0.640
    straightening_port: float = 0.395
    rate_lever: float = -0.710
    wake_ratio: float = 1.09
    race: float = 0.50


WAKE_OF_THE_SHIP = 0.35

BLOCK = 3.27 / (LENGTH * BEAM * DRAUGHT)
"""C_b."""
GEAR = SteeringGear(math.radians(35.0), math.radians(15.8), 0.05)
"""Of the model: 35 deg, and the 2.34 deg/s of the ship; the lag is assumed."""

SHIP_LENGTH, SHIP_BEAM, SHIP_DRAUGHT, SHIP_DEPTH = 320.0, 58.0, 20.8, 30.0
WINDAGE = Windage(
    ahead=0.90,
    astern=0.55,
    across=0.70,
    cross_force=0.40,
    front=((SHIP_DEPTH - SHIP_DRAUGHT) * SHIP_BEAM + 600.0) * (LENGTH / SHIP_LENGTH) ** 2,
    side=((SHIP_DEPTH - SHIP_DRAUGHT) * SHIP_LENGTH + 700.0) * (LENGTH / SHIP_LENGTH) ** 2,
    length=LENGTH,
    centroid=-0.05,
)
"""Blendermann's loaded tanker; areas from depth and draught, deckhouse and centroid assumed."""


class Tanker(NamedTuple):
    """Everything about the tanker that does not change; `revolutions` [1/m]: of the propeller per speed of the engine's
    order, `push` [1/s^2]: yaw acceleration of a radian of disturbance."""

    gear: SteeringGear
    hull: Hull
    length: float
    revolutions: float
    windage: Windage
    wind_share: float
    push: float = 0.0
    forces: HullForces = HullForces()
    mass: Mass = Mass()
    propeller: Propeller = Propeller()
    rudder: Rudder = Rudder()


def revolutions_per_speed(length: float, forces: HullForces, propeller: Propeller) -> float:
    """Return the revolutions [1/s] per speed [m/s] at which thrust is resistance on a straight course.

    (1 - t) 2 D^2 (1 - w)^2 K(J)/J^2 = R0 L d  leaves a quadratic for J.
    """
    share = 1.0 - propeller.wake
    load = forces.resistance * (DRAUGHT / LENGTH) / (2.0 * (1.0 - propeller.deduction))
    load /= propeller.diameter**2 * share**2
    leading = load - propeller.k2
    advance = (propeller.k1 + math.sqrt(propeller.k1**2 + 4.0 * leading * propeller.k0)) / (2.0 * leading)
    return share / (advance * propeller.diameter * length)


class Shallow(NamedTuple):
    """Factors on added mass and inertia, and on the derivatives of the hull's side force and moment by v and r."""

    mass: float
    inertia: float
    y_v: float
    y_r: float
    n_v: float
    n_r: float


def shallow_factors(depth: float) -> Shallow:
    """Return the factors at a `depth` in draughts, 1.2 and more."""
    f = depth - 1.0
    k0 = 1.0 + 0.0775 / f**2 - 0.0110 / f**3 + 0.000068 / f**5
    k1 = -0.0643 / f + 0.0724 / f**2 - 0.0113 / f**3 + 0.0000767 / f**5
    full = BLOCK * BEAM / DRAUGHT * (1.0 + BEAM / LENGTH) ** 2
    one, two = k1 * full, 0.0342 / f * full * full
    n_r = k0 + one / 2.0 + two / 3.0
    return Shallow(
        mass=k0 + 2.0 / 3.0 * one + 8.0 / 15.0 * two,
        inertia=k0 + 8.0 / 15.0 * one + 40.0 / 105.0 * two,
        y_v=1.5 * n_r - 0.5,
        y_r=k0 + 2.0 / 5.0 * one + 24.0 / 105.0 * two,
        n_v=k0 + one + two,
        n_r=n_r,
    )


def in_shallow_water(tanker: Tanker, depth: float) -> Tanker:
    """Return the tanker in water of a `depth` in draughts; its engine still reaches the speed that is ordered."""
    by, h, near = shallow_factors(depth), tanker.forces, 1.0 / depth
    slender = BLOCK * LENGTH / DRAUGHT
    wake = 1.0 + (-4.932 + 0.6425 * slender - 0.0165 * slender * slender) * near**1.655
    propeller = tanker.propeller._replace(wake=tanker.propeller.wake * wake)
    forces = HullForces(
        resistance=h.resistance * (1.0 + 0.388 * near * near),
        x_vv=h.x_vv * by.y_v,
        x_vr=h.x_vr * by.y_r,
        x_rr=h.x_rr * by.n_r,
        x_vvvv=h.x_vvvv * by.y_v,
        y_v=h.y_v * by.y_v,
        y_r=h.y_r * by.y_r,
        y_vvv=h.y_vvv * by.y_v,
        y_vvr=h.y_vvr * by.y_v,
        y_vrr=h.y_vrr * by.y_v,
        y_rrr=h.y_rrr * by.y_r,
        n_v=h.n_v * by.n_v,
        n_r=h.n_r * by.n_r,
        n_vvv=h.n_vvv * by.n_v,
        n_vvr=h.n_vvr * by.n_v,
        n_vrr=h.n_vrr * by.n_v,
        n_rrr=h.n_rrr * by.n_r,
    )
    return tanker._replace(
        forces=forces,
        propeller=propeller,
        mass=tanker.mass._replace(sway=tanker.mass.sway * by.mass, yaw=tanker.mass.yaw * by.inertia),
        revolutions=revolutions_per_speed(tanker.length, forces, propeller),
    )


def accelerations(tanker: Tanker, motion: Motion, rudder: float, thrust_speed: float, acting: Disturbance) -> Motion:
    """Return the derivative of the motion: the paper's equations (4) to (30), one after the other."""
    u, v, r = motion.surge, motion.sway, motion.rate
    length, forces, mass = tanker.length, tanker.forces, tanker.mass
    turn = r * length
    flow = max(math.sqrt(u * u + v * v), abs(turn) / TURN_ON_THE_SPOT)
    vn, rn = (v / flow, turn / flow) if flow > 0.0 else (0.0, 0.0)
    drift = math.atan2(-v, abs(u))
    vv, vr, rr = vn * vn, vn * rn, rn * rn
    h = forces
    square = flow * flow / length
    resistance = h.resistance if u >= 0.0 else -h.resistance
    x = square * (h.x_vv * vv + h.x_vr * vr + h.x_rr * rr + h.x_vvvv * vv * vv - resistance)
    y = square * ((h.y_v + h.y_vvv * vv + h.y_vvr * vr + h.y_vrr * rr) * vn + (h.y_r + h.y_rrr * rr) * rn)
    n = square / length * ((h.n_v + h.n_vvv * vv + h.n_vvr * vr + h.n_vrr * rr) * vn + (h.n_r + h.n_rrr * rr) * rn)

    p = tanker.propeller
    at_propeller = drift - p.place * rn
    side = p.c2_starboard if at_propeller > 0.0 else p.c2_port
    inflow = u * (1.0 - p.wake) * (1.0 + (1.0 - math.exp(-p.c1 * abs(at_propeller))) * (side - 1.0))
    revolutions = tanker.revolutions * thrust_speed
    tip = revolutions * p.diameter * length
    thrust = p.k0 * tip * abs(tip) + p.k1 * inflow * abs(tip) + p.k2 * inflow * abs(inflow)
    disc = p.diameter * p.diameter * (LENGTH / DRAUGHT) / length
    x += (1.0 - p.deduction) * 2.0 * thrust * disc

    k = tanker.rudder
    race = inflow
    if inflow >= 0.0 and thrust > 0.0:
        race += k.race * (math.sqrt(inflow * inflow + 8.0 / math.pi * thrust) - inflow)
    ahead = k.wake_ratio * math.sqrt(k.diameter_to_span * race * race + (1.0 - k.diameter_to_span) * inflow * inflow)
    ahead = ahead if u >= 0.0 else -ahead
    at_rudder = drift - k.rate_lever * rn
    straightening = k.straightening_port if at_rudder < 0.0 else k.straightening_starboard
    across = flow * straightening * at_rudder
    cosine, sine = math.cos(rudder), math.sin(rudder)
    normal = k.area * k.lift_slope / length * math.sqrt(ahead * ahead + across * across)
    normal *= ahead * sine - across * cosine
    x -= (1.0 - k.deduction) * normal * sine
    y -= (1.0 + k.increase) * normal * cosine
    n -= (k.place + k.increase * k.increase_at) * normal * cosine / length

    wind = wind_force(tanker.windage, acting.wind_ahead, acting.wind_starboard)
    x += wind.ahead * tanker.wind_share
    y += wind.starboard * tanker.wind_share
    n += wind.yaw * tanker.wind_share / (length * length)

    # the two sides of sway and yaw, which the centre of gravity couples
    m11, m22 = mass.mass + mass.surge, mass.mass + mass.sway
    m66 = mass.mass * (mass.gyration**2 + mass.centre**2) + mass.yaw
    coupling = mass.centre * mass.mass
    surge = (x + m22 * v * r + coupling * length * r * r) / m11
    y -= m11 * u * r
    n -= coupling / length * u * r
    m23, m32 = coupling * length, coupling / length
    divisor = m22 * m66 - m23 * m32
    sway = (m66 * y - m23 * n) / divisor
    rate = (m22 * n - m32 * y) / divisor + acting.yaw_acceleration + tanker.push * acting.rudder
    roll_rate = roll_acceleration(tanker.hull, u, r, motion.roll, motion.roll_rate, acting.roll_slope)
    return Motion(surge, sway, rate, roll_rate, motion.roll_rate)


def of(vessel: Vessel, scenario: Scenario) -> Tanker:
    """Return the tanker at the scale and in the depth of water of a scenario."""
    scale, section = scenario.scale, scenario.gear
    root = math.sqrt(scale)
    length = LENGTH * scale
    propeller = Propeller(wake=WAKE_OF_THE_SHIP) if scale >= FULL_SCALE_FROM else Propeller()
    own = GEAR._replace(rate_max=GEAR.rate_max / root, lag=GEAR.lag * root)
    windage = WINDAGE._replace(front=WINDAGE.front * scale**2, side=WINDAGE.side * scale**2, length=length)
    tanker = Tanker(
        gear=gear_of(own, section),
        hull=Hull(
            length=length,
            beam=BEAM * scale,
            draught=DRAUGHT * scale,
            roll_period=2.1 * root,
            roll_damping=0.05,
            roll_lever=0.02,
            windage=True,
        ),
        length=length,
        revolutions=revolutions_per_speed(length, HullForces(), propeller),
        windage=windage,
        wind_share=1.0 / (0.5 * WATER_DENSITY * length * length * DRAUGHT * scale),
        propeller=propeller,
    )
    if scenario.depth_draughts is not None:
        tanker = in_shallow_water(tanker, scenario.depth_draughts)
    return tanker._replace(push=turning(accelerations, tanker, SERVICE_SPEED * root))


PLANTS = (PlantKind("mmg_tanker", of, step_by(accelerations), knows_depth=True),)
