"""The corrected Norrbin backstepping heading law.

With z1 = wrap(psi - psi_d), alpha = -k1 z1 + psi_d', z2 = r - alpha and V = (g z1^2 + z2^2)/2, the rudder

    delta = (T/K) [-k2 z2 - g z1 + (n1 r + n2 r^2 + n3 r^3 + n0)/T + psi_d'' - k1 (r - psi_d')] - b

makes V' = -g k1 z1^2 - k2 z2^2 and z1'' + (k1 + k2) z1' + (g + k1 k2) z1 = 0. b is the rudder angle that
wind, current and trim are worth: the estimator learns it from the rudder that was really commanded, so that there
is nothing here to wind up.

A heading error larger than E counts as E: the law then turns the boat back at the rate (W/S) E, with W = g + k1 k2 and
S = k1 + k2, in place of swinging it to and fro with a rudder that is always late. With e = z1 and a course or a rate
that is held,

    e'' + S e' + W sat(e) = 0,   V = e'^2/2 + W int_0^e sat(y) dy,   V' = -S e'^2,

stable however large the error. E is where a swing at the loop's natural frequency, e = A sin(sqrt(W) t), asks for
OVERTAXED times the rudder's rate, A (T/K) W sqrt(W + (S - n1/T)^2), but not below LEAST_BOUND.

What is cancelled of the damping is n1 r at the measured rate and d(r_d) = n3 r_d^3 + n2 r_d^2 at the rate r_d that is
planned. n3 ~ 1/U^2: cancelled at the measured rate, a speed that is read three times too low would make nine times the
true damping a push that turns the boat ever faster. At the planned rate it is a known order to the rudder, and the
boat's own damping stays in the loop,

    e'' + S e' + p(e')/T + W sat(e) = 0,   p(y) = d(r_d + y) - d(r_d),   V' = -S e'^2 - e' p(e')/T,

for any r_d, held or not. The boat's damping p(y) is passive, y p(y) >= 0, wherever n3 r^3 + n2 r^2 rises, and so for
n2 = 0 at every rate. V knows nothing of the file's n3: one that is wrong leaves the loop stable and passive
and adds no more than (d - d_file)(r_d)/T from outside, which is 0 on a course. All that is cancelled counts for no more
rudder than there is. The paper's law, with d at the measured rate, is the case p = 0.

A third step spares the rudder: it does not jump to delta, it goes there at a rate,

    u' = -k3 (u - delta - b),   u = rudder + b,   k3 = 1/smoothing.

With a course or a rate r_d that is held and the damping c(r) = n3 r^3 + n2 r^2 + n1 r + n0,

    e''' + a(r) e'' + k3 S e' + k3 p(e')/T + k3 W e = 0,   a(r) = k3 + c'(r)/T,
    V3 = (e'' + W/S e')^2/2 + k3 S (e' + W/S e)^2/2 + int_0^e' (W/S (a(r_d + y) - W/S) y + k3 p(y)/T) dy,
    V3' = -(a(r) - W/S) e''^2 - k3 W/S e' p(e')/T:

stable, however large the error, where k3 + c'(r)/T > W/S at every rate; nothing but e = e' = 0 keeps e'' = 0. The
linear-quadratic regulator with a weight on the rudder's rate is of this form (`autopilot.control.design`). u begins
each time at the rudder that was really commanded: nothing winds up, and engaging makes no bump. A planned turn that
takes rudder is steered without this step, as the plan wants its rudder at once.

With the third step the law steers by the state as it will be when the rudder has come to the order, gear's delay and
lag and half a tick from now, reckoned from where the rudder is and what it was last ordered; and waves are states of
the regulator like any other, see the end.

What wears a rudder is its travel, the mean of |u'| and not of u'^2. For this the best law is no linear one: it leaves
the rudder where it is inside a band about what is asked for, and moves it along at the band's edge (singular control).
So the third step has play,

    |u - delta - b| <= B,   u moved by no more than it takes.

B is such that the rudder travels as far as that of the linear step, u1' = -k3 (u1 - delta - b), would. Behind a random
walk it travels D/(2 B) between the edges, and sqrt(k3 D/pi) by the linear step, whose deviation is s = sqrt(D/(2 k3)).
So B = sqrt(pi/2) s, and the rudder is off by B/sqrt(3) = 0.72 s in place of s. What s is, the linear rudder shows that
is reckoned beside. A degree of travel is worth as much in a calm as in a sea, though, which a weight on u'^2 forgets:
where travel has one price the best band goes with D^(1/3), that is B = sqrt(pi/2) s^(2/3) s0^(1/3), s0 the s of a usual
sea. It grows with the sea and the noise, and spares the rudder the more the less there is to steer against. To a swing
the play is much like the linear step, at a gain that is never more and with about its lag, so that the margins of the
linear loop stand. A course-unstable boat leaves its course where the rudder rests, and is steered by the linear step.
So is one whose steering moves nothing that wears: two thrusters that push with a difference. Its order is small, for a
degree of it turns the boat by what ten of a rudder do, and a band of a tenth of one lets it swing by degrees.
Source: Harrison and Taylor 1978 for the band of a Brownian motion; travel and B derived here.

The regulator that holds a course: the linear-quadratic one with a weight on the rudder's rate, in closed form. A
planned turn has gains of its own.

For the linear boat e'' + n e' = (K/T) u, n = n1/T, with the rudder's rate u' as the input, the least of the mean of

    e^2 + weight^2 u'^2   is   u' = -k3 (u - delta),   delta = -(T/K) [W e + (S - n) e']:

this law with smoothing 1/k3. The closed loop p(s) = s^3 + a s^2 + b s + c is the stable half of
p(s) p(-s) = q^2 + s^4 (n^2 - s^2), q = K/(T weight), so that

    c = q,   b = (a^2 - n^2)/2,   (a^2 - n^2)^2 = 8 a q,   k3 = a - n,   S = b/k3 = (a + n)/2,   W = q/k3.

The third has one root a above |n|. w = q^(1/3), the mean distance of the poles from the origin, stands for the weight:
a boat is asked for a bandwidth, not for seconds.
Source: symmetric root locus, Kailath 1980, section 3.4; the closed form derived here.

The paper has g = 1 1/s^2, hidden in V = (z1^2 + z2^2)/2. Left at 1 it asks a boat with K = 0.1 1/s and
T = 20 s for at least 200 deg of rudder per degree of error however small k1 and k2 are; so g is a gain here.

Source: Jiang et al. 2016, eqs (6)-(25), derived anew: their eq. (26) prints K/T for T/K, (1 - k1 k2) for
-(1 + k1 k2) and -(k1 + k2) psi_d' for +(k1 + k2) psi_d'.

Waves are states of the regulator like any other, as far as it is shown them (`autopilot.steering.wave_shares`). The
filter holds the waves for a motion h of their own on top of the boat's heading. What makes it is the push

    a = h'' + n h',   n = n1/T,   worth the rudder angle a T/K.

Shown all of the heading and of the rate, and with w' = M w, w = (h, h', e), the filter's oscillator, the u' that makes
the mean of e^2 + weight^2 u'^2 least is

    u' = -k3 (u - delta - delta_w),   delta_w = -(T/(K k3)) a(N(M) p(-M)^-1 w),
    N(s) = (a k3 - b) s^2 + (c - b k3) s + k3 c,   p(s) = s^3 + a s^2 + b s + c, the closed loop,

the slow waves cancelled, the quick ones kept from the rudder, each neither early nor late. For a push e^(s t) the best
steady rudder is -share T/K, share = c^2/(p(s) p(-s)); N/p(-s) is what this leaves to delta_w, where nothing of p(s) is
left to divide by: a wave may die away as quickly as the loop settles.

Derived here, from e'' + n e' = (K/T) u + a.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

from autopilot.angles import PI, wrap
from autopilot.control.law import Law, LawBoat, LawDesign, LawInput, LoopGains, in_units_of_file
from autopilot.estimation.path_delay import moved_on
from autopilot.estimation.tuning import WAVE_CORNER, WAVE_DAMPING, WAVE_STIFFENING
from autopilot.files.typed import NOW, Bounds, Positive
from autopilot.models.norrbin import Norrbin, rudder_for, rudder_within
from autopilot.signals import NavState, Reference

LAGGED = -WAVE_CORNER / WAVE_STIFFENING
"""e w0 in units of h': the best guess of e that goes by h and h' alone."""
RINGING = math.sqrt(1.0 - WAVE_DAMPING * WAVE_DAMPING)


class ClosedLoop(NamedTuple):
    """The regulator's: its third step k3 [1/s], and b [1/s^2] and c [1/s^3] of p(s); a is k3 + n."""

    k3: float
    b: float
    c: float


def wave_rudder(model: Norrbin, loop: ClosedLoop, heading: float, rate: float, frequency: float) -> float:
    """Return delta_w [rad] for waves of this `heading` [rad], `rate` [rad/s] and `frequency` [rad/s], by the equations
    above: a polynomial of M by its values at the eigenvalues of M."""
    if frequency <= 0.0:
        return 0.0
    k3, b, c = loop
    n = model.n1 / model.time_constant
    a = k3 + n
    decay, ringing, corner = WAVE_DAMPING * frequency, RINGING * frequency, WAVE_CORNER * frequency
    square = frequency * frequency
    s = complex(-decay, ringing)
    found = ((a * k3 - b) * s * s + (c - b * k3) * s + k3 * c) / (((a - s) * s - b) * s + c)
    slope = found.imag / ringing
    level = found.real + slope * decay
    real = ((a * k3 - b) * corner * corner - (c - b * k3) * corner + k3 * c) / (
        ((a + corner) * corner + b) * corner + c
    )
    bend = (real - level + slope * corner) / (square + corner * (corner - 2.0 * decay))
    h0, h1, e0 = heading, rate, LAGGED * rate / frequency
    h2, e1 = -square * (h0 + e0) - 2.0 * decay * (h1 + corner * h0) - corner * h1, corner * h0
    h3, e2 = -square * (h1 + e1) - 2.0 * decay * (h2 + corner * h1) - corner * h2, corner * h1
    h4 = -square * (h2 + e2) - 2.0 * decay * (h3 + corner * h2) - corner * h3
    # level + slope s + bend (s^2 + 2 decay s + square), of the push h'' + n h'
    straight, once = level + bend * square, slope + 2.0 * decay * bend
    push = straight * (h2 + n * h1) + once * (h3 + n * h2) + bend * (h4 + n * h3)
    return -model.time_constant / (model.gain * k3) * push


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
BISECTIONS = 60
PLAY = math.sqrt(0.5 * math.pi)
"""B in units of s, in the usual sea; derived above."""
PLAY_USUAL, PLAY_MOST = math.radians(0.4), math.radians(1.0)
"""s [rad] in waves worth 1 deg of rudder, of regulators of the middle levels, and the most that is believed of it."""
PLAY_FIRST = math.radians(0.05)
"""s [rad] before anything is known of it."""
PLAY_REACH = 9.0
"""What is asked for and lies further off than three deviations is a push or a turn, and says nothing of s."""
PLAY_MEMORY, PLAY_LASTS = 15.0, 3.0
"""s is learnt over this time [s], or over so many times the smoothing if that is longer."""
PLAY_BEGINS = 0.25
"""Until s has been learnt for so much of that, the rudder goes by the linear step: engaging makes no bump."""
BEGUN_SMOOTHING = 0.1
"""Smoothing with which a search begins where there is none, in units of 1/(the loop's natural frequency): a sixth of it
is next to none, a regulator has 0.35."""


@dataclass(frozen=True)
class Backstepping:
    """Gains of the corrected backstepping law: z1'' + (k1+k2) z1' + (gamma + k1 k2) z1 = 0."""

    k1_1_s: Annotated[float, NOW, Bounds(Positive, 1000.0, "heading gain k1")]
    k2_1_s: Annotated[float, NOW, Bounds(Positive, 1000.0, "rate gain k2")]
    gamma_1_s2: Annotated[float, NOW, Bounds(Positive, 1.0e6, "weight of the heading error; 1 in the paper")] = 1.0
    smoothing_s: Annotated[float, NOW, Bounds(0.0, 1000.0, "time in which the rudder follows the law; 0: at once")] = (
        0.0
    )
    course_rad_s: Annotated[float, NOW, Bounds(0.0, 1000.0, "bandwidth of the regulator that holds a course")] = 0.0
    """0: a course is held by the gains above; else they are those of planned turns."""


class BacksteppingGains(NamedTuple):
    """k1 [1/s] on the heading error, k2 [1/s] on the rate error, gamma [1/s^2] the weight of the heading error, and
    smoothing [s], the time in which the rudder goes to what they ask for; 0: at once."""

    k1: float
    k2: float
    gamma: float = 1.0
    smoothing: float = 0.0


NO_GAINS = BacksteppingGains(0.0, 0.0, 0.0, 0.0)


class Rested(NamedTuple):
    """What the third step remembers: the rudder u1 [rad] of the linear step, and the variance s^2 [rad^2] of what is
    asked for about it, learnt for so many `seconds`."""

    rudder: float
    variance: float
    seconds: float = 0.0


def at_rest(gains: object, rudder: float) -> Rested:
    """Return the memory with which steering begins at a `rudder` [rad]."""
    return Rested(rudder, PLAY_FIRST * PLAY_FIRST, 0.0)


class BoundedGains(NamedTuple):
    """The gains in force, the largest heading error [rad] to which they answer in proportion, and how long [s] after an
    order the rudder is there; course: gains of the regulator that holds a course, NO_GAINS where these do, and its
    largest error; play: whether the third step has it."""

    gains: BacksteppingGains
    error_max: float = math.inf
    ahead: float = 0.0
    course: BacksteppingGains = NO_GAINS
    course_error_max: float = math.inf
    play: bool = True


def on_course(bounded: BoundedGains) -> BoundedGains:
    """Return the gains that hold a course."""
    if bounded.course.smoothing == 0.0:
        return bounded
    return BoundedGains(bounded.course, bounded.course_error_max, bounded.ahead, NO_GAINS, math.inf, bounded.play)


RESOLVED = 1.0e-9
"""Share of its terms that a difference must be to have seven digits left of the sixteen."""


def lqr_gains(model: Norrbin, bandwidth: float) -> BacksteppingGains:
    """Return the regulator's gains for the `bandwidth` w [rad/s], see the module's equations. ValueError where it is so
    small beside what the boat does by itself that the gains are lost in rounding."""
    n, q = model.n1 / model.time_constant, bandwidth**3
    low, high = abs(n), abs(n) + 2.0 * bandwidth
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if (middle * middle - n * n) ** 2 < 8.0 * middle * q:
            low = middle
        else:
            high = middle
    k3 = high - n
    if k3 <= RESOLVED * high:
        raise ValueError(f"a regulator of {bandwidth:.3g} rad/s does nothing for this boat; 0 has none")
    return gains_of_loop(0.5 * (high + n), q / k3, 1.0 / k3)


def gains_of_loop(total: float, square: float, smoothing: float = 0.0) -> BacksteppingGains:
    """Return gains with k1 + k2 = `total` S [1/s] and gamma + k1 k2 = `square` W [1/s^2]; the loop knows no more."""
    slow = min(0.5 * total, 0.75 * square / total)
    return BacksteppingGains(slow, total - slow, square - slow * (total - slow), smoothing)


def gains_at(gains: BacksteppingGains, speed_ratio: float) -> BacksteppingGains:
    """Return the gains at `speed_ratio` times the speed at which they hold."""
    (low, high), (k1, k2, gamma, smoothing) = SPEED_RANGE, gains
    ratio = low if speed_ratio < low else high if speed_ratio > high else speed_ratio
    return BacksteppingGains(k1 * ratio, k2 * ratio, gamma * ratio * ratio, smoothing / ratio)


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
    low, high = SPEED_RANGE
    bound = error_max / (low if speed_ratio < low else high if speed_ratio > high else speed_ratio)
    return LEAST_BOUND if bound < LEAST_BOUND else bound


def errors(
    gains: BacksteppingGains, heading: float, rate: float, reference: Reference, error_max: float = math.inf
) -> tuple[float, float]:
    """Return z1 [rad], `error_max` [rad] at most, and z2 [rad/s], eqs (6), (9) and (14)."""
    z1 = heading - reference.heading
    z1 = z1 if -PI < z1 <= PI else wrap(z1)
    z1 = -error_max if z1 < -error_max else error_max if z1 > error_max else z1
    return z1, rate - (reference.rate - gains.k1 * z1)


def backstepping_rudder(bounded: BoundedGains, given: LawInput, cancelled: float) -> float:
    """Return the unlimited rudder demand [rad] of the law in the module's docstring, without its third step.

    bounded: the gains at the present speed. cancelled [rad/s]: the rate whose n3 r^3 + n2 r^2 is cancelled; the
    measured one is the paper's law.
    """
    gains, reference, rate = bounded.gains, given.reference, given.state.rate
    z1, z2 = errors(gains, given.state.heading, rate, reference, bounded.error_max)
    wanted = -gains.k2 * z2 - gains.gamma * z1 + reference.acceleration - gains.k1 * (rate - reference.rate)
    return rudder_within(given.model, rate, cancelled, wanted, given.rudder_max) - given.state.bias


def when_acted_on(ahead: float, given: LawInput) -> LawInput:
    """Return state and reference as they will be `ahead` [s], when the rudder has come to an order of now: meanwhile it
    goes from where it is to the last one."""
    state, reference, model = given.state, given.reference, given.model
    if ahead <= 0.0 or given.is_ahead:
        return given
    then = moved_on(model, state, given.last_rudder, ahead)
    on = wrap(reference.heading + ahead * (reference.rate + 0.5 * ahead * reference.acceleration))
    met = Reference(on, reference.rate + ahead * reference.acceleration, reference.acceleration)
    return LawInput(model, given.ratio, met, then, given.roll, given.last_rudder, given.rudder_max, given.dt, True)


def without_waves(given: LawInput) -> LawInput:
    """Return the input without the waves that the regulator is shown: a turn goes by the boat alone."""
    state = given.state
    if state.wave_heading == 0.0 and state.wave_rate == 0.0:
        return given
    heading = state.heading - state.wave_heading
    alone = NavState(
        state.time,
        heading if -PI < heading <= PI else wrap(heading),
        state.rate - state.wave_rate,
        state.speed,
        state.rudder,
        state.bias,
        state.heading_age,
        state.valid,
        0.0,
        0.0,
        state.wave_deviation,
        state.wave_frequency,
    )
    return LawInput(
        given.model,
        given.ratio,
        given.reference,
        alone,
        given.roll,
        given.last_rudder,
        given.rudder_max,
        given.dt,
        given.is_ahead,
    )


def regulated_waves(gains: BacksteppingGains, given: LawInput) -> float:
    """Return the rudder [rad] that the regulator gives for the waves it is shown; `gains` have smoothing."""
    state, k3 = given.state, 1.0 / gains.smoothing
    loop = ClosedLoop(k3, k3 * (gains.k1 + gains.k2), k3 * (gains.gamma + gains.k1 * gains.k2))
    return wave_rudder(given.model, loop, state.wave_heading, state.wave_rate, state.wave_frequency)


def smoothed_rudder(smoothing: float, wanted: float, last_rudder: float, dt: float) -> float:
    """Return the demand [rad] of the third step, `dt` [s] after the rudder was commanded to `last_rudder` [rad].

    wanted: what `backstepping_rudder` asks for [rad].
    """
    if smoothing == 0.0:
        return wanted
    return last_rudder - math.expm1(-dt / smoothing) * (wanted - last_rudder)


def played_rudder(
    smoothing: float, memory: Rested, wanted: float, last_rudder: float, dt: float
) -> tuple[float, Rested]:
    """Return the demand [rad] of the third step with its play, and the memory, `dt` [s] after the rudder was commanded
    to `last_rudder` [rad]. wanted: what `regulated` asks for [rad]."""
    rudder, variance, seconds = memory
    lasts = PLAY_LASTS * smoothing
    lasts = PLAY_MEMORY if lasts < PLAY_MEMORY else lasts
    begins = PLAY_BEGINS * lasts
    # what limits left of the last command is what the linear step goes on from
    rudder = last_rudder if seconds < begins else rudder
    apart = wanted - rudder
    rudder -= math.expm1(-dt / smoothing) * apart
    time = begins if seconds < begins else seconds if seconds < lasts else lasts
    seen = apart * apart
    if seen < PLAY_REACH * (variance + PLAY_FIRST * PLAY_FIRST):
        variance -= math.expm1(-dt / time) * (seen - variance)
        variance = PLAY_MOST * PLAY_MOST if variance > PLAY_MOST * PLAY_MOST else variance
    if seconds < begins:
        return rudder, Rested(rudder, variance, seconds + dt)
    band, off = PLAY * math.pow(variance * PLAY_USUAL, 1.0 / 3.0), wanted - last_rudder
    demand = wanted - band if off > band else wanted + band if off < -band else last_rudder
    return demand, Rested(rudder, variance, seconds + dt)


def smoothing_in(model: Norrbin, smoothing: float, reference: Reference) -> float:
    """Return the smoothing [s] that is in force: none in a planned turn that takes more than PLANNED of rudder."""
    if smoothing == 0.0:
        return 0.0
    planned = rudder_for(model, reference.rate, reference.acceleration) - rudder_for(model, 0.0, 0.0)
    return 0.0 if abs(planned) > PLANNED else smoothing


def linear_gains_backstepping(model: Norrbin, gains: BacksteppingGains) -> LoopGains:
    """Return the law's gains about straight running: (T/K)(gamma + k1 k2) and (T/K)(k1 + k2 - n1/T)."""
    ratio = model.time_constant / model.gain
    return LoopGains(
        ratio * (gains.gamma + gains.k1 * gains.k2),
        0.0,
        ratio * (gains.k1 + gains.k2 - model.n1 / model.time_constant),
        gains.smoothing,
    )


def bounded_gains(section: Backstepping, boat: LawBoat) -> BoundedGains:
    """Return the gains of a vessel file for the boat. ValueError where they are none."""
    gains = BacksteppingGains(section.k1_1_s, section.k2_1_s, section.gamma_1_s2, section.smoothing_s)
    if not all(0.0 < gain < math.inf for gain in gains[:3]):
        raise ValueError(f"k1, k2 and gamma must be positive and finite, got {gains}")
    if not 0.0 <= gains.smoothing < math.inf:
        raise ValueError(f"smoothing must be finite and not negative, got {gains.smoothing}")
    if not 0.0 <= section.course_rad_s < math.inf:
        raise ValueError(f"course_rad_s must be finite and not negative, got {section.course_rad_s}")
    rate_max, ahead = boat.limits.rate_max, boat.gear.delay + boat.gear.lag
    error_max = error_max_of(boat.model, gains, rate_max)
    if section.course_rad_s == 0.0:
        return BoundedGains(gains, error_max, ahead, play=boat.wears)
    course = lqr_gains(boat.model, section.course_rad_s)
    return BoundedGains(gains, error_max, ahead, course, error_max_of(boat.model, course, rate_max), boat.wears)


def bounded_gains_at(bounded: BoundedGains, speed_ratio: float) -> BoundedGains:
    """Return the gains and their bound at `speed_ratio` times the speed at which they hold: they go with the speed, as
    1/T does, so that a slow boat is not asked for a quick boat's accelerations."""
    gains, error_max, ahead, course, course_max, play = bounded
    gains, error_max = gains_at(gains, speed_ratio), error_max_at(error_max, speed_ratio)
    if course.smoothing > 0.0:
        course, course_max = gains_at(course, speed_ratio), error_max_at(course_max, speed_ratio)
    return BoundedGains(gains, error_max, ahead, course, course_max, play)


def in_proportion(bounded: BoundedGains, given: LawInput) -> float:
    """Return the rudder demand [rad] of the regulator that holds a course, its third step without play."""
    kept = on_course(bounded_gains_at(bounded, given.ratio))
    return smoothed_rudder(kept.gains.smoothing, regulated(kept, given), given.last_rudder, given.dt)


def regulated(kept: BoundedGains, given: LawInput) -> float:
    """Return the rudder [rad] that the regulator asks for, before its third step."""
    # an order holds until the next: on the mean it is half a tick old
    acted = when_acted_on(kept.ahead + 0.5 * given.dt, given)
    return backstepping_rudder(kept, acted, acted.reference.rate) + regulated_waves(kept.gains, acted)


def step(bounded: BoundedGains, memory: Rested, given: LawInput) -> tuple[float, Rested]:
    """Return the rudder demand [rad], and the memory. Bias and limits come with the state and the last rudder."""
    here = bounded_gains_at(bounded, given.ratio)
    kept = on_course(here) if here.course.smoothing > 0.0 else here
    smoothing = kept.gains.smoothing
    if smoothing > 0.0:
        smoothing = smoothing_in(given.model, smoothing, given.reference)
    if smoothing == 0.0:
        demand = backstepping_rudder(here, without_waves(given), given.reference.rate)
        return demand, Rested(demand, memory.variance, memory.seconds)
    wanted = regulated(kept, given)
    if given.model.n1 < 0.0 or not bounded.play:
        demand = smoothed_rudder(smoothing, wanted, given.last_rudder, given.dt)
        return demand, Rested(demand, memory.variance, memory.seconds)
    return played_rudder(smoothing, memory, wanted, given.last_rudder, given.dt)


def _linear(bounded: BoundedGains, model: Norrbin) -> LoopGains:
    found = linear_gains_backstepping(model, on_course(bounded).gains)
    return found._replace(ahead=bounded.ahead) if found.smoothing > 0.0 else found


def _shown(section: Backstepping, bounded: BoundedGains, ratio: float) -> dict[str, float]:
    now, filed = gains_at(bounded.gains, ratio), bounded.gains
    course = section.course_rad_s
    return in_units_of_file(section, (*now, course * min(max(ratio, SPEED_RANGE[0]), SPEED_RANGE[1])), (*filed, course))


def _designed(boat: LawBoat, loop: BacksteppingGains) -> Backstepping:
    return Backstepping(*loop)


def _quicker(section: Backstepping, factor: float) -> Backstepping:
    return Backstepping(
        section.k1_1_s * factor,
        section.k2_1_s * factor,
        section.gamma_1_s2 * (factor * factor),
        section.smoothing_s / factor,
        section.course_rad_s * factor,
    )


def _begin(section: Backstepping) -> Backstepping:
    """Return where a search begins: the section, with a little smoothing where it has none."""
    natural = math.sqrt(section.gamma_1_s2 + section.k1_1_s * section.k2_1_s)
    smoothing = section.smoothing_s if section.smoothing_s > 0.0 else BEGUN_SMOOTHING / natural
    course = section.course_rad_s if section.course_rad_s > 0.0 else natural
    return replace(section, smoothing_s=smoothing, course_rad_s=course)


LAW = Law(
    name="backstepping",
    title="Backstepping law",
    prefix="BS",
    section=Backstepping,
    numbers=BoundedGains,
    gains=bounded_gains,
    step=step,
    first=at_rest,
    at=bounded_gains_at,
    linear=_linear,
    shown=_shown,
    design=LawDesign(_designed, _quicker, _begin),
)
