"""A naval vessel of 51.5 m that rolls: surge, sway, roll and yaw, and two rudders that heel it as they turn it.

    M (v', p', r')' = (Y, K, N)_hull + (0 - m u r, m z_G u r, -m x_G u r) + (Y, K, N)_rudders
    (m - X_udot) u' = X_uu u |u| + X_vr v r + m (v r + x_G r^2 - z_G p r) + thrust - drag of the rudders
    phi' = p,  psi' = r cos(phi)

about the origin of the towing tank tests: 3.38 m ahead of the centre of gravity, in the waterline; x forward, y to
starboard, z down. The thrust is the resistance on a straight course at the speed that the engine is ordered to.

Sources: the hull is Blanke and Christensen 1993 with the numbers that T. Perez published with the model `navalvessel`
of the Marine Systems Simulator (hull without rudders); the rudders are those of Liu and Jin 2017, eqs (9)-(11). Two
coefficients are corrected. Y_pdot is printed -296e3: +296e3 makes added mass symmetric with K_vdot, as the potential
theory behind it demands. The yaw term phi |u phi| must be phi |u v|, as in sway and roll.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from autopilot.models.steering_gear import SteeringGear
from autopilot.vessel.schema import Vessel
from sitl import boat
from sitl.boat import PlantKind
from sitl.craft import Motion, Windage, gear_of, step_by, turning, wind_force

if TYPE_CHECKING:
    from sitl.scenario import Scenario

KNOT = 1852.0 / 3600.0
DENSITY = 1014.0
"""Water density [kg/m^3] of the published model."""
GRAVITY_OF_MODEL = 9.81
"""Gravity [m/s^2] of the published model."""
CALM_WATER = 1960.0
"""Resistance over speed squared [N s^2/m^2]: the coefficient X_|u|u of the published model."""
SURGE_ADDED = 17400.0
"""Added mass in surge [kg]."""
SURGE_TURNING = 0.33
"""X_vr in masses of the ship."""
SERVICE_SPEED = 15.0 * KNOT
"""[m/s]; Liu and Jin 2017."""


class Derivatives(NamedTuple):
    """Derivatives of Y, K or N in SI units, 0 where the model has none.

    Added masses; then u|v, ur, ..., and those with the roll angle (b). Of K alone: up, pp and p damp the roll, and
    `restoring` is rho g GM displacement [N m/rad].
    """

    v_dot: float = 0.0
    p_dot: float = 0.0
    r_dot: float = 0.0
    uv: float = 0.0
    ur: float = 0.0
    vv: float = 0.0
    vr: float = 0.0
    rr: float = 0.0
    rv: float = 0.0
    buv: float = 0.0
    bur: float = 0.0
    buu: float = 0.0
    up: float = 0.0
    pp: float = 0.0
    p: float = 0.0
    bbb: float = 0.0
    restoring: float = 0.0


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
    sway: Derivatives
    roll: Derivatives
    yaw: Derivatives


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
    sway=Derivatives(-393e3, 296e3, -1.4e6, -11.8e3, 131e3, -3.7e3, -794e3, 0.0, -182e3, 10.8e3, 251e3, -74.0),
    roll=Derivatives(
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
    yaw=Derivatives(538e3, 0.0, -38.7e6, -92e3, -4.71e6, 0.0, 0.0, -202e6, -15.6e6, -214e3, -4.98e6, -8e3),
)
"""The published hull, with the two corrections of this module's docstring."""

NAVAL_RUDDERS = Rudders(
    area=2.0 * 1.5, lift_slope=math.degrees(0.054), stall=math.radians(23.0), aspect=1.5, x=-23.79, z=1.55
)
"""Two rudders of 1.5 m span and 1.0 m chord (Liu and Jin 2017 swap the two), 20.41 m abaft the centre of gravity,
their middle 1.55 m under water: K = -1.55 Y, N = -23.79 Y."""


def hull_load(hull: Hull, u: float, v: float, p: float, r: float, b: float) -> Load:
    """Return hull forces without added mass, and the centripetal terms: Liu and Jin 2017, eqs (1)-(3), (6)-(8).

    Speed u and sway v [m/s], rates p and r [rad/s], heel b [rad].
    """
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


GEAR = SteeringGear(math.radians(40.0), math.radians(20.0), 0.1)
"""The angle is Liu and Jin's; they give no rate, and rate and lag are assumed."""
WINDAGE = Windage(
    ahead=0.60,
    astern=0.65,
    across=0.85,
    cross_force=0.65,
    front=8.6 * 6.0,
    side=51.5 * 4.0,
    length=51.5,
    arm=3.0,
)
"""Blendermann's destroyer; the areas and the arm above the waterline are assumed."""


class RollShip(NamedTuple):
    """Everything about the ship that does not change; `mass` are the sway, roll and yaw of the inverse mass matrix,
    row by row, and the scale's factors turn the ship's lengths, speeds and times into the plant's."""

    gear: SteeringGear
    hull: boat.Hull
    inverse: tuple[float, float, float, float, float, float, float, float, float]
    length_factor: float = 1.0
    time_factor: float = 1.0
    push: float = 0.0


def inverse_mass(
    hull: Hull,
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return the inverse of the 3 x 3 mass matrix of sway, roll and yaw, row by row."""
    m, sway, roll, yaw = hull.mass, hull.sway, hull.roll, hull.yaw
    a, b, c = m - sway.v_dot, -(m * hull.z_g + sway.p_dot), m * hull.x_g - sway.r_dot
    d, e = -(m * hull.z_g + roll.v_dot), hull.inertia_x - roll.p_dot
    g, i = m * hull.x_g - yaw.v_dot, hull.inertia_z - yaw.r_dot
    whole = a * e * i - b * d * i - c * e * g
    rows = (e * i, -b * i, -c * e, -d * i, a * i - c * g, c * d, -e * g, b * g, a * e - b * d)
    first, second, third, fourth, fifth, sixth, seventh, eighth, ninth = (entry / whole for entry in rows)
    return first, second, third, fourth, fifth, sixth, seventh, eighth, ninth


def accelerations(
    ship: RollShip, motion: Motion, rudder: float, thrust_speed: float, acting: boat.Disturbance
) -> Motion:
    """Return the derivative of the motion."""
    # in the size of the published ship, where the coefficients have their units
    long, slow = ship.length_factor, ship.time_factor
    fast = slow / long
    u, v = motion.surge * fast, motion.sway * fast
    p, r, b = motion.roll_rate * slow, motion.rate * slow, motion.roll
    hull = NAVAL_HULL
    slope = acting.roll_slope
    own = hull_load(hull, u, v, p, r, b)
    helm = rudder_load(NAVAL_RUDDERS, u, rudder if u >= 0.0 else -rudder)
    wind = wind_force(WINDAGE, acting.wind_ahead * fast, acting.wind_starboard * fast)
    thrust = CALM_WATER * thrust_speed * abs(thrust_speed) * fast * fast
    drag = 0.5 * DENSITY * NAVAL_RUDDERS.area * drag_coefficient(NAVAL_RUDDERS, rudder) * u * abs(u)
    x = thrust - CALM_WATER * u * abs(u) - drag + wind.ahead
    x += hull.mass * ((1.0 + SURGE_TURNING) * v * r + hull.x_g * r * r - hull.z_g * p * r)
    y = own.Y + helm.Y + wind.starboard
    k = own.K + helm.K + wind.roll + hull.roll.restoring * slope
    n = own.N + helm.N + wind.yaw
    vv, vp, vr, pv, pp, pr, rv, rp, rr = ship.inverse
    per_square = 1.0 / (slow * slow)
    yaw = acting.yaw_acceleration + ship.push * acting.rudder
    return Motion(
        x / (hull.mass + SURGE_ADDED) * long * per_square,
        (vv * y + vp * k + vr * n) * long * per_square,
        (rv * y + rp * k + rr * n) * per_square + yaw,
        (pv * y + pp * k + pr * n) * per_square,
        motion.roll_rate,
    )


def of(vessel: Vessel, scenario: Scenario) -> RollShip:
    """Return the ship at the scale of a scenario."""
    scale, section = scenario.scale, scenario.gear
    root = math.sqrt(scale)
    ship = RollShip(
        gear=gear_of(GEAR._replace(rate_max=GEAR.rate_max / root, lag=GEAR.lag * root), section),
        hull=boat.Hull(
            length=NAVAL_HULL.length * scale,
            beam=NAVAL_HULL.beam * scale,
            draught=NAVAL_HULL.draught * scale,
            windage=True,
        ),
        inverse=inverse_mass(NAVAL_HULL),
        length_factor=scale,
        time_factor=root,
    )
    return ship._replace(push=turning(accelerations, ship, SERVICE_SPEED * root))


PLANTS = (PlantKind("roll_ship", of, step_by(accelerations)),)
