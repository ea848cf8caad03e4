"""Runs of the steering study: boats of the simulator's zoo, a sea worth a rudder angle, instruments, and the loop.

What pushes the boat is a rudder angle: waves (Jiang et al. 2016's spectrum, a second-order shaping filter), a steady
wind and gusts (first order). Nobody at the helm knows the deviates. Everything goes in lockstep: a set of readings, the
helmsman, his order `path` seconds later at the servo, the plant in steps of 10 ms.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from autopilot.angles import wrap
from autopilot.control.registry import own_step
from autopilot.estimation.fusion import Measured
from autopilot.estimation.heading_ekf import FilterState, initial
from autopilot.estimation.rudder_observer import RudderMemory
from autopilot.runtime.build import gear_of, model_of
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Helm, Model, Rudder, Vessel
from sitl.boat import BoatState, Disturbance, Hull, Plant, boat_step, step_of
from sitl.campaign.compiled_tick import CampaignConfig, Measurement, initial_state, tick
from sitl.campaign.setting import campaign_of, ring_of
from sitl.compiled import compiled
from sitl.registry import PLANTS
from sitl.scenario import Scenario

Floats = npt.NDArray[np.float64]

STEP = 0.01
FIRST_S = 60.0
"""A run counts from then on."""
LOST = 1.0e3
"""What stands for heading rms [deg] and rudder travel [deg/s] where nobody steers."""


class Sea(NamedTuple):
    """What pushes, in degrees of rudder: waves [rms] of a frequency [rad/s] and damping [-], a steady wind, gusts [rms]
    of a correlation time [s]."""

    waves: float = 0.0
    frequency: float = 0.6082763
    damping: float = 0.2959182
    wind: float = 0.0
    gusts: float = 0.0
    gust_time: float = 10.0


class Instruments(NamedTuple):
    """Readings a second, noise of the heading [deg] and of the rate [deg/s], and whether there is a rate at all."""

    hz: int = 20
    heading_deg: float = 0.0
    rate_deg_s: float = 0.0
    has_rate: bool = True


class Boat(NamedTuple):
    """The vessel file that a skipper has of it, the plant it really is, and the speed [m/s] its engine would reach."""

    vessel: Vessel
    plant: Any
    step: Callable[..., Any]
    speed: float


class Drawn(NamedTuple):
    """A run's numbers: pushes [rad of rudder] by step, deviates of heading [rad] and rate [rad/s] by set of readings
    (the rates are nan where there is none), steps between sets, and steps from order to servo."""

    pushes: Floats
    headings: Floats
    rates: Floats
    every: int
    path: int
    speed: float


class Score(NamedTuple):
    """Sums over the ticks that count."""

    ticks: int
    square: float
    travel: float


def drawn(boat: Boat, sea: Sea, instruments: Instruments, path_s: float, run: tuple[int, float]) -> Drawn:
    """Return the numbers of a run: its seed and how long it lasts [s]."""
    seed, seconds = run
    steps = round((FIRST_S + seconds) / STEP)
    every = round(1.0 / (STEP * instruments.hz))
    sea_random, sensor_random = (np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(2))
    deviates = sea_random.standard_normal((steps, 3))
    pushes = sea.wind + sea.waves * _waves(sea, deviates) + sea.gusts * _gusts(sea, deviates[:, 2])
    noise = sensor_random.standard_normal((steps // every + 1, 2))
    rates = np.radians(instruments.rate_deg_s) * noise[:, 1]
    return Drawn(
        np.radians(pushes),
        np.radians(instruments.heading_deg) * noise[:, 0],
        rates if instruments.has_rate else np.full(len(rates), math.nan),
        every,
        round(path_s / STEP),
        boat.speed,
    )


def _waves(sea: Sea, deviates: Floats) -> Floats:
    """Return y'' + 2 xi w0 y' + w0^2 y = noise', of rms 1, exact at the steps."""
    from scipy.linalg import expm
    from scipy.signal import lfilter

    w, xi = sea.frequency, sea.damping
    a = np.array([[0.0, w], [-w, -2.0 * xi * w]])
    f = expm(STEP * a)
    q = np.eye(2) - f @ f.T
    root = np.linalg.cholesky(q + 1.0e-15 * np.eye(2))
    kicks = deviates[:, :2] @ root.T
    # x2 as a filter of both kicks: (z - f11) k2 + f21 k1 over the characteristic polynomial
    poly = [1.0, -f[0, 0] - f[1, 1], f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]]
    return np.asarray(lfilter([1.0, -f[0, 0]], poly, kicks[:, 1]) + lfilter([0.0, f[1, 0]], poly, kicks[:, 0]))


def _gusts(sea: Sea, deviates: Floats) -> Floats:
    from scipy.signal import lfilter

    keep = math.exp(-STEP / sea.gust_time)
    return np.asarray(lfilter([math.sqrt(1.0 - keep * keep)], [1.0, -keep], deviates))


def scored(score: Score, time: float, heading: float, moved: float) -> Score:
    """Return the score a tick later."""
    if time < FIRST_S:
        return score
    error = wrap(heading)
    return Score(score.ticks + 1, score.square + error * error, score.travel + abs(moved))


def point(score: Score, hz: int) -> tuple[float, float]:
    """Return heading rms [deg] and rudder travel [deg/s]."""
    count = max(score.ticks, 1)
    found = math.degrees(math.sqrt(score.square / count)), math.degrees(score.travel) / count * hz
    return found if all(math.isfinite(each) for each in found) else (LOST, LOST)


def plant_step(plant: Any, step: Any, state: BoatState, order: float, speed: float, acting: Disturbance) -> BoatState:
    """Stand for the plant's own step, which is compiled in its place."""
    return boat_step(plant, step, state, order, speed, acting)


def peer_step(helm: Any, memory: Any, heading: float, rate: float, dt: float) -> tuple[float, Any]:
    """Stand for the helmsman's own step, which is compiled in its place."""
    raise NotImplementedError


def run_pilot(
    plant: Any, step: Any, given: Drawn, campaign: CampaignConfig, filtered: FilterState, rings: Any
) -> Score:
    """Return the score of the pilot, on the course 0."""
    memory, orders = rings
    state = BoatState(0.0, 0.0, 0.0, 0.0, given.speed, 0.0, 0.0, 0.0, 0.0, given.speed, 0.0)
    first = Measurement(Measured(0.0, wrap(given.headings[0]), given.rates[0]), given.speed)
    pilot = initial_state(campaign, filtered, 0.0, first, memory)
    score, command, order, number = Score(0, 0.0, 0.0), 0.0, 0.0, 0
    for k in range(len(given.pushes)):
        if k % given.every == 0:
            time = k * STEP
            seen = Measured(time, wrap(state.heading + given.headings[number]), state.rate + given.rates[number])
            speed = given.speed if number % 20 == 0 else math.nan
            pilot = tick(campaign, pilot, memory, time, Measurement(seen, speed), 0.0)
            score = scored(score, time, state.heading, pilot.command - command)
            command = pilot.command
            number += 1
        orders[k % len(orders)] = command
        if k >= given.path:
            order = orders[(k - given.path) % len(orders)]
        acting = Disturbance(given.pushes[k], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        state = plant_step(plant, step, state, order, given.speed, acting)
    return score


def run_peer(plant: Any, step: Any, given: Drawn, helm: Any, memory: Any, orders: Floats) -> Score:
    """Return the score of a peer, on the course 0."""
    dt = STEP * given.every
    state = BoatState(0.0, 0.0, 0.0, 0.0, given.speed, 0.0, 0.0, 0.0, 0.0, given.speed, 0.0)
    score, command, order, number = Score(0, 0.0, 0.0), 0.0, 0.0, 0
    for k in range(len(given.pushes)):
        if k % given.every == 0:
            before = command
            seen = wrap(state.heading + given.headings[number])
            command, memory = peer_step(helm, memory, seen, state.rate + given.rates[number], dt)
            score = scored(score, k * STEP, state.heading, command - before)
            number += 1
        orders[k % len(orders)] = command
        if k >= given.path:
            order = orders[(k - given.path) % len(orders)]
        acting = Disturbance(given.pushes[k], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        state = plant_step(plant, step, state, order, given.speed, acting)
    return score


@functools.cache
def compiled_pilot(law: str, moved: Callable[..., Any]) -> Callable[..., Any]:
    """Return the pilot's run with this law and plant, compiled."""
    return compiled(run_pilot, quick=True, instead={**own_step(law), plant_step: moved})


@functools.cache
def compiled_peer(helm_step: Callable[..., Any], moved: Callable[..., Any]) -> Callable[..., Any]:
    """Return a peer's run with this plant, compiled."""
    return compiled(run_peer, quick=True, instead={peer_step: helm_step, plant_step: moved})


def sailed_pilot(boat: Boat, vessel: Vessel, given: Drawn, law: str = "backstepping") -> tuple[float, float]:
    """Return heading rms and travel of the pilot with a vessel file. Raises RefusedError for gains without margins."""
    campaign = campaign_of(vessel, law)
    assert campaign is not None
    rate = None if math.isnan(given.rates[0]) else float(given.rates[0])
    state = initial(0.0, float(given.headings[0]), rate, campaign.config.estimator.noises.usual)
    dt = STEP * given.every
    past, orders = ring_of(64 + math.ceil(2.0 / dt)), ring_of(3 + math.ceil(campaign.config.estimator.gear.delay / dt))
    memory = RudderMemory(*(np.zeros(kept) for kept in (past, past, past, orders, orders, 1)))
    rings = (memory, np.zeros(ring_of(given.path + 2)))
    run = compiled_pilot(law, boat.step)
    return point(run(boat.plant, step_of(boat.plant, STEP), given, campaign, state, rings), round(1.0 / dt))


def sailed_peer(boat: Boat, helm: Any, first: Any, helm_step: Callable[..., Any], given: Drawn) -> tuple[float, float]:
    """Return heading rms and travel of a peer."""
    run = compiled_peer(helm_step, boat.step)
    orders = np.zeros(ring_of(given.path + 2))
    return point(
        run(boat.plant, step_of(boat.plant, STEP), given, helm, first, orders), round(1.0 / (STEP * given.every))
    )


def equation_boat(name: str, vessel_model: Model, rudder: Rudder) -> Boat:
    """Return a boat that is its model, with this steering gear."""
    vessel = Vessel(2, name, vessel_model, rudder, helm=Helm(rudder_at_full_pwm_deg=rudder.angle_max_deg))
    # no speed is lost in turns: a course is held
    plant = Plant(model_of(vessel), gear_of(vessel)._replace(delay=0.0), Hull(turn_speed_loss=0.0))
    return Boat(vessel, plant, boat_step, vessel_model.reference_speed_m_s)


def zoo_boat(kind: str) -> Boat:
    """Return a plant of the simulator with the vessel file that was identified from its zigzags."""
    vessel = load_vessel(kind)
    plant = PLANTS[kind].of(vessel, Scenario(1, "front"))
    return Boat(vessel, plant, PLANTS[kind].step, vessel.model.reference_speed_m_s)


def quick_boat() -> Boat:
    """Return the boat of K 0.43 1/s and T 3.5 s."""
    return equation_boat("K 0.43 1/s, T 3.5 s", Model(0.43, 3.5, 5.0, n3_s2_rad2=5.0), Rudder(30.0, 15.0, 0.1, 0.0))


def lanxin_boat() -> Boat:
    """Return Lanxin (Jiang et al. 2016) with a rudder of 15 deg/s."""
    return equation_boat("Lanxin", Model(0.701, 0.332, 4.63, n3_s2_rad2=3.2828), Rudder(30.0, 15.0, 0.1, 0.0))


def as_known(vessel: Vessel, instruments: Instruments, path_s: float) -> Vessel:
    """Return the vessel file of somebody who measured his instruments and the path to his servo."""
    sensors = replace(
        vessel.sensors,
        heading_noise_deg=max(instruments.heading_deg, 0.001),
        rate_noise_deg_s=max(instruments.rate_deg_s, 0.001),
        gyro=instruments.has_rate,
    )
    control = replace(vessel.control, rate_hz=float(instruments.hz))
    return replace(vessel, sensors=sensors, control=control, rudder=replace(vessel.rudder, delay_s=path_s))
