"""The off-course alarm of a shipped boat in sea state 5: false alarms, and departures missed, printed as a table.

    python benchmarks/off_course.py [--hours 1000] [--departures 1000]

The whole closed loop (boat, sea, sensors, filter, law, limits) is `sitl.campaign`'s, compiled; the alarm is the
monitor's own step with the limits of the vessel file. Waves and wind come from five sides in turn. A false alarm is one
in a run without a fault. In a departure the steering gear jams at a random moment and angle, and the boat goes where
that takes her; she has departed when her true heading has been further off than the limit for the alarm's own time. It
is missed where no alarm has come half that time later.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from autopilot.angles import shortest_turn, wrap
from autopilot.build import alarm_limits_of
from autopilot.estimation.fusion import mean_at
from autopilot.estimation.rudder_track import RudderPast
from autopilot.monitors import AlarmLimits
from autopilot.monitors.course import course_step
from autopilot.params.vessel_file import load_vessel
from sitl.boat import boat_step
from sitl.campaign.brain import first_mind, tick
from sitl.campaign.cases import Job, number_of_runs
from sitl.campaign.score import ordered
from sitl.campaign.setting import rooms_of, setting_of
from sitl.campaign.study import BoatSection, SeaSection, Study
from sitl.campaign.swift import CALM, Rooms, Setting, heard_of, readings
from sitl.campaign.waters import WaterState, water_step
from sitl.compiled import compiled
from sitl.scenario import HullSection, IttcSection, WavesSection, WindSection

STATE_5 = SeaSection(
    # WMO-No. 306, code table 3700, middle of the range; peak period and wind of the open ocean, Bales 1982
    WavesSection(ittc=IttcSection(significant_height_m=3.25, peak_period_s=9.7)),
    WindSection(speed_m_s=12.0, gust_m_s=1.5, rudder_deg_per_m2_s2=0.02),
)
SIDES_DEG = (20.0, 45.0, 70.0, 110.0, 135.0)
"""Off the bow; exactly ahead, abeam or astern a long-crested sea does not yaw a boat."""
SETTLED_S = 60.0
"""What is earlier is not watched: the pilot learns the sea and the wind."""
NEVER = math.inf


class Seen(NamedTuple):
    """Of one run: alarms that began, when the first did [s], when the true heading had departed [s], the largest true
    error [rad], and whether the compiled loop met what only the full simulator does."""

    alarms: int
    first: float
    departed: float
    worst: float
    gone: bool


def watched_run(setting: Setting, rooms: Rooms, limits: AlarmLimits, jams_at: float, jam: float) -> Seen:
    """Run as `sitl.campaign.swift.run_swiftly` does, watched; from `jams_at` [s] on the rudder stays at `jam` [rad]."""
    instruments, course, dt = setting.instruments, setting.course, setting.dt
    state = setting.start
    water, acting, felt_dt = WaterState(setting.swell, 0.0, 0.0, 0), CALM, dt * setting.water_every
    lag = math.ceil(instruments.latency / dt - 1.0e-7)
    taken, order, told = 0, 0.0, 0.0
    heading, rate, speed = readings(instruments, 0, state)
    rooms.readings[0, 0], rooms.readings[0, 1], rooms.readings[0, 2] = heading, rate, speed
    mind = first_mind(setting.brain, setting.filtered, lag * dt, wrap(heading), speed, rooms.past)
    since, is_off, away_since = math.nan, False, math.nan
    alarms, first, departed, worst = 0, math.inf, math.inf, 0.0
    for step in range(setting.steps):
        now = step * dt
        if step >= lag and (step - lag) % instruments.every == 0:
            heard = heard_of(instruments, rooms, (step - lag) // instruments.every, dt)
            target = ordered(course, now)
            mind = tick(setting.brain, mind, rooms.past, now, heard, target)
            told = mind.told
            if now >= SETTLED_S:
                past = RudderPast(rooms.past.times, rooms.past.angles, mind.ticks)
                seen = mean_at(mind.model, setting.brain.noises, mind.fusion, past, now)
                was_off = is_off
                error = shortest_turn(target, wrap(seen[0] + seen[2]))
                since, is_off = course_step(limits, since, is_off, now, error)
                if is_off and not was_off:
                    alarms += 1
                    first = min(first, now)
                true = abs(shortest_turn(target, state.heading))
                worst = max(worst, true)
                if true <= limits.off_course:
                    away_since = math.nan
                elif math.isnan(away_since):
                    away_since = now
                elif now - away_since >= limits.off_course_time:
                    departed = min(departed, now)
        rooms.orders[step % len(rooms.orders)] = told
        while taken <= step and taken * dt + setting.plant.gear.delay <= now:
            order = rooms.orders[taken % len(rooms.orders)]
            taken += 1
        if step % setting.water_every == 0:
            water, acting = water_step(setting.water, rooms.surface, water, step // setting.water_every, felt_dt, state)
        steered = jam if now >= jams_at else order
        state = boat_step(setting.plant, setting.shares, state, steered, setting.thrust_speed, acting, dt)
        if (step + 1) % instruments.every == 0:
            reading = (step + 1) // instruments.every
            heading, rate, speed = readings(instruments, reading, state)
            place = reading % len(rooms.readings)
            rooms.readings[place, 0], rooms.readings[place, 1], rooms.readings[place, 2] = heading, rate, speed
    return Seen(alarms, first, departed, worst, mind.gone)


def study_of(boat: str, runs: int, seconds: float, seed: int) -> Job:
    """Return the study: one boat in sea state 5 from every side, `runs` times."""
    sides = SIDES_DEG
    boats = {boat: BoatSection(boat, HullSection())}
    made = Study(
        1, "off course", boats, seed=seed, runs=runs, seconds=seconds, seas={"state 5": STATE_5}, sides_deg=sides
    )
    return Job(made, ".")


def main() -> None:
    """Run all and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--boat", default="lanxin")
    parser.add_argument("--hours", type=int, default=1000)
    parser.add_argument("--departures", type=int, default=1000)
    arguments = parser.parse_args()
    limits, run = alarm_limits_of(load_vessel(arguments.boat)), compiled(watched_run, quick=True)
    print("| boat | simulated | alarms | largest error, deg | remarks |\n|---|---|---|---|---|")
    departures(arguments.boat, arguments.departures, limits, run)
    quiet(arguments.boat, arguments.hours, limits, run)


def quiet(boat: str, hours: int, limits: AlarmLimits, run: Callable[..., Seen]) -> None:
    """Print the line of the runs without a fault: an hour each."""
    began = time.monotonic()
    job = study_of(boat, max(1, hours // len(SIDES_DEG)), 3600.0, 1)
    alarms, worst, gone = 0, 0.0, 0
    for number in range(number_of_runs(job)):
        setting = setting_of(job, number)
        assert setting is not None
        seen = run(setting, rooms_of(setting), limits, NEVER, 0.0)
        alarms, worst, gone = alarms + seen.alarms, max(worst, seen.worst), gone + seen.gone
        if number % 10 == 9:
            print(
                f"{number + 1} h: {alarms} alarms, {math.degrees(worst):.1f} deg, {gone}", file=sys.stderr, flush=True
            )
    took = time.monotonic() - began
    print(
        f"| {boat} | {number_of_runs(job)} h without a fault | {alarms} false | {math.degrees(worst):.1f} | "
        f"{gone} runs where another monitor would have looked; {took:.0f} s |",
        flush=True,
    )


def departures(boat: str, count: int, limits: AlarmLimits, run: Callable[..., Seen]) -> None:
    """Print the line of the departures: four minutes each."""
    random, began = np.random.default_rng(20261121), time.monotonic()
    job = study_of(boat, max(1, 2 * count // len(SIDES_DEG)), 240.0, 1_000_001)
    made, missed, worst, delays, before = 0, 0, 0.0, [], 0
    for number in range(number_of_runs(job)):
        if made == count:
            break
        jams_at, jam = random.uniform(90.0, 150.0), math.radians(random.uniform(-30.0, 30.0))
        setting = setting_of(job, number)
        assert setting is not None
        seen = run(setting, rooms_of(setting), limits, jams_at, jam)
        if math.isinf(seen.departed) or seen.departed > 230.0:
            continue
        made, worst = made + 1, max(worst, seen.worst)
        if made % 100 == 0:
            print(f"{made} departures, {missed} missed", file=sys.stderr, flush=True)
        before += seen.first < jams_at
        if seen.first > seen.departed + 0.5 * limits.off_course_time:
            missed += 1
        else:
            delays.append(seen.first - seen.departed)
    late = f"alarm {min(delays):+.1f} to {max(delays):+.1f} s after the departure" if delays else "no alarm at all"
    print(
        f"| {boat} | {made} departures | {missed} missed | {math.degrees(worst):.1f} | {late}, "
        f"{before} before the jam; {time.monotonic() - began:.0f} s |"
    )


if __name__ == "__main__":
    main()
