"""Every identification method there is, by name."""

from __future__ import annotations

from autopilot.errors import InputError
from autopilot.identification.filter_methods import KalmanMethod, ParticleMethod
from autopilot.identification.integral_method import IntegralMethod, IntegralRecursionMethod
from autopilot.identification.methods import Method, OutputErrorMethod, TwoStageMethod

METHODS: tuple[Method, ...] = (
    OutputErrorMethod(),
    TwoStageMethod(),
    IntegralMethod(),
    IntegralRecursionMethod(),
    KalmanMethod(),
    ParticleMethod(),
)
"""The one to use unless told otherwise comes first."""

NAMES = tuple(method.name for method in METHODS)


def method_named(name: str, gain: str = "constant") -> Method:
    """Return the method called `name`; gain: of the feedback particle filter, one of `GAINS`. Raises InputError."""
    if gain != "constant":
        if name != ParticleMethod.name:
            raise InputError(f"--gain {gain} goes with --method {ParticleMethod.name} alone; leave one of them out.")
        return ParticleMethod(gain)
    for method in METHODS:
        if method.name == name:
            return method
    raise InputError(f"{name!r} is no identification method; there are {', '.join(NAMES)}.")
