"""The recursion of the integral method: one parameter after another, each from the same window's equation.

    e = T dr + dpsi + alpha I3 - K Id
    K += lambda Id e/(mu + Id^2),   T -= lambda dr e/(mu + dr^2),   alpha -= lambda I3 e/(mu + I3^2)

each minimises e^2 + mu (theta - theta before)^2 over its own parameter, with the others as they were, and goes the
share lambda of the way. The linear form has no alpha. Source: patent application of Harbin Engineering University
(Liao et al., 2019). Its mu has the unit of a regressor squared; here it is a multiple of the regressor's own mean
square, which makes it the same number for a model boat and a ship.

The recursion is not the estimate to rely on: three parameters from one equation creep along a valley where K, T and
alpha change together and e hardly does. `integral_fit` solves the same equations of many windows at once.
"""

from __future__ import annotations

from typing import NamedTuple

from autopilot.identification.integral_window import Integrals
from autopilot.models.norrbin import Norrbin


class RecursionSettings(NamedTuple):
    """step lambda [-] and weight mu [-, in mean squares of the regressor], the same for every parameter; whether
    alpha is estimated, or else held; how far K, T and alpha may go from the model they begin with, a factor."""

    step: float = 0.5
    weight: float = 1.0
    nonlinear: bool = False
    bound: float = 10.0


class Recursion(NamedTuple):
    """The estimate and, per regressor (Id, dr, I3), its mean square over `windows` of them."""

    model: Norrbin
    powers: tuple[float, float, float] = (0.0, 0.0, 0.0)
    windows: int = 0


MEMORY = 200
"""Windows over which the mean squares are taken."""


def recursion_step(settings: RecursionSettings, first: Norrbin, state: Recursion, window: Integrals) -> Recursion:
    """Return the state after one more window; `first` is the model it all began with, which the bounds are about."""
    model = state.model
    count = min(state.windows + 1, MEMORY)
    regressors = window.driven, window.rate_change, window.cubed
    driven, change, cubed = regressors
    power = [p + (x * x - p) / count for p, x in zip(state.powers, regressors, strict=True)]
    error = (
        model.time_constant * change
        + model.n1 * window.turned
        + model.n3 * cubed
        + model.n0 * window.elapsed
        - model.gain * driven
    )
    gain = model.gain + settings.step * _share(driven, power[0], settings.weight) * error
    time_constant = model.time_constant - settings.step * _share(change, power[1], settings.weight) * error
    n3 = model.n3
    if settings.nonlinear:
        n3 = max(0.0, n3 - settings.step * _share(cubed, power[2], settings.weight) * error)
        n3 = min(n3, settings.bound * first.n3) if first.n3 > 0.0 else n3
    found = model._replace(
        gain=_within(gain, first.gain, settings.bound),
        time_constant=_within(time_constant, first.time_constant, settings.bound),
        n3=n3,
    )
    return Recursion(found, (power[0], power[1], power[2]), count)


def _share(regressor: float, power: float, weight: float) -> float:
    whole = weight * power + regressor * regressor
    return regressor / whole if whole > 0.0 else 0.0


def _within(value: float, first: float, bound: float) -> float:
    return min(max(value, first / bound), first * bound)
