"""The quickest change of heading that a rudder of limited angle and rate can give a Norrbin boat, by two methods.

For psi' = r, r' = f(r, delta), delta' = u with |u| <= rate_max and |delta| <= angle_max the quickest way from straight
running on one heading to straight running on another has bang-bang u (Pontryagin), the rudder resting at its stop in
between: over, hold, across, hold, back amidships. `bang_bang` finds the two free times by shooting. `collocated` knows
nothing of this: it discretises the equations by the trapezoidal rule and lets an optimiser find rudder and time.
Lag and dead time of the steering gear are left out of both, which only makes the bound harder to meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy.optimize import Bounds, NonlinearConstraint, brentq, minimize

from autopilot.models.norrbin import Norrbin, yaw_acceleration

STEPS_A_PHASE = 60

Floats = npt.NDArray[np.float64]


def _phase(
    model: Norrbin, heading: float, rate: float, rudder: float, moving: float, seconds: float
) -> tuple[float, float, float]:
    """Return heading, rate and rudder after a rudder that moves at `moving` [rad/s] for `seconds`; Runge-Kutta."""
    h = seconds / STEPS_A_PHASE
    for _ in range(STEPS_A_PHASE):
        middle, end = rudder + 0.5 * h * moving, rudder + h * moving
        a = yaw_acceleration(model, rate, rudder)
        b = yaw_acceleration(model, rate + 0.5 * h * a, middle)
        c = yaw_acceleration(model, rate + 0.5 * h * b, middle)
        d = yaw_acceleration(model, rate + h * c, end)
        heading += h * (rate + h / 6.0 * (a + b + c))
        rate += h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        rudder = end
    return heading, rate, rudder


def _driven(
    model: Norrbin, angle: float, speed: float, first: float, second: float, braked: float = 1.0
) -> tuple[float, float, float]:
    """Return heading, rate and time after `first` [s] towards +angle, `second` [s] towards -angle, and back to 0.

    braked: the share of angle and speed that the rudder has from the second way on.
    """
    now = (0.0, 0.0, 0.0)
    total = 0.0
    for goal, seconds, share in ((angle, first, 1.0), (-braked * angle, second, braked), (0.0, math.inf, braked)):
        way = goal - now[2]
        ramp = min(abs(way) / (share * speed), seconds)
        now = _phase(model, *now, math.copysign(share * speed, way), ramp)
        total += ramp
        if math.isfinite(seconds) and seconds > ramp:
            now = _phase(model, *now, 0.0, seconds - ramp)
            total += seconds - ramp
    return now[0], now[1], total


def bang_bang(model: Norrbin, angle_max: float, rate_max: float, change: float, braked: float = 1.0) -> float:
    """Return the least time [s] for a `change` > 0 of heading [rad] under a rudder of `angle_max`, `rate_max` [rad].

    braked: the turn is ended with this share of the rudder's angle and rate, so that a rudder which is weaker by as
    much would still end it.
    """
    longest = 4.0 * angle_max / rate_max + 20.0 * model.time_constant

    def driven(first: float, second: float) -> tuple[float, float, float]:
        return _driven(model, angle_max, rate_max, first, second, braked)

    def met(first: float) -> float:
        """Counter-rudder's duration [s] that ends the turn; inf: none does."""
        if driven(first, longest)[1] >= 0.0:
            return math.inf
        return _root(lambda second: driven(first, second)[1], 0.0, longest)

    def left(first: float) -> float:
        second = met(first)
        return driven(first, second)[0] - change if math.isfinite(second) else change

    first = _root(left, 1.0e-3 * longest, 2.0 * longest)
    return driven(first, met(first))[2]


def settled(model: Norrbin, angle_max: float, rate_max: float, change: float, braked: float, near: float) -> float:
    """Return when [s] the turn of `bang_bang` is within `near` [rad] of its end, short of which it never stays."""
    return bang_bang(model, angle_max, rate_max, change, braked) - _last_part(model, angle_max, rate_max, braked, near)


def _last_part(model: Norrbin, angle_max: float, rate_max: float, braked: float, near: float) -> float:
    """Return how long [s] the last `near` [rad] of a turn take: backwards from rest, the rudder from amidships."""
    h, time, heading, rate = 1.0e-3, 0.0, 0.0, 0.0
    while heading > -near:
        rudder = -min(braked * rate_max * (time + 0.5 * h), braked * angle_max)
        half = rate - 0.5 * h * yaw_acceleration(model, rate, rudder)
        before, rate = rate, rate - h * yaw_acceleration(model, half, rudder)
        heading -= 0.5 * h * (before + rate)
        time += h
    return time


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=1.0e-9, rtol=1.0e-10))


def collocated(model: Norrbin, angle_max: float, rate_max: float, change: float, parts: int = 40) -> float:
    """Return the least time [s] by direct collocation on `parts` intervals: no structure of the solution is assumed."""
    scale_r, guess = change, _guess(model, angle_max, rate_max, change)

    def unpack(z: Floats) -> tuple[Floats, Floats, Floats, float]:
        n = parts + 1
        return z[:n] * change, z[n : 2 * n] * scale_r, z[2 * n : 3 * n] * angle_max, float(z[-1]) * guess

    def defects(z: Floats) -> Floats:
        psi, r, delta, time = unpack(z)
        h, a = time / parts, np.asarray(yaw_acceleration(model, r, delta))  # type: ignore[arg-type]
        return np.concatenate(
            [
                np.diff(psi) - 0.5 * h * (r[1:] + r[:-1]) + h * h / 12.0 * (a[1:] - a[:-1]),
                np.diff(r) - 0.5 * h * (a[1:] + a[:-1]),
            ]
        )

    def rate_left(z: Floats) -> Floats:
        _, _, delta, time = unpack(z)
        moved = np.diff(delta) / rate_max
        return np.concatenate([time / parts - moved, time / parts + moved])

    n = parts + 1
    low, high = np.full(3 * n + 1, -np.inf), np.full(3 * n + 1, np.inf)
    low[2 * n : 3 * n], high[2 * n : 3 * n] = -1.0, 1.0
    low[-1], high[-1] = 0.2, 5.0
    for place, value in ((0, 0.0), (n - 1, 1.0), (n, 0.0), (2 * n - 1, 0.0), (2 * n, 0.0), (3 * n - 1, 0.0)):
        low[place] = high[place] = value
    along = np.linspace(0.0, 1.0, n)
    start = np.concatenate([along, np.sin(math.pi * along) / guess, 0.5 * np.sin(2.0 * math.pi * along), [1.5]])
    found = minimize(
        lambda z: z[-1],
        start,
        jac=lambda z: np.eye(1, 3 * n + 1, 3 * n)[0],
        method="SLSQP",
        bounds=Bounds(low, high),
        constraints=[
            NonlinearConstraint(defects, 0.0, 0.0),
            NonlinearConstraint(rate_left, 0.0, np.inf),
        ],
        options={"maxiter": 300, "ftol": 1.0e-9},
    )
    if not found.success:
        raise ArithmeticError(f"collocation: {found.message}")
    return float(found.x[-1]) * guess


def _guess(model: Norrbin, angle_max: float, rate_max: float, change: float) -> float:
    return change / (model.gain * angle_max) + model.time_constant + angle_max / rate_max
