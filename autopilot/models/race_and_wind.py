"""What besides rudder and speed turns a boat: the propeller's race over the rudder, and the wind on the hull.

    T r' + n3 r^3 + n2 r^2 + n1 r + n0 = K (W/W0)^2 (U0/U)^2 delta + T (c1 Ua^2 sin g + c2 Ua^2 sin 2g)
    W^2 = U^2 + c n^2,   W0^2 = U0^2 + c n0^2

all parameters at the speed U of the moment as in `norrbin`, so that K is the gain at the reference speed U0 and
the reference revolutions n0. A rudder in the race of a propeller that turns keeps its force when the boat slows
down, in a turn or when getting under way; c is that of the inflow to the rudder (0: no race). Ua and g are the
apparent wind's speed and direction from the bow, starboard positive.

Source of the forms: for the rudder in the race the MMG model (Yasukawa and Yoshimura 2015), simplified to a sum of
squares; for the wind moment Fossen 2011, section 8.1 (Isherwood 1972), of which the first two harmonics are kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class RaceAndWind(NamedTuple):
    """race c [m^2], reference_propeller n0 [1/s], wind_beam c1 and wind_quarter c2 [rad/m^2]."""

    race: float = 0.0
    reference_propeller: float = 0.0
    wind_beam: float = 0.0
    wind_quarter: float = 0.0


def inflow_ratio(around: RaceAndWind, reference_speed: float, ratio: FloatArray, propeller: FloatArray) -> FloatArray:
    """Return (W/W0)^2 (U0/U)^2 [-] at U = `ratio` times `reference_speed` [m/s] and `propeller` n [1/s].

    Elementwise; the fields of `around` may be arrays.
    """
    still = reference_speed**2 + around.race * around.reference_propeller**2
    moving = (ratio * reference_speed) ** 2 + around.race * propeller**2
    return np.asarray(moving / (still * ratio**2))


def wind_acceleration(around: RaceAndWind, beam: FloatArray, quarter: FloatArray) -> FloatArray:
    """Return the yaw acceleration [rad/s^2] by wind; beam = Ua^2 sin g and quarter = Ua^2 sin 2g [m^2/s^2]."""
    return np.asarray(around.wind_beam * beam + around.wind_quarter * quarter)
