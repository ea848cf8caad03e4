"""Gains of the law of heading and roll for a boat whose roll was identified.

The model is the row of roll, the yaw of the vessel file's model, and a sway that nothing hangs on:

    v' = -v/T,   p' = a_p p + a_r r + a_phi phi + b_p delta,   r' = -(n1 r - K delta)/T

The feedback k on p, r and phi minimises the integral of q p^2 + delta^2 (Riccati), with the least q that gives the roll
the damping asked for; less is asked for where the law is not stable from 20 to 150 % of the reference speed, with the
rudder's lag and the loop's dead time. The surfaces are reached with time constants of several T: a slack course, as
docs/roll_damping.md says of the law.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_are

from autopilot.control.law import LawBoat
from autopilot.control.rudder_roll import RollGains
from autopilot.control.sliding_heading import SwayYawGains, sway_yaw_law
from autopilot.control.sliding_roll import (
    STEERING,
    QuietHeading,
    RollShip,
    Row,
    SlidingRoll,
    linear_model,
    roll_numbers,
)

ASKED = (2.0, 1.7, 1.45, 1.25)
"""The roll's damping ratio under the law, in those of the boat itself; the first that is stable counts. More than twice
has the rudder at its stops in any sea."""
LARGEST = 0.5
"""A boat that damps its roll by more of critical than this needs no law for it."""
QUIET_YAW, QUIET_REACH, ROLL_REACH = 0.85, 0.4, 0.12
"""The quiet law's K k_r, and how quickly its surface and the roll law's are reached, in 1/T; as in the shipped file of
the naval vessel, which sailed (benchmarks/results/liu2017.md): 0.85, 0.38 and 0.11."""
QUIET_BOUNDARY, ROLL_BOUNDARY = 0.5, 1.2
"""Width of the two layers for |h| = 1, as in that file."""
LARGEST_WEIGHT = 1.0e6

Array = NDArray[np.float64]


def roll_section(row: Row, boat: LawBoat, source: str, date: str) -> SlidingRoll:
    """Return the law's section for the row of roll at the reference speed of `boat`. ValueError where there is none."""
    model = boat.model
    if model.n1 <= 0.0:
        raise ValueError("the boat is course-unstable, and this law needs one that runs straight by itself")
    yaw: Row = (0.0, 0.0, -model.n1 / model.time_constant, 0.0, model.gain / model.time_constant)
    sway: Row = (-1.0 / model.time_constant, 0.0, 0.0, 0.0, 0.0)
    linear = linear_model((sway, row, yaw))
    own = _damping(linear.A[1:4, 1:4])
    ship = RollShip(
        linear,
        model.reference_speed,
        boat.gear._replace(angle_max=boat.limits.angle_max, rate_max=boat.limits.rate_max),
        boat.delay,
        model.gain / model.reference_speed,
    )
    quiet = SwayYawGains(
        0.0, QUIET_YAW / model.gain, QUIET_REACH / model.time_constant * QUIET_BOUNDARY, QUIET_BOUNDARY
    )
    sway_yaw_law(linear.A[np.ix_(STEERING, STEERING)], linear.b[STEERING], quiet)
    reason = ""
    for asked in ASKED:
        if own > LARGEST:
            break
        try:
            k_p, k_r, k_phi = _feedback(linear.A[1:4, 1:4], linear.b[1:4], asked * own)
            reach = ROLL_REACH / model.time_constant * ROLL_BOUNDARY
            roll_numbers(ship, quiet, RollGains(0.0, k_p, k_r, k_phi, reach, ROLL_BOUNDARY))
        except ValueError as error:
            reason = str(error)
            continue
        return SlidingRoll(
            sway_row=_rounded(sway),
            roll_row=_rounded(row),
            yaw_row=_rounded(yaw),
            k_v_s_m=0.0,
            k_p_s=float(f"{k_p:.4g}"),
            k_r_s=float(f"{k_r:.4g}"),
            k_phi=float(f"{k_phi:.4g}"),
            reach=float(f"{reach:.4g}"),
            boundary=ROLL_BOUNDARY,
            quiet=QuietHeading(*(float(f"{one:.4g}") for one in quiet)),
            source=source,
            date=date,
        )
    raise ValueError(
        reason or f"the boat damps its roll by {own:.2f} of critical by itself; this law adds nothing to that"
    )


def _rounded(row: Row) -> Row:
    v, p, r, phi, rudder = (float(f"{one:.6g}") for one in row)
    return v, p, r, phi, rudder


def _damping(A: Array) -> float:
    """Return the least damping ratio of the modes that swing, 1 where none does."""
    poles = np.linalg.eigvals(A)
    return min((float(-pole.real / abs(pole)) for pole in poles if abs(pole.imag) > 1.0e-9), default=1.0)


def _feedback(A: Array, b: Array, asked: float) -> tuple[float, float, float]:
    """Return k on p, r and phi of the least weight q that gives the damping asked for. ValueError where none does."""
    column = b[:, None]

    def gains(log: float) -> Array:
        found = solve_continuous_are(A, column, np.diag([math.exp(log), 1.0e-9, 1.0e-9]), np.eye(1))
        k: Array = (column.T @ found)[0]
        return k

    low, high = math.log(1.0e-8), math.log(LARGEST_WEIGHT)
    if _damping(A - np.outer(b, gains(high))) < asked:
        raise ValueError(f"no feedback damps the roll to {asked:g} of critical")
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _damping(A - np.outer(b, gains(middle))) >= asked else (middle, high)
    k = gains(high)
    return float(k[0]), float(k[1]), float(k[2])
