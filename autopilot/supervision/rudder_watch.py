"""The rudder watch: a rudder that does not move, does not follow, moves the wrong way, or is not enough.

By its sensor and the order that the steering gear reports, and by a boat that turns against it (`rudder_following`),
and by the answer of the boat (`rudder_response`). What it finds of boat, rudder and speed counts until we let go. Pure.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.estimation.disturbance import slide_step
from autopilot.signals import AlarmEvent, HeadingSample
from autopilot.supervision.monitor_input import (
    AlarmLimits,
    Measured,
    MonitorInput,
    reads_low,
    speed_ratio,
)
from autopilot.supervision.response_filter import (
    NO_SEAWAY,
    SEA_KNOWN_S,
    Seaway,
    changing_noise,
    counts_as_course,
    seaway_noise,
    seaway_step,
)
from autopilot.supervision.rudder_following import (
    NO_RUNAWAY,
    NOT_OVERPOWERED,
    Following,
    History,
    Overpowered,
    Runaway,
    followed,
    is_anothers,
    overpowered_step,
    runaway_step,
)
from autopilot.supervision.rudder_response import (
    FILED,
    LIVELIER,
    NO_RESPONSE,
    NOTHING_ADDED,
    QUICKER,
    SLOW_RUDDER,
    ResponseState,
    Three,
    acquitted,
    carried_on,
    enough,
    first_response,
    is_doubtful,
    is_suspect,
    other_verdict,
    push_at_least,
    response_step,
    since_turning,
    taken_over,
    turned_verdict,
    verdict,
    without_evidence,
)
from autopilot.supervision.tuning import (
    AT_THE_STOP,
    AT_THE_STOP_TIME,
    CHANGED_TIME,
    FROZEN_SAMPLES,
    LATE_LASTS,
    LATE_S,
    LONGEST_GAP_S,
    ON_COURSE,
    PUSHED_S,
    REPORT_FRESH_S,
    SEA_FIRST,
    SEA_FIRST_TIME,
    SLOW,
    SPEED_DOUBT,
    SURE_TURNING,
    TRIAL_SAID,
    WORKED_TIME,
)

PAST_S = LATE_S + 2.0 * LONGEST_GAP_S


class Evidence(NamedTuple):
    """What the rudder-response monitor goes by, in numbers. since [s]: since when it is at work, nan: it is not;
    response: what is known; seaway: the seas met; heading [rad]: the newest, and how many `same` ones there were in a
    row; late_until [s]: until then nothing is evidence; slow [rad]: where a slow rudder would stand at slow_time [s],
    nan where that is out of question; speed [m/s]: the model's of late; worked [rad^2]: the mean square of the
    rudder on a course in a sea; carried: into a turn, see `carried_on`; added: by a turn, see `since_turning`."""

    since: float = math.nan
    response: ResponseState = NO_RESPONSE
    seaway: Seaway = NO_SEAWAY
    heading: float = math.nan
    same: int = 0
    late_until: float = -math.inf
    slow_time: float = math.nan
    slow: float = math.nan
    speed: float = math.nan
    slide: float = 0.0
    worked: float = 0.0
    carried: float = 0.0
    added: Three = NOTHING_ADDED


NOTHING_KNOWN = Evidence()


def evidence_step(
    before: Evidence,
    limits: AlarmLimits,
    seen: MonitorInput,
    measured: tuple[float, float],
    rudders: tuple[float, float],
) -> Evidence:
    """Return what is known after a tick and a heading [rad] `measured` at its time [s], not numbers where none came.
    rudders [rad]: half way from the heading before to this one, and `LATE_S` earlier. Compiled as it is."""
    (
        since, response, seaway, last, same, late_until, slow_time, slow, speed, slide, worked, carried, added,
    ) = before  # fmt: skip
    (time, heading), state, now, model = measured, seen.state, seen.now, seen.model
    since = since if since == since else now  # what is no number is not itself
    late_until = now + LATE_LASTS if seen.is_late else late_until
    if seen.rudder_is_measured or not math.isfinite(limits.rudder_rate):
        slow_time, slow = math.nan, math.nan
    elif slow_time != slow_time:
        slow_time, slow = now, state.rudder
    else:
        reach, left = limits.rudder_rate / SLOW * (now - slow_time if now > slow_time else 0.0), seen.rudder - slow
        slow_time, slow = now, slow + (-reach if left < -reach else reach if left > reach else left)
    if heading != heading:
        return Evidence(
            since, response, seaway, last, same, late_until, slow_time, slow, speed, slide, worked, carried, added
        )
    seaway = seaway_step(seaway, now, state.heading, state.wave_deviation)
    # in a turn the order moves the rudder, and not the sea
    unmet = SEA_FIRST * math.exp(-(now - seaway.begun) / SEA_FIRST_TIME) if seen.holds_course else 0.0
    noise = seaway_noise(model, limits.heading_noise, state, seaway, worked, unmet)
    same = same + 1 if last == heading else 1
    if same >= FROZEN_SAMPLES:
        return Evidence(
            since, NO_RESPONSE, seaway, heading, same, late_until, slow_time, slow, speed, slide, worked, carried,
            NOTHING_ADDED,
        )  # fmt: skip
    known = response.time
    # written so that it holds where nothing is known
    if not time - known <= LONGEST_GAP_S:
        response, last, speed = first_response(noise, time, heading), heading, model.reference_speed
        added = NOTHING_ADDED
    elif time > known:
        fastest, rate, in_time = 2.0 * model.gain * seen.angle_max, state.rate, rudders[0]
        rate = -fastest if rate < -fastest else fastest if rate > fastest else rate
        speed -= math.expm1(-(time - known) / CHANGED_TIME) * (model.reference_speed - speed)
        slide = slide_step(model, slide, rate, seen.angle_max, time - known)
        is_usual = not is_suspect(response.stuck, response.reversed, response.blocks)
        # a boat that is far off does not answer, or is turned: that is no work against waves
        off = state.heading - seen.wanted
        is_near = abs(off if -PI < off <= PI else wrap(off)) < ON_COURSE
        if seen.holds_course and is_near and is_usual and state.wave_deviation > 0.0:
            off = in_time + state.bias
            worked -= math.expm1(-(time - known) / WORKED_TIME) * (off * off - worked)
        noise = changing_noise(model, noise, rate, speed)
        at = in_time, rudders[1], slow if slow == slow else in_time, slide, seen.weaker
        after = response_step(response, model, noise, rate, (time, heading), at)
        response, last = after if time > late_until else without_evidence(response, after), heading
        as_course = counts_as_course(seaway, now, seen.holds_course)
        carried = carried_on(carried, response, as_course, time - known)
        added = since_turning(added, response, seen.follows and not seen.holds_course)
    return Evidence(
        since, response, seaway, last, same, late_until, slow_time, slow, speed, slide, worked, carried, added
    )


def verdict_at(evidence: Evidence, now: float, holds_course: bool) -> int:
    """Return the `verdict` at `now` [s]: as long as the sea is not known a turn that the boat has answered to is no
    evidence, whatever has come since."""
    response, added = evidence.response, evidence.added
    found = turned_verdict(response, added)
    as_course = counts_as_course(evidence.seaway, now, holds_course)
    if found != 0 or (as_course and not holds_course and (added[0] <= 0.0 or added[1] <= 0.0 or added[2] <= 0.0)):
        return found
    return verdict(response, enough(evidence.carried, as_course))


class Response(NamedTuple):
    """The rudder-response monitor at work. evidence: what it goes by; source: of the newest heading; held_off_since
    [s]: a trial's push holds against its rudder; doubted_trial: that has been said of this trial, and doubts_trial: in
    this tick; other: see `other_verdict`; verdict: see `verdict`."""

    evidence: Evidence = NOTHING_KNOWN
    source: str = ""
    held_off_since: float = math.nan
    doubted_trial: bool = False
    doubts_trial: bool = False
    other: int = FILED
    verdict: int = 0

    def but_the_sea(self, seen: MonitorInput) -> Response:
        """Return nothing but since when the sea is estimated, which goes on where the boat's answers prove nothing."""
        begun = self.evidence.seaway.begun
        begun = begun if begun == begun else seen.now
        return (
            Response(NOTHING_KNOWN._replace(seaway=NO_SEAWAY._replace(begun=begun))) if seen.state.valid else UNJUDGED
        )


def judge_response(
    before: Response, limits: AlarmLimits, seen: MonitorInput, headings: tuple[HeadingSample, ...], history: History
) -> Response:
    """Return what is known after a tick; the history has this tick, too."""
    state, now = seen.state, seen.now
    # a sum is finite only where every part of it is
    if not (seen.steers and seen.has_way and math.isfinite(state.rate + state.rudder)):
        return before.but_the_sea(seen)
    evidence, source, held_off_since, doubted_trial, _, _, _ = before
    evidence, source, earliest = _with_headings(evidence, source, limits, seen, headings, history)
    response = evidence.response
    # where waves are not estimated, what they do to boat and rudder together looks like a strong rudder
    other = other_verdict(response.others) if state.wave_deviation > 0.0 else FILED
    found = verdict_at(evidence, now, seen.holds_course)
    if seen.follows:
        return Response(evidence, source, math.nan, False, False, other, found)
    is_known = not math.isnan(response.time)
    is_held_off = is_known and now - evidence.since >= SEA_KNOWN_S and _is_held_off(response, seen, history, earliest)
    held_off_since = (now if math.isnan(held_off_since) else held_off_since) if is_held_off else math.nan
    is_doubted = is_doubtful(response) or now - held_off_since >= PUSHED_S
    if not is_known or doubted_trial or not is_doubted:
        return Response(evidence, source, held_off_since, doubted_trial, False, other, found)
    return Response(evidence._replace(response=acquitted(response)), source, held_off_since, True, True, other)


def listened(
    before: Response, limits: AlarmLimits, seen: MonitorInput, measured: Measured, history: History
) -> Response:
    """Return what is known after a tick in which somebody else steers, with a rudder that is measured or reported: how
    the boat turns, what pushes it, and the sea. All of it was so before our first order, and is no evidence."""
    known, report = before.but_the_sea(seen), measured.report
    is_shown = seen.rudder_is_measured or (report is not None and seen.now - report.time <= REPORT_FRESH_S)
    if not (limits.rudder_response and is_shown and seen.has_way and math.isfinite(seen.state.rate)):
        return known
    evidence, source, _ = _with_headings(before.evidence, before.source, limits, seen, measured.headings, history)
    if math.isnan(evidence.response.time):
        return known
    kept = known.evidence._replace(
        response=taken_over(evidence.response),
        heading=evidence.heading,
        same=evidence.same,
        speed=evidence.speed,
        slide=evidence.slide,
    )
    return Response(kept, source)


def _with_headings(
    evidence: Evidence,
    source: str,
    limits: AlarmLimits,
    seen: MonitorInput,
    headings: tuple[HeadingSample, ...],
    history: History,
) -> tuple[Evidence, str, float]:
    """Return what is known after a tick's headings, their source, and the first time [s] of which the rudder counts."""
    known, now = _in_order(headings), seen.now
    if not known:
        evidence = evidence_step(evidence, limits, seen, NO_HEADING, NO_HEADING)
    since = evidence.since if evidence.since == evidence.since else now
    earliest = now - PAST_S if now - PAST_S > since else since
    for sample in known:
        if sample.source != source:
            # what another compass shows does not follow on
            evidence, source = evidence._replace(response=NO_RESPONSE), sample.source
        middle = 0.5 * (evidence.response.time + sample.time)
        rudders = rudder_at(history, earliest, middle), rudder_at(history, earliest, middle - LATE_S)
        evidence = evidence_step(evidence, limits, seen, (sample.time, sample.heading), rudders)
    return evidence, source, earliest


UNJUDGED = Response()
NO_HEADING = math.nan, math.nan


def _in_order(headings: tuple[HeadingSample, ...]) -> Sequence[HeadingSample]:
    """Return the headings that are numbers; of a burst that was read at once, and has one time, the last is the
    newest."""
    if len(headings) == 1 and math.isfinite(headings[0].heading + headings[0].time):
        return headings
    known = [each for each in headings if math.isfinite(each.heading) and math.isfinite(each.time)]
    return sorted({each.time: each for each in known}.values(), key=lambda each: each.time)


def rudder_at(history: History, earliest: float, time: float) -> float:
    """Return the rudder [rad] at `time` [s], no earlier than that: each is that of the end of its tick.

    As `rudder_observer.angle_from`, by bisection: at 100 ticks a second `LATE_S` is many of them.
    """
    times, angles, _, ticks = history
    newest, time = (ticks - 1) & (len(times) - 1), earliest if time < earliest else time
    if times[newest] < time:
        return angles[newest]
    if times[0] < time or ticks <= len(times):
        return angles[bisect_left(times, time, 0, newest + 1)]
    place = bisect_left(times, time, newest + 1)
    return angles[place if place < len(times) else 0]


def _is_held_off(response: ResponseState, seen: MonitorInput, history: History, earliest: float) -> bool:
    """Return whether a push holds against a trial's rudder, as far as that was over of late: on the way from one side
    to the other it passes amidships."""
    push, (times, angles, _, ticks) = push_at_least(response), history
    ring = len(times) - 1
    if not push * seen.rudder < 0.0:
        return False
    for tick in range(ticks - 1, max(ticks - 2 - ring, -1), -1):
        if times[tick & ring] < earliest:
            break
        if abs(push) <= abs(angles[tick & ring]):
            return False
    return True


class State(NamedTuple):
    """What the rudder watch remembers. since [s]: since when we steer; stop_since
    [s]: the rudder stands at its stop; trial_doubted [s]: when that was.

    What was found counts until we let go: other: what the answer tells of boat and rudder, see `other_verdict`;
    asks_less: the law is to order less for it; rests_roll: the rudder is too slow to work against roll too, and the
    quick orders are those: a course alone may well be held with it as it is;
    doubts_speed: the boat's own turns contradict its speed.
    """

    since: float = math.nan
    following: Following = Following()
    response: Response = UNJUDGED
    overpowered: Overpowered = NOT_OVERPOWERED
    runaway: Runaway = NO_RUNAWAY
    stop_since: float = math.nan
    trial_doubted: float = math.nan
    other: int = FILED
    asks_less: bool = False
    rests_roll: bool = False
    doubts_speed: bool = False

    def with_doubted_speed(self) -> State:
        """Return the state where the speed is doubted: the model is the trial's from the next tick on, and what was
        seen is weighed anew by that."""
        return self._replace(doubts_speed=True, response=UNJUDGED)


def update(
    limits: AlarmLimits, before: State, seen: MonitorInput, measured: Measured, history: History
) -> tuple[State, tuple[AlarmEvent, ...]]:
    """Judge a tick, with the rudder's `history` until now; return what is remembered, and what is found."""
    if not seen.steers:
        # what is done by others proves nothing; what a line holds it still does
        following = Following(line=before.following.line)
        response = listened(before.response, limits, seen, measured, history)
        return State(following=following, response=response, trial_doubted=before.trial_doubted), ()
    since, following, response, overpowered, runaway, stop_since, doubted, other, _, rests, doubts = before
    now = seen.now
    since = since if since == since else now
    if seen.is_late:
        following = following._replace(late_until=now + LATE_LASTS)
    if measured.angles:
        following = followed(following, limits, measured.angles, history, since)
    if following.name or seen.waits or not limits.rudder_response or is_anothers(history, now, measured.report):
        # a rudder that waits for way proves nothing, nor does a boat that follows somebody else; the link finds out who
        # has the helm
        response, overpowered = response.but_the_sea(seen), NOT_OVERPOWERED
    else:
        response = judge_response(response, limits, seen, measured.headings, history)
        if since <= doubted and now - doubted < TRIAL_SAID and not response.verdict:
            # the trial's end moves the rudder as an order does, and against a push that is no sea
            response = response._replace(verdict=verdict(response.evidence.response, SURE_TURNING))
        if (response.other or response.verdict) and _is_for_the_speed(response, seen):
            response, doubts = response.but_the_sea(seen), True
        is_held = -seen.angle_max <= seen.push <= seen.angle_max
        overpowered = NOT_OVERPOWERED if is_held else overpowered_step(overpowered, seen)
        doubted = now if response.doubts_trial else doubted
    runaway = runaway_step(runaway, seen)
    stop = AT_THE_STOP * seen.angle_max
    if not seen.holds_course or -stop < seen.rudder < stop:
        stop_since = math.nan
    elif math.isnan(stop_since):
        stop_since = now
    asks_less = False
    if other or response.other or following.is_slow:
        news = (other, response.other, SLOW_RUDDER if following.is_slow else FILED)
        other = min(each for each in news if each != FILED)
        rests = rests or (other == SLOW_RUDDER and seen.damps_roll and seen.model.n1 > 0.0)
        # where the rate is known turns are planned with it, and no law need be softer
        slow = other == SLOW_RUDDER and not (seen.rudder_is_slow or following.is_slow)
        asks_less = other == LIVELIER or (slow and not rests and seen.model.n1 > 0.0)
    after = State(
        since, following, response, overpowered, runaway, stop_since, doubted, other, asks_less, rests, doubts
    )
    return after, _findings(after, seen)


VERDICTS = {
    1: AlarmEvent("rudder_stuck", "the boat does not answer to it"),
    -1: AlarmEvent("rudder_reversed", "the boat answers to the opposite rudder"),
}
OTHERS = {
    QUICKER: AlarmEvent("too_quick"),
    SLOW_RUDDER: AlarmEvent("rudder_slow"),
    LIVELIER: AlarmEvent("lively"),
}


def _findings(state: State, seen: MonitorInput) -> tuple[AlarmEvent, ...]:
    found: tuple[AlarmEvent, ...] = ()
    if state.following.name:
        found = (AlarmEvent(state.following.name, state.following.shown),)
    if state.response.verdict:
        found = (VERDICTS[state.response.verdict],)
    if state.overpowered.found:
        found += (AlarmEvent("overpowered", state.overpowered.found),)
    if seen.now - state.trial_doubted < TRIAL_SAID:
        found += (AlarmEvent("trial_doubtful"),)
    if state.runaway.has_run:
        found += (AlarmEvent("runaway"),)
    if state.runaway.overpowered:
        found += (AlarmEvent("overpowered", state.runaway.overpowered),)
    if seen.now - state.stop_since >= AT_THE_STOP_TIME:
        found += (AlarmEvent("rudder_at_stop"),)
    if state.other == SLOW_RUDDER and seen.model.n1 <= 0.0 and not seen.rudder_is_slow:
        # no gain is soft enough for a boat that turns away quicker than its rudder comes
        found += (AlarmEvent("rudder_not_following", "much slower than its file says"),)
    elif state.other != FILED:
        found += (OTHERS[state.other],)
    elif seen.rudder_is_slow:
        found += (OTHERS[SLOW_RUDDER],)
    if state.doubts_speed:
        found += (AlarmEvent("speed_doubtful"),)
    return found


def _is_for_the_speed(response: Response, seen: MonitorInput) -> bool:
    """Return whether the answer to the rudder is one that a wrong speed explains: it is doubted then."""
    if response.other in (QUICKER, LIVELIER) and reads_low(seen):
        return True
    return response.verdict > 0 and speed_ratio(seen) > SPEED_DOUBT
