"""The slope that the search for a boat goes by, against differences of the loss."""

from __future__ import annotations

import pytest

from autopilot.identification.likelihood_search import Space


def check_slope(space: Space) -> None:
    """Assert that the slope at the start is that of the loss's central differences, number by number."""
    _, slope, _ = space.slope(space.start)
    for i, name in enumerate(space.names):
        losses = []
        for by in (1.0e-4, -1.0e-4):
            at = space.start.copy()
            at[i] += by
            losses.append(space.found(at).loss)
        assert slope[i] == pytest.approx((losses[0] - losses[1]) / 2.0e-4, rel=1.0e-3, abs=0.01), name
