"""The recursion of the integral method as published, to hold the solution with instruments against.

One parameter after another, each from the same window's equation:

    e = T dr + dpsi + alpha I3 - K Id
    K += lambda Id e/(mu + Id^2),   T -= lambda dr e/(mu + dr^2),   alpha -= lambda I3 e/(mu + I3^2)

each minimises e^2 + mu (theta - theta before)^2 over its own parameter, with the others as they were, and goes the
share lambda of the way. The linear form has no alpha. Source: patent application of Harbin Engineering University
(Liao et al., 2019). Its mu has the unit of a regressor squared; here it is a multiple of the regressor's own mean
square, which makes it the same number for a model boat and a ship. The windows are those of
`autopilot.identification.integral_method`, which solves their equations all at once.

It is not the estimate to rely on: three parameters from one equation creep along a valley where K, T and
alpha change together and e hardly does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import Convergence, Identified, Question
from autopilot.identification.identify import sources_of
from autopilot.identification.integral_method import MOVES, NAMES, Motion, equations, window_length
from autopilot.identification.methods import Method, begin, identified_as
from autopilot.identification.residuals import instrument_noise
from autopilot.identification.runs import Run
from autopilot.models.norrbin import Norrbin

RECURSION_PASSES = 10

NO_ERRORS = (
    "integral-recursion gives no standard errors: it follows the error window by window, and where n3 counts "
    "it has not settled yet; integral and output-error do."
)


class RecursionSettings(NamedTuple):
    """step lambda [-] and weight mu [-, in mean squares of the regressor], the same for every parameter; whether
    alpha is estimated, or else held; how far K, T and alpha may go from the model they begin with, a factor."""

    step: float = 0.5
    weight: float = 1.0
    nonlinear: bool = False
    bound: float = 10.0


class Recursion(NamedTuple):
    """The estimate and, per regressor (Id, dr, I3), its mean square over `windows` of them."""

    model: Norrbin
    powers: tuple[float, float, float] = (0.0, 0.0, 0.0)
    windows: int = 0


MEMORY = 200
"""Windows over which the mean squares are taken."""


def recursion_step(
    settings: RecursionSettings, first: Norrbin, state: Recursion, terms: Sequence[float], left: float
) -> Recursion:
    """Return the state after one more window: what K, T, n3 and n0 are multiplied by, and the equation's left side;
    `first` is the model it all began with, which the bounds are about."""
    model = state.model
    count = min(state.windows + 1, MEMORY)
    regressors = driven, change, cubed = terms[0], -terms[1], -terms[2]
    power = [p + (x * x - p) / count for p, x in zip(state.powers, regressors, strict=True)]
    error = model.time_constant * change + left + model.n3 * cubed - model.n0 * terms[3] - model.gain * driven
    gain = model.gain + settings.step * _share(driven, power[0], settings.weight) * error
    time_constant = model.time_constant - settings.step * _share(change, power[1], settings.weight) * error
    n3 = model.n3
    if settings.nonlinear:
        n3 = max(0.0, n3 - settings.step * _share(cubed, power[2], settings.weight) * error)
        n3 = min(n3, settings.bound * first.n3) if first.n3 > 0.0 else n3
    found = model._replace(
        gain=_within(gain, first.gain, settings.bound),
        time_constant=_within(time_constant, first.time_constant, settings.bound),
        n3=n3,
    )
    return Recursion(found, (power[0], power[1], power[2]), count)


def _share(regressor: float, power: float, weight: float) -> float:
    whole = weight * power + regressor * regressor
    return regressor / whole if whole > 0.0 else 0.0


def _within(value: float, first: float, bound: float) -> float:
    return min(max(value, first / bound), first * bound)


def integral_recursion(runs: Sequence[Run], question: Question) -> Identified:
    """Return where the recursion of the patent has come to after ten times through the runs; see `Method`.

    A course-unstable boat is refused: there n3 is as large as everything else.
    """
    if question.course_unstable:
        raise InputError(
            f"{sources_of(runs)}: integral-recursion does not settle on a course-unstable boat; use --method "
            "integral or output-error."
        )
    start = question.start or begin(runs, question).model
    length, begun, windows = window_length(start.time_constant), 0.0, list[tuple[float, list[float], float]]()
    for segment in (segment for run in runs for segment in run.segments):
        motion = Motion(segment.heading, segment.rate, instrument_noise(segment.heading))
        rows = equations(segment, motion, start, length, begun)
        telling = rows.moves > MOVES
        windows += zip(
            rows.time[telling].tolist(), rows.terms[telling].tolist(), rows.left[telling].tolist(), strict=True
        )
        begun += float(segment.time[-1] - segment.time[0])
    settings = RecursionSettings(nonlinear=question.kind == "norrbin")
    state, path = Recursion(start), []
    for done in range(RECURSION_PASSES):
        for time, terms, left in windows:
            state = recursion_step(settings, start, state, terms, left)
            path.append((time, *(getattr(state.model, name) for name in NAMES[:3])))
        question.progress(done + 1, RECURSION_PASSES)
    last = np.array(path[-len(path) // RECURSION_PASSES :]).reshape(-1, 4)
    return identified_as(
        state.model, runs, {}, notes=[NO_ERRORS], convergence=Convergence(last[:, 0], NAMES[:3], last[:, 1:])
    )


RECURSION = Method(
    "integral-recursion",
    "the integral method's recursion as published, one parameter after another; slow where n3 counts",
    integral_recursion,
)
