"""From a run of a study to the NamedTuples and arrays of `compiled_loop`: the same numbers that `full` starts from.

One run of a campaign in the full simulator: `sitl.world` and the pilot itself, supervisor, monitors and all.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from autopilot.angles import wrap
from autopilot.errors import RefusedError
from autopilot.estimation.heading_ekf import initial
from autopilot.estimation.rudder_observer import RudderMemory
from autopilot.models.weather import WaveState
from autopilot.pilot_state import steering_of
from autopilot.runtime.build import build_pilot, law_of, pilot_config, verdict_of
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, Sample, SpeedSample, Tick
from autopilot.vessel.schema import Vessel
from sitl.boat import BoatState, Plant, plant_of, step_of
from sitl.campaign.compiled_run import (
    NOTHING,
    Course,
    Figures,
    Instruments,
    Setting,
    Workspace,
    figures,
    ordered,
    readings,
    scored,
)
from sitl.campaign.compiled_tick import CampaignConfig
from sitl.campaign.study import Case, Job, Study, case_and_seed, real_boat, scenario_of, steps_of, vessel_of
from sitl.scenario import Scenario
from sitl.sea import Water, surface_of, swell_at_start, water_of
from sitl.sensors import DEVIATES_A_SET, Reading, noise_of
from sitl.world import STEP, Orders, Pace, World

SPEED_HZ = 1
WATER_EVERY = 5
"""The sea is felt anew every so many steps, 20 times a second: quickly enough for waves of less than 1 Hz."""


class _LastCommand:
    """The helm that the pilot holds."""

    def __init__(self) -> None:
        self.rudder: float | None = None

    def orders(self, time: float) -> Orders:
        """Return the pilot's last rudder command."""
        return Orders(self.rudder)


def measured_every(study: Study) -> int:
    """Return how many steps lie between two sets of readings."""
    return round(1.0 / STEP / study.heading_hz)


def course_of(study: Study) -> Course:
    """Return what is ordered."""
    turn_at = study.turn.at_s if study.turn.degrees else math.inf
    return Course(0.0, math.radians(study.turn.degrees), turn_at, study.measured_from_s)


def run_reference(job: Job, run: int) -> Figures:
    """Return the figures of a run. Raises RefusedError where the case's gains must not be engaged."""
    case, seed = case_and_seed(job, run)
    study, vessel, scenario = job.study, vessel_of(job, case), scenario_of(job, case)
    plant = plant_of(real_boat(job, case), scenario)
    shared = Prepared(scenario, plant, None, course_of(study), BoatState(), vessel)
    score, before, ticks, engaged = NOTHING, 0.0, 0, 0
    for tick, world, command in sailed(shared, study, seed, case.law):
        score = scored(score, shared.course, world.time, world.boat.state, before, command)
        ticks, engaged, before = ticks + 1, engaged + (tick.mode is Mode.ENGAGED), command
    return figures(score, measured_every(study) * STEP, engaged / max(ticks, 1))


def sailed(shared: Prepared, study: Study, seed: int, law: str | None = None) -> Iterator[tuple[Tick, World, float]]:
    """Yield the ticks of a run in the full simulator, each with the world as it is then and the last command [rad]."""
    every = measured_every(study)
    world = World(shared.vessel, shared.scenario, seed, plant=shared.plant, pace=Pace(every, WATER_EVERY))
    pilot, helm = build_pilot(shared.vessel, law), _LastCommand()
    world.helms.append(helm)
    seen: Reading | None = None
    for _ in range(steps_of(study, STEP)):
        now = world.time
        reading = world.sensors.latest(now)
        if reading is not None and reading is not seen:
            with_speed = round(reading.time / STEP) // every % max(study.heading_hz, 1) == 0
            samples = _samples(world, reading, now, with_speed, study.gyro)
            order = Order(OrderKind.HEADING, ordered(shared.course, now), serial=1)
            tick, seen = pilot.step(now, samples, order), reading
            helm.rudder = tick.command.angle if tick.command.engaged else None
            yield tick, world, tick.command.angle if tick.command.engaged else 0.0
        world.advance(world.next_step)


def _samples(world: World, reading: Reading, now: float, with_speed: bool, with_rate: bool) -> tuple[Sample, ...]:
    """Return what of a set of readings reaches the pilot: the speed once a second, the heading unless it fails."""
    if world.sensors.is_silent(now):
        return ()
    with_speed = with_speed and not world.faults.silences("VFR_HUD", now)
    speed = (SpeedSample(reading.time, reading.water_speed),) if with_speed else ()
    if not world.sensors.has_heading(now):
        return speed
    heading = wrap(reading.heading)
    for fault, effect in world.faults.acting("attitude", now):
        heading = effect(fault, heading)
    return (HeadingSample(reading.time, heading, reading.rate if with_rate else None), *speed)


RING = 64


class Prepared(NamedTuple):
    """What the runs of a case share. `campaign` is None where only the full simulator does justice to the vessel."""

    scenario: Scenario
    plant: Plant
    campaign: CampaignConfig | None
    course: Course
    start: BoatState
    vessel: Vessel


@functools.lru_cache(maxsize=512)
def prepared(job: Job, case: Case) -> Prepared:
    """Return what the runs of a case share. Raises RefusedError where its gains must not be engaged."""
    vessel, scenario = vessel_of(job, case), scenario_of(job, case)
    if refusal := verdict_of(vessel, case.law).refusal:
        raise RefusedError(f"vessel {vessel.name!r}: {refusal}")
    speed, real = scenario.start.speed_m_s or 0.0, real_boat(job, case)
    campaign = campaign_of(vessel, case.law)
    if campaign is not None and real.model == vessel.model:
        # a boat that is its file's answers its rudder, and to ask at every tick would cost a tenth of the speed
        campaign = campaign._replace(alarms=campaign.alarms._replace(rudder_response=False))
    return Prepared(
        scenario,
        plant_of(real, scenario),
        campaign,
        course_of(job.study),
        BoatState(heading=0.0, speed=speed, north_speed=speed, east_speed=0.0),
        vessel,
    )


def campaign_of(vessel: Vessel, law: str) -> CampaignConfig | None:
    """Return what the pilot knows of the boat, for `campaign`; None where it does more than that module knows."""
    config, chosen = pilot_config(vessel, law), law_of(vessel, law)
    if config.roll is not None or not config.rudder_is_ours or chosen.kind.takes_roll:
        return None
    return CampaignConfig(
        config=steering_of(config, chosen),
        gains=chosen.gains,
        first=chosen.first(0.0),
        heading_timeout=config.failsafe.heading_timeout,
        alarms=config.alarms,
    )


def setting_of(job: Job, run: int) -> Setting | None:
    """Return the setting of a run; None where only the full simulator can do it."""
    case, seed = case_and_seed(job, run)
    shared = prepared(job, case)
    return None if shared.campaign is None or shared.scenario.faults else setting_for(shared, job.study, seed)


def setting_for(shared: Prepared, study: Study, seed: int) -> Setting:
    """Return the setting of a run of what is shared."""
    assert shared.campaign is not None
    steps = steps_of(study, STEP)
    sea_seed, sensor_seed, _, _ = np.random.SeedSequence(seed).spawn(4)
    water, swell = drawn_water(shared.scenario, shared.plant, sea_seed, steps // WATER_EVERY + 1)
    every = measured_every(study)
    instruments = instruments_of(shared, sensor_seed, steps, every, study)
    heading, rate, _ = readings(instruments, 0, shared.start)
    return Setting(
        steps=steps,
        dt=STEP,
        plant=shared.plant,
        step=step_of(shared.plant, STEP),
        start=shared.start,
        thrust_speed=shared.start.speed,
        water_every=WATER_EVERY,
        water=water,
        swell=swell,
        instruments=instruments,
        campaign=shared.campaign,
        filtered=initial(
            0.0,
            wrap(float(heading)),
            float(rate) if study.gyro else None,
            shared.campaign.config.estimator.noises.usual,
        ),
        course=shared.course,
        is_watched=True,
    )


def instruments_of(shared: Prepared, seed: np.random.SeedSequence, steps: int, every: int, study: Study) -> Instruments:
    """Return the instruments with all their deviates, drawn as `sitl.sensors.Sensors` draws them."""
    sets = steps // every + 1
    deviates = np.random.default_rng(seed).standard_normal((sets, DEVIATES_A_SET))
    return Instruments(
        noise=noise_of(shared.vessel, shared.scenario),
        deviates=deviates,
        every=every,
        speed_every=study.heading_hz // SPEED_HZ,
        has_rate=study.gyro,
    )


def drawn_water(scenario: Scenario, plant: Plant, seed: np.random.SeedSequence, steps: int) -> tuple[Water, WaveState]:
    """Return the sea with all its deviates, drawn as `sitl.sea.Sea` draws them, and the swell at the start."""
    swell_seed, ittc_seed, wind_seed = seed.spawn(3)
    water, swell = water_of(scenario, plant.hull, ittc_seed, WATER_EVERY * STEP), WaveState()
    if water.has_swell:
        drawn = np.random.default_rng(swell_seed).standard_normal(2 + 2 * steps)
        swell = swell_at_start(scenario, float(drawn[0]), float(drawn[1]))
        water = water._replace(swell_noise=drawn[2:])
    if water.has_wind:
        water = water._replace(wind_noise=np.random.default_rng(wind_seed).standard_normal(steps))
    return water, swell


def workspace_of(setting: Setting, *, plain: bool = False) -> Workspace:
    """Return memory for one run; `plain`: for the loop as it is, which is slow with NumPy's numbers."""
    delay, latency = setting.plant.gear.delay, setting.instruments.noise.latency
    tick = setting.instruments.every * setting.dt
    past = ring_of(RING + math.ceil(2.0 / tick))
    orders = ring_of(3 + math.ceil(setting.campaign.config.estimator.gear.delay / tick))
    if plain:
        memory = RudderMemory(*([0.0] * kept for kept in (past, past, past, orders, orders, 1)))
    else:
        memory = RudderMemory(*(np.zeros(kept) for kept in (past, past, past, orders, orders, 1)))
    return Workspace(
        surface_of(len(setting.water.waves.number)),
        memory,
        np.zeros(ring_of(2 + math.ceil(delay / setting.dt))),
        np.zeros((ring_of(2 + math.ceil(latency / tick)), 3)),
    )


def ring_of(least: int) -> int:
    """Return the length of a ring that holds `least` entries: a power of two."""
    return 1 << (least - 1).bit_length()
