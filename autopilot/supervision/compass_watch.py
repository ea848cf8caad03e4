"""The compass watch: a heading that stands still while the boat must be turning, jumps, or contradicts the model.

It stands by the rate beside it, by the rudder, or in a sea. What heading and rate say of one another is
`heading_and_rate`'s. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, shortest_turn, wrap
from autopilot.estimation.tuning import WAVE_MEMORY
from autopilot.models.norrbin import rate_step
from autopilot.models.steering_gear import clip
from autopilot.signals import AlarmEvent, HeadingSample
from autopilot.supervision.monitor_input import AlarmLimits, Measured, MonitorInput
from autopilot.supervision.tuning import (
    FINE_DIGIT,
    FINE_DIGITS,
    FINE_SAME,
    FROZEN_BEFORE,
    FROZEN_BY_RATE,
    FROZEN_BY_RUDDER,
    FROZEN_REPEATED,
    FROZEN_SAMPLES,
    HEADINGS_APART_S,
    INNOVATION_TIME,
    JUMP_SAID,
    JUMP_SAMPLES,
    JUMP_SETTLED,
    JUMP_UNSHOWN,
    JUMPS,
    JUMPS_WITHIN,
    NOUGHT_FORGOTTEN,
    RATE_FORGOTTEN,
    RATE_OFF,
    RATE_RIGHT,
    SEA_DIGITS,
    SEA_FELT,
    SEA_PROVEN,
    SEA_STOOD,
    TREMBLES_DIGITS,
    TREMBLES_KNOWN,
    TREMBLES_LEAST,
    TREMBLES_SAME,
    TREMBLES_SIGMAS,
    TREMBLES_TIME,
)

LONGEST_STEP_S = 0.5
FLOAT_DIGIT = 2.0**-22
"""[rad]: of a float of 32 bits near pi."""


class Standing(NamedTuple):
    """A heading that is the same to the last digit: the `samples` that say so, the first of them [s] and the last; the
    turn that the rate beside it, less rate_bias [rad/s], what is known of its error, adds up to [rad], nan where none
    came, and its span; rate_unknown [(rad/s)^2]: the variance of that bias, inf: it is not known; walk [rad^2]: that of
    the rate's noise, added up; last_rate: that rate the time before, nan where none was, and whether it has moved since
    the model's turn was reckoned; that turn, which the model makes of the rudder while the rate stands: when it was
    reckoned last [s], the bias [rad], the rate [rad/s], and how far it has turned [rad]; is_frozen: until it moves
    again; source: whose heading it is; off [rad]: how far it was from the boat's as that was estimated when it began to
    stand, and unknown [rad^2]: the variance of that; steered: the rate [rad/s] and the turn [rad] that the rudder has
    made since of a boat that lay on its course; quickest [rad/s]: of late, by the rate beside it and by the model, and
    beyond [s]: since when either turn is more than its limit, nan: it is not."""

    heading: float = math.nan
    samples: int = 0
    since: float = math.nan
    time: float = math.nan
    turn: float = math.nan
    low: float = 0.0
    high: float = 0.0
    last_rate: float = math.nan
    rate_moves: bool = False
    reckoned: float = math.nan
    bias: float = 0.0
    rate: float = 0.0
    turned: float = 0.0
    is_frozen: bool = False
    source: str = ""
    off: float = 0.0
    unknown: float = 0.0
    steered: tuple[float, float] = (0.0, 0.0)
    quickest: tuple[float, float] = (0.0, 0.0)
    beyond: tuple[float, float] = (math.nan, math.nan)
    rate_bias: float = 0.0
    rate_unknown: float = math.inf
    walk: float = 0.0


class Sea(NamedTuple):
    """What moves the heading: by this standard deviation [rad] when it began to stand, felt on a course that is held
    since flat water [s]; digit [rad]: the least step of the compass. watched [s]: for how long it had been learnt.
    kept [rad]: the deviation that was known when it was forgotten, until it is known anew. change [rad]: the newest
    step; noise [rad^2]: the variance of the compass's own noise, see `trembling`; same: the share of headings that are
    the same as the one before, of those that `known`, the share of TREMBLES_TIME's memory that is filled, has seen."""

    digit: float = math.inf
    deviation: float = math.nan
    flat: float = math.nan
    watched: float = 0.0
    kept: float = 0.0
    change: float = 0.0
    noise: float = 0.0
    same: float = 1.0
    known: float = 0.0


def trembling(sea: Sea, change: float, step: float, stood: float) -> Sea:
    """Return what moves the heading after a `change` [rad] in a `step` [s], behind headings that were the same for as
    long as it `stood` [s].

    White noise n adds n' - n to one change and n'' - n' to the next, so that its variance is -E[change' change]. What
    turns the boat takes longer than TREMBLES_LEAST, and adds to the same side of both: with that the mean is less.
    """
    size = change if change > 0.0 else -change
    digit = size if size < sea.digit else sea.digit
    if not (0.0 < step <= TREMBLES_LEAST and size <= PI):
        return sea._replace(digit=digit, change=0.0)
    fades = math.exp(-step / TREMBLES_TIME)
    noise = fades * sea.noise - (1.0 - fades) * change * (sea.change if stood == 0.0 else 0.0)
    stays = math.exp(-stood / TREMBLES_TIME)
    same, known = fades * (1.0 - (1.0 - sea.same) * stays), 1.0 - fades * stays * (1.0 - sea.known)
    return sea._replace(digit=digit, change=change, noise=noise, same=same, known=known)


def felt(sea: Sea, seen: MonitorInput) -> Sea:
    """Return what moves the heading after a tick in which it moves.

    A sea that the estimate forgets, for it was learnt beside a rate that is found wrong, is no flat water: where it was
    proven it counts on for WAVE_MEMORY, as long as the estimate would have remembered it.
    """
    now, watched, deviation = seen.now, seen.sea_watched, seen.state.wave_deviation
    kept = sea.deviation if watched < sea.watched and now - sea.flat >= SEA_PROVEN else sea.kept
    kept = kept if seen.holds_course and watched < WAVE_MEMORY else 0.0
    deviation = deviation if deviation > kept else kept
    is_flat = deviation < SEA_FELT or math.isnan(sea.flat) or not seen.holds_course
    return Sea(
        sea.digit, deviation, now if is_flat else sea.flat, watched, kept, sea.change, sea.noise, sea.same, sea.known
    )


def repeated(sea: Sea) -> float:
    """Return the share of headings that are the same as the one before, 1 while it is not known."""
    # the memory began with headings that are all the same, and no noise
    return 1.0 - (1.0 - sea.same) / sea.known if sea.known >= TREMBLES_KNOWN else 1.0


def is_stale(standing: Standing, sea: Sea) -> bool:
    """Return whether heading and rate are sent on as they were: both the same to the last digit, and the rate not
    nought, which may be made of that very heading, so often that a compass which repeats no more than TREMBLES_SAME of
    its headings does it with a probability of 0.2^9. For SEA_STOOD this ends no steering: another compass may be left
    to go on with."""
    stands = standing.samples >= FROZEN_SAMPLES and standing.walk == 0.0 and abs(standing.last_rate) > 0.0
    return stands and repeated(sea) <= TREMBLES_SAME


def never_stands(standing: Standing, sea: Sea, seen: MonitorInput) -> bool:
    """Return whether a compass shows something new each time in a boat that has way, whatever the water is: its own
    noise moved it by its digits, or these are so small that no boat keeps within one, and from one heading to the next
    it moved by many.

    Noise ends with an engine, and a boat may lie within a digit: then the compass shows the heading that it had, as far
    as that is known, and neither the rudder nor the rate of turn beside it says that the boat has turned since: by more
    than a digit, what the rate's bias may add up to while it is remembered, and its noise, at either end of its span.
    """
    digit = sea.digit if sea.digit > FLOAT_DIGIT else FLOAT_DIGIT
    same = repeated(sea)
    if not seen.has_way or same > TREMBLES_SAME:
        return False
    if digit <= FINE_DIGIT and same <= FINE_SAME and abs(sea.change) >= FINE_DIGITS * digit:
        return True
    lasts = min(standing.time - standing.since, RATE_FORGOTTEN)
    doubt = standing.rate_unknown * lasts * lasts + standing.walk
    is_turned = standing.high - standing.low > digit + 2.0 * TREMBLES_SIGMAS * math.sqrt(doubt)
    off, unknown = abs(standing.off - standing.steered[1]), max(standing.unknown, 0.0)
    is_off = is_turned or off > digit + TREMBLES_SIGMAS * math.sqrt(unknown)
    return is_off and sea.noise >= sea.known * TREMBLES_DIGITS * TREMBLES_DIGITS * digit * digit


def was_moved(standing: Standing, sea: Sea) -> bool:
    """Return whether it was a sea that moved the heading until it stood."""
    is_felt = sea.deviation >= max(SEA_FELT, SEA_DIGITS * sea.digit)
    return is_felt and standing.since - sea.flat >= SEA_PROVEN


def stood_by(before: Standing, sample: HeadingSample, bias: float) -> Standing:
    """Take a heading that is the same as the one before it; bias [rad/s]: what is known of the rate's error now. What
    was known when the heading began to stand goes before it: a compass that is frozen teaches a wrong one."""
    time, turn_rate = before.time, sample.rate
    if turn_rate is None or not math.isfinite(time):
        return before._replace(samples=before.samples + 1, time=sample.time)
    step = clip(sample.time - time, 0.0, LONGEST_STEP_S)
    moves = before.rate_moves or not (math.isnan(before.last_rate) or turn_rate == before.last_rate)
    # what is long past may be what is not known of the bias, added up
    kept, bias = math.exp(-step / RATE_FORGOTTEN), before.rate_bias if before.rate_unknown < math.inf else bias
    turn = kept * (0.0 if math.isnan(before.turn) else before.turn) + (turn_rate - bias) * step
    # what lies between two rates is noise, or turns that make this too large
    differs = 0.0 if math.isnan(before.last_rate) else (turn_rate - before.last_rate) * step
    return before._replace(
        samples=before.samples + 1,
        time=sample.time,
        turn=turn,
        low=min(before.low, turn),
        high=max(before.high, turn),
        quickest=(quicker(before.quickest[0], turn_rate, step), before.quickest[1]),
        last_rate=turn_rate,
        rate_moves=moves,
        walk=kept * kept * before.walk + 0.5 * differs * differs,
    )


def beyond(since: float, turn: float, most: float, now: float) -> float:
    """Return since when [s] a `turn` [rad] is more than `most` [rad], nan where it is not."""
    return math.nan if not turn > most else now if math.isnan(since) else since


def is_unseen(turn: float, quickest: float, most: float, lasts: float) -> bool:
    """Return whether a `turn` [rad] is more than `most` [rad], and more than a heading that is repeated hides: of a
    boat that turns by `quickest` [rad/s]; or it `lasts` [s], nan where it is not, for longer than one is repeated,
    however quickly waves or an outlier of a rate sensor turn the boat."""
    return lasts >= FROZEN_REPEATED or (turn > most and turn > FROZEN_REPEATED * quickest + FROZEN_BEFORE * most)


def quicker(before: float, rate: float, step: float) -> float:
    """Return the quickest rate of late [rad/s] after one of `rate` [rad/s], a `step` [s] after it was `before`."""
    return max(abs(rate), before * math.exp(-0.5 * step / FROZEN_REPEATED))


def frozen_step(
    standing: Standing, sea: Sea, seen: MonitorInput, headings: tuple[HeadingSample, ...]
) -> tuple[Standing, Sea]:
    """Take a tick's headings, and judge whether the heading stands still while the boat must be turning.

    A compass that shows something new each time stands for no other reason, in flat water neither. Else it is judged by
    the yaw rate that came with it where there is one that does not stand still too, or by the sea that moved it until
    then, and by the turn that the model makes of the rudder, the bias being what it was when the heading began to
    stand: the estimator has learnt the wrong one since. A rate of nought may be made of that very heading, or true for
    long in flat water: then what a wrong bias adds up to is forgotten.
    """
    now, state = seen.now, seen.state
    for sample in headings:
        heading, time = sample.heading, sample.time
        if sample.source != standing.source:
            # digits and noise are a compass's own, the sea is not
            sea = Sea(math.inf, sea.deviation, sea.flat, sea.watched, sea.kept)
        elif heading == standing.heading:
            standing = stood_by(standing, sample, seen.rate_bias)
            continue
        else:
            change = heading - standing.heading
            change = change if -PI < change <= PI else wrap(change)
            sea = trembling(sea, change, time - standing.time, standing.time - standing.since)
        off = heading - state.heading + state.rate * (now - time)
        standing = Standing(
            heading,
            1,
            time,
            time,
            reckoned=now,
            bias=state.bias,
            rate=state.rate,
            source=sample.source,
            off=off if -PI < off <= PI else wrap(off),
            unknown=seen.unknown,
            rate_bias=seen.rate_bias,
            rate_unknown=seen.rate_unknown,
        )
    if standing.is_frozen:
        return standing, sea
    if standing.samples < 2:
        sea = felt(sea, seen)
    elif (
        standing.samples >= FROZEN_SAMPLES
        and standing.time - standing.since >= SEA_STOOD
        and (never_stands(standing, sea, seen) or was_moved(standing, sea))
    ):
        return standing._replace(is_frozen=True), sea
    if standing.reckoned == now:
        return standing, sea
    last, span, by_rate, by_rudder = standing.time, standing.high - standing.low, *standing.beyond
    by_rate = beyond(by_rate, span, FROZEN_BY_RATE, last)
    standing = standing._replace(beyond=(by_rate, by_rudder))
    is_spanned = standing.samples >= FROZEN_SAMPLES
    is_spanned = is_spanned and is_unseen(span, standing.quickest[0], FROZEN_BY_RATE, last - by_rate)
    if standing.samples < 2 or is_spanned or not seen.steers:
        # what somebody else does with the rudder proves nothing
        since = standing._replace(reckoned=now, bias=state.bias, rate=state.rate, turned=0.0, steered=(0.0, 0.0))
        return since._replace(is_frozen=is_spanned), sea
    step = clip(now - standing.reckoned, 0.0, LONGEST_STEP_S)
    model, push, (own, steered) = seen.model, state.rudder + standing.bias, standing.steered
    rate, own = rate_step(model, standing.rate, push, step), rate_step(model, own, push, step)
    kept = math.exp(-step / NOUGHT_FORGOTTEN) if standing.last_rate == 0.0 else 1.0
    turned = 0.0 if standing.rate_moves else standing.turned * kept + rate * step
    quickest = quicker(standing.quickest[1], rate, step)
    is_frozen = standing.samples >= FROZEN_SAMPLES and seen.has_way
    by_rudder = beyond(by_rudder, abs(turned), FROZEN_BY_RUDDER, last)
    is_frozen = is_frozen and is_unseen(abs(turned), quickest, FROZEN_BY_RUDDER, last - by_rudder)
    standing = standing._replace(steered=(own, 0.0 if standing.rate_moves else steered + own * step))
    standing = standing._replace(rate_moves=False, reckoned=now, rate=rate, turned=turned, is_frozen=is_frozen)
    return standing._replace(quickest=(standing.quickest[0], quickest), beyond=(by_rate, by_rudder)), sea


class Jumping(NamedTuple):
    """last: the newest heading that is believed; away: those since that are further on than the boat can have turned;
    jumps [s]: when it jumped of late; found [s]: when that was an alarm, and by [rad] how much; text: what is said."""

    last: HeadingSample | None = None
    away: tuple[HeadingSample, ...] = ()
    jumps: tuple[float, ...] = ()
    found: float = math.nan
    by: float = math.nan
    text: str = ""


def is_turned(last: HeadingSample, turned: tuple[float, float], rate: float | None, off: float, most: float) -> bool:
    """Return whether the rates [rad/s] beside two headings show the turn between them, (by heading [rad], in a time
    [s]), to within `most` [rad], and more of what it is `off` by [rad] than a rate that is made of the headings does.
    """
    if last.rate is None or rate is None:
        return False
    by_heading, step = turned
    unshown = abs(wrap(by_heading - 0.5 * (last.rate + rate) * step))
    return unshown <= most and unshown < JUMP_UNSHOWN * abs(off)


def jumping_step(before: Jumping, sample: HeadingSample, rate: float, most: float) -> Jumping:
    """Take a heading; it may be off by `most` [rad] from the one before, the boat turning at `rate` [rad/s] as it is
    estimated, or as was measured beside both: where headings are seldom, the first knows nothing of what a sea does."""
    time, heading, measured, source = sample
    if not -math.inf < heading + time < math.inf:
        return before
    last, away, jumps, found, by, text = before
    newest = away[-1] if away else last
    if (
        last is None
        or newest is None
        or last.source != source
        or time < last.time
        or time - newest.time > HEADINGS_APART_S
    ):
        return Jumping(sample, (), jumps, found, by, text)
    off = heading - (last.heading + rate * (time - last.time))
    off = off if -PI < off <= PI else wrap(off)
    turned = heading - last.heading, time - last.time
    if -most <= off <= most or is_turned(last, turned, measured, off, most):
        return Jumping(sample, (), jumps, found, by, text)
    if not away or abs(shortest_turn(away[-1].heading, heading)) > most:
        away, jumps = (), (*(then for then in jumps if time - then < JUMPS_WITHIN), time)
    away = (*away, sample)
    if len(away) >= JUMP_SAMPLES and time - away[0].time >= JUMP_SETTLED:
        return Jumping(sample, (), jumps, time, off, text)
    return Jumping(last, away, jumps, time if len(jumps) >= JUMPS else found, off, text)


class State(NamedTuple):
    """What the compass watch remembers; rate [rad/s]: the boat's, a tick ago; off_since [s]: since when the
    innovation's mean has been off, nan: it is not; off_by: how far it was when that was said first; rate_off: what is
    said of a rate sensor's standing error."""

    standing: Standing = Standing()
    sea: Sea = Sea()
    jumping: Jumping = Jumping()
    rate: float = 0.0
    off_since: float = math.nan
    off_by: str = ""
    rate_off: str = ""


def with_rates(measured: Measured) -> tuple[HeadingSample, ...]:
    """Return the headings, each that has no rate of turn of its own with the one that was measured beside it; with none
    where rate and headings contradict each other, for a rate that is wrong tells nothing of a heading that stands."""
    headings, beside = measured.headings, measured.rate
    if measured.rate_disagrees:
        return tuple(each if each.rate is None else each._replace(rate=None) for each in headings)
    if beside is None:
        return headings
    return tuple(
        each._replace(rate=beside.rate)
        if each.rate is None and abs(each.time - beside.time) <= HEADINGS_APART_S
        else each
        for each in headings
    )


def update(
    limits: AlarmLimits, before: State, seen: MonitorInput, measured: Measured
) -> tuple[State, tuple[AlarmEvent, ...]]:
    """Judge a tick; return what is remembered, and what is found."""
    standing, sea, jumping, rate, off_since, off_by, rate_off = before
    found: tuple[AlarmEvent, ...] = ()
    headings = with_rates(measured) if measured.rate or measured.rate_disagrees else measured.headings
    if limits.frozen_heading:
        standing, sea = frozen_step(standing, sea, seen, headings)
        if standing.is_frozen:
            found = (AlarmEvent("heading_frozen"),)
    for sample in headings:
        jumping = jumping_step(jumping, sample, rate, limits.heading_jump)
    now, state = seen.now, seen.state
    if 0.0 <= now - jumping.found < JUMP_SAID:
        jumping = jumping if jumping.text else jumping._replace(text=f"by {math.degrees(jumping.by):+.0f} deg")
        found += (AlarmEvent("heading_jumping", jumping.text),)
    elif jumping.text:
        jumping = jumping._replace(text="")
    bias = seen.rate_bias
    if not (bias > RATE_RIGHT or bias < -RATE_RIGHT) or limits.rate_disagrees == math.inf:
        rate_off = ""
    elif not rate_off and (bias > RATE_OFF or bias < -RATE_OFF):
        rate_off = f"{math.degrees(abs(bias)):.1f} deg/s apart"
    if measured.rate_disagrees or rate_off:
        found += (AlarmEvent("rate_disagrees", measured.rate_disagrees or rate_off),)
    innovation, most = seen.innovation, limits.innovation
    if not (seen.has_way and (innovation > most or innovation < -most)):
        off_since, off_by = math.nan, ""
    elif math.isnan(off_since):
        off_since = now
    elif now - off_since >= INNOVATION_TIME:
        # as it is at first: each tenth would be a new text
        off_by = off_by or f"{abs(innovation):.1f} standard deviations"
        found += (AlarmEvent("innovation", off_by),)
    rate = state.rate if -math.inf < state.rate < math.inf else 0.0
    return State(standing, sea, jumping, rate, off_since, off_by, rate_off), found
