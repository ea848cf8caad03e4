"""What an identification is asked, and what it answers: the model, how sure it is, and what the runs cannot tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from autopilot.identification.boat_prior import BoatPrior
from autopilot.identification.interval import SURE_OF_IT
from autopilot.identification.likelihood_fit import LikelihoodFit
from autopilot.identification.one_boat import Differing
from autopilot.identification.output_error import Solution, Weighting
from autopilot.identification.residual_tests import (
    Prediction,
    ResidualTest,
    Simulation,
    one_of,
    predict,
    residual_tests,
)
from autopilot.identification.residuals import PREFIX, Noise, Trim
from autopilot.identification.rudder_path import DIRECT, RudderRate, RudderTrain
from autopilot.identification.runs import FloatArray, Run, has_propeller, has_wind
from autopilot.identification.two_stage import CubicDamping
from autopilot.models.norrbin import Norrbin
from autopilot.models.weather import RaceAndWind

ModelKind = Literal["nomoto", "norrbin"]
Progress = Callable[[int, int], None]
"""Called with how many of how many steps are done."""


LARGEST_RELATIVE_ERROR = 0.5
"""A parameter whose standard error is more than this share of it cannot be distinguished from zero at two sigma."""


class Steps:
    """Counts steps and tells the progress."""

    def __init__(self, progress: Progress, total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def next(self) -> None:
        """One step more is done."""
        self._done = min(self._done + 1, self._total)
        self._progress(self._done, self._total)


class SteadyTurns(NamedTuple):
    """Turns in which nothing changes any more, one per element: rudder [rad], rate [rad/s], and speed [m/s],
    None where they were all made at the reference speed."""

    rudder: FloatArray
    rate: FloatArray
    speed: FloatArray | None = None


def silent(done: int, total: int) -> None:
    """Tell nobody of the progress."""


class Question(NamedTuple):
    """What is asked of a method; each says in `Method.takes` which of it, beyond the first three, it can be asked.

    kind: with n3 or without.  reference_speed [m/s]: where the parameters are stated, None for the runs' mean speed.
    course_unstable: the boat will not go straight by itself, n1 = -1; then n3 is what bounds its turning.
    steady_turns, gain [1/s]: n3 from steady turns, with K held at `gain`, or else at the fitted K.  start: where a
    recursive method begins, None for its own choice.  forgetting: of recursive least squares, 1 forgets nothing.
    rudder_train: names of RudderTrain to be fitted too, what lies between the recorded rudder and the water.
    weighting: "likelihood" knows gusts from instrument noise.  quadratic: n2 too, of a boat that turns otherwise to one
    side.  trim: "per-run" fits an n0 for each run; the model has their mean.  progress: called
    with how far it is.  prior: what other boats of its length say of the boat.
    """

    kind: ModelKind = "norrbin"
    reference_speed: float | None = None
    course_unstable: bool = False
    steady_turns: SteadyTurns | None = None
    gain: float | None = None
    start: Norrbin | None = None
    forgetting: float = 1.0
    rudder_train: tuple[str, ...] = ()
    weighting: Weighting = "likelihood"
    quadratic: bool = False
    trim: Trim = "common"
    prior: BoatPrior | None = None
    progress: Progress = silent


USUAL = Question()
"""Norrbin's model of a course-stable boat at the runs' mean speed."""


class Convergence(NamedTuple):
    """How a recursive method came to its estimate: time [s] from the beginning of the first run, shape (N,), and the
    parameters called `names` at each, shape (N, len(names))."""

    time: FloatArray
    names: tuple[str, ...]
    values: FloatArray


class Ratios(NamedTuple):
    """K/T [1/s^2], n1/T [1/s], n3/T [s/rad^2] and n0/T [rad/s^2] at the reference speed, and their standard errors."""

    values: tuple[float, float, float, float]
    errors: tuple[float, float, float, float]

    @property
    def on_ridge(self) -> bool:
        """Return whether n1/T, and with it whether the boat is course-stable, cannot be distinguished from 0."""
        return abs(self.values[1]) < SURE_OF_IT * self.errors[1]


class Sliding(NamedTuple):
    """A boat that slides in its turns, of Nomoto's second order with Norrbin's damping: the fit, whose train's lag and
    lead are T2 and T3, and its model, whose T is T1."""

    model: Norrbin
    fit: LikelihoodFit


class Identified(NamedTuple):
    """The model; standard errors by parameter name, None where not fitted; what the runs cannot tell, a sentence
    by symbol; the residuals of rate and heading; n3 of the steady-turn stage where there was one; what propeller
    and wind add where the runs show it, with `plain`, the model that does without; what else the method has to say,
    a sentence each; from a recursive method, how it came there; and the covariance, shape (F, F), of the parameters
    called `free` where the method knows it. train: the way from the recorded rudder to the water, where it was asked
    for and the runs show it. trims: where each run has an n0 of its own, that [rad/s] by the run's source; the model's
    is their mean. ratios: where the method has them, what is determined of a boat of either stability.
    leans: by symbol K, T and n3 the share of what is known of K/T, n1/T and n3/T that other boats said; empty where
    they said nothing. likely: the likelihood's fit with the weather that it found, where that answered. sliding: the
    boat of second order where the runs show that it slides: predictions are made with it, `model` is what it is steered
    by. of_order: covariance of a, b, d and e, shape (4, 4), that the first order leaves open of a boat that slides, or
    may. rudder_rate: at which the rudder moved that the runs know by its orders alone, where the boat's turning showed
    it slower than the vessel file says and the runs were fitted behind it. is_blind: the errors are those of a fit that
    knows of gusts only what the residuals remember of them, which is too little (`identify`). spacing: how far apart
    the samples are [s], 0 where the method does not say. differing: two parts of the runs that do not tell of one boat,
    which the errors hold; None where all agree, or nobody looked. answers: share of the rudder's motion that is an
    answer to what pushed the boat, 0 where nobody looked. may_be_lag: the runs do not tell T
    from the rudder's lag; the errors hold both in one. simulations: those that were made on the way."""

    model: Norrbin
    standard_errors: dict[str, float | None]
    unidentifiable: dict[str, str]
    noise: tuple[Noise, Noise]
    steady: CubicDamping | None = None
    around: RaceAndWind | None = None
    plain: Norrbin | None = None
    notes: tuple[str, ...] = ()
    convergence: Convergence | None = None
    free: tuple[str, ...] = ()
    covariance: FloatArray | None = None
    train: RudderTrain = DIRECT
    trims: tuple[tuple[str, float], ...] = ()
    ratios: Ratios | None = None
    leans: Mapping[str, float] = MappingProxyType({})
    likely: LikelihoodFit | None = None
    sliding: Sliding | None = None
    of_order: FloatArray | None = None
    rudder_rate: RudderRate | None = None
    is_blind: bool = False
    spacing: float = 0.0
    differing: Differing | None = None
    answers: float = 0.0
    may_be_lag: bool = False
    simulations: tuple[Simulation, ...] = ()

    @property
    def why_not(self) -> tuple[str, ...]:
        """Why parameters are missing: the sentences of `unidentifiable`, what is said of several once."""
        return tuple(dict.fromkeys(self.unidentifiable.values()))

    @property
    def predictor(self) -> LikelihoodFit | None:
        """The fit that says what the boat will do."""
        return self.likely if self.sliding is None else self.sliding.fit

    def predict(self, run: Run) -> Prediction:
        """Return how well `run` is predicted, with propeller and wind where both model and run know them."""
        return predict(*self._known_to(run), self.simulations)

    def simulated(self, run: Run) -> list[FloatArray]:
        """Return the motion predicted for `run`, per segment rate [rad/s] and heading [rad] of shape (N, 2)."""
        return one_of(self.simulations, *self._known_to(run))

    def residual_tests(self, runs: Sequence[Run]) -> list[ResidualTest]:
        """Return the tests of what the model leaves of yaw rate and heading of the runs that were fitted."""
        model, train = self.model, self.train
        if self.sliding is not None and self.around is None:
            model, train = self.sliding.model, self.sliding.fit.train
        return residual_tests(runs, model, self.around, train, dict(self.trims), self.simulations)

    def _known_to(self, run: Run) -> tuple[Norrbin, Run, RaceAndWind | None, RudderTrain]:
        n0 = dict(self.trims).get(run.source, self.model.n0)
        if self.around is None or self.plain is None:
            if self.sliding is not None:
                return self.sliding.model, run, None, self.sliding.fit.train
            return self.model._replace(n0=n0), run, None, self.train
        lacks_race = self.around.race > 0.0 and not has_propeller([run])
        lacks_wind = (self.around.wind_beam or self.around.wind_quarter) and not has_wind([run])
        if lacks_race or lacks_wind:
            return self.plain, run, None, DIRECT
        return self.model._replace(n0=n0), run, self.around, self.train


def identified_from(solution: Solution, reasons: dict[str, str], runs: Sequence[Run] = ()) -> Identified:
    """Return the answer that a fit gives, with `reasons` why parameters are missing, by symbol; `runs`: those fitted,
    where each has a trim of its own."""
    names = ("gain", "time_constant", "n3", "n2", "n1", "n0")
    errors = {name: solution.standard_error(name) for name in names}
    shared = [i for i, name in enumerate(solution.free) if not name.startswith(PREFIX)]
    model, own = solution.model, solution.fitted.trims
    trims = tuple(
        (run.source, model.n0 - model.gain * float(angle))
        for run, angle in zip(runs, own.angles if own.values else (), strict=False)
    )
    return Identified(
        model,
        errors,
        {**reasons, **_too_uncertain(solution)},
        solution.noise,
        free=tuple(solution.free[i] for i in shared),
        covariance=solution.covariance[np.ix_(shared, shared)],
        train=solution.fitted.train,
        trims=trims,
        is_blind=True,
    )


def _too_uncertain(solution: Solution) -> dict[str, str]:
    reasons = {}
    for name, symbol, unit in (("gain", "K", "1/s"), ("time_constant", "T", "s")):
        value, error = getattr(solution.model, name), solution.standard_error(name) or 0.0
        if error > LARGEST_RELATIVE_ERROR * value:
            reasons[symbol] = (
                f"{symbol}: {value:.3g} with a standard error of {error:.2g} {unit} is not determined by these runs; "
                "record a zigzag in which the rudder goes over several times."
            )
    if "time_constant" in solution.at_bound:
        reasons["T"] = too_quick(solution.model.time_constant)
    return reasons


def too_quick(shortest: float, share: str = "a fifth") -> str:
    """Return why no T is given where it would be below the `shortest` [s] that the samples can tell, that `share` of
    the time between two."""
    return (
        f"T: below {shortest:.2g} s, {share} of the time between two samples: the boat answers faster than these runs "
        "can show; record a zigzag, with heading and rate more often."
    )
