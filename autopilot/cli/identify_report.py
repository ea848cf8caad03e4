"""What `autopilot identify` found, as JSON (SI and radians, degrees beside) and as tables for people.

Which model `autopilot identify` is asked for, and the table of candidates where it shall choose.

`autopilot identify --wave-glider`: float and glider from the same recordings, side by side.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from autopilot.cli.terminal import ProgressBar
from autopilot.errors import InputError
from autopilot.files.printable import fixed
from autopilot.identification.identified import Identified, Question, SteadyTurns
from autopilot.identification.identify import identify, mean_speed
from autopilot.identification.methods import Method
from autopilot.identification.model_choice import FORMS, Candidate, Choice, choose
from autopilot.identification.registry import method_named, that_take
from autopilot.identification.residual_tests import Prediction, ResidualTest
from autopilot.identification.rudder_path import RudderRate, rate_sentence
from autopilot.identification.runs import Run
from autopilot.identification.two_stage import Nomoto, cubic_damping_stage, nomoto_stage
from autopilot.identification.wave_glider import BodyRuns, body_runs, identify_bodies
from autopilot.logs.csv_log import WAVE_GLIDER_NEEDS, load_column_map, read_csv

HEADINGS = ("candidate", "parameters", "held-out R2", "BIC less the least", "")


def form_of(arguments: argparse.Namespace) -> Question:
    """Return the form that --model, --course-unstable, --fit-rudder and --trim ask for; of auto, that of norrbin."""
    from autopilot.cli.identify import rudder_train

    named = FORMS[
        "nomoto1" if arguments.model == "nomoto" else arguments.model if arguments.model in FORMS else "norrbin"
    ]
    train = (*named.rudder_train, *(name for name in rudder_train(arguments) if name not in named.rudder_train))
    return named._replace(course_unstable=arguments.course_unstable, rudder_train=train, trim=arguments.trim)


def check_gain(arguments: argparse.Namespace, method: Method) -> None:
    """Raise InputError where --gain does not go with the method."""
    if arguments.gain != "constant" and "gain" not in method.takes:
        raise InputError(
            f"--gain {arguments.gain} goes with --method {that_take('gain')} alone; leave one of them out."
        )


def check_model(arguments: argparse.Namespace, method: Method) -> None:
    """Raise InputError where --model or --trim do not go with the other options."""
    asked = f"--model {arguments.model}" if arguments.model in ("auto", "nomoto2", "norrbin-n2") else ""
    asked, option = (asked, "models") if asked else ("--trim per-run" if arguments.trim == "per-run" else "", "trim")
    if asked and option not in method.takes:
        raise InputError(
            f"{asked} goes with --method {that_take(option)}, not with {method.name}; leave one of them out."
        )
    if asked and arguments.weighting == "prediction-error":
        raise InputError(f"{asked} and --weighting prediction-error exclude each other; leave one of them out.")
    if arguments.model == "auto" and (
        arguments.course_unstable or arguments.steady_turns or arguments.fit_rudder or arguments.trim == "per-run"
    ):
        raise InputError(
            "--model auto chooses by itself: leave out --course-unstable, --steady-turns, --fit-rudder and --trim."
        )


def chosen(runs: Sequence[Run], question: Question, progress: Callable[[int, int], None]) -> Choice:
    """Return the candidates fitted to the runs, stated at one speed, and the one to take."""
    speed = mean_speed(runs) if question.reference_speed is None else question.reference_speed

    def fit(some: Sequence[Run], form: Question) -> Identified:
        return identify(some, form._replace(reference_speed=speed))

    return choose(runs, fit, progress)


def choice_rows(choice: Choice) -> list[tuple[str, ...]]:
    """Return the table of candidates, the chosen one marked."""
    least = min(candidate.bic for candidate in choice.candidates)
    return [HEADINGS, *(_row(candidate, choice.chosen, least) for candidate in choice.candidates)]


def _row(candidate: Candidate, chosen_one: str, least: float) -> tuple[str, ...]:
    if candidate.found is None:
        return candidate.name, "-", "-", "-", candidate.reason
    score = f"{candidate.held_out:.4f}" if math.isfinite(candidate.held_out) else "-"
    mark = "chosen" if candidate.name == chosen_one else ""
    return candidate.name, str(candidate.parameters), score, f"{candidate.bic - least:.1f}", mark


def choice_sentence(choice: Choice) -> str:
    """Return how the candidates were compared, and what was chosen."""
    if choice.folds < 2:
        return f"Chosen: {choice.chosen}, by BIC alone: the record is too short to hold parts of it back."
    parts = f"{choice.folds} blocks of the run" if choice.by_blocks else f"{choice.folds} runs"
    return (
        f"Chosen: {choice.chosen}. Each of {parts} was predicted by a fit that had not seen it; of the candidates that "
        "do so equally well the one with the least BIC is taken."
    )


def choice_document(choice: Choice) -> dict[str, Any]:
    """Return the comparison for JSON; null where a number was not found."""
    return {
        "chosen": choice.chosen,
        "left_out": {"count": choice.folds, "of": "blocks" if choice.by_blocks else "runs"},
        "candidates": [
            {
                "name": candidate.name,
                "parameters": candidate.parameters if candidate.found else None,
                "held_out_r2": candidate.held_out if math.isfinite(candidate.held_out) else None,
                "bic": candidate.bic if math.isfinite(candidate.bic) else None,
                "reason": candidate.reason,
            }
            for candidate in choice.candidates
        ],
    }


DEG = math.pi / 180.0


class Quantity(NamedTuple):
    """A parameter's symbol, its name in the model, unit in radians, unit in degrees, and radians per degree-unit."""

    symbol: str
    name: str
    unit: str
    unit_deg: str
    factor: float


QUANTITIES = (
    Quantity("K", "gain", "1/s", "1/s", 1.0),
    Quantity("T", "time_constant", "s", "s", 1.0),
    Quantity("n3", "n3", "s^2/rad^2", "s^2/deg^2", DEG**-2),
    Quantity("n1", "n1", "1", "1", 1.0),
    Quantity("n0", "n0", "rad/s", "deg/s", DEG),
)

N2 = Quantity("n2", "n2", "s/rad", "s/deg", 1.0 / DEG)
"""Named only where it was found."""

AROUND = (
    Quantity("c_race", "race", "m^2", "m^2", 1.0),
    Quantity("c_wind_1", "wind_beam", "rad/m^2", "deg/m^2", DEG),
    Quantity("c_wind_2", "wind_quarter", "rad/m^2", "deg/m^2", DEG),
)
"""What propeller and wind add, where the recordings show it."""

BESIDE = (
    Quantity("race_w2", "steady_race", "m^2/s^2", "m^2/s^2", 1.0),
    Quantity("drift", "drift", "1", "1", 1.0),
    Quantity("drift_time", "drift_time", "s", "s", 1.0),
    Quantity("c_drift_wind", "drift_wind", "rad/m^2", "deg/m^2", DEG),
)
"""A race without recorded revolutions, and drift: named only where they were found."""

TRAIN = (
    Quantity("rudder_dead_band", "dead_band", "rad", "deg", DEG),
    Quantity("rudder_delay", "delay", "s", "s", 1.0),
    Quantity("rudder_lag", "lag", "s", "s", 1.0),
    Quantity("rudder_lead", "lead", "s", "s", 1.0),
)
"""What lies between the recorded rudder and the boat, where it was asked for and shows."""


class Result(NamedTuple):
    """Everything to print: the kind of model asked for or chosen, the estimate, stage one, each run with its role, the
    candidates where the kind was chosen, the rudder's measured rate, and remarks on the file that was written."""

    kind: str
    found: Identified
    stage_one: Nomoto | None
    predictions: Sequence[tuple[Run, str, Prediction]]
    residual_tests: Sequence[ResidualTest] = ()
    choice: Choice | None = None
    rudder_rate: RudderRate | None = None
    remarks: Sequence[str] = ()


def as_json(result: Result) -> str:
    """Return the result as JSON text; null where a number was not determined."""
    found, model = result.found, result.found.model
    document = {
        "model": result.kind,
        "parameters": {
            quantity.symbol: _parameter(quantity, value, found.standard_errors[quantity.name])
            for quantity, value in _known_quantities(found)
        },
        "reference_speed_m_s": model.reference_speed,
        "reference_propeller_rps": found.around.reference_propeller if found.around else None,
        "runs": [_run(run, role, prediction) for run, role, prediction in result.predictions],
        "unidentifiable": list(found.unidentifiable),
        "reasons": found.unidentifiable,
        "rudder_rate": result.rudder_rate
        and {
            "value_deg_s": math.degrees(result.rudder_rate.rate),
            "std_deg_s": math.degrees(result.rudder_rate.standard_error),
            "movements": result.rudder_rate.movements,
        },
        "notes": _notes(result),
        "two_stage": _stages(result),
        "trims_n0_rad_s": dict(found.trims),
        "model_choice": choice_document(result.choice) if result.choice else None,
        "residuals": {
            "yaw_rate_rms_rad_s": _finite(found.noise[0].size),
            "heading_rms_rad": _finite(found.noise[1].size),
            "tests": [_residual_test(test) for test in result.residual_tests],
        },
    }
    return json.dumps(document, indent=2, allow_nan=False)


def _quantities(found: Identified) -> list[tuple[Quantity, float]]:
    """Return what the model consists of, each with its value."""
    pairs = [(quantity, float(getattr(found.model, quantity.name))) for quantity in QUANTITIES]
    pairs += [(N2, found.model.n2)] if found.model.n2 != 0.0 else []
    if found.around is not None:
        recorded = AROUND if _felt(found) else ()
        pairs += [(quantity, float(getattr(found.around, quantity.name))) for quantity in recorded]
        pairs += [(q, float(getattr(found.around, q.name))) for q in BESIDE if getattr(found.around, q.name) != 0.0]
    pairs += [(q, float(getattr(found.train, q.name))) for q in TRAIN if getattr(found.train, q.name) != 0.0]
    return pairs


def _known_quantities(found: Identified) -> list[tuple[Quantity, float | None]]:
    """Return the same with None for a K or T that the recordings do not determine."""
    return [(q, None if q.symbol in undetermined(found) else value) for q, value in _quantities(found)]


def undetermined(found: Identified) -> tuple[str, ...]:
    """Return which of K and T, without which there is no model, the recordings do not determine."""
    return tuple(symbol for symbol in ("K", "T") if symbol in found.unidentifiable)


def _felt(found: Identified) -> bool:
    """Return whether the model uses recorded propeller or wind."""
    around = found.around
    return around is not None and (around.reference_propeller > 0.0 or around.wind_beam != 0.0)


def _parameter(quantity: Quantity, value: float | None, std: float | None) -> dict[str, Any]:
    return {
        "value": value,
        "std": std,
        "unit": quantity.unit,
        "value_deg": None if value is None else value / quantity.factor,
        "std_deg": None if std is None else std / quantity.factor,
        "unit_deg": quantity.unit_deg,
    }


def _notes(result: Result) -> list[str]:
    """Return what was left out of the recordings and what the method has to say, a sentence each."""
    return [*(note for run, _, _ in result.predictions for note in run.notes), *result.found.notes, *result.remarks]


def _run(run: Run, role: str, prediction: Prediction) -> dict[str, Any]:
    return {
        "file": run.source,
        "role": role,
        "seconds": prediction.seconds,
        "yaw_rate_r2": prediction.yaw_rate_r2,
        "heading_rms_deg": None if prediction.heading_rms is None else math.degrees(prediction.heading_rms),
        "segments": len(run.segments),
    }


def _residual_test(test: ResidualTest) -> dict[str, Any]:
    return {
        "signal": test.signal,
        "is_white": test.is_white,
        "whiteness_p": test.whiteness,
        "lag_one_correlation": test.lag_one,
        "memory_s": test.memory,
        "follows_rudder": test.follows_rudder,
        "rudder_correlation": test.rudder,
        "rudder_lag_s": test.rudder_lag,
        "rudder_correlation_by_chance": test.by_chance,
    }


def _stages(result: Result) -> dict[str, float | None]:
    stage_one, steady = result.stage_one, result.found.steady
    return {
        "K": stage_one.gain if stage_one else None,
        "T": stage_one.time_constant if stage_one else None,
        "n3": steady.n3 if steady else None,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def as_text(result: Result) -> str:
    """Return the result as tables and sentences."""
    found, model = result.found, result.found.model
    stages = _stages(result)
    rows = [("", "estimate", "standard error", "unit", "in degrees", "two-stage (RLS)")]
    for quantity, value in _known_quantities(found):
        std = found.standard_errors[quantity.name]
        in_degrees = None if value is None or quantity.factor == 1.0 else value / quantity.factor
        degrees = "" if in_degrees is None else f"{in_degrees:.5g} {quantity.unit_deg}"
        staged = stages.get(quantity.symbol)
        rows.append(
            (
                quantity.symbol,
                "not determined" if value is None else f"{value:.5g}",
                _spread(quantity, std),
                quantity.unit,
                degrees,
                "" if staged is None else f"{staged:.5g}",
            )
        )
    choice = [_table(choice_rows(result.choice)), choice_sentence(result.choice)] if result.choice else []
    parts = [
        *choice,
        f"Norrbin's model at {model.reference_speed:.4g} m/s ({model.reference_speed * 3600.0 / 1852.0:.3g} kn)",
        _table(rows),
        "Open-loop prediction from rudder and speed alone" + (", propeller and wind" if _felt(found) else ""),
        _table(_run_rows(result)),
        *_trims(found),
        *([f"Rudder rate: {rate_sentence(result.rudder_rate)}."] if result.rudder_rate else []),
        *found.unidentifiable.values(),
        *(" ".join(test.sentences()) for test in result.residual_tests),
        *_notes(result),
    ]
    return "\n\n".join(parts)


def _trims(found: Identified) -> list[str]:
    if not found.trims:
        return []
    each = ", ".join(f"{source} {n0 / DEG:.3g}" for source, n0 in found.trims)
    return [f"n0 of each run's own, deg/s: {each}; the model has their mean."]


def _spread(quantity: Quantity, std: float | None) -> str:
    if std is not None:
        return f"{std:.2g}"
    # some methods find K and T but no honest error of them
    return "not given" if quantity.symbol in ("K", "T") else "held"


def _run_rows(result: Result) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("run", "role", "seconds", "R2 of yaw rate", "heading rms deg")]
    for run, role, prediction in result.predictions:
        r2, rms = prediction.yaw_rate_r2, prediction.heading_rms
        rows.append(
            (
                run.source,
                role,
                f"{prediction.seconds:.1f}",
                "-" if r2 is None else fixed(r2, 3),
                "-" if rms is None else fixed(math.degrees(rms), 1),
            )
        )
    return rows


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(_line(row, widths) for row in rows)


def _line(row: Sequence[str], widths: Iterable[int]) -> str:
    return "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def steady_report(turns: SteadyTurns, gain: float, *, as_json: bool) -> str:
    """Return n3 from steady turns alone, with K [1/s] given: Jiang 2016's second stage."""
    cubic = cubic_damping_stage(turns.rudder, turns.rate, gain)
    values = {"gain": gain, "time_constant": None, "n3": cubic.n3, "n1": 1.0, "n0": 0.0}
    if as_json:
        document = {
            "model": "norrbin",
            "parameters": {
                q.symbol: _parameter(q, values[q.name], cubic.standard_error if q.symbol == "n3" else None)
                for q in QUANTITIES
            },
            "reference_speed_m_s": None,
            "runs": [],
            "unidentifiable": ["T"],
            "reasons": {"T": "T: steady turns tell nothing of the time constant; record a zigzag."},
        }
        return json.dumps(document, indent=2, allow_nan=False)
    error = "" if cubic.standard_error is None else f" +- {cubic.standard_error:.2g}"
    error_deg = "" if cubic.standard_error is None else f" +- {cubic.standard_error * DEG**2:.2g}"
    return (
        f"K   {gain:.5g} 1/s (given)\n"
        f"n3  {cubic.n3:.5g}{error} s^2/rad^2  =  {cubic.n3 * DEG**2:.5g}{error_deg} s^2/deg^2\n\n"
        "Steady turns tell nothing of the time constant T; record a zigzag."
    )


NOT_HERE = ("out", "report", "steady_turns", "vessel")
"""Options that have no meaning for a craft of two bodies."""


def identify_wave_glider(arguments: argparse.Namespace) -> str:
    """Return what is found of both bodies, as text or JSON. Raises InputError."""
    for name in NOT_HERE:
        if getattr(arguments, name):
            raise InputError(f"--{name.replace('_', '-')} does not go with --wave-glider; leave one of them out.")
    if not arguments.logs:
        raise InputError("identify --wave-glider needs a LOG, a CSV table with the headings of both bodies.")
    method = method_named(arguments.method)
    check_gain(arguments, method)
    fitted, held_out = _load(arguments.logs, arguments), _load(arguments.holdout, arguments)
    question = Question(
        arguments.model,
        arguments.reference_speed_m_s,
        forgetting=arguments.forgetting,
        particle_gain=arguments.gain,
    )
    with ProgressBar("identifying") as bar:
        found = identify_bodies(fitted, method, question._replace(progress=bar.update))
    results = {
        name: _result(arguments.model, body, [r[place] for r in fitted], [r[place] for r in held_out])
        for place, (name, body) in enumerate((("float", found.surface), ("glider", found.glider)))
    }
    if arguments.json:
        bodies = {name: json.loads(as_json(result)) for name, result in results.items()}
        return json.dumps({"fixed_angle_deg": arguments.fixed_angle_deg, **bodies}, indent=2, allow_nan=False)
    text = [f"{name.upper()}\n\n{as_text(result)}" for name, result in results.items()]
    return "\n\n\n".join(text) + f"\n\nK of the float holds for delta_0 = {arguments.fixed_angle_deg:g} deg."


def _load(paths: list[str], arguments: argparse.Namespace) -> list[BodyRuns]:
    column_map = load_column_map(arguments.columns) if arguments.columns else None
    records = []
    for path in paths:
        table, notes = read_csv(path, column_map, WAVE_GLIDER_NEEDS)
        if arguments.reverse_rudder:
            table["rudder_rad"] = -table["rudder_rad"]
        found = body_runs(path, table, math.radians(arguments.fixed_angle_deg))
        records.append(BodyRuns(*(run._replace(notes=(*notes, *run.notes)) for run in found)))
    return records


def _result(kind: str, found: Identified, fitted: list[Run], held_out: list[Run]) -> Result:
    predictions = [(run, "fit", found.predict(run)) for run in fitted]
    predictions += [(run, "holdout", found.predict(run)) for run in held_out]
    return Result(kind, found, nomoto_stage(fitted, found.model.reference_speed), predictions)
