"""What heading and rate of turn tell of the boat's turns: a rate that is wrong, and a heading that jumps.

How far apart the turns are that both tell of, and whether they go opposite ways. A heading that is off at once by more
than noise and lag explain, and stays so, has jumped, and the boat did not turn: it is carried on by its rate of turn,
and the jump is held. The functions on turns are scalar, over NamedTuples, and compiled by `sitl.compiled` as they are.
Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.models.steering_gear import clip
from autopilot.signals import AlarmEvent, HeadingSample, RateSample
from autopilot.supervision.panel import ESCALATES_AFTER
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
    HELD_FOLLOWS,
    HELD_LAG,
    HELD_LEAST,
    HELD_RESTS,
    HELD_SAID,
    HELD_SETTLES,
    HELD_SIGMAS,
    HELD_STAYS,
    HELD_USUAL_TIME,
    JUMP_SAMPLES,
    JUMP_SETTLED,
    JUMPS,
    NEWS,
    RATE_LAG,
    RATE_RIGHT,
    SENSE_LASTS,
    SENSE_LEAST,
    SENSE_SHARE,
    SENSE_TIME,
    TREMBLES_SAME,
    TURN_GAINED,
    WILD_RATES,
)

SQRT_2 = math.sqrt(2.0)
CLOCK = 1.0e-9
"""[s]: clocks count nanoseconds."""
TURN_SHOWS = HELD_SETTLES + APART_TIME
"""[s]: by then a heading that was taken for one that has jumped, and turns, is off again."""


class Turns(NamedTuple):
    """apart [rad]: the turn by heading less that by rate, of late; heading and rate [rad]: the turns over a shorter
    time by each; difference and sum [rad^2]: the mean squares of both."""

    apart: float
    heading: float
    rate: float
    difference: float
    sum: float


NO_TURNS = Turns(0.0, 0.0, 0.0, 0.0, 0.0)


def turns_step(turns: Turns, by_heading: float, by_rate: float, step: float) -> Turns:
    """Return what is known after a step of `step` [s] in which the boat turned `by_heading` and `by_rate` [rad]."""
    apart, heading, rate, difference, total = turns
    fades = math.exp(-step / SENSE_TIME)
    # no boat turns further between two headings, and an instrument that says so must not falsify the sums
    by_rate = -PI if by_rate < -PI else PI if by_rate > PI else by_rate
    heading, rate = heading * fades + by_heading, rate * fades + by_rate
    share = -math.expm1(-step / SENSE_LASTS)
    return Turns(
        apart * math.exp(-step / APART_TIME) + by_heading - by_rate,
        heading,
        rate,
        difference + share * ((heading - rate) ** 2 - difference),
        total + share * ((heading + rate) ** 2 - total),
    )


def are_opposite(turns: Turns) -> bool:
    """Return whether heading and rate tell of turns to opposite sides."""
    return turns.difference > SENSE_SHARE * turns.sum + SENSE_LEAST


def are_consistent(turns: Turns) -> bool:
    """Return whether they tell of turns to the same side: where the boat hardly turns neither holds."""
    return turns.sum > SENSE_SHARE * turns.difference + SENSE_LEAST


class Held(NamedTuple):
    """How far the headings are off from what the rate of turn carries on, by a jump that it does not show.

    offset [rad]: they are further than the boat by so much; usual and at_once [rad^2]: the mean squares of the
    innovation, and of its change from one heading to the next, over the time `known` [s]. While it is not known whether
    it is a jump: onset [s], nan otherwise, the offset `before`, and how far it still `moved` in the second half [rad],
    or, beside no rate that is believed, since; is_sudden: no boat turns so far at once. is_turn: the heading turns on
    and the rate does not, until they go together again. jumped [s]: when the heading was off last, and how often in a
    row; by [rad]: the first time; is_said: whether that is an alarm. stood [s]: for how long the headings have been the
    very same: one that is repeated says nothing of what the boat does. rate [rad/s]: by how much they turned when they
    showed anything new last."""

    offset: float = 0.0
    usual: float = 0.0
    at_once: float = 0.0
    known: float = 0.0
    onset: float = math.nan
    before: float = 0.0
    moved: float = 0.0
    is_turn: bool = False
    jumped: float = -math.inf
    jumps: int = 0
    by: float = 0.0
    is_said: bool = False
    is_sudden: bool = False
    stood: float = 0.0
    rate: float = 0.0


NOT_HELD = Held()


def turning_most(turns: Turns, rate: float) -> float:
    """Return how fast [rad/s] a boat may turn whose rate of turn is `rate` [rad/s]: as it says now, or said of late.
    turns: those until then."""
    of_late, now = abs(turns.rate) / SENSE_TIME, abs(rate)
    return now if now > of_late else of_late


def off_most(rate: float, seconds: float, usual: float) -> float:
    """Return by how much [rad] a heading may be off where a boat turns by `rate` [rad/s] at most for so many `seconds`
    unseen, and it is usually off by `usual` [rad], a root mean square."""
    noise = HELD_SIGMAS * usual
    return rate * seconds + (noise if noise > HELD_LEAST else HELD_LEAST)


def usual_step(held: Held, offs: tuple[float, float], step: float, is_turn: bool) -> Held:
    """Return what is known after a heading that is off as it usually is, `offs` [rad] the innovation and its change, a
    `step` [s] after the one before."""
    off, change = offs
    usual, at_once, known, most = held.usual, held.at_once, held.known, 9.0 * HELD_LEAST * HELD_LEAST
    # a mean of all there is at first: what begins at nought takes noise for jumps
    known += step if known < HELD_USUAL_TIME else 0.0
    share = step / known if known > step else 1.0
    square, square_at_once = off * off, change * change
    usual += share * ((most if most < square else square) - usual)
    at_once += share * ((most if most < square_at_once else square_at_once) - at_once)
    return held._replace(usual=usual, at_once=at_once, known=known, is_turn=is_turn)


def begun(held: Held, off: float, time: float) -> Held:
    """Return what is held as a heading is `off` [rad] at `time` [s], and nobody knows yet whether it has jumped."""
    is_first = held.offset == 0.0 and not time - held.jumped < HELD_SAID
    jumps, by, is_said = (1, off, False) if is_first else (held.jumps + 1, held.by, held.is_said)
    held = held._replace(onset=time, before=held.offset, moved=0.0, jumped=time, jumps=jumps, by=by, is_said=is_said)
    return held._replace(is_sudden=False)


def ended(held: Held, rest: float) -> Held:
    """Return what is held where the heading has come to rest: nothing where less than `rest` [rad] is left."""
    offset = 0.0 if abs(held.offset) <= rest else held.offset
    is_said = held.is_said or held.jumps >= JUMPS or abs(held.offset - held.before) > rest
    return held._replace(offset=offset, onset=math.nan, moved=0.0, is_turn=False, is_said=is_said)


def rate_within(held: Held, quickest: float, step: float) -> float:
    """Return the rate [rad/s] by which a boat that turns by `quickest` [rad/s] at most may turn in a `step` [s]: that
    which its headings showed last, and what it can gain since, for no rudder and no push gives it its quickest turn
    sooner than in TURN_GAINED."""
    rate = abs(held.rate) + quickest * (held.stood + step) / TURN_GAINED
    return rate if rate < quickest else quickest


def has_rested(held: Held, time: float, step: float) -> bool:
    """Return whether a heading that jumped has shown since that it rests there, when it jumps again at `time` [s], a
    `step` [s] after the one before: one that trembles, or is swung, goes on at once. One that is repeated shows less.
    """
    new = JUMP_SAMPLES * (held.stood + step) + CLOCK
    return time - held.jumped > min(new, max(JUMP_SETTLED - CLOCK, JUMP_SAMPLES * step + CLOCK))


def alone_step(held: Held, turned: tuple[float, float], time: float, jump: float, quickest: float) -> Held:
    """Take a heading that is further by `turned`, (by heading [rad], in a step [s]), at `time` [s], beside no rate of
    turn that is believed; return what is held.

    By more than the boat turns at its `quickest` [rad/s] it has jumped, if it stays: no gyro bears witness. One that is
    back within HELD_SETTLES was a spike, and one that moves by more than HELD_STAYS of its jump otherwise turns, by
    hand, in a wake or in a broach, as does one that was about to; but from rest by as much as no boat turns since the
    heading showed anything new it jumps again. jump: see `held_step`.
    """
    (by_heading, step), usual = turned, math.sqrt(held.at_once)
    quickest = rate_within(held, quickest, step)
    least, turns = off_most(quickest, step, usual), abs(by_heading)
    if math.isnan(held.onset):
        if not least < turns < jump + HELD_LEAST or held.is_turn or held.known < HELD_LAG:
            # half of it is the heading's before
            return usual_step(held, (by_heading / SQRT_2, by_heading), step, turns > HELD_STAYS * least)
        return begun(held, by_heading, time)._replace(offset=held.offset + by_heading, is_sudden=True)
    by_jump, moved = held.offset - held.before, (held.moved if held.is_sudden else 0.0) + by_heading
    rest = 0.5 * off_most(0.0, 0.0, usual)
    if abs(moved) > HELD_STAYS * abs(by_jump):
        if abs(by_jump + moved) < HELD_STAYS * abs(by_jump):
            return ended(held._replace(offset=held.before), rest)
        is_sudden = jump + HELD_LEAST > turns > off_most(quickest, held.stood + step, usual)
        if is_sudden and has_rested(held, time, step):
            return jumped_again(held, by_heading, time)
        return settled(held)._replace(moved=0.0, is_turn=True, jumps=held.jumps - 1)
    held = held._replace(moved=moved, is_sudden=True)
    return ended(held, rest) if time - held.onset >= HELD_SETTLES else held


class Off(NamedTuple):
    """How far a heading is off from what the rate of turn beside it carries on, `step` [s] after the one before.

    off [rad]: the innovation against the rate's own reckoning, which forgets in SENSE_TIME, and `at_once`: its change.
    limit and once [rad]: by no more of either is it off by noise and lag; sudden [rad]: by more than this no boat turns
    since the headings showed anything new; ours [rad]: what is further ends steering, and is not held.
    """

    time: float
    step: float
    off: float
    at_once: float
    limit: float
    once: float
    sudden: float
    ours: float


Looked = tuple[Held, float, float]
"""What is held after a heading; by how much [rad] of its turn the boat has not turned; and what was held until now, and
is a turn, or noise, after all [rad]."""


def held_step(
    held: Held, turns: Turns, turned: tuple[float, float, float], at: tuple[float, float], most: tuple[float, float]
) -> tuple[Held, Turns]:
    """Take a heading that is further by `turned`, (by heading, by rate [rad], in a step [s]), at (time [s], rate
    [rad/s]); return what is held, and the turns without the jump.

    It is known what the heading does, or it is looked at for HELD_SETTLES, or it turns and the rate does not, until
    they go together again. most: by more than its first [rad] at once it is none of ours, that ends steering; its
    second is the boat's quickest turn [rad/s].
    """
    (by_heading, by_rate, step), (time, rate), (jump, quickest) = turned, at, most
    after, usual, change = turns_step(turns, by_heading, by_rate, step), math.sqrt(held.usual), math.sqrt(held.at_once)
    lasted, turning = held.stood + step, turning_most(turns, rate)
    seen = Off(
        time,
        step,
        after.heading - after.rate,
        by_heading - by_rate,
        # a compass lags, and a rate stands for all of its step
        off_most(turning, HELD_LAG + lasted, usual),
        off_most(turning, lasted + lasted, change),
        off_most(rate_within(held, quickest, step), lasted, change),
        jump + HELD_LEAST,
    )
    if is_looked_at(held):
        held, by, back = looking_step(held, seen)
    elif held.is_turn:
        goes_on = abs(seen.off) > HELD_RESTS * seen.limit
        held, by, back = usual_step(held, (seen.off, seen.at_once), step, goes_on), 0.0, 0.0
    else:
        held, by, back = known_step(held, seen)
    after = turns_step(turns, by_heading - by, by_rate, step) if by else after
    return held, after._replace(apart=after.apart + back, heading=after.heading + back) if back else after


def known_step(held: Held, seen: Off) -> Looked:
    """Take a heading while it is known what the headings do. One that is off further than by noise and lag, or changes
    by more at once, is looked at; one that was held to have jumped, and goes on to the same side soon, turns, unless it
    does so from rest and as suddenly as no boat does."""
    time, step, off, at_once, limit, once, sudden, ours = seen
    size, size_at_once = abs(off), abs(at_once)
    goes_on = held.offset * off > 0.0 and size > HELD_RESTS * limit and time - held.jumped < TURN_SHOWS
    if goes_on and size_at_once > sudden and abs(off - at_once) <= HELD_RESTS * limit:
        goes_on = not has_rested(held, time, step)
    is_off = size > limit or goes_on
    if not (is_off or size_at_once > once) or size >= ours or held.known < HELD_LAG:
        return usual_step(held, (off, at_once), step, size > limit), 0.0, 0.0
    by = off if is_off else at_once
    begins = begun(held, by, time)
    if goes_on:
        return turning(begins._replace(before=0.0)), 0.0, held.offset
    if abs(by) >= ours:
        return turning(begins), 0.0, 0.0
    return begins._replace(offset=held.offset + by, is_sudden=size_at_once > sudden), by, 0.0


def looking_step(held: Held, seen: Off) -> Looked:
    """Take a heading while the headings are looked at, and the rate alone carries on. One that has come to rest after
    HELD_SETTLES has jumped, one that is back was a spike, one that moves on from rest by what no boat turns at once has
    jumped again, and one that moves on otherwise turns, and the rate does not."""
    by, before, since = seen.at_once, held.before, seen.time - held.onset
    offset, is_late = held.offset + by, since > 0.5 * HELD_SETTLES
    # half of what noise alone allows
    rest, is_over = 0.5 * off_most(0.0, 0.0, math.sqrt(held.usual)), since >= HELD_SETTLES
    if seen.ours > abs(by) > seen.sudden:
        rests = is_late and abs(held.moved) <= HELD_RESTS * seen.limit and has_rested(held, seen.time, seen.step)
        if abs(offset - before) >= seen.ours or (rests and abs(offset - before) > rest):
            return jumped_again(held, by, seen.time), by, 0.0
        held = held._replace(jumped=seen.time)
    moved = held.moved + (by if is_late else 0.0)
    is_back = abs(offset) <= rest
    if (is_over and not is_back and abs(moved) > HELD_RESTS * seen.limit) or abs(offset - before) >= seen.ours:
        return turning(held), 0.0, held.offset - before
    held = held._replace(offset=offset, moved=moved)
    # what is left of a spike is the noise of one heading
    return (ended(held, rest), by, offset if is_back else 0.0) if is_over else (held, by, 0.0)


def turning(held: Held) -> Held:
    """Return what is held where the heading turned, and did not jump."""
    return held._replace(offset=held.before, onset=math.nan, moved=0.0, is_turn=True)


def turn_shown(held: Held, turns: Turns, unseen: float) -> tuple[Held, Turns]:
    """Return what is held, and the turns, after a rate that comes so much later than the one before it, and differs so
    much, that the boat may have turned by `unseen` [rad] in between: what is as much and may have been a jump was none.
    """
    by_jump = held.offset - held.before
    if math.isnan(held.onset) or by_jump * unseen <= 0.0 or abs(by_jump) > abs(unseen):
        return held, turns
    turns = turns._replace(apart=turns.apart + by_jump, heading=turns.heading + by_jump)
    return settled(held)._replace(is_turn=True, jumps=held.jumps - 1), turns


def is_looked_at(held: Held) -> bool:
    """Return whether it is not known yet what a heading that is off has done: jumped, turned, or been a spike."""
    return held.onset == held.onset  # what is no number is not itself


def jumped_again(held: Held, by: float, time: float) -> Held:
    """Return what is held as a heading that had jumped, and come to rest, is off `by` as much again [rad] at `time`."""
    again = begun(held, by, time)
    # one that jumps on and on never comes to rest
    return again._replace(offset=held.offset + by, is_sudden=True, is_said=again.is_said or again.jumps >= JUMPS)


def settled(held: Held) -> Held:
    """Return what is held without what may have been a spike."""
    return held if math.isnan(held.onset) else held._replace(offset=held.before, onset=math.nan)


def followed(held: Held, now: float, dt: float, is_ours: bool) -> tuple[Held, float]:
    """Return what is still held at `now` [s], `dt` after the last time, and by how much [rad] the compass is followed:
    slowly, once it has stayed where it jumped to for as long as an alarm waits for somebody before it grows louder; at
    once where nobody is steered by us."""
    offset = held.offset
    if not math.isnan(held.onset) or (is_ours and now - held.jumped < ESCALATES_AFTER):
        return held, 0.0
    most = HELD_FOLLOWS * dt if is_ours else math.inf
    turn = clip(offset, -most, most)
    return held._replace(offset=offset - turn), turn


def held_events(held: Held, now: float) -> tuple[AlarmEvent, ...]:
    """Return the alarm of a compass that has jumped, while it is held and for HELD_SAID."""
    if not held.is_said or (held.offset == 0.0 and now - held.jumped >= HELD_SAID):
        return ()
    by = math.degrees(held.by)
    detail = f"by {by:+.0f} deg" if held.jumps < JUMPS else f"to and fro by {abs(by):.0f} deg"
    return (AlarmEvent("compass_jumped", detail),)


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
