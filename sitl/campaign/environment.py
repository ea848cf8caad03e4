"""Waves and wind on the boat step by step, over arrays, so that numba compiles them: the sea of `sitl.sea`.

The equations are those of `autopilot.models` and `sitl.sea`. Only the sum of wave components goes another way: their
phases move little in a step, so that sine and cosine are turned on by it,

    cos(a + d) = cos a cos d - sin a sin d,   sin(a + d) = sin a cos d + cos a sin d,

with the series of sin d and cos d to d^11 and d^12, and taken anew every `AFRESH` steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.models import weather
from autopilot.models.weather import WaveState
from sitl.boat import BoatState, Disturbance
from sitl.sea import IttcWaves, Water, acting, wave_forces, way_along, whole_degree

Floats = NDArray[np.float64]

AFRESH = 64
LONGEST_TURN = 0.6
"""A phase that moves further than this [rad] in one step is taken anew each step."""


class Surface(NamedTuple):
    """The waves' phases and forces by component, and the force of every degree of heading met so far."""

    cosine: Floats
    sine: Floats
    yaw: Floats
    roll: Floats
    known: NDArray[np.bool_]


class WaterState(NamedTuple):
    """Where the sea is: the swell's state, the gust [m/s], way in the water along the waves [m] at the last step, its
    degree."""

    swell: WaveState
    gust: float
    along: float
    degree: int


def surface_of(components: int) -> Surface:
    """Return room for so many wave components."""
    return Surface(
        np.zeros(components),
        np.zeros(components),
        np.zeros((360, components)),
        np.zeros((360, components)),
        np.zeros(360, dtype=np.bool_),
    )


def water_step(
    water: Water, surface: Surface, before: WaterState, step: int, dt: float, state: BoatState
) -> tuple[WaterState, Disturbance]:
    """Return the sea after step number `step`, and what it does to a boat at `state`."""
    swell, rudder = before.swell, 0.0
    if water.has_swell:
        swell = weather.wave_step(
            water.swell, swell, float(water.swell_noise[2 * step]), float(water.swell_noise[2 * step + 1])
        )
        rudder = swell.value
    yaw, slope, along, degree = 0.0, 0.0, before.along, before.degree
    if water.has_waves:
        degree = whole_degree(state.heading)
        if not surface.known[degree]:
            # not inlined, and handed many numbers: called once a degree
            _meet(water.waves, surface, degree)
        along = _phases(water.waves, surface, before.along, step, dt, state)
        yaw, slope = summed(surface.yaw[degree], surface.roll[degree], surface.cosine, surface.sine)
    gust = before.gust
    if water.has_wind:
        gust = weather.gust_step(water.gust, gust, dt, float(water.wind_noise[step]))
    return WaterState(swell, gust, along, degree), acting(water, rudder, gust, yaw, slope, state)


def _meet(components: IttcWaves, surface: Surface, degree: int) -> None:
    """Work out the forces at this heading [deg]."""
    yaw, roll = wave_forces(components, math.radians(degree))
    surface.yaw[degree, :] = yaw
    surface.roll[degree, :] = roll
    surface.known[degree] = True


def _phases(
    components: IttcWaves, surface: Surface, along_before: float, step: int, dt: float, state: BoatState
) -> float:
    """Bring cosine and sine of every component's phase to this step; return the way along the waves [m]."""
    along = way_along(components, step * dt, state)
    moved = along - along_before
    is_far = abs(moved) * components.number[-1] + dt * components.frequency[-1] > LONGEST_TURN
    if step % AFRESH == 0 or is_far:
        for k in range(len(components.number)):
            theta = components.number[k] * along - components.frequency[k] * (step * dt) + components.phase[k]
            surface.cosine[k] = math.cos(theta)
            surface.sine[k] = math.sin(theta)
    else:
        turned(components.number, components.frequency, moved, dt, surface.cosine, surface.sine)
    return along


def turned(number: Floats, frequency: Floats, moved: float, dt: float, cosine: Floats, sine: Floats) -> None:
    """Turn the phases, in place, by number x `moved` [m] - frequency x `dt` [s]."""
    for k in range(len(number)):
        d = number[k] * moved - frequency[k] * dt
        q = d * d
        s = d * (1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 - q / 39916800)))))
        c = 1.0 + q * (-1 / 2 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 + q * (-1 / 3628800 + q / 479001600)))))
        before = cosine[k]
        cosine[k] = before * c - sine[k] * s
        sine[k] = sine[k] * c + before * s


def summed(yaw: Floats, roll: Floats, cosine: Floats, sine: Floats) -> tuple[float, float]:
    """Return the sums of yaw cos and roll sin over the components."""
    total_yaw = total_roll = 0.0
    for k in range(len(yaw)):
        total_yaw += yaw[k] * cosine[k]
        total_roll += roll[k] * sine[k]
    return total_yaw, total_roll
