"""What was found of a boat, as a page: measured beside predicted, what it will do, how sure each number is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.identified import Convergence, Identified, SteadyTurns
from autopilot.identification.interval import SURE_OF_IT
from autopilot.identification.model_choice import steering_model
from autopilot.identification.residual_tests import ResidualTest
from autopilot.identification.runs import FloatArray, Run
from autopilot.identification.trial_design import InstrumentNoise, cramer_rao
from autopilot.models.norrbin import Norrbin, steady_rate
from autopilot.report.identification import (
    ALL,
    FORECAST,
    QUANTITIES,
    Result,
    choice_rows,
    choice_sentence,
    forecast_rows,
    interval_text,
    known_quantities,
    notes,
    run_rows,
    spread,
    verdict_on,
)
from autopilot.report.page import SPEED_SPAN, Line, Opening, Panel, Section, render, time_figure

LARGEST_RUDDER = math.radians(35.0)
PROBE = 1.0e-4
LONGEST_MEMORY_SHOWN = 200
LEAST = "Least possible: the bound of Cramér and Rao, if the residuals were white noise of the size they have."


class PredictedRun(NamedTuple):
    """A run, its role, and the motion predicted for it: per segment rate [rad/s] and heading [rad], shape (N, 2)."""

    run: Run
    role: str
    predicted: list[FloatArray]


def identification_page(
    result: Result, method: str, command: str, turns: SteadyTurns | None, convergence: Mapping[str, Convergence]
) -> str:
    """Return the report as one HTML file.

    method: its name. turns: steady turns where given. convergence: how recursive methods came to theirs, by name.
    """
    found, choice = result.found, result.choice
    model = found.model
    shown = [PredictedRun(run, role, found.simulated(run)) for run, role, _ in result.predictions]
    sections = [
        Section("Parameters", _parameters(result), (*found.why_not, *notes(result), LEAST)),
        *_correlation(found),
        *([Section("Candidates", choice_rows(choice), (choice_sentence(choice),))] if choice else []),
        Section("Predictions", run_rows(result, _name), ("Open loop, from what drove the boat alone.",)),
        *([_what_it_will_do(result)] if result.forecast else []),
        *map(_run_section, shown[1:]),
        _residuals(result.residual_tests, [each for each in shown if each.role == "fit"]),
        *_steady_turn_curve(found, turns),
        *_convergence(found, convergence),
    ]
    lead = (
        f"T r' + n3 r³ + n1 r + n0 = K δ at {model.reference_speed:.3g} m/s, by the method {method}, from "
        f"{', '.join(_name(run) for run, role, _ in result.predictions if role == 'fit')}."
    )
    first = _run_section(shown[0]) if shown else None
    hero = first._replace(caption=f"{first.title}: {first.caption}") if first else None
    opening = Opening("Identification: what the recordings say of this boat", lead, hero, verdict_on(result))
    return render(opening, sections, command)


def _parameters(result: Result) -> list[tuple[str, ...]]:
    found, bound = result.found, _bound(result)
    rows: list[tuple[str, ...]] = [
        ("parameter", "unit", "estimate", "standard error", "95 % interval", "least possible")
    ]
    for quantity, value in known_quantities(found):
        error, unit = found.standard_errors.get(quantity.name), quantity.unit.replace("^2", "²")
        if value is None:
            rows.append((quantity.symbol, unit, "not determined", "-" if error is None else f"{error:.2g}", "-", "-"))
            continue
        least = f"{bound[quantity.name]:.2g}" if quantity.name in bound else "-"
        interval = interval_text(quantity, value, error).replace("...", "…")
        rows.append((quantity.symbol, unit, f"{value:.4g}", spread(quantity, error), interval, least))
    return rows


def _bound(result: Result) -> dict[str, float]:
    found = result.found
    free = found.free or ("gain", "time_constant", "n0", *(("n3",) if found.model.n3 > 0.0 else ()))
    rate, heading = (noise.size if noise.size > 0.0 else math.inf for noise in found.noise)
    runs = [run for run, role, _ in result.predictions if role == "fit"]
    return cramer_rao(runs, found.model, free, InstrumentNoise(rate, heading), found.around, found.train)


def _correlation(found: Identified) -> list[Section]:
    if found.covariance is None or len(found.free) < 2:
        return []
    size = np.sqrt(np.maximum(np.diag(found.covariance), 1.0e-300))
    correlation = found.covariance / np.outer(size, size)
    symbols = [next(q.symbol for q in ALL if q.name == name) for name in found.free]
    rows = [("", *symbols)]
    rows += [(symbol, *(f"{value:+.2f}" for value in row)) for symbol, row in zip(symbols, correlation, strict=True)]
    said = (
        "Two that are close to ±1 are hard to distinguish: the runs fix one combination of them much better than each."
    )
    return [Section("Correlation of the errors", rows, (said,))]


def _run_section(shown: PredictedRun) -> Section:
    """Measured beside predicted, and what drove the boat."""
    run, role, simulated = shown
    time = _joined([segment.time for segment in run.segments])
    panels = []
    for column, label in ((0, "yaw rate [deg/s]"), (1, "heading [deg]")):
        measured = _joined([s.rate if column == 0 else s.heading for s in run.segments])
        if np.isfinite(measured).any():
            predicted = _joined([values[:, column] for values in simulated])
            panels.append(
                Panel(
                    label,
                    [
                        Line("measured", time, np.degrees(measured), True),
                        Line("predicted", time, np.degrees(predicted)),
                    ],
                )
            )
    panels.append(Panel("rudder [deg]", [Line("rudder", time, np.degrees(_joined([s.rudder for s in run.segments])))]))
    speed = _joined([s.speed for s in run.segments])
    panels.append(Panel("speed [m/s]", [Line("speed", time, speed)], SPEED_SPAN * float(np.nanmean(speed))))
    caption = "used in the fit" if role == "fit" else "held out: the fit never saw it"
    return Section(f"{_name(run)} ({role})", figure=time_figure(panels), caption=caption)


def _what_it_will_do(result: Result) -> Section:
    """The turn that is forecast, and the overshoots, with their bands."""
    assert result.forecast is not None
    time, turn = result.forecast.time, np.degrees(result.forecast.turn)
    lines = [
        Line("in the middle", time, turn[:, 1]),
        Line("lower end", time, turn[:, 0], True),
        Line("upper end", time, turn[:, 2], True),
    ]
    figure = time_figure([Panel("heading [deg]", lines)], "time since the rudder went over [s]")
    return Section("Forecast", forecast_rows(result.forecast), (f"{FORECAST}.",), figure=figure, caption="95 % band")


def _name(run: Run) -> str:
    return run.source.replace("\\", "/").rpartition("/")[2]


def _joined(parts: Sequence[FloatArray]) -> FloatArray:
    """Return the segments one after the other, with a gap that no line is drawn across."""
    return np.concatenate([piece for part in parts for piece in (part, np.array([np.nan]))])


def _residuals(tests: Sequence[ResidualTest], fitted: Sequence[PredictedRun]) -> Section:
    sentences = tuple(" ".join(test.sentences()) for test in tests)
    panels = []
    for column, label in ((0, "yaw rate"), (1, "heading")):
        lags, correlation = _autocorrelation(fitted, column)
        if lags.size:
            panels.append(Panel(f"{label}: correlation", [Line("residuals", lags, correlation)]))
    figure = time_figure(panels, "lag [s]") if panels else ""
    return Section("Residuals", text=sentences, figure=figure, caption="how long the residuals remember")


def _autocorrelation(fitted: Sequence[PredictedRun], column: int) -> tuple[FloatArray, FloatArray]:
    """Return lags [s] and the residuals' correlation there, of the longest segment."""
    pairs = [pair for each in fitted for pair in zip(each.run.segments, each.predicted, strict=True)]
    segment, simulated = max(pairs, key=lambda pair: pair[0].time.size)
    measured = segment.rate if column == 0 else segment.heading
    known = np.isfinite(measured)
    if np.count_nonzero(known) < 2 * LONGEST_MEMORY_SHOWN:
        return np.empty(0), np.empty(0)
    error = np.where(known, measured - simulated[:, column], np.nan)
    error = np.nan_to_num(error - np.nanmean(error))
    power = float(np.sum(error**2))
    correlation = [
        float(np.sum(error[lag:] * error[: error.size - lag])) / power for lag in range(LONGEST_MEMORY_SHOWN)
    ]
    spacing = float(np.median(np.diff(segment.time)))
    return np.asarray(spacing * np.arange(LONGEST_MEMORY_SHOWN), dtype=np.float64), np.array(correlation)


def _steady_turn_curve(found: Identified, turns: SteadyTurns | None) -> list[Section]:
    """The curve of steady turns with the band that the uncertainty of the parameters leaves."""
    if found.model.n1 <= 0.0 and found.model.n3 <= 0.0:
        return []
    rudder = np.linspace(-LARGEST_RUDDER, LARGEST_RUDDER, 71)
    rates = _rates(steering_model(found), rudder)
    lines = [Line("model, 95 % band", np.degrees(rudder), np.degrees(rates), band=_band(found, rudder, rates))]
    if turns is not None:
        ratio = 1.0 if turns.speed is None else turns.speed / found.model.reference_speed
        lines.append(Line("steady turns", np.degrees(turns.rudder), np.degrees(turns.rate / ratio), dots=True))
    figure = time_figure([Panel("yaw rate [deg/s]", lines)], "rudder [deg]")
    caption = (
        f"at {found.model.reference_speed:.3g} m/s; beyond the rudder angles of the runs the curve is extrapolated"
    )
    return [Section("Steady turns", figure=figure, caption=caption)]


def _rates(model: Norrbin, rudder: FloatArray) -> FloatArray:
    return np.array([steady_rate(model, float(angle)) for angle in rudder])


def _band(found: Identified, rudder: FloatArray, rates: FloatArray) -> FloatArray | None:
    """Return 1.96 standard errors of the steady rate [deg/s], by the parameters' covariance."""
    names = [name for name in found.free if name in ("gain", "n3", "n2", "n0")]
    if found.covariance is None or not names:
        return None
    chosen = [found.free.index(name) for name in names]
    covariance = found.covariance[np.ix_(chosen, chosen)]
    slopes = []
    for name, variance in zip(names, np.diag(covariance), strict=True):
        step = max(PROBE * abs(getattr(found.model, name)), PROBE * math.sqrt(max(variance, 0.0)), 1.0e-9)
        moved = steering_model(found._replace(model=found.model._replace(**{name: getattr(found.model, name) + step})))
        slopes.append((_rates(moved, rudder) - rates) / step)
    slope = np.stack(slopes)
    variance = np.einsum("in,ij,jn->n", slope, covariance, slope)
    return np.asarray(SURE_OF_IT * np.degrees(np.sqrt(np.maximum(variance, 0.0))))


def _convergence(found: Identified, convergence: Mapping[str, Convergence]) -> list[Section]:
    """How the recursive methods came to their estimates, beside the one of this report."""
    panels = []
    for symbol, name, unit, *_ in QUANTITIES[:3]:
        lines = [
            Line(method, path.time, path.values[:, path.names.index(name)])
            for method, path in convergence.items()
            if name in path.names
        ]
        if lines:
            ends = np.array([min(line.time[0] for line in lines), max(line.time[-1] for line in lines)])
            here = np.full(2, float(getattr(found.model, name)))
            panels.append(
                Panel(f"{symbol} [{unit.replace('^2', '²')}]", [Line("this report", ends, here, True), *lines])
            )
    if not panels:
        return []
    return [
        Section("Recursive methods", figure=time_figure(panels), caption="estimates while the recordings were read")
    ]
