"""Angles: wrapping, shortest turns, unwrapping. Radians inside, degrees only at the edges."""

from __future__ import annotations

import math

PI, TWO_PI = math.pi, 2.0 * math.pi


def wrap(angle: float) -> float:
    """Return `angle` [rad] in the half-open interval (-pi, pi]; non-finite input gives nan.

    An angle that is inside already comes back unchanged, bit for bit.
    """
    if -PI < angle <= PI:
        return angle
    if not math.isfinite(angle):
        return math.nan
    wrapped = math.remainder(angle, TWO_PI)
    return PI if wrapped == -PI else wrapped


def wrap_positive(angle: float) -> float:
    """Return `angle` [rad] in [0, 2 pi), as a compass shows it; non-finite input gives nan."""
    if not math.isfinite(angle):
        return math.nan
    positive = angle % TWO_PI
    return 0.0 if positive >= TWO_PI else positive


def shortest_turn(from_heading: float, to_heading: float) -> float:
    """Return the signed turn [rad] in (-pi, pi] that leads from one heading [rad] to another."""
    turn = to_heading - from_heading
    return turn if -PI < turn <= PI else wrap(turn)


def compass_deg(heading: float) -> float:
    """Return `heading` [rad] as degrees in [0, 360)."""
    degrees = math.degrees(wrap_positive(heading))
    return 0.0 if degrees >= 360.0 else degrees


def compass_text(heading: float, decimals: int = 0) -> str:
    """Return `heading` [rad] as it is written: three digits before the point, and 000 where it rounds to 360."""
    degrees = round(compass_deg(heading), decimals) % 360.0
    return f"{degrees:0{4 + decimals if decimals else 3}.{decimals}f}"
