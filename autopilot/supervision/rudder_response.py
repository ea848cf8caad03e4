"""The rudder-response monitor: whether the boat's heading answers its rudder, as a generalised likelihood ratio.

A filter parts the answer to the rudder from what sea and wind do (`response_filter`).

By this the innovation of a filter that supposes the share a of the rudder's answer is nu - a s: nu that of a filter
which knows of no rudder, s the part of the rudder's answer which could not have been p or w. Both come from the same
gains. The evidence for one share against another is the sum of the logarithms of their likelihood ratios over the
headings, begun anew at zero (Page 1954), so that it needs no window: it grows only where the rudder moves, faster than
wind and sea would, and the boat does not go along. A straight course with a rudder that rests tells nothing.

How large the sea is counts in this, and is not known: a quick rudder takes its yaw away, and a fault lets it be felt.
So each heading is weighed in three seas, the one that is felt and two larger ones, with l the log-likelihood of late of
a boat that answers, and g the evidence of a fault, in that sea. The evidence is max(l + g) - max l: a fault came in the
sea that was there before, and a boat that answers may be in whatever sea explains all its headings best.

Of a boat that answers and slides in its turn nu - a s - c g is left: g is the answer to what brakes it, and its share c
is estimated from the headings before, none where the boat has sailed turns without a slide. A boat that turns against
its rudder, or on with it where the rudder has come back, is none that is braked: that counts in full.

Sources: Willsky and Jones 1976, the generalised likelihood ratio of an additive change, here of a change in a; Page
1954, the cumulative sum; Magill 1965, a filter for each size that is supposed. Scalar functions over NamedTuples,
compiled by `sitl.compiled` as they are. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.models.norrbin import Norrbin
from autopilot.supervision.response_filter import (
    NO_SLIDE,
    NOTHING,
    Covariance,
    Gains,
    Mean,
    Noise,
    Slide,
    Transition,
    corrected,
    in_sea,
    measured,
    moved,
    predicted,
    slide_learnt,
    slide_share,
    transition_of,
)
from autopilot.supervision.tuning import (
    ANSWERS_MOST,
    COLOUR_FIRST,
    COLOUR_KNOWN,
    COLOUR_TIME,
    DOUBTED,
    FADES_SLOW,
    FADES_TIME,
    GUST,
    LEAST,
    LEAST_SHARE,
    LIVELY,
    MISFIT,
    MISFIT_TIME,
    MOST_AT_ONCE,
    OUTLIER,
    OUTLIERS_MOST,
    PUSHED_SIGMAS,
    QUICK,
    REVERSED_SHARE,
    SEA_TIME,
    SEAS,
    SURE,
    SUSPECT,
    UNEXPLAINED,
    UNEXPLAINED_TIME,
    USUAL,
    USUAL_SURE,
    USUAL_TIME,
)

WEAK, STRONG = LEAST[0], ANSWERS_MOST
"""The least and the most that a boat answers whose rudder is not slow."""
RATE_UNKNOWN = 0.2**2
PUSH_UNKNOWN = math.radians(20.0) ** 2
"""Variances of a rate [(rad/s)^2] and a push [rad^2] of which nothing is known."""
OUTLIER_SQUARE = OUTLIER * OUTLIER


class Rudders(NamedTuple):
    """Where the rudder was [rad]: in time, or where everything is `LATE_S` late, or the rudder much slower than filed
    (`in_time` again where that is out of question); what a boat that slides is braked by, see `slide_step`; and the
    share of the answer that drift leaves."""

    in_time: float
    late: float
    slow: float
    slide: float
    weaker: float


class Others(NamedTuple):
    """What else may turn the boat as it turns. slow: the answer to a slow rudder; lively and quick: how much likelier
    each is, to starboard and to port; strange and strange_slow: squares that no answer explains, nor a slow rudder;
    weak, right, strong and late: how much likelier a slow rudder is than a boat that answers in this way; fit: sums of
    innovation times answer and of the answer's square, over the variance; left: the mean of late of what the best share
    of the answer leaves over [standard deviations]; colour: its square, 1 where that is white noise."""

    slow: Mean
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


NO_OTHERS = Others(NOTHING, (0.0, 0.0), (0.0, 0.0), 0.5, 1.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0), 0.0, 1.0)


class Supposed(NamedTuple):
    """What is known if the sea is of one size. covariance and mean of a boat without a rudder; answers to the rudder
    [rad], in time and late, and to what brakes a boat that slides; how much likelier it is that the rudder is stuck
    than that the boat answers, in time and late, and that it is reversed; unexplained: squares that no answer explains;
    outliers: how many of the last headings were; fit: the log-likelihood of the headings of late, of a boat that
    answers."""

    covariance: Covariance
    mean: Mean
    answer: Mean
    late: Mean
    slide: Mean
    stuck: float
    stuck_late: float
    reversed: float
    reversed_late: float
    unexplained: float
    outliers: int
    fit: float


class ResponseState(NamedTuple):
    """time [s] of the newest heading, nan: nothing is known yet; seas: what is known in the sea that is felt, and in
    two of other sizes; slid: how much the boat slides; usual and shown: the share of the model's answer that the boat
    has had so far is the former over the latter; others: the boat or its rudder may not be the file's; usual_colour:
    the colour of what is left over as long as nothing was suspect, and at first what a sea's may be."""

    time: float
    seas: tuple[Supposed, Supposed, Supposed]
    slid: Slide
    usual: float
    shown: float
    others: Others
    usual_colour: float


def first_response(noise: Noise, time: float, heading: float) -> ResponseState:
    """Return what is known after the first heading [rad]: a sea that is not felt is as rare as a false verdict."""
    felt = _first(noise, noise.sea, heading, 0.0)
    middle, large = _first(noise, SEAS[0], heading, -SURE), _first(noise, SEAS[1], heading, -2.0 * SURE)
    usual = USUAL * USUAL_SURE
    return ResponseState(time, (felt, middle, large), NO_SLIDE, usual, USUAL_SURE, NO_OTHERS, COLOUR_FIRST)


def _first(noise: Noise, sea: float, heading: float, fit: float) -> Supposed:
    covariance = Covariance(noise.heading, 0.0, 0.0, 0.0, RATE_UNKNOWN, 0.0, 0.0, PUSH_UNKNOWN, 0.0, sea)
    mean = heading, 0.0, 0.0, 0.0
    return Supposed(covariance, mean, NOTHING, NOTHING, NOTHING, 0.0, 0.0, 0.0, 0.0, 1.0, 0, fit)


NO_RESPONSE = first_response(Noise(0.0, 0.0, 0.0, 0.0, 0.0), math.nan, math.nan)


def grown(evidence: float, squares: float, variance: float, most: float) -> float:
    """Return the `evidence` with what a heading adds, of which one answer leaves a square that is so much larger
    [rad^2] than what another leaves: how much likelier the other one is, half the difference of the `squares` over the
    variance, within MOST_AT_ONCE less and `most` more."""
    more = 0.5 * squares / variance
    evidence += most if more > most else more if more > -MOST_AT_ONCE else -MOST_AT_ONCE
    return evidence if evidence > 0.0 else 0.0


class Heard(NamedTuple):
    """A heading [rad], dt [s] after the one before; least: the least share of the answer that a boat has which answers;
    braked: the share of the slide's answer that it has; slow [rad]: the answer to a slow rudder."""

    heading: float
    dt: float
    least: float
    braked: float
    slow: float


class Innovation(NamedTuple):
    """How far the heading is from what it would be without a rudder, the answers to the rudder, in time and late, and
    the slide's [rad]; gains: of the filter; is_left_out: the heading is."""

    off: float
    answer: float
    late: float
    slide: float
    gains: Gains
    is_left_out: bool


def supposed_step(
    before: Supposed, step: Transition, noise: Noise, heard: Heard, rudders: Rudders
) -> tuple[Supposed, Innovation]:
    """Return what is known after a heading if the sea is the noise's."""
    known, mean, answer, late, slide, stuck, stuck_late, wrong, wrong_late, unexplained, outliers, fit = before
    heading, dt, least, braked, by_slow = heard
    is_gust = unexplained > UNEXPLAINED
    covariance = predicted(step, known, noise, noise.push + GUST if is_gust else noise.push, dt)
    gains, known = measured(covariance, noise.heading)
    variance = gains[0]
    mean, answer = moved(step, mean, 0.0), moved(step, answer, rudders.in_time)
    late, slide = moved(step, late, rudders.late), moved(step, slide, rudders.slide)
    off, s, s_late, g = heading - mean[0], answer[0], late[0], slide[0]
    off = off if -PI < off <= PI else wrap(off)
    kept, remembered = math.exp(-dt / FADES_TIME), math.exp(-dt / SEA_TIME)
    # of the shares of the answer, the opposite one allowed, the one that explains most; a slow rudder is no gust either
    ahead, size = (-off, -s) if s < 0.0 else (off, s)
    left = ahead + size if ahead < -size else ahead - ANSWERS_MOST * size if ahead > ANSWERS_MOST * size else 0.0
    left_by_slow = off - by_slow
    square = (left * left if left * left < left_by_slow * left_by_slow else left_by_slow * left_by_slow) / variance
    if square > OUTLIER_SQUARE:
        square = OUTLIER_SQUARE
        if outliers < OUTLIERS_MOST:
            fit = remembered * fit - 0.5 * (math.log(variance) + square)
            wild = Supposed(
                Covariance(*covariance),
                mean,
                answer,
                late,
                slide,
                stuck,
                stuck_late,
                wrong,
                wrong_late,
                unexplained,
                outliers + 1,
                fit,
            )
            return wild, Innovation(off, s, s_late, g, gains, True)
    # while a gust sets in nothing that the rudder does against it is evidence
    most = 0.0 if is_gust else MOST_AT_ONCE
    off_some, off_some_late = off - least * s - braked * g, off - least * s_late
    off_wrong, off_wrong_late = off - REVERSED_SHARE * s, off - REVERSED_SHARE * s_late
    square_some, square_some_late = off_some * off_some, off_some_late * off_some_late
    # of the shares that a boat has which answers, too
    ahead -= braked * (-g if s < 0.0 else g)
    left = ahead - least * size if ahead < least * size else max(ahead - ANSWERS_MOST * size, 0.0)
    # no heading speaks more against an answer than it counts as evidence of a fault
    least_square = min(off * off, off_wrong * off_wrong)
    square_most = min(least_square / variance + 2.0 * MOST_AT_ONCE, OUTLIER_SQUARE)
    fit = remembered * fit - 0.5 * (math.log(variance) + min(left * left / variance, square_most))
    after = Supposed(
        known,
        corrected(gains, mean, off),
        corrected(gains, answer, -s),
        corrected(gains, late, -s_late),
        corrected(gains, slide, -g),
        grown(kept * stuck, square_some - off * off, variance, most),
        grown(kept * stuck_late, square_some_late - off * off, variance, most),
        grown(kept * wrong, square_some - off_wrong * off_wrong, variance, most),
        grown(kept * wrong_late, square_some_late - off_wrong_late * off_wrong_late, variance, most),
        unexplained + (1.0 - math.exp(-dt / UNEXPLAINED_TIME)) * (square - unexplained),
        0,
        fit,
    )
    return after, Innovation(off, s, s_late, g, gains, False)


def response_step(
    before: ResponseState, model: Norrbin, noise: Noise, rate: float, newest: tuple[float, float], rudders: Rudders
) -> ResponseState:
    """Return what is known after the `newest` heading [rad] at its time [s], the rudder having been at `rudders` since
    the one before; the boat turns at about `rate` [rad/s]."""
    last, (felt, middle, large), slid, usual, shown, others, colour = before
    time, heading = newest
    dt = time - last
    step = transition_of(model, rate, noise.pace, dt)
    slow = moved(step, others.slow, rudders.slow)
    least = LEAST_SHARE * usual / shown
    least = least if least > LEAST[0] else LEAST[0]
    least = rudders.weaker * (least if least < LEAST[1] else LEAST[1])
    # how much the boat slides is known by what came before, so that no heading explains itself
    heard = Heard(heading, dt, least, slide_share(slid), slow[0])
    felt, (off, s, s_late, g, gains, is_left_out) = supposed_step(felt, step, noise, heard, rudders)
    middle, _ = supposed_step(middle, step, in_sea(noise, SEAS[0]), heard, rudders)
    large, _ = supposed_step(large, step, in_sea(noise, SEAS[1]), heard, rudders)
    if is_left_out:
        return ResponseState(time, (felt, middle, large), slid, usual, shown, others_moved(others, slow), colour)
    variance = gains[0]
    # what may be a fault is none of the boat's usual ways
    learns = 0.0 if felt.stuck >= SUSPECT or before.seas[0].reversed >= SUSPECT else 1.0 / variance
    slid = slide_learnt(slid, model, (off - least * s, g, variance), dt, learns > 0.0)
    slow_after, unknown = corrected(gains, slow, -slow[0]), math.exp(-dt / FADES_TIME) * (colour - others.colour)
    others = others_step(others, model.time_constant, variance, dt, (off, s, s_late, slow[0]), slow_after)
    remembered = math.exp(-dt / USUAL_TIME)
    return ResponseState(
        time,
        (felt, middle, large),
        slid,
        USUAL * USUAL_SURE + remembered * (usual - USUAL * USUAL_SURE) + learns * off * s,
        USUAL_SURE + remembered * (shown - USUAL_SURE) + learns * s * s,
        others,
        others.colour + unknown if learns > 0.0 else colour,
    )


def others_moved(before: Others, slow: Mean) -> Others:
    """Return what is known of the other explanations after a heading that is left out; `slow`: the answer then."""
    _, lively, quick, misfit, misfit_slow, weak, right, strong, latest, fit, left, colour = before
    return Others(slow, lively, quick, misfit, misfit_slow, weak, right, strong, latest, fit, left, colour)


def others_step(
    before: Others,
    time_constant: float,
    variance: float,
    dt: float,
    shown: tuple[float, float, float, float],
    slow: Mean,
) -> Others:
    """Return what is known of the other explanations `dt` [s] later; shown: how far the heading is from what it would
    be without a rudder, the answers to the rudder, to a late one and to a slow one [rad]; slow: the mean of that
    answer after the heading."""
    _, of_lively, of_quick, misfit, misfit_slow, weak, right, strong, latest, fit, left, colour = before
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
    most_slow = MOST_AT_ONCE if misfit_slow < MISFIT else 0.0
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
    return Others(
        slow,
        (lively, lively_port),
        (quick, quick_port),
        misfit,
        misfit_slow,
        grown(kept * weak, by_weak * by_weak - square_slow, variance, most_slow),
        grown(kept * right, by_right * by_right - square_slow, variance, most_slow),
        grown(kept * strong, by_strong * by_strong - square_slow, variance, most_slow),
        grown(kept * latest, by_late * by_late - square_slow, variance, most_slow),
        fit,
        left,
        colour,
    )


def without_evidence(before: ResponseState, after: ResponseState) -> ResponseState:
    """Return `after` with no more evidence against the rudder than `before`; what speaks for it counts."""
    (felt, middle, large), (was_felt, was_middle, was_large) = after.seas, before.seas
    was, others = before.others, after.others
    return ResponseState(
        after.time,
        (_no_more(felt, was_felt), _no_more(middle, was_middle), _no_more(large, was_large)),
        after.slid,
        after.usual,
        after.shown,
        Others(
            others.slow,
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
    )


def _no_more(after: Supposed, before: Supposed) -> Supposed:
    return Supposed(
        after.covariance,
        after.mean,
        after.answer,
        after.late,
        after.slide,
        min(before.stuck, after.stuck),
        min(before.stuck_late, after.stuck_late),
        min(before.reversed, after.reversed),
        min(before.reversed_late, after.reversed_late),
        after.unexplained,
        after.outliers,
        after.fit,
    )


def acquitted(response: ResponseState) -> ResponseState:
    """Return the same with no more evidence against the rudder than makes as much again as was a doubt a verdict."""
    most = SURE - DOUBTED
    felt, middle, large = (
        each._replace(
            stuck=min(each.stuck, most),
            stuck_late=min(each.stuck_late, most),
            reversed=min(each.reversed, most),
            reversed_late=min(each.reversed_late, most),
        )
        for each in response.seas
    )
    return response._replace(seas=(felt, middle, large))


def evidence(response: ResponseState) -> tuple[float, float]:
    """Return how much likelier it is that the rudder is stuck, or reversed, than that the boat answers.

    With l the log-likelihood of a boat that answers in a sea of one size, and g that of a fault since it may have begun
    over that of an answer since then, l + g is that of the fault in the same sea before and after: a boat that answers
    may be in whatever sea explains all of the headings best.
    """
    felt, middle, large = response.seas
    best = max(felt.fit, middle.fit, large.fit)
    stuck, wrong = 0.0, 0.0
    for each in response.seas:
        likely = each.fit - best
        in_time, late = each.stuck, each.stuck_late
        more = likely + (in_time if in_time < late else late)
        stuck = more if more > stuck else stuck
        in_time, late = each.reversed, each.reversed_late
        more = likely + (in_time if in_time < late else late)
        wrong = more if more > wrong else wrong
    return stuck, wrong


def verdict(response: ResponseState) -> int:
    """Return 0 where the boat answers or nothing tells, 1 where it does not, -1 where it answers to the opposite."""
    stuck, wrong = evidence(response)
    if stuck < SURE and wrong < SURE:
        return 0
    sure = SURE * max(response.usual_colour / COLOUR_KNOWN, 1.0)
    return -1 if wrong >= sure else 1 if stuck >= sure else 0


def is_doubtful(response: ResponseState) -> bool:
    """Return whether there is some evidence that the boat does not answer, or to the opposite rudder; that in the sea
    that is felt is enough: a doubt lets go of nothing."""
    felt = response.seas[0]
    is_reversed = felt.reversed >= DOUBTED and felt.reversed_late >= DOUBTED
    is_stuck = felt.stuck >= DOUBTED and felt.stuck_late >= DOUBTED
    return is_reversed or is_stuck or max(evidence(response)) >= DOUBTED


def push_at_least(response: ResponseState) -> float:
    """Return what the boat is pushed by beside rudder and sea [rad of rudder], less `PUSHED_SIGMAS`; 0 where that
    may be nothing. The boat is supposed to answer to its rudder as usual."""
    felt = response.seas[0]
    push = felt.mean[2] + response.usual / response.shown * felt.answer[2]
    uncertain = PUSHED_SIGMAS * math.sqrt(max(felt.covariance.p22, 0.0))
    return math.copysign(max(abs(push) - uncertain, 0.0), push)


FILED, QUICKER, SLOW_RUDDER, LIVELIER = 0, 1, 2, 3
"""What boat and rudder turn out to be: the file's as far as anything tells, a boat that turns as none of the model, a
slow rudder, or a boat that turns more than the model allows for. Of several the first counts."""


def other_verdict(others: Others) -> int:
    """Return what boat and rudder turn out to be."""
    if others.right >= SURE and others.weak >= SURE and others.strong >= SURE and others.late >= SURE:
        return SLOW_RUDDER
    quick, lively = others.quick, others.lively
    if quick[0] < SURE and lively[0] < SURE:
        return FILED
    sure = SURE * max(others.colour, 1.0)
    if quick[0] >= sure and quick[1] >= sure:
        return QUICKER
    return LIVELIER if lively[0] >= sure and lively[1] >= sure else FILED
