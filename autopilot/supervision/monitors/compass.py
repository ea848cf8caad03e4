"""A compass that stands still, jumps, or does not go together with the rate of turn.

What heading and rate of turn tell of the boat's turns: how far apart they are, and whether they go opposite ways.

Scalar functions over NamedTuples, compiled by `sitl.compiled` as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import shortest_turn
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.models.steering_gear import clip
from autopilot.signals import HeadingSample, RateSample
from autopilot.supervision.monitors.watched import NEWS, Watched

APART_TIME = 5.0
"""Turns by heading and by rate are compared over about this time [s]."""
SENSE_TIME = 2.0
"""Which way the boat turns is taken from its turns over about this time [s]."""
SENSE_LASTS = 4.0
SENSE_LEAST = math.radians(2.0) ** 2
SENSE_SHARE = 4.0
"""They go opposite ways where the mean square of their difference, over this time [s], is this many times that of
their sum and by so much [rad^2] more: a compass that lags by less than 120 deg of a wave is right yet, and so is
a gyro that is off by a degree a second."""


class Turns(NamedTuple):
    """apart [rad]: the turn by heading less that by rate, of late; heading and rate [rad]: the turns over a shorter
    time by each; difference and sum [rad^2]: the mean squares of both."""

    apart: float
    heading: float
    rate: float
    difference: float
    sum: float


NO_TURNS = Turns(0.0, 0.0, 0.0, 0.0, 0.0)


def turns_told(turns: Turns, by_heading: float, by_rate: float, step: float) -> Turns:
    """Return what is known after a step of `step` [s] in which the boat turned `by_heading` and `by_rate` [rad]."""
    fades = math.exp(-step / SENSE_TIME)
    # no boat turns further between two headings, and an instrument that says so must not spoil the sums
    by_rate = clip(by_rate, -math.pi, math.pi)
    heading, rate = turns.heading * fades + by_heading, turns.rate * fades + by_rate
    share = -math.expm1(-step / SENSE_LASTS)
    return Turns(
        turns.apart * math.exp(-step / APART_TIME) + by_heading - by_rate,
        heading,
        rate,
        turns.difference + share * ((heading - rate) ** 2 - turns.difference),
        turns.sum + share * ((heading + rate) ** 2 - turns.sum),
    )


def are_opposite(turns: Turns) -> bool:
    """Return whether heading and rate tell of turns to opposite sides."""
    return turns.difference > SENSE_SHARE * turns.sum + SENSE_LEAST


def are_alike(turns: Turns) -> bool:
    """Return whether they tell of turns to the same side: where the boat hardly turns neither holds."""
    return turns.sum > SENSE_SHARE * turns.difference + SENSE_LEAST


LONGEST_STEP_S = 0.5
FROZEN_SAMPLES = 10
"""So many headings that are the same to the last digit are worth a second look."""
FROZEN_BY_RATE = math.radians(5.0)
FROZEN_BY_RUDDER = math.radians(15.0)
"""The turn that an instrument measured, or that the rudder must have made, spans this while the heading stood."""
RATE_FORGOTTEN = 10.0
"""A rate sensor's bias would add up over longer than this [s]."""
SEA_LEAST = math.radians(0.7)
SEA_DIGITS = 5.0
SEA_STOOD = 3.0
"""In a sea that moved the heading by this standard deviation [rad], and by so many of the compass's own digits, no
heading stands for so long [s], between two wave groups neither."""
SEA_PROVEN = 20.0
"""A sea is one that has been felt for so long [s] on a course that is held: a turn in flat water looks like a wave."""
JUMPS = 3
JUMPS_WITHIN = 10.0
"""So many jumps within this time [s] are no spikes any more."""
JUMP_SETTLED = 0.5
JUMP_SAMPLES = 3
"""A heading that stays where it jumped to for so long [s], and so many samples, has jumped for good."""
JUMP_SAID = 5.0
"""A jump is told for this time [s] after it was found."""
JUMP_GAP = 2.0
DISAGREES_LASTS = 1.0
"""Turns by heading and by rate must differ for so long [s]."""
DISAGREES_SAID = 20.0
"""That they differed is said for this time [s]: a boat that does not turn for a while tells nothing of its gyro."""
OPPOSITE_WAYS = "they turn opposite ways"


class FrozenHeading:
    """A heading that stays the very same number while the boat must be turning.

    Judged by the yaw rate that came with it where there is one that does not stand still too, else by the sea that
    moved it until then, and by the turn that the model makes of the rudder, the bias being what it was when the heading
    began to stand: the estimator has learnt the wrong one since.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._digit = math.inf
        self._sea = math.nan
        self._flat = math.nan
        self._stand(math.nan)

    def _stand(self, heading: float) -> None:
        self._heading = heading
        self._proven = False
        self._same = 0
        self._since = self._time = math.nan
        self._turn: float | None = None
        self._told: float | None = None
        self._rate_moves = False
        self._low = self._high = 0.0
        # what the model makes of the rudder begins with the next look
        self._now = math.nan
        self._rate: float
        self._turned: float

    def hear(self, sample: HeadingSample) -> None:
        """Take a heading as it was measured."""
        if sample.heading != self._heading:
            step = abs(shortest_turn(self._heading, sample.heading))
            if step < self._digit:
                self._digit = step
            self._stand(sample.heading)
            self._since = sample.time
        elif sample.rate is not None and math.isfinite(self._time):
            step = clip(sample.time - self._time, 0.0, LONGEST_STEP_S)
            # nought may well be true for long
            self._rate_moves = self._rate_moves or sample.rate == 0.0 or self._told not in (None, sample.rate)
            self._told = sample.rate
            # what is long past may be the bias of the rate sensor, added up
            self._turn = (self._turn or 0.0) * math.exp(-step / RATE_FORGOTTEN) + sample.rate * step
            self._low, self._high = min(self._low, self._turn), max(self._high, self._turn)
        self._same += 1
        self._time = sample.time

    def is_frozen(self, model: Norrbin, watched: Watched) -> bool:
        """Return whether the heading has stood still while the boat turned; once it has, until it moves again."""
        self._proven = self._proven or self._is_proven(model, watched)
        return self._proven

    def _is_proven(self, model: Norrbin, watched: Watched) -> bool:
        if self._same < 2:
            self._sea = watched.state.wave_deviation
            if self._sea < SEA_LEAST or math.isnan(self._flat) or not watched.holds_course:
                self._flat = watched.now
        elif self._stands_in_a_sea():
            return True
        if self._same < 2 or not math.isfinite(self._now) or not (watched.steers or self._turn is not None):
            # what somebody else does with the rudder proves nothing
            self._begin(watched)
            return False
        step = clip(watched.now - self._now, 0.0, LONGEST_STEP_S)
        self._now = watched.now
        self._rate = rate_step(model, self._rate, watched.state.rudder + self._bias, step)
        self._turned += self._rate * step
        if self._same < FROZEN_SAMPLES:
            return False
        if self._high - self._low > FROZEN_BY_RATE:
            return True
        return not self._rate_moves and watched.has_way and abs(self._turned) > FROZEN_BY_RUDDER

    def _stands_in_a_sea(self) -> bool:
        moved = self._sea >= max(SEA_LEAST, SEA_DIGITS * self._digit)
        felt = self._since - self._flat >= SEA_PROVEN
        return moved and felt and self._same >= FROZEN_SAMPLES and self._time - self._since >= SEA_STOOD

    def _begin(self, watched: Watched) -> None:
        self._now, self._bias = watched.now, watched.state.bias
        self._rate, self._turned = watched.state.rate, 0.0


class JumpingHeading:
    """A heading that is suddenly further on than the boat can have turned: several times, or once and for good."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._last: HeadingSample | None = None
        self._rate = 0.0
        self._away: list[HeadingSample] = []
        self._jumps: list[float] = []
        self._found = self._by = math.nan
        self._text = ""

    def hear(self, sample: HeadingSample, most: float) -> None:
        """Take a heading; `most` [rad]: no boat turns further between two of them."""
        if not math.isfinite(sample.heading) or not math.isfinite(sample.time):
            return
        last = self._last
        newest = self._away[-1] if self._away else last
        if (
            last is None
            or newest is None
            or last.source != sample.source
            or sample.time < last.time
            or sample.time - newest.time > JUMP_GAP
        ):
            self._take(sample)
            return
        off = shortest_turn(last.heading + self._rate * (sample.time - last.time), sample.heading)
        if abs(off) <= most:
            self._take(sample)
            return
        if not self._away or abs(shortest_turn(self._away[-1].heading, sample.heading)) > most:
            self._away = []
            self._jumps = [*(time for time in self._jumps if sample.time - time < JUMPS_WITHIN), sample.time]
        self._by = off
        self._away.append(sample)
        settled = len(self._away) >= JUMP_SAMPLES and sample.time - self._away[0].time >= JUMP_SETTLED
        if settled:
            self._take(sample)
        if settled or len(self._jumps) >= JUMPS:
            self._found = sample.time

    def _take(self, sample: HeadingSample) -> None:
        self._last, self._away = sample, []

    def found(self, watched: Watched) -> str:
        """Return how far it jumped, where it has of late; empty where not."""
        self._rate = watched.state.rate if math.isfinite(watched.state.rate) else 0.0
        if not 0.0 <= watched.now - self._found < JUMP_SAID:
            self._text = ""
        elif not self._text:
            self._text = f"by {math.degrees(self._by):+.0f} deg"
        return self._text


class RateAgainstHeading:
    """Whether heading and rate of turn tell of the same turn, over a few seconds, and of the same side."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._heading: HeadingSample | None = None
        self._rate: RateSample | None = None
        self._turns = NO_TURNS
        self._told = math.nan
        self._since: float | None = None
        self._seen = math.nan
        self.is_opposite = False
        self.found = ""

    def hear(self, sample: HeadingSample | RateSample, most: float) -> None:
        """Take a heading or a rate; `most` [rad] may lie between the turns that they tell of, inf: not watched."""
        if not math.isfinite(sample.time) or (sample.rate is not None and not math.isfinite(sample.rate)):
            return
        if isinstance(sample, RateSample):
            self._rate = sample
            return
        last = self._heading
        if last is not None and last.source == sample.source and sample.time < last.time:
            return
        self._heading = sample
        rate = sample.rate if sample.rate is not None else self._fresh_rate(sample.time)
        if last is None or rate is None or last.source != sample.source or not math.isfinite(sample.heading):
            return
        # a burst that was read at once has one time: its turn happened since the heading before
        step = sample.time - last.time
        if not 0.0 <= step <= JUMP_GAP or not math.isfinite(last.heading):
            return
        self._turns = turns_told(self._turns, shortest_turn(last.heading, sample.heading), rate * step, step)
        if math.isfinite(most):
            self._judge(sample.time, most)

    def _judge(self, time: float, most: float) -> None:
        # only turns that both tell of alike put an end to it: a boat that lies still shows nothing
        turns = self._turns
        self.is_opposite = not are_alike(turns) if self.is_opposite else are_opposite(turns)
        if self.is_opposite:
            self._seen, self.found = time, OPPOSITE_WAYS
        elif abs(turns.apart) <= most:
            self._since = None
            if not 0.0 <= time - self._seen < DISAGREES_SAID:
                self.found = ""
        elif self._since is None:
            self._since = time
        elif time - self._since >= DISAGREES_LASTS:
            self._say(time)

    def _say(self, time: float) -> None:
        self._seen, apart = time, abs(self._turns.apart)
        if not self.found or (apart - self._told > NEWS and self.found != OPPOSITE_WAYS):
            self.found, self._told = f"{math.degrees(apart):.0f} deg apart", apart

    def _fresh_rate(self, time: float) -> float | None:
        rate = self._rate
        return rate.rate if rate is not None and 0.0 <= time - rate.time <= JUMP_GAP else None
