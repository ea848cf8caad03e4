"""The sums over windows from which the integral method takes its estimate: three small matrices, whatever the time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class WindowSums:
    """R = sum zeta phi'/s^2, S = sum zeta zeta'/s^2 and f = sum zeta missing/s^2 over the windows, fading.

    size: number of parameters.  expected_error: s [rad], what an equation's error is expected to be.
    """

    def __init__(self, size: int, expected_error: float) -> None:
        self._weight = expected_error**-2
        self._one = np.eye(size)
        self.R: Array = np.zeros((size, size))
        self.S: Array = np.zeros((size, size))
        self.f: Array = np.zeros(size)

    def add(self, fading: float, instruments: Array, terms: Array, missing: float) -> None:
        """Fade what is there by the factor `fading` and add a window: its instruments zeta, its terms phi, and what
        the terms times the first parameters lack of its left side."""
        weighted = self._weight * instruments
        self.R = fading * self.R + np.outer(weighted, terms)
        self.S = fading * self.S + np.outer(weighted, instruments)
        self.f = fading * self.f + weighted * missing

    def step(self, spread: Array, square: float) -> Array:
        """Return theta - theta_0, held by `spread`, its expected size; `square` is the equations' mean square error in
        units of s^2. nan where the sums do not determine it."""
        whole = spread[:, None] * self.R * spread / square + self._one
        try:
            return np.asarray(spread * np.linalg.solve(whole, spread * self.f / square))
        except np.linalg.LinAlgError:
            return np.full(spread.size, np.nan)

    def errors(self, spread: Array, square: float) -> Array:
        """Return the standard errors of `step`; infinite where the sums do not determine it."""
        try:
            inverse = np.linalg.inv(spread[:, None] * self.R * spread / square + self._one)
        except np.linalg.LinAlgError:
            return np.full(spread.size, np.inf)
        scores = spread[:, None] * self.S * spread / square + self._one
        return np.asarray(spread * np.sqrt(np.maximum(np.diag(inverse @ scores @ inverse.T), 0.0)))
