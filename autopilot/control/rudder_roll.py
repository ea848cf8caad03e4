"""Heading and roll with the rudder alone: the sliding mode law of Liu and Jin 2017, and when to leave it off.

    delta = -k' x~ - eta/(h'b) tanh(s/W),   s = h' x~,   (A - b k')' h = 0,   x~ = (v, p, r, phi, psi - psi_d)

eqs (32)-(34). The paper's k are degrees of rudder per SI unit and for a rudder positive to port, its eta is for
radians; (34) writes h4 b4, which is zero.

What the rudder can do about roll ends near the zero of the right half plane of rudder to roll (+0.418 rad/s for the
naval vessel at 15 knots): there the loop's sensitivity is 1 whatever the law, and reducing roll at its natural
frequency raises it below. In stern-quartering seas, met at such frequencies, any roll law amplifies. So
`RollSchedule` weighs the roll law by what it would do to the present roll:

    x_free  = x - (response of the linear model to the rudder as it stood): the ship with the rudder amidships
    x_quiet = x_free + (response of the linear model to a rudder under a quiet heading law, through the steering gear)
    x_roll  = x_free + (the same under the roll law)

All go on all the time, whoever steers. How much of the roll law is used goes with the sea: its `strength` falls until
the rudder of its shadow works no harder than a budget, which is what it may cost in speed, and within each group of
waves `RateGain` holds its part to what the gear can follow, since a rudder that its rate limits comes too late. The
weight rises where the third has rolled less than both others over the last
minutes and falls to zero where it has not.

All three lean on the model, the rudder and its gear. What the roll itself says stands above them: `Proof` holds the
roll measured under the law against that measured before it, and bars the law where too little of the promise came true.

No numpy is loaded, which a running pilot does without.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, cast

from autopilot.control.sliding_heading import SMALL, SwayYawLaw, sliding_surface, sway_yaw_rudder
from autopilot.models.steering_gear import SteeringGear, clip, gear_step

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class Motion(NamedTuple):
    """Sway v [m/s], roll rate p, yaw rate r [rad/s], roll phi and heading psi [rad]; or their derivatives."""

    v: float
    p: float
    r: float
    phi: float
    psi: float


class LinearMotion(NamedTuple):
    """x' = A x + b delta about straight running, x = (v, p, r, phi, psi), delta [rad] positive to starboard."""

    A: Array
    b: Array


class RollGains(NamedTuple):
    """k [rad rudder per SI unit] on v, p, r and phi; eta and boundary W as the paper has them."""

    k_v: float
    k_p: float
    k_r: float
    k_phi: float
    reach: float
    boundary: float


class RollLaw(NamedTuple):
    """The law made ready: feedback k, surface h, `switching` eta/(h'b) [rad], boundary W."""

    k_v: float
    k_p: float
    k_r: float
    k_phi: float
    h_v: float
    h_p: float
    h_r: float
    h_phi: float
    h_psi: float
    switching: float
    boundary: float


PAPER_ROLL = RollGains(math.radians(5.0), math.radians(200.0), math.radians(100.0), math.radians(10.0), 0.0751, 0.5)
"""Liu and Jin 2017, section 4: k = (-5, -200, -100, -10, 0) degrees per SI unit, rudder positive to port there."""


def roll_law(model: LinearMotion, gains: RollGains) -> RollLaw:
    """Return the law for the linear model of (v, p, r, phi, psi). ValueError for gains that do not stabilise it."""
    # numpy comes along only with this law
    import numpy as np

    k = np.array([gains.k_v, gains.k_p, gains.k_r, gains.k_phi, 0.0])
    h = sliding_surface(model.A, model.b, k)
    through = float(h @ model.b)
    if abs(through) < SMALL:
        raise ValueError("rudder roll: the rudder does not move s: h'b is zero")
    return RollLaw(*(float(value) for value in (*k[:4], *h, gains.reach / through, gains.boundary)))


def roll_rudder(law: RollLaw, state: Motion, heading_goal: float) -> float:
    """Return the unlimited rudder demand [rad] at `state` for the heading psi_d `heading_goal` [rad], unwrapped."""
    error = state.psi - heading_goal
    surface = law.h_v * state.v + law.h_p * state.p + law.h_r * state.r + law.h_phi * state.phi + law.h_psi * error
    feedback = law.k_v * state.v + law.k_p * state.p + law.k_r * state.r + law.k_phi * state.phi
    return -feedback - law.switching * math.tanh(surface / law.boundary)


Row = tuple[float, float, float, float, float, float]
"""What v, p, r, phi, psi and the rudder are worth."""


class LinearStep(NamedTuple):
    """v, p, r, phi and psi one step later, the rudder held: plain numbers, which cost a running pilot the least."""

    v: Row
    p: Row
    r: Row
    phi: Row
    psi: Row


SERIES = 18
"""Terms of the exponential series: exact to rounding for steps up to a second."""
FORGET = 300.0
"""Time [s] in which the two responses forget their heading, so that what the model lacks does not pile up there."""


def linear_step_of(model: LinearMotion, dt: float) -> LinearStep:
    """Return the exact step over `dt` [s] of the linear model whose heading leaks with the time constant FORGET."""
    import numpy as np

    block = np.zeros((6, 6))
    block[:5, :5], block[:5, 5] = model.A, model.b
    block[4, 4] = -1.0 / FORGET
    over = np.eye(6)
    for term in range(SERIES, 0, -1):
        over = np.eye(6) + (dt / term) * (block @ over)
    return LinearStep(*(cast(Row, tuple(row)) for row in over[:5].tolist()))


def linear_response(step: LinearStep, x: Motion, rudder: float) -> Motion:
    """Return the response one step later, from `x` under `rudder` [rad]; nothing but itself depends on the heading."""
    a, b, c, d, e = step
    return Motion(
        a[0] * x.v + a[1] * x.p + a[2] * x.r + a[3] * x.phi + a[5] * rudder,
        b[0] * x.v + b[1] * x.p + b[2] * x.r + b[3] * x.phi + b[5] * rudder,
        c[0] * x.v + c[1] * x.p + c[2] * x.r + c[3] * x.phi + c[5] * rudder,
        d[0] * x.v + d[1] * x.p + d[2] * x.r + d[3] * x.phi + d[5] * rudder,
        e[0] * x.v + e[1] * x.p + e[2] * x.r + e[3] * x.phi + e[4] * x.psi + e[5] * rudder,
    )


class ScheduleSettings(NamedTuple):
    """memory [s] of the two variances; the weight goes to 0 where the shadow's reduction of roll is `none` [-], to 1
    where it is `full` [-], at most `slew` [1/s]; nothing is decided before `wait` [s]. budget: rms [rad] that the
    rudder may have under the roll law. roll_time [s]: 1/(zeta omega), in which the hull's roll is forgotten."""

    memory: float = 120.0
    none: float = 0.05
    full: float = 0.15
    slew: float = 1.0 / 30.0
    wait: float = 60.0
    budget: float = math.inf
    roll_time: float = 10.0


class Shadow(NamedTuple):
    """A ship that steers by itself in the sea of the real one: its response to its own rudder, that rudder [rad], and
    mean and variance of its roll [rad, rad^2]."""

    response: Motion
    rudder: float
    mean: float
    variance: float


RATE_SMOOTH = 0.3
"""Time constant [s] of the order whose rate counts: its noise is small against a gear's rate then, and at a roll's
frequency little is lost."""
RATE_FADE = 10.0
"""Time [s] in which a peak of the rate is forgotten: about two rolls of a ship of 50 m."""
WORKED = 30.0
"""Time [s] over which the rudder's mean square is taken."""
STRENGTH_TIME = 60.0
"""Time constant [s] of the strength: with WORKED it settles with a damping ratio of a half."""
WEAKEST = 0.05
"""The strength falls no lower, so that it finds back."""


class RateGain(NamedTuple):
    """The order [rad], smoothed, and the largest rate [rad/s] that it had of late."""

    order: float = 0.0
    peak: float = 0.0


AT_REST = RateGain()


def rate_gain_step(gain: RateGain, order: float, dt: float) -> RateGain:
    """Return the memory after `dt` [s] more, above 0, in which `order` [rad] was wanted."""
    smooth = gain.order - (order - gain.order) * math.expm1(-dt / RATE_SMOOTH)
    return RateGain(smooth, max(abs(smooth - gain.order) / dt, gain.peak * math.exp(-dt / RATE_FADE)))


def rate_share(gain: RateGain, rate_max: float) -> float:
    """Return the share [-] of the order at which its largest rate is `rate_max` [rad/s], no more than 1.

    Automatic gain control: van der Klugt 1987, Rudder roll stabilization. A smaller rudder in time damps; one that its
    rate holds back comes late, and feeds the roll.
    """
    return rate_max / gain.peak if gain.peak > rate_max else 1.0


SETTLE = 20.0
"""Time [s] after a switch that is not measured: the roll from before dies away."""
PROOF = 120.0
"""Time [s] over which the roll under the law is measured before it is judged, and for which the law stays off where it
falls short the first time: the sea may have grown, and what it does without the law is measured anew."""
STANDS = 600.0
"""Time [s] for which a judgement stands: kept, or short of the promise twice running."""
POOLED = 300.0
"""Memory [s] of the two measurements, over all the times with and without."""
KEPT_SHARE = 0.5
"""Share of the promised reduction that must come true, where the chance of the sea does not explain less."""
SURE = 2.33
"""In so many standard deviations a law that keeps its promise is found short by chance once in a hundred judgements."""
GROWN = 1.1
"""Whatever chance may do, a roll that has grown by more than this is not risked any longer."""


class Measured(NamedTuple):
    """Roll as it was measured over `time` [s]: mean and variance [rad, rad^2], and the mean reduction promised."""

    time: float = 0.0
    mean: float = 0.0
    variance: float = 0.0
    promise: float = 0.0


class Proof(NamedTuple):
    """The roll measured with the roll law off and with its full weight; for how long [s] that has been so since the law
    was switched or judged, how often running it fell short, how long [s] it stays off for that, and over how long [s]
    it is measured before it is judged next."""

    without: Measured = Measured()
    under: Measured = Measured()
    so_far: float = 0.0
    failures: int = 0
    barred: float = 0.0
    span: float = PROOF


UNPROVEN = Proof()


class RollSchedule(NamedTuple):
    """Memory of the schedule: time [s] it has run, the response to the real rudder, a shadow with the rudder amidships,
    one under the quiet law and one under the roll law, the weight [-] of the roll law, and what it proved to do; the
    strength [-] of the roll law in this sea, the mean square [rad^2] of its shadow's rudder, and that rudder's rate."""

    time: float
    own: Motion
    free: Shadow
    quiet: Shadow
    roll: Shadow
    weight: float
    proof: Proof = UNPROVEN
    strength: float = 1.0
    square: float = 0.0
    gain: RateGain = AT_REST


def begin_schedule(proof: Proof = UNPROVEN) -> RollSchedule:
    """Return a schedule that knows nothing of the sea and has the roll law off."""
    rest = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
    shadow = Shadow(rest, 0.0, 0.0, 0.0)
    return RollSchedule(0.0, rest, shadow, shadow, shadow, 0.0, proof, 1.0, 0.0, AT_REST)


def _minus(x: Motion, y: Motion) -> Motion:
    return Motion(x.v - y.v, x.p - y.p, x.r - y.r, x.phi - y.phi, x.psi - y.psi)


def _plus(x: Motion, y: Motion) -> Motion:
    return Motion(x.v + y.v, x.p + y.p, x.r + y.r, x.phi + y.phi, x.psi + y.psi)


def roll_reduction(schedule: RollSchedule) -> float:
    """Return by how much the roll law would reduce the roll's deviation below the smaller of that with the rudder
    amidships and that under the quiet law, as a share of it; negative where it would roll more."""
    least = min(schedule.free.variance, schedule.quiet.variance)
    return 1.0 - math.sqrt(schedule.roll.variance / least) if least > 0.0 else 0.0


class ShadowStep(NamedTuple):
    """What a shadow goes on by: steering gear, linear model, `share` [-] of what is new in mean and variance, and the
    time [s]."""

    gear: SteeringGear
    model: LinearStep
    share: float
    dt: float


def shadow_step(step: ShadowStep, shadow: Shadow, roll: float, demand: float) -> Shadow:
    """Return the shadow one step later: `roll` [rad] it has now, `demand` [rad] on its rudder."""
    off = roll - shadow.mean
    rudder = gear_step(step.gear, shadow.rudder, demand, step.dt)
    return Shadow(
        linear_response(step.model, shadow.response, rudder),
        rudder,
        shadow.mean + step.share * off,
        shadow.variance + step.share * (off * off - shadow.variance),
    )


def measured_with(measured: Measured, roll: float, promise: float, memory: float, dt: float) -> Measured:
    """Return `measured` with `dt` [s] of `roll` [rad] more, at a memory of `memory` [s]."""
    time = measured.time + dt
    share, off = dt / min(memory, time), roll - measured.mean
    return Measured(
        time,
        measured.mean + share * off,
        measured.variance + share * ((1.0 - share) * off * off - measured.variance),
        measured.promise + share * (promise - measured.promise),
    )


def short_beyond(proof: Proof, roll_time: float) -> float:
    """Return the roll under the law over that without it [-] beyond which the law falls short.

    A roll that is forgotten in tau = `roll_time`, 1/(zeta omega), measured over T, has a variance that is tau/T of its
    square in doubt, so the logarithm of the share has a deviation of half sqrt(tau/T_without + tau/T_under).
    """
    under = proof.under
    doubt = roll_time / min(proof.without.time, POOLED) + roll_time / min(under.time, POOLED)
    chance = (1.0 - under.promise) * math.exp(0.5 * SURE * math.sqrt(doubt))
    return max(min(chance, GROWN), 1.0 - KEPT_SHARE * under.promise)


def proof_step(proof: Proof, weight: float, roll: float, promise: float, dt: float, roll_time: float) -> Proof:
    """Return the proof after `dt` [s] under `weight` [-]: `roll` [rad] measured, its reduction `promise` [-], the time
    [s] in which a roll is forgotten."""
    without, under, so_far, failures, barred, span = proof  # numba knows no _replace
    if weight <= 0.0:
        so_far, barred = so_far + dt, max(barred - dt, 0.0)
        if so_far > SETTLE:
            without = measured_with(without, roll, 0.0, POOLED, dt)
        return Proof(without, under, so_far, failures, barred, span)
    if weight < 1.0 or barred > 0.0:
        return Proof(without, under, 0.0, failures, barred, span)
    so_far += dt
    if so_far <= SETTLE:
        return Proof(without, under, so_far, failures, barred, span)
    under = measured_with(under, roll, promise, POOLED, dt)
    if so_far < SETTLE + span:
        return Proof(without, under, so_far, failures, barred, span)
    share = math.sqrt(under.variance / without.variance) if without.variance > 0.0 else 1.0
    if share <= 1.0 - KEPT_SHARE * under.promise:
        return Proof(without, under, SETTLE, 0, barred, STANDS)
    if share <= short_beyond(Proof(without, under), roll_time):
        return Proof(without, under, SETTLE, failures, barred, POOLED)
    return Proof(without, under, 0.0, failures + 1, PROOF if failures == 0 else STANDS, PROOF)


class ScheduleParts(NamedTuple):
    """What a schedule works with: settings, the two laws, steering gear, linear model."""

    settings: ScheduleSettings
    quiet: SwayYawLaw
    roll: RollLaw
    gear: SteeringGear
    step: LinearStep


def schedule_step(
    parts: ScheduleParts, schedule: RollSchedule, state: Motion, heading_goal: float, rudder: float, dt: float
) -> RollSchedule:
    """Return the schedule after one step: `state` measured now, `rudder` [rad] as it stands until the next.

    `parts.step` is that of `linear_step_of` for the same `dt` [s].
    """
    settings, time = parts.settings, schedule.time + dt
    step = ShadowStep(parts.gear, parts.step, dt / min(settings.memory, time), dt)
    free = _minus(state, schedule.own)
    quiet = _plus(free, schedule.quiet.response)
    roll = _plus(free, schedule.roll.response)
    quiet_demand = sway_yaw_rudder(parts.quiet, quiet.v, quiet.r, quiet.psi - heading_goal)
    steady = sway_yaw_rudder(parts.quiet, roll.v, roll.r, roll.psi - heading_goal)
    wanted = roll_rudder(parts.roll, roll, heading_goal)
    limits = parts.gear.rate_max, dt
    roll_demand, gain = damping_rudder((1.0, schedule.strength), schedule.gain, steady, wanted, limits)
    now = RollSchedule(
        time,
        linear_response(parts.step, schedule.own, rudder),
        shadow_step(step, schedule.free, free.phi, 0.0),
        shadow_step(step, schedule.quiet, quiet.phi, quiet_demand),
        shadow_step(step, schedule.roll, roll.phi, roll_demand),
        schedule.weight,
    )
    promise = roll_reduction(now)
    proof = proof_step(schedule.proof, schedule.weight, state.phi, promise, dt, settings.roll_time)
    worth = (promise - settings.none) / (settings.full - settings.none)
    is_open = time > settings.wait and proof.barred <= 0.0
    goal = clip(worth, 0.0, 1.0) if is_open else 0.0
    reach = settings.slew * dt
    weight = now.weight + clip(goal - now.weight, -reach, reach)
    square = schedule.square + dt / min(WORKED, time) * (now.roll.rudder * now.roll.rudder - schedule.square)
    strength = strength_step(schedule.strength, square / (settings.budget * settings.budget), dt)
    return RollSchedule(now.time, now.own, now.free, now.quiet, now.roll, weight, proof, strength, square, gain)


def strength_step(strength: float, spent: float, dt: float) -> float:
    """Return the strength [-] `dt` [s] later, with so much of the budget `spent` [-], in squares of the rudder."""
    return clip(strength * math.exp(clip(1.0 - spent, -1.0, 1.0) * dt / STRENGTH_TIME), WEAKEST, 1.0)


def damping_rudder(
    shares: tuple[float, float], gain: RateGain, quiet: float, roll: float, limits: tuple[float, float]
) -> tuple[float, RateGain]:
    """Return the rudder demand [rad] between the `quiet` law's and the `roll` law's, by rate and the shares, weight and
    strength, and the memory of its rate; limits: the gear's rate [rad/s] and the time [s] since the last demand."""
    (rate_max, dt), (weight, strength) = limits, shares
    wanted = blended_rudder(strength, quiet, roll)
    if dt > 0.0:
        gain = rate_gain_step(gain, wanted, dt)
    return blended_rudder(weight * rate_share(gain, rate_max), quiet, wanted), gain


def blended_rudder(weight: float, quiet: float, roll: float) -> float:
    """Return the rudder demand [rad]: `weight` of the roll law's, the rest of a quiet heading law's."""
    return (1.0 - weight) * quiet + weight * roll
