"""Whether the boat answers to its rudder: the evidence of a tick, what it takes for a verdict, and what sea there is.

The likelihood ratios come from `rudder_response`, by headings in the sea that is estimated, and by blocks in the sea
that was learnt; a verdict takes both together, and something of each. How large the sea is supposed to be is said
here. Pure; the scalar functions are compiled by `sitl.compiled` as they are.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

from autopilot.angles import PI, shortest_turn, wrap
from autopilot.estimation.disturbance import slide_step
from autopilot.models.norrbin import Norrbin
from autopilot.signals import HeadingSample, NavState
from autopilot.supervision.monitor_input import AlarmLimits, History, Measured, MonitorInput
from autopilot.supervision.response_filter import SEA_KNOWN_S, Blocks, Noise
from autopilot.supervision.rudder_response import (
    NO_RESPONSE,
    NOTHING_ADDED,
    Others,
    ResponseState,
    Three,
    first_response,
    is_suspect,
    response_step,
    taken_over,
    without_evidence,
)
from autopilot.supervision.tuning import (
    CHANGED_LEAST,
    CHANGED_TIME,
    COLOUR_KNOWN,
    DOUBTED,
    FADES_TIME,
    FROZEN_SAMPLES,
    LATE_LASTS,
    LATE_S,
    LONGEST_GAP_S,
    ON_COURSE,
    OWN_UNKNOWN,
    PUSH_CHANGE,
    PUSHED_S,
    PUSHED_SIGMAS,
    REPORT_FRESH_S,
    ROUGH,
    ROUGH_TIME,
    SEA_FIRST,
    SEA_FIRST_TIME,
    SEA_LASTS,
    SEA_LEAST,
    SEA_SLOWEST,
    SEA_TURNED,
    SEA_UNMET,
    SLOW,
    SURE,
    SURE_OTHER,
    SURE_SINCE,
    SURE_TURNING,
    WORKED_TIME,
)

Evident = TypeVar("Evident", ResponseState, Blocks)


def acquitted(response: ResponseState) -> ResponseState:
    """Return the same with no more evidence against the rudder, in both seas together, than makes as much again as was
    a doubt a verdict: on the course that is held behind a trial, and by headings, in each of both, in a turn."""
    most = 0.5 * (SURE[0] - DOUBTED)
    return _at_most(response, most)._replace(blocks=_at_most(response.blocks, most))


def _at_most(known: Evident, most: float) -> Evident:
    return known._replace(
        stuck=min(known.stuck, most),
        stuck_late=min(known.stuck_late, most),
        reversed=min(known.reversed, most),
        reversed_late=min(known.reversed_late, most),
    )


def verdict(response: ResponseState, sure: tuple[float, float, float]) -> int:
    """Return 0 where the boat answers or nothing tells, 1 where it does not, -1 where it answers to the opposite. sure:
    so much evidence together, by headings, and by blocks is `enough`.

    A boat that turns against its rudder shows as soon that it does not answer, as each heading adds no more than
    MOST_AT_ONCE to either. Which of the two it is, the share of the answer tells that explains most since then.
    """
    together, headings, blocks = sure
    if response.stuck < headings and response.reversed < headings:
        return 0
    (stuck, wrong), (stuck_too, wrong_too) = by_headings(response), by_blocks(response)
    is_wrong = wrong >= headings and wrong_too >= blocks and wrong + wrong_too >= together
    if not is_wrong and not (stuck >= headings and stuck_too >= blocks and stuck + stuck_too >= together):
        return 0
    return _which(response)


def turned_verdict(response: ResponseState, added: Three) -> int:
    """Return the same by what a turn has `added` up since its beginning."""
    return _which(response) if added[0] >= SURE_SINCE and added[1] >= SURE_SINCE and added[2] >= SURE_SINCE else 0


def _which(response: ResponseState) -> int:
    both, squares = response.since
    return -1 if both < -0.5 * squares else 1


def by_headings(response: ResponseState) -> tuple[float, float]:
    """Return how much likelier it is, heading by heading in the sea that is estimated, that the rudder is stuck than
    that the boat answers, and that it is reversed; less where the sea is another."""
    colour = response.usual_colour / COLOUR_KNOWN
    known = 1.0 / colour if colour > 1.0 else 1.0
    stuck, late, wrong, wrong_late = response.stuck, response.stuck_late, response.reversed, response.reversed_late
    return known * (stuck if stuck < late else late), known * (wrong if wrong < wrong_late else wrong_late)


def by_blocks(response: ResponseState) -> tuple[float, float]:
    """Return the same in the sea that was learnt."""
    blocks = response.blocks
    stuck, late, wrong, wrong_late = blocks.stuck, blocks.stuck_late, blocks.reversed, blocks.reversed_late
    return stuck if stuck < late else late, wrong if wrong < wrong_late else wrong_late


def enough(carried: float, holds_course: bool) -> tuple[float, float, float]:
    """Return how much evidence is enough on a course, or in a turn: there what was `carried` into it counts as the same
    share of a verdict as on the course."""
    share = 1.0 if holds_course else carried
    return (
        SURE_TURNING[0] + (SURE[0] - SURE_TURNING[0]) * share,
        SURE_TURNING[1] + (SURE[1] - SURE_TURNING[1]) * share,
        SURE_TURNING[2] + (SURE[2] - SURE_TURNING[2]) * share,
    )


def carried_on(before: float, response: ResponseState, holds_course: bool, dt: float) -> float:
    """Return what a turn carries of evidence from before it, as a share of a verdict, `dt` [s] after `before`: it fades
    as all evidence does."""
    if not holds_course:
        return before * math.exp(-dt / FADES_TIME)
    (stuck, wrong), (stuck_too, wrong_too) = by_headings(response), by_blocks(response)
    stuck, wrong = stuck + stuck_too, wrong + wrong_too
    share = (stuck if stuck > wrong else wrong) / SURE[0]
    return share if share < 1.0 else 1.0


def since_turning(before: Three, response: ResponseState, turns: bool) -> Three:
    """Return how much likelier it is, after another heading, that the rudder has been stuck ever since a turn began;
    nothing on a course.

    A fault may begin at any time, and what is known of it is begun anew whenever the boat answers. Of a fault that was
    there before the turn all headings tell, and a boat that has answered to its beginning is none of those, whatever
    the sea does then: such evidence of one that works ever reaches a with a probability of exp(-a) at most (Wald 1945,
    Ville 1939), and not once in so many headings.
    """
    if not turns:
        return NOTHING_ADDED
    (stuck, late, slow), (more, more_late, more_slow) = before, response.added
    return stuck + more, late + more_late, slow + more_slow


def is_doubtful(response: ResponseState) -> bool:
    """Return whether there is some evidence that the boat does not answer, or to the opposite rudder."""
    is_reversed = response.reversed >= DOUBTED and response.reversed_late >= DOUBTED
    return is_reversed or (response.stuck >= DOUBTED and response.stuck_late >= DOUBTED)


def push_at_least(response: ResponseState) -> float:
    """Return what the boat is pushed by beside rudder and sea [rad of rudder], less `PUSHED_SIGMAS`; 0 where that
    may be nothing. The boat is supposed to answer to its rudder as usual."""
    mean, answer, _, _, _ = response.means
    push = mean[2] + response.usual / response.shown * answer[2]
    uncertain = PUSHED_SIGMAS * math.sqrt(max(response.covariance[7], 0.0))
    return math.copysign(max(abs(push) - uncertain, 0.0), push)


FILED, QUICKER, SLOW_RUDDER, LIVELIER = 0, 1, 2, 3
"""What boat and rudder turn out to be: the file's as far as anything tells, a boat that turns as none of the model, a
slow rudder, or a boat that turns more than the model allows for. Of several the first counts."""


def other_verdict(others: Others) -> int:
    """Return what boat and rudder turn out to be."""
    if (
        others.right >= SURE_OTHER
        and others.weak >= SURE_OTHER
        and others.strong >= SURE_OTHER
        and others.late >= SURE_OTHER
    ):
        return SLOW_RUDDER
    quick, lively = others.quick, others.lively
    if quick[0] < SURE_OTHER and lively[0] < SURE_OTHER:
        return FILED
    sure = SURE_OTHER * max(others.colour, 1.0)
    if quick[0] >= sure and quick[1] >= sure:
        return QUICKER
    return LIVELIER if lively[0] >= sure and lively[1] >= sure else FILED


class Seaway(NamedTuple):
    """What a boat has met: at `time` [s], nan: nothing yet, `swing` [rad] the largest yaw by waves of the last
    SEA_LASTS, `north` and `east` the mean of the headings of the last SEA_KNOWN_S, as unit vectors; `begun` [s]:
    since when it is estimated."""

    time: float
    swing: float
    north: float
    east: float
    begun: float


NO_SEAWAY = Seaway(math.nan, 0.0, 0.0, 0.0, math.nan)


def seaway_step(before: Seaway, time: float, heading: float, swing: float) -> Seaway:
    """Return what has been met by `time` [s] with waves that yaw the boat by `swing` [rad] on a `heading` [rad]."""
    north, east = math.cos(heading), math.sin(heading)
    last, largest, mean_north, mean_east, begun = before
    if last != last:
        return Seaway(time, swing, north, east, begun if begun == begun else time)
    kept = math.exp(-(time - last) / SEA_KNOWN_S)
    largest *= math.exp(-(time - last) / SEA_LASTS)
    return Seaway(
        time,
        largest if largest > swing else swing,
        north + kept * (mean_north - north),
        east + kept * (mean_east - east),
        begun,
    )


def counts_as_course(seaway: Seaway, now: float, holds_course: bool) -> bool:
    """Return whether a rudder is judged at `now` [s] as on a course that is held: in a turn too as long as it is not
    known how large the sea is, which may be what keeps the boat from turning."""
    return holds_course or not now - seaway.begun >= SEA_KNOWN_S


def sea_of(model: Norrbin, swing: float, pace: float) -> float:
    """Return the sea [rad^2 of rudder] that yaws the boat by `swing` [rad] at its pace [1/s]."""
    yaw, lag = swing * pace / model.gain, pace * model.time_constant
    sea = yaw * yaw * (1.0 + lag * lag)
    return sea if sea > SEA_LEAST else SEA_LEAST


def seaway_noise(model: Norrbin, heading: float, state: NavState, seaway: Seaway, worked: float, unmet: float) -> Noise:
    """Return the noise of a boat in this `state`, with a compass of `heading` [rad^2]; where it has turned away from
    where the sea was estimated, of that one, the largest that has been met, and one that nobody has met yet, at the
    slowest pace, the one that pushes hardest. A sea from right ahead or astern turns no boat, until it leaves that
    course.

    worked [rad^2]: the mean square of a rudder that works against the sea. The yaw that is left is less than the sea is
    worth then, and the rudder of a boat that is quicker than the waves makes up for it. unmet: see `Noise`.
    """
    drive, frequency = model.gain / model.time_constant, state.wave_frequency
    pace = frequency if frequency > SEA_SLOWEST else SEA_SLOWEST
    sea = sea_of(model, state.wave_deviation, pace)
    swing = seaway.swing if seaway.swing > SEA_UNMET else SEA_UNMET
    largest = sea_of(model, swing, SEA_SLOWEST)
    if largest > sea and abs(shortest_turn(math.atan2(seaway.east, seaway.north), state.heading)) > SEA_TURNED:
        sea, pace = largest, SEA_SLOWEST
    return Noise(heading, drive * drive * ROUGH * ROUGH_TIME, PUSH_CHANGE, sea + worked, pace, unmet)


def changing_noise(model: Norrbin, noise: Noise, rate: float, speed: float) -> Noise:
    """Return the noise of a boat that turns at `rate` [rad/s] and goes at another speed than the `speed` [m/s] of late.

    n3 ~ 1/U^2 and n2 ~ 1/U, and a speed that is measured late or seldom is off by what it has changed by: a boat that
    loses way in a hard turn is braked by more than its rudder, and turns slower against it. What a course-unstable boat
    does by itself nearly balances its rudder in a slow turn, and a little of it decides which way it goes.
    """
    change, own = abs(model.reference_speed / speed - 1.0), 0.0
    if model.n1 < 0.0:
        own = OWN_UNKNOWN * abs(model.n1 * rate)
    elif change < CHANGED_LEAST:
        return noise
    unknown = (own + change * abs((2.0 * model.n3 * rate + model.n2) * rate * rate)) / model.time_constant
    acceleration = noise.acceleration + unknown * unknown * CHANGED_TIME
    return Noise(noise.heading, acceleration, noise.push, noise.sea, noise.pace, noise.unmet)


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
    if seen.rudder_is_measured or not limits.rudder_rate < math.inf:
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
        off = off if -PI < off <= PI else wrap(off)
        is_near = -ON_COURSE < off < ON_COURSE
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
    if not (seen.steers and seen.has_way and -math.inf < state.rate + state.rudder < math.inf):
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
    if len(headings) == 1 and -math.inf < headings[0].heading + headings[0].time < math.inf:
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
