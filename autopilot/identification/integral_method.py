"""The integral method on recorded runs, behind the interface of all methods: with all windows together, and as the
recursion of one parameter after another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import LARGEST_RELATIVE_ERROR, Convergence, Identified, Question
from autopilot.identification.identify import sources_of
from autopilot.identification.integral_fit import NAMES, FitSettings, IntegralFit, window_length
from autopilot.identification.integral_window import (
    BLOCKS,
    IntegralWindow,
    Recursion,
    RecursionSettings,
    recursion_step,
)
from autopilot.identification.methods import Method, begin, identified_as
from autopilot.identification.runs import Run, gap_limit
from autopilot.models.norrbin import Norrbin

PASSES = 3
"""How often the runs are gone through, each time with the boat simulated by the estimate of the time before."""

RECURSION_PASSES = 10
LEAST_GAP_S = 2.0

NO_ERRORS = (
    "integral-recursion gives no standard errors: it follows the error window by window, and where n3 counts "
    "it has not settled yet; integral and output-error do."
)


class Moment(NamedTuple):
    """What was recorded at a time [s] that goes on over all runs, None where missing."""

    time: float
    rudder: float
    ratio: float
    heading: float | None
    rate: float | None


def moments(runs: Sequence[Run], reference_speed: float, gap: float) -> Iterator[Moment]:
    """Give every sample of the runs; between segments time leaps by more than `gap` [s]."""
    begun = 0.0
    for segment in (segment for run in runs for segment in run.segments):
        time = segment.time - segment.time[0] + begun
        ratio = np.abs(segment.speed) / reference_speed
        columns = (time, segment.rudder, ratio, segment.heading, segment.rate)
        for now, rudder, share, heading, rate in zip(*(column.tolist() for column in columns), strict=True):
            yield Moment(now, rudder, share, None if heading != heading else heading, None if rate != rate else rate)
        begun = float(time[-1]) + 2.0 * gap + 1.0


def _gap(runs: Sequence[Run]) -> float:
    return max(LEAST_GAP_S, *(gap_limit(segment.time) for run in runs for segment in run.segments))


def integral(runs: Sequence[Run], question: Question) -> Identified:
    """Return the solution of the integrated equation of all windows, with instruments from a simulated boat; see
    `Method`. n3 is held at 0, with the reason, where it cannot be determined."""
    start = question.start or begin(runs, question).model
    cubic = question.kind == "norrbin"
    fit, convergence = _fit(runs, start, cubic, question)
    if fit.windows < 2 * BLOCKS:
        raise InputError(
            f"{sources_of(runs)}: the rudder moves in only {fit.windows} windows of {fit.length:.3g} s, too few "
            "for the integral method; record a longer zigzag, or use --method output-error."
        )
    errors, reasons = fit.standard_errors(), {}
    if cubic and start.n1 > 0.0 and errors["n3"] > LARGEST_RELATIVE_ERROR * fit.model.n3:
        reasons["n3"] = (
            f"n3: {fit.model.n3:.3g} with a standard error of {errors['n3']:.2g} s^2/rad^2 cannot be distinguished "
            "from 0, so it is held at 0; steady turns at large rudder angles would tell it (--steady-turns)."
        )
        # what is not known of n3 is not known of K and T either: their errors are those of the fit with it
        fit, convergence = _fit(runs, start._replace(n3=0.0), False, question)
        del errors["n3"]
    return identified_as(fit.model, runs, errors, unidentifiable=reasons, convergence=convergence)


def _fit(runs: Sequence[Run], start: Norrbin, cubic: bool, question: Question) -> tuple[IntegralFit, Convergence]:
    gap = _gap(runs)
    settings = FitSettings(longest_gap=gap, memory=float("inf"), cubic=cubic, length=window_length(start.time_constant))
    simulated: Norrbin | None = None
    for done in range(PASSES):
        fit = IntegralFit(start, settings, simulated)
        path = [
            (moment.time, *(getattr(fit.model, name) for name in NAMES))
            for moment in moments(runs, start.reference_speed, gap)
            if fit.update(*moment) is not None
        ]
        simulated = fit.model
        settings = settings._replace(length=window_length(simulated.time_constant))
        question.progress(done + 1, PASSES)
    table = np.array(path).reshape(-1, 1 + len(NAMES))
    return fit, Convergence(table[:, 0], NAMES, table[:, 1:])


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
    gap = _gap(runs)
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


METHODS = (
    Method(
        "integral",
        "the yaw equation integrated over windows, solved for all windows together; runs live too",
        integral,
    ),
    Method(
        "integral-recursion",
        "the integral method's recursion as published, one parameter after another; slow where n3 counts",
        integral_recursion,
    ),
)
