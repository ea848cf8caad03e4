"""The compass watch: a heading that stands still, jumps, or does not go together with the rate of turn or the model.

Rate-heading consistency: what heading and rate of turn tell of the boat's turns, how far they are apart, and whether
they go opposite ways. Its functions are scalar, over NamedTuples, and compiled by `sitl.compiled` as they are. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, shortest_turn, wrap
from autopilot.estimation.tuning import WAVE_MEMORY
from autopilot.models.norrbin import rate_step
from autopilot.models.steering_gear import clip
from autopilot.signals import AlarmEvent, HeadingSample, RateSample
from autopilot.supervision.monitor_input import AlarmLimits, Measured, MonitorInput
from autopilot.supervision.panel import ESCALATES_AFTER
from autopilot.supervision.tuning import (
    APART_TIME,
    DISAGREES_LASTS,
    DISAGREES_SAID,
    FINE_DIGIT,
    FINE_DIGITS,
    FINE_SAME,
    FROZEN_BEFORE,
    FROZEN_BY_RATE,
    FROZEN_BY_RUDDER,
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
    INNOVATION_TIME,
    JUMP_SAID,
    JUMP_SAMPLES,
    JUMP_SETTLED,
    JUMPS,
    JUMPS_WITHIN,
    NEWS,
    NOUGHT_FORGOTTEN,
    RATE_FORGOTTEN,
    RATE_LAG,
    RATE_OFF,
    RATE_RIGHT,
    SEA_DIGITS,
    SEA_FELT,
    SEA_PROVEN,
    SEA_STOOD,
    SENSE_LASTS,
    SENSE_LEAST,
    SENSE_SHARE,
    SENSE_TIME,
    TREMBLES_DIGITS,
    TREMBLES_LEAST,
    TREMBLES_SAME,
    TREMBLES_SIGMAS,
    TREMBLES_TIME,
    WILD_RATES,
)

OPPOSITE_WAYS = "they turn opposite ways"
STANDS_STILL = "the rate stands still"
LONGEST_STEP_S = 0.5
SQRT_2 = math.sqrt(2.0)
FLOAT_DIGIT = 2.0**-22
"""[rad]: of a float of 32 bits near pi."""
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


class Still(NamedTuple):
    """A rate that is the same to the last digit: turn [rad]: how much further the heading went meanwhile, of late;
    since [s]: when that became too much, nan: it is not, and the `rates` that have said the same since; is_dead: until
    it moves."""

    rates: int = 0
    turn: float = 0.0
    since: float = math.nan
    is_dead: bool = False


MOVES = Still()


class Held(NamedTuple):
    """How far the headings are off from what the rate of turn carries on, by a jump that it does not show.

    offset [rad]: they are further than the boat by so much; usual and at_once [rad^2]: the mean squares of the
    innovation, and of its change from one heading to the next, over the time `known` [s]. While it is not known whether
    it is a jump: onset [s], nan otherwise, the offset `before`, and how far it still `moved` in the second half [rad],
    or, beside no rate that is believed, since; is_sudden: no boat turns so far at once. is_turn: the heading turns on
    and the rate does not, until they go together again. jumped [s]: when the heading was off last, and how often in a
    row; by [rad]: the first time; is_said: whether that is an alarm. stood [s]: for how long the headings have been the
    very same: one that is repeated says nothing of what the boat does."""

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


NOT_HELD = Held()


def unturned_most(turns: Turns, rate: float, step: float, usual: float, lag: float) -> float:
    """Return by how much [rad] a heading may be off from the one that the rate of turn carries on, a `step` [s] after
    the one before: by noise, `usual` [rad] as a root mean square, by a `lag` [s] of the compass, and because a rate
    stands for all of its step. turns: those until then."""
    of_late, noise = abs(turns.rate) / SENSE_TIME, HELD_SIGMAS * usual
    rate = abs(rate)
    most = (lag + step) * (rate if rate > of_late else of_late)
    return most + (noise if noise > HELD_LEAST else HELD_LEAST)


def usual_step(held: Held, offs: tuple[float, float], step: float, is_turn: bool) -> Held:
    """Return what is known after a heading that is off as it usually is, `offs` [rad] the innovation and its change, a
    `step` [s] after the one before."""
    off, change = offs
    usual, at_once, known, most = held.usual, held.at_once, held.known, 9.0 * HELD_LEAST * HELD_LEAST
    # a mean of all there is at first: what begins at nought takes noise for jumps
    known += step if known < HELD_USUAL_TIME else 0.0
    share = step / known if known > step else 1.0
    usual += share * (min(off * off, most) - usual)
    at_once += share * (min(change * change, most) - at_once)
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


def sudden_most(quickest: float, step: float, usual: float) -> float:
    """Return by how much [rad] a heading may be off at once, a `step` [s] after the one before, in a boat that turns by
    `quickest` [rad/s] at most, where it is usually off by `usual` [rad], a root mean square."""
    noise = HELD_SIGMAS * usual
    return quickest * step + (noise if noise > HELD_LEAST else HELD_LEAST)


def has_rested(held: Held, time: float, step: float) -> bool:
    """Return whether a heading that jumped has shown since that it rests there, when it jumps again at `time` [s], a
    `step` [s] after the one before: one that trembles, or is swung, goes on at once."""
    return time - held.jumped > max(JUMP_SETTLED - CLOCK, JUMP_SAMPLES * step + CLOCK)


def alone_step(held: Held, turned: tuple[float, float], time: float, jump: float, quickest: float) -> Held:
    """Take a heading that is further by `turned`, (by heading [rad], in a step [s]), at `time` [s], beside no rate of
    turn that is believed; return what is held.

    By more than the boat turns at its `quickest` [rad/s] it has jumped, if it stays: no gyro bears witness. One that is
    back within HELD_SETTLES was a spike, and one that moves by more than HELD_STAYS of its jump otherwise turns, by
    hand, in a wake or in a broach, as does one that was about to; but from rest by as much as no boat turns since the
    heading showed anything new it jumps again. jump: see `held_step`.
    """
    (by_heading, step), usual = turned, math.sqrt(held.at_once)
    least, turns = sudden_most(quickest, step, usual), abs(by_heading)
    if math.isnan(held.onset):
        if not least < turns < jump + HELD_LEAST or held.is_turn or held.known < HELD_LAG:
            # half of it is the heading's before
            return usual_step(held, (by_heading / SQRT_2, by_heading), step, turns > HELD_STAYS * least)
        return begun(held, by_heading, time)._replace(offset=held.offset + by_heading, is_sudden=True)
    by_jump, moved = held.offset - held.before, (held.moved if held.is_sudden else 0.0) + by_heading
    rest = 0.5 * sudden_most(0.0, 0.0, usual)
    if abs(moved) > HELD_STAYS * abs(by_jump):
        if abs(by_jump + moved) < HELD_STAYS * abs(by_jump):
            return ended(held._replace(offset=held.before), rest)
        is_sudden = jump + HELD_LEAST > turns > sudden_most(quickest, held.stood + step, usual)
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
    lasted = held.stood + step
    seen = Off(
        time,
        step,
        after.heading - after.rate,
        by_heading - by_rate,
        unturned_most(turns, rate, lasted, usual, HELD_LAG),
        unturned_most(turns, rate, lasted, change, lasted),
        sudden_most(quickest, lasted, change),
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
    goes_on = held.offset * off > 0.0 and abs(off) > HELD_RESTS * limit and time - held.jumped < TURN_SHOWS
    if goes_on and abs(at_once) > sudden and abs(off - at_once) <= HELD_RESTS * limit:
        goes_on = not has_rested(held, time, step)
    is_off = abs(off) > limit or goes_on
    if not (is_off or abs(at_once) > once) or abs(off) >= ours or held.known < HELD_LAG:
        return usual_step(held, (off, at_once), step, abs(off) > limit), 0.0, 0.0
    by = off if is_off else at_once
    begins = begun(held, by, time)
    if goes_on:
        return turning(begins._replace(before=0.0)), 0.0, held.offset
    if abs(by) >= ours:
        return turning(begins), 0.0, 0.0
    return begins._replace(offset=held.offset + by, is_sudden=abs(at_once) > sudden), by, 0.0


def looking_step(held: Held, seen: Off) -> Looked:
    """Take a heading while the headings are looked at, and the rate alone carries on. One that has come to rest after
    HELD_SETTLES has jumped, one that is back was a spike, one that moves on from rest by what no boat turns at once has
    jumped again, and one that moves on otherwise turns, and the rate does not."""
    by, before, since = seen.at_once, held.before, seen.time - held.onset
    offset, is_late = held.offset + by, since > 0.5 * HELD_SETTLES
    # half of what noise alone allows
    rest, is_over = 0.5 * sudden_most(0.0, 0.0, math.sqrt(held.usual)), since >= HELD_SETTLES
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
    return not math.isnan(held.onset)


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


def still_step(still: Still, time: float, turn: float, step: float) -> Still:
    """Return what is known at `time` [s] of a rate that stands, the heading having turned by `turn` [rad] more than it
    says in a `step` [s]."""
    rates, before, since, is_dead = still
    turn += before * math.exp(-step / APART_TIME)
    if abs(turn) <= FROZEN_BY_RATE:
        return Still(0, turn, math.nan, is_dead)
    since = time if math.isnan(since) else since
    return Still(rates, turn, since, is_dead or (rates >= FROZEN_RATES and time - since >= DISAGREES_LASTS))


class Consistency(NamedTuple):
    """heading and rate: the newest of each; turns: what they tell; since [s]: when the turns began to differ, nan: they
    do not; seen [s]: when that was found last; reported [rad]: how far apart they were when it was said; found: what is
    said, '' where they go together; is_refused: whether it is the rate that is wrong: they turn opposite ways, it
    stands still, or no boat like this turns so; wild [s]: when rates came of late that are beyond what a boat like this
    turns by; still: what is known of a rate that stands; held: of headings that jumped, and the boat did not turn."""

    heading: HeadingSample | None = None
    rate: RateSample | None = None
    turns: Turns = NO_TURNS
    since: float = math.nan
    seen: float = math.nan
    reported: float = math.nan
    found: str = ""
    is_refused: bool = False
    wild: tuple[float, ...] = ()
    still: Still = MOVES
    held: Held = NOT_HELD


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
    return (held if held.stood == stood else held._replace(stood=stood)), turns


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
    # a sum is finite only where every part of it is
    parts = time if isinstance(sample, RateSample) else time + sample.heading
    if not math.isfinite(parts if rate is None else parts + rate):
        return before
    last, beside, wild = before.heading, before.rate, before.wild
    # a rate that is held for the headings beside it is one, however many they are
    if rate is not None and not -rate_most <= rate <= rate_most:
        wild = (*wild, time)[-WILD_RATES:]
    if isinstance(sample, RateSample):
        # that of the heading's own instrument goes before
        is_used = last is None or last.rate is None
        still = _repeated(before.still, rate, beside) if is_used else before.still
        if is_used and beside is not None:
            unseen = (sample.rate - beside.rate) * max(time - beside.time, 0.0)
            held, turns = turn_shown(before.held, before.turns, unseen)
            before = before._replace(held=held, turns=turns)
        return before._replace(rate=sample, wild=wild if is_used else before.wild, still=still)
    still = before.still if rate is None else _repeated(before.still, rate, last)
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
    before = before._replace(still=still_step(still, time, clip(by, -most_turn, most_turn), step) if turn else still)
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


def _repeated(still: Still, rate: float | None, last: HeadingSample | RateSample | None) -> Still:
    """Take a rate [rad/s] that comes behind the `last`."""
    return still._replace(rates=still.rates + 1) if last is not None and rate == last.rate else MOVES


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
    (sample, turns, wild), (_, beside, _, since, seen, reported, found, was_refused, _, still, held) = news, before
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
    return Consistency(sample, beside, turns, since, seen, reported, found, is_refused, wild, still, held)


class Standing(NamedTuple):
    """A heading that is the same to the last digit: the `samples` that say so, the first of them [s] and the last; the
    turn that the rate beside it adds up to [rad], nan where none came, and its span; last_rate: that rate the time
    before, nan where none was, and whether it has moved since the model's turn was reckoned; that turn, which the model
    makes of the rudder while the rate stands: when it was reckoned last [s], the bias [rad], the rate [rad/s], and how
    far it has turned [rad]; is_frozen: until it moves again; source: whose heading it is; off [rad]: how far it was
    from the boat's as that was estimated when it began to stand, and unknown [rad^2]: the variance of that; steered:
    the rate [rad/s] and the turn [rad] that the rudder has made since of a boat that lay on its course; quickest
    [rad/s]: of late, by the rate beside it and by the model, and beyond [s]: since when either turn is more than its
    limit, nan: it is not."""

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


class Sea(NamedTuple):
    """What moves the heading: by this standard deviation [rad] when it began to stand, felt on a course that is held
    since flat water [s]; digit [rad]: the least step of the compass. watched [s]: for how long it had been learnt.
    kept [rad]: the deviation that was known when it was forgotten, until it is known anew. change [rad]: the newest
    step; noise [rad^2]: the variance of the compass's own noise, see `trembling`; same: the share of headings that are
    the same as the one before."""

    digit: float = math.inf
    deviation: float = math.nan
    flat: float = math.nan
    watched: float = 0.0
    kept: float = 0.0
    change: float = 0.0
    noise: float = 0.0
    same: float = 1.0


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
    same = fades * (1.0 - (1.0 - sea.same) * math.exp(-stood / TREMBLES_TIME))
    return sea._replace(digit=digit, change=change, noise=noise, same=same)


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
    return Sea(sea.digit, deviation, now if is_flat else sea.flat, watched, kept, sea.change, sea.noise, sea.same)


def never_stands(standing: Standing, sea: Sea, seen: MonitorInput) -> bool:
    """Return whether a compass shows something new each time in a boat that has way, whatever the water is: its own
    noise moved it by its digits, or these are so small that no boat keeps within one, and from one heading to the next
    it moved by many.

    Noise ends with an engine, and a boat may lie within a digit: then the compass shows the heading that it had, as far
    as that is known, and the rudder has not turned it since.
    """
    digit = sea.digit if sea.digit > FLOAT_DIGIT else FLOAT_DIGIT
    if not seen.has_way or sea.same > TREMBLES_SAME:
        return False
    if digit <= FINE_DIGIT and sea.same <= FINE_SAME and abs(sea.change) >= FINE_DIGITS * digit:
        return True
    is_off = abs(standing.off - standing.steered[1]) > digit + TREMBLES_SIGMAS * math.sqrt(max(standing.unknown, 0.0))
    return is_off and sea.noise >= TREMBLES_DIGITS * TREMBLES_DIGITS * digit * digit


def was_moved(standing: Standing, sea: Sea) -> bool:
    """Return whether it was a sea that moved the heading until it stood."""
    is_felt = sea.deviation >= max(SEA_FELT, SEA_DIGITS * sea.digit)
    return is_felt and standing.since - sea.flat >= SEA_PROVEN


def stood_by(before: Standing, sample: HeadingSample) -> Standing:
    """Take a heading that is the same as the one before it."""
    time, turn_rate = before.time, sample.rate
    if turn_rate is None or not math.isfinite(time):
        return before._replace(samples=before.samples + 1, time=sample.time)
    step = clip(sample.time - time, 0.0, LONGEST_STEP_S)
    moves = before.rate_moves or not (math.isnan(before.last_rate) or turn_rate == before.last_rate)
    # what is long past may be the bias of the rate sensor, added up
    turn = (0.0 if math.isnan(before.turn) else before.turn) * math.exp(-step / RATE_FORGOTTEN) + turn_rate * step
    return before._replace(
        samples=before.samples + 1,
        time=sample.time,
        turn=turn,
        low=min(before.low, turn),
        high=max(before.high, turn),
        quickest=(quicker(before.quickest[0], turn_rate, step), before.quickest[1]),
        last_rate=turn_rate,
        rate_moves=moves,
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
            standing = stood_by(standing, sample)
            continue
        else:
            change = heading - standing.heading
            change = change if -PI < change <= PI else wrap(change)
            sea = trembling(sea, change, time - standing.time, standing.time - standing.since)
        since = Standing(heading, 1, time, time, math.nan, 0.0, 0.0, math.nan, False, now, state.bias, state.rate)
        off = heading - state.heading + state.rate * (now - time)
        standing = since._replace(source=sample.source, off=wrap(off), unknown=seen.unknown)
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


def jumping_step(before: Jumping, sample: HeadingSample, rate: float, most: float) -> Jumping:
    """Take a heading; it may be off by `most` [rad] from the one before, the boat turning at `rate` [rad/s]."""
    time, heading, _, source = sample
    if not math.isfinite(heading + time):
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
    if -most <= off <= most:
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


def update(
    limits: AlarmLimits, before: State, seen: MonitorInput, measured: Measured
) -> tuple[State, tuple[AlarmEvent, ...]]:
    """Judge a tick; return what is remembered, and what is found."""
    standing, sea, jumping, rate, off_since, off_by, rate_off = before
    found: tuple[AlarmEvent, ...] = ()
    if limits.frozen_heading:
        standing, sea = frozen_step(standing, sea, seen, measured.headings)
        if standing.is_frozen:
            found = (AlarmEvent("heading_frozen"),)
    for sample in measured.headings:
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
    rate = state.rate if math.isfinite(state.rate) else 0.0
    return State(standing, sea, jumping, rate, off_since, off_by, rate_off), found
