"""The two stages of Jiang et al. 2016 behind the interface of all methods."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import Convergence, Identified
from autopilot.identification.identify import sources_of, steady_damping
from autopilot.identification.methods import Question, begin, identified_as
from autopilot.identification.runs import FloatArray, Run
from autopilot.identification.two_stage import nomoto_at_end, nomoto_path
from autopilot.models.norrbin import Norrbin

NO_TURNS = (
    "n3: the two-stage method takes it from steady turns (--steady-turns), and there are none, so it is held at 0."
)
NO_ERRORS = (
    "two-stage gives no standard errors: noise and the rudder's movement between samples bias it by more than its "
    "scatter shows; output-error does."
)

FAR = 4.0
"""Estimates further than this factor from the last are the beginning's, and not shown."""


class TwoStageMethod:
    """K and T by recursive least squares with optional forgetting, then n3 from steady turns with K held."""

    name = "two-stage"
    summary = "recursive least squares for K and T, n3 from steady turns (Jiang et al. 2016)"

    def identify(self, runs: Sequence[Run], question: Question) -> Identified:
        """Return K, T and, with steady turns, n3; see `Method.identify`. A course-unstable boat is refused."""
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
