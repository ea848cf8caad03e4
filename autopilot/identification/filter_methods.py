"""The extended Kalman filter and the feedback particle filter behind the interface of all methods.

Passes of a filter over the runs until nothing moves any more: what the filter methods have in common.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.feedback_particle import (
    Case,
    Found,
    Gaussian,
    Moved,
    Steps,
    by_constant_gain,
    by_particle_filter,
)
from autopilot.identification.identified import LARGEST_RELATIVE_ERROR, Convergence, Identified, Question
from autopilot.identification.identified import Steps as ProgressSteps
from autopilot.identification.identify import sources_of
from autopilot.identification.methods import Method, begin, identified_as
from autopilot.identification.norrbin_filter import HELD_STEPS_PER_TIME_CONSTANT as HELD
from autopilot.identification.norrbin_filter import (
    NAMES,
    Innovations,
    RunNoise,
    Separated,
    beliefs,
    covariance_of,
    disturbance_intensity,
    entered,
    instruments,
    model_of,
    passage,
    prior_about,
    segment_steps,
    stacked,
    yaw_case,
)
from autopilot.identification.norrbin_filter import STEPS_PER_TIME_CONSTANT as RUNNING
from autopilot.identification.residuals import typical_rate
from autopilot.identification.runs import FloatArray, Run, Segment, shortest_time_constant
from autopilot.models.norrbin import Norrbin

PASSES = 10
"""At most: each is linearised where the one before ended; fewer where nothing moves any more."""

SETTLED = 0.1
"""Of a standard deviation: what moves by less has settled."""

ALIKE = 0.8
"""Where the disturbance intensity moves by less of its logarithm, a step of the ladder, it is known."""

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
            innovations = self._linearised(model, noise, cubic)
            estimates, covariance = beliefs(stacked(innovations), about, prior)
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
        return Passed(estimates[-1], covariance_of(innovations, off, prior.covariance), convergence)

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
            return RunNoise(disturbance_intensity(model, self.unit, passages, near), *sizes)
        except (OverflowError, ValueError, ZeroDivisionError) as error:
            raise self._lost() from error

    def _linearised(self, model: Norrbin, noise: RunNoise, cubic: bool) -> list[Innovations]:
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
        models = [[getattr(self.model(row), key) for key in NAMES] for row in np.concatenate(rows)]
        return Convergence(np.concatenate(times), NAMES, np.array(models))


PARTICLES = 300
SEED = 2019
"""The same runs give the same model."""

BY_CHANCE = (
    "fpf's standard errors take how far it ended from the Kalman filter on the same record for its errors by chance, "
    "which in gusts can be the larger part; hold it against ekf."
)


def kalman_filter(runs: Sequence[Run], question: Question) -> Identified:
    """Return the last belief of the extended Kalman filter with the parameters as states; see `Method`. n3 is held at 0
    where it cannot be determined."""
    return _identify(runs, question, None, "ekf")


def particle_filter(runs: Sequence[Run], question: Question, moved: Moved = by_constant_gain) -> Identified:
    """Return the last belief of the feedback particle filter, the parameters as states; see `Method`. n3 is held at 0
    where it cannot be determined. moved: how a gain moves the particles."""
    random = np.random.default_rng(SEED)

    def filtered(case: Case, steps: Steps) -> Found:
        return by_particle_filter(case, steps, PARTICLES, random, moved)

    return _identify(runs, question, filtered, "fpf")


def _identify(runs: Sequence[Run], question: Question, filter_: Filter | None, name: str) -> Identified:
    found = begin(runs, question).model
    start = found if question.start is None else question.start
    cubic = question.kind == "norrbin" or question.course_unstable
    steps = ProgressSteps(question.progress, total=PASSES)
    segments = [segment for run in runs for segment in run.segments]
    unit, shortest = typical_rate(segments), shortest_time_constant(segments)
    passes = Passes(runs, unit, start if cubic else start._replace(n3=0.0), name, steps, shortest)
    result, reasons = passes.kalman(cubic), {}
    if cubic and not _determines_n3(result):
        reason = _undetermined(result, unit)
        if question.course_unstable:
            raise InputError(f"{sources_of(runs)}: a course-unstable boat has no steady turn without n3, but {reason}.")
        reasons["n3"] = (
            f"{reason}, so it is held at 0; steady turns at large rudder angles would tell it (--steady-turns)."
        )
        passes = passes._replace(start=start._replace(n3=0.0))
        result = passes.kalman(False)
    if filter_ is not None:
        result = passes.filtered(result, filter_)
    notes = [] if filter_ is None else [BY_CHANCE]
    if question.steady_turns is not None:
        notes.append(f"{name} does not use the steady turns.")
    return _identified(passes, result, reasons, notes)


def _determines_n3(result: Passed) -> bool:
    return bool(np.sqrt(result.covariance[-1, -1]) <= LARGEST_RELATIVE_ERROR * result.mean[-1])


def _undetermined(result: Passed, unit: float) -> str:
    value, error = float(result.mean[-1]) / unit**2, float(result.covariance[-1, -1]) ** 0.5 / unit**2
    return f"n3: {value:.3g} with a standard error of {error:.2g} s^2/rad^2 cannot be distinguished from 0"


def _identified(passes: Passes, result: Passed, reasons: dict[str, str], notes: list[str]) -> Identified:
    model, free = passes.model(result.mean), NAMES[: result.mean.size]
    scale = np.array([model.gain, model.time_constant, passes.unit, passes.unit**-2])[: len(free)]
    covariance = result.covariance * np.outer(scale, scale)
    errors = dict(zip(free, np.sqrt(np.diag(covariance)).tolist(), strict=True))
    for key, symbol, what in (("gain", "K", "1/s"), ("time_constant", "T", "s")):
        if errors[key] > LARGEST_RELATIVE_ERROR * getattr(model, key):
            reasons[symbol] = (
                f"{symbol}: {getattr(model, key):.3g} with a standard error of {errors[key]:.2g} {what} is not "
                "determined by these runs; record a zigzag in which the rudder goes over several times."
            )
    found = identified_as(
        model, passes.runs, errors, unidentifiable=reasons, notes=notes, convergence=result.convergence
    )
    return found._replace(free=free, covariance=covariance)


METHODS = (
    Method(
        "ekf",
        "extended Kalman filter over heading, rate and parameters; knows gusts from instrument noise",
        kalman_filter,
    ),
    Method(
        "fpf",
        "feedback particle filter (Zheng et al. 2019), 300 particles",
        particle_filter,
    ),
)
