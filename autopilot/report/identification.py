"""The identification's report: what was found, how sure it is, and measured beside predicted for every run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from autopilot import __version__
from autopilot.files.printable import fixed
from autopilot.identification.identified import Convergence, Identified, SteadyTurns
from autopilot.identification.model_choice import steering_model
from autopilot.identification.residual_tests import Prediction, ResidualTest
from autopilot.identification.rudder_path import RudderTrain
from autopilot.identification.runs import FloatArray, Run
from autopilot.identification.trial_design import InstrumentNoise, cramer_rao
from autopilot.models.norrbin import Norrbin, steady_rate
from autopilot.report.page import Line, Panel, Section, render, time_figure

SYMBOLS = {
    "gain": ("K", "1/s"),
    "time_constant": ("T", "s"),
    "n3": ("n3", "s²/rad²"),
    "n2": ("n2", "s/rad"),
    "n1": ("n1", "1"),
    "n0": ("n0", "rad/s"),
    "race": ("c (race)", "m²"),
    "wind_beam": ("c1 (wind)", "rad/m²"),
    "wind_quarter": ("c2 (wind)", "rad/m²"),
    "steady_race": ("w² (race)", "m²/s²"),
    "drift": ("d (drift)", "1"),
    "drift_time": ("Td (drift)", "s"),
    "drift_wind": ("cd (drift by wind)", "rad/m²"),
    "dead_band": ("rudder dead band", "rad"),
    "delay": ("rudder delay", "s"),
    "lag": ("rudder lag", "s"),
    "lead": ("rudder lead", "s"),
}
SURE_OF_IT = 1.96
"""Standard errors to either side that hold the truth in 95 of 100 cases."""
LARGEST_RUDDER = math.radians(35.0)
PROBE = 1.0e-4
LONGEST_MEMORY_SHOWN = 200


class Findings(NamedTuple):
    """What is to be shown: the result, each run with its role and prediction, the tests of the residuals, steady turns
    where given, how recursive methods converged, by name, and the table and the outcome of choosing the model."""

    method: str
    found: Identified
    runs: Sequence[tuple[Run, str, Prediction]]
    residual_tests: Sequence[ResidualTest]
    steady_turns: SteadyTurns | None = None
    convergence: Mapping[str, Convergence] = {}
    choice: Sequence[tuple[str, ...]] = ()
    chosen: str = ""


class PredictedRun(NamedTuple):
    """A run, its role, and the motion predicted for it: per segment rate [rad/s] and heading [rad], shape (N, 2)."""

    run: Run
    role: str
    predicted: list[FloatArray]


def identification_page(findings: Findings, command: str) -> str:
    """Return the report as one HTML file."""
    model = findings.found.model
    shown = [PredictedRun(run, role, findings.found.simulated(run)) for run, role, _ in findings.runs]
    sections = [
        Section("Parameters", _parameters(findings), _unidentified(findings)),
        *_correlation(findings.found),
        *([Section("Candidates", findings.choice, (findings.chosen,))] if findings.choice else []),
        Section("Predictions", _predictions(findings.runs), ("Open loop, from what drove the boat alone.",)),
        *map(_run, shown),
        _residuals(findings.residual_tests, [each for each in shown if each.role == "fit"]),
        *_steady_turn_curve(findings),
        *_convergence(findings),
    ]
    lead = (
        f"T r' + n3 r³ + n1 r + n0 = K δ at {model.reference_speed:.3g} m/s, by the method {findings.method}, from "
        f"{', '.join(_name(run) for run, role, _ in findings.runs if role == 'fit')}."
    )
    return render("Identification: what the recordings say of this boat", lead, sections, command, __version__)


def _parameters(findings: Findings) -> list[tuple[str, ...]]:
    found = findings.found
    bound = _bound(findings)
    rows: list[tuple[str, ...]] = [
        ("parameter", "unit", "estimate", "standard error", "95 % interval", "least possible")
    ]
    for name, (symbol, unit) in SYMBOLS.items():
        value = _value(found, name)
        if value is None:
            continue
        error = found.standard_errors.get(name)
        if symbol in ("K", "T") and symbol in found.unidentifiable:
            rows.append((symbol, unit, "not determined", "-" if error is None else f"{error:.2g}", "-", "-"))
            continue
        interval = "-" if error is None else f"{value - SURE_OF_IT * error:.4g} … {value + SURE_OF_IT * error:.4g}"
        least = f"{bound[name]:.2g}" if name in bound else "-"
        rows.append((symbol, unit, f"{value:.4g}", "held" if error is None else f"{error:.2g}", interval, least))
    return rows


def _value(found: Identified, name: str) -> float | None:
    if name == "n2" and found.model.n2 == 0.0:
        return None
    if name in Norrbin._fields:
        return float(getattr(found.model, name))
    if name in RudderTrain._fields:
        return float(getattr(found.train, name)) or None
    return None if found.around is None else float(getattr(found.around, name)) or None


def _bound(findings: Findings) -> dict[str, float]:
    found = findings.found
    free = found.free or ("gain", "time_constant", "n0", *(("n3",) if found.model.n3 > 0.0 else ()))
    rate, heading = (noise.size if noise.size > 0.0 else math.inf for noise in found.noise)
    runs = [run for run, role, _ in findings.runs if role == "fit"]
    return cramer_rao(runs, found.model, free, InstrumentNoise(rate, heading), found.around, found.train)


def _unidentified(findings: Findings) -> tuple[str, ...]:
    found = findings.found
    return (
        *found.unidentifiable.values(),
        *found.notes,
        *(note for run, _, _ in findings.runs for note in run.notes),
        "Least possible: the bound of Cramér and Rao, if the residuals were white noise of the size they have.",
    )


def _correlation(found: Identified) -> list[Section]:
    if found.covariance is None or len(found.free) < 2:
        return []
    size = np.sqrt(np.maximum(np.diag(found.covariance), 1.0e-300))
    correlation = found.covariance / np.outer(size, size)
    symbols = [SYMBOLS[name][0] for name in found.free]
    rows = [("", *symbols)]
    rows += [(symbol, *(f"{value:+.2f}" for value in row)) for symbol, row in zip(symbols, correlation, strict=True)]
    said = (
        "Two that are close to ±1 are hard to distinguish: the runs fix one combination of them much better than each."
    )
    return [Section("Correlation of the errors", rows, (said,))]


def _predictions(runs: Sequence[tuple[Run, str, Prediction]]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [("run", "role", "length [s]", "R² of yaw rate [-]", "heading rms [deg]")]
    for run, role, prediction in runs:
        r2 = "-" if prediction.yaw_rate_r2 is None else fixed(prediction.yaw_rate_r2, 3)
        rms = "-" if prediction.heading_rms is None else fixed(math.degrees(prediction.heading_rms), 1)
        rows.append((_name(run), role, f"{prediction.seconds:.0f}", r2, rms))
    return rows


def _run(shown: PredictedRun) -> Section:
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
    panels.append(Panel("speed [m/s]", [Line("speed", time, _joined([s.speed for s in run.segments]))]))
    caption = "used in the fit" if role == "fit" else "held out: the fit never saw it"
    return Section(f"{_name(run)} ({role})", figure=time_figure(panels), caption=caption)


def _name(run: Run) -> str:
    """Return the recording's name without its folder."""
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


def _steady_turn_curve(findings: Findings) -> list[Section]:
    """The curve of steady turns with the band that the uncertainty of the parameters leaves."""
    found = findings.found
    if found.model.n1 <= 0.0 and found.model.n3 <= 0.0:
        return []
    rudder = np.linspace(-LARGEST_RUDDER, LARGEST_RUDDER, 71)
    rates = _rates(steering_model(found), rudder)
    lines = [Line("model, 95 % band", np.degrees(rudder), np.degrees(rates), band=_band(found, rudder, rates))]
    turns = findings.steady_turns
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


def _convergence(findings: Findings) -> list[Section]:
    """How the recursive methods came to their estimates, beside the one of this report."""
    if not findings.convergence:
        return []
    panels = []
    for name in ("gain", "time_constant", "n3"):
        symbol, unit = SYMBOLS[name]
        lines = [
            Line(method, path.time, path.values[:, path.names.index(name)])
            for method, path in findings.convergence.items()
            if name in path.names
        ]
        if lines:
            ends = np.array([min(line.time[0] for line in lines), max(line.time[-1] for line in lines)])
            here = np.full(2, float(getattr(findings.found.model, name)))
            panels.append(Panel(f"{symbol} [{unit}]", [Line("this report", ends, here, True), *lines]))
    if not panels:
        return []
    return [
        Section("Recursive methods", figure=time_figure(panels), caption="estimates while the recordings were read")
    ]
