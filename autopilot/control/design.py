"""Gains from model, rudder and delay, with the margins they leave.

About straight running the loop, cut at the rudder, is

    L(s) = (p + i/s + d s)/(smoothing s + 1) * K / (s (T s + n1)) * exp(-s tau) / (lag s + 1)

with p, i and d the law's gains on heading error, its integral and the rate, and smoothing that of its rudder. From its
frequency response come gain, phase and delay margin and the worst sensitivity Ms = max |1/(1 + L)| (Astrom and Murray
2021, ch. 10).
The rudder's rate adds a limit of its own: at the crossover frequency w an error of amplitude A asks for a
rudder moving at A |C(jw)| w, so that errors above rate_max/(|C| w) find the rudder saturated.
"""

from __future__ import annotations

import cmath
import itertools
import math
from typing import NamedTuple

from autopilot.control import backstepping
from autopilot.control.backstepping import BacksteppingGains, linear_gains_backstepping
from autopilot.control.law import LoopGains
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

DESIGNED = backstepping.LAW.name
"""The law whose gains are designed; those of the others follow from its loop."""


WORST_SENSITIVITY = 1.6
"""Ms that a design may reach; 1.4 is cautious, 2.0 is the usual limit."""
SENSITIVITY_MOST = 2.0
"""A peak of the sensitivity above 2 is less than a usual margin (Astrom and Murray)."""
DAMPING = math.sqrt(0.8)
"""Of designed loops that do not spare the rudder."""
LEAST_ERROR = math.radians(1.0)
"""A heading error this small must not saturate the rudder's rate in a designed loop."""
MIDDLE_LEVEL = 5
"""Of the response levels 1 to 9."""
REFUSED_ERROR = math.radians(0.1)
"""A loop whose rudder rate saturates at errors as small as this limit-cycles on compass noise alone."""
BANDWIDTHS = (0.03, 100.0)
"""Times 1/T: slower loops cross over below the frequencies that are judged, and quicker ones no rudder follows."""
GRID = 400


class Margins(NamedTuple):
    """gain [-] (inf: none needed), phase [rad], delay [s], sensitivity Ms [-], crossover [rad/s], stable or not,
    saturation: heading error amplitude [rad] at the crossover from which the rudder's rate saturates."""

    gain: float
    phase: float
    delay: float
    sensitivity: float
    crossover: float
    stable: bool
    saturation: float


class Verdict(NamedTuple):
    """Margins, and the reason not to engage ("" when there is none)."""

    margins: Margins
    refusal: str


def controller(gains: LoopGains, omega: float) -> complex:
    """Return C(j omega), omega [rad/s]."""
    asked = complex(gains.proportional, gains.derivative * omega - gains.integral / omega)
    return asked / complex(1.0, gains.smoothing * omega)


class AheadGains(NamedTuple):
    """The gains of a law that acts on the state `ahead` [s] later, on the state that is: on heading and rate, on the
    bias more than without, on the rudder as it stands and on the last order."""

    heading: float
    rate: float
    bias: float
    rudder: float
    order: float


def ahead_gains(model: Norrbin, gains: LoopGains) -> AheadGains:
    """Return what reckoning ahead makes of the gains: `heading_ekf.carried_ahead` about straight running."""
    p, d, t = gains.proportional, gains.derivative, gains.ahead
    if t <= 0.0:
        return AheadGains(p, d, 0.0, 0.0, 0.0)
    n, drive = model.n1 / model.time_constant, model.gain / model.time_constant
    x = n * t
    once, twice, thrice = 1.0 - 0.5 * x, 0.5 - x / 6.0, 1.0 / 6.0 - x / 24.0
    if abs(x) > 1.0e-3:
        once = -math.expm1(-x) / x
        twice = (1.0 - once) / x
        thrice = (0.5 - twice) / x
    return AheadGains(
        p,
        p * t * (1.0 - x * twice) + d * (1.0 - x * once),
        drive * t * (p * t * twice + d * once),
        drive * t * (p * t * (twice - thrice) + d * (once - twice)),
        drive * t * (p * t * thrice + d * twice),
    )


def loop(model: Norrbin, lag: float, delay: float, gains: LoopGains, omega: float) -> complex:
    """Return L(j omega), omega [rad/s]: the module's equation; what reckons ahead knows the orders that it gave."""
    s = 1j * omega
    plant = model.gain / (s * (model.time_constant * s + model.n1))
    if gains.ahead == 0.0:
        return controller(gains, omega) * plant * cmath.exp(-s * delay) / (lag * s + 1.0)
    on = ahead_gains(model, gains)
    acts = cmath.exp(-s * max(gains.ahead - lag, 0.0)) / (lag * s + 1.0)
    asked = on.heading + gains.integral / s + on.rate * s
    return (
        asked
        * plant
        * cmath.exp(-s * delay)
        / (lag * s + 1.0)
        / (1.0 + gains.smoothing * s + on.rudder * acts + on.order)
    )


def margins(model: Norrbin, lag: float, delay: float, rate_max: float, gains: LoopGains) -> Margins:
    """Return the margins of the loop with a first-order `lag` [s], dead time `delay` [s] and rudder `rate_max` [rad/s].

    Stability is decided by the Nyquist criterion on a logarithmic grid around the loop's own frequencies.
    """
    scale = max(1.0 / model.time_constant, _rough_crossover(model, gains))
    low, high = 1.0e-3 * min(scale, 1.0 / model.time_constant), 1.0e3 * scale
    omegas = [low * (high / low) ** (index / (GRID - 1)) for index in range(GRID)]
    values = [loop(model, lag, delay, gains, omega) for omega in omegas]
    sensitivity = max(1.0 / abs(1.0 + value) for value in values)
    crossover, phase = _crossover(omegas, values)
    saturation = math.inf
    if math.isfinite(rate_max) and crossover > 0.0:
        saturation = rate_max / (abs(controller(gains, crossover)) * crossover)
    stable = _encirclements(model, gains, values)
    return Margins(
        gain=_gain_margin(omegas, values),
        phase=phase,
        delay=phase / crossover if crossover > 0.0 else math.inf,
        sensitivity=sensitivity,
        crossover=crossover,
        stable=stable,
        saturation=saturation,
    )


def _rough_crossover(model: Norrbin, gains: LoopGains) -> float:
    drive = model.gain / model.time_constant
    return max(math.sqrt(drive * gains.proportional), drive * abs(gains.derivative), 1.0e-6)


def _crossover(omegas: list[float], values: list[complex]) -> tuple[float, float]:
    """Return the highest frequency [rad/s] where |L| falls through 1, and the phase margin [rad] there."""
    falls = [
        (omega, here)
        for omega, (here, above) in zip(omegas, itertools.pairwise(values), strict=False)
        if abs(here) >= 1.0 > abs(above)
    ]
    if not falls:
        return 0.0, math.pi
    omega, value = falls[-1]
    return omega, math.remainder(cmath.phase(value) - math.pi, math.tau)


def _gain_margin(omegas: list[float], values: list[complex]) -> float:
    """Return the factor by which the gain may still grow: 1/|L| at the first crossing of the negative real axis."""
    best = math.inf
    for before, after in itertools.pairwise(values):
        if before.real < 0.0 and after.real < 0.0 and before.imag < 0.0 <= after.imag and 0.0 < abs(after) < 1.0:
            best = min(best, 1.0 / abs(after))
    return best


def _encirclements(model: Norrbin, gains: LoopGains, values: list[complex]) -> bool:
    """Nyquist: the turns of 1 + L from the lowest to the highest frequency must make up for the open loop's poles.

    Every integrator at the origin and every unstable pole costs half a turn of the upper half of the curve.
    """
    turned = 0.0
    for before, after in itertools.pairwise(values):
        turned += cmath.phase((1.0 + after) / (1.0 + before))
    integrators = 1 + (1 if gains.integral > 0.0 else 0)
    unstable = 1 if model.n1 < 0.0 else 0
    wanted = math.pi * (0.5 * integrators + unstable)
    return abs(turned - wanted) < 0.5


def judge(model: Norrbin, gear: SteeringGear, rate_max: float, loop_delay: float, gains: LoopGains) -> Verdict:
    """Return the margins with the real rudder, and why these gains must not be engaged where they must not.

    `rate_max` [rad/s] is what limits and gear leave; `loop_delay` [s] comes on top of the gear's own delay.
    """
    found = margins(model, gear.lag, gear.delay + loop_delay, rate_max, gains)
    rudder = (
        f"a rudder with {_rate_text(rate_max)}, {gear.lag:.2f} s lag and "
        f"{gear.delay + loop_delay:.2f} s delay in the loop"
    )
    cure = "lower the gains, or let `autopilot gains` design them for this rudder"
    if not found.stable:
        return Verdict(found, f"refused to engage: the loop is unstable with {rudder}; {cure}")
    if found.saturation < REFUSED_ERROR:
        return Verdict(
            found,
            f"refused to engage: with {rudder} the rudder's rate saturates at a heading error of "
            f"{math.degrees(found.saturation):.3f} deg and the loop would limit-cycle; {cure}",
        )
    return Verdict(found, "")


def design_backstepping(
    model: Norrbin,
    gear: SteeringGear,
    rate_max: float,
    loop_delay: float,
    level: int = MIDDLE_LEVEL,
) -> BacksteppingGains:
    """Return gains of a response `level` from 1 (calm) to 9 (quick).

    Level 5 is the quickest loop that keeps WORST_SENSITIVITY and leaves the rudder's rate room for LEAST_ERROR. Three
    levels down the loop is half as quick. Three levels up it is twice as quick where the margins allow it: each level
    lets Ms grow by 0.1 and the error that must not saturate the rate shrink by the root of two.
    The damping ratio is 0.89, or more where the boat has more by itself. Raises ValueError for another level, and where
    no gain keeps the margins: the rudder is too slow for this boat.
    """
    if not 1 <= level <= 9:
        raise ValueError(f"response level {level}: allowed is 1 (calm) to 9 (quick)")

    steered = Steered(model, gear, rate_max, gear.delay + loop_delay)
    k = _quickest(steered, WORST_SENSITIVITY, LEAST_ERROR)
    above = level - MIDDLE_LEVEL
    wanted = k * math.exp2(above / 3.0)
    if above > 0:
        worst, least_error = WORST_SENSITIVITY + 0.1 * above, LEAST_ERROR * math.exp2(-0.5 * above)
        wanted = min(wanted, _quickest(steered, worst, least_error))
    return _at(model, wanted)


class Steered(NamedTuple):
    """A boat with its rudder, and the dead time [s] of the whole loop."""

    model: Norrbin
    gear: SteeringGear
    rate_max: float
    delay: float


def _quickest(steered: Steered, worst: float, least_error: float) -> float:
    """Return the largest k [1/s] whose loop is stable, with Ms up to `worst` and room for `least_error` [rad]."""
    model, gear, rate_max, delay = steered

    def holds(k: float) -> bool:
        found = margins(model, gear.lag, delay, rate_max, linear_gains_backstepping(model, _at(model, k)))
        return found.stable and found.sensitivity <= worst and found.saturation >= least_error

    slowest, quickest = 1.0e-3 / model.time_constant, 1.0e2 / model.time_constant
    for index in range(120, -1, -1):
        k = slowest * math.pow(quickest / slowest, index / 120)
        if holds(k):
            return k
    raise ValueError("design: no gain gives a stable loop with margins: the steering gear is too slow for this boat")


def bandwidths_of(model: Norrbin) -> tuple[float, float]:
    """Return the least and the largest bandwidth [rad/s] that is looked at for a boat."""
    low, high = BANDWIDTHS
    return low / model.time_constant, high / model.time_constant


class Spread(NamedTuple):
    """How far the boat may be from its model: relative, of K and of T, to either side."""

    gain: float
    time_constant: float


def worst_margins(
    model: Norrbin, gear: SteeringGear, rate_max: float, loop_delay: float, gains: LoopGains, spread: Spread
) -> Margins:
    """Return the margins of the worst of the boats within the `spread`, the gains being what they are.

    The four corners of K and T and the four edges between them; the least stable first, then by sensitivity.
    """
    boats = [
        model._replace(
            gain=model.gain * (1.0 + a * spread.gain),
            time_constant=model.time_constant * (1.0 + b * spread.time_constant),
        )
        for a in (-1.0, 0.0, 1.0)
        for b in (-1.0, 0.0, 1.0)
    ]
    found = [margins(boat, gear.lag, gear.delay + loop_delay, rate_max, gains) for boat in boats]
    return max(found, key=lambda each: (not each.stable, each.sensitivity))


def _at(model: Norrbin, k: float) -> BacksteppingGains:
    """Return the gains of bandwidth w = k/zeta, zeta = DAMPING, keeping what damping the boat has by itself.

    The closed loop is z1'' + S z1' + w^2 z1 = 0. S = k1 + k2 = 2 zeta w, but never less than the boat's own n1/T:
    below that the law would have to drive the boat on against its damping, a positive feedback of the rate that costs
    margin the more the calmer the loop is meant to be.
    """
    damping = max(2.0 * k, model.n1 / model.time_constant)
    apart = math.sqrt(max(0.25 * damping * damping - k * k, 0.0))
    slow = k * k / (0.5 * damping + apart)
    return BacksteppingGains(slow, damping - slow, 0.25 * k * k)


def _rate_text(rate_max: float) -> str:
    return "unlimited rate" if math.isinf(rate_max) else f"{math.degrees(rate_max):.1f} deg/s"
