"""Sliding mode heading laws: on the identified Norrbin model, and on sway and yaw of a ship as in Liu and Jin 2017.

On the Norrbin model, with z1 = wrap(psi - psi_d), s = (r - psi_d') + c z1 and a boundary layer W,

    delta = (T/K) [ (n1 r + n2 r^2 + n3 r^3 + n0)/T + psi_d'' - c (r - psi_d') - eta tanh(s/W) ] - b

makes s' = -eta tanh(s/W): s falls at the rate eta from afar and as exp(-eta t/W) within the layer, where the law is
backstepping with k1 = c, k2 = eta/W and gamma = 0. Unlike there, a large error asks for no more rudder than
(T/K) eta beyond what the turn itself needs. b is the rudder angle that wind, current and trim are worth; the damping
n1 r + n2 r^2 + n3 r^3 + n0 counts for no more rudder than there is.

On x' = A x + b delta, x = (v, r, psi), eqs (27)-(31):

    delta = -k' x~ - eta/(h'b) tanh(s/W),   s = h' x~,   (A - b k')' h = 0,   |h| = 1,   x~ = (v, r, psi - psi_d)

so that s' = -eta tanh(s/W) again. The paper prints its k in degrees of rudder per SI unit and its eta for radians:
k in radians per unit makes A - b k' unstable. Eq. (31) lacks an equals sign and states itself twice.
Sources: Liu and Jin 2017, section 3.1; Healey and Lienard 1993.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

from autopilot.angles import wrap
from autopilot.control.backstepping import BacksteppingGains, linear_gains_backstepping
from autopilot.control.law import Law, LawBoat, LawDesign, LawInput, LoopGains, NoMemory, in_units_of_file
from autopilot.files.typed import NOW, Bounds, Positive
from autopilot.models.norrbin import Norrbin, rudder_within
from autopilot.models.steering_gear import clip

if TYPE_CHECKING:
    # only the second law needs numpy, which would double the time that a pilot takes to start
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SPEED_RANGE = (0.2, 1.5)
"""Share of the reference speed within which the gains follow the speed."""
SMALL = 1.0e-12


@dataclass(frozen=True)
class Sliding:
    """Gains of the sliding mode law: s = rate error + slope * heading error, s' = -reach * tanh(s/boundary)."""

    slope_1_s: Annotated[float, NOW, Bounds(Positive, 1000.0, "rate wanted per heading error, on the surface")]
    reach_deg_s2: Annotated[float, NOW, Bounds(Positive, 1.0e6, "yaw acceleration towards the surface, at most")]
    boundary_deg_s: Annotated[float, NOW, Bounds(Positive, 1.0e5, "width of the layer where the law is linear")]


class SlidingGains(NamedTuple):
    """slope c [1/s] of the surface, reach eta [rad/s^2] towards it, boundary W [rad/s] of the layer around it."""

    slope: float
    reach: float
    boundary: float


def gains_at(gains: SlidingGains, speed_ratio: float) -> SlidingGains:
    """Return the gains at `speed_ratio` times the speed at which they hold."""
    ratio = clip(speed_ratio, SPEED_RANGE[0], SPEED_RANGE[1])
    return SlidingGains(gains.slope * ratio, gains.reach * ratio * ratio, gains.boundary * ratio)


def sliding_gains(section: Sliding, boat: LawBoat) -> SlidingGains:
    """Return the gains of a vessel file. ValueError where they are none."""
    gains = SlidingGains(section.slope_1_s, math.radians(section.reach_deg_s2), math.radians(section.boundary_deg_s))
    if not all(0.0 < gain < math.inf for gain in gains):
        raise ValueError(f"slope, reach and boundary must be positive and finite, got {gains}")
    return gains


def sliding_rudder(gains: SlidingGains, given: LawInput) -> float:
    """Return the unlimited rudder demand [rad] of the first law in the module's docstring; `gains`: at the present
    speed."""
    reference, rate = given.reference, given.state.rate
    rate_error = rate - reference.rate
    surface = rate_error + gains.slope * wrap(given.state.heading - reference.heading)
    wanted = reference.acceleration - gains.slope * rate_error - gains.reach * math.tanh(surface / gains.boundary)
    return rudder_within(given.model, rate, rate, wanted, given.rudder_max) - given.state.bias


def step(gains: SlidingGains, memory: NoMemory, given: LawInput) -> tuple[float, NoMemory]:
    """Return the rudder demand [rad]. There is no memory: bias and limits come with the state."""
    return sliding_rudder(gains_at(gains, given.ratio), given), memory


def linear_gains_sliding(model: Norrbin, gains: SlidingGains) -> LoopGains:
    """Return the law's gains within its boundary layer: backstepping with k1 = slope, k2 = reach/boundary, gamma 0."""
    return linear_gains_backstepping(model, BacksteppingGains(gains.slope, gains.reach / gains.boundary, 0.0))


def sliding_of(model: Norrbin, gains: BacksteppingGains, angle_max: float) -> SlidingGains:
    """Return the sliding mode gains with slope k1 and reach/boundary k2, which never ask for more than the rudder has.

    The reach is the yaw acceleration of a rudder at `angle_max` [rad] from rest: a large error puts it hard over, no
    further. Without gamma the loop is less stiff than the backstepping law's, with margins no smaller.
    """
    reach = model.gain / model.time_constant * angle_max
    return SlidingGains(gains.k1, reach, reach / gains.k2)


def _linear(gains: SlidingGains, model: Norrbin) -> LoopGains:
    return linear_gains_sliding(model, gains)


def _shown(section: Sliding, gains: SlidingGains, ratio: float) -> dict[str, float]:
    return in_units_of_file(section, gains_at(gains, ratio), gains)


def _designed(boat: LawBoat, loop: BacksteppingGains) -> Sliding:
    slope, *surface = sliding_of(boat.model, loop, boat.limits.angle_max)
    return Sliding(slope, *(math.degrees(gain) for gain in surface))


def _quicker(section: Sliding, factor: float) -> Sliding:
    return Sliding(
        section.slope_1_s * factor, section.reach_deg_s2 * (factor * factor), section.boundary_deg_s * factor
    )


LAW = Law(
    name="sliding",
    title="Sliding law",
    prefix="SLD",
    section=Sliding,
    numbers=SlidingGains,
    gains=sliding_gains,
    step=step,
    at=gains_at,
    linear=_linear,
    shown=_shown,
    design=LawDesign(_designed, _quicker),
)


def closed_loop(A: Array, b: Array, k: Array) -> Array:
    """Return A - b k'. ValueError where anything but the heading's zero eigenvalue is not stable."""
    import numpy as np

    closed = np.asarray(A - np.outer(b, k))
    inner = np.linalg.eigvals(closed[:-1, :-1])
    if np.max(inner.real) >= 0.0:
        raise ValueError(
            f"sliding mode: these k leave A - b k' with an eigenvalue of real part {np.max(inner.real):.3g} 1/s; "
            f"give k in radians of rudder per SI unit, with the signs of positive rudder to starboard"
        )
    return closed


def sliding_surface(A: Array, b: Array, k: Array) -> Array:
    """Return h (n,), |h| = 1, with (A - b k')' h = 0: eq. (30).

    A (n, n), b (n,), k (n,): the heading is the last state, which nothing depends on and k does not feed back. The
    sign is that of a positive weight on the heading. ValueError where k does not stabilise the rest.
    """
    import numpy as np

    n = len(b)
    if k[n - 1] != 0.0 or np.any(A[:, n - 1] != 0.0):
        raise ValueError("sliding mode: the last state must be a pure integral that k does not feed back")
    closed = closed_loop(A, b, k)
    inner = np.linalg.solve(closed[:-1, :-1].T, -closed[-1, :-1])
    h = np.append(inner, 1.0)
    return np.asarray(h / np.linalg.norm(h))


class SwayYawGains(NamedTuple):
    """k_v [rad rudder per m/s], k_r [s], eta and boundary W as the paper has them (h has norm 1, mixed units)."""

    k_v: float
    k_r: float
    reach: float
    boundary: float


class SwayYawLaw(NamedTuple):
    """The second law made ready: feedback k, surface h, `switching` eta/(h'b) [rad], boundary W."""

    k_v: float
    k_r: float
    h_v: float
    h_r: float
    h_psi: float
    switching: float
    boundary: float


PAPER_SWAY_YAW = SwayYawGains(math.radians(-10.0), math.radians(-100.0), 1.0512, 1.0)
"""Liu and Jin 2017, section 4: k = (-10, -100, 0) degrees per SI unit, taken as printed: A - b k' is stable so."""


def sway_yaw_law(A: Array, b: Array, gains: SwayYawGains) -> SwayYawLaw:
    """Return the law for the linear model of (v, r, psi), A (3, 3) and b (3,). ValueError where h'b is zero."""
    import numpy as np

    h = sliding_surface(A, b, np.array([gains.k_v, gains.k_r, 0.0]))
    through = float(h @ b)
    if abs(through) < SMALL:
        raise ValueError("sliding mode: the rudder does not move s: h'b is zero")
    return SwayYawLaw(
        gains.k_v, gains.k_r, float(h[0]), float(h[1]), float(h[2]), gains.reach / through, gains.boundary
    )


def sway_yaw_rudder(law: SwayYawLaw, sway: float, rate: float, heading_error: float) -> float:
    """Return the unlimited rudder demand [rad] at sway v [m/s], yaw rate [rad/s], heading error psi - psi_d [rad]."""
    surface = law.h_v * sway + law.h_r * rate + law.h_psi * heading_error
    return -(law.k_v * sway + law.k_r * rate) - law.switching * math.tanh(surface / law.boundary)
