"""What the rudder-response monitor supposes of boat, sea and slide, and learns of the sea: what its evidence comes of.

State (psi, r, p, w): psi' = r, T r' = K (a delta + p + w) - lambda r. p [rad of rudder] is wind, trim and a rudder that
stands anywhere, a random walk; w [rad of rudder] is the sea, w' = -w/tau + white noise. lambda = n1 + n2 r + n3 r^2 at
the rate that is, so that the answers to the rudder and to all else add up. A compass shows psi.

What the answer leaves over is summed in blocks, too, with its spectrum learnt: so that a sea is weighed as it is.

A boat that answers leaves d, what sea, wind and gusts do; one that does not leaves d and what it was ordered, L d, the
loop's own answer to d. By a filter that supposes a spectrum F of d, and with S = 1/(1 + L) what the loop leaves of d,
a healthy boat shows evidence against its rudder of

    1/2 integral (D/F) (1 - |S|^2) df    a second,

D being the true spectrum of d. Where D/F is the same everywhere that is never positive: the integral of log |S|^2 is 0
(Bode 1945), and 1 - x <= -log x. Where D is larger than F just where the rudder works, in a gust or in a narrow swell
that is quicker or slower than supposed, a healthy rudder is accused. So F must be D in its shape: it is learnt.

The innovations and the answers of a filter that supposes a slight sea, over their standard deviation, are summed over
blocks. Of what the usual share of the answer leaves, the covariances of up to four blocks are kept, while nothing is
suspect; the predictor of each block from the four before it, and its variance, follow by Levinson's recursion. The same
predictor is taken from innovation and answers alike, and what is then left of a boat that answers is white: a fault is
weighed in the sea that was there before it.

Sources: Bode 1945, Network Analysis and Feedback Amplifier Design; Levinson 1947; Ljung 1999, System Identification,
section 13.4: in a closed loop the answer to an input is found without bias where the noise has a model of its own.
Scalar functions over NamedTuples, compiled by `sitl.compiled` as they are. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.estimation.tuning import WAVE_FREQUENCY_LEAST
from autopilot.models.norrbin import Norrbin
from autopilot.supervision.tuning import (
    ANSWERS_MOST,
    BLOCK_S,
    FADES_TIME,
    GUST,
    LITTLE,
    MOST_OF_BLOCK,
    OUTLIER,
    OUTLIERS_MOST,
    REVERSED_SHARE,
    SEA_SLIGHT,
    SEA_SLOWEST,
    SPECTRUM_FIRST,
    SPECTRUM_LEAST,
    SPECTRUM_SURE,
    SPECTRUM_TIME,
    TAILS,
    UNEXPLAINED,
    UNEXPLAINED_TIME,
)

SEA_KNOWN_S = 2.0 * math.pi / WAVE_FREQUENCY_LEAST
"""One period of the longest wave that is estimated [s]: before, how large the sea is is not known, and it looks like a
push."""
STEEPEST = 20.0
"""The growth of a course-unstable boat over one step is cut at exp of this."""


Transition = tuple[float, float, float, float, float]
"""turn, drift, decay, gain, kept: psi += turn r + drift u, r = decay r + gain u, w = kept w; u: rudder, push, sea."""
Covariance = tuple[float, float, float, float, float, float, float, float, float, float]
"""p00, p01, p02, p03, p11, p12, p13, p22, p23, p33: the upper triangle, common to all suppositions about the rudder; i
and j count psi, r, p, w."""
Gains = tuple[float, float, float, float, float]
"""The variance [rad^2] of a heading's innovation, and what psi, r, p and w take of it."""


class Noise(NamedTuple):
    """heading [rad^2]; densities a second of acceleration [(rad/s)^2/s] and push [rad^2/s]; sea [rad^2] about zero,
    which changes at its pace [1/s]; unmet [rad^2]: by so much it may be larger, as it is not known yet."""

    heading: float
    acceleration: float
    push: float
    sea: float
    pace: float
    unmet: float


Mean = tuple[float, float, float, float]
"""psi [rad], r [rad/s], p [rad], w [rad]."""

NOTHING: Mean = (0.0, 0.0, 0.0, 0.0)
RATE_UNKNOWN = 0.2**2
PUSH_UNKNOWN = math.radians(20.0) ** 2
"""Variances of a rate [(rad/s)^2] and a push [rad^2] of which nothing is known."""
Means = tuple[Mean, Mean, Mean, Mean, Mean]
"""Of the heading without a rudder [rad], and of what adds to it: the rudder, a late one, what brakes a boat that
slides, a slow rudder."""


def transition_of(model: Norrbin, rate: float, pace: float, dt: float) -> Transition:
    """Return the transition over `dt` [s] of a boat that turns at about `rate` [rad/s] in a sea of that pace [1/s]."""
    boat_gain, time_constant, n3, n2, n1, _, _ = model
    slope = n1 + (n2 + n3 * rate) * rate
    x = slope * dt / time_constant
    x = x if x > -STEEPEST else -STEEPEST
    lost = -math.expm1(-x)
    once, twice = (1.0 - 0.5 * x, 0.5) if -1.0e-3 < x < 1.0e-3 else (lost / x, (x - lost) / (x * x))
    drive = boat_gain * dt / time_constant
    return dt * once, drive * dt * twice, 1.0 - lost, drive * once, math.exp(-pace * dt)


def foreseen(
    step: Transition,
    known: Covariance,
    means: Means,
    rudders: tuple[float, float, float, float],
    noises: tuple[float, float, float, float],
    dt: float,
) -> tuple[Covariance, Gains, Covariance, Means]:
    """Return the covariance before the next heading, F P F' + Q, how much that is believed, the covariance after it,
    and the means before it, `dt` [s] after the last. rudders [rad]: since then; noises: heading, acceleration, push and
    sea, as `Noise` has them."""
    heading, acceleration, push, sea = noises
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = known
    turn, drift, decay, gain, kept = step
    push_and_sea, of_sea = p22 + p23, p23 + p33
    pushes = p12 + p13
    a01 = p01 + turn * p11 + drift * pushes
    a02 = p02 + turn * p12 + drift * push_and_sea
    a03 = p03 + turn * p13 + drift * of_sea
    a12 = decay * p12 + gain * push_and_sea
    a13 = decay * p13 + gain * of_sea
    q = acceleration * dt
    before = (
        p00 + turn * p01 + drift * (p02 + p03) + turn * a01 + drift * (a02 + a03) + q * dt * dt / 3.0,
        decay * a01 + gain * (a02 + a03) + 0.5 * q * dt,
        a02,
        kept * a03,
        decay * (decay * p11 + gain * pushes) + gain * (a12 + a13) + q,
        a12,
        kept * a13,
        p22 + push * dt,
        kept * p23,
        kept * kept * p33 + (1.0 - kept * kept) * sea,
    )
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = before
    variance = p00 + heading
    k0, k1, k2, k3 = p00 / variance, p01 / variance, p02 / variance, p03 / variance
    after = (
        p00 - k0 * p00,
        p01 - k0 * p01,
        p02 - k0 * p02,
        p03 - k0 * p03,
        p11 - k1 * p01,
        p12 - k1 * p02,
        p13 - k1 * p03,
        p22 - k2 * p02,
        p23 - k2 * p03,
        p33 - k3 * p03,
    )
    return before, (variance, k0, k1, k2, k3), after, all_moved(step, means, rudders)


def all_moved(step: Transition, means: Means, rudders: tuple[float, float, float, float]) -> Means:
    """Return the means a step later: of the heading without a rudder, and of what each of the held `rudders` [rad]
    adds. Written out, as each mean would be one call more."""
    (psi, r, p, w), (psi_1, r_1, p_1, w_1), (psi_2, r_2, p_2, w_2), (psi_3, r_3, p_3, w_3), (psi_4, r_4, p_4, w_4) = (
        means
    )
    u_1, u_2, u_3, u_4 = rudders
    turn, drift, decay, gain, kept = step
    u, u_1, u_2, u_3, u_4 = p + w, u_1 + p_1 + w_1, u_2 + p_2 + w_2, u_3 + p_3 + w_3, u_4 + p_4 + w_4
    return (
        (psi + turn * r + drift * u, decay * r + gain * u, p, kept * w),
        (psi_1 + turn * r_1 + drift * u_1, decay * r_1 + gain * u_1, p_1, kept * w_1),
        (psi_2 + turn * r_2 + drift * u_2, decay * r_2 + gain * u_2, p_2, kept * w_2),
        (psi_3 + turn * r_3 + drift * u_3, decay * r_3 + gain * u_3, p_3, kept * w_3),
        (psi_4 + turn * r_4 + drift * u_4, decay * r_4 + gain * u_4, p_4, kept * w_4),
    )


def all_corrected(gains: Gains, means: Means, innovation: float) -> Means:
    """Return the means after a heading that was `innovation` [rad] off what it would be without a rudder: the gains are
    the same for all, and so each answer is the smaller by its own part of what is explained."""
    (psi, r, p, w), (psi_1, r_1, p_1, w_1), (psi_2, r_2, p_2, w_2), (psi_3, r_3, p_3, w_3), (psi_4, r_4, p_4, w_4) = (
        means
    )
    _, k0, k1, k2, k3 = gains
    return (
        (psi + k0 * innovation, r + k1 * innovation, p + k2 * innovation, w + k3 * innovation),
        (psi_1 - k0 * psi_1, r_1 - k1 * psi_1, p_1 - k2 * psi_1, w_1 - k3 * psi_1),
        (psi_2 - k0 * psi_2, r_2 - k1 * psi_2, p_2 - k2 * psi_2, w_2 - k3 * psi_2),
        (psi_3 - k0 * psi_3, r_3 - k1 * psi_3, p_3 - k2 * psi_3, w_3 - k3 * psi_3),
        (psi_4 - k0 * psi_4, r_4 - k1 * psi_4, p_4 - k2 * psi_4, w_4 - k3 * psi_4),
    )


def first_means(heading: float) -> Means:
    """Return the means after the first `heading` [rad]."""
    return (heading, 0.0, 0.0, 0.0), NOTHING, NOTHING, NOTHING, NOTHING


def first_covariance(heading: float, sea: float) -> Covariance:
    """Return the covariance after the first heading of that variance [rad^2] in a `sea` [rad^2]."""
    return heading, 0.0, 0.0, 0.0, RATE_UNKNOWN, 0.0, 0.0, PUSH_UNKNOWN, 0.0, sea


def unlike(off: float, s: float, s_slow: float, opposite: float) -> float:
    """Return the square [rad^2] of what is left of a heading that is so far `off` by that share of the answer `s` which
    explains most, of the opposite one no more than `opposite`, or by a slow rudder's, which is no gust either."""
    ahead, size = (-off, -s) if s < 0.0 else (off, s)
    least, most = -opposite * size, ANSWERS_MOST * size
    left = ahead - least if ahead < least else ahead - most if ahead > most else 0.0
    by_slow = off - s_slow
    return left * left if left * left < by_slow * by_slow else by_slow * by_slow


OUTLIER_SQUARE = OUTLIER * OUTLIER
"""Beyond so many variances a heading is left out."""

Block = tuple[float, float, float, float]
"""Innovation, answers to the rudder, in time and late, and to what brakes a boat that slides [standard deviations]."""
EMPTY: Block = (0.0, 0.0, 0.0, 0.0)
Covariances = tuple[float, float, float, float, float]
"""Of blocks no, one, two, three and four apart."""
FORGOTTEN = math.exp(-SEA_KNOWN_S / SPECTRUM_TIME)
SPECTRUM_KNOWN = FORGOTTEN * SPECTRUM_SURE + (1.0 - FORGOTTEN) / (1.0 - math.exp(-BLOCK_S / SPECTRUM_TIME))
"""So many blocks, faded, are learnt of a sea by when its size is estimated, too."""
REFLECTED_MOST = 0.98
"""A swell whose waves die away no slower than by 2 % a block."""


Spectrum = tuple[float, float, Block, tuple[Block, Block, Block, Block], Covariances, float, Covariances, float]
"""begun, many, sums, past, sums_apart, weight, lately, lately_weight. begun [s]: the first heading of the block that is
going on, many: how many it has, sums: of theirs; past: the last four blocks, the newest first; sums_apart and weight:
what the usual share of the answer left, its products with what it left so many blocks before, and how many there were;
lately and lately_weight: the same since there was no evidence of a fault last, which is not learnt yet."""


NOTHING_LATELY: Covariances = (0.0, 0.0, 0.0, 0.0, 0.0)
NO_SPECTRUM: Spectrum = (
    math.nan, 0.0, EMPTY, (EMPTY, EMPTY, EMPTY, EMPTY), SPECTRUM_FIRST, SPECTRUM_SURE, NOTHING_LATELY, 0.0,
)  # fmt: skip


def strength(spectrum: Spectrum) -> float:
    """Return how many times the supposed sea's variance that of a block is, 1 at least."""
    _, _, _, _, apart, weight, _, _ = spectrum
    found = (apart[0] + SPECTRUM_LEAST) / (weight + SPECTRUM_LEAST)
    return found if found > 1.0 else 1.0


def summed(before: Spectrum, time: float, seen: Block, variance: float) -> tuple[Spectrum, bool]:
    """Return the same with what is `seen` [rad] at `time` [s], the innovation's variance being so large [rad^2], and
    whether the block is whole."""
    begun, many, (off, s, late, braked), past, apart, weight, lately, lately_weight = before
    root, begun = 1.0 / math.sqrt(variance), time if many == 0.0 else begun
    sums = (off + root * seen[0], s + root * seen[1], late + root * seen[2], braked + root * seen[3])
    # half a tick's jitter is no more than that
    return (begun, many + 1.0, sums, past, apart, weight, lately, lately_weight), time - begun > BLOCK_S - 0.01


def emptied(before: Spectrum) -> Spectrum:
    """Return the same without the block that is going on."""
    _, _, _, past, apart, weight, lately, lately_weight = before
    return math.nan, 0.0, EMPTY, past, apart, weight, lately, lately_weight


def whitened(before: Spectrum, share: float) -> tuple[Block, float, Spectrum]:
    """Return what of a whole block the four before it did not predict, its variance, and what is known after it.
    share: of the answer that the boat usually has."""
    _, many, (off, s, late, braked), past, apart, weight, lately, lately_weight = before
    root, (one, two, three, four) = 1.0 / math.sqrt(many), past
    now = (root * off, root * s, root * late, root * braked)
    a1, a2, a3, a4, variance = predictor(apart, weight)
    off, s, late, braked = (
        now[0] - a1 * one[0] - a2 * two[0] - a3 * three[0] - a4 * four[0],
        now[1] - a1 * one[1] - a2 * two[1] - a3 * three[1] - a4 * four[1],
        now[2] - a1 * one[2] - a2 * two[2] - a3 * three[2] - a4 * four[2],
        now[3] - a1 * one[3] - a2 * two[3] - a3 * three[3] - a4 * four[3],
    )
    left = now[0] - share * now[1] - now[3]
    lately = (
        lately[0] + left * left,
        lately[1] + left * (one[0] - share * one[1] - one[3]),
        lately[2] + left * (two[0] - share * two[1] - two[3]),
        lately[3] + left * (three[0] - share * three[1] - three[3]),
        lately[4] + left * (four[0] - share * four[1] - four[3]),
    )
    after = math.nan, 0.0, EMPTY, (now, one, two, three), apart, weight, lately, lately_weight + 1.0
    return (off, s, late, braked), variance, after


def learnt(before: Spectrum) -> Spectrum:
    """Return the same where there is no evidence of a fault: none had begun until now, and what was left lately is the
    sea's."""
    begun, many, sums, past, apart, weight, lately, more = before
    kept = math.exp(-BLOCK_S * more / SPECTRUM_TIME)
    apart = (
        kept * apart[0] + lately[0],
        kept * apart[1] + lately[1],
        kept * apart[2] + lately[2],
        kept * apart[3] + lately[3],
        kept * apart[4] + lately[4],
    )
    return begun, many, sums, past, apart, kept * weight + more, NOTHING_LATELY, 0.0


def predictor(apart: Covariances, weight: float) -> tuple[float, float, float, float, float]:
    """Return how much of each of the four blocks before is in the next, and the variance of what is not, by Levinson's
    recursion. SPECTRUM_LEAST blocks of white noise are supposed beside those that were seen."""
    total = weight + SPECTRUM_LEAST
    r0, r1, r2 = (apart[0] + SPECTRUM_LEAST) / total, apart[1] / total, apart[2] / total
    r3, r4 = apart[3] / total, apart[4] / total
    a1 = _reflected(r1 / r0)
    left = r0 * (1.0 - a1 * a1)
    k = _reflected((r2 - a1 * r1) / left)
    a1, a2, left = a1 - k * a1, k, left * (1.0 - k * k)
    k = _reflected((r3 - a1 * r2 - a2 * r1) / left)
    a1, a2, a3, left = a1 - k * a2, a2 - k * a1, k, left * (1.0 - k * k)
    k = _reflected((r4 - a1 * r3 - a2 * r2 - a3 * r1) / left)
    return a1 - k * a3, a2 - k * a2, a3 - k * a1, k, left * (1.0 - k * k)


def _reflected(k: float) -> float:
    """Return a reflection coefficient within what a spectrum can have: products that fade are not quite one's."""
    return REFLECTED_MOST if k > REFLECTED_MOST else k if k > -REFLECTED_MOST else -REFLECTED_MOST


class Blocks(NamedTuple):
    """What is known in the sea that was learnt. In a slight sea covariance and means; spectrum: of what is left; how
    much likelier it is that the rudder is stuck than that the boat answers, in time and late, and that it is reversed;
    unexplained: squares that no answer explains; outliers: how many of the last headings were."""

    covariance: Covariance
    means: Means
    spectrum: Spectrum
    stuck: float
    stuck_late: float
    reversed: float
    reversed_late: float
    unexplained: float
    outliers: int


def first_blocks(noise: Noise, heading: float) -> Blocks:
    """Return what is known after the first heading [rad]."""
    covariance = first_covariance(noise.heading, SEA_SLIGHT)
    return Blocks(covariance, first_means(heading), NO_SPECTRUM, 0.0, 0.0, 0.0, 0.0, 1.0, 0)


def likelier(evidence: float, square: float, other: float, variance: float, most: float) -> float:
    """Return the `evidence` with what a block adds, `most` at most, of which one answer leaves a `square` and the other
    one another: how much likelier the other is, both over the variance as Student's t."""
    more = 0.5 * (TAILS + 1.0) * math.log((TAILS * variance + square) / (TAILS * variance + other))
    evidence += most if more > most else more
    return evidence if evidence > 0.0 else 0.0


def blocks_step(
    before: Blocks,
    moves: Transition,
    noise: Noise,
    rudders: tuple[float, float, float, float],
    newest: tuple[float, float, float],
    by_headings: tuple[float, float, float, bool],
) -> Blocks:
    """Return what is known after the `newest` heading [rad], at a time [s] and so long [s] after the one before, in a
    slight sea, whatever sea there is: how that differs is learnt. moves: of the boat, in any sea; rudders: as
    `foreseen` has them; by_headings: the least of the model's answer of a boat that answers, the usual one, how much
    this one slides, and whether a fault may have begun, so that what is left may be no sea's."""
    known, means, spectrum, stuck, stuck_late, wrong, wrong_late, unexplained, outliers = before
    (time, dt, heading), (least, usual, slides, is_suspect) = newest, by_headings
    is_gust = unexplained > UNEXPLAINED
    turn, drift, decay, gain, _ = moves
    step, push = (turn, drift, decay, gain, math.exp(-SEA_SLOWEST * dt)), noise.push + GUST if is_gust else noise.push
    noises = noise.heading, noise.acceleration, push, SEA_SLIGHT
    covariance, gains, known, means = foreseen(step, known, means, rudders, noises, dt)
    variance = gains[0]
    mean, answer, late, slide, slow = means
    off, s, s_late = heading - mean[0], answer[0], late[0]
    off = off if -PI < off <= PI else wrap(off)
    square = unlike(off, s, slow[0], ANSWERS_MOST) / (variance * strength(spectrum))
    is_left_out = square > OUTLIER_SQUARE and outliers < OUTLIERS_MOST
    if is_left_out:
        known = covariance
    else:
        square = OUTLIER_SQUARE if square > OUTLIER_SQUARE else square
        unexplained += (1.0 - math.exp(-dt / UNEXPLAINED_TIME)) * (square - unexplained)
        spectrum, is_whole = summed(spectrum, time, (off, s, s_late, slides * slide[0]), variance)
        if is_whole:
            evidence, spectrum = weighed(
                (stuck, stuck_late, wrong, wrong_late), spectrum, (least, usual), (is_gust, is_suspect)
            )
            stuck, stuck_late, wrong, wrong_late = evidence
        means = all_corrected(gains, means, off)
    outliers = outliers + 1 if is_left_out else 0
    return Blocks(known, means, spectrum, stuck, stuck_late, wrong, wrong_late, unexplained, outliers)


def weighed(
    evidence: tuple[float, float, float, float],
    spectrum: Spectrum,
    shares: tuple[float, float],
    shown: tuple[bool, bool],
) -> tuple[tuple[float, float, float, float], Spectrum]:
    """Return the `evidence` of `Blocks`, that the rudder is stuck and reversed, with what a whole block adds to it, and
    what is known of the sea then. shares: the least of the model's answer and the usual one; shown: a heading showed a
    gust, and headings make a fault suspect."""
    (stuck, stuck_late, wrong, wrong_late), (least, usual), (is_gust, is_suspect) = evidence, shares, shown
    (z, x, x_late, braked), left, spectrum = whitened(spectrum, usual)
    kept = math.exp(-BLOCK_S / FADES_TIME)
    some, some_late = z - least * x - braked, z - least * x_late
    opposite, opposite_late = z - REVERSED_SHARE * x, z - REVERSED_SHARE * x_late
    # while a gust sets in nothing that the rudder does against it is evidence; one that sets in gently, or turns a
    # slow boat, shows in no single heading but in the block
    now = spectrum[3][0]
    is_gust = is_gust or unlike(now[0], now[1], math.inf, ANSWERS_MOST) > UNEXPLAINED * strength(spectrum)
    most = 0.0 if is_gust else MOST_OF_BLOCK
    stuck = likelier(kept * stuck, some * some, z * z, left, most)
    stuck_late = likelier(kept * stuck_late, some_late * some_late, z * z, left, most)
    wrong = likelier(kept * wrong, some * some, opposite * opposite, left, most)
    wrong_late = likelier(kept * wrong_late, some_late * some_late, opposite_late * opposite_late, left, most)
    # cumulative sums that are nothing say that no fault has begun until now. In blocks alone a rudder that runs off by
    # itself looks like a gust at first; by headings a sea looks like a fault that is not known yet
    is_doubted = is_suspect and spectrum[5] > SPECTRUM_KNOWN
    spectrum = learnt(spectrum) if stuck < LITTLE and wrong < LITTLE and not is_doubted else spectrum
    return (stuck, stuck_late, wrong, wrong_late), spectrum


def no_more_blocks(before: Blocks, after: Blocks) -> Blocks:
    """Return `after` with no more evidence against the rudder than `before`."""
    known, means, spectrum, stuck, stuck_late, wrong, wrong_late, unexplained, outliers = after
    return Blocks(
        known,
        means,
        emptied(spectrum),
        min(before.stuck, stuck),
        min(before.stuck_late, stuck_late),
        min(before.reversed, wrong),
        min(before.reversed_late, wrong_late),
        unexplained,
        outliers,
    )
