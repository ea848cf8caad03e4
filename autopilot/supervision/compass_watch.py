"""The compass watch: a heading that stands still, jumps, or does not go together with the rate of turn or the model.

Rate-heading consistency: how far apart what heading and rate of turn tell of the boat's turns is, and whether they go
opposite ways. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.signals import AlarmEvent, HeadingSample, RateSample
from autopilot.supervision.frozen_heading import Sea, Standing, frozen_step
from autopilot.supervision.heading_jump import (
    NO_TURNS,
    NOT_HELD,
    TURN_SHOWS,
    Held,
    Jumping,
    Turns,
    alone_step,
    are_consistent,
    are_opposite,
    held_step,
    jumping_step,
    settled,
    turn_shown,
    turns_step,
)
from autopilot.supervision.monitor_input import AlarmLimits, Measured, MonitorInput
from autopilot.supervision.tuning import (
    APART_TIME,
    DISAGREES_LASTS,
    DISAGREES_SAID,
    FINE_SAME,
    FROZEN_BY_RATE,
    FROZEN_RATES,
    FROZEN_REPEATED,
    FROZEN_SAMPLES,
    HEADINGS_APART_S,
    HELD_SIGMAS,
    INNOVATION_TIME,
    JUMP_SAID,
    NEWS,
    RATE_LAG,
    RATE_OFF,
    RATE_RIGHT,
    SENSE_LEAST,
    TREMBLES_SAME,
    WILD_RATES,
)

OPPOSITE_WAYS = "they turn opposite ways"
STANDS_STILL = "the rate stands still"


class Still(NamedTuple):
    """A rate that is the same to the last digit: turn [rad]: how much further the heading went meanwhile, of late;
    since [s]: when that became too much, nan: it is not, and the `rates` that have said the same since; is_dead: until
    it moves. mean [rad]: of the turn, over FROZEN_REPEATED, and first: what it was at the end of the first such time.
    rate [rad/s]: the newest of a `source`; alike: how many say the same, and begun [s]: the first of them. heard: how
    many rates there were, of which `same` were the same as the one before, while it worked; digit [rad/s]: the least
    step between two."""

    rates: int = 0
    turn: float = 0.0
    since: float = math.nan
    is_dead: bool = False
    mean: float = 0.0
    first: float = 0.0
    rate: float = math.nan
    source: str = ""
    alike: int = 0
    begun: float = math.nan
    heard: int = 0
    same: int = 0
    digit: float = math.inf


def is_strange(still: Still) -> bool:
    """Return whether a rate has never stood so long.

    A sensor of whose rates no more than a share FINE_SAME were the same as the one before says the same FROZEN_RATES
    times with a probability of FINE_SAME^3 = 8e-6, one of TREMBLES_SAME FROZEN_SAMPLES times with 0.2^9 = 5e-7.
    """
    share = still.same + 1.0
    is_fine = still.alike >= FROZEN_RATES and share <= FINE_SAME * still.heard
    return is_fine or (still.alike >= FROZEN_SAMPLES and share <= TREMBLES_SAME * still.heard)


def is_turned(still: Still, step: float, usual: float) -> bool:
    """Return whether the heading, every `step` [s], shows a turn that a rate which stands does not: more than a rate
    that is right may be off, what rates within a digit add up to over APART_TIME, and HELD_SIGMAS of noise.

    That is what usually lies between heading and rate, `usual` [rad]. The mean over FROZEN_REPEATED has the share
    s/(2 - s) of white noise's variance, s = 1 - exp(-step/FROZEN_REPEATED), and what lies between two such means twice
    that.
    """
    share = -math.expm1(-step / FROZEN_REPEATED)
    least, noise = RATE_RIGHT * APART_TIME, HELD_SIGMAS * usual
    unseen = still.digit * APART_TIME
    of_means = noise * math.sqrt(2.0 * share / (2.0 - share)) + unseen
    return abs(still.turn) > max(noise + unseen, least) or abs(still.mean - still.first) > max(of_means, least)


def still_step(still: Still, time: float, turn: float, step: float, usual: float) -> Still:
    """Return what is known at `time` [s] of a rate that stands, the heading having turned by `turn` [rad] more than it
    says in a `step` [s]; usual [rad]: a root mean square of what lies between the two, inf: it is not known.

    For FROZEN_REPEATED what is the same may be one that is sent again.
    """
    fades = math.exp(-step / APART_TIME)
    turn += still.turn * fades
    mean = still.mean * fades
    mean -= math.expm1(-step / FROZEN_REPEATED) * (turn - mean)
    is_first = time - still.begun < FROZEN_REPEATED
    still = still._replace(turn=turn, mean=mean, first=mean if is_first else still.first * fades)
    if not is_first and is_strange(still) and is_turned(still, step, usual):
        return still._replace(is_dead=True)
    if -FROZEN_BY_RATE <= turn <= FROZEN_BY_RATE:
        return still._replace(rates=0, since=math.nan)
    since = time if math.isnan(still.since) else still.since
    is_dead = still.is_dead or (still.rates >= FROZEN_RATES and time - since >= DISAGREES_LASTS)
    return still._replace(since=since, is_dead=is_dead)


class Consistency(NamedTuple):
    """heading and rate: the newest of each; turns: what they tell; since [s]: when the turns began to differ, nan: they
    do not; seen [s]: when that was found last; reported [rad]: how far apart they were when it was said; found: what is
    said, '' where they go together; is_refused: whether it is the rate that is wrong: they turn opposite ways, it
    stands still, or no boat like this turns so; wild [s]: when rates came of late that are beyond what a boat like this
    turns by; still: what is known of a rate that stands, and aside: of an instrument's of its own beside a heading that
    has one; held: of headings that jumped, and the boat did not turn."""

    heading: HeadingSample | None = None
    rate: RateSample | None = None
    turns: Turns = NO_TURNS
    since: float = math.nan
    seen: float = math.nan
    reported: float = math.nan
    found: str = ""
    is_refused: bool = False
    wild: tuple[float, ...] = ()
    still: Still = Still()
    held: Held = NOT_HELD
    aside: Still = Still()


def carried_on(
    before: Consistency,
    by_heading: tuple[float, float],
    at: tuple[float, float | None],
    is_believed: bool,
    most: tuple[float, float],
) -> tuple[Held, Turns]:
    """Return what is held, and the turns, after a heading that is further `by_heading` [rad, in s]; at: time [s] and
    rate [rad/s], None without one, and whether that is believed; most: see `held_step`."""
    (turn, step), (time, rate), (jump, quickest) = by_heading, at, most
    held, turns = before.held, before.turns
    stood = held.stood + step if turn == 0.0 else 0.0
    shown = turn / (held.stood + step) if turn != 0.0 and step > 0.0 else held.rate
    if rate is not None and is_believed and jump < math.inf:
        held, turns = held_step(held, turns, (turn, rate * step, step), (time, rate), most)
    else:
        if jump < math.inf:
            if rate is not None and not held.is_sudden:
                # it was the rate that did not show a turn
                held = settled(held)
            held = alone_step(held, by_heading, time, jump, quickest)
            turn -= held.offset - before.held.offset
        turns = turns if rate is None else turns_step(turns, turn, rate * step, step)
    return held._replace(stood=stood, rate=shown), turns


def concluded(before: Consistency) -> Consistency:
    """Return what is known of the rate without what was compared so far: one that was found wrong stays so until it
    goes together with headings again."""
    return before._replace(heading=None, rate=None, turns=NO_TURNS, since=math.nan, held=NOT_HELD)


def handed_over(before: Consistency) -> tuple[Consistency, float]:
    """Return what is known where another compass steers, and how far [rad] the one before it was held to be off: what
    lies between the two lies between the other and the heading it showed, not the one that was steered by."""
    held = settled(before.held)
    return concluded(before)._replace(held=held._replace(offset=0.0)), held.offset


def consistency_step(
    before: Consistency,
    sample: HeadingSample | RateSample,
    most: float,
    rate_most: float = math.inf,
    jump: float = math.inf,
) -> Consistency:
    """Take a heading or a rate; `most` [rad] may lie between the turns that they tell of, inf: not watched; a boat that
    turns by more than `rate_most` [rad/s] shows it; jump [rad]: see `held_step`, inf: nothing is held."""
    rate, time = sample.rate, sample.time
    last, beside, wild = before.heading, before.rate, before.wild
    # a rate that is held for the headings beside it is one, however many they are
    if rate is not None and not -rate_most <= rate <= rate_most:
        wild = (*wild, time)[-WILD_RATES:]
    # a sum is finite only where every part of it is
    if isinstance(sample, RateSample):
        return _with_rate(before, sample, wild) if math.isfinite(time + sample.rate) else before
    if not -math.inf < time + sample.heading + (0.0 if rate is None else rate) < math.inf:
        return before
    still = before.still if rate is None else _repeated(before.still, sample)
    is_same = last is not None and last.source == sample.source
    if is_same and time < last.time:  # type: ignore[union-attr]
        return before
    if rate is None and beside is not None and 0.0 <= time - beside.time <= HEADINGS_APART_S:
        rate = beside.rate
    # a burst that was read at once has one time: its turn happened since the heading before
    if last is None or not is_same or not 0.0 <= time - last.time <= HEADINGS_APART_S:
        held = settled(before.held)._replace(stood=0.0)
        # what comes behind a gap, or by another name, is none that jumped
        held = held._replace(offset=0.0) if last is not None and (rate is not None or not is_same) else held
        return before._replace(heading=sample, still=still, held=held)
    step, turn = time - last.time, sample.heading - last.heading
    turn = turn if -PI < turn <= PI else wrap(turn)
    is_believed = not before.found and still.rates < FROZEN_RATES
    held, turns = carried_on(before, (turn, step), (time, rate), is_believed, (jump, rate_most))
    if rate is None:
        return before._replace(heading=sample, still=still, held=held)
    before = before._replace(held=held)
    if most == math.inf:
        return before._replace(heading=sample, turns=turns, wild=wild)
    # where the compass stands as well nobody can tell which of the two is dead, nor by what no boat like this turns
    by, most_turn = turn - rate * step, rate_most * step if step > 0.0 else math.inf
    if turn:
        usual = math.sqrt(held.usual) if held.known >= APART_TIME else math.inf
        by = -most_turn if by < -most_turn else most_turn if by > most_turn else by
        still = still_step(still, time, by, step, usual)
    before = before._replace(still=still)
    if before.still.is_dead:
        found = before.found if before.is_refused else STANDS_STILL
        after = before._replace(
            heading=sample, turns=turns, since=math.nan, seen=time, found=found, is_refused=True, wild=wild
        )
    else:
        after = _judged(before, (sample, turns, wild), rate, most, not -rate_most <= rate <= rate_most)
    if after.found and not before.found and held.offset and time - held.jumped < TURN_SHOWS:
        # it was the rate that did not show a turn
        return after._replace(held=NOT_HELD)
    return after


def _with_rate(before: Consistency, sample: RateSample, wild: tuple[float, ...]) -> Consistency:
    """Take a rate of an instrument of its own; that of the heading's own goes before. wild: the times with its."""
    last, beside = before.heading, before.rate
    if last is not None and last.rate is not None:
        return before._replace(rate=sample, aside=_repeated(before.aside, sample))
    still = _repeated(before.still if before.still.source == sample.source else before.aside, sample)
    held, turns = before.held, before.turns
    if beside is not None:
        held, turns = turn_shown(held, turns, (sample.rate - beside.rate) * max(sample.time - beside.time, 0.0))
    return before._replace(rate=sample, turns=turns, wild=wild, still=still, held=held)


def _repeated(still: Still, sample: HeadingSample | RateSample) -> Still:
    """Take the next rate."""
    rate: float = sample.rate  # type: ignore[assignment]
    if sample.source != still.source or still.rate != still.rate:  # what is no number is not itself
        return Still(rate=rate, source=sample.source, alike=1, begun=sample.time)
    if rate == still.rate:
        return still._replace(rates=still.rates + 1, alike=still.alike + 1)
    # what a dead one repeated was none of its ways
    more = 0 if still.is_dead else still.alike - 1
    change, heard, same = abs(rate - still.rate), still.heard + 1 + more, still.same + more
    digit = change if change < still.digit else still.digit
    fresh = Still(rate=rate, source=sample.source, alike=1, begun=sample.time)
    return fresh._replace(heard=heard, same=same, digit=digit)


def is_no_turn(turns: Turns, rate: float, most: float) -> bool:
    """Return whether no heading shows a `rate` [rad/s] that is too quick for the rudder.

    What waves or thrusters turn quicker than the rudder does the heading shows, RATE_LAG later at most.
    """
    unseen = -turns.apart if rate > 0.0 else turns.apart
    return unseen > RATE_LAG * abs(rate) + most


def _judged(
    before: Consistency,
    news: tuple[HeadingSample, Turns, tuple[float, ...]],
    rate: float,
    most: float,
    is_wild: bool,
) -> Consistency:
    (sample, turns, wild), (_, beside, _, since, seen, reported, found, was_refused, _, still, held, aside) = (
        news,
        before,
    )
    time, apart, are_turned = sample.time, abs(turns.apart), are_opposite(turns)
    if wild and time - wild[0] > APART_TIME:
        wild = wild[1:]
    # turns that both tell of alike put an end to it; that they went opposite ways nothing else does: a boat that lies
    # still shows nothing
    was_turned = found == OPPOSITE_WAYS
    lasts = was_refused and not are_consistent(turns)
    is_kept = lasts and (was_turned or 0.0 <= time - seen < DISAGREES_SAID)
    is_none = is_wild and len(wild) >= WILD_RATES and is_no_turn(turns, rate, most)
    is_refused = is_kept or are_turned or is_none
    if is_refused:
        if are_turned:
            found = OPPOSITE_WAYS
        elif not is_kept:
            found = f"{math.degrees(abs(rate)):.0f} deg/s is no turn of this boat"
        # in other units a boat on its course turns by less than is impossible, and yet by more than its heading shows
        if are_turned or was_turned or is_wild or (turns.heading - turns.rate) ** 2 > SENSE_LEAST:
            seen = time
    elif apart <= most:
        since = math.nan
        if not 0.0 <= time - seen < DISAGREES_SAID:
            found = ""
    elif math.isnan(since):
        since = time
    elif time - since >= DISAGREES_LASTS:
        seen = time
        if not found or (apart - reported > NEWS and found != OPPOSITE_WAYS):
            found, reported = f"{math.degrees(apart):.0f} deg apart", apart
    return Consistency(sample, beside, turns, since, seen, reported, found, is_refused, wild, still, held, aside)


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
