"""What `autopilot identify` found, as JSON (SI and radians, degrees beside) and as tables for people."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from autopilot.cli.identify_model import choice_document, choice_rows, choice_sentence
from autopilot.identification.identified import Identified, SteadyTurns
from autopilot.identification.model_choice import Choice
from autopilot.identification.prediction import Prediction
from autopilot.identification.residual_tests import ResidualTest
from autopilot.identification.rudder_rate import RudderRate, rate_sentence
from autopilot.identification.runs import Run
from autopilot.identification.two_stage import Nomoto, cubic_damping_stage
from autopilot.printable import fixed

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
            for quantity, value in _told_quantities(found)
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


def _told_quantities(found: Identified) -> list[tuple[Quantity, float | None]]:
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
    for quantity, value in _told_quantities(found):
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
