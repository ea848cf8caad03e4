"""Learning while sailing: a filter fed with the ticks, and a candidate model that must predict what comes.

It only proposes. A model whose K and T the filter (`live_filter`) knows well enough is put forward as a candidate, and
from that moment on both it and the present model predict the boat's heading, stretch by stretch, from the rudder alone:
what they are judged by is what the candidate has not learnt from. A bet is made on each stretch, that the candidate's
error is less than a share m = BETTER of the present model's: with e0 and e1 the errors of the present model and of the
candidate and

    x = (m^2 e0^2 - e1^2)/(m^2 e0^2 + e1^2)
    wealth = mean over l of the product of (1 + l x) over all stretches so far

a candidate that is no better than that makes no wealth: that it ever has more than w is less probable than 1/w, however
often one looks (Ville's inequality; Shafer 2021, Waudby-Smith and Ramdas 2024). It has proved itself when its wealth is
above k (k + 1)/CHANCE, k counting the candidates, so that all together are wrong with less than CHANCE.

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
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from autopilot.angles import wrap
from autopilot.identification.interval import ENOUGH, GOOD, SURE_OF_IT, off_by
from autopilot.identification.live_filter import GUST_TIME_S, USUAL_COMPASS, LiveFilter, Push, moved_on
from autopilot.models.norrbin import Norrbin
from autopilot.signals import HeadingSample, RateSample, RudderSample, Tick

AHEAD_TIME_CONSTANTS, AHEAD_SHORTEST_S, AHEAD_LONGEST_S = 4.0, 3.0, 30.0
"""A stretch is this many time constants long, within these limits: long enough for the models to differ."""

LONGEST_GAP_S = 2.0
LEAST_RUDDER_RANGE_RAD, LEAST_TURNED_RAD = math.radians(3.0), math.radians(8.0)
"""A stretch in which rudder or boat turned less tells nothing of either model: a rudder that only answers gusts, so
that nothing turns, would speak for the model on which it does least."""
LEAST_APART_RAD = 2.0 * math.sqrt(2.0) * USUAL_COMPASS
"""Nor does one at whose end both models predict the same heading, within two standard deviations of the noise of the
two headings that it is seen by: what is compared there is the noise. The bets stay fair: both predict from the
rudder, and not from the heading that decides the bet."""
SETTLES = 2.0
"""Stretches' worth of time in which the filters find gust and trim."""


class Outcome(NamedTuple):
    """Heading errors [rad] at a stretch's end: of the present model and of the other."""

    present: float
    other: float


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
        longest = max(present.time_constant, other.time_constant)
        self.ahead = min(max(AHEAD_TIME_CONSTANTS * longest, AHEAD_SHORTEST_S), AHEAD_LONGEST_S)
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
        if not 0.0 < dt <= LONGEST_GAP_S:
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
        return None if abs(present - other) < LEAST_APART_RAD else Outcome(present, other)


LEAST_MOVED_S = 20.0
"""The rudder must have been away from its mean for so long before a model is put forward."""
MUCH_BETTER = 0.6
"""A candidate that is not winning is replaced when the standard errors have shrunk to this share, and judged anew."""

STRETCHES = 64
"""Outcomes kept: with stretches of a few seconds to half a minute, the last minutes of manoeuvring."""
CHANCE = 0.02
"""With this probability at most a model that does not halve the error is called proved between two adoptions."""
BETTER = 0.5
"""A model that is a little better in this weather may be worse in another, where the boat is not of the model's kind:
what is adopted has less than half the error."""
BETS = np.array([0.1, 0.25, 0.5, 0.8, 0.98])

RUDDER_FRESH_S = 2.0
RATE_FRESH_S = 0.3
LOOKS_S = 1.0
"""Seconds between looks at what the filter holds."""
SPACING_S = 0.045
"""Headings that follow one another more quickly are not taken."""
SPIKE_RAD = math.radians(30.0)
RATE_MOST_RAD_S = 3.0


class Proposal(NamedTuple):
    """A model that was learnt, and how it did since.

    standard_errors by parameter; learnt from `moved` [s] in which the rudder was away from its mean; stretches
    predicted since it was put forward, each of `ahead` [s]; root mean square heading errors [rad] of the present model
    and the proposed one; wealth of the bets on it, and how much proves it.
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

    @property
    def is_proved(self) -> bool:
        """Whether it predicted what came afterwards with BETTER times the present model's error or less, by more than
        chance gives."""
        return self.wealth >= self.needed

    @property
    def verdict(self) -> str:
        """What the model is good for, from its intervals and its predictions."""
        worst = worst_doubt(self.model, self.standard_errors)
        share = f"K and T +- {100.0 * worst:.0f} % or better, 95 %"
        if not self.is_proved:
            return f"not proved yet: {share}"
        return f"good, steer with it ({share})" if worst <= GOOD else f"good for a start ({share}): turn or zigzag"


def worst_doubt(model: Norrbin, errors: Mapping[str, float]) -> float:
    """Return how far the 95 % intervals of K and T reach at most, as a share."""
    return max(max(off_by(name, getattr(model, name), errors[name])) for name in ("gain", "time_constant"))


class _Candidate(NamedTuple):
    model: Norrbin
    standard_errors: dict[str, float]
    moved: float


class Learner:
    """Learns from ticks; see the module's docstring.

    chance: with which a model that does not halve the error may be called proved at most. n2 is not known to it.
    """

    def __init__(self, present: Norrbin, chance: float = CHANCE) -> None:
        self._chance = chance
        self.begin(present)

    def begin(self, present: Norrbin) -> None:
        """Forget everything and learn what differs from `present`."""
        self.present = present
        self._fit = LiveFilter(present)
        self._rudders: deque[tuple[float, float]] = deque(maxlen=16)
        self._rudder_time = -math.inf
        self._rate: tuple[float, float] | None = None
        self._last_motion = self._looked = -math.inf
        self._candidate: _Candidate | None = None
        self._prediction_test: PredictionTest | None = None
        self._outcomes: deque[Outcome] = deque(maxlen=STRETCHES)
        self._candidates = 0
        self._wealth = np.ones(BETS.size)
        self._proved: Proposal | None = None

    @property
    def moved(self) -> float:
        """For how long [s] the rudder was away from its mean so far: what there was to learn from."""
        return self._fit.moved_s

    @property
    def estimate(self) -> Norrbin:
        """What the filter holds for the boat now, whether or not it is worth proposing."""
        return learnt_model(self._fit, self.present)[0]

    def learn(self, tick: Tick, *, steered: bool) -> None:
        """Take a tick. `steered`: the rudder follows our orders; where nobody else tells what it does either, nothing
        is learnt."""
        state = tick.state
        if any(isinstance(sample, RudderSample) for sample in tick.samples):
            self._rudder_time = tick.now
        if not state.valid or not (steered or tick.now - self._rudder_time <= RUDDER_FRESH_S):
            self._rudders.clear()
            return
        self._rudders.append((tick.now, state.rudder))
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
        """Take a heading [rad], with a rate [rad/s] where one is measured, and the rudder [rad] at `time` [s], at
        `ratio` times the reference speed."""
        self._fit.update(time, rudder, ratio, heading, rate)
        outcome = None
        if self._prediction_test is not None:
            outcome = self._prediction_test.update(time, rudder, ratio, heading, rate)
        if outcome is not None:
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
        """Make the estimate the candidate where there is none, or it is known much better than the candidate was."""
        if self._fit.moved_s < LEAST_MOVED_S:
            return
        model, errors = learnt_model(self._fit, self.present)
        if worst_doubt(model, errors) > ENOUGH:
            return
        if self._candidate is not None:
            before = self._candidate.standard_errors
            is_winning = float(np.mean(self._wealth)) > 1.0
            if is_winning or any(errors[name] > MUCH_BETTER * before[name] for name in ("gain", "time_constant")):
                return
        self._candidate = _Candidate(model, errors, self._fit.moved_s)
        self._prediction_test = PredictionTest(self.present, model)
        if self._candidates == 0 or self._outcomes:
            # one on which no bet was made has cost no chance
            self._candidates += 1
        self._wealth = np.ones(BETS.size)
        self._outcomes.clear()

    def _judge(self, outcome: Outcome) -> None:
        """Take a stretch's errors; bet on it."""
        self._outcomes.append(outcome)
        present, other = (BETTER * outcome.present) ** 2, outcome.other**2
        if present + other > 0.0:
            self._wealth = self._wealth * (1.0 + BETS * (present - other) / (present + other))
        judged = self._judged()
        if judged is not None and judged.is_proved:
            self._proved = judged

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
            standard_errors=self._candidate.standard_errors,
            moved=self._candidate.moved,
            stretches=count,
            ahead=self._prediction_test.ahead,
            present_error=math.sqrt(squares[0]),
            proposed_error=math.sqrt(squares[1]),
            wealth=float(np.mean(self._wealth)),
            needed=self._candidates * (self._candidates + 1) / self._chance,
        )


def learnt_model(fit: LiveFilter, present: Norrbin) -> tuple[Norrbin, dict[str, float]]:
    """Return what the filter holds in Norrbin's convention, with n0 as it is, and the standard errors, infinite where
    n1/T cannot be parted from 0."""
    (a, b, d, _), covariance = fit.estimate.values.tolist(), fit.estimate.covariance
    sign, size = math.copysign(1.0, b), max(abs(b), 1.0e-6)
    T = 1.0 / size
    model = present._replace(gain=a * T, time_constant=T, n3=d * T, n1=sign)
    known = covariance[:3, :3]
    if size < SURE_OF_IT * math.sqrt(known[1, 1]):
        return model, {"gain": math.inf, "time_constant": math.inf, "n3": math.inf}
    slopes = {"gain": (T, -sign * a * T * T, 0.0), "time_constant": (0.0, -sign * T * T, 0.0)}
    slopes["n3"] = (0.0, -sign * d * T * T, T)
    errors = {name: math.sqrt(max(float(np.array(by) @ known @ np.array(by)), 0.0)) for name, by in slopes.items()}
    return model, errors
