"""One whole run over NamedTuples and arrays: sea, boat, sensors and pilot in the order of `sitl.world` and the pilot.

Compiled by `sitl.compiled`. A run that comes to where only the full simulator goes on says so.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.angles import wrap, wrap_positive
from autopilot.estimation.heading_filter import FilterState
from autopilot.models.waves import WaveState
from sitl.boat import BoatState, Plant, boat_step
from sitl.campaign.brain import Brain, Heard, Past, first_mind, tick
from sitl.campaign.score import NOTHING, Course, Score, ordered, scored
from sitl.campaign.waters import Surface, Water, WaterState, water_step

Floats = NDArray[np.float64]

HEADING, RATE, SPEED = 0, 5, 9
"""Places of these readings' deviates among those that `Sensors.sample` draws for one set."""
DROPOUT, FROZEN, STUCK, SILENCE = 0, 1, 2, 3
FAULTS = ("heading_dropout", "heading_frozen", "rudder_stuck", "silence")


class Instruments(NamedTuple):
    """Standard deviations [rad], [rad/s], [m/s]; offset and resolution [rad]; latency [s]; deviates by set of readings.

    A set is measured every `every` steps, a speed goes out with every `speed_every`-th set.
    """

    heading_noise: float
    rate_noise: float
    speed_noise: float
    offset: float
    resolution: float
    latency: float
    deviates: Floats
    every: int
    speed_every: int


class Faults(NamedTuple):
    """Kinds, by their places in FAULTS, and when they last [s]."""

    kinds: NDArray[np.int64]
    begin: Floats
    end: Floats


class Setting(NamedTuple):
    """All that a run depends on: steps of `dt` [s], the engine's speed [m/s], and every part's own setting.

    filtered: the filter's state after the first heading.
    """

    steps: int
    dt: float
    plant: Plant
    start: BoatState
    thrust_speed: float
    water: Water
    swell: WaveState
    instruments: Instruments
    faults: Faults
    brain: Brain
    filtered: FilterState
    course: Course


class Rooms(NamedTuple):
    """Memory that a run writes in: the waves' surface, the pilot's past, orders to the rudder by step, readings."""

    surface: Surface
    past: Past
    orders: Floats
    readings: Floats


def run_swiftly(setting: Setting, rooms: Rooms) -> tuple[Score, bool]:
    """Return the score of a run, and whether it came to its end; otherwise the full simulator must do it."""
    instruments, faults, course, dt = setting.instruments, setting.faults, setting.course, setting.dt
    state = setting.start
    water = WaterState(setting.swell, 0.0, 0.0, 0)
    lag = math.ceil(instruments.latency / dt - 1.0e-7)
    taken, order, frozen = 0, 0.0, math.nan
    first = readings(instruments, instruments.deviates[0], state)
    rooms.readings[0, 0], rooms.readings[0, 1], rooms.readings[0, 2] = first
    if at_work(faults, DROPOUT, lag * dt) or at_work(faults, SILENCE, lag * dt) or at_work(faults, FROZEN, 0.0):
        return NOTHING, False
    mind = first_mind(setting.brain, setting.filtered, lag * dt, wrap(first[0]), first[2], rooms.past)
    score, told = NOTHING, 0.0
    for step in range(setting.steps):
        time = step * dt
        if step >= lag and (step - lag) % instruments.every == 0:
            reading = (step - lag) // instruments.every
            heard = heard_of(setting, rooms, reading, time)
            mind = tick(setting.brain, mind, rooms.past, time, heard, ordered(course, time))
            if mind.gone:
                return score, False
            score = scored(score, course, time, state.heading, state.speed, told, mind.told)
            told = mind.told
        rooms.orders[step % len(rooms.orders)] = state.rudder if at_work(faults, STUCK, time) else told
        while taken <= step and taken * dt + setting.plant.gear.delay <= time:
            order = rooms.orders[taken % len(rooms.orders)]
            taken += 1
        water, acting = water_step(setting.water, rooms.surface, water, step, dt, state)
        state = boat_step(setting.plant, state, order, setting.thrust_speed, acting, dt)
        if (step + 1) % instruments.every == 0:
            frozen = measured(setting, rooms, (step + 1) // instruments.every, (step + 1) * dt, state, frozen)
    return score, True


def at_work(faults: Faults, kind: int, time: float) -> bool:
    """Return whether a fault of this kind lasts at `time` [s]."""
    for k in range(len(faults.kinds)):
        if faults.kinds[k] == kind and faults.begin[k] <= time < faults.end[k]:
            return True
    return False


def readings(instruments: Instruments, deviates: Floats, state: BoatState) -> tuple[float, float, float]:
    """Return heading [rad] in [0, 2 pi), rate [rad/s] and speed [m/s] as `Sensors.sample` makes them."""
    heading = state.heading + instruments.offset + instruments.heading_noise * deviates[HEADING]
    step = instruments.resolution
    shown = wrap_positive(round(heading / step) * step if step > 0.0 else heading)
    rate = state.rate + instruments.rate_noise * deviates[RATE]
    return shown, rate, state.speed + instruments.speed_noise * deviates[SPEED]


def measured(setting: Setting, rooms: Rooms, reading: int, time: float, state: BoatState, frozen: float) -> float:
    """Write a set of readings into its place; return the heading [rad] that a frozen compass shows, nan for none."""
    heading, rate, speed = readings(setting.instruments, setting.instruments.deviates[reading], state)
    if at_work(setting.faults, FROZEN, time):
        frozen = wrap_positive(unrounded(setting.instruments, reading, state)) if math.isnan(frozen) else frozen
        heading = frozen
    else:
        frozen = math.nan
    place = reading % len(rooms.readings)
    rooms.readings[place, 0], rooms.readings[place, 1], rooms.readings[place, 2] = heading, rate, speed
    return frozen


def unrounded(instruments: Instruments, reading: int, state: BoatState) -> float:
    """Return the heading [rad] before its resolution: what a freezing compass keeps."""
    return state.heading + instruments.offset + instruments.heading_noise * instruments.deviates[reading][HEADING]


def heard_of(setting: Setting, rooms: Rooms, reading: int, now: float) -> Heard:
    """Return what of a set of readings reaches the pilot at `now` [s]."""
    faults, instruments = setting.faults, setting.instruments
    place, time = reading % len(rooms.readings), reading * instruments.every * setting.dt
    if at_work(faults, SILENCE, now):
        return Heard(time, math.nan, math.nan, math.nan)
    speed = rooms.readings[place, 2] if reading % instruments.speed_every == 0 else math.nan
    if at_work(faults, DROPOUT, now):
        return Heard(time, math.nan, math.nan, speed)
    return Heard(time, wrap(rooms.readings[place, 0]), rooms.readings[place, 1], speed)
