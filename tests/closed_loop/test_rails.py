"""A route with three corners in a current, on plants that are not the model's equation (`benchmarks/rails.py`)."""

from __future__ import annotations

import pytest
from rails import sail

LIMITS = {0.3: 0.1, 0.6: 0.25}
"""rms of the cross-track error [lengths], by current [the boat's speeds]; corners included."""


@pytest.mark.parametrize("share", LIMITS)
@pytest.mark.parametrize("kind", ["outboard", "mmg_tanker", "roll_ship", "twin_thruster"])
def test_the_boat_keeps_to_legs_and_corners_in_a_current(kind: str, share: float) -> None:
    found = sail(kind, share, seed=5)
    assert found.is_complete
    assert found.rms < LIMITS[share]
    assert found.wide < 0.2


@pytest.mark.parametrize("share", LIMITS)
def test_without_a_log_it_keeps_to_them_too(share: float) -> None:
    found = sail("outboard", share, seed=5, has_log=False)
    assert found.is_complete
    assert found.rms < LIMITS[share]
