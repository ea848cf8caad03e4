"""Whether the boat answers to its rudder, by its heading alone: one that is stuck, gone, or wired the wrong way."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from autopilot.angles import shortest_turn
from autopilot.estimation.waves import FREQUENCY_LEAST
from autopilot.models.norrbin import Norrbin
from autopilot.signals import HeadingSample
from autopilot.supervision.monitors.answer_filter import (
    NOTHING,
    Gains,
    Mean,
    Noise,
    Spread,
    corrected,
    first_spread,
    gains_of,
    moved,
    spread_measured,
    spread_moved,
    step_of,
)
from autopilot.supervision.monitors.compass import FROZEN_SAMPLES
from autopilot.supervision.monitors.watched import Watched

LEAST_SHARE = 0.75
LEAST = (0.5, 0.85)
"""A boat still answers whose answer is this share of what it usually is, and within these shares of the model's: a
model that is 40 % too lively is none the worse for it."""
USUAL = 0.75
USUAL_SURE = 60.0
SUSPECT = 2.0
USUAL_TIME = 900.0
"""What share of the model's answer the boat is supposed to have before it has shown any; how sure that is, as a sum of
squares of the answer over their variance; with so much evidence against it nothing is learnt; and how long [s] what
it has shown is remembered."""
FADES_TIME = 20.0
"""Evidence is forgotten in this time [s]: a fault that matters shows more of it."""
FADES_SLOW = 8.0
"""Or, of the boat and its gear, in so many time constants if that is longer."""
SURE = 10.4
"""So much more likely, as a natural logarithm, must it be that the boat does not answer."""
MOST_AT_ONCE = 0.8
"""What one heading may add to that."""
LATE_S = 0.4
"""An answer that comes this much later [s] than the model's is one, too: links and gears are slow at times."""
LONGEST_GAP_S = 1.0
LATE_LASTS = 1.0
"""So long [s] after a tick that came late nothing is evidence against the rudder: what was ordered then has left some
time between the two ticks, and what the boat did until then hangs after it."""
WILD = 6.0
WILD_MOST = 4
"""A heading so many standard deviations away is left out, but no more than so many in a row."""
PUSH_CHANGE = math.radians(0.6) ** 2
"""Wind and trim wander by so much [rad^2 of rudder] in a second."""
ROUGH = math.radians(0.5) ** 2
"""So uncertain is the model itself: the square [rad^2 of rudder] of a push that lasts for `ROUGH_TIME` [s]."""
ROUGH_TIME = 0.2
SEA_LEAST = math.radians(1.0) ** 2
SEA_SLOWEST = 0.5
"""A sea of at least this size [rad^2 of rudder] and pace [1/s] is always supposed."""
ODD_TIME = 0.25
ODD = 3.0
"""Where headings of this time [s] are so much further off, squared, than any answer explains, a gust has set in."""
GUST = math.radians(25.0) ** 2
"""What a gust adds to the push's variance, a second [rad^2/s]."""
DOUBTED = 7.0
"""Evidence that is a doubt in a trial, as a natural logarithm: its rudder rests, and a gust looks the same there. The
law's rudder moves, and tells them apart."""
PUSHED_S = 0.3
PUSHED_SIGMAS = 2.0
"""A push that is heavier than the trial's rudder by so many standard deviations for this time [s] is one: with only
one of them healthy zigzags in sea state 5 ended."""
SEA_KNOWN_S = 2.0 * math.pi / FREQUENCY_LEAST
"""One period of the longest wave that is estimated [s]: before, how large the sea is is not known, and it looks like a
push."""
SEA_TURNED = math.radians(10.0)
"""So far [rad] from the headings of the last SEA_KNOWN_S the sea is not the one that is estimated there: a boat meets
the same waves slower, and from a side that turns it more."""
ANSWERS_MOST = 1.6
"""Shares of the answer beyond which, the opposite one included, it is something else that turns the boat."""
OPPOSITE_SHARE = -0.7
"""What a boat answers at least whose rudder is wired the wrong way."""
LIVELY = (1.6, 3.5)
QUICK = (2.4, 6.0)
"""Shares of the model's answer, the one against the other: more than their mean is a boat that turns better than the
model allows for, and one that is not the model's. A gust turns the boat to one side while the rudder may go there too;
an answer is to both sides, so the evidence must be there on each."""
SLOW = 4.0
"""The rudder is so many times slower than it should be: against one that is right on a boat that answers weakly, as the
model says, or strongly, and against one that is late."""
STRANGE = 3.0
STRANGE_TIME = 2.0
"""Where headings of this time [s], or of a time constant, lie so much further off, squared, than such an answer
explains, it is not what turns the boat."""
WEAK, STRONG = 0.5, 1.6
COLOUR_TIME = 0.5
"""What the best share of the answer leaves over is white noise where it is a compass's. Where it lies to one side for
so long [s], a sea other than the one that is estimated turns the boat, and the rudder follows it at the sea's own pace:
one heading then tells little that those before it have not."""
COLOUR_KNOWN = 2.5
"""The square of what lies to one side, where the sea is the one that is estimated: 2.3 at most with each boat of the
tests in state 3. Where it has been so many times as much while nothing was suspect, the sea is another, and does what
looks like a fault of the rudder so much more often: as much more evidence is wanted."""


class Others(NamedTuple):
    """What else may turn the boat as it turns. slow: the answer to a rudder that is SLOW times slower [rad]; lively and
    quick: how much likelier each is, to starboard and to port; strange and strange_slow: squares that no answer
    explains, nor a slow rudder; weak, right, strong and late: how much likelier a slow rudder is than a boat that
    answers in this way; fit: sums of innovation times answer and of the answer's square, over the variance; left: the
    mean of late of what the best share of the answer leaves over [standard deviations]; colour: its square, 1 where
    that is white noise."""

    slow: Mean
    lively: tuple[float, float]
    quick: tuple[float, float]
    strange: float
    strange_slow: float
    weak: float
    right: float
    strong: float
    late: float
    fit: tuple[float, float] = (0.0, 0.0)
    left: float = 0.0
    colour: float = 1.0


NO_OTHERS = Others(NOTHING, (0.0, 0.0), (0.0, 0.0), 0.5, 1.0, 0.0, 0.0, 0.0, 0.0)


class Memory(NamedTuple):
    """time [s] of the newest heading; spread and mean of a boat without a rudder; answers to the rudder [rad], in time
    and late; how much likelier it is that the boat does not answer than that it does, in time and late, and that it
    answers to the opposite; odd: squares that nothing explains; wild: so many headings were, the last ones; usual and
    shown: the share of the model's answer that the boat has had so far is the former over the latter; others: the
    boat or its rudder may not be the file's; usual_colour: the colour of what is left over as long as nothing was
    suspect."""

    time: float
    spread: Spread
    mean: Mean
    answer: Mean
    late: Mean
    silent: float
    silent_late: float
    opposite: float
    opposite_late: float
    odd: float
    wild: int
    usual: float
    shown: float
    others: Others = NO_OTHERS
    usual_colour: float = 1.0


class Seaway(NamedTuple):
    """What a boat has met: at `time` [s], `swing` [rad] the largest yaw by waves of the last USUAL_TIME, `north` and
    `east` the mean of the headings of the last SEA_KNOWN_S, as unit vectors."""

    time: float
    swing: float
    north: float
    east: float


def seaway_step(before: Seaway | None, time: float, heading: float, swing: float) -> Seaway:
    """Return what has been met by `time` [s] with waves that yaw the boat by `swing` [rad] on a `heading` [rad]."""
    north, east = math.cos(heading), math.sin(heading)
    if before is None:
        return Seaway(time, swing, north, east)
    kept = math.exp(-(time - before.time) / SEA_KNOWN_S)
    return Seaway(
        time,
        max(swing, before.swing * math.exp(-(time - before.time) / USUAL_TIME)),
        north + kept * (before.north - north),
        east + kept * (before.east - east),
    )


def sea_met(model: Norrbin, noise: Noise, seaway: Seaway, heading: float) -> Noise:
    """Return the noise of a boat that has turned away to `heading` [rad] from where the sea was estimated: of that one
    and the largest that has been met, at the slowest pace, the one that pushes harder."""
    turned = shortest_turn(math.atan2(seaway.east, seaway.north), heading)
    met = answer_noise(model, noise.heading, seaway.swing, SEA_SLOWEST)
    return met if abs(turned) > SEA_TURNED and met.sea > noise.sea else noise


def first_memory(noise: Noise, time: float, heading: float) -> Memory:
    """Return what is known after the first heading [rad]."""
    mean, usual = Mean(heading, 0.0, 0.0, 0.0), USUAL * USUAL_SURE
    return Memory(time, first_spread(noise), mean, NOTHING, NOTHING, 0.0, 0.0, 0.0, 0.0, 1.0, 0, usual, USUAL_SURE)


def answer_noise(model: Norrbin, heading: float, swing: float, frequency: float) -> Noise:
    """Return the noise: of a compass with `heading` [rad^2], in a sea that yaws by `swing` [rad] at `frequency`."""
    drive = model.gain / model.time_constant
    pace = max(frequency, SEA_SLOWEST)
    yaw, lag = swing * pace / model.gain, pace * model.time_constant
    sea = max(yaw * yaw * (1.0 + lag * lag), SEA_LEAST)
    return Noise(heading, drive * drive * ROUGH * ROUGH_TIME, PUSH_CHANGE, sea, pace)


def answer_step(
    memory: Memory,
    model: Norrbin,
    noise: Noise,
    rate: float,
    heard: tuple[float, float],
    rudder: float,
    late: float,
    slow: float | None = None,
) -> Memory:
    """Return the memory after a heading [rad] `heard` at its time [s], the rudder having been at `rudder` [rad] since
    the one before, or `late` where everything is late, or `slow` where it is SLOW times slower than filed, None where
    that is out of question; the boat turns at about `rate` [rad/s]."""
    time, heading = heard
    dt = time - memory.time
    step = step_of(model, rate, noise, dt)
    push = noise.push + GUST if memory.odd > ODD else noise.push
    gusty = Noise(noise.heading, noise.acceleration, push, noise.sea, noise.pace)
    spread = spread_moved(step, memory.spread, gusty, dt)
    mean, answer = moved(step, memory.mean, 0.0), moved(step, memory.answer, rudder)
    late_answer = moved(step, memory.late, late)
    slow_answer = moved(step, memory.others.slow, rudder if slow is None else slow)
    gains = gains_of(spread, noise)
    off = shortest_turn(mean.psi, heading)
    unexplained = _unexplained(off, answer.psi)
    by_slow = off - slow_answer.psi
    # a rudder that is slow is no gust either
    square = min(unexplained * unexplained, by_slow * by_slow) / gains.variance
    # while a gust sets in nothing that the rudder does against it is evidence
    most = 0.0 if memory.odd > ODD else MOST_AT_ONCE
    if square > WILD * WILD and memory.wild < WILD_MOST:
        return Memory(
            time,
            spread,
            mean,
            answer,
            late_answer,
            memory.silent,
            memory.silent_late,
            memory.opposite,
            memory.opposite_late,
            memory.odd,
            memory.wild + 1,
            memory.usual,
            memory.shown,
            memory.others._replace(slow=slow_answer),
            memory.usual_colour,
        )
    share = 1.0 - math.exp(-dt / ODD_TIME)
    least = min(max(LEAST_SHARE * memory.usual / memory.shown, LEAST[0]), LEAST[1])
    kept_others = math.exp(-dt / max(FADES_TIME, FADES_SLOW * model.time_constant))
    fit, left, colour = _colour(memory.others, gains, off, answer.psi, kept_others, 1.0 - math.exp(-dt / COLOUR_TIME))
    kept, remembered = math.exp(-dt / FADES_TIME), math.exp(-dt / USUAL_TIME)
    silent = max(kept * memory.silent + _evidence(gains, off, least * answer.psi, 0.0, most), 0.0)
    silent_late = max(kept * memory.silent_late + _evidence(gains, off, least * late_answer.psi, 0.0, most), 0.0)
    # what may be a fault is none of the boat's usual ways
    learns = 1.0 / gains.variance if max(silent, memory.opposite) < SUSPECT else 0.0
    contrary, contrary_late = OPPOSITE_SHARE * answer.psi, OPPOSITE_SHARE * late_answer.psi
    opposite = max(kept * memory.opposite + _evidence(gains, off, least * answer.psi, contrary, most), 0.0)
    opposite_late = max(
        kept * memory.opposite_late + _evidence(gains, off, least * late_answer.psi, contrary_late, most), 0.0
    )
    return Memory(
        time,
        spread_measured(gains, spread),
        corrected(gains, mean, off),
        corrected(gains, answer, -answer.psi),
        corrected(gains, late_answer, -late_answer.psi),
        silent,
        silent_late,
        opposite,
        opposite_late,
        memory.odd + share * (min(square, WILD * WILD) - memory.odd),
        0,
        USUAL * USUAL_SURE + remembered * (memory.usual - USUAL * USUAL_SURE) + learns * off * answer.psi,
        USUAL_SURE + remembered * (memory.shown - USUAL_SURE) + learns * answer.psi * answer.psi,
        _others(
            memory.others,
            gains,
            off,
            (answer.psi, late_answer.psi),
            slow_answer,
            1.0 - math.exp(-dt / max(STRANGE_TIME, model.time_constant)),
            kept_others,
        )._replace(fit=fit, left=left, colour=colour),
        colour if learns > 0.0 else memory.usual_colour,
    )


def _others(
    before: Others,
    gains: Gains,
    off: float,
    answers: tuple[float, float],
    slow: Mean,
    share: float,
    kept: float,
) -> Others:
    """Return what is known of the other explanations after a heading `off` [rad] from what it would be without a
    rudder; answers: to the rudder, and to a late one [rad]."""
    answer, late = answers

    # what neither any share of the answer explains, nor a slow rudder's, is a gust or a sea: no evidence of either
    ahead = off if answer >= 0.0 else -off
    left, left_by_slow = min(ahead, 0.0), off - slow.psi
    strange = before.strange + share * (_square(left, gains) - before.strange)
    strange_slow = before.strange_slow + share * (_square(left_by_slow, gains) - before.strange_slow)
    most = MOST_AT_ONCE if strange < STRANGE else 0.0
    most_slow = MOST_AT_ONCE if strange_slow < STRANGE else 0.0

    def grown(evidence: float, least: float, other: float, most: float) -> float:
        return max(kept * evidence + _evidence(gains, off, least, other, most), 0.0)

    def either(evidence: tuple[float, float], pair: tuple[float, float]) -> tuple[float, float]:
        starboard, port = evidence
        if answer > 0.0:
            return grown(starboard, pair[0] * answer, pair[1] * answer, most), kept * port
        return kept * starboard, grown(port, pair[0] * answer, pair[1] * answer, most)

    return Others(
        corrected(gains, slow, -slow.psi),
        either(before.lively, LIVELY),
        either(before.quick, QUICK),
        strange,
        strange_slow,
        grown(before.weak, WEAK * answer, slow.psi, most_slow),
        grown(before.right, answer, slow.psi, most_slow),
        grown(before.strong, STRONG * answer, slow.psi, most_slow),
        grown(before.late, late, slow.psi, most_slow),
    )


def _colour(
    before: Others, gains: Gains, off: float, answer: float, kept: float, share: float
) -> tuple[tuple[float, float], float, float]:
    """Return `fit`, `left` and `colour` after an innovation `off` [rad] beside an `answer` [rad]; kept: of what was
    before; share: of the newest in `left`. The mean of white noise has the variance share/(2 - share)."""
    if share <= 0.0:
        # no time has passed: a second heading of the same instant says nothing of colour
        return before.fit, before.left, before.colour
    both, squares = before.fit
    fit = kept * both + off * answer / gains.variance, kept * squares + answer * answer / gains.variance
    best = max(fit[0] / fit[1], 1.0) if fit[1] > 0.0 else 1.0
    left = before.left + share * ((off - best * answer) / math.sqrt(gains.variance) - before.left)
    square = left * left * (2.0 - share) / share
    return fit, left, square + kept * (before.colour - square)


def _unexplained(off: float, answer: float) -> float:
    """Return what is left of an innovation by the share of the answer, the opposite allowed, that explains most."""
    if answer < 0.0:
        off, answer = -off, -answer
    return off - min(max(off, -answer), ANSWERS_MOST * answer)


def _square(left: float, gains: Gains) -> float:
    return min(left * left / gains.variance, WILD * WILD)


def _evidence(gains: Gains, off: float, least: float, other: float, most: float) -> float:
    """Return how much likelier the answer `other` is than the `least` [rad], `most` at once: half the difference of the
    squares that they leave."""
    left, left_by_other = off - least, off - other
    more = 0.5 * (left * left - left_by_other * left_by_other) / gains.variance
    return min(max(more, -MOST_AT_ONCE), most)


def without_evidence(before: Memory, after: Memory) -> Memory:
    """Return `after` with no more evidence against the rudder than `before`; what speaks for it counts."""
    return after._replace(
        silent=min(before.silent, after.silent),
        silent_late=min(before.silent_late, after.silent_late),
        opposite=min(before.opposite, after.opposite),
        opposite_late=min(before.opposite_late, after.opposite_late),
        others=_without_more(before.others, after.others),
    )


def _without_more(before: Others, after: Others) -> Others:
    (lively, lively_port), (quick, quick_port) = before.lively, before.quick
    return after._replace(
        lively=(min(lively, after.lively[0]), min(lively_port, after.lively[1])),
        quick=(min(quick, after.quick[0]), min(quick_port, after.quick[1])),
        weak=min(before.weak, after.weak),
        right=min(before.right, after.right),
        strong=min(before.strong, after.strong),
        late=min(before.late, after.late),
    )


def verdict(memory: Memory) -> int:
    """Return 0 where the boat answers or nothing tells, 1 where it does not, -1 where it answers to the opposite."""
    sure = SURE * max(memory.usual_colour / COLOUR_KNOWN, 1.0)
    if min(memory.opposite, memory.opposite_late) >= sure:
        return -1
    return 1 if min(memory.silent, memory.silent_late) >= sure else 0


def is_doubtful(memory: Memory) -> bool:
    """Return whether there is some evidence that the boat does not answer, or to the opposite rudder."""
    return max(min(memory.opposite, memory.opposite_late), min(memory.silent, memory.silent_late)) >= DOUBTED


def acquitted(memory: Memory) -> Memory:
    """Return the memory with no more evidence against the rudder than makes as much again as was a doubt a verdict."""
    most = SURE - DOUBTED
    return memory._replace(
        silent=min(memory.silent, most),
        silent_late=min(memory.silent_late, most),
        opposite=min(memory.opposite, most),
        opposite_late=min(memory.opposite_late, most),
    )


def push_at_least(memory: Memory) -> float:
    """Return what the boat is pushed by beside rudder and sea [rad of rudder], less `PUSHED_SIGMAS`; 0 where that
    may be nothing. The boat is supposed to answer to its rudder as usual."""
    push = memory.mean.push + memory.usual / memory.shown * memory.answer.push
    return math.copysign(max(abs(push) - PUSHED_SIGMAS * math.sqrt(max(memory.spread.p22, 0.0)), 0.0), push)


def other_verdict(others: Others) -> str:
    """Return "quick" where the boat turns as no boat of the model does, "lively" where it turns more than the model
    allows for, "slow" where its rudder is slow, "" where nothing tells."""
    if min(others.weak, others.right, others.strong, others.late) >= SURE:
        return "slow"
    sure = SURE * max(others.colour, 1.0)
    if min(others.quick) >= sure:
        return "quick"
    return "lively" if min(others.lively) >= sure else ""


class RudderAnswer:
    """Sums up, over the headings, how much likelier it is that the boat does not answer than that it does.

    A cumulative sum that begins anew at zero (Page 1954), so that it needs no window: it grows only where the rudder
    moves, faster than wind and sea would, and the boat does not go along. A straight course with a rudder that rests
    tells nothing, and what is told then is nothing.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._memory: Memory | None = None
        self._seaway: Seaway | None = None
        self._rudders: deque[tuple[float, float]] = deque()
        self._heard: list[HeadingSample] = []
        self._last: HeadingSample | None = None
        self._same = 0
        self._late_until = -math.inf
        self._slow: tuple[float, float] | None = None
        self._steers_since = self._held_off_since = math.nan
        self._doubted_trial = False
        self.doubts_trial = False
        """Whether a trial's rudder does not turn the boat as it should: said in one tick of a trial."""
        self.other = ""
        """See `other_verdict`."""

    def hear(self, sample: HeadingSample) -> None:
        """Take a heading as it was measured."""
        if math.isfinite(sample.heading) and math.isfinite(sample.time):
            self._heard.append(sample)

    def look(self, model: Norrbin, watched: Watched, noise: float, rudder_rate: float = math.inf) -> tuple[str, str]:
        """Return the alarm's name and what is seen, '' where the boat answers or nothing tells; `noise` [rad^2].

        rudder_rate [rad/s]: the filed one; inf: nobody asks whether the rudder is slower.
        """
        heard, self._heard = self._heard, []
        state = watched.state
        if not (watched.steers and watched.has_way and math.isfinite(state.rate) and math.isfinite(state.rudder)):
            self.reset()
            return "", ""
        if watched.is_late:
            self._late_until = watched.now + LATE_LASTS
        self._rudders.append((watched.now, state.rudder))
        self._follow_slowly(watched, rudder_rate)
        while self._rudders[0][0] < watched.now - LATE_S - 2.0 * LONGEST_GAP_S:
            self._rudders.popleft()
        # of a burst that was read at once, and has one time, the last is the newest
        for sample in sorted({each.time: each for each in heard}.values(), key=lambda each: each.time):
            self._take(model, watched, noise, sample)
        # where waves are not estimated, what they do to boat and rudder together looks like a strong rudder
        memory = self._memory
        self.other = other_verdict(memory.others) if memory is not None and state.wave_deviation > 0.0 else ""
        self._doubt_trial(watched)
        return self._found()

    def _doubt_trial(self, watched: Watched) -> None:
        """Find a trial whose rudder cannot or does not turn the boat back."""
        memory, now = self._memory, watched.now
        self._steers_since = _since(self._steers_since, now, is_so=True)
        is_known = now - self._steers_since >= SEA_KNOWN_S
        push = push_at_least(memory) if memory is not None and is_known else 0.0
        self.doubts_trial = False
        if watched.follows:
            self._held_off_since, self._doubted_trial = math.nan, False
            return
        # on the way from one side to the other the rudder passes amidships
        holds = max(abs(angle) for _, angle in self._rudders)
        is_held_off = push * watched.rudder < 0.0 and abs(push) > holds
        self._held_off_since = _since(self._held_off_since, now, is_so=is_held_off)
        if memory is None or self._doubted_trial:
            return
        if is_doubtful(memory) or now - self._held_off_since >= PUSHED_S:
            self.doubts_trial = self._doubted_trial = True
            self._memory = acquitted(memory)

    def _follow_slowly(self, watched: Watched, rate: float) -> None:
        """Carry on where the rudder would be if it were SLOW times slower; one that is measured is where it is."""
        if watched.rudder_is_measured or not math.isfinite(rate):
            self._slow = None
        elif self._slow is None:
            self._slow = watched.now, watched.state.rudder
        else:
            reach = rate / SLOW * max(watched.now - self._slow[0], 0.0)
            angle = self._slow[1]
            self._slow = watched.now, angle + min(max(watched.rudder - angle, -reach), reach)

    def _take(self, model: Norrbin, watched: Watched, variance: float, sample: HeadingSample) -> None:
        state, memory, last = watched.state, self._memory, self._last
        self._seaway = seaway_step(self._seaway, watched.now, state.heading, state.wave_deviation)
        noise = answer_noise(model, variance, state.wave_deviation, state.wave_frequency)
        noise = sea_met(model, noise, self._seaway, state.heading)
        self._same = self._same + 1 if last is not None and last.heading == sample.heading else 1
        stands = self._same >= FROZEN_SAMPLES
        if (
            memory is None
            or last is None
            or stands
            or last.source != sample.source
            or sample.time - memory.time > LONGEST_GAP_S
        ):
            self._memory = None if stands else first_memory(noise, sample.time, sample.heading)
            self._last = sample
            return
        if sample.time <= memory.time:
            return
        self._last = sample
        middle = 0.5 * (memory.time + sample.time)
        fastest = 2.0 * model.gain * watched.angle_max
        rate = min(max(state.rate, -fastest), fastest)
        after = answer_step(
            memory,
            model,
            noise,
            rate,
            (sample.time, sample.heading),
            self._rudder_at(middle),
            self._rudder_at(middle - LATE_S),
            None if self._slow is None else self._slow[1],
        )
        self._memory = after if sample.time > self._late_until else without_evidence(memory, after)

    def _rudder_at(self, time: float) -> float:
        """Return the rudder at `time` [s]: each is that of the end of its tick."""
        return next((angle for then, angle in self._rudders if then >= time), self._rudders[-1][1])

    def _found(self) -> tuple[str, str]:
        memory = self._memory
        seen = 0 if memory is None else verdict(memory)
        if seen == 0:
            return "", ""
        if seen < 0:
            return "rudder_reversed", "the boat answers to the opposite rudder"
        return "rudder_stuck", "the boat does not answer to it"


def _since(since: float, now: float, *, is_so: bool) -> float:
    """Return since when [s] something is so, nan: it is not."""
    if not is_so:
        return math.nan
    return now if math.isnan(since) else since
