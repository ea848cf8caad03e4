"""CyberShip II, a supply vessel of 1.26 m with two propellers and a rudder behind each, in surge, sway and yaw.

    X = X_u u + X_uu |u| u + X_uuu u^3 + 2 T
    Y = Y_v v + Y_r r + (Y_vv |v| + Y_rv |r|) v + (Y_vr |v| + Y_rr |r|) r - 2 L
    N = N_v v + N_r r + (N_vv |v| + N_rv |r|) v + (N_vr |v| + N_rr |r|) r + 2 l L
    T = T_nn |n| n - T_nu |n| u,   L = (L_d - L_dd |d|) d |w| w,   w = u + k (sqrt(u^2 + 8 T/(pi rho D^2)) - u)

T is the thrust of one propeller at n revolutions, L the lift of one rudder in the flow w, which the propeller ahead of
it quickens; running astern both have coefficients of their own, and the rudder sees the speed alone. A propeller that
runs too slowly to push does not hold back either.

Source: Skjetne, Smogeli and Fossen 2004, Modeling, Identification and Control 25:3-27, from towing and free-running
tests in the Marine Cybernetics laboratory. With these numbers the boat is course-unstable (it leaves a straight course
of 0.5 m/s within seconds) and slides through a turn at a drift angle of 50 deg. The steering gear and the areas in the
wind are assumed.

At the bow a thruster in a tunnel pushes across:  Y + B,  N + l_b B,  B = B0 s exp(-(|u|/u_b)^2) at a share s of its
full thrust. That it has one is in the paper; its force, and how the flow along the hull takes it away, are assumed.
"""

from __future__ import annotations

import math

from autopilot.models.steering_gear import SteeringGear
from sitl.boat import BowMotor, Disturbance, Hull, PlantKind
from sitl.craft import WATER_DENSITY, Craft, Inertia, Motion, Push, Windage, of_one_size, planar, step_by, wind_force

LENGTH, BEAM = 1.255, 0.29
MASS, CENTRE, INERTIA = 23.8, 0.046, 1.76
X_U, X_UU, X_UUU = -0.72253, -1.32742, -5.86643
Y_V, Y_VV, Y_RV = -0.88965, -36.47287, -0.805
Y_R, Y_VR, Y_RR = -7.250, -0.845, -3.450
N_V, N_VV, N_RV = 0.03130, 3.95645, 0.130
N_R, N_VR, N_RR = -1.900, 0.080, -0.750
T_NN, T_NU = 3.65034e-3, 1.52468e-4
T_NN_ASTERN, T_NU_ASTERN = 5.10256e-3, 4.55822e-2
L_D, L_DD = 6.43306, 5.83594
L_D_ASTERN, L_DD_ASTERN = 3.19573, 2.34356
RACE, RUDDER_DIAMETER, RUDDER_LEVER = 0.5, 0.08, 0.549
"""k, D [m] and how far the rudders are abaft midships [m]."""
BOW_THRUST, BOW_LEVER, BOW_FADES = 0.6, 0.47, 0.15
"""B0 [N], how far the thruster is ahead of midships [m], and u_b [m/s]: 2.4 kn of the ship."""
BOW_MOTOR = BowMotor(delay=0.15, lag=0.15)
FULL_REVOLUTIONS = 33.0
"""[1/s]."""
SERVICE_SPEED = 0.5
"""[m/s]: 8 kn of the ship that is 70 times as long."""
GEAR = SteeringGear(math.radians(35.0), math.radians(40.0), 0.05)
"""The angle is the laboratory's; rate and lag of a model's servo are assumed."""
WINDAGE = Windage(ahead=0.55, astern=0.80, across=0.90, cross_force=0.55, front=0.06, side=0.2, length=LENGTH)
"""Blendermann's offshore supply vessel."""
HULL = Hull(length=LENGTH, beam=BEAM, draught=0.1, roll_period=1.2, roll_damping=0.1, roll_lever=0.05, windage=True)
"""The hull that the sea meets; its roll, which moves nothing else, is assumed."""


def revolutions_of(speed: float) -> float:
    """Return the revolutions [1/s] of both propellers that hold a straight course at `speed` [m/s]."""
    resistance = -(X_U + X_UU * abs(speed) + X_UUU * speed * speed) * abs(speed)
    square, mixed = (T_NN, T_NU) if speed >= 0.0 else (T_NN_ASTERN, T_NU_ASTERN)
    flow = mixed * abs(speed)
    turns = (flow + math.sqrt(flow * flow + 2.0 * square * resistance)) / (2.0 * square)
    return math.copysign(min(turns, FULL_REVOLUTIONS), speed)


def thrust(revolutions: float, u: float) -> float:
    """Return the thrust [N] of one propeller."""
    n = revolutions
    if n >= 0.0:
        return max(T_NN * n * n - T_NU * n * u, 0.0)
    return min(-T_NN_ASTERN * n * n + T_NU_ASTERN * n * u, 0.0)


def lift(rudder: float, u: float, pull: float) -> float:
    """Return the lift [N] of one rudder at an angle [rad], behind a propeller with a `pull` [N] of thrust."""
    flow = u
    if u >= 0.0:
        disc = math.pi * WATER_DENSITY * RUDDER_DIAMETER * RUDDER_DIAMETER
        flow += RACE * (math.sqrt(max(u * u + 8.0 * pull / disc, 0.0)) - u)
    slope, bend = (L_D, L_DD) if flow >= 0.0 else (L_D_ASTERN, L_DD_ASTERN)
    return (slope - bend * abs(rudder)) * rudder * abs(flow) * flow


def accelerations(craft: Craft, motion: Motion, rudder: float, thrust_speed: float, acting: Disturbance) -> Motion:
    """Return the derivative of the motion."""
    u, v, r = motion.surge, motion.sway, motion.rate
    av, ar = abs(v), abs(r)
    pull = thrust(revolutions_of(thrust_speed), u)
    side = 2.0 * lift(rudder, u, pull)
    wind = wind_force(WINDAGE, acting.wind_ahead, acting.wind_starboard)
    fade = u / BOW_FADES
    bow = BOW_THRUST * acting.bow * math.exp(-fade * fade)
    x = (X_U + X_UU * abs(u) + X_UUU * u * u) * u + 2.0 * pull + wind.ahead
    y = (Y_V + Y_VV * av + Y_RV * ar) * v + (Y_R + Y_VR * av + Y_RR * ar) * r - side + wind.starboard + bow
    n = (N_V + N_VV * av + N_RV * ar) * v + (N_R + N_VR * av + N_RR * ar) * r + RUDDER_LEVER * side
    return planar(craft, motion, Push(x, y, n + wind.yaw + BOW_LEVER * bow), acting)


CRAFT = Craft(GEAR, HULL, Inertia(MASS + 2.0, MASS + 10.0, MASS * CENTRE, INERTIA + 1.0))
PLANTS = (
    PlantKind(
        "small_craft",
        of_one_size("small_craft", accelerations, CRAFT, SERVICE_SPEED),
        step_by(accelerations),
        bow=BOW_MOTOR,
    ),
)
