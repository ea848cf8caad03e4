"""One interface for every way from recorded runs to a model, so that they can be asked, compared and tested alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from autopilot.identification.identified import Convergence, Identified, ModelKind, Progress, SteadyTurns, too_quick
from autopilot.identification.identify import check_excitation, check_response, mean_speed
from autopilot.identification.noise import residual_noise
from autopilot.identification.output_error import Weighting
from autopilot.identification.prediction import simulate_run
from autopilot.identification.run_trim import Trim
from autopilot.identification.runs import Run, shortest_time_constant
from autopilot.identification.starting_point import StartingPoint, starting_point, unstable_starting_point
from autopilot.models.norrbin import Norrbin

PARAMETERS = ("gain", "time_constant", "n3", "n2", "n1", "n0")
"""Those every result names in its standard errors."""


def _silent(done: int, total: int) -> None:
    """Tell nobody."""


class Question(NamedTuple):
    """What is asked of a method.

    kind: with n3 or without.  reference_speed [m/s]: where the parameters are stated, None for the runs' mean speed.
    course_unstable: n1 = -1.  steady_turns, gain [1/s]: for methods that take n3 from steady turns.  start: where a
    recursive method begins, None for its own choice.  forgetting: of recursive least squares, 1 forgets nothing.
    rudder_train: names of RudderTrain to be fitted too, by methods that can. weighting: of the
    output-error fit. quadratic: n2 too, trim: one n0 or one for each run, by methods that can.
    progress: told how far it is.
    """

    kind: ModelKind = "norrbin"
    reference_speed: float | None = None
    course_unstable: bool = False
    steady_turns: SteadyTurns | None = None
    gain: float | None = None
    start: Norrbin | None = None
    forgetting: float = 1.0
    rudder_train: tuple[str, ...] = ()
    weighting: Weighting = "residuals"
    quadratic: bool = False
    trim: Trim = "common"
    progress: Progress = _silent


class Method(Protocol):
    """A way to identify; `tests/contract/test_identification_methods.py` holds every one in the registry to this."""

    @property
    def name(self) -> str:
        """What `autopilot identify --method` calls it."""

    @property
    def summary(self) -> str:
        """What it does, in a line."""

    def identify(self, runs: Sequence[Run], question: Question) -> Identified:
        """Return the model that all runs together give. The runs are not changed; the same runs give the same model.

        Raises InputError, in one sentence that names the runs, where they tell nothing: the rudder never moves, the
        boat makes no way, the motion does not follow the rudder or follows it backwards, or the method cannot answer
        the question at all.
        """


def begin(runs: Sequence[Run], question: Question) -> StartingPoint:
    """Return a linear model near the best one, stated at the question's reference speed, the runs being fit to
    identify from. Raises InputError where they are not; see `Method.identify`."""
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
