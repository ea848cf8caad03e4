"""Recursive least squares over the integrated equation: the plain variant beside `integral_fit`, biased by the noise of
the measured rate and quick to compute."""

from __future__ import annotations

from autopilot.filters.rls import rls_start, rls_step
from autopilot.identification.integral_window import Integrals
from autopilot.models.norrbin import Norrbin

EXPECTED_ERROR_RAD = 0.002


class WindowRls:
    """K, T and, with `cubic`, n3, beginning at `first`, with `forgetting` per window."""

    def __init__(self, first: Norrbin, forgetting: float = 1.0, *, cubic: bool = True) -> None:
        self.model = self._first = first
        self._forgetting = forgetting
        # in units of the first model the unknowns are of order one, and so is their variance
        self._units = (first.gain, first.time_constant, max(first.n3, 1.0)) if cubic else first[:2]
        self._state = rls_start([0.0] * len(self._units), EXPECTED_ERROR_RAD**-2)

    def update(self, window: Integrals) -> Norrbin:
        """Take one window's equation; return the model as it is then, T positive and n3 not negative."""
        first = self._first
        terms = (window.driven, -window.rate_change, -window.cubed)[: len(self._units)]
        known = first.gain * terms[0] + first.time_constant * terms[1] - first.n3 * window.cubed
        missing = first.n1 * window.turned + first.n0 * window.elapsed - known
        scaled = [term * unit for term, unit in zip(terms, self._units, strict=True)]
        self._state = rls_step(self._state, scaled, missing, self._forgetting)
        found = [share * unit for share, unit in zip(self._state.theta, self._units, strict=True)]
        self.model = first._replace(
            gain=max(first.gain + found[0], 1.0e-9),
            time_constant=max(first.time_constant + found[1], 1.0e-9),
            n3=max(first.n3 + found[2], 0.0) if len(found) > 2 else first.n3,
        )
        return self.model
