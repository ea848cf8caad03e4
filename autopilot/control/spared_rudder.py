"""Gains that spare the rudder: the linear-quadratic regulator with a weight on the rudder's rate, in closed form.

For the linear boat e'' + n e' = (K/T) u, n = n1/T, with the rudder's rate u' as the input, the least of the mean of

    e^2 + weight^2 u'^2   is   u' = -k3 (u - delta),   delta = -(T/K) [W e + (S - n) e']:

the backstepping law with smoothing 1/k3. The closed loop p(s) = s^3 + a s^2 + b s + c is the stable half of
p(s) p(-s) = q^2 + s^4 (n^2 - s^2), q = K/(T weight), so that

    c = q,   b = (a^2 - n^2)/2,   (a^2 - n^2)^2 = 8 a q,   k3 = a - n,   S = b/k3 = (a + n)/2,   W = q/k3.

The third has one root a above |n|. w = q^(1/3), the mean distance of the poles from the origin, stands for the weight:
a boat is asked for a bandwidth, not for seconds.
Source: symmetric root locus, Kailath 1980, section 3.4; the closed form derived here.
"""

from __future__ import annotations

from autopilot.control.backstepping import BacksteppingGains
from autopilot.models.norrbin import Norrbin

BISECTIONS = 60


def spared_gains(model: Norrbin, bandwidth: float) -> BacksteppingGains:
    """Return the regulator's gains for the `bandwidth` w [rad/s], see the module's equations."""
    n, q = model.n1 / model.time_constant, bandwidth**3
    low, high = abs(n), abs(n) + 2.0 * bandwidth
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if (middle * middle - n * n) ** 2 < 8.0 * middle * q:
            low = middle
        else:
            high = middle
    k3 = high - n
    return gains_of_loop(0.5 * (high + n), q / k3, 1.0 / k3)


def gains_of_loop(total: float, square: float, smoothing: float = 0.0) -> BacksteppingGains:
    """Return gains with k1 + k2 = `total` S [1/s] and gamma + k1 k2 = `square` W [1/s^2]; the loop knows no more."""
    slow = min(0.5 * total, 0.75 * square / total)
    return BacksteppingGains(slow, total - slow, square - slow * (total - slow), smoothing)
