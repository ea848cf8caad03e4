"""A heading that jumps while the boat does not turn: beside a rate of turn, and beside none.

What heading and rate of turn tell of the boat's turns is compared. A heading that is off at once by more than noise and
lag explain, and stays so, has jumped: the boat is carried on by its rate of turn, and the jump is held. Its functions
are scalar, over NamedTuples, and compiled by `sitl.compiled` as they are. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, shortest_turn, wrap
from autopilot.models.steering_gear import clip
from autopilot.signals import AlarmEvent, HeadingSample
from autopilot.supervision.panel import ESCALATES_AFTER
from autopilot.supervision.tuning import (
    APART_TIME,
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
    JUMP_UNSHOWN,
    JUMPS,
    JUMPS_WITHIN,
    SENSE_LASTS,
    SENSE_LEAST,
    SENSE_SHARE,
    SENSE_TIME,
    TURN_GAINED,
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
