"""The corrected Norrbin backstepping heading law.

With z1 = wrap(psi - psi_d), alpha = -k1 z1 + psi_d', z2 = r - alpha and V = (g z1^2 + z2^2)/2, the rudder

    delta = (T/K) [-k2 z2 - g z1 + (n1 r + n2 r^2 + n3 r^3 + n0)/T + psi_d'' - k1 (r - psi_d')] - b

makes V' = -g k1 z1^2 - k2 z2^2 and z1'' + (k1 + k2) z1' + (g + k1 k2) z1 = 0. b is the rudder angle that
wind, current and trim are worth: the estimator learns it from the rudder that was really told, so that there
is nothing here to wind up.

A heading error larger than E counts as E: the law then turns the boat back at the rate (W/S) E, with W = g + k1 k2 and
S = k1 + k2, in place of swinging it to and fro with a rudder that is always late. With e = z1 and a course or a rate
that is held,

    e'' + S e' + W sat(e) = 0,   V = e'^2/2 + W int_0^e sat(y) dy,   V' = -S e'^2,

stable however large the error. E is where a swing at the loop's natural frequency, e = A sin(sqrt(W) t), asks for
OVERTAXED times the rudder's rate, A (T/K) W sqrt(W + (S - n1/T)^2), but not below LEAST_BOUND.

The damping n1 r + n2 r^2 + n3 r^3 + n0 counts for no more rudder than there is, that is up to the steady rate of a
rudder hard over. No trial has seen what it is beyond, and n3 ~ 1/U^2: a speed that is read too low would have the law
turn the boat ever faster to make up for a damping that is not there.

A third step spares the rudder: it does not jump to delta, it goes there at a rate,

    u' = -k3 (u - delta - b),   u = rudder + b,   k3 = 1/smoothing.

With a course or a rate r_d that is held the boat's damping d(r) = n3 r^3 + n2 r^2 + n1 r + n0 cancels but for its
slope, and

    e''' + a(r) e'' + k3 S e' + k3 W e = 0,   a(r) = k3 + d'(r)/T,
    V3 = (e'' + W/S e')^2/2 + k3 S (e' + W/S e)^2/2 + W/S int_0^e' (a(r_d + y) - W/S) y dy,
    V3' = -(a(r) - W/S) e''^2:

stable, however large the error, where k3 + d'(r)/T > W/S at every rate; nothing but e = e' = 0 keeps e'' = 0. The
linear-quadratic regulator with a weight on the rudder's rate is of this form (`autopilot.control.design`). u begins
each time at the rudder that was really told: nothing winds up, and engaging makes no bump. A planned turn that takes
rudder is steered without this step, as the plan wants its rudder at once.

The paper has g = 1 1/s^2, hidden in V = (z1^2 + z2^2)/2. Left at 1 it asks a boat with K = 0.1 1/s and
T = 20 s for at least 200 deg of rudder per degree of error however small k1 and k2 are; so g is a gain here.

Source: Jiang et al. 2016, eqs (6)-(25), derived anew: their eq. (26) prints K/T for T/K, (1 - k1 k2) for
-(1 + k1 k2) and -(k1 + k2) psi_d' for +(k1 + k2) psi_d'.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, rudder_for, rudder_within
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState, Reference

SPEED_RANGE = (0.2, 1.5)
"""Share of the reference speed within which the gains follow the speed."""
PLANNED = math.radians(1.0)
"""A planned turn with less rudder than this is no more than keeping a course."""
LEAST_BOUND = math.radians(2.0)
"""Heading errors up to this count in full: so far a planned turn may run ahead of the boat."""
OVERTAXED = 1.7
"""The law answers an error in proportion up to one whose swing takes this many times the rudder's rate. With less,
quick loops lag in turns and a launch is held worse in following seas; with 2 and more, a boat turning 40 % better than
its model may swing about its course for ever after a push that its rudder did not hold: benchmarks/results/gains.md."""


class BacksteppingGains(NamedTuple):
    """k1 [1/s] on the heading error, k2 [1/s] on the rate error, gamma [1/s^2] the weight of the heading error, and
    smoothing [s], the time in which the rudder goes to what they ask for; 0: at once."""

    k1: float
    k2: float
    gamma: float = 1.0
    smoothing: float = 0.0


def gains_at(gains: BacksteppingGains, speed_ratio: float) -> BacksteppingGains:
    """Return the gains at `speed_ratio` times the speed at which they hold."""
    ratio = _followed(speed_ratio)
    return BacksteppingGains(gains.k1 * ratio, gains.k2 * ratio, gains.gamma * ratio * ratio, gains.smoothing / ratio)


def _followed(speed_ratio: float) -> float:
    return clip(speed_ratio, SPEED_RANGE[0], SPEED_RANGE[1])


def error_max_of(model: Norrbin, gains: BacksteppingGains, rudder_rate: float) -> float:
    """Return the largest heading error [rad] to be answered in proportion, see the module's docstring.

    rudder_rate [rad/s]: inf where it is not limited.
    """
    total, square = gains.k1 + gains.k2, gains.gamma + gains.k1 * gains.k2
    steered = total - model.n1 / model.time_constant
    asked = model.time_constant / model.gain * square * math.sqrt(square + steered * steered)
    # gains too small for a number to hold what they ask for can follow any error
    return max(OVERTAXED * rudder_rate / asked, LEAST_BOUND) if asked > 0.0 else math.inf


def error_max_at(error_max: float, speed_ratio: float) -> float:
    """Return the largest heading error [rad] to be answered at `speed_ratio` times the speed at which the gains hold.

    The boat answers the rudder by the square of the speed, and the gains ask for its third power.
    """
    return max(error_max / _followed(speed_ratio), LEAST_BOUND)


def errors(
    gains: BacksteppingGains, heading: float, rate: float, reference: Reference, error_max: float = math.inf
) -> tuple[float, float]:
    """Return z1 [rad], `error_max` [rad] at most, and z2 [rad/s], eqs (6), (9) and (14)."""
    z1 = clip(wrap(heading - reference.heading), -error_max, error_max)
    return z1, rate - (reference.rate - gains.k1 * z1)


def backstepping_rudder(
    model: Norrbin,
    gains: BacksteppingGains,
    reference: Reference,
    heading: float,
    rate: float,
    bias: float = 0.0,
    error_max: float = math.inf,
    rudder_max: float = math.inf,
) -> float:
    """Return the unlimited rudder demand [rad] of the law in the module's docstring."""
    z1, z2 = errors(gains, heading, rate, reference, error_max)
    wanted = -gains.k2 * z2 - gains.gamma * z1 + reference.acceleration - gains.k1 * (rate - reference.rate)
    return rudder_within(model, rate, wanted, rudder_max) - bias


def smoothed_rudder(smoothing: float, wanted: float, last_rudder: float, dt: float) -> float:
    """Return the demand [rad] of the third step, `dt` [s] after the rudder was told `last_rudder` [rad].

    wanted: what `backstepping_rudder` asks for [rad].
    """
    if smoothing == 0.0:
        return wanted
    return last_rudder - math.expm1(-dt / smoothing) * (wanted - last_rudder)


def smoothing_in(model: Norrbin, smoothing: float, reference: Reference) -> float:
    """Return the smoothing [s] that is in force: none in a planned turn that takes more than PLANNED of rudder."""
    if smoothing == 0.0:
        return 0.0
    planned = rudder_for(model, reference.rate, reference.acceleration) - rudder_for(model, 0.0, 0.0)
    return 0.0 if abs(planned) > PLANNED else smoothing


def printed_equation_26(
    model: Norrbin, gains: BacksteppingGains, reference: Reference, heading: float, rate: float
) -> float:
    """Return the rudder [rad] that eq. (26) gives as printed, misprints and all: to show what they do."""
    z1 = wrap(heading - reference.heading)
    k1, k2 = gains.k1, gains.k2
    return (model.gain / model.time_constant) * (
        (-k1 - k2 + 1.0 / model.time_constant) * rate
        + model.n3 / model.time_constant * rate**3
        + (1.0 - k1 * k2) * z1
        - (k1 + k2) * reference.rate
        + reference.acceleration
    )


class BacksteppingLaw:
    """The law as the pilot holds it. It has no memory: bias and limits reach it through the state and the rudder told.

    The gains hold at `reference_speed` [m/s] and go with the speed, as 1/T does: a slow boat is not asked
    for a quick boat's accelerations.
    """

    name = "backstepping"

    def __init__(
        self,
        gains: BacksteppingGains,
        reference_speed: float,
        error_max: float = math.inf,
        rudder_max: float = math.inf,
    ) -> None:
        if not all(0.0 < gain < math.inf for gain in gains[:3]):
            raise ValueError(f"backstepping: k1, k2 and gamma must be positive and finite, got {gains}")
        if not 0.0 <= gains.smoothing < math.inf:
            raise ValueError(f"backstepping: smoothing must be finite and not negative, got {gains.smoothing}")
        if not error_max > 0.0:
            raise ValueError(f"backstepping: the largest error must be positive, got {error_max}")
        if not rudder_max > 0.0:
            raise ValueError(f"backstepping: the most rudder must be positive, got {rudder_max}")
        self.gains, self.error_max, self.rudder_max = gains, error_max, rudder_max
        self._reference_speed = reference_speed

    def reset(self, rudder: float) -> None:
        """Nothing to forget."""

    def update(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        """Return the rudder demand [rad]."""
        ratio = model.reference_speed / self._reference_speed
        gains, most = gains_at(self.gains, ratio), error_max_at(self.error_max, ratio)
        wanted = backstepping_rudder(
            model, gains, reference, state.heading, state.rate, state.bias, most, self.rudder_max
        )
        return smoothed_rudder(smoothing_in(model, gains.smoothing, reference), wanted, last_rudder, dt)
