"""The integral method as published and by plain least squares, to hold the fit with instruments against.

The recursion of the integral method: one parameter after another, each from the same window's equation.

    e = T dr + dpsi + alpha I3 - K Id
    K += lambda Id e/(mu + Id^2),   T -= lambda dr e/(mu + dr^2),   alpha -= lambda I3 e/(mu + I3^2)

each minimises e^2 + mu (theta - theta before)^2 over its own parameter, with the others as they were, and goes the
share lambda of the way. The linear form has no alpha. Source: patent application of Harbin Engineering University
(Liao et al., 2019). Its mu has the unit of a regressor squared; here it is a multiple of the regressor's own mean
square, which makes it the same number for a model boat and a ship.

It is not the estimate to rely on: three parameters from one equation creep along a valley where K, T and
alpha change together and e hardly does. `autopilot.identification.integral_fit` solves the same equations of many
windows at once.

Plain recursive least squares over the same equation is biased by the noise of the measured rate, and quick to compute.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.filters.rls import rls_start, rls_step
from autopilot.identification.identified import Convergence, Identified, Question
from autopilot.identification.identify import sources_of
from autopilot.identification.integral_fit import NAMES, FitSettings, window_length
from autopilot.identification.integral_method import longest_gap, moments
from autopilot.identification.integral_window import Integrals, IntegralWindow
from autopilot.identification.methods import Method, begin, identified_as
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


def recursion_step(settings: RecursionSettings, first: Norrbin, state: Recursion, window: Integrals) -> Recursion:
    """Return the state after one more window; `first` is the model it all began with, which the bounds are about."""
    model = state.model
    count = min(state.windows + 1, MEMORY)
    regressors = window.driven, window.rate_change, window.cubed
    driven, change, cubed = regressors
    power = [p + (x * x - p) / count for p, x in zip(state.powers, regressors, strict=True)]
    error = (
        model.time_constant * change
        + model.n1 * window.turned
        + model.n3 * cubed
        + model.n0 * window.elapsed
        - model.gain * driven
    )
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
    gap = longest_gap(runs)
    window = IntegralWindow(window_length(start.time_constant), longest_gap=gap)
    settings = RecursionSettings(nonlinear=question.kind == "norrbin")
    state, path = Recursion(start), []
    for done in range(RECURSION_PASSES):
        for moment in moments(runs, start.reference_speed, gap):
            integrals = window.update(*moment)
            if integrals is not None and integrals.rudder_range > FitSettings().rudder_range:
                state = recursion_step(settings, start, state, integrals)
                path.append((moment.time, *(getattr(state.model, name) for name in NAMES[:3])))
        window.reset()
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

PLAIN_ERROR_RAD = 0.002


class WindowRls:
    """K, T and, with `cubic`, n3, beginning at `first`, with `forgetting` per window."""

    def __init__(self, first: Norrbin, forgetting: float = 1.0, *, cubic: bool = True) -> None:
        self.model = self._first = first
        self._forgetting = forgetting
        # in units of the first model the unknowns are of order one, and so is their variance
        self._units = (first.gain, first.time_constant, max(first.n3, 1.0)) if cubic else first[:2]
        self._state = rls_start([0.0] * len(self._units), PLAIN_ERROR_RAD**-2)

    def update(self, window: Integrals) -> Norrbin:
        """Take one window's equation; return the model as it is then, T positive and n3 not negative."""
        first = self._first
        terms = (window.driven, -window.rate_change, -window.cubed)[: len(self._units)]
        known = first.gain * terms[0] + first.time_constant * terms[1] - first.n3 * window.cubed
        missing = first.n1 * window.turned + first.n0 * window.elapsed - known
        scaled = [term * unit for term, unit in zip(terms, self._units, strict=True)]
        self._state = rls_step(self._state, scaled, missing, self._forgetting)
        found = [share * unit for share, unit in zip(self._state.theta, self._units, strict=True)]
        self.model = first._replace(
            gain=max(first.gain + found[0], 1.0e-9),
            time_constant=max(first.time_constant + found[1], 1.0e-9),
            n3=max(first.n3 + found[2], 0.0) if len(found) > 2 else first.n3,
        )
        return self.model
