"""How far boat, gear, speed and sea may be from the vessel file before the pilot does not hold the boat any more.

Runs are drawn at random over ranges about the file: what the file says of its own uncertainty, and for the rest what
boats show. Each run keeps a course and turns. It is *held* where the boat never leads past its course by more than the
file's off-course limit, and is within that of it once the turn has had its time. Where it leaves, it is *alarmed* if an
alarm stands, or steering has ended with one, no later than ALARM_S after; *back* if it is within the limit again by
then, or is ordered to turn; and *unsaid* else. The compiled loop does the runs that it can; those that it hands over,
or in which the boat leaves, are done again by the full simulator, monitors and all.

With the distance of a run from the file as a share of each range, the bounds are the largest box about the file without
a run that is not held: first the same share of every range, then as far on in one range after the other as it goes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from autopilot.angles import wrap
from autopilot.errors import RefusedError
from autopilot.guidance.stop import turn_limits
from autopilot.guidance.turn import turning_time
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import limits_of, model_at_ratio, planned_share, verdict_of
from autopilot.signals import Mode
from autopilot.vessel.schema import Vessel
from sitl.boat import BoatState, plant_of
from sitl.campaign.compiled_run import figures
from sitl.campaign.setting import Prepared, campaign_of, course_of, measured_every, sailed, setting_for, workspace_of
from sitl.campaign.study import Study, TurnSection
from sitl.campaign.work import announce, compiled_loop
from sitl.scenario import GearSection, HullSection, Scenario, SecondOrderSection, Start, WavesSection, WindSection
from sitl.world import STEP

OFF_DEG = 20.0
"""Where the file names no off-course limit [deg]."""
ALARM_S = 5.0
COURSE_S = 20.0
"""So long [s] the course is kept before the turn."""
AFTER_S = 60.0
"""And the new one after the turn has had its time."""
FINEST = 2.0
"""A boat with a time constant below this [s] has 20 readings a second, any other 10."""
HELD, BACK, ALARMED, UNSAID = "held", "back", "alarmed", "unsaid"
SIGMAS = 2.0
"""A number of the file is uncertain by so many of its standard errors."""


class Range(NamedTuple):
    """What is drawn: its name, from `low` to `high`, and what the file says. A ratio is drawn by its logarithm."""

    name: str
    unit: str
    low: float
    filed: float
    high: float

    @property
    def is_ratio(self) -> bool:
        """Whether it multiplies what the file says."""
        return self.filed == 1.0

    def at(self, share: float) -> float:
        """Return the value at a `share` of the way from the file's to `high`, to `low` where it is negative."""
        end = self.high if share > 0.0 else self.low
        if self.is_ratio:
            return float(end ** abs(share))
        return self.filed + abs(share) * (end - self.filed)


SPEED = 6
"""The place of the speed among the ranges."""
Drawn = tuple[float, ...]
"""Of each range the share, from -1 at its low end to 1 at its high end; 0: as filed."""


class Found(NamedTuple):
    """A run: its number and shares, what became of it, when it left [s] and when an alarm stood then [s], nan: never,
    and how far past its course [deg] it led."""

    run: int
    drawn: Drawn
    outcome: str
    left_s: float
    alarm_s: float
    overshoot_deg: float


def ranges_of(vessel: Vessel) -> tuple[Range, ...]:
    """Return what is uncertain of a vessel."""
    model, errors = vessel.model, vessel.model.standard_errors

    def about(value: float, error: float | None, usual: float) -> tuple[float, float]:
        """The ends of a ratio: by the file's standard error where it has one."""
        off = SIGMAS * error / abs(value) if error and value else usual
        off = min(max(off, 0.02), 0.6)
        return 1.0 - off, 1.0 + off

    gain = about(model.K_1_s, errors.K_1_s, 0.4)
    lasts = about(model.T_s, errors.T_s, 0.4)
    damping = about(model.n3_s2_rad2, errors.n3_s2_rad2, 0.6)
    return (
        Range("K", "x", gain[0], 1.0, gain[1]),
        Range("T", "x", lasts[0], 1.0, lasts[1]),
        Range("n3", "x", damping[0], 1.0, damping[1]),
        Range("rudder rate", "x", 0.25, 1.0, 1.5),
        Range("delay", "s", 0.0, 0.0, 0.3),
        Range("backlash", "deg", 0.0, 0.0, 6.0),
        Range("speed read", "x", 1.0 / 3.0, 1.0, 3.0),
        Range("waves", "deg rms", 0.0, 0.0, 3.0),
        Range("wind", "deg", 0.0, 0.0, 5.0),
    )


def limit_of(vessel: Vessel) -> float:
    """Return how far [rad] past its course, or off it when the turn is over, a boat is not held any more."""
    return math.radians(vessel.alarms.off_course_deg or OFF_DEG)


def drawn_of(seed: int, run: int, ranges: tuple[Range, ...]) -> tuple[Drawn, float]:
    """Return the shares of a run, and its turn [deg]: as many runs lie at each distance from the file."""
    random = np.random.default_rng((seed, run))
    reach, signs = random.random(), random.uniform(-1.0, 1.0, len(ranges))
    shares = tuple(
        0.0 if (each.low if share < 0.0 else each.high) == each.filed else float(reach * share)
        for each, share in zip(ranges, signs, strict=True)
    )
    return shares, float(random.uniform(20.0, 150.0) * random.choice((-1.0, 1.0)))


def study_of(vessel: Vessel, turn_deg: float, speed: float, *, gyro: bool) -> tuple[Study, float]:
    """Return how a run is sailed, and until when [s] the turn may last: as long as the pilot itself gives it by the
    `speed` [share of the trial's] that the log shows."""
    model, limits = model_at_ratio(vessel, min(speed, 1.0)), limits_of(vessel)
    planned = turn_limits(model, SteeringGear(limits.angle_max, limits.rate_max), planned_share(vessel))
    until = COURSE_S + 2.0 * model.time_constant + turning_time(model, planned, math.radians(turn_deg))
    study = Study(
        schema_version=1,
        name="envelope",
        boats={},
        seconds=until + AFTER_S,
        measured_from_s=until,
        heading_hz=20 if model.time_constant < FINEST else 10,
        gyro=gyro,
        turn=TurnSection(turn_deg, COURSE_S),
        laws=(vessel.control.law,),
    )
    return study, until


def hull_of(length_m: float | None) -> HullSection:
    """Return the usual hull, of a length where it is known: by Froude, times go with its root."""
    usual = HullSection()
    scale = 1.0 if length_m is None else length_m / usual.length_m
    return replace(
        usual,
        length_m=usual.length_m * scale,
        beam_m=usual.beam_m * scale,
        draught_m=usual.draught_m * scale,
        drift_lever_m=usual.drift_lever_m * scale,
        speed_time_s=usual.speed_time_s * math.sqrt(scale),
        sway_time_s=usual.sway_time_s * math.sqrt(scale),
        roll_period_s=usual.roll_period_s * math.sqrt(scale),
    )


def prepared_for(vessel: Vessel, study: Study, ranges: tuple[Range, ...], drawn: Drawn) -> Prepared:
    """Return boat, sea and pilot of a run.

    A log that shows so many times the speed is sailed as a boat that makes it, and turns as the other one does: by
    Norrbin's scaling nothing else tells the two apart.
    """
    gain, lasts, n3, rate, delay, backlash, speed, waves, gusts = (
        each.at(share) for each, share in zip(ranges, drawn, strict=True)
    )
    model, rudder = vessel.model, vessel.rudder
    shown = model.reference_speed_m_s * speed
    real = replace(
        vessel,
        model=replace(
            model,
            K_1_s=model.K_1_s * gain,
            T_s=model.T_s * lasts,
            n3_s2_rad2=model.n3_s2_rad2 * n3,
            reference_speed_m_s=shown,
        ),
        rudder=replace(
            rudder,
            rate_max_deg_s=None if rudder.rate_max_deg_s is None else rudder.rate_max_deg_s * rate,
            delay_s=rudder.delay_s + delay,
        ),
    )
    pace, damping = 0.8, 0.15
    # stationary deviation of the noise through 2 xi w0 sigma s/(s^2 + 2 xi w0 s + w0^2): sigma sqrt(xi w0 power)
    sea = SecondOrderSection(pace, damping, waves / math.sqrt(damping * pace * 0.1))
    # c V^2 sin(2 gamma) of a wind from 45 deg: its mean is as much rudder as the gusts about it, 2 V s = V^2
    wind = WindSection(speed_m_s=4.0, from_deg=45.0, gust_m_s=2.0, rudder_deg_per_m2_s2=gusts / 16.0, leeway=0.0)
    scenario = Scenario(
        schema_version=1,
        name=study.name,
        start=Start(speed_m_s=shown),
        hull=hull_of(vessel.length_m),
        gear=GearSection(play_deg=0.5 * backlash),
        waves=WavesSection(second_order=sea) if waves > 0.0 else WavesSection(),
        wind=wind if gusts > 0.0 else WindSection(),
    )
    return Prepared(
        scenario,
        plant_of(real, scenario),
        campaign_of(vessel, vessel.control.law),
        course_of(study),
        BoatState(heading=0.0, speed=shown, north_speed=shown, east_speed=0.0),
        vessel,
    )


def found_by(vessel: Vessel, seed: int, run: int, *, gyro: bool = True, is_compiled: bool = True) -> Found:
    """Return what becomes of a run."""
    ranges = ranges_of(vessel)
    drawn, turn = drawn_of(seed, run, ranges)
    study, until = study_of(vessel, turn, ranges[SPEED].at(drawn[SPEED]), gyro=gyro)
    shared, key = (
        prepared_for(vessel, study, ranges, drawn),
        int(np.random.SeedSequence((seed, run)).generate_state(1)[0]),
    )
    quick = compiled_loop(vessel.control.law) if is_compiled and shared.campaign is not None else None
    if quick is not None:
        announce(vessel.control.law)
        setting = setting_for(shared, study, key)
        score, is_whole = quick(setting, workspace_of(setting))
        if is_whole:
            sailed_so = figures(score, measured_every(study) * STEP, 1.0)
            if max(sailed_so.heading_most_deg, sailed_so.overshoot_deg) <= math.degrees(limit_of(vessel)):
                return Found(run, drawn, HELD, math.nan, math.nan, sailed_so.overshoot_deg)
    return watched(vessel, shared, study, (run, key, until), drawn)


def watched(vessel: Vessel, shared: Prepared, study: Study, numbers: tuple[int, int, float], drawn: Drawn) -> Found:
    """Return what becomes of a run in the full simulator. numbers: of the run, its seed, and until when it turns."""
    run, seed, until = numbers
    turn, goal, left, alarm, overshoot = math.radians(study.turn.degrees), 0.0, math.nan, math.nan, 0.0
    turned, before, strayed, off = 0.0, 0.0, math.nan, limit_of(vessel)
    for tick, world, _ in sailed(shared, study, seed):
        heading, now = world.boat.state.heading, world.time
        turned, before = turned + wrap(heading - before), heading
        if now >= COURSE_S and goal == 0.0:
            # a boat that had left the course before turns from wherever it is
            goal, strayed, left = turn, left, math.nan
        past = math.copysign(1.0, turn) * (turned - goal)
        overshoot = max(overshoot, past) if now >= COURSE_S else overshoot
        is_off = abs(turned - goal) > off if now < COURSE_S or now > until else past > off
        if math.isnan(left) and (is_off or (tick.mode is not Mode.ENGAGED and now > 1.0)):
            left = now
        if not tick.alarms:
            alarm = math.nan
        elif math.isnan(alarm):
            alarm = now
        if not (math.isnan(left) or math.isnan(alarm)):
            return Found(run, drawn, ALARMED, left, alarm, math.degrees(overshoot))
        if now > left + ALARM_S:
            return Found(run, drawn, UNSAID if is_off else BACK, left, alarm, math.degrees(overshoot))
    if math.isnan(left) and not math.isnan(strayed):
        return Found(run, drawn, BACK, strayed, alarm, math.degrees(overshoot))
    return Found(run, drawn, HELD, left, alarm, math.degrees(overshoot))


class Bound(NamedTuple):
    """Of a range the shares between which every run was held that lies within all bounds."""

    low: float
    high: float


def box_of(found: list[Found], count: int) -> tuple[list[Bound], int]:
    """Return the bounds of so many ranges, and how many runs lie within them."""
    lost = [each.drawn for each in found if each.outcome != HELD]
    least = min((max(map(abs, drawn)) for drawn in lost), default=1.0)
    low, high = [-least] * count, [least] * count

    def is_inside(drawn: Drawn, but: int) -> bool:
        return all(
            low[place] <= share <= high[place] for place, share in enumerate(drawn) if place != but
        )  # fmt: skip

    for place in range(count):
        others = [drawn[place] for drawn in lost if is_inside(drawn, place)]
        high[place] = min([share for share in others if share >= high[place] - 1.0e-12], default=1.0)
        low[place] = max([share for share in others if share <= low[place] + 1.0e-12], default=-1.0)
    inside = sum(is_inside(each.drawn, -1) for each in found if each.outcome == HELD)
    return [Bound(*each) for each in zip(low, high, strict=True)], inside


def check_vessel(vessel: Vessel) -> None:
    """RefusedError for a vessel whose gains must not be engaged."""
    if refusal := verdict_of(vessel, vessel.control.law).refusal:
        raise RefusedError(f"vessel {vessel.name!r}: {refusal}")
