"""Sway, roll and yaw of a ship: the state, and its linear model. No numpy, which a running pilot does without."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


class Motion(NamedTuple):
    """Sway v [m/s], roll rate p, yaw rate r [rad/s], roll phi and heading psi [rad]; or their derivatives."""

    v: float
    p: float
    r: float
    phi: float
    psi: float


class LinearMotion(NamedTuple):
    """x' = A x + b delta about straight running, x = (v, p, r, phi, psi), delta [rad] positive to starboard."""

    A: Array
    b: Array
