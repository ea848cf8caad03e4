"""One step of a stochastic differential equation x' = f(x, u) + w for many states at once, by the midpoint rule.

The filters of this room share it, so that they solve the same discrete system and can be held against each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Drift = Callable[[Any, Any], Sequence[Any]]
"""f(state, inputs): the d rates of a state with d components. state[i] is component i, a float or an array of one
value for each of many states; so is each rate. Inputs are whatever the model needs, held over the step."""

Observe = Callable[[Any], Sequence[Any]]
"""h(state): the m values that a measurement of the state would show without noise; state as in Drift."""


def midpoint_step(
    drift: Drift, inputs: Any, states: FloatArray, dt: float, kick: FloatArray | float = 0.0, substeps: int = 1
) -> FloatArray:
    """Return `states`, shape (n, d), after `dt` [s]: x' = f(x, u) + kick/dt, with u and the kick held.

    kick: what the process noise adds over the step, shape (n, d); a Gaussian of covariance Q dt makes the step a
    second-order one of dx = f dt + Q^(1/2) dW. Second order in dt/substeps.
    """
    h = dt / substeps
    push = kick / substeps
    for _ in range(substeps):
        middle = states + 0.5 * (h * rates(drift, inputs, states) + push)
        states = states + h * rates(drift, inputs, middle) + push
    return states


def rates(drift: Drift, inputs: Any, states: FloatArray) -> FloatArray:
    """Return f(x, u) for `states`, shape (n, d)."""
    return _columns(drift(states.T, inputs), states.shape[0])


def observed(observe: Observe, states: FloatArray) -> FloatArray:
    """Return h(x) for `states`, shape (n, d), as shape (n, m)."""
    return _columns(observe(states.T), states.shape[0])


def _columns(components: Sequence[Any], count: int) -> FloatArray:
    table = np.empty((count, len(components)))
    for index, values in enumerate(components):
        table[:, index] = values
    return table
