"""What was found of a boat, how sure it is, and measured beside predicted: as JSON, and as tables for people.

JSON has SI units and radians, and degrees beside them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from autopilot.files.printable import aligned, fixed, json_text
from autopilot.identification.identified import Identified, SteadyTurns
from autopilot.identification.interval import interval_of
from autopilot.identification.model_choice import Candidate, Choice
from autopilot.identification.prediction_bands import AHEAD_S, TURNING_RAD, Band, Forecast
from autopilot.identification.residual_tests import Prediction, ResidualTest
from autopilot.identification.rudder_path import RudderRate, rate_sentence
from autopilot.identification.runs import Run
from autopilot.identification.two_stage import Nomoto, cubic_damping_stage
from autopilot.identification.verdict import GearCheck, Verdict, verdict_of

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


ALL = (*QUANTITIES, N2, *AROUND, *BESIDE, *TRAIN)

RATIOS = (("K/T", "1/s^2"), ("n1/T", "1/s"), ("n3/T", "s/rad^2"), ("n0/T", "rad/s^2"))
"""What is determined of a boat of either stability, where the method gives it."""


class Result(NamedTuple):
    """Everything to tell: the kind of model asked for or chosen, the estimate, stage one, each run with its role and
    prediction, the tests of the residuals, the candidates where the kind was chosen, the rudder's measured rate,
    remarks on the file that was written, what the boat will do in manoeuvres that were not sailed, whether the
    rudder is that of the vessel file, and why no gains serve the boat, "" where some do or nobody looked."""

    kind: str
    found: Identified
    stage_one: Nomoto | None
    predictions: Sequence[tuple[Run, str, Prediction]]
    residual_tests: Sequence[ResidualTest] = ()
    choice: Choice | None = None
    rudder_rate: RudderRate | None = None
    remarks: Sequence[str] = ()
    forecast: Forecast | None = None
    gear: GearCheck = GearCheck()
    no_gains: str = ""


def document_of(result: Result) -> dict[str, Any]:
    """Return the result as it is for programs; None where a number was not determined."""
    found, model, verdict = result.found, result.found.model, verdict_on(result)
    return {
        "verdict": {"grade": verdict.grade, "sentence": verdict.sentence},
        "model": result.kind,
        "parameters": {
            quantity.symbol: _parameter(quantity, value, found.standard_errors[quantity.name])
            for quantity, value in known_quantities(found)
        },
        "ratios": _ratios(found),
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
        "steering_gear": {"against": list(result.gear.against), "beside": result.gear.beside},
        "notes": notes(result),
        "two_stage": _stages(result),
        "trims_n0_rad_s": dict(found.trims),
        "sliding": _sliding(found),
        "forecast": forecast_document(result.forecast),
        "model_choice": choice_document(result.choice) if result.choice else None,
        "residuals": {
            "yaw_rate_rms_rad_s": found.noise[0].size,
            "heading_rms_rad": found.noise[1].size,
            "tests": [_residual_test(test) for test in result.residual_tests],
        },
    }


def verdict_on(result: Result) -> Verdict:
    """Return what the model is good for; where no gains serve the boat, for nothing."""
    if result.no_gains:
        return Verdict("not enough", f"not enough: {result.no_gains}")
    fitted = [prediction for _, role, prediction in result.predictions if role == "fit"]
    return verdict_of(result.found, fitted, result.residual_tests, result.gear)


def _sliding(found: Identified) -> dict[str, Any] | None:
    if found.sliding is None:
        return None
    model, fit = found.sliding
    numbers = {"K_1_s": model.gain, "T1_s": model.time_constant, "n1": model.n1, "n3_s2_rad2": model.n3}
    return {
        **numbers,
        "T2_s": {"value": fit.train.lag, "std": fit.train_errors["lag"]},
        "T3_s": {"value": fit.train.lead, "std": fit.train_errors["lead"]},
    }


def _ratios(found: Identified) -> dict[str, dict[str, Any]] | None:
    if found.ratios is None:
        return None
    return {
        symbol: {
            "value": value,
            "std": std,
            "interval_95": list(interval_of(symbol, value, std)),
            "unit": unit,
        }
        for (symbol, unit), value, std in zip(RATIOS, *found.ratios, strict=True)
    }


def _ratio_rows(found: Identified) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("", "estimate", "standard error", "95 % interval", "unit")]
    for symbol, each in (_ratios(found) or {}).items():
        low, high = each["interval_95"]
        rows.append((symbol, f"{each['value']:.4g}", f"{each['std']:.2g}", f"{low:.4g} ... {high:.4g}", each["unit"]))
    return rows


def _bands_of(ahead: Forecast | None) -> list[tuple[str, Band]]:
    """Return what the boat will do, by what is asked."""
    if ahead is None:
        return []
    bands = [(f"heading {AHEAD_S:g} s after {math.degrees(TURNING_RAD):g} deg of rudder", ahead.heading)]
    for angle, both in ahead.overshoots.items():
        numbered = zip(("first", "second"), both, strict=True)
        bands += [(f"{number} overshoot of a {angle:g}/{angle:g} zigzag", band) for number, band in numbered]
    return bands


def forecast_document(ahead: Forecast | None) -> dict[str, dict[str, float]]:
    """Return what the boat will do for JSON, by what is asked; empty where nothing is forecast."""
    return {
        what: {f"{name}_deg": math.degrees(angle) for name, angle in band._asdict().items()}
        for what, band in _bands_of(ahead)
    }


def forecast_rows(ahead: Forecast | None) -> list[tuple[str, ...]]:
    """Return the table of what the boat will do, with its bands; no rows where nothing is forecast."""
    rows: list[tuple[str, ...]] = [("", "middle", "95 % band", "unit")]
    for what, band in _bands_of(ahead):
        low, middle, high = (fixed(math.degrees(a), 1) if math.isfinite(a) else "does not come back" for a in band)
        rows.append((what, middle, f"{low} ... {high}", "deg"))
    return rows if len(rows) > 1 else []


FORECAST = "What the boat will do at this speed, in weather like the runs'"


def as_json(result: Result) -> str:
    """Return the same as JSON text."""
    return json_text(document_of(result))


HEADINGS = ("candidate", "parameters", "held-out R2", "BIC less the least", "")


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


def _choice(choice: Choice) -> list[str]:
    """Return the table of candidates, and below it why some are out of the question."""
    head, *rows = choice_rows(choice)
    marked = [(*row[:-1], row[-1] if each.found else "") for row, each in zip(rows, choice.candidates, strict=True)]
    reasons = [f"- {each.name}: {each.reason}" for each in choice.candidates if each.found is None]
    return ["\n".join(aligned([head, *marked])), *(["\n".join(reasons)] if reasons else []), choice_sentence(choice)]


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
    """Return the comparison for JSON."""
    return {
        "chosen": choice.chosen,
        "left_out": {"count": choice.folds, "of": "blocks" if choice.by_blocks else "runs"},
        "candidates": [
            {
                "name": candidate.name,
                "parameters": candidate.parameters if candidate.found else None,
                "held_out_r2": candidate.held_out,
                "bic": candidate.bic,
                "reason": candidate.reason,
            }
            for candidate in choice.candidates
        ],
    }


def _quantities(found: Identified) -> list[tuple[Quantity, float]]:
    pairs = [(quantity, float(getattr(found.model, quantity.name))) for quantity in QUANTITIES]
    pairs += [(N2, found.model.n2)] if found.model.n2 != 0.0 else []
    if found.around is not None:
        recorded = AROUND if _felt(found) else ()
        pairs += [(quantity, float(getattr(found.around, quantity.name))) for quantity in recorded]
        pairs += [(q, float(getattr(found.around, q.name))) for q in BESIDE if getattr(found.around, q.name) != 0.0]
    pairs += [(q, float(getattr(found.train, q.name))) for q in TRAIN if getattr(found.train, q.name) != 0.0]
    return pairs


def known_quantities(found: Identified) -> list[tuple[Quantity, float | None]]:
    """Return each quantity and its value, None for a K or T that the recordings do not determine."""
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
        "interval_95": None if value is None or std is None else interval_of(quantity.name, value, std),
        "unit": quantity.unit,
        "value_deg": None if value is None else value / quantity.factor,
        "std_deg": None if std is None else std / quantity.factor,
        "unit_deg": quantity.unit_deg,
    }


def notes(result: Result) -> list[str]:
    """Return what was left out of the recordings and what the method has to say, a sentence each."""
    gear = [*(f"{clause[0].upper()}{clause[1:]}." for clause in result.gear.against), *filter(None, [result.gear.note])]
    runs = (note for run, _, _ in result.predictions for note in run.notes)
    return [*runs, *result.found.notes, *gear, *result.remarks]


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


def as_text(result: Result) -> str:
    """Return the result as tables and sentences."""
    found, model, verdict = result.found, result.found.model, verdict_on(result).sentence
    stages = _stages(result)
    rows = [("", "estimate", "standard error", "95 % interval", "unit")]
    beside: dict[str, list[str]] = {"In degrees": [], "By two stages (RLS)": []}
    for quantity, value in known_quantities(found):
        std = found.standard_errors[quantity.name]
        if value is not None and quantity.factor != 1.0:
            in_degrees = f"{quantity.symbol} {value / quantity.factor:.5g} {quantity.unit_deg}"
            beside["In degrees"].append(in_degrees)
        if (staged := stages.get(quantity.symbol)) is not None:
            beside["By two stages (RLS)"].append(f"{quantity.symbol} {staged:.5g} {quantity.unit}")
        rows.append(
            (
                quantity.symbol,
                "not determined" if value is None else f"{value:.5g}",
                spread(quantity, std),
                interval_text(quantity, value, std),
                quantity.unit,
            )
        )
    others = "\n".join(f"{how}: {', '.join(values)}" for how, values in beside.items() if values)
    choice = _choice(result.choice) if result.choice else []
    parts = [
        verdict[0].upper() + verdict[1:],
        *choice,
        f"Norrbin's model at {model.reference_speed:.4g} m/s ({model.reference_speed * 3600.0 / 1852.0:.3g} kn)",
        "\n".join(aligned(rows)),
        *([others] if others else []),
        *(["\n".join(aligned(_ratio_rows(found)))] if found.ratios is not None and found.ratios.on_ridge else []),
        "Open-loop prediction from rudder and speed alone" + (", propeller and wind" if _felt(found) else ""),
        "\n".join(aligned(run_rows(result))),
        *([FORECAST, "\n".join(aligned(forecast_rows(result.forecast)))] if result.forecast else []),
        *_trims(found),
        *([f"Rudder rate: {rate_sentence(result.rudder_rate)}."] if result.rudder_rate else []),
        *found.why_not,
        *(" ".join(test.sentences()) for test in result.residual_tests),
        *notes(result),
    ]
    return "\n\n".join(parts)


def _trims(found: Identified) -> list[str]:
    if not found.trims:
        return []
    each = ", ".join(f"{source} {n0 / DEG:.3g}" for source, n0 in found.trims)
    return [f"n0 of each run's own, deg/s: {each}; the model has their mean."]


def spread(quantity: Quantity, std: float | None) -> str:
    """Return a standard error in words for a table, in the unit of `std`."""
    if std is not None:
        return f"{std:.2g}"
    # some methods find K and T but no honest error of them
    return "not given" if quantity.symbol in ("K", "T") else "held"


def interval_text(quantity: Quantity, value: float | None, std: float | None) -> str:
    """Return a quantity's 95 % interval in words for a table."""
    if value is None or std is None:
        return "-"
    ends = interval_of(quantity.name, value, std)
    low, high = (f"{end:.4g}" if math.isfinite(end) else "without end" for end in ends)
    return f"{low} ... {high}"


def run_rows(result: Result, name: Callable[[Run], str] = lambda run: run.source) -> list[tuple[str, ...]]:
    """Return a table of runs: role, length, R2 of yaw rate, heading rms; `name` names a run."""
    rows: list[tuple[str, ...]] = [("run", "role", "seconds", "R2 of yaw rate", "heading rms deg")]
    for run, role, prediction in result.predictions:
        r2, rms = prediction.yaw_rate_r2, prediction.heading_rms
        rows.append(
            (
                name(run),
                role,
                f"{prediction.seconds:.1f}",
                "-" if r2 is None else fixed(r2, 3),
                "-" if rms is None else fixed(math.degrees(rms), 1),
            )
        )
    return rows


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
        return json_text(document)
    error = "" if cubic.standard_error is None else f" +- {cubic.standard_error:.2g}"
    error_deg = "" if cubic.standard_error is None else f" +- {cubic.standard_error * DEG**2:.2g}"
    return (
        f"K   {gain:.5g} 1/s (given)\n"
        f"n3  {cubic.n3:.5g}{error} s^2/rad^2  =  {cubic.n3 * DEG**2:.5g}{error_deg} s^2/deg^2\n\n"
        "Steady turns tell nothing of the time constant T; record a zigzag."
    )
