"""Learning while sailing: the integral method fed with the ticks, and a candidate model that must predict what comes.

It only proposes. A model that the windows tell well enough is put forward as a candidate, and from that moment on
both it and the present model predict the boat's heading, stretch by stretch, from the rudder alone: what they are
judged by is what the candidate has not learnt from. Memory is constant: `integral_fit`, the last few rudder angles,
one running prediction, and the outcomes of the last `STRETCHES` stretches.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.identification.integral_fit import ENOUGH, IntegralFit
from autopilot.identification.model_choice import Outcome, PredictionTest
from autopilot.models.norrbin import Norrbin
from autopilot.signals import HeadingSample, Mode, OrderKind, RateSample, RudderSample, Tick

WORTH_PROPOSING = 0.1
"""K and T must be known to this share before a model is put forward."""

MUCH_BETTER = 0.5
"""A candidate is replaced when the standard errors have shrunk to this share; it is then judged anew."""

STRETCHES = 64
"""Outcomes kept: with stretches of a few seconds to half a minute, the last minutes of manoeuvring."""

LEAST_STRETCHES = 3
BETTER = 0.95
"""The proposed model's root mean square error must be below this share of the present one's."""

RUDDER_FRESH_S = 2.0
RATE_FRESH_S = 0.3
SPIKE_RAD = math.radians(30.0)
RATE_MOST_RAD_S = 3.0


class Proposal(NamedTuple):
    """A model that was learnt, and how it did since.

    standard_errors by parameter; windows it was learnt from, each of `length` [s]; stretches predicted since it was put
    forward, each of `ahead` [s]; root mean square heading errors [rad] of the present model and the proposed one.
    """

    model: Norrbin
    standard_errors: dict[str, float]
    windows: int
    length: float
    stretches: int
    ahead: float
    present_error: float
    proposed_error: float

    @property
    def is_proved(self) -> bool:
        """Whether it predicted what came afterwards clearly better than the present model."""
        return self.stretches >= LEAST_STRETCHES and self.proposed_error < BETTER * self.present_error


class _Candidate(NamedTuple):
    model: Norrbin
    standard_errors: dict[str, float]
    windows: int


class Learner:
    """Learns from ticks; see the module's docstring.

    Raises ValueError for a present model with n2, which the method does not know.
    """

    def __init__(self, present: Norrbin) -> None:
        self.begin(present)

    def begin(self, present: Norrbin) -> None:
        """Forget everything and learn what differs from `present`."""
        self.present = present
        self._fit = IntegralFit(present)
        self._rudders: deque[tuple[float, float]] = deque(maxlen=16)
        self._rudder_time = -math.inf
        self._rate: tuple[float, float] | None = None
        self._last_motion = -math.inf
        self._candidate: _Candidate | None = None
        self._prediction_test: PredictionTest | None = None
        self._outcomes: deque[Outcome] = deque(maxlen=STRETCHES)
        self._proved: Proposal | None = None

    @property
    def windows(self) -> int:
        """How many windows carried information so far."""
        return self._fit.windows

    @property
    def estimate(self) -> Norrbin:
        """What the fit holds for the boat now, whether or not it is worth proposing."""
        return self._fit.model

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
        if not time > self._last_motion:
            return
        self._last_motion = time
        rudder = self._rudder_at(time)
        is_steered = tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING
        added = self._fit.update(time, rudder, ratio, heading, rate, tick.reference if is_steered else None)
        self._judge(time, rudder, ratio, heading, rate)
        if added is not None:
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
        if self._fit.windows < ENOUGH:
            return
        model, errors = self._fit.model, self._fit.standard_errors()
        shares = [errors[name] / getattr(model, name) for name in ("gain", "time_constant")]
        if max(shares) > WORTH_PROPOSING:
            return
        if self._candidate is not None:
            before = self._candidate.standard_errors
            if any(errors[name] > MUCH_BETTER * before[name] for name in ("gain", "time_constant")):
                return
        self._candidate = _Candidate(model, errors, self._fit.windows)
        self._prediction_test = PredictionTest(self.present, model)
        self._outcomes.clear()

    def _judge(self, time: float, rudder: float, ratio: float, heading: float, rate: float | None) -> None:
        if self._prediction_test is not None:
            outcome = self._prediction_test.update(time, rudder, ratio, heading, rate, self._fit.moved_by)
            if outcome is not None:
                self._outcomes.append(outcome)
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
            windows=self._candidate.windows,
            length=self._fit.length,
            stretches=count,
            ahead=self._prediction_test.ahead,
            present_error=math.sqrt(squares[0]),
            proposed_error=math.sqrt(squares[1]),
        )
