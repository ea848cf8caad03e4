"""Weather. Waves: a second-order shaping filter for white noise, and the ITTC two-parameter spectrum as a sum of
components.

Randomness is an argument everywhere: normal deviates for the filter, phases for the sum.

Sea states follow the code table of the World Meteorological Organization (WMO-No. 306, code table 3700), by
significant wave height: 3 slight 0.5-1.25 m, 4 moderate 1.25-2.5 m, 5 rough 2.5-4 m, 6 very rough 4-6 m.

Wind: what a boat feels of it, gusts, and the rudder angle its yaw moment is worth.

What besides rudder and speed turns a boat: the propeller's race over the rudder, wind, and drift.

Norrbin's model scaled with the inflow W to the rudder in place of the speed U, and two terms more:

    T r' + n3 r^3 + n2 r^2 + n1 r + n0 = K delta + T (c1 Ua^2 sin g + c2 Ua^2 sin 2g) + (U W0)/(U0 W) x
    W^2 = U^2 + c max(n, 0)^2 + w^2,   W0^2 = U0^2 + c n0^2 + w^2
    x' = (U/U0) (d r - x)/Td + cd Ua^2 sin g

K ~ W, T ~ 1/W, n3 ~ 1/W^2, so that K is the gain at the reference speed U0 and the reference revolutions n0. A rudder
in the race of a propeller that turns keeps its force when the boat slows down, in a turn or when getting under way, and
keeps straightening the flow behind the hull, which is most of the damping. c is that of the inflow to the rudder (0:
no race); w stands for a race of revolutions that were not recorded and did not change. Ua and g are the apparent
wind's speed and direction from the bow, starboard positive.

x is the turning by drift: the hull slides outwards in a turn, and before the wind, slower than it turns, and the flow
across it turns it further. Left alone it follows the rate, x = d r, within Td. Without wind this is Nomoto's second
order (Nomoto et al. 1957).

Source of the forms: for the rudder in the race the MMG model (Yasukawa and Yoshimura 2015), simplified to a sum of
squares; for the wind moment Fossen 2011, section 8.1 (Isherwood 1972), of which the first two harmonics are kept; for
the drift the linear sway equation of Davidson and Schiff (1946), in units of what it does to the yaw.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.typing import NDArray

from autopilot.models.norrbin import Norrbin

GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2]."""

Array = NDArray[np.float64]


class SecondOrderWaves(NamedTuple):
    """y(s) = gain s/(s^2 + 2 damping frequency s + frequency^2) w(s): Jiang et al. 2016, eqs (29)-(30).

    (30) lacks the frequency in its damping term; here it is in. frequency w0 [rad/s], damping xi [-] in
    (0, 1), gain = 2 xi w0 sigma, `intensity` q of the white noise: E[w(t) w(t')] = q delta(t - t'). y has the
    unit of gain sqrt(q); as an equivalent rudder angle it is radians.
    """

    frequency: float
    damping: float
    gain: float
    intensity: float


JIANG_DEG = SecondOrderWaves(frequency=math.sqrt(0.37), damping=0.18 / math.sqrt(0.37), gain=0.42, intensity=0.1)
"""Jiang et al. 2016, eq. (31), for a wind of Beaufort force 5; its output is an equivalent rudder in degrees."""


def standard_deviation(waves: SecondOrderWaves) -> float:
    """Return the standard deviation of y: gain sqrt(q/(4 xi w0))."""
    return waves.gain * math.sqrt(waves.intensity / (4.0 * waves.damping * waves.frequency))


class WaveState(NamedTuple):
    """State of the shaping filter: `value` is y, `integral` its integral over time."""

    integral: float = 0.0
    value: float = 0.0


class WaveTransition(NamedTuple):
    """Exact discretisation over one step: x' = A x + L n, with n two independent standard normal deviates."""

    a11: float
    a12: float
    a21: float
    a22: float
    l11: float
    l21: float
    l22: float


def discretise(waves: SecondOrderWaves, dt: float) -> WaveTransition:
    """Return the transition over `dt` [s], exact for any dt > 0; ValueError unless 0 < damping < 1 and dt > 0.

    The noise covariance of a step is what keeps the stationary covariance P stationary: Q = P - A P A'.
    """
    if not (0.0 < waves.damping < 1.0 and waves.frequency > 0.0 and dt > 0.0):
        raise ValueError(f"waves: damping must lie in (0, 1), frequency and dt above 0, got {waves} and dt {dt}")
    decay = waves.damping * waves.frequency
    ringing = waves.frequency * math.sqrt(1.0 - waves.damping**2)
    envelope = math.exp(-decay * dt)
    cosine = envelope * math.cos(ringing * dt)
    sine = envelope * math.sin(ringing * dt) / ringing
    a11, a12 = cosine + decay * sine, sine
    a21, a22 = -(waves.frequency**2) * sine, cosine - decay * sine
    p22 = standard_deviation(waves) ** 2
    p11 = p22 / waves.frequency**2
    q11 = p11 - (a11 * a11 * p11 + a12 * a12 * p22)
    q21 = -(a21 * a11 * p11 + a22 * a12 * p22)
    q22 = p22 - (a21 * a21 * p11 + a22 * a22 * p22)
    l11 = math.sqrt(max(q11, 0.0))
    l21 = q21 / l11 if l11 > 0.0 else 0.0
    return WaveTransition(a11, a12, a21, a22, l11, l21, math.sqrt(max(q22 - l21 * l21, 0.0)))


def stationary_state(waves: SecondOrderWaves, deviate_1: float, deviate_2: float) -> WaveState:
    """Return a state drawn from the stationary distribution by two standard normal deviates."""
    deviation = standard_deviation(waves)
    return WaveState(integral=deviation / waves.frequency * deviate_1, value=deviation * deviate_2)


def wave_step(step: WaveTransition, state: WaveState, deviate_1: float, deviate_2: float) -> WaveState:
    """Return the state one step later, driven by two standard normal deviates."""
    return WaveState(
        integral=step.a11 * state.integral + step.a12 * state.value + step.l11 * deviate_1,
        value=step.a21 * state.integral + step.a22 * state.value + step.l21 * deviate_1 + step.l22 * deviate_2,
    )


def ittc_spectrum(frequency: Array, significant_height: float, mean_period: float) -> Array:
    """Return S(w) [m^2 s/rad] of the ITTC two-parameter spectrum at `frequency` w [rad/s], w > 0.

    S = A/w^5 exp(-B/w^4), A = 173 H^2/T1^4, B = 691/T1^4, with the significant height H [m] and the mean
    period T1 [s] = 2 pi m0/m1. ITTC 1978; Liu and Jin 2017, eq. (12).
    """
    shape = 691.0 / mean_period**4
    power = np.power(frequency, 4)
    return np.asarray(173.0 * significant_height**2 / mean_period**4 / (power * frequency) * np.exp(-shape / power))


def mean_period_of(peak_period: float) -> float:
    """Return the mean period T1 [s] of an ITTC spectrum with its peak at `peak_period` Tp [s].

    The peak lies at w = (4 B/5)^(1/4) with B = 691/T1^4, hence T1 = Tp (0.8 x 691)^(1/4)/(2 pi) = 0.772 Tp.
    """
    return peak_period * float((0.8 * 691.0) ** 0.25) / (2.0 * math.pi)


def component_amplitudes(frequency: Array, significant_height: float, mean_period: float) -> Array:
    """Return the amplitude [m] sqrt(2 S dw) of each component; `frequency` [rad/s] ascending, at least two."""
    if len(frequency) < 2:
        raise ValueError("component_amplitudes: at least two frequencies are needed")
    width = np.gradient(frequency)
    return np.asarray(np.sqrt(2.0 * ittc_spectrum(frequency, significant_height, mean_period) * width))


def wave_number(frequency: Array) -> Array:
    """Return k [rad/m] = w^2/g of deep water."""
    return np.asarray(frequency * frequency / GRAVITY)


def component_sum(amplitude: Array, phase: Array) -> float:
    """Return the sum of amplitude cos(phase) over the components."""
    return float(np.dot(amplitude, np.cos(phase)))


class ApparentWind(NamedTuple):
    """How much of the wind over the boat comes from ahead and from starboard [m/s]: V cos(gamma) and V sin(gamma)."""

    ahead: float
    starboard: float

    @property
    def speed(self) -> float:
        """V [m/s]."""
        return math.hypot(self.ahead, self.starboard)

    @property
    def angle(self) -> float:
        """gamma [rad] from the bow to where the wind comes from, positive to starboard."""
        return math.atan2(self.starboard, self.ahead)


class WindLoad(NamedTuple):
    """How the boat answers: rudder equivalent [rad/(m/s)^2] and leeway [-], drift speed per wind speed abeam."""

    rudder_per_speed_squared: float = 0.0
    leeway: float = 0.0


class Gust(NamedTuple):
    """First-order Gauss-Markov gust on the wind speed: standard deviation [m/s] and correlation time [s]."""

    deviation: float = 0.0
    time: float = 10.0


def apparent_wind(
    wind_speed: float, wind_from: float, heading: float, north_speed: float, east_speed: float
) -> ApparentWind:
    """Return the wind felt by a boat that moves with `north_speed` and `east_speed` [m/s] at `heading` [rad].

    `wind_speed` [m/s] is over the ground, `wind_from` [rad] the direction it comes from, clockwise from north.
    """
    north = -wind_speed * math.cos(wind_from) - north_speed
    east = -wind_speed * math.sin(wind_from) - east_speed
    cosine, sine = math.cos(heading), math.sin(heading)
    return ApparentWind(-(north * cosine + east * sine), north * sine - east * cosine)


def rudder_equivalent(load: WindLoad, wind: ApparentWind) -> float:
    """Return the rudder angle [rad] that yaws the boat as the wind does: c V^2 sin(2 gamma).

    The yaw moment of a hull and its superstructure is zero head to wind, abeam and astern and changes sign
    abeam; sin(2 gamma) is its first harmonic (Isherwood 1973 tabulates the rest). c > 0 turns the bow away
    from a wind on the bow, as it does on most power boats.
    """
    return -load.rudder_per_speed_squared * 2.0 * wind.ahead * wind.starboard


def leeway_speed(load: WindLoad, wind: ApparentWind) -> float:
    """Return the sideways drift [m/s], positive to starboard: away from the wind."""
    return -load.leeway * wind.starboard


def gust_step(gust: Gust, value: float, dt: float, deviate: float) -> float:
    """Return the gust [m/s] `dt` [s] later, driven by a standard normal deviate; exact for any dt >= 0."""
    keep = math.exp(-dt / gust.time)
    return keep * value + gust.deviation * math.sqrt(1.0 - keep * keep) * deviate


FloatArray = npt.NDArray[np.float64]


class RaceAndWind(NamedTuple):
    """race c [m^2], reference_propeller n0 [1/s], wind_beam c1 and wind_quarter c2 [rad/m^2], steady_race w^2
    [m^2/s^2], drift d [-], drift_time Td [s] at the reference speed (0: no drift), drift_wind cd [rad/m^2]."""

    race: float = 0.0
    reference_propeller: float = 0.0
    wind_beam: float = 0.0
    wind_quarter: float = 0.0
    steady_race: float = 0.0
    drift: float = 0.0
    drift_time: float = 0.0
    drift_wind: float = 0.0

    @property
    def drifts(self) -> bool:
        """Whether drift counts."""
        return self.drift_time > 0.0


def inflow_ratio(around: RaceAndWind, reference_speed: float, ratio: FloatArray, propeller: FloatArray) -> FloatArray:
    """Return W/W0 [-] at U = `ratio` times `reference_speed` [m/s] and `propeller` n [1/s].

    Elementwise; the fields of `around` may be arrays. A propeller that turns astern makes no race over the rudder.
    """
    still = reference_speed**2 + around.race * around.reference_propeller**2 + around.steady_race
    ahead = np.maximum(propeller, 0.0)
    moving = (ratio * reference_speed) ** 2 + around.race * ahead**2 + around.steady_race
    return np.sqrt(np.asarray(moving / still))


def wind_acceleration(around: RaceAndWind, beam: FloatArray, quarter: FloatArray) -> FloatArray:
    """Return the yaw acceleration [rad/s^2] by wind; beam = Ua^2 sin g and quarter = Ua^2 sin 2g [m^2/s^2]."""
    return np.asarray(around.wind_beam * beam + around.wind_quarter * quarter)


def without_drift(model: Norrbin, around: RaceAndWind) -> Norrbin:
    """Return the model of first order that answers a slow rudder as `model` with its drift does.

    K/(1 - d), and by Nomoto's rule T1 + T2 - T3 = (T + Td)/(1 - d) - Td. Raises ValueError where d is not below 1:
    such a boat will not go straight by itself and has no such model.
    """
    if around.drift >= 1.0:
        raise ValueError("without_drift: a drift of 1 or more makes the boat course-unstable")
    left = 1.0 - around.drift
    time_constant = (model.time_constant + around.drift_time) / left - around.drift_time
    return model._replace(
        gain=model.gain / left, time_constant=time_constant, n3=model.n3 / left, n2=model.n2 / left, n0=model.n0 / left
    )
