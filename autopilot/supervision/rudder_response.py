"""The rudder-response monitor: whether the boat's heading answers its rudder, as a generalised likelihood ratio.

A filter parts the answer to the rudder from what sea and wind do (`response_filter`).

By this the innovation of a filter that supposes the share a of the rudder's answer is nu - a s: nu that of a filter
which knows of no rudder, s the part of the rudder's answer which could not have been p or w. Both come from the same
gains. The evidence for one share against another is the sum of the logarithms of their likelihood ratios over the
headings, begun anew at zero (Page 1954), so that it needs no window: it grows only where the rudder moves, faster than
wind and sea would, and the boat does not go along. A straight course with a rudder that rests tells nothing.

Of a boat that answers and slides in its turn nu - a s - c g is left: g is the answer to what brakes it, and its share c
is estimated from the headings before, none where the boat has sailed turns without a slide. A boat that turns against
its rudder, or on with it where the rudder has come back, is none that is braked: that counts in full.

A hull also slides: sway, and the way that it loses as it turns, brake it in a long turn by up to a few times what the
model's damping is worth. That is one more input, the own damping delayed as the slide is (`slide_step`), times a share
c >= 0. c is estimated over a time constant, with a prior of variance U^2 about zero; and U^2 itself is what the boat
has shown: of both = sum y g/v and squares = sum g^2/v, y = c g + noise of variance v, E[both^2] = c^2 squares^2 +
squares, half of it where both > 0. So a boat that has sailed a turn without a slide has no share for one (an empirical
Bayes estimate, Robbins 1956). A slide comes after the turn has begun: what a turn shows counts SLIDE_LASTS time
constants later.

A gust that sets in, or ends, as the rudder moves the other way turns the boat as a reversed rudder would. So a push
that may have begun with the evidence is one more explanation: where it is likelier than any fault nothing is evidence.

A sea other than the one that is estimated accuses a healthy rudder, as the rudder follows it. So the same is weighed in
the sea as it was learnt, too (`blocks_step`): a verdict takes both together, and something of each. In a turn it
takes less: there the order moves the rudder, and not the sea. But until the sea is known what keeps a boat from turning
may be a sea that is larger than supposed, and a turn is judged as a course is (`counts_as_course`). What a turn tells
from its beginning on, which needs no sea that is known so well, is a verdict of its own (`since_turning`).

Sources: Willsky and Jones 1976, the generalised likelihood ratio of an additive change, here of a change in a; Page
1954, the cumulative sum; Wald 1945, the sequential test; Ville 1939, how seldom it is wrong. Scalar functions over
NamedTuples, compiled by `sitl.compiled` as they are. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.estimation.tuning import SLIDE_LASTS, SLIDE_UNKNOWN
from autopilot.models.norrbin import Norrbin
from autopilot.supervision.response_filter import (
    NOTHING,
    OUTLIER_SQUARE,
    Blocks,
    Covariance,
    Gains,
    Mean,
    Means,
    Noise,
    Transition,
    all_corrected,
    blocks_step,
    emptied,
    first_blocks,
    first_covariance,
    first_means,
    foreseen,
    no_more_blocks,
    transition_of,
    unlike,
)
from autopilot.supervision.tuning import (
    ANSWERS_MOST,
    COLOUR_TIME,
    FADES_SLOW,
    FADES_TIME,
    GUST,
    GUST_IN,
    GUST_OVER,
    GUST_SIZE,
    HARDLY,
    LEAST,
    LEAST_SHARE,
    LITTLE,
    LIVELY,
    MISFIT,
    MISFIT_TIME,
    MOST_AT_ONCE,
    OUTLIERS_MOST,
    QUICK,
    REVERSED_SHARE,
    SLIDE_SURE,
    SUSPECT,
    UNEXPLAINED,
    UNEXPLAINED_TIME,
    USUAL,
    USUAL_SURE,
    USUAL_TIME,
)

WEAK, STRONG = LEAST[0], ANSWERS_MOST
"""The least and the most that a boat answers whose rudder is not slow."""


Slide = tuple[float, float, float, float, float, float]
"""What a boat has shown of its slide: both, squares, lately, lately_sure, shown, sure. both and squares: sums of what
is left over times the slide's answer, and of the answer's square, over the variance, of a time constant; lately and
lately_sure: sums for the share's mean square and its weight, of a turn that may be going on; shown and sure: of those
before."""
NO_SLIDE: Slide = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def slide_share(slide: Slide) -> float:
    """Return how many times its own damping the boat is braked by."""
    (both, squares, _, _, shown, sure), prior = slide, SLIDE_SURE * SLIDE_SURE
    usual = (shown + SLIDE_UNKNOWN * SLIDE_UNKNOWN * prior) / (sure + prior)
    return 0.0 if usual <= 0.0 or both <= 0.0 else both * usual / (squares * usual + 1.0)


def slide_learnt(before: Slide, model: Norrbin, seen: tuple[float, float, float], dt: float, learns: bool) -> Slide:
    """Return what is known after a heading of which the answers but the slide's leave so much [rad], the slide's own
    answer being so large [rad], with a variance [rad^2] of the innovation: `seen`. learns: nothing is suspect."""
    left, answer, variance = seen
    both, squares, lately, lately_sure, shown, sure = before
    changes = model.time_constant if model.time_constant < FADES_TIME else FADES_TIME
    fresh = -math.expm1(-dt / changes)
    both += left * answer / variance - fresh * both
    squares += answer * answer / variance - fresh * squares
    if not learns:
        return both, squares, lately, lately_sure, shown, sure
    # half of white noise lies to the side that is no slide
    square = both * both if both > 0.0 else 0.0
    passed, remembered = -math.expm1(-dt / (SLIDE_LASTS * model.time_constant)), math.exp(-dt / USUAL_TIME)
    return (
        both,
        squares,
        lately - passed * lately + fresh * (square - 0.5 * squares),
        lately_sure - passed * lately_sure + fresh * squares * squares,
        remembered * shown + passed * lately,
        remembered * sure + passed * lately_sure,
    )


Rudders = tuple[float, float, float, float, float]
"""Where the rudder was [rad]: in time, or where everything is `LATE_S` late, or the rudder much slower than filed (in
time again where that is out of question); what a boat that slides is braked by, see `slide_step`; and the share of the
answer that drift leaves."""


class Others(NamedTuple):
    """What else may turn the boat as it turns. lively and quick: how much likelier
    each is, to starboard and to port; strange and strange_slow: squares that no answer explains, nor a slow rudder;
    weak, right, strong and late: how much likelier a slow rudder is than a boat that answers in this way; fit: sums of
    innovation times answer and of the answer's square, over the variance; left: the mean of late of what the best share
    of the answer leaves over [standard deviations]; colour: its square, 1 where that is white noise."""

    lively: tuple[float, float]
    quick: tuple[float, float]
    misfit: float
    misfit_slow: float
    weak: float
    right: float
    strong: float
    late: float
    fit: tuple[float, float]
    left: float
    colour: float


NO_OTHERS = Others((0.0, 0.0), (0.0, 0.0), 0.5, 1.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0), 0.0, 1.0)


Gust = tuple[Mean, float, float, float, float, float, float]
"""A push that may have set in when evidence against the rudder began: the answer to one of 1 rad; both and squares:
sums over the variance of what a boat that answers leaves, times that, and of its square; stuck and slow: how much
likelier such a rudder is than a boat that answers without a push, by then and by all that the headings since tell;
against and own: sums of innovation times the answer to the rudder, and of that one's square, by which a reversed one is
likelier yet."""
NO_GUST: Gust = (NOTHING, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0)


Three = tuple[float, float, float]
"""How much likelier it is that a rudder is stuck than that the boat answers to it, in time, late, and to a slow one."""
NOTHING_ADDED: Three = (0.0, 0.0, 0.0)


class ResponseState(NamedTuple):
    """time [s] of the newest heading, nan: nothing is known yet; covariance and means; slid: how much the boat slides;
    how much likelier it is that the rudder is stuck than that the boat answers, in time and late, and that it
    is reversed; unexplained: squares that no answer explains; outliers: how many of the last headings were; usual
    and shown: the share of the model's answer that the boat has had so far is the former over the latter; others:
    the boat or its rudder may not be the file's; usual_colour: the colour of what is left over as long as nothing
    was suspect; since: innovation times answer, and the answer's square, over the variance, summed since a fault may
    have begun; gust: what may have set in then in its place; added: what the newest heading adds to `since_turning`."""

    time: float
    covariance: Covariance
    means: Means
    slid: Slide
    stuck: float
    stuck_late: float
    reversed: float
    reversed_late: float
    unexplained: float
    outliers: int
    usual: float
    shown: float
    others: Others
    usual_colour: float
    blocks: Blocks
    since: tuple[float, float]
    gust: Gust
    added: Three


def first_response(noise: Noise, time: float, heading: float) -> ResponseState:
    """Return what is known after the first heading [rad]."""
    # every field is given: what numba compiles has no defaults
    return ResponseState(
        time,
        first_covariance(noise.heading, noise.sea),
        first_means(heading),
        NO_SLIDE,
        stuck=0.0,
        stuck_late=0.0,
        reversed=0.0,
        reversed_late=0.0,
        unexplained=1.0,
        outliers=0,
        usual=USUAL * USUAL_SURE,
        shown=USUAL_SURE,
        others=NO_OTHERS,
        usual_colour=1.0,
        blocks=first_blocks(noise, heading),
        since=(0.0, 0.0),
        gust=NO_GUST,
        added=NOTHING_ADDED,
    )


NO_RESPONSE = first_response(Noise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), math.nan, math.nan)


def grown(evidence: float, squares: float, variance: float, most: float) -> float:
    """Return the `evidence` with what a heading adds, of which one answer leaves a square that is so much larger
    [rad^2] than what another leaves: how much likelier the other one is, half the difference of the `squares` over the
    variance, within MOST_AT_ONCE less and `most` more."""
    evidence += more_of(squares, variance, most)
    return evidence if evidence > 0.0 else 0.0


def more_of(squares: float, variance: float, most: float) -> float:
    """Return what a heading adds, see `grown`."""
    more = 0.5 * squares / variance
    return most if more > most else more if more > -MOST_AT_ONCE else -MOST_AT_ONCE


Four = tuple[float, float, float, float]


def all_grown(evidence: Four, squares: Four, variance: float, most: float) -> Four:
    """Return four kinds of evidence with what a heading adds to each, see `grown`; written out, as `all_moved` is."""
    (one, two, three, four), (square_one, square_two, square_three, square_four) = evidence, squares
    more = 0.5 * square_one / variance
    one += most if more > most else more if more > -MOST_AT_ONCE else -MOST_AT_ONCE
    more = 0.5 * square_two / variance
    two += most if more > most else more if more > -MOST_AT_ONCE else -MOST_AT_ONCE
    more = 0.5 * square_three / variance
    three += most if more > most else more if more > -MOST_AT_ONCE else -MOST_AT_ONCE
    more = 0.5 * square_four / variance
    four += most if more > most else more if more > -MOST_AT_ONCE else -MOST_AT_ONCE
    return (
        one if one > 0.0 else 0.0,
        two if two > 0.0 else 0.0,
        three if three > 0.0 else 0.0,
        four if four > 0.0 else 0.0,
    )


def response_step(
    before: ResponseState, model: Norrbin, noise: Noise, rate: float, newest: tuple[float, float], rudders: Rudders
) -> ResponseState:
    """Return what is known after the `newest` heading [rad] at its time [s], the rudder having been at `rudders` since
    the one before; the boat turns at about `rate` [rad/s]."""
    (
        last, known, means, slid, stuck, stuck_late, wrong, wrong_late, unexplained, outliers,
        usual, shown, others, usual_colour, blocks, since, gust, _,
    ) = before  # fmt: skip
    (time, heading), (rudder, rudder_late, rudder_slow, braked, weaker) = newest, rudders
    dt = time - last
    is_pushed = is_gust_likelier(gust, usual / shown)
    is_gust = unexplained > UNEXPLAINED
    least = LEAST_SHARE * usual / shown
    least = least if least > LEAST[0] else LEAST[0]
    least = weaker * (least if least < LEAST[1] else LEAST[1])
    at = rudder, rudder_late, braked, rudder_slow
    slides, is_doubted = slide_share(slid), stuck >= SUSPECT or wrong >= SUSPECT
    step = transition_of(model, rate, noise.pace, dt)
    blocks = blocks_step(blocks, step, noise, at, (time, dt, heading), (least, usual / shown, slides, is_doubted))
    noises = noise.heading, noise.acceleration, noise.push + GUST if is_gust else noise.push, noise.sea
    covariance, gains, known, means = foreseen(step, known, means, at, noises, dt)
    variance = gains[0]
    mean, answer, late, slide, slow = means
    off, s, s_late = heading - mean[0], answer[0], late[0]
    off = off if -PI < off <= PI else wrap(off)
    square = unlike(off, s, slow[0], 1.0) / variance
    if square > OUTLIER_SQUARE:
        if outliers < OUTLIERS_MOST:
            return _without_heading(before, time, covariance, means, blocks, gust_moved(gust, step))
        square = OUTLIER_SQUARE
    kept, remembered = math.exp(-dt / FADES_TIME), math.exp(-dt / USUAL_TIME)
    # while a gust sets in nothing that the rudder does against it is evidence
    most = 0.0 if is_gust or is_pushed else MOST_AT_ONCE
    off_some, off_some_late = off - least * s, off - least * s_late
    # how much the boat slides is known by what came before, so that no heading explains itself
    g, left_over = slide[0], off_some
    off_some -= slides * g
    off_wrong, off_wrong_late = off - REVERSED_SHARE * s, off - REVERSED_SHARE * s_late
    # a sea that may be larger, beside what sea and push may do as they are known, makes the same headings tell less;
    # were the filter to suppose it, what it leaves would not be coloured, by which a sea that is another is known
    doubtful = variance * (1.0 + noise.unmet / (noise.sea + covariance[7]))
    square_none, square_some, square_some_late = off * off, off_some * off_some, off_some_late * off_some_late
    stuck, stuck_late, turned, turned_late = all_grown(
        (kept * stuck, kept * stuck_late, kept * wrong, kept * wrong_late),
        (
            square_some - square_none,
            square_some_late - square_none,
            square_some - off_wrong * off_wrong,
            square_some_late - off_wrong_late * off_wrong_late,
        ),
        doubtful,
        most,
    )
    by_slow = off - slow[0]
    added = (
        more_of(square_some - square_none, doubtful, most),
        more_of(square_some_late - square_none, doubtful, most),
        more_of(by_slow * by_slow - square_none, doubtful, most),
    )
    both, squares = since
    may_have_begun = stuck >= LITTLE or turned >= LITTLE
    since = (both + off * s / variance, squares + s * s / variance) if may_have_begun else (0.0, 0.0)
    evidence = stuck if stuck > turned else turned
    if evidence < HARDLY:
        gust = begun_gust(evidence)
    else:
        gust = gust_step(gust_moved(gust, step), gains, (off, s, slow[0], off_some), doubtful, evidence)
    # what may be a fault is none of the boat's usual ways
    learns = 0.0 if is_suspect(stuck, wrong, blocks) else 1.0 / variance
    slid = slide_learnt(slid, model, (left_over, g, variance), dt, learns > 0.0)
    others = others_step(others, model.time_constant, variance, dt, (off, s, s_late, slow[0]), is_pushed)
    return ResponseState(
        time,
        known,
        all_corrected(gains, means, off),
        slid,
        stuck,
        stuck_late,
        turned,
        turned_late,
        unexplained + (1.0 - math.exp(-dt / UNEXPLAINED_TIME)) * (square - unexplained),
        0,
        USUAL * USUAL_SURE + remembered * (usual - USUAL * USUAL_SURE) + learns * off * s,
        USUAL_SURE + remembered * (shown - USUAL_SURE) + learns * s * s,
        others,
        others.colour if learns > 0.0 else usual_colour,
        blocks,
        since,
        gust,
        added,
    )


def gust_moved(gust: Gust, step: Transition) -> Gust:
    """Return the same a step later, before its heading."""
    ((psi, r, p, w), both, squares, stuck, slow, against, own), (turn, drift, decay, gain, kept) = gust, step
    u = 1.0 + p + w
    return (psi + turn * r + drift * u, decay * r + gain * u, p, kept * w), both, squares, stuck, slow, against, own


def gust_step(
    moved: Gust, gains: Gains, shown: tuple[float, float, float, float], variance: float, evidence: float
) -> Gust:
    """Return what a heading tells of a gust that has `moved` the boat until it. shown [rad]: the innovation, the
    answers to the rudder and to a slow one, and what a boat that answers leaves; evidence: how much there is of a
    fault.

    Another one is supposed where there was none, by its size, and where such a one would show no more."""
    ((psi, r, p, w), both, squares, stuck, slow, against, own), (_, k0, k1, k2, k3) = moved, gains
    off, s, s_slow, left = shown
    added, by_slow, square = psi * psi / variance, off - s_slow, left * left
    both, squares = both + left * psi / variance, squares + added
    stuck, slow = stuck + 0.5 * (square - off * off) / variance, slow + 0.5 * (square - by_slow * by_slow) / variance
    against, own = against + off * s / variance, own + s * s / variance
    is_over = added * GUST_SIZE * GUST_SIZE < 1.0 and added < GUST_OVER * squares
    if is_over or gust_likelier(both, squares) < -GUST_IN:
        return begun_gust(evidence)
    return (psi - k0 * psi, r - k1 * psi, p - k2 * psi, w - k3 * psi), both, squares, stuck, slow, against, own


def begun_gust(evidence: float) -> Gust:
    """Return a gust that sets in now, where there is so much `evidence` of a fault."""
    return NOTHING, 0.0, 0.0, evidence, 0.0, 0.0, 0.0


def gust_likelier(both: float, squares: float) -> float:
    """Return how much likelier the headings are where a gust has set in than without one, of which nothing is known but
    GUST_SIZE B: b ~ N(0, B^2), and log p(y | gust)/p(y) = both^2/(2 (squares + 1/B^2)) - log(1 + B^2 squares)/2."""
    size = GUST_SIZE * GUST_SIZE
    return 0.5 * both * both / (squares + 1.0 / size) - 0.5 * math.log(1.0 + size * squares)


def is_gust_likelier(gust: Gust, usual: float) -> bool:
    """Return whether a gust explains the headings, and better than any fault does: a rudder that does nothing, one of
    the opposite share of the answer that explains most, but no more than the `usual` one, or a slow one."""
    _, both, squares, stuck, slow, against, own = gust
    if squares == 0.0:
        return False
    likelier = gust_likelier(both, squares) - GUST_IN
    if not (likelier > 0.0 and likelier > stuck and likelier > slow):
        return False
    share = usual if -against > usual * own else -against / own if against < 0.0 else 0.0
    return likelier > stuck - share * against - 0.5 * share * share * own


def is_suspect(stuck: float, wrong: float, blocks: Blocks) -> bool:
    """Return whether there is so much evidence of a fault, by headings or by blocks, that nothing is learnt of boat and
    sea: either may see it first."""
    return stuck >= SUSPECT or wrong >= SUSPECT or blocks.stuck >= SUSPECT or blocks.reversed >= SUSPECT


def _without_heading(
    before: ResponseState, time: float, covariance: Covariance, means: Means, blocks: Blocks, gust: Gust
) -> ResponseState:
    """Return what is known at `time` [s] of a heading that is left out."""
    return ResponseState(
        time,
        covariance,
        means,
        before.slid,
        before.stuck,
        before.stuck_late,
        before.reversed,
        before.reversed_late,
        before.unexplained,
        before.outliers + 1,
        before.usual,
        before.shown,
        before.others,
        before.usual_colour,
        blocks,
        before.since,
        gust,
        NOTHING_ADDED,
    )


def others_step(
    before: Others,
    time_constant: float,
    variance: float,
    dt: float,
    shown: tuple[float, float, float, float],
    is_pushed: bool,
) -> Others:
    """Return what is known of the other explanations `dt` [s] later; shown: how far the heading is from what it would
    be without a rudder, the answers to the rudder, to a late one and to a slow one [rad]; is_pushed: by a gust, which
    is no evidence of a slow rudder."""
    of_lively, of_quick, misfit, misfit_slow, weak, right, strong, latest, fit, left, colour = before
    (lively, lively_port), (quick, quick_port) = of_lively, of_quick
    off, s, s_late, s_slow = shown
    lasts = FADES_SLOW * time_constant
    kept = math.exp(-dt / (lasts if lasts > FADES_TIME else FADES_TIME))
    share = 1.0 - math.exp(-dt / (time_constant if time_constant > MISFIT_TIME else MISFIT_TIME))
    # what neither any share of the answer explains, nor a slow rudder's, is a gust or a sea: no evidence of either
    ahead, left_by_slow = off if s >= 0.0 else -off, off - s_slow
    square = ahead * ahead / variance if ahead < 0.0 else 0.0
    misfit += share * ((OUTLIER_SQUARE if square > OUTLIER_SQUARE else square) - misfit)
    square_slow = left_by_slow * left_by_slow
    square = square_slow / variance
    misfit_slow += share * ((OUTLIER_SQUARE if square > OUTLIER_SQUARE else square) - misfit_slow)
    most = MOST_AT_ONCE if misfit < MISFIT else 0.0
    most_slow = MOST_AT_ONCE if misfit_slow < MISFIT and not is_pushed else 0.0
    lively, lively_port, quick, quick_port = kept * lively, kept * lively_port, kept * quick, kept * quick_port
    one, other = off - LIVELY[0] * s, off - LIVELY[1] * s
    squares_lively = one * one - other * other
    one, other = off - QUICK[0] * s, off - QUICK[1] * s
    squares_quick = one * one - other * other
    if s > 0.0:
        lively = grown(lively, squares_lively, variance, most)
        quick = grown(quick, squares_quick, variance, most)
    else:
        lively_port = grown(lively_port, squares_lively, variance, most)
        quick_port = grown(quick_port, squares_quick, variance, most)
    newest = 1.0 - math.exp(-dt / COLOUR_TIME)
    # where no time has passed a second heading of the same instant says nothing of colour
    if newest > 0.0:
        both, squares = kept * fit[0] + off * s / variance, kept * fit[1] + s * s / variance
        fit, best = (both, squares), both / squares if both > squares > 0.0 else 1.0
        left += newest * ((off - best * s) / math.sqrt(variance) - left)
        # the mean of white noise has the variance newest/(2 - newest)
        square = left * left * (2.0 - newest) / newest
        colour = square + kept * (colour - square)
    by_weak, by_right, by_strong, by_late = off - WEAK * s, off - s, off - STRONG * s, off - s_late
    weak, right, strong, latest = all_grown(
        (kept * weak, kept * right, kept * strong, kept * latest),
        (
            by_weak * by_weak - square_slow,
            by_right * by_right - square_slow,
            by_strong * by_strong - square_slow,
            by_late * by_late - square_slow,
        ),
        variance,
        most_slow,
    )
    return Others(
        (lively, lively_port),
        (quick, quick_port),
        misfit,
        misfit_slow,
        weak,
        right,
        strong,
        latest,
        fit,
        left,
        colour,
    )


def without_evidence(before: ResponseState, after: ResponseState) -> ResponseState:
    """Return `after` with no more evidence against the rudder than `before`; what speaks for it counts."""
    was, others = before.others, after.others
    return ResponseState(
        after.time,
        after.covariance,
        after.means,
        after.slid,
        min(before.stuck, after.stuck),
        min(before.stuck_late, after.stuck_late),
        min(before.reversed, after.reversed),
        min(before.reversed_late, after.reversed_late),
        after.unexplained,
        after.outliers,
        after.usual,
        after.shown,
        Others(
            (min(was.lively[0], others.lively[0]), min(was.lively[1], others.lively[1])),
            (min(was.quick[0], others.quick[0]), min(was.quick[1], others.quick[1])),
            others.misfit,
            others.misfit_slow,
            min(was.weak, others.weak),
            min(was.right, others.right),
            min(was.strong, others.strong),
            min(was.late, others.late),
            others.fit,
            others.left,
            others.colour,
        ),
        after.usual_colour,
        no_more_blocks(before.blocks, after.blocks),
        before.since,
        after.gust,
        (min(after.added[0], 0.0), min(after.added[1], 0.0), min(after.added[2], 0.0)),
    )


def taken_over(response: ResponseState) -> ResponseState:
    """Return how a boat turns at the newest heading that others have steered until then, and what pushes it and the
    sea, as if nothing were known of its rudder."""
    blocks, share = response.blocks, response.usual / response.shown
    fresh = first_blocks(Noise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0)
    return NO_RESPONSE._replace(
        time=response.time,
        covariance=response.covariance,
        means=_by_itself(response.means, share),
        blocks=fresh._replace(
            covariance=blocks.covariance, means=_by_itself(blocks.means, share), spectrum=emptied(blocks.spectrum)
        ),
    )


def _by_itself(means: Means, share: float) -> Means:
    (psi, r, p, w), (psi_1, r_1, p_1, w_1), _, _, _ = means
    own = psi + share * psi_1, r + share * r_1, p + share * p_1, w + share * w_1
    return own, NOTHING, NOTHING, NOTHING, NOTHING
