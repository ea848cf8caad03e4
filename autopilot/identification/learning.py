"""Learning while sailing: a filter fed with the ticks, and a candidate model that must predict what comes.

It only proposes. A model is put forward as a candidate when its turns are known well enough: when the filter
(`live_filter`) doubts them less than they differ from the present model's. K and T by themselves need not be known for
that: a boat that is hardly ever in a steady turn shows K/T, and the two together. From that moment on both models
predict the boat's heading, stretch by stretch, from the rudder alone: what they are judged by is what the candidate has
not learnt from. A bet is made on each stretch that the boat turned as the candidate says rather than as the present
model does: that it lies beyond the point between both from which the candidate's error is less than a share m = BETTER
of the other's. With e0 and e1 the errors of the present model and of the candidate, D = e1 - e0 how far apart they are,
and s what the candidate has left so far (root mean square),

    v = -sign(D) (m e0 + e1)/(1 + m)
    x = v/(2 s) within -1 and 1, times |D|/(2 s) where that is less than 1
    wealth = mean over l of the product of (1 + l x) over all stretches so far

What turns the boat beside the rudder is in both errors and hides neither model: it is no more in favour of the one than
of the other. D and s are known before the heading that decides, so a candidate that is not better by as much makes no
wealth where what else turns the boat goes to both sides alike: that it ever has more than w is less probable than 1/w,
however often one looks (Ville's inequality; Shafer 2021, Waudby-Smith and Ramdas 2024). It has proved itself when its
wealth is above k (k + 1)/CHANCE, k counting the candidates, so that all together are wrong with less than CHANCE. A
rudder that answers gusts goes with them, and speaks for a model on which it does little: so no bet is made where the
rudder does less than the filter learns by. And it must have been the better one in hard turns, where models that turn
alike with little rudder part.

n0 is the wind's and stays as it is; what wind does, each model finds for itself. Memory is
constant: filters, the last few rudder angles, one running prediction, the outcomes of the last `STRETCHES` stretches.

In that test two models predict the heading side by side. What else pushes the boat, each model finds for itself: beside
each runs a filter (`live_filter`) whose boat is the model's, and which knows gusts and trim only. A stretch begins with
its rate, its gust, which dies away, and its trim, which stays, so that wind counts for neither model and what is left
to tell them apart is what the rudder does.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.angles import wrap
from autopilot.identification.interval import ENOUGH, GOOD, SURE_OF_IT, off_by
from autopilot.identification.live_filter import (
    GUST_TIME_S,
    LEAST_RATIO,
    MOST_RATIO,
    USUAL_COMPASS,
    LiveFilter,
    Push,
    moved_on,
)
from autopilot.models.norrbin import ROUNDING, Norrbin
from autopilot.models.steering_gear import RudderBounds, SteeringGear
from autopilot.signals import HeadingSample, RateSample, RudderSample, Tick

AHEAD_TIME_CONSTANTS, AHEAD_SHORTEST_S, AHEAD_LONGEST_S = 4.0, 3.0, 30.0
"""A stretch is this many time constants long, within these limits: long enough for the models to differ."""

LONGEST_GAP_S = 2.0
LEAST_RUDDER_RANGE_RAD, LEAST_TURNED_RAD = math.radians(3.0), math.radians(8.0)
"""A stretch in which rudder or boat turned less tells nothing of either model: a rudder that only answers gusts, so
that nothing turns, would speak for the model on which it does least."""
APART, NOISE_RAD = 2.0, math.sqrt(2.0) * USUAL_COMPASS
LEAST_APART_RAD = APART * NOISE_RAD
"""Nor does one at whose end both models predict the same heading, within APART standard deviations of the noise of the
two headings that it is seen by: what is compared there is the noise. The bets stay fair: both predict from the
rudder, and not from the heading that decides the bet."""
SETTLES = 2.0
"""Stretches' worth of time in which the filters find gust and trim."""


def ahead_of(present: Norrbin, other: Norrbin) -> float:
    """Return how long [s] a stretch is."""
    longest = max(present.time_constant, other.time_constant)
    return min(max(AHEAD_TIME_CONSTANTS * longest, AHEAD_SHORTEST_S), AHEAD_LONGEST_S)


class Outcome(NamedTuple):
    """Heading errors [rad] at a stretch's end, of the present model and of the other, and the largest rudder [rad]."""

    present: float
    other: float
    rudder: float = 0.0


def beyond(outcome: Outcome, left: float) -> float:
    """Return x of the module's docstring, -1 to 1, for a candidate that has `left` [rad] so far."""
    apart, reach = outcome.other - outcome.present, APART * left
    v = -math.copysign(1.0, apart) * (BETTER * outcome.present + outcome.other) / (1.0 + BETTER)
    return min(max(v / reach, -1.0), 1.0) * min(abs(apart) / reach, 1.0)


class _Side:
    """A model, its filter, and its boat since the stretch began: rate [rad/s] and angle turned [rad]."""

    def __init__(self, model: Norrbin) -> None:
        self.model = model._replace(n0=0.0)
        self.filter = LiveFilter(model, held=True)
        self.motion, self.push = (0.0, 0.0), Push(0.0, 0.0)

    def begin(self) -> None:
        """Start a stretch."""
        self.motion, self.push = (self.filter.rate, 0.0), self.filter.push

    def move(self, ratio: float, dt: float, since: float, rudders: tuple[float, float]) -> None:
        """Go on `dt` [s], `since` [s] after the stretch began, from one rudder [rad] to the other."""
        a = self.model.gain / self.model.time_constant
        fading = math.exp(-(since + 0.5 * dt) / GUST_TIME_S)
        extra = (self.push.gust * fading / max(ratio, 0.2) ** 2 + self.push.trim) / a
        self.motion = moved_on(self.model, ratio, self.motion, dt, (rudders[0] + extra, rudders[1] + extra))


class PredictionTest:
    """Feed it with `update`; it answers at the end of each stretch that tells something. Constant memory."""

    def __init__(self, present: Norrbin, other: Norrbin) -> None:
        self.ahead = ahead_of(present, other)
        self._sides = _Side(present), _Side(other)
        self._at = self._settled = -math.inf
        self._rudder = self._heading = 0.0
        self._begun: float | None = None
        self._turned = self._least = self._most = self._port = self._starboard = 0.0

    def update(self, time: float, rudder: float, ratio: float, heading: float, rate: float | None) -> Outcome | None:
        """Take a sample as `LiveFilter.update` does, always with a heading; return the outcome at a stretch's end."""
        for side in self._sides:
            side.filter.update(time, rudder, ratio, heading, rate)
        dt = time - self._at
        outcome = None
        # at a speed of which the filters take nothing the wind turns the boat, and neither model
        is_taken = LEAST_RATIO <= ratio <= MOST_RATIO and rudder == rudder
        if not (0.0 < dt <= LONGEST_GAP_S and is_taken):
            self._begun, self._settled = None, time + SETTLES * self.ahead
        elif self._begun is not None:
            self._turned += wrap(heading - self._heading)
            for side in self._sides:
                side.move(ratio, dt, self._at - self._begun, (self._rudder, rudder))
            self._least, self._most = min(self._least, rudder), max(self._most, rudder)
            self._port, self._starboard = min(self._port, self._turned), max(self._starboard, self._turned)
            if time - self._begun >= self.ahead:
                outcome = self._end()
        if self._begun is None and time >= self._settled:
            self._begun, self._turned = time, 0.0
            self._least = self._most = rudder
            self._port = self._starboard = 0.0
            for side in self._sides:
                side.begin()
        self._at, self._rudder, self._heading = time, rudder, heading
        return outcome

    def _end(self) -> Outcome | None:
        self._begun = None
        if self._most - self._least < LEAST_RUDDER_RANGE_RAD or self._starboard - self._port < LEAST_TURNED_RAD:
            return None
        present, other = (side.motion[1] - self._turned for side in self._sides)
        rudder = max(self._most, -self._least)
        return None if abs(present - other) < LEAST_APART_RAD else Outcome(present, other, rudder)


LEAST_MOVED = 6.0
"""The rudder must have been away from its mean for so many stretches' time before a model is put forward."""
TURNS_RAD = tuple(map(math.radians, (5.0, 10.0, 20.0)))
"""What is doubted of a model is the heading after a stretch with the rudder put over by each of these."""
HARD_TURNS, FEEDBACK_OFF_RAD = 5, math.radians(1.0)
"""A model is proved only if it was tried with the largest of them, or all the rudder there is, less what a feedback is
off, in so many stretches, and was the better one there: turns with less rudder say little of the cubic damping that
holds a hard turn."""
MUCH_BETTER = 0.6
"""A candidate that is not a third of the way to its proof, and may by its doubt lie short of the point beyond which its
bets are won, is replaced when the doubt has shrunk to this share, and judged anew."""
TRIED = 24
"""So is one that has won nothing in the last so many bets."""

STRETCHES = 64
"""Outcomes kept: with stretches of a few seconds to half a minute, the last minutes of manoeuvring."""
CHANCE = 0.001
"""With this probability at most a model that is not better by as much is called proved between two adoptions."""
BETTER = 0.5
"""A model that is a little better in this weather may be worse in another, where the boat is not of the model's kind:
of what tells both models apart, what is adopted leaves less than half as much as the present one."""
BETS = np.array([0.1, 0.25, 0.5, 0.8, 0.98])

RUDDER_FRESH_S = 2.0
RATE_FRESH_S = 0.3
LOOKS_S = 5.0
"""Seconds between looks at what the filter holds."""
SPACING_S = 0.045
"""Headings that follow one another more quickly are not taken."""
SPIKE_RAD = math.radians(30.0)
RATE_MOST_RAD_S = 3.0


class Proposal(NamedTuple):
    """A model that was learnt, and how it did since.

    standard_errors by parameter, by what is known today; learnt from `moved` [s] in which the rudder was away from its
    mean; stretches predicted since it was put forward, each of `ahead` [s]; root mean square heading errors [rad] of
    the present model and the proposed one, with rudder up to `rudder` [rad]; wealth of the bets on it, and how much
    proves it; whether it was the better one in hard turns, too, which are those with `hard` [rad] of rudder.
    """

    model: Norrbin
    standard_errors: dict[str, float]
    moved: float
    stretches: int
    ahead: float
    present_error: float
    proposed_error: float
    wealth: float
    needed: float
    rudder: float = 0.0
    is_tried_hard: bool = True
    hard: float = TURNS_RAD[-1]

    @property
    def is_proved(self) -> bool:
        """Whether what came afterwards was as it predicts rather than as the present model does, by more than chance
        gives and in hard turns, too, and K and T have an interval: whether the boat is course-stable is known."""
        is_known = math.isfinite(worst_doubt(self.model, self.standard_errors))
        return self.wealth >= self.needed and self.is_tried_hard and is_known

    @property
    def verdict(self) -> str:
        """What the model is good for, from its intervals and its predictions."""
        worst = worst_doubt(self.model, self.standard_errors)
        share = f"K and T +- {100.0 * worst:.0f} % or better, 95 %"
        if worst > ENOUGH:
            share = "K and T by themselves are hardly known"
        if not self.is_proved:
            missing = "" if self.is_tried_hard else f" (turn with {math.degrees(self.hard):.0f} deg of rudder)"
            return f"not proved yet{missing}: {share}"
        if worst > ENOUGH:
            return f"predicts better, though {share}: turn or zigzag"
        return f"good, steer with it ({share})" if worst <= GOOD else f"good for a start ({share}): turn or zigzag"


def worst_doubt(model: Norrbin, errors: Mapping[str, float]) -> float:
    """Return how far the 95 % intervals of K and T reach at most, as a share."""
    return max(max(off_by(name, getattr(model, name), errors[name])) for name in ("gain", "time_constant"))


def is_better_in_hard_turns(outcomes: Iterable[Outcome], hard: float = TURNS_RAD[-1]) -> bool:
    """Return whether the other model was tried in turns with `hard` [rad] of rudder, and was the better one there."""
    tried = [each for each in outcomes if each.rudder >= hard - FEEDBACK_OFF_RAD]
    gained = sum(each.present**2 - each.other**2 for each in tried)
    return len(tried) >= HARD_TURNS and gained > 0.0


AT_ONCE = SteeringGear(math.pi, math.inf)


class _Candidate(NamedTuple):
    model: Norrbin
    moved: float
    doubt: float


class Learner:
    """Learns from ticks; see the module's docstring.

    chance: with which a model that is not better by as much may be called proved at most; rudder_max: all the rudder
    there is [rad]; gear: what moves it. n2 is not known to it.
    """

    def __init__(
        self, present: Norrbin, chance: float = CHANCE, rudder_max: float = math.inf, gear: SteeringGear = AT_ONCE
    ) -> None:
        self._chance, self._hard = chance, min(TURNS_RAD[-1], rudder_max)
        self._bounds = RudderBounds(gear)
        self.begin(present)

    def begin(self, present: Norrbin) -> None:
        """Forget everything and learn what differs from `present`."""
        self.present = present
        self._fit = LiveFilter(present)
        self._rudders: deque[tuple[float, float]] = deque(maxlen=16)
        self._rudder_time = -math.inf
        self._rate: tuple[float, float] | None = None
        self._last_motion = self._looked = self._worked = -math.inf
        self._candidate: _Candidate | None = None
        self._prediction_test: PredictionTest | None = None
        self._outcomes: deque[Outcome] = deque(maxlen=STRETCHES)
        self._candidates = 0
        self._wealth, self._bets, self._wealth_then, self._has_lost = np.ones(BETS.size), 0, 1.0, False
        self._proved: Proposal | None = None

    @property
    def moved(self) -> float:
        """For how long [s] the rudder was away from its mean so far: what there was to learn from."""
        return self._fit.moved_s

    @property
    def is_blown(self) -> bool:
        """Whether nothing is learnt as the rudder does too little beside what else pushes the boat."""
        return self._fit.is_blown

    @property
    def estimate(self) -> Norrbin:
        """What the filter holds for the boat now, whether or not it is worth proposing."""
        return learnt_model(self._fit, self.present)[0]

    def learn(self, tick: Tick, *, steered: bool) -> None:
        """Take a tick. `steered`: the rudder follows our orders; where nobody else tells what it does either, nothing
        is learnt, nor before the orders tell where it is."""
        state = tick.state
        if any(isinstance(sample, RudderSample) for sample in tick.samples):
            self._rudder_time = tick.now
        is_fed_back = tick.now - self._rudder_time <= RUDDER_FRESH_S
        if steered:
            self._bounds.order(tick.now, tick.command.angle)
        else:
            self._bounds.forget()
        if not state.valid or not (steered or is_fed_back):
            self._rudders.clear()
            return
        is_known = is_fed_back or self._bounds.is_known
        self._rudders.append((tick.now, state.rudder if is_known else math.nan))
        ratio = abs(state.speed) / self.present.reference_speed
        for sample in tick.samples:
            if isinstance(sample, RateSample):
                self._rate = (sample.time, sample.rate)
            elif isinstance(sample, HeadingSample) and abs(wrap(sample.heading - state.heading)) < SPIKE_RAD:
                self._take(sample, tick, ratio)

    def _rate_at(self, sample: HeadingSample) -> float | None:
        """Return the rate that came with a heading or just before it."""
        rate = sample.rate
        if rate is None and self._rate is not None and abs(sample.time - self._rate[0]) <= RATE_FRESH_S:
            rate = self._rate[1]
        return rate if rate is not None and abs(rate) <= RATE_MOST_RAD_S else None

    def _take(self, sample: HeadingSample, tick: Tick, ratio: float) -> None:
        time, heading, rate = min(sample.time, tick.now), sample.heading, self._rate_at(sample)
        if not time - self._last_motion > SPACING_S:
            return
        self._last_motion = time
        self.update(time, self._rudder_at(time), ratio, heading, rate)

    def update(self, time: float, rudder: float, ratio: float, heading: float, rate: float | None) -> None:
        """Take a heading [rad], with a rate [rad/s] where one is measured, and the rudder [rad] at `time` [s], nan
        where nobody knows it, at `ratio` times the reference speed."""
        self._fit.update(time, rudder, ratio, heading, rate)
        self._worked = time if self._fit.learns else self._worked
        if self._prediction_test is not None:
            outcome = self._prediction_test.update(time, rudder, ratio, heading, rate)
            if outcome is not None and time - self._worked <= self._prediction_test.ahead:
                self._judge(outcome)
        if time - self._looked >= LOOKS_S:
            self._looked = time
            self._put_forward()

    def _rudder_at(self, time: float) -> float:
        """Return the rudder [rad] at `time` [s], linear between ticks: headings are older than their tick."""
        later = self._rudders[-1]
        for earlier in reversed(self._rudders):
            if earlier[0] <= time:
                span = later[0] - earlier[0]
                share = min((time - earlier[0]) / span, 1.0) if span > 0.0 else 0.0
                return earlier[1] + share * (later[1] - earlier[1])
            later = earlier
        return later[1]

    def _put_forward(self) -> None:
        """Make the estimate the candidate if it is expected to win its bets, and there is none or one that is known
        much worse and is not winning."""
        if self._fit.moved_s < LEAST_MOVED * ahead_of(self.present, self.estimate):
            return
        doubt, off = doubts(self._fit, self.present)
        if doubt > off:
            return
        if self._candidate is not None:
            # a third of the way, as wealth multiplies
            is_winning = float(np.mean(self._wealth)) > self._needed ** (1.0 / 3.0)
            is_unsure = SURE_OF_IT * self._candidate.doubt > BETTER / (1.0 + BETTER) * off
            is_known_better = is_unsure and not is_winning and doubt <= MUCH_BETTER * self._candidate.doubt
            if not (is_known_better or self._has_lost):
                return
        model, _ = learnt_model(self._fit, self.present)
        self._candidate = _Candidate(model, self._fit.moved_s, doubt)
        self._prediction_test = PredictionTest(self.present, model)
        if self._candidates == 0 or float(np.mean((1.0 + BETS) ** self._bets)) >= self._needed:
            # one that could not have been proved yet, had it won every bet, has cost no chance
            self._candidates += 1
        self._wealth, self._bets, self._wealth_then, self._has_lost = np.ones(BETS.size), 0, 1.0, False
        self._outcomes.clear()

    def _judge(self, outcome: Outcome) -> None:
        """Take a stretch's errors; bet on it."""
        self._wealth = self._wealth * (1.0 + BETS * beyond(outcome, self._left()))
        self._outcomes.append(outcome)
        self._bets += 1
        wealth = float(np.mean(self._wealth))
        if self._bets % TRIED == 0:
            self._has_lost, self._wealth_then = wealth <= self._wealth_then, wealth
        if wealth >= self._needed:
            judged = self._judged()
            self._proved = judged if judged is not None and judged.is_proved else self._proved

    def _left(self) -> float:
        """Return what the candidate has left so far [rad], root mean square."""
        squares = [each.other**2 for each in self._outcomes]
        return math.sqrt((NOISE_RAD**2 + sum(squares)) / (1 + len(squares)))

    @property
    def _needed(self) -> float:
        return self._candidates * (self._candidates + 1) / self._chance

    def proposal(self) -> Proposal | None:
        """Return what is put forward, None as long as nothing is: the latest that has proved itself, or else the one
        that is being judged."""
        return self._proved or self._judged()

    def _judged(self) -> Proposal | None:
        if self._candidate is None or self._prediction_test is None:
            return None
        count = len(self._outcomes)
        squares = [sum(each[i] ** 2 for each in self._outcomes) / count if count else math.nan for i in (0, 1)]
        return Proposal(
            model=self._candidate.model,
            standard_errors=errors_of(self._candidate.model, self._fit),
            moved=self._candidate.moved,
            stretches=count,
            ahead=self._prediction_test.ahead,
            present_error=math.sqrt(squares[0]),
            proposed_error=math.sqrt(squares[1]),
            wealth=float(np.mean(self._wealth)),
            needed=self._needed,
            rudder=max((each.rudder for each in self._outcomes), default=0.0),
            is_tried_hard=is_better_in_hard_turns(self._outcomes, self._hard),
            hard=self._hard,
        )


def doubts(fit: LiveFilter, present: Norrbin) -> tuple[float, float]:
    """Return what the filter doubts of its own turns, and how far the present model's are from them (root mean squares
    over TURNS_RAD), as shares of the larger of both models' turns."""
    (a, b, d), covariance = fit.estimate.values[:3], fit.estimate.covariance[:3, :3]
    if not (np.diag(covariance) > 0.0).all():
        # rounding has left nothing to doubt it by
        return math.inf, 0.0
    ahead = ahead_of(present, _model(a, b, d))
    turned = _turned(_model(a, b, d), ahead)
    off = _turned(present, ahead) - turned
    errors = np.sqrt(np.diag(covariance))
    sizes, axes = np.linalg.eigh(covariance / np.outer(errors, errors))
    # rounding may have left a size below 0, of which there is no root
    roots = errors * np.linalg.cholesky((np.maximum(sizes, ROUNDING) * axes) @ axes.T).T
    doubt = sum((_turned(_model(a + da, b + db, max(d + dd, 0.0)), ahead) - turned) ** 2 for da, db, dd in roots)
    size = np.maximum(np.abs(turned), np.abs(turned + off)) ** 2
    return math.sqrt(float(np.mean(doubt / size))), math.sqrt(float(np.mean(off**2 / size)))


def _model(a: float, b: float, d: float) -> Norrbin:
    T = 1.0 / max(abs(b), 1.0e-6)
    return Norrbin(a * T, T, d * T, n1=math.copysign(1.0, b))


def _turned(model: Norrbin, ahead: float) -> NDArray[np.float64]:
    """Return by how much [rad] it turns in `ahead` [s] from a straight course with the rudder at each of TURNS_RAD."""
    boat = model._replace(n0=0.0)
    return np.array([moved_on(boat, 1.0, (0.0, 0.0), ahead, (angle, angle))[1] for angle in TURNS_RAD])


def learnt_model(fit: LiveFilter, present: Norrbin) -> tuple[Norrbin, dict[str, float]]:
    """Return what the filter holds in Norrbin's convention, with n0 as it is, and the standard errors, infinite where
    n1/T cannot be parted from 0."""
    learnt = _model(*fit.estimate.values[:3].tolist())
    model = present._replace(gain=learnt.gain, time_constant=learnt.time_constant, n3=learnt.n3, n1=learnt.n1)
    return model, errors_of(model, fit)


def errors_of(model: Norrbin, fit: LiveFilter) -> dict[str, float]:
    """Return the standard errors of a model by what the filter holds and how far the model is off that, infinite where
    n1/T cannot be parted from 0."""
    T, sign = model.time_constant, math.copysign(1.0, model.n1)
    a, b, d = rates = model.gain / T, sign / T, model.n3 / T
    off = np.array(rates) - fit.estimate.values[:3]
    known = fit.estimate.covariance[:3, :3] + np.outer(off, off)
    if not known[1, 1] > 0.0 or abs(b) < SURE_OF_IT * math.sqrt(known[1, 1]):
        return {"gain": math.inf, "time_constant": math.inf, "n3": math.inf}
    slopes = {"gain": (T, -sign * a * T * T, 0.0), "time_constant": (0.0, -sign * T * T, 0.0)}
    slopes["n3"] = (0.0, -sign * d * T * T, T)
    return {name: math.sqrt(max(float(np.array(by) @ known @ np.array(by)), 0.0)) for name, by in slopes.items()}
