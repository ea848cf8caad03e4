"""One whole run over NamedTuples and arrays: sea, boat, sensors and pilot in the order of `sitl.world` and the pilot.

Compiled by `sitl.compiled`. A run that comes to where only the full simulator goes on says so.

What a run is judged by, summed up tick by tick; the same function scores compiled and full runs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.angles import wrap
from autopilot.estimation.fusion import Measured
from autopilot.estimation.heading_ekf import FilterState
from autopilot.estimation.rudder_observer import RudderMemory
from autopilot.models.weather import WaveState
from sitl.boat import BoatState, Disturbance, Plant, Step, boat_step
from sitl.campaign.compiled_tick import CampaignConfig, Measurement, initial_state, tick
from sitl.sea import Surface, Water, WaterState, water_step
from sitl.sensors import HEADING, RATE, SPEED, Noise, shown

SETTLED = math.radians(1.0)
"""A turn is over when the true heading stays within this [rad] of the one ordered."""


class Course(NamedTuple):
    """What is ordered: heading [rad] at first, and `turn` [rad] on top of it from `turn_at` [s] on. Ticks before
    `measured_from` [s] do not count."""

    heading: float
    turn: float
    turn_at: float
    measured_from: float


class Score(NamedTuple):
    """Sums over the ticks that count; overshoot [rad] beyond the new heading, settled [s] after the turn's order."""

    ticks: int = 0
    error: float = 0.0
    error_square: float = 0.0
    error_most: float = 0.0
    travel: float = 0.0
    rudder_square: float = 0.0
    speed: float = 0.0
    overshoot: float = 0.0
    settled: float = 0.0


NOTHING = Score()


def ordered(course: Course, now: float) -> float:
    """Return the heading [rad] ordered at `now` [s]."""
    return wrap(course.heading + course.turn) if now >= course.turn_at else course.heading


def scored(score: Score, course: Course, now: float, state: BoatState, command_before: float, command: float) -> Score:
    """Return the score after a tick at `now` [s]: the boat's true state, and rudder orders [rad]."""
    error = wrap(state.heading - ordered(course, now))
    overshoot, settled = score.overshoot, score.settled
    if course.turn != 0.0 and now >= course.turn_at:
        beyond = error if course.turn > 0.0 else -error
        # what lies half a circle off is on its way, not beyond
        overshoot = max(overshoot, beyond) if beyond < 0.5 * math.pi else overshoot
        settled = now - course.turn_at if abs(error) > SETTLED else settled
    if now < course.measured_from:
        return Score(
            score.ticks,
            score.error,
            score.error_square,
            score.error_most,
            score.travel,
            score.rudder_square,
            score.speed,
            overshoot,
            settled,
        )
    return Score(
        score.ticks + 1,
        score.error + error,
        score.error_square + error * error,
        max(score.error_most, abs(error)),
        score.travel + abs(command - command_before),
        score.rudder_square + command * command,
        score.speed + state.speed,
        overshoot,
        settled,
    )


class Figures(NamedTuple):
    """A run in numbers: heading error's rms, mean and most [deg], rudder travel [deg/s] and rms [deg], mean speed
    [m/s]; of a turn the overshoot [deg] and the time until it was over [s]; the share of ticks engaged."""

    heading_rms_deg: float
    heading_mean_deg: float
    heading_most_deg: float
    travel_deg_s: float
    rudder_rms_deg: float
    speed_m_s: float
    overshoot_deg: float
    settled_s: float
    engaged: float


def figures(score: Score, tick_s: float, engaged: float) -> Figures:
    """Return the figures of a score with a tick every `tick_s` [s], engaged for this share of them."""
    count = max(score.ticks, 1)
    return Figures(
        math.degrees(math.sqrt(score.error_square / count)),
        math.degrees(score.error / count),
        math.degrees(score.error_most),
        math.degrees(score.travel / (count * tick_s)),
        math.degrees(math.sqrt(score.rudder_square / count)),
        score.speed / count,
        math.degrees(score.overshoot),
        score.settled,
        engaged,
    )


Floats = NDArray[np.float64]

CALM = Disturbance(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Instruments(NamedTuple):
    """The instruments' noise, and deviates by set of readings.

    A set is measured every `every` steps, a speed goes out with every `speed_every`-th set, and a rate with each where
    there is a gyro, `has_rate`.
    """

    noise: Noise
    deviates: Floats
    every: int
    speed_every: int
    has_rate: bool


class Setting(NamedTuple):
    """All that a run depends on: steps of `dt` [s], the engine's speed [m/s], and every part's own setting.

    The sea is felt anew every `water_every` steps.

    filtered: the filter's state after the first heading. is_watched: a run ends where supervisor or monitors might have
    a word; False: it goes on as if there were none.
    """

    steps: int
    dt: float
    plant: Plant
    step: Step
    start: BoatState
    thrust_speed: float
    water_every: int
    water: Water
    swell: WaveState
    instruments: Instruments
    campaign: CampaignConfig
    filtered: FilterState
    course: Course
    is_watched: bool


class Workspace(NamedTuple):
    """Memory that a run writes in: the waves' surface, where the rudder was, orders to the rudder by step, readings.

    All but the surface are rings whose lengths are powers of two."""

    surface: Surface
    rudder: RudderMemory
    orders: Floats
    readings: Floats


def run_compiled(setting: Setting, workspace: Workspace) -> tuple[Score, bool]:
    """Return the score of a run, and whether it came to its end; otherwise the full simulator must do it."""
    instruments, course, dt = setting.instruments, setting.course, setting.dt
    state = setting.start
    water, acting, felt_dt = WaterState(setting.swell, 0.0, 0.0, 0), CALM, dt * setting.water_every
    lag = math.ceil(instruments.noise.latency / dt - 1.0e-7)
    taken, order = 0, 0.0
    # counted on: dividing integers is slow
    next_tick, next_water, next_reading, ticks, felt, reading = lag, 0, instruments.every - 1, 0, 0, 0
    orders_ring = len(workspace.orders) - 1
    heading, rate, speed = readings(instruments, 0, state)
    _keep(workspace, 0, heading, rate, speed)
    measurement = Measurement(Measured(0.0, wrap(heading), rate), speed)
    pilot_state = initial_state(setting.campaign, setting.filtered, lag * dt, measurement, workspace.rudder)
    score, command = NOTHING, 0.0
    for step in range(setting.steps):
        time = step * dt
        if step == next_tick:
            measurement = measurement_of(instruments, workspace, ticks, dt)
            next_tick, ticks = next_tick + instruments.every, ticks + 1
            pilot_state = tick(
                setting.campaign, pilot_state, workspace.rudder, time, measurement, ordered(course, time)
            )
            if pilot_state.gone and setting.is_watched:
                return score, False
            score = scored(score, course, time, state, command, pilot_state.command)
            command = pilot_state.command
        workspace.orders[step & orders_ring] = command
        while taken <= step and taken * dt + setting.plant.gear.delay <= time:
            order = float(workspace.orders[taken & orders_ring])
            taken += 1
        if step == next_water:
            water, acting = water_step(setting.water, workspace.surface, water, felt, felt_dt, state)
            next_water, felt = next_water + setting.water_every, felt + 1
        state = boat_step(setting.plant, setting.step, state, order, setting.thrust_speed, acting)
        if step == next_reading:
            next_reading, reading = next_reading + instruments.every, reading + 1
            heading, rate, speed = readings(instruments, reading, state)
            _keep(workspace, reading, heading, rate, speed)
    return score, True


def readings(instruments: Instruments, reading: int, state: BoatState) -> tuple[float, float, float]:
    """Return heading [rad] in [0, 2 pi), rate [rad/s] and speed [m/s] as `Sensors.sample` makes them."""
    drawn = instruments.deviates
    heading, rate, speed = drawn[reading, HEADING], drawn[reading, RATE], drawn[reading, SPEED]
    return shown(instruments.noise, state, float(heading), float(rate), float(speed))


def _keep(workspace: Workspace, reading: int, heading: float, rate: float, speed: float) -> None:
    place = reading & (len(workspace.readings) - 1)
    workspace.readings[place, 0] = heading
    workspace.readings[place, 1] = rate
    workspace.readings[place, 2] = speed


def measurement_of(instruments: Instruments, workspace: Workspace, reading: int, dt: float) -> Measurement:
    """Return what of a set of readings reaches the pilot."""
    place, time = reading & (len(workspace.readings) - 1), reading * instruments.every * dt
    heading = wrap(float(workspace.readings[place, 0]))
    rate = float(workspace.readings[place, 1]) if instruments.has_rate else math.nan
    speed = float(workspace.readings[place, 2]) if reading % instruments.speed_every == 0 else math.nan
    return Measurement(Measured(time, heading, rate), speed)
