"""From recorded runs to a model with its standard errors, and to a plain statement of what they cannot tell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.noise import Noise
from autopilot.identification.output_error import NOISE_ROUNDS, Solution, solve
from autopilot.identification.prediction import Prediction, predict, simulate_run
from autopilot.identification.residuals import typical_rate
from autopilot.identification.runs import FloatArray, Run, Segment, has_propeller, has_wind
from autopilot.identification.starting_point import StartingPoint, starting_point, unstable_starting_point
from autopilot.identification.two_stage import CubicDamping, cubic_damping_stage
from autopilot.models.norrbin import Norrbin
from autopilot.models.race_and_wind import RaceAndWind

ModelKind = Literal["nomoto", "norrbin"]
Progress = Callable[[int, int], None]
"""Told how many of how many steps are done."""

LINEAR = ("gain", "time_constant", "n0")
CUBIC = ("gain", "time_constant", "n3", "n0")

WIND = ("wind_beam", "wind_quarter")
START_RACE = 0.5
"""Where the fit of the race begins: c n0^2/U0^2."""
START_N3 = 0.2
"""Where the fit of n3 beside a race begins, in units of the typical rate squared."""
WORTH_IT = 0.98
"""Propeller and wind must take the residuals of the rate below this share of what they are without."""

STEADY_ROUNDS = 3
"""K and the n3 that the steady turns give for it settle within a per cent in as many rounds."""

LARGEST_RELATIVE_ERROR = 0.5
"""A parameter whose standard error is more than this share of it cannot be told from zero at two sigma."""

LEAST_RUDDER_MOVEMENT_RAD = 0.005
LEAST_SPEED_M_S = 0.02
LEAST_EXPLAINED = 0.05
"""Share of the motion that the rudder must explain before anything is fitted to it."""

CLEARLY_BACKWARDS = 0.3
"""Share of the motion that a rudder of opposite sign must explain before the sign is called wrong."""


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


class Convergence(NamedTuple):
    """How a recursive method came to its estimate: time [s] from the beginning of the first run, shape (N,), and the
    parameters called `names` at each, shape (N, len(names))."""

    time: FloatArray
    names: tuple[str, ...]
    values: FloatArray


class Identified(NamedTuple):
    """The model; standard errors by parameter name, None where not fitted; what the runs cannot tell, a sentence
    by symbol; the residuals of rate and heading; n3 of the steady-turn stage where there was one; what propeller
    and wind add where the runs show it, with `plain`, the model that does without; what else the method has to say,
    a sentence each; from a recursive method, how it came there; and the covariance, shape (F, F), of the parameters
    called `free` where the method knows it."""

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

    def foretell(self, run: Run) -> Prediction:
        """Return how well `run` is foretold, with propeller and wind where both model and run know them."""
        return predict(*self._known_to(run))

    def simulated(self, run: Run) -> list[FloatArray]:
        """Return the motion foretold for `run`, per segment rate [rad/s] and heading [rad] of shape (N, 2)."""
        return simulate_run(*self._known_to(run))

    def _known_to(self, run: Run) -> tuple[Norrbin, Run, RaceAndWind | None]:
        if self.around is None or self.plain is None:
            return self.model, run, None
        lacks_race = self.around.race > 0.0 and not has_propeller([run])
        lacks_wind = (self.around.wind_beam or self.around.wind_quarter) and not has_wind([run])
        return (self.plain, run, None) if lacks_race or lacks_wind else (self.model, run, self.around)


def mean_speed(runs: Sequence[Run]) -> float:
    """Return the mean speed [m/s] over the runs' recorded time: the reference at which parameters are stated."""
    way = [float(np.trapezoid(np.abs(s.speed), s.time)) for run in runs for s in run.segments]
    time = [float(s.time[-1] - s.time[0]) for run in runs for s in run.segments]
    return sum(way) / sum(time)


def identify(
    runs: Sequence[Run],
    kind: ModelKind = "norrbin",
    reference_speed: float | None = None,
    *,
    steady_turns: SteadyTurns | None = None,
    gain: float | None = None,
    course_unstable: bool = False,
    progress: Progress = lambda done, total: None,
) -> Identified:
    """Return the output-error estimate from all runs together, scaled with speed.

    A "norrbin" has n3: from `steady_turns` where given (with K held at `gain` [1/s], or else at the fitted K),
    otherwise fitted with the rest and dropped again, with the reason, where it ends on its bound or cannot be
    told from zero: the linear model that is left is stable everywhere. reference_speed [m/s]: default the mean.

    course_unstable: the boat will not go straight by itself, n1 = -1; then n3 is what bounds its turning, is always
    fitted, and there is no smaller model to fall back to.

    Raises InputError where the rudder never moves, the boat makes no way, the motion does not follow the
    rudder, or follows it backwards.
    """
    speed = mean_speed(runs) if reference_speed is None else reference_speed
    check_excitation(runs, speed)
    fits = 1 if kind == "nomoto" else 3 if has_propeller(runs) or has_wind(runs) else 2
    steps = Steps(progress, total=1 + NOISE_ROUNDS * fits)
    start = starting_point(runs, speed)
    check_response(runs, start)
    steps.next()
    if course_unstable:
        unstable = unstable_starting_point(runs, start.model)
        return _unstable(solve(runs, unstable, CUBIC, steps.next), runs)
    linear = solve(runs, start.model, LINEAR, steps.next)
    if kind == "nomoto":
        return _identified(linear, {})
    if steady_turns is not None:
        return _with_steady_turns(runs, linear, steady_turns, gain, steps)
    cubic = solve(runs, linear.model, CUBIC, steps.next)
    reason = _why_no_cubic(cubic)
    plain = _identified(linear, {"n3": reason}) if reason else _identified(cubic, {})
    return _with_race_and_wind(runs, plain, steps)


def _unstable(solution: Solution, runs: Sequence[Run]) -> Identified:
    if "n3" in solution.at_bound:
        raise InputError(
            f"{sources_of(runs)}: a course-unstable model (n1 = -1) does not fit: n3 ends at 0, and nothing would "
            "bound its turning; leave --course-unstable out."
        )
    return _identified(solution, {})


def steady_damping(turns: SteadyTurns, gain: float, reference_speed: float) -> CubicDamping:
    """Return n3 at the reference speed [m/s] from steady turns, K [1/s] held at that speed."""
    ratio = np.ones(turns.rate.size) if turns.speed is None else turns.speed / reference_speed
    # with the rate in units of the speed ratio every turn obeys the equation of the reference speed
    return cubic_damping_stage(turns.rudder, turns.rate / ratio, gain)


def _with_steady_turns(
    runs: Sequence[Run], linear: Solution, turns: SteadyTurns, gain: float | None, steps: Steps
) -> Identified:
    """Fit the rest with n3 held at what the steady turns give for the K of the round before."""
    solution = linear
    for _ in range(STEADY_ROUNDS):
        K = solution.model.gain if gain is None else gain
        cubic = steady_damping(turns, K, solution.model.reference_speed)
        if cubic.n3 <= 0.0:
            reason = (
                f"n3: the steady turns give {cubic.n3:.3g} s^2/rad^2 with K = {K:.3g} 1/s, which would let the boat "
                "turn without bound, so it is held at 0; check the signs and units of the steady turns."
            )
            return _identified(linear, {"n3": reason})._replace(steady=cubic)
        solution = solve(runs, solution.model._replace(n3=cubic.n3), LINEAR, lambda: None, rounds=2)
        steps.next()
    found = _identified(solution, {})
    return found._replace(standard_errors={**found.standard_errors, "n3": cubic.standard_error}, steady=cubic)


def _with_race_and_wind(runs: Sequence[Run], plain: Identified, steps: Steps) -> Identified:
    """Fit propeller race and wind moment too where recorded; drop what the runs do not show, one after the other."""
    names = (("race",) if has_propeller(runs) else ()) + (WIND if has_wind(runs) else ())
    if not names:
        return plain
    start = plain.model._replace(n3=max(plain.model.n3, START_N3 / typical_rate(_segments(runs)) ** 2))
    around = RaceAndWind(race=0.0, reference_propeller=mean_propeller(runs) if "race" in names else 0.0)
    if "race" in names:
        around = around._replace(race=START_RACE * (start.reference_speed / around.reference_propeller) ** 2)
    found = solve(runs, start, (*CUBIC, *names), steps.next, around=around)
    reasons: dict[str, str] = {}
    while weakest := _least_shown(found, ("n3", *names)):
        gone = WIND if weakest in WIND else (weakest,)
        smaller = _without(runs, found, gone, steps)
        if _says_more(found, smaller, runs):
            # two that work in the same moments may each be uncertain and yet be needed together
            kept = [name for name in ("n3", *names) if _is_uncertain(found, name)]
            return _extended(found, plain, {**reasons, **{name: _told_together(name, found) for name in kept}})
        reasons.update({name: _not_shown(name, found) for name in gone})
        names = tuple(name for name in names if name not in gone)
        found = smaller
        if not names:
            return plain._replace(unidentifiable={**reasons, **plain.unidentifiable})
    if found.noise[0].size > WORTH_IT * plain.noise[0].size:
        return plain._replace(unidentifiable={**reasons, **plain.unidentifiable})
    return _extended(found, plain, reasons)


def _extended(found: Solution, plain: Identified, reasons: dict[str, str]) -> Identified:
    result = _identified(found, reasons)
    errors = {**result.standard_errors, **{name: found.standard_error(name) for name in RaceAndWind._fields}}
    return result._replace(around=found.around, plain=plain.model, standard_errors=errors)


def _without(runs: Sequence[Run], found: Solution, gone: Sequence[str], steps: Steps) -> Solution:
    """Return the fit without the parameters `gone`."""
    free = tuple(name for name in found.free if name not in gone)
    around = found.around._replace(**{name: 0.0 for name in gone if name != "n3"})
    start = found.model._replace(n3=0.0) if "n3" in gone else found.model
    return solve(runs, start, free, steps.next, around=around)


def _says_more(larger: Solution, smaller: Solution, runs: Sequence[Run]) -> bool:
    """Return whether Schwarz's information criterion favours the larger model.

    N ln s^2 + k ln N (Schwarz 1978), with N the independent samples that the rate's residuals are worth by their
    memory.
    """
    noise = larger.noise[0]
    samples = sum(int(np.count_nonzero(np.isfinite(segment.rate))) for segment in _segments(runs))
    worth = samples * (1.0 - noise.correlation) / (1.0 + noise.correlation) if samples else 0.0
    if not worth > 1.0:
        return False
    gain = 2.0 * worth * float(np.log(smaller.noise[0].size / noise.size))
    return gain > (len(larger.free) - len(smaller.free)) * float(np.log(worth))


def _is_uncertain(solution: Solution, name: str) -> bool:
    return name in solution.free and _relative_error(solution, name) > LARGEST_RELATIVE_ERROR


def _told_together(name: str, solution: Solution) -> str:
    error = solution.standard_error(name) or 0.0
    return (
        f"{name}: {_value(solution, name):.3g} with a standard error of {error:.2g} is kept, for without it the runs "
        "are explained clearly worse, but it cannot be told apart from the others; trials at other speeds would."
    )


def _least_shown(solution: Solution, names: Sequence[str]) -> str:
    """Return the parameter that can least be told from zero; '' where all can. The two of the wind stand together."""
    doubt = {name: _relative_error(solution, name) for name in names if name in solution.free}
    if WIND[0] in doubt:
        doubt[WIND[0]] = doubt[WIND[1]] = min(doubt[name] for name in WIND)
    weak = {name: value for name, value in doubt.items() if value > LARGEST_RELATIVE_ERROR}
    return max(weak, key=lambda name: weak[name]) if weak else ""


def _relative_error(solution: Solution, name: str) -> float:
    if name in solution.at_bound:
        return float("inf")
    return (solution.standard_error(name) or 0.0) / max(abs(_value(solution, name)), 1.0e-300)


def _not_shown(name: str, solution: Solution) -> str:
    error = solution.standard_error(name) or 0.0
    return (
        f"{name}: {_value(solution, name):.3g} with a standard error of {error:.2g} cannot be told from 0, so it is "
        "held at 0; trials at other speeds and in stronger wind would tell it."
    )


def _value(solution: Solution, name: str) -> float:
    return float(getattr(solution.model if name == "n3" else solution.around, name))


def _segments(runs: Sequence[Run]) -> list[Segment]:
    return [segment for run in runs for segment in run.segments]


def mean_propeller(runs: Sequence[Run]) -> float:
    """Return the mean revolutions [1/s] over the runs' recorded time: the reference for the propeller's race."""
    turns = sum(float(np.trapezoid(np.abs(s.propeller), s.time)) for s in _segments(runs))
    return turns / sum(float(s.time[-1] - s.time[0]) for s in _segments(runs))


def _identified(solution: Solution, reasons: dict[str, str]) -> Identified:
    names = ("gain", "time_constant", "n3", "n1", "n0")
    errors = {name: solution.standard_error(name) for name in names}
    return Identified(
        solution.model,
        errors,
        {**reasons, **_too_uncertain(solution)},
        solution.noise,
        free=solution.free,
        covariance=solution.covariance,
    )


def _why_no_cubic(solution: Solution) -> str:
    n3, error = solution.model.n3, solution.standard_error("n3") or 0.0
    remedy = "steady turns at large rudder angles would tell it (--steady-turns)."
    if "n3" in solution.at_bound:
        return (
            "n3: the fit ends at its bound 0 (left alone it would turn negative and the simulation diverge), so it "
            f"is held at 0; {remedy}"
        )
    if error > LARGEST_RELATIVE_ERROR * n3:
        return (
            f"n3: {n3:.3g} with a standard error of {error:.2g} s^2/rad^2 cannot be told from 0, so it is held at 0; "
            f"{remedy}"
        )
    return ""


def _too_uncertain(solution: Solution) -> dict[str, str]:
    reasons = {}
    for name, symbol, unit in (("gain", "K", "1/s"), ("time_constant", "T", "s")):
        value, error = getattr(solution.model, name), solution.standard_error(name) or 0.0
        if error > LARGEST_RELATIVE_ERROR * value:
            reasons[symbol] = (
                f"{symbol}: {value:.3g} with a standard error of {error:.2g} {unit} is not determined by these runs; "
                "record a zigzag in which the rudder goes over several times."
            )
    return reasons


def sources_of(runs: Sequence[Run]) -> str:
    """Return where the runs came from, in words."""
    return ", ".join(run.source for run in runs)


def check_excitation(runs: Sequence[Run], speed: float) -> None:
    """Raise InputError where the rudder never moves or the boat makes no way at a mean `speed` [m/s]."""
    movement = max(float(np.ptp(segment.rudder)) for run in runs for segment in run.segments)
    if movement < LEAST_RUDDER_MOVEMENT_RAD:
        raise InputError(
            f"{sources_of(runs)}: the rudder never moves (by {np.degrees(movement):.2f} deg in all), so nothing can be "
            "identified; record a zigzag."
        )
    if speed < LEAST_SPEED_M_S:
        raise InputError(
            f"{sources_of(runs)}: the boat makes no way (mean speed {speed:.3f} m/s), so its rudder has nothing to "
            "steer with; check the speed column and its unit."
        )


def check_response(runs: Sequence[Run], start: StartingPoint) -> None:
    """Raise InputError where the motion does not follow the rudder, or follows it backwards."""
    if start.model.gain < 0.0 and start.explained > CLEARLY_BACKWARDS:
        raise InputError(
            f"{sources_of(runs)}: the boat turns against its rudder (K = {start.model.gain:.3g} 1/s explains "
            f"{100.0 * start.explained:.0f} % of the motion); rudder must be positive to starboard and heading "
            "clockwise: pass --reverse-rudder if the recorded rudder has the opposite sign."
        )
    if start.model.gain <= 0.0 or start.explained < LEAST_EXPLAINED:
        raise InputError(
            f"{sources_of(runs)}: the motion does not follow the rudder (it explains "
            f"{100.0 * max(start.explained, 0.0):.0f} % of it), so nothing can be identified; check that heading, "
            "yaw rate and rudder are the right columns and share one clock."
        )
