"""The extended Kalman filter and the feedback particle filter behind the interface of all methods."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import LARGEST_RELATIVE_ERROR, Convergence, Identified
from autopilot.identification.identified import Steps as ProgressSteps
from autopilot.identification.identify import sources_of
from autopilot.identification.methods import Question, begin, identified_as
from autopilot.identification.norrbin_case import (
    NAMES,
    RunNoise,
    entered,
    model_of,
    run_noise,
    segment_steps,
    yaw_case,
)
from autopilot.identification.recursive import Case, Found, Steps, by_kalman_filter, by_particle_filter
from autopilot.identification.residuals import typical_rate
from autopilot.identification.runs import FloatArray, Run
from autopilot.models.norrbin import Norrbin

PARTICLES = 300
SEED = 2019
"""The same runs give the same model."""

PASSES = 4
"""Each pass takes noise and linearisation from the model of the one before; all but the last are the extended Kalman
filter's."""

MODESTY = 10.0
"""How many of the last pass's standard deviations the next one begins with: the nearer, the more linear."""

PASSES_WITHOUT_N3 = 2
"""After n3 is dropped."""

BY_CHANCE = (
    "fpf's standard errors leave out the errors that its particles make by chance, which on a long record in gusts can "
    "be the larger part; hold it against ekf."
)

TOO_SURE = (
    "{}'s standard errors take its noise for known and the rudder for exact: on a slow boat (T of 5 s) its 95 % "
    "intervals held the truth in only half of the trials without gusts; output-error's hold."
)

Filter = Callable[[Case, Steps], Found]


class _Pass(NamedTuple):
    """What one way through the runs gave: the model, the covariance in the state's units, and how it came there."""

    model: Norrbin
    covariance: FloatArray
    convergence: Convergence


class KalmanMethod:
    """The extended Kalman filter with the parameters as states."""

    name = "ekf"
    summary = "extended Kalman filter over heading, rate and parameters; knows gusts from instrument noise"

    def identify(self, runs: Sequence[Run], question: Question) -> Identified:
        """Return the filter's last belief; see `Method.identify`. n3 is held at 0 where it cannot be told."""
        return _identify(runs, question, by_kalman_filter, self.name)


class ParticleMethod:
    """The feedback particle filter with constant gain, the parameters as states."""

    name = "fpf"
    summary = "feedback particle filter, 300 particles, constant gain; an ensemble Kalman filter (Zheng et al. 2019)"

    def identify(self, runs: Sequence[Run], question: Question) -> Identified:
        """Return the filter's last belief; see `Method.identify`. n3 is held at 0 where it cannot be told."""
        random = np.random.default_rng(SEED)
        return _identify(
            runs, question, lambda case, steps: by_particle_filter(case, steps, PARTICLES, random), self.name
        )


def _identify(runs: Sequence[Run], question: Question, filter_: Filter, name: str) -> Identified:
    found = begin(runs, question).model
    start = found if question.start is None else question.start
    cubic = question.kind == "norrbin" or question.course_unstable
    steps = ProgressSteps(question.progress, total=PASSES + (PASSES_WITHOUT_N3 if cubic else 0))
    unit = typical_rate([segment for run in runs for segment in run.segments])
    search = _Search(runs, unit, filter_, name, steps)
    result = search.passes(start, run_noise(found, runs), cubic, PASSES)
    reasons = {}
    # the logarithm's standard deviation is the relative error
    error = float(np.sqrt(result.covariance[-1, -1])) if cubic else 0.0
    if cubic and not question.course_unstable and error > LARGEST_RELATIVE_ERROR:
        n3 = result.model.n3
        reasons["n3"] = (
            f"n3: {n3:.3g} with a standard error of {error * n3:.2g} s^2/rad^2 cannot be told from 0, so it is held at "
            "0; steady turns at large rudder angles would tell it (--steady-turns)."
        )
        linear = result.model._replace(n3=0.0)
        result = search.passes(linear, run_noise(linear, runs), False, PASSES_WITHOUT_N3)
    return _identified(runs, result, unit, reasons, question, name)


class _Search(NamedTuple):
    """What all passes have in common; unit: the typical rate."""

    runs: Sequence[Run]
    unit: float
    filter_: Filter
    name: str
    steps: ProgressSteps

    def passes(self, start: Norrbin, noise: RunNoise, cubic: bool, count: int) -> _Pass:
        """Return the last of `count` passes, each begun where the one before ended."""
        narrow: FloatArray | None = None
        for done in range(count):
            case = yaw_case(start, self.unit, noise, cubic, narrow)
            result = self._through(case, start, noise, self.filter_ if done + 1 == count else by_kalman_filter)
            # but far less sure of it: the record counts only once
            start, narrow = result.model, MODESTY * np.sqrt(np.diag(result.covariance))
            noise = run_noise(start, self.runs)
            self.steps.next()
        return result

    def _through(self, case: Case, start: Norrbin, noise: RunNoise, filter_: Filter) -> _Pass:
        """Filter one segment after the other; between them only the belief about the parameters is kept."""
        times, values, begun = [], [], 0.0
        for segment in (segment for run in self.runs for segment in run.segments):
            steps, last, time = segment_steps(segment, start, self.unit)
            found = filter_(entered(case, segment, start, noise, self.unit), steps)
            if not np.isfinite(found.estimate[-1]).all():
                raise InputError(f"{sources_of(self.runs)}: {self.name} loses the boat; use --method output-error.")
            case.prior.mean[2:], case.prior.covariance[2:, 2:] = found.estimate[-1], found.covariance
            times.append(begun + time)
            values.append(found.estimate[last])
            begun += float(segment.time[-1] - segment.time[0])
        models = [model_of(row, start, self.unit) for row in np.concatenate(values)]
        told = np.array([[getattr(model, key) for key in NAMES] for model in models])
        return _Pass(models[-1], case.prior.covariance[2:, 2:], Convergence(np.concatenate(times), NAMES, told))


def _identified(
    runs: Sequence[Run], result: _Pass, unit: float, reasons: dict[str, str], question: Question, name: str
) -> Identified:
    model = result.model
    deviation = np.sqrt(np.diag(result.covariance))
    scale = (model.gain, model.time_constant, unit, model.n3)
    errors = {name: float(d * s) for name, d, s in zip(NAMES, deviation, scale, strict=False)}
    for key, symbol, what in (("gain", "K", "1/s"), ("time_constant", "T", "s")):
        if errors[key] > LARGEST_RELATIVE_ERROR * getattr(model, key):
            reasons[symbol] = (
                f"{symbol}: {getattr(model, key):.3g} with a standard error of {errors[key]:.2g} {what} is not "
                "determined by these runs; record a zigzag in which the rudder goes over several times."
            )
    notes = [TOO_SURE.format(name), *([BY_CHANCE] if name == ParticleMethod.name else [])]
    if question.steady_turns is not None:
        notes.append(f"{name} does not use the steady turns.")
    return identified_as(model, runs, errors, unidentifiable=reasons, notes=notes, convergence=result.convergence)
