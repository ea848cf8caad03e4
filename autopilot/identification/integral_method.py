"""The integral method on recorded runs: all windows together, gone through a few times."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import LARGEST_RELATIVE_ERROR, Convergence, Identified, Question
from autopilot.identification.identify import sources_of
from autopilot.identification.integral_fit import NAMES, FitSettings, IntegralFit, window_length
from autopilot.identification.integral_window import BLOCKS
from autopilot.identification.methods import Method, begin, identified_as
from autopilot.identification.runs import Run, gap_limit
from autopilot.models.norrbin import Norrbin

PASSES = 3
"""How often the runs are gone through, each time with the boat simulated by the estimate of the time before."""

LEAST_GAP_S = 2.0


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


def longest_gap(runs: Sequence[Run]) -> float:
    """Return the longest time [s] between samples of one stretch of the runs."""
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
    gap = longest_gap(runs)
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


METHODS = (
    Method(
        "integral",
        "the yaw equation integrated over windows, solved for all windows together; runs live too",
        integral,
    ),
)
