"""The model that steers: what laws and gains are designed from, where the fit knows more than they do."""

from __future__ import annotations

import numpy as np

from autopilot.identification.identified import Identified
from autopilot.identification.runs import FloatArray
from autopilot.models.norrbin import Norrbin
from autopilot.models.race_and_wind import RaceAndWind, without_drift

NAMES = ("gain", "time_constant", "n3", "n0")
PROBE = 1.0e-4
"""Share of a parameter over which slopes are taken."""


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
