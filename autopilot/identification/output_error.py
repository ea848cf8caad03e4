"""The estimate that ships: simulate the model with the recorded rudder, fit it to heading and yaw rate.

Minimises, over the parameters theta and each segment's initial rate and heading,

    sum over samples of ((r_measured - r(theta)) / s_r)^2 + ((psi_measured - psi(theta)) / s_psi)^2

where r and psi are the open-loop response to recorded rudder and speed. The weights come from the residuals
themselves, found by repeating the fit: s^2 is their mean square times (1 + rho)/(1 - rho), rho their correlation
from sample to sample. Where instruments are to blame for the residuals (rho = 0) that is plain weighting by
noise; where gusts and what the model leaves out are (rho near 1), heading errors are sums of rate errors and
tell little that the rate does not hold already, and their long memory takes their weight away.

The initial state is fitted, but held near the first measured one within the instrument's own noise, as seen in
the second differences of the record: a boat at rest forgets nothing, and must not start with an invented turn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from autopilot.identification.residuals import (
    Fitted,
    Noise,
    Problem,
    initial_state,
    residual_noise,
    robust_covariance,
    triangle,
    typical_rate,
    units,
)
from autopilot.identification.runs import FloatArray, Run, Segment, shortest_time_constant
from autopilot.identification.simulation import Forcing, forcing
from autopilot.models.norrbin import Norrbin
from autopilot.models.weather import RaceAndWind

STEPS_PER_TIME_CONSTANT = 4.0
"""Integration steps per time constant, at least, during the fit: Runge-Kutta is then exact to some 3e-5."""
SAMPLES_TOGETHER = 200.0
"""Samples closer than a time constant by this number are stepped over together: what lies inside a step, the rudder's
movement and the motion between two samples, is otherwise known only roughly."""
LARGE_TURN = 2.0
"""Cubic damping shortens the memory in a turn; it is reckoned with at the largest rates measured, at most at this many
times the typical rate."""
LARGE_SHARE = 0.99
"""Rates above this quantile are too rare to count."""

NOT_NEGATIVE = ("n3", "race", "steady_race", "drift", "dead_band", "delay", "lag")
LARGEST_DRIFT = 0.95
"""With a drift of 1 the boat would no longer go straight by itself."""
DRIFT_TIMES = 2.0
"""A round of the fit changes the drift's time by at most this factor's logarithm: with much less the steps would be too
long for it, with much more there is no drift."""
LARGEST_ASYMMETRY = 3.0
"""n2 times the typical rate: beyond this one side would hardly turn and the other without end."""
AT_BOUND = 1.0e-4
"""A scaled parameter below this has ended at its bound 0."""

NOISE_ROUNDS = 4
"""How often, at most, the weights are found anew from the residuals."""

TOLERANCE, FIRST_TOLERANCE = 1.0e-6, 1.0e-3
"""Relative change of parameters and loss at which a round ends; the first one has only rough weights."""

SETTLED = 0.01
"""Relative change of the weights below which another round would change nothing that matters."""


Weighting = Literal["likelihood", "residuals"]
"""How rate and heading are weighed: by the likelihood of all motions that gusts allow (`identification.likelihood_fit`;
what it does not know, n2, trims of the runs' own, a lead, is fitted by residuals); or each by its residuals' size and
memory."""


class Solution(NamedTuple):
    """The best `fitted` with the parameters `free` changed.

    covariance: of the free parameters in their own units, shape (F, F). noise: of rate and heading residuals.
    at_bound: those that were fitted and ended at their bound: 0 where they cannot be negative, T at its shortest.
    """

    fitted: Fitted
    free: tuple[str, ...]
    covariance: FloatArray
    noise: tuple[Noise, Noise]
    at_bound: tuple[str, ...]

    @property
    def model(self) -> Norrbin:
        """The boat's model."""
        return self.fitted.model

    @property
    def around(self) -> RaceAndWind:
        """What propeller, wind and drift add."""
        return self.fitted.around

    def standard_error(self, name: str) -> float | None:
        """Return the standard error of a parameter, None where it was not fitted."""
        if name not in self.free:
            return None
        index = self.free.index(name)
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))


def solve(
    runs: Sequence[Run],
    start: Fitted,
    free: tuple[str, ...],
    after_round: Callable[[], None] = lambda: None,
    rounds: int = NOISE_ROUNDS,
) -> Solution:
    """Return the best model near `start` with the parameters `free` of it fitted.

    K and T stay positive, n3 and the race not negative; what is not free keeps its value.
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    scale = typical_rate(segments)
    base, states = start, [initial_state(segment) for segment in segments]
    noise: tuple[Noise, Noise] | None = None
    for _ in range(rounds):
        steps = fit_steps(segments, base.model, scale)
        problem = Problem(segments, steps, base, free, scale, units(base, scale, segments))
        start_z = problem.vector(states)
        z = _minimise(problem, start_z, noise or _noise(problem, start_z), TOLERANCE if noise else FIRST_TOLERANCE)
        base = problem.fitted(z)
        states = problem.states(z)
        before, noise = noise, _noise(problem, z)
        after_round()
        if before is not None and _settled(before, noise):
            break
    return _solution(problem, z)


def fit_steps(segments: Sequence[Segment], model: Norrbin, typical_rate: float) -> Forcing:
    """Return the integration steps for models near `model` that turn at about `typical_rate` [rad/s].

    What counts is T/(1 + 3 n3 r^2) in a large turn, the linearised time constant there.
    """
    memory = model.time_constant / (1.0 + 3.0 * model.n3 * _large_rate(segments, typical_rate) ** 2)
    memory = max(memory, shortest_time_constant(segments))
    return forcing(segments, memory / STEPS_PER_TIME_CONSTANT, memory / SAMPLES_TOGETHER)


def _large_rate(segments: Sequence[Segment], typical_rate: float) -> float:
    rates = np.concatenate([segment.rate[np.isfinite(segment.rate)] for segment in segments])
    if rates.size == 0:
        return LARGE_TURN * typical_rate
    return min(LARGE_TURN * typical_rate, float(np.quantile(np.abs(rates), LARGE_SHARE)))


def _settled(before: Sequence[Noise], now: Sequence[Noise]) -> bool:
    return all(abs(a.weight - b.weight) <= SETTLED * b.weight for a, b in zip(before, now, strict=True))


def _noise(problem: Problem, z: FloatArray) -> tuple[Noise, Noise]:
    residuals = [values for values, _ in problem.response(z)]
    return residual_noise([values[:, 0] for values in residuals]), residual_noise([v[:, 1] for v in residuals])


def _minimise(problem: Problem, z: FloatArray, noise: Sequence[Noise], tolerance: float) -> FloatArray:
    """Return the vector that minimises the weighted residuals and the anchors of the initial states."""
    S, F = len(problem.segments), len(problem.free)
    memory: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def evaluate(vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = vector.tobytes()
        if key not in memory:
            memory.clear()
            distance, spread = problem.anchors(vector)
            rows = [
                _compressed(values.ravel(), slope.reshape(-1, F + 2), distance[s], spread[s])
                for s, (values, slope) in enumerate(problem.weighted(vector, noise))
            ]
            jacobian = np.zeros((S, F + 3, vector.size))
            for s, (_, slope) in enumerate(rows):
                jacobian[s][:, [*range(F), F + s, F + S + s]] = slope
            memory[key] = np.concatenate([values for values, _ in rows]), jacobian.reshape(-1, vector.size)
        return memory[key]

    low, high = _bounds(problem, z)
    z = np.clip(z, low, high)

    def residual(vector: FloatArray) -> FloatArray:
        return evaluate(vector)[0]

    def jacobian(vector: FloatArray) -> FloatArray:
        return evaluate(vector)[1]

    from scipy.optimize import least_squares  # slow to load, and few recordings need it

    found = least_squares(
        residual,
        z,
        jac=jacobian,
        bounds=(low, high),
        x_scale="jac",
        xtol=tolerance,
        ftol=tolerance,
        max_nfev=60,
    )
    return np.asarray(found.x, dtype=np.float64)


def _bounds(problem: Problem, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return between which values each component of the vector may move from `z`. Of two time constants in series T is
    the longer one, or they would change places."""
    low, high = np.full(z.size, -np.inf), np.full(z.size, np.inf)
    for i, name in enumerate(problem.free):
        if name in NOT_NEGATIVE:
            low[i] = 0.0
        if name == "time_constant":
            low[i] = np.log(shortest_time_constant(problem.segments))
        if name == "drift":
            high[i] = LARGEST_DRIFT
        if name == "n2":
            low[i], high[i] = -LARGEST_ASYMMETRY, LARGEST_ASYMMETRY
        if name == "lag":
            high[i] = problem.base.model.time_constant / problem.units["lag"]
        if name == "drift_time":
            low[i], high[i] = z[i] - DRIFT_TIMES, z[i] + DRIFT_TIMES
    return low, high


def _compressed(
    values: FloatArray, slope: FloatArray, distance: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a segment's residuals and derivatives as F + 3 rows of the same cost, gradient and normal matrix.

    With [J e] = Q R the minimiser sees R alone: it asks for nothing but e'e, J'e and J'J, and is spared every sample.
    """
    F = slope.shape[1] - 2
    anchors = np.hstack([np.zeros((2, F)), np.diag(1.0 / spread), distance[:, None]])
    rows = triangle(np.vstack([np.hstack([slope, values[:, None]]), anchors]))
    return rows[:, -1], rows[:, :-1]


def _solution(problem: Problem, z: FloatArray) -> Solution:
    """Gather the standard errors, with the initial states projected out segment by segment."""
    F = len(problem.free)
    noise = _noise(problem, z)
    spread = problem.anchors(z)[1]
    residuals, jacobians = [], []
    for s, (values, slope) in enumerate(problem.weighted(z, noise)):
        flat = slope.reshape(-1, F + 2)
        own = np.vstack([flat[:, F:], np.diag(1.0 / spread[s])])
        target = np.vstack([flat[:, :F], np.zeros((2, F))])
        projected = flat[:, :F] - flat[:, F:] @ np.linalg.lstsq(own, target, rcond=None)[0]
        residuals.append(values)
        jacobians.append(projected.reshape(*values.shape, F))
    fitted = problem.fitted(z)
    scale = problem.parameter_scale(z)
    covariance = robust_covariance(jacobians, residuals) * np.outer(scale, scale)
    at_bound = tuple(
        name for name, value in zip(problem.free, z, strict=False) if name in NOT_NEGATIVE and value < AT_BOUND
    )
    shortest = shortest_time_constant(problem.segments)
    if "time_constant" in problem.free and fitted.model.time_constant < (1.0 + SETTLED) * shortest:
        at_bound = (*at_bound, "time_constant")
    return Solution(fitted, problem.free, covariance, noise, at_bound)
