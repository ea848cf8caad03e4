"""One run of a campaign in the full simulator: `sitl.world` and the pilot itself, supervisor, monitors and all."""

from __future__ import annotations

import math

from autopilot.angles import wrap
from autopilot.build import build_pilot
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, Sample, SpeedSample
from sitl.campaign.cases import Job, case_and_seed, real_boat, scenario_of, steps_of, vessel_of
from sitl.campaign.score import NOTHING, Course, Figures, Score, figures, ordered, scored
from sitl.campaign.study import Study
from sitl.reading import Reading
from sitl.world import STEP, Orders, World, plant_of

SPEED_HZ = 1
WATER_EVERY = 5
"""The sea is felt anew every so many steps, 20 times a second: quickly enough for waves of less than 1 Hz."""


class _Told:
    """The helm that the pilot holds."""

    def __init__(self) -> None:
        self.rudder: float | None = None

    def orders(self, time: float) -> Orders:
        """Return what the pilot told the rudder last."""
        return Orders(self.rudder)


def measured_every(study: Study) -> int:
    """Return how many steps lie between two sets of readings."""
    return round(1.0 / STEP / study.heading_hz)


def course_of(study: Study) -> Course:
    """Return what is ordered."""
    turn_at = study.turn.at_s if study.turn.degrees else math.inf
    return Course(0.0, math.radians(study.turn.degrees), turn_at, study.measured_from_s)


def run_fully(job: Job, run: int) -> Figures:
    """Return the figures of a run. Raises RefusedError where the case's gains must not be engaged."""
    case, seed = case_and_seed(job, run)
    study, vessel, scenario = job.study, vessel_of(job, case), scenario_of(job, case)
    every = measured_every(study)
    world = World(
        vessel,
        scenario,
        seed,
        plant=plant_of(real_boat(job, case), scenario),
        measured_every=every,
        felt_every=WATER_EVERY,
    )
    pilot, helm, course = build_pilot(vessel, case.law), _Told(), course_of(study)
    world.helms.append(helm)
    score, told, ticks, engaged = NOTHING, 0.0, 0, 0
    seen: Reading | None = None
    for _ in range(steps_of(study, STEP)):
        now = world.time
        reading = world.sensors.latest(now)
        if reading is not None and reading is not seen:
            with_speed = round(reading.time / STEP) // every % max(study.heading_hz, 1) == 0
            samples = _samples(world, reading, now, with_speed, study.gyro)
            order = Order(OrderKind.HEADING, ordered(course, now), serial=1)
            tick = pilot.step(now, samples, order)
            command = tick.command
            helm.rudder, before = (command.angle if command.engaged else None), told
            told = command.angle if command.engaged else 0.0
            ticks, engaged, seen = ticks + 1, engaged + (tick.mode is Mode.ENGAGED), reading
            score = _scored(score, course, world, before, told)
        world.advance(world.next_step)
    return figures(score, every * STEP, engaged / max(ticks, 1))


def _samples(world: World, reading: Reading, now: float, with_speed: bool, with_rate: bool) -> tuple[Sample, ...]:
    """Return what of a set of readings reaches the pilot: the speed once a second, the heading unless it fails."""
    if world.sensors.is_silent(now):
        return ()
    with_speed = with_speed and not world.faults.is_on("speed_lost", now)
    speed = (SpeedSample(reading.time, reading.water_speed),) if with_speed else ()
    if not world.sensors.has_heading(now):
        return speed
    heading = math.nan if world.faults.is_on("heading_nan", now) else wrap(reading.heading)
    return (HeadingSample(reading.time, heading, reading.rate if with_rate else None), *speed)


def _scored(score: Score, course: Course, world: World, before: float, told: float) -> Score:
    state = world.boat.state
    return scored(score, course, world.time, state.heading, state.speed, before, told)
