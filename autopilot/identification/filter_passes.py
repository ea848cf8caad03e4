"""Passes of a filter over the runs until nothing moves any more: what the filter methods have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.filters.kalman import Gaussian
from autopilot.identification.gust_strength import RunNoise, gust_strength, instruments
from autopilot.identification.identified import Convergence
from autopilot.identification.identified import Steps as ProgressSteps
from autopilot.identification.identify import sources_of
from autopilot.identification.norrbin_case import HELD_STEPS_PER_TIME_CONSTANT as HELD
from autopilot.identification.norrbin_case import (
    NAMES,
    entered,
    model_of,
    passage,
    prior_about,
    segment_steps,
    yaw_case,
)
from autopilot.identification.norrbin_case import STEPS_PER_TIME_CONSTANT as RUNNING
from autopilot.identification.recursive import Case, Found, Steps
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.identification.separated_filter import Innovations, Separated, beliefs, covariance_of, together_told
from autopilot.models.norrbin import Norrbin

PASSES = 10
"""At most: each is linearised where the one before ended; fewer where nothing moves any more."""

SETTLED = 0.1
"""Of a standard deviation: what moves by less has settled."""

ALIKE = 0.8
"""Where the gusts' strength moves by less of its logarithm, a step of the ladder, it is known."""

LARGEST_MOVE = 1.0
"""Of ln K, ln T, n0/w and n3 w^2 from pass to pass."""

MODESTY = 10.0
"""How many standard deviations particles begin with: the nearer, the more linear."""

Filter = Callable[[Case, Steps], Found]


class Passed(NamedTuple):
    """What the last pass gave: mean, shape (p,), and covariance of the parameters in the state's units, and how they
    came there."""

    mean: FloatArray
    covariance: FloatArray
    convergence: Convergence


class Passes(NamedTuple):
    """Passes over `runs` from the model `start`; unit: the typical rate; method: what calls itself so; shortest: the
    shortest time constant [s] that the runs can tell."""

    runs: Sequence[Run]
    unit: float
    start: Norrbin
    method: str
    steps: ProgressSteps
    shortest: float

    def kalman(self, cubic: bool) -> Passed:
        """Return what the Kalman filter ends with, its covariance that of scores which may remember. Raises
        InputError where it loses the boat."""
        prior = self._prior(cubic)
        about, noise, weighed = prior.mean, self._noise(self.model(prior.mean)), False
        for _ in range(PASSES):
            model = self.model(about)
            told = self._told(model, noise, cubic)
            estimates, covariance = beliefs(together_told(told), about, prior)
            self._check(estimates)
            off = estimates[-1] - about
            far = float(np.max(np.abs(off) / np.sqrt(np.diag(covariance))))
            self.steps.next()
            if far <= SETTLED and weighed:
                break
            about = about + np.clip(off, -LARGEST_MOVE, LARGEST_MOVE)
            about[1] = max(about[1], math.log(self.shortest))
            # a strength found far from the end says nothing of the end
            before, noise = noise, self._noise(self.model(about), noise.process)
            weighed = abs(math.log(noise.process / before.process)) < ALIKE
        convergence = self._convergence(estimates, model)
        return Passed(estimates[-1], covariance_of(told, off, prior.covariance), convergence)

    def filtered(self, kalman: Passed, filter_: Filter) -> Passed:
        """Return what another filter makes of the record from where the Kalman filter ended, far less sure: the record
        counts only once. What lies between the two counts as an error of chance."""
        cubic, model = kalman.mean.size == len(NAMES), self.model(kalman.mean)
        widest = np.diag(self._prior(cubic).covariance)
        spread = np.minimum(widest, MODESTY**2 * np.diag(kalman.covariance))
        belief, noise, estimates = Gaussian(kalman.mean, np.diag(spread)), self._noise(model), []
        for segment in self._segments():
            case = entered(yaw_case(belief, cubic), segment, model, noise, self.unit)
            found = self._found(filter_, case, segment_steps(segment, model, self.unit, HELD)[0])
            belief = Gaussian(found.estimate[-1], found.covariance)
            estimates.append(found.estimate)
        self.steps.next()
        off = belief.mean - kalman.mean
        convergence = self._convergence(np.concatenate(estimates), model, HELD)
        return Passed(belief.mean, kalman.covariance + np.diag(off * off), convergence)

    def model(self, values: FloatArray) -> Norrbin:
        """Return the model that parameters in the state's units stand for, T held where the samples can tell it."""
        model = model_of(values, self.start, self.unit)
        return model._replace(time_constant=max(model.time_constant, self.shortest))

    def _prior(self, cubic: bool) -> Gaussian:
        return prior_about(self.start, self.unit, cubic)

    def _segments(self) -> list[Segment]:
        return [segment for run in self.runs for segment in run.segments]

    def _noise(self, model: Norrbin, near: float | None = None) -> RunNoise:
        sizes = instruments(model, self.runs)
        passages = [passage(segment, model, sizes, self.unit) for segment in self._segments()]
        try:
            return RunNoise(gust_strength(model, self.unit, passages, near), *sizes)
        except (OverflowError, ValueError, ZeroDivisionError) as error:
            raise self._lost() from error

    def _told(self, model: Norrbin, noise: RunNoise, cubic: bool) -> list[Innovations]:
        filter_ = Separated(model, self.unit, cubic, noise.process)
        sizes = noise.rate, noise.heading
        try:
            return [filter_.innovations(passage(each, model, sizes, self.unit)) for each in self._segments()]
        except (OverflowError, ValueError, ZeroDivisionError) as error:
            raise self._lost() from error

    def _found(self, filter_: Filter, case: Case, steps: Steps) -> Found:
        try:
            with np.errstate(all="ignore"):
                found = filter_(case, steps)
        except np.linalg.LinAlgError as error:
            raise self._lost() from error
        self._check(found.estimate)
        return found

    def _check(self, estimates: FloatArray) -> None:
        if not np.isfinite(estimates[-1]).all():
            raise self._lost()

    def _lost(self) -> InputError:
        boat = "boat" if self.start.n1 > 0.0 else "course-unstable boat"
        return InputError(f"{sources_of(self.runs)}: {self.method} loses the {boat}; use --method output-error.")

    def _convergence(self, estimates: FloatArray, model: Norrbin, per_memory: float = RUNNING) -> Convergence:
        """Return the models at the steps that end with a measurement; the segments' steps lie one after the other."""
        times, rows, begun, first = [], [], 0.0, 0
        for segment in self._segments():
            steps, last, time = segment_steps(segment, model, self.unit, per_memory)
            times.append(begun + time)
            rows.append(estimates[first + last])
            begun, first = begun + float(segment.time[-1] - segment.time[0]), first + steps.dt.size
        told = [[getattr(self.model(row), key) for key in NAMES] for row in np.concatenate(rows)]
        return Convergence(np.concatenate(times), NAMES, np.array(told))
