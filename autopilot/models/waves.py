"""Waves: a second-order shaping filter for white noise, and the ITTC two-parameter spectrum as a sum of components.

Randomness is an argument everywhere: normal deviates for the filter, phases for the sum.

Sea states follow the code table of the World Meteorological Organization (WMO-No. 306, code table 3700), by
significant wave height: 3 slight 0.5-1.25 m, 4 moderate 1.25-2.5 m, 5 rough 2.5-4 m, 6 very rough 4-6 m.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
