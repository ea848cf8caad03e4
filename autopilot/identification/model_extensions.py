"""What turns a boat beside the rudder as recorded: propeller, wind, and the rudder's own train; kept where it shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from autopilot.identification.identified import LARGEST_RELATIVE_ERROR, Identified, Steps, identified_from
from autopilot.identification.output_error import Solution, solve
from autopilot.identification.residuals import NO_TRIMS, Fitted, RunTrims, typical_rate
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import Run, Segment, has_propeller, has_wind
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
SPEED_VARIES = 0.1
"""A race at revolutions that nobody recorded is looked for where the speed varies by this share of its mean."""
START_RACE = 0.5
"""Where the fit of the race begins: c n0^2/U0^2."""
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
        around = around._replace(race=START_RACE * (start.reference_speed / around.reference_propeller) ** 2)
    if "steady_race" in names:
        around = around._replace(steady_race=START_RACE * start.reference_speed**2)
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
    return drifting if is_significant and 0.0 < drifting.around.drift < 1.0 else None


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
    """Return the fit without the parameters `gone`."""
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
    """Return the parameter that is hardest to distinguish from zero; '' where all can. What stands
    together counts as its best."""
    doubt = {name: _relative_error(solution, name) for name in names if name in solution.free}
    for group in TOGETHER:
        if group[0] in doubt:
            held = [name for name in group if name in doubt]
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
