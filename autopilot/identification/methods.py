"""One record for every way from recorded runs to a model, so that they can be asked, compared and tested alike.

The output-error fit, and the two stages of Jiang et al. 2016, behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import Convergence, Identified, Question, too_quick
from autopilot.identification.identify import (
    StartingPoint,
    check_excitation,
    check_response,
    identify,
    sources_of,
    starting_point,
    steady_damping,
    unstable_starting_point,
)
from autopilot.identification.residual_tests import simulate_run
from autopilot.identification.residuals import residual_noise
from autopilot.identification.runs import FloatArray, Run, mean_speed, shortest_time_constant
from autopilot.identification.two_stage import nomoto_at_end, nomoto_path
from autopilot.models.norrbin import Norrbin

PARAMETERS = ("gain", "time_constant", "n3", "n2", "n1", "n0")
"""Those every result names in its standard errors."""


class Method(NamedTuple):
    """A way to identify; `tests/contract/test_identification_methods.py` holds every one in the registry to this.

    name: what `autopilot identify --method` calls it.  summary: what it does, in a line.  takes: what it can be asked
    beyond the usual question: `models` (n2, Nomoto's second order, or to choose), `trim`, and `rudder`, what
    lies before it.

    identify: returns the model that all runs together give. The runs are not changed; the same runs give the same
    model. Raises InputError, in one sentence that names the runs, where they tell nothing: the rudder never moves, the
    boat makes no way, the motion does not follow the rudder or follows it backwards, or the method cannot answer the
    question at all.
    """

    name: str
    summary: str
    identify: Callable[[Sequence[Run], Question], Identified]
    takes: frozenset[str] = frozenset()


def begin(runs: Sequence[Run], question: Question) -> StartingPoint:
    """Return a linear model near the best one, stated at the question's reference speed, the runs being fit to
    identify from. Raises InputError where they are not; see `Method`."""
    speed = mean_speed(runs) if question.reference_speed is None else question.reference_speed
    check_excitation(runs, speed)
    found = starting_point(runs, speed)
    check_response(runs, found)
    if question.course_unstable:
        return found._replace(model=unstable_starting_point(runs, found.model))
    return found


def identified_as(
    model: Norrbin,
    runs: Sequence[Run],
    standard_errors: Mapping[str, float],
    *,
    unidentifiable: Mapping[str, str] | None = None,
    notes: Sequence[str] = (),
    convergence: Convergence | None = None,
) -> Identified:
    """Return the result for a model that was found in whatever way, with the residuals of its open-loop prediction.

    standard_errors: by the names of the model's parameters, only those that the method has an honest one for. A time
    constant that the samples cannot tell is held where they can.
    """
    reasons = dict(unidentifiable or {})
    shortest = shortest_time_constant([segment for run in runs for segment in run.segments])
    if model.time_constant <= shortest:
        model, reasons["T"] = model._replace(time_constant=shortest), too_quick(shortest)
    residuals = [
        (simulated[:, 0] - segment.rate, simulated[:, 1] - segment.heading)
        for run in runs
        for segment, simulated in zip(run.segments, simulate_run(model, run), strict=True)
    ]
    return Identified(
        model=model,
        standard_errors={name: standard_errors.get(name) for name in PARAMETERS},
        unidentifiable=reasons,
        noise=(residual_noise([rate for rate, _ in residuals]), residual_noise([heading for _, heading in residuals])),
        notes=tuple(notes),
        convergence=convergence,
    )


NO_TURNS = (
    "n3: the two-stage method takes it from steady turns (--steady-turns), and there are none, so it is held at 0."
)
NO_ERRORS = (
    "two-stage gives no standard errors: noise and the rudder's movement between samples bias it by more than its "
    "scatter shows; output-error does."
)

FAR = 4.0
"""Estimates further than this factor from the last are the beginning's, and not shown."""


def two_stage(runs: Sequence[Run], question: Question) -> Identified:
    """Return K and T by recursive least squares with optional forgetting, then n3 from steady turns with K held; see
    `Method`. A course-unstable boat is refused."""
    if question.course_unstable:
        raise InputError(
            f"{sources_of(runs)}: two-stage leaves n3 out of its first stage, without which a course-unstable "
            "boat has no bounded turn; use --method output-error."
        )
    start = begin(runs, question).model
    time, values = nomoto_path(runs, start.reference_speed, question.forgetting)
    stage = nomoto_at_end(values)
    if stage is None:
        raise InputError(
            f"{sources_of(runs)}: two-stage finds no boat that settles on a turn (K and T not both positive); "
            "record a zigzag sampled more often than the rudder moves, or use --method output-error."
        )
    model = start._replace(gain=stage.gain, time_constant=stage.time_constant, n0=0.0)
    path = _convergence(time, values, model)
    if question.kind == "nomoto" or question.steady_turns is None:
        reasons = {} if question.kind == "nomoto" else {"n3": NO_TURNS}
        return identified_as(model, runs, {}, unidentifiable=reasons, notes=[NO_ERRORS], convergence=path)
    cubic = steady_damping(question.steady_turns, question.gain or stage.gain, model.reference_speed)
    if cubic.n3 <= 0.0:
        reason = f"n3: the steady turns give {cubic.n3:.3g} s^2/rad^2, which bounds no turn, so it is held at 0."
        return identified_as(model, runs, {}, unidentifiable={"n3": reason}, notes=[NO_ERRORS], convergence=path)
    errors = {} if cubic.standard_error is None else {"n3": cubic.standard_error}
    found = identified_as(model._replace(n3=cubic.n3), runs, errors, notes=[NO_ERRORS], convergence=path)
    return found._replace(steady=cubic)


def _convergence(time: FloatArray, values: FloatArray, end: Norrbin) -> Convergence:
    """Return how K and T were found, from where they first are of the size that they end with: before the rudder has
    moved, noise alone makes them anything."""
    share = values / (end.gain, end.time_constant)
    begins = int(np.argmax(np.all((share > 1.0 / FAR) & (share < FAR), axis=1)))
    return Convergence(time[begins:], ("gain", "time_constant"), values[begins:])


METHODS = (
    Method(
        "output-error",
        "simulates the model with the recorded rudder and fits heading and rate; with standard errors",
        identify,
        frozenset({"models", "trim", "rudder"}),
    ),
    Method("two-stage", "recursive least squares for K and T, n3 from steady turns (Jiang et al. 2016)", two_stage),
)
