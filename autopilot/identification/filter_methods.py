"""The extended Kalman filter and the feedback particle filter behind the interface of all methods."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from autopilot.errors import InputError
from autopilot.filters.particle_gains import GAINS
from autopilot.identification.filter_passes import PASSES, Filter, Passed, Passes
from autopilot.identification.identified import LARGEST_RELATIVE_ERROR, Identified
from autopilot.identification.identified import Steps as ProgressSteps
from autopilot.identification.identify import sources_of
from autopilot.identification.methods import Question, begin, identified_as
from autopilot.identification.norrbin_case import NAMES
from autopilot.identification.recursive import Case, Found, Steps, by_particle_filter
from autopilot.identification.residuals import typical_rate
from autopilot.identification.runs import Run, shortest_time_constant

PARTICLES = 300
SEED = 2019
"""The same runs give the same model."""

BY_CHANCE = (
    "fpf's standard errors take how far it ended from the Kalman filter on the same record for its errors by chance, "
    "which in gusts can be the larger part; hold it against ekf."
)


class KalmanMethod:
    """The extended Kalman filter with the parameters as states."""

    name = "ekf"
    summary = "extended Kalman filter over heading, rate and parameters; knows gusts from instrument noise"

    def identify(self, runs: Sequence[Run], question: Question) -> Identified:
        """Return the filter's last belief; see `Method.identify`. n3 is held at 0 where it cannot be told."""
        return _identify(runs, question, None, self.name)


class ParticleMethod:
    """The feedback particle filter, the parameters as states.

    gain: one of `GAINS`; particles: how many. Raises KeyError for a gain that there is not.
    """

    name = "fpf"
    summary = "feedback particle filter (Zheng et al. 2019), 300 particles; --gain constant, galerkin or kernel"

    def __init__(self, gain: str = "constant", particles: int = PARTICLES) -> None:
        self._gain, self._particles = GAINS[gain], particles

    def identify(self, runs: Sequence[Run], question: Question) -> Identified:
        """Return the filter's last belief; see `Method.identify`. n3 is held at 0 where it cannot be told."""
        random = np.random.default_rng(SEED)

        def filtered(case: Case, steps: Steps) -> Found:
            return by_particle_filter(case, steps, self._particles, random, self._gain)

        return _identify(runs, question, filtered, self.name)


def _identify(runs: Sequence[Run], question: Question, filter_: Filter | None, name: str) -> Identified:
    found = begin(runs, question).model
    start = found if question.start is None else question.start
    cubic = question.kind == "norrbin" or question.course_unstable
    steps = ProgressSteps(question.progress, total=PASSES)
    segments = [segment for run in runs for segment in run.segments]
    unit, shortest = typical_rate(segments), shortest_time_constant(segments)
    passes = Passes(runs, unit, start if cubic else start._replace(n3=0.0), name, steps, shortest)
    result, reasons = passes.kalman(cubic), {}
    if cubic and not _tells_n3(result):
        reason = _untold(result, unit)
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


def _tells_n3(result: Passed) -> bool:
    return bool(np.sqrt(result.covariance[-1, -1]) <= LARGEST_RELATIVE_ERROR * result.mean[-1])


def _untold(result: Passed, unit: float) -> str:
    value, error = float(result.mean[-1]) / unit**2, float(result.covariance[-1, -1]) ** 0.5 / unit**2
    return f"n3: {value:.3g} with a standard error of {error:.2g} s^2/rad^2 cannot be told from 0"


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
