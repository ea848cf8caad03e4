"""Which model the runs deserve: candidates compared by what they predict and by an information criterion.

Each candidate is fitted to all runs but one, which it then predicts open loop from rudder and speed; where there is
one run alone, blocks of it stand for runs. What was not predicted, over all runs left out together, makes the held-out
R2. Schwarz's criterion (1978) is taken of the fit to everything,

    BIC = sum over rate and heading of N_eff ln s^2 + k ln N_eff,   N_eff = N (1 - rho)/(1 + rho),

with N_eff the independent samples that correlated residuals are worth (rho from sample to sample, of the candidate that
explains the rate best, the same for all). Of the candidates that predict as well as the best one within one standard
error of the difference, from run to run (Breiman et al. 1984), or within what matters, the one with the least BIC is
chosen. A candidate that explains even the runs it is fitted to much worse than another need predict nothing.

Candidates beyond the rudder as recorded: propeller, wind, and the rudder's own train; each is kept where it shows.

The model that steers: what laws and gains are designed from, where the fit knows more than they do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import (
    LARGEST_RELATIVE_ERROR,
    Identified,
    Question,
    Ratios,
    Steps,
    identified_from,
)
from autopilot.identification.likelihood_record import USUAL_RACE, usual_race
from autopilot.identification.output_error import Solution, solve
from autopilot.identification.residuals import NO_TRIMS, Fitted, RunTrims, typical_rate
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import SHORTEST_SEGMENT_SAMPLES, FloatArray, Run, Segment, has_propeller, has_wind
from autopilot.models.norrbin import Norrbin
from autopilot.models.weather import RaceAndWind, without_drift

CUBIC = ("gain", "time_constant", "n3", "n0")
DAMPING = ("n3", "n2")
WIND = ("wind_beam", "wind_quarter")
DRIFT = ("drift", "drift_time", "drift_wind")
TURN = ("steady_race", "n3")
"""What holds against what in a turn: the lost speed that leaves the rudder its force, and the cubic damping."""
TOGETHER = (WIND, DRIFT, TURN)
"""What stands and falls together."""
START_DRIFT = 0.3
"""Where the fit of the drift begins; its time begins at half of T, its wind at none."""
SURELY = 1.0 / 3.0
"""Drift brings three parameters at once, so its share must be distinguished from zero at three standard errors."""
SETTLED, LEAST_DRIFT, MOST_DRIFT = 0.5, 0.25, 0.9
"""Drift's time must be below this share of the longest run, and its share between these: near 1, what is left of the
boat's own T and K is nothing, and anything slow is explained by it; a small one is in K and T of the first order."""
LONGEST_DRIFT = 3.0
"""And its time below so many T. Of a Mariner, with T1 118, T2 7.8 and T3 18.5 s (Fossen's Marine Systems Simulator),
drift has a share of 0.76 and a time of 1.5 T, of the 3 m tanker model 0.47 and 1.4 T. In gusts runs show 0.1 to 0.2 of
1.5 T, or more of 4 to 16 T, where there is none."""
SPEED_VARIES = 0.1
"""A race at revolutions that nobody recorded is looked for where the speed varies by this share of its mean."""
START_N3 = 0.2
"""Where the fit of n3 beside a race begins, in units of the typical rate squared."""
WORTH_IT = 0.98
"""Propeller and wind must take the residuals of the rate below this share of what they are without."""

LARGEST_RACE = 9.0
"""A race w^2 beyond this many times the largest speed's square: three times as fast as the boat, no propeller's."""

START_TRAIN = 0.1
"""Where the fit of delay, lag and lead begins, as a share of T."""
START_DEAD_BAND = 0.01
"""Where that of the dead band begins [rad]."""


def extended(
    runs: Sequence[Run],
    plain: Identified,
    asked: Sequence[str],
    steps: Steps,
    base: tuple[str, ...] = CUBIC,
    trims: RunTrims = NO_TRIMS,
) -> Identified:
    """Fit propeller race and wind moment too where recorded, and what was `asked` of the rudder's train; drop what the
    runs do not show, one after the other. base: what is fitted with them, `trims` the runs' own where it names them;
    without n3 in it, propeller and wind are left out."""
    names = (_race(runs) + (WIND if has_wind(runs) else ()) if "n3" in base else ()) + tuple(asked)
    if not names:
        return plain
    train = DIRECT._replace(**{name: _begin_with(name, plain.model) for name in asked})
    start = plain.model
    if "n3" in base:
        start = start._replace(n3=max(start.n3, START_N3 / typical_rate(_segments(runs)) ** 2))
    around = RaceAndWind(race=0.0, reference_propeller=mean_propeller(runs) if "race" in names else 0.0)
    if "race" in names:
        around = around._replace(race=usual_race(start.reference_speed, around.reference_propeller))
    if "steady_race" in names:
        around = around._replace(steady_race=USUAL_RACE * start.reference_speed**2)
    found = solve(runs, Fitted(start, around, train, trims), (*base, *names), steps.next)
    if "n3" in base and has_wind(runs) and (drifting := _with_drift(runs, found, steps)) is not None:
        found, names = drifting, (*names, *DRIFT)
    reasons: dict[str, str] = {}
    while weakest := _least_shown(found, (*DAMPING, *names)):
        gone = _falling(weakest, found)
        smaller = _without(runs, found, gone, steps)
        if _is_better(found, smaller, runs):
            # two that work in the same moments may each be uncertain and yet be needed together
            kept = [name for name in (*DAMPING, *names) if _is_uncertain(found, name)]
            return _extended(found, plain, {**reasons, **{name: _kept_together(name, found) for name in kept}}, runs)
        reasons.update({name: _not_shown(name, found) for name in gone})
        names = tuple(name for name in names if name not in gone)
        found = smaller
        if not names:
            return plain._replace(unidentifiable={**reasons, **plain.unidentifiable})
    only_around = not any(name in RudderTrain._fields for name in names)
    if only_around and found.noise[0].size > WORTH_IT * plain.noise[0].size:
        reasons.update({name: _not_worth(name, trims) for name in names if name in (*WIND, "race")})
        return plain._replace(unidentifiable={**reasons, **plain.unidentifiable})
    if found.around.steady_race > LARGEST_RACE * _fastest(runs) ** 2:
        reason = (
            "race_w2: the fit ends at a race beside which the boat's speed would not count, which no propeller makes, "
            "so it is held at 0; record the propeller's revolutions."
        )
        return plain._replace(unidentifiable={**reasons, "race_w2": reason, **plain.unidentifiable})
    if _is_uncertain(found, "n3"):
        reasons["n3"] = _kept_together("n3", found)
    return _extended(found, plain, reasons, runs)


def may_extend(runs: Sequence[Run]) -> bool:
    """Return whether the runs may tell of a propeller's race or of wind."""
    return has_wind(runs) or bool(_race(runs))


def _not_worth(name: str, trims: RunTrims) -> str:
    beside = "; an n0 of each run's own takes what the wind did" if trims.names and name in WIND else ""
    return f"{name}: explains less than 2 % of what is left without it, so it is left out{beside}."


def _fastest(runs: Sequence[Run]) -> float:
    return max(float(np.max(np.abs(segment.speed))) for segment in _segments(runs))


def _race(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return the race that the runs may tell: of recorded revolutions, or of unknown ones that stayed the same."""
    if has_propeller(runs):
        return ("race",) if mean_propeller(runs) > 0.0 else ()
    speed = np.abs(np.concatenate([segment.speed for segment in _segments(runs)]))
    return ("steady_race",) if float(np.std(speed)) > SPEED_VARIES * float(np.mean(speed)) else ()


def _with_drift(runs: Sequence[Run], found: Solution, steps: Steps) -> Solution | None:
    """Return the fit with drift before the wind beside everything in `found`, None where the runs do not ask for it."""
    around = found.around._replace(drift=START_DRIFT, drift_time=0.5 * found.model.time_constant)
    drifting = solve(runs, found.fitted._replace(around=around), (*found.free, *DRIFT), steps.next)
    is_significant = (
        _relative_error(drifting, "drift") < SURELY and drifting.noise[0].size < WORTH_IT * found.noise[0].size
    )
    # what has not settled when a run ends, or lasts longer than hulls slide, is gusts or an offset of that run
    longest = max(float(s.time[-1] - s.time[0]) for s in _segments(runs))
    settles = drifting.around.drift_time < min(SETTLED * longest, LONGEST_DRIFT * drifting.model.time_constant)
    return drifting if is_significant and settles and LEAST_DRIFT < drifting.around.drift < MOST_DRIFT else None


def _extended(found: Solution, plain: Identified, reasons: dict[str, str], runs: Sequence[Run]) -> Identified:
    result = identified_from(found, reasons, runs)
    has_around = any(name in RaceAndWind._fields for name in found.free)
    extras = (*(RaceAndWind._fields if has_around else ()), *RudderTrain._fields)
    errors = {**result.standard_errors, **{name: found.standard_error(name) for name in extras}}
    around = found.around if has_around else None
    notes = result.notes
    if around is not None and around.drifts:
        steering = without_drift(found.model, around)
        notes = (
            *notes,
            f"drift: to a slow rudder this boat has K {steering.gain:.4g} 1/s, T {steering.time_constant:.4g} s; "
            "that goes into a vessel file, and gains are designed from it.",
        )
    return result._replace(
        around=around, plain=plain.model, standard_errors=errors, train=found.fitted.train, notes=notes
    )


def _without(runs: Sequence[Run], found: Solution, gone: Sequence[str], steps: Steps) -> Solution:
    free = tuple(name for name in found.free if name not in gone)
    model, around, train, trims = found.fitted
    around = around._replace(**{name: 0.0 for name in gone if name in RaceAndWind._fields})
    train = train._replace(**{name: 0.0 for name in gone if name in RudderTrain._fields})
    model = model._replace(**{name: 0.0 for name in gone if name in DAMPING})
    return solve(runs, Fitted(model, around, train, trims), free, steps.next)


def _is_better(larger: Solution, smaller: Solution, runs: Sequence[Run]) -> bool:
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


def _kept_together(name: str, solution: Solution) -> str:
    error = solution.standard_error(name) or 0.0
    return (
        f"{name}: {_value(solution, name):.3g} with a standard error of {error:.2g} is kept, for without it the runs "
        "are explained clearly worse, but it cannot be distinguished from the others; trials at other speeds would."
    )


def _least_shown(solution: Solution, names: Sequence[str]) -> str:
    """Return the parameter that is hardest to distinguish from zero; '' where all can. What stands together counts as
    its best, but for what ended at its bound: that is not there."""
    doubt = {name: _relative_error(solution, name) for name in names if name in solution.free}
    for group in TOGETHER:
        held = [name for name in group if name in doubt and name not in solution.at_bound]
        if group[0] in held:
            doubt.update(dict.fromkeys(held, min(doubt[name] for name in held)))
    weak = {name: value for name, value in doubt.items() if value > LARGEST_RELATIVE_ERROR}
    return max(weak, key=lambda name: weak[name]) if weak else ""


def _falling(weakest: str, solution: Solution) -> tuple[str, ...]:
    """Return what goes when `weakest` does: of what counts in a turn the race first, and then n3 is asked again."""
    if weakest in TURN:
        return tuple(name for name in TURN if name in solution.free)[:1]
    group = next((group for group in TOGETHER if weakest in group), (weakest,))
    return tuple(name for name in group if name in solution.free)


def _relative_error(solution: Solution, name: str) -> float:
    if name in solution.at_bound:
        return float("inf")
    return (solution.standard_error(name) or 0.0) / max(abs(_value(solution, name)), 1.0e-300)


def _not_shown(name: str, solution: Solution) -> str:
    error = solution.standard_error(name) or 0.0
    return (
        f"{name}: {_value(solution, name):.3g} with a standard error of {error:.2g} cannot be distinguished from 0, so "
        f"it is held at 0; {_remedy(name)} would tell it."
    )


def _remedy(name: str) -> str:
    if name in RudderTrain._fields:
        return "trials with quick reversals, sampled well within that time,"
    return "trials at other speeds and in stronger wind"


def _value(solution: Solution, name: str) -> float:
    held = next(part for part in solution.fitted[:3] if name in part._fields)
    return float(getattr(held, name))


def _begin_with(name: str, model: Norrbin) -> float:
    """Return where the fit of a part of the rudder's train begins: what one would hardly notice."""
    return START_DEAD_BAND if name == "dead_band" else START_TRAIN * model.time_constant


def _segments(runs: Sequence[Run]) -> list[Segment]:
    return [segment for run in runs for segment in run.segments]


def mean_propeller(runs: Sequence[Run]) -> float:
    """Return the mean revolutions ahead [1/s] over the runs' recorded time: the reference for the propeller's race."""
    turns = sum(float(np.trapezoid(np.maximum(s.propeller, 0.0), s.time)) for s in _segments(runs))
    return turns / sum(float(s.time[-1] - s.time[0]) for s in _segments(runs))


BLOCKS = 4
"""Into so many parts of one length a run that is alone is cut."""
MATTERS = 0.005
"""A difference of held-out R2 below this is none."""
MUCH_WORSE = 1.5
"""Residuals this many times as large as another candidate's need not be tried on runs left out."""
EXPLAINED = 0.3
"""Residuals whose correlation from sample to sample is below this are the instruments': a boat that will not go
straight by itself is not looked for then."""
LEAST_WORTH = 2.0
"""Independent samples that a record is at least taken to be worth."""


SECOND_ORDER = ("lag", "lead")
FORMS = {
    "nomoto": Question("nomoto"),
    "nomoto2": Question("nomoto", rudder_train=SECOND_ORDER),
    "norrbin": Question(weighting="residuals"),
    "norrbin-n2": Question(quadratic=True),
    "norrbin unstable": Question(course_unstable=True, weighting="residuals"),
}
"""The candidates, by name; the first four may be asked for by it. All are fitted alike, so that their residuals
compare."""
PER_RUN = ", trim per run"

Fit = Callable[[Sequence[Run], Question], Identified]
"""Fits a form to runs; raises InputError where they do not let it."""


class Candidate(NamedTuple):
    """A form and what came of it: found, None where it was refused with `reason`; held_out R2 of the yaw rate (or of
    the heading where no rate is measured) on runs left out, and what each of them takes from it; bic; parameters: how
    many were fitted."""

    name: str
    form: Question
    found: Identified | None
    held_out: float = -math.inf
    errors: tuple[float, ...] = ()
    bic: float = math.inf
    parameters: int = 0
    reason: str = ""


class Choice(NamedTuple):
    """The candidates, the name of the chosen one, how many runs or blocks were left out in turn, and which of both."""

    candidates: tuple[Candidate, ...]
    chosen: str
    folds: int
    by_blocks: bool

    @property
    def found(self) -> Identified:
        """The chosen candidate's fit to everything."""
        found = next(candidate.found for candidate in self.candidates if candidate.name == self.chosen)
        assert found is not None
        return found

    @property
    def form(self) -> Question:
        """The chosen candidate's form."""
        return next(candidate.form for candidate in self.candidates if candidate.name == self.chosen)


def choose(runs: Sequence[Run], fit: Fit, progress: Callable[[int, int], None] = lambda done, total: None) -> Choice:
    """Return the candidates and the one to take; of several runs, trims of their own are tried for the best form too.

    Raises the first candidate's InputError where none can be fitted.
    """
    parts = list(runs) if len(runs) > 1 else blocks(runs[0])
    total = len(FORMS) + (len(runs) > 1)
    tried: list[Candidate] = []
    for name, form in FORMS.items():
        if form.course_unstable and any(_is_noise(candidate) for candidate in tried):
            reason = "the runs are explained down to the instruments' noise without it."
            tried.append(Candidate(name, form, None, reason=reason))
        else:
            tried.append(_candidate(name, form, runs, parts, fit, tried))
        progress(len(tried), total)
    if all(candidate.found is None for candidate in tried):
        raise InputError(tried[0].reason)
    best = _best(_judged(tried, runs))
    if len(runs) > 1:
        own = best.form._replace(trim="per-run")
        tried.append(_candidate(best.name + PER_RUN, own, runs, parts, fit, tried))
        progress(total, total)
    judged = _judged(tried, runs)
    return Choice(tuple(judged), _best(judged).name, len(parts), len(runs) == 1)


def blocks(run: Run) -> list[Run]:
    """Return parts of one duration of a run; fewer where too little was recorded in one of them, [] where that leaves
    less than two."""
    begin, end = run.segments[0].time[0], run.segments[-1].time[-1]
    edges = np.linspace(begin, end, BLOCKS + 1)
    edges[-1] = math.inf
    parts = [_between(run, first, last) for first, last in pairwise(edges)]
    known = [part for part in parts if part.segments]
    return known if len(known) > 1 else []


def _between(run: Run, begin: float, end: float) -> Run:
    segments = []
    for segment in run.segments:
        inside = (segment.time >= begin) & (segment.time < end)
        if np.count_nonzero(inside) >= SHORTEST_SEGMENT_SAMPLES:
            segments.append(Segment(*(values[inside] if values.size else values for values in segment)))
    return run._replace(segments=tuple(segments))


def _candidate(
    name: str, form: Question, runs: Sequence[Run], parts: Sequence[Run], fit: Fit, others: Sequence[Candidate]
) -> Candidate:
    try:
        found = fit(runs, form)
    except InputError as error:
        return Candidate(name, form, None, reason=str(error))
    for other in others:
        if other.found is not None and _is_like(found, other.found):
            reasons = " ".join(found.unidentifiable.values())
            return Candidate(name, form, None, reason=f"comes to the same as {other.name}. {reasons}".strip())
        if other.found is not None and _size(found) > MUCH_WORSE * _size(other.found):
            return Candidate(name, form, None, reason=f"explains the runs much worse than {other.name}.")
    lost, spread = [], []
    for i, part in enumerate(parts):
        try:
            without = fit([*parts[:i], *parts[i + 1 :]], form)
        except InputError:
            continue
        missed, varied = _missed(without, part)
        lost.append(missed)
        spread.append(varied)
    held_out = 1.0 - sum(lost) / sum(spread) if sum(spread) > 0.0 else -math.inf
    errors = tuple(missed / max(sum(spread), 1.0e-300) for missed in lost) if len(lost) == len(parts) else ()
    count = len(found.free) + max(len(found.trims) - 1, 0)
    return Candidate(name, form, found, held_out, errors, parameters=count)


def _is_like(found: Identified, other: Identified) -> bool:
    """Return whether two fits have the same parameters."""
    return (
        set(found.free) == set(other.free) and found.model.n1 == other.model.n1 and len(found.trims) == len(other.trims)
    )


def _is_noise(candidate: Candidate) -> bool:
    if candidate.found is None:
        return False
    rate, heading = candidate.found.noise
    return (rate if rate.size > 0.0 else heading).correlation < EXPLAINED


def _size(found: Identified) -> float:
    """Return the size of the rate's residuals [rad/s], or of the heading's [rad] where no rate is measured."""
    return found.noise[0].size if found.noise[0].size > 0.0 else found.noise[1].size


def _missed(found: Identified, run: Run) -> tuple[float, float]:
    """Return the sum of squares that was not predicted, and that about the mean: of the rate, or else of the
    heading."""
    simulated = found.simulated(run)
    column = 0 if any(np.isfinite(segment.rate).any() for segment in run.segments) else 1
    measured = np.concatenate([segment.rate if column == 0 else segment.heading for segment in run.segments])
    error = np.concatenate([values[:, column] for values in simulated]) - measured
    known = np.isfinite(error)
    return float(np.sum(error[known] ** 2)), float(np.sum((measured[known] - np.mean(measured[known])) ** 2))


def _judged(tried: Sequence[Candidate], runs: Sequence[Run]) -> list[Candidate]:
    """Return the candidates with their criteria, all of them for the same worth of samples."""
    fitted = [candidate.found for candidate in tried if candidate.found is not None]
    closest = min(fitted, key=_size)
    segments = [segment for run in runs for segment in run.segments]
    worth = []
    for column, noise in enumerate(closest.noise):
        measured: list[FloatArray] = [segment.rate if column == 0 else segment.heading for segment in segments]
        count = sum(int(np.count_nonzero(np.isfinite(values))) for values in measured)
        share = (1.0 - noise.correlation) / (1.0 + noise.correlation) if count else 0.0
        worth.append(max(count * share, LEAST_WORTH) if count else 0.0)
    return [candidate._replace(bic=_criterion(candidate, worth)) for candidate in tried]


def _criterion(candidate: Candidate, worth: Sequence[float]) -> float:
    if candidate.found is None:
        return math.inf
    misfit = sum(
        2.0 * each * math.log(noise.size) for each, noise in zip(worth, candidate.found.noise, strict=True) if each
    )
    return misfit + candidate.parameters * math.log(max(sum(worth), LEAST_WORTH))


def _best(judged: Sequence[Candidate]) -> Candidate:
    """Return the one with the least criterion of those that predict as well as the best."""
    fitted = [candidate for candidate in judged if candidate.found is not None]
    first = max(fitted, key=lambda candidate: candidate.held_out)
    alike = [candidate for candidate in fitted if _predicts_like(candidate, first)]
    return min(alike, key=lambda candidate: candidate.bic)


def _predicts_like(candidate: Candidate, best: Candidate) -> bool:
    if candidate is best:
        return True
    if not candidate.errors or len(candidate.errors) != len(best.errors):
        return False
    behind = np.array(candidate.errors) - np.array(best.errors)
    return float(np.sum(behind)) <= max(float(np.std(behind, ddof=1)) * math.sqrt(behind.size), MATTERS)


NAMES = ("gain", "time_constant", "n3", "n0")
PROBE = 1.0e-4
"""Share of a parameter over which slopes are taken."""


def filed_model(found: Identified) -> tuple[Norrbin, dict[str, float | None]]:
    """Return the model that a vessel file holds, and its standard errors; where n1/T may be 0, `ridge_model`."""
    if found.ratios is not None and found.ratios.on_ridge and found.likely is not None:
        return ridge_model(found.ratios, found.likely.covariance, found.model.reference_speed)
    return steering_model(found), steering_errors(found)


def ridge_model(
    ratios: Ratios, covariance: FloatArray, speed: float, rate: float | None = None
) -> tuple[Norrbin, dict[str, float | None]]:
    """Return the likeliest boat whose n1/T is `rate` [1/s], and what is then not known of it; None: the rate nearest to
    the estimate that gives no T longer than the runs could tell, one standard error.

    Where n1/T may be 0, K and T have one doubt in common, without end, and K/T has not: two standard errors by
    themselves would be those of boats that the runs exclude. So the file has K's at this T, and none of T. covariance:
    of K/T, n1/T, n3/T and n0/T, shape (4, 4).
    """
    b = ratios.values[1]
    b_here = math.copysign(max(abs(b), ratios.errors[1]), b) if rate is None else rate
    by, T = covariance[1] / covariance[1, 1], 1.0 / abs(b_here)
    a, _, d, e = np.array(ratios.values) + by * (b_here - b)
    left = np.sqrt(np.maximum(np.diag(covariance - np.outer(by, covariance[1])), 0.0)) * T
    a = a if a > 0.0 else ratios.values[0]
    model = Norrbin(a * T, T, max(d, 0.0) * T, n1=math.copysign(1.0, b_here), n0=e * T, reference_speed=speed)
    return model, {"gain": float(left[0]), "time_constant": None, "n3": float(left[2]), "n0": float(left[3])}


def steering_model(found: Identified) -> Norrbin:
    """Return the model of first order at the reference speed: the one found, or with drift what it comes to."""
    return found.model if found.around is None or not found.around.drifts else without_drift(found.model, found.around)


def steering_errors(found: Identified) -> dict[str, float | None]:
    """Return the standard errors of `steering_model` by parameter, with drift carried on from the fit's covariance."""
    around, covariance = found.around, found.covariance
    if around is None or not around.drifts or covariance is None:
        return found.standard_errors
    here, slope = _values(found.model, around), np.zeros((len(NAMES), len(found.free)))
    for column, name in enumerate(found.free):
        model, beside, by = _moved(found.model, around, name)
        if by > 0.0:
            slope[:, column] = (_values(model, beside) - here) / by
    variance = np.einsum("pf,fg,pg->p", slope, covariance, slope)
    errors = dict(zip(NAMES, np.sqrt(np.maximum(variance, 0.0)).tolist(), strict=True))
    return {**found.standard_errors, **{name: errors[name] for name in NAMES if name in found.free}}


def _values(model: Norrbin, around: RaceAndWind) -> FloatArray:
    steering = without_drift(model, around)
    return np.array([getattr(steering, name) for name in NAMES])


def _moved(model: Norrbin, around: RaceAndWind, name: str) -> tuple[Norrbin, RaceAndWind, float]:
    """Return the model and its surroundings with one parameter moved, and by how much; 0 where it does not count."""
    if name in NAMES:
        by = PROBE * max(abs(getattr(model, name)), PROBE)
        return model._replace(**{name: getattr(model, name) + by}), around, by
    if name in ("drift", "drift_time"):
        by = PROBE * getattr(around, name)
        return model, around._replace(**{name: getattr(around, name) + by}), by
    return model, around, 0.0
