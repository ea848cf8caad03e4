"""What `autopilot identify-dp` found, as JSON and as a table for people."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np

from autopilot.filters.midpoint import FloatArray
from autopilot.identification.prediction_error import BatchFit
from autopilot.identification.recursive import UNIDENTIFIED, Case, Found, Steps

MISFIT = (0.5, 2.0)
"""Mean squares of whitened prediction errors between these are what the assumed noise explains."""


class Answers(NamedTuple):
    """The three answers to one trial, and the truth where it is known."""

    source: str
    case: Case
    steps: Steps
    kalman: Found
    particles: Found
    batch: BatchFit
    gain: str
    truth: tuple[float, ...] | None


def deviations(answers: Answers) -> dict[str, FloatArray]:
    """Return the standard deviations of every method at the end of the trial."""
    return {
        "EKF": answers.kalman.deviation[-1],
        "FPF": answers.particles.deviation[-1],
        "batch": np.sqrt(np.diag(answers.batch.covariance)),
    }


def left(answers: Answers) -> FloatArray:
    """Return which share of the prior's standard deviation the trial has left, by the Kalman filter and the batch
    fit, whichever leaves more, shape (p,)."""
    known = deviations(answers)
    return np.asarray(np.maximum(known["EKF"], known["batch"]) / answers.case.prior_deviation)


def warnings(answers: Answers) -> list[str]:
    """Return what the user should know beside the numbers, a sentence each."""
    told = [
        f"{name} cannot be identified from this trial: {share:.0%} of what was unknown of it still is; make the trial "
        "longer, or its thrusts larger."
        for name, share in zip(answers.case.names, left(answers), strict=True)
        if share > UNIDENTIFIED
    ]
    misfit = answers.batch.misfit
    if not MISFIT[0] <= misfit <= MISFIT[1]:
        told.append(
            f"The prediction errors have {misfit:.2g} times the variance that the assumed noise explains: correct the "
            f"noise in the ship's file; until then every deviation is about {misfit**-0.5:.2g} of what it should be."
        )
    return told


def as_json(answers: Answers) -> str:
    """Return the answers as JSON text; null in place of what cannot be identified."""
    document = {
        "source": answers.source,
        "samples": len(answers.steps.dt),
        "gain": answers.gain,
        "parameters": {name: _parameter(answers, i) for i, name in enumerate(answers.case.names)},
        "mean_square_prediction_error": answers.batch.misfit,
        "warnings": warnings(answers),
    }
    return json.dumps(document, indent=2, allow_nan=False)


def _parameter(answers: Answers, i: int) -> dict[str, Any]:
    share = float(left(answers)[i])
    values: dict[str, Any] = {
        "prior": _pair(answers.case.prior.mean[answers.case.states + i], answers.case.prior_deviation[i]),
        "left_of_prior_deviation": share,
        "is_identified": share <= UNIDENTIFIED,
    }
    for name, estimate, deviation in _methods(answers):
        values[name.lower()] = _pair(estimate[i], deviation[i]) if values["is_identified"] else None
    if answers.truth is not None:
        values["truth"] = answers.truth[i]
    return values


def _pair(value: float, deviation: float) -> dict[str, float]:
    return {"value": float(value), "std": float(deviation)}


def _methods(answers: Answers) -> list[tuple[str, FloatArray, FloatArray]]:
    known = deviations(answers)
    return [
        ("EKF", answers.kalman.estimate[-1], known["EKF"]),
        ("FPF", answers.particles.estimate[-1], known["FPF"]),
        ("batch", answers.batch.estimate, known["batch"]),
    ]


def as_text(answers: Answers) -> str:
    """Return the answers as a table with a sentence for each warning."""
    case, is_known = answers.case, answers.truth is not None
    heads = ["prior", "EKF", f"FPF, {answers.gain}", "batch fit", *(["truth"] if is_known else [])]
    lines = [answers.source, "", f"{'':4}" + "".join(f"{head:>24}" for head in heads)]
    for i, name in enumerate(case.names):
        cells = [_cell(case.prior.mean[case.states + i], case.prior_deviation[i])]
        if left(answers)[i] > UNIDENTIFIED:
            cells += [f"{'cannot be identified':>24}", f"{'-':>24}", f"{'-':>24}"]
        else:
            cells += [_cell(estimate[i], deviation[i]) for _, estimate, deviation in _methods(answers)]
        if answers.truth is not None:
            cells.append(f"{answers.truth[i]:>24.5g}")
        lines.append(f"{name:4}" + "".join(cells))
    lines.append("\nDimensionless in the bis system; deviations are standard deviations of the method's own belief.")
    lines += [f"\n{sentence}" for sentence in warnings(answers)]
    return "\n".join(lines)


def _cell(value: float, deviation: float) -> str:
    return f"{f'{value:.5g} ± {deviation:.2g}':>24}"
