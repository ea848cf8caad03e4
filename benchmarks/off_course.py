"""The off-course alarm of a shipped boat in sea state 5: false alarms, and departures missed, printed as a table.

    python benchmarks/off_course.py [--hours 1000] [--departures 1000] [--kept hours.jsonl]
    python benchmarks/off_course.py --compare 10

The whole closed loop (boat, sea, sensors, filter, law, limits) is `sitl.campaign`'s, compiled; the alarm is the
monitor's own step with the limits of the vessel file. Waves and wind come from five sides in turn. A false alarm is one
in a run without a fault. In a departure the steering gear jams at a random moment and angle, and the boat goes where
that takes it; it has departed when its true heading has been further off than the limit for the alarm's own time. It
is missed where no alarm has come half that time later. Exit code 1 at a false or a missed alarm.

`--kept` names a file with a line for each hour that is done, and a run that was cut goes on from there. `--compare`
makes so many short runs by the compiled loop and by the plain one, and prints how far they are apart.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from autopilot.angles import shortest_turn, wrap
from autopilot.control.registry import own_step
from autopilot.estimation.fusion import Measured, Moment, seen_at
from autopilot.runtime.build import alarm_limits_of
from autopilot.supervision.course_watch import ON_HEADING, course_step
from autopilot.supervision.monitor_input import AlarmLimits
from autopilot.vessel.file import load_vessel
from sitl.boat import boat_step
from sitl.campaign.compiled_run import CALM, Setting, Workspace, measurement_of, ordered, readings
from sitl.campaign.compiled_tick import Measurement, initial_state, tick
from sitl.campaign.setting import setting_of, workspace_of
from sitl.campaign.study import BoatSection, Job, SeaSection, Study, number_of_runs
from sitl.compiled import compiled
from sitl.scenario import HullSection, IttcSection, WavesSection, WindSection
from sitl.sea import WaterState, water_step

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


def watched_run(setting: Setting, workspace: Workspace, limits: AlarmLimits, jams_at: float, jam: float) -> Seen:
    """Run as `sitl.campaign.compiled_run.run_compiled` does, watched; from `jams_at` [s] on the rudder stays at `jam`
    [rad]."""
    instruments, course, dt = setting.instruments, setting.course, setting.dt
    state = setting.start
    water, acting, felt_dt = WaterState(setting.swell, 0.0, 0.0, 0), CALM, dt * setting.water_every
    lag = math.ceil(instruments.noise.latency / dt - 1.0e-7)
    taken, order, command = 0, 0.0, 0.0
    heading, rate, speed = readings(instruments, 0, state)
    workspace.readings[0, 0], workspace.readings[0, 1], workspace.readings[0, 2] = heading, rate, speed
    measurement = Measurement(Measured(0.0, wrap(heading), rate), speed)
    pilot_state = initial_state(setting.campaign, setting.filtered, lag * dt, measurement, workspace.rudder)
    away, away_since = ON_HEADING, math.nan
    alarms, first, departed, worst = 0, math.inf, math.inf, 0.0
    for step in range(setting.steps):
        now = step * dt
        if step >= lag and (step - lag) % instruments.every == 0:
            measurement = measurement_of(instruments, workspace, (step - lag) // instruments.every, dt)
            target = ordered(course, now)
            pilot_state = tick(setting.campaign, pilot_state, workspace.rudder, now, measurement, target)
            command = pilot_state.command
            if now >= SETTLED_S:
                past = (workspace.rudder.times, workspace.rudder.angles, pilot_state.rudder.ticks)
                at = Moment(now, pilot_state.speed.value, pilot_state.heading_time)
                seen = seen_at(
                    pilot_state.model, setting.campaign.config.estimator.noises, pilot_state.fusion, past, at
                )
                was_off = away.is_off
                error = shortest_turn(target, seen.heading)
                away = course_step(limits, pilot_state.model.time_constant, away, now, error)
                if away.is_off and not was_off:
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
        workspace.orders[step % len(workspace.orders)] = command
        while taken <= step and taken * dt + setting.plant.gear.delay <= now:
            order = workspace.orders[taken % len(workspace.orders)]
            taken += 1
        if step % setting.water_every == 0:
            water, acting = water_step(
                setting.water, workspace.surface, water, step // setting.water_every, felt_dt, state
            )
        steered = jam if now >= jams_at else order
        state = boat_step(setting.plant, setting.step, state, steered, setting.thrust_speed, acting)
        if (step + 1) % instruments.every == 0:
            reading = (step + 1) // instruments.every
            heading, rate, speed = readings(instruments, reading, state)
            place = reading % len(workspace.readings)
            workspace.readings[place, 0], workspace.readings[place, 1], workspace.readings[place, 2] = (
                heading,
                rate,
                speed,
            )
    return Seen(alarms, first, departed, worst, pilot_state.gone)


def study_of(boat: str, runs: int, seconds: float, seed: int) -> Job:
    """Return the study: one boat in sea state 5 from every side, `runs` times."""
    sides = SIDES_DEG
    boats = {boat: BoatSection(boat, HullSection())}
    made = Study(
        1, "off course", boats, seed=seed, runs=runs, seconds=seconds, seas={"state 5": STATE_5}, sides_deg=sides
    )
    return Job(made, ".")


def main() -> int:
    """Run all and print; 1 where an alarm was false, or missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--boat", default="lanxin")
    parser.add_argument("--hours", type=int, default=1000)
    parser.add_argument("--departures", type=int, default=1000)
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--compare", type=int, default=0)
    arguments = parser.parse_args()
    limits, run = (
        alarm_limits_of(load_vessel(arguments.boat)),
        compiled(watched_run, quick=True, instead=own_step("backstepping")),
    )
    if arguments.compare:
        return compared(arguments.boat, arguments.compare, limits, run)
    print("| boat | simulated | alarms | largest error, deg | remarks |\n|---|---|---|---|---|")
    wrong = departures(arguments.boat, arguments.departures, limits, run) if arguments.departures else 0
    wrong += quiet(arguments.boat, arguments.hours, limits, run, arguments.kept)
    return 1 if wrong else 0


def quiet(boat: str, hours: int, limits: AlarmLimits, run: Callable[..., Seen], kept: Path | None) -> int:
    """Print the line of the runs without a fault, an hour each; return the number of alarms."""
    job = study_of(boat, max(1, hours // len(SIDES_DEG)), 3600.0, 1)
    lines = kept.read_text().splitlines() if kept is not None and kept.exists() else []
    done = {each["run"]: each for each in map(json.loads, lines)}
    runs = job.study.runs
    # every side in turn, so that a run that is cut has seen them all; the seed says which sea
    for seed, side in ((seed, side) for seed in range(runs) for side in range(len(SIDES_DEG))):
        name = f"{boat} {SIDES_DEG[side]:g} deg, sea {seed}"
        if name in done:
            continue
        began, setting = time.process_time(), setting_of(job, side * runs + seed)
        assert setting is not None
        seen = run(setting, workspace_of(setting), limits, NEVER, 0.0)
        spent = time.process_time() - began
        done[name] = {"run": name, "alarms": seen.alarms, "worst": seen.worst, "gone": seen.gone, "seconds": spent}
        if kept is not None:
            with kept.open("a") as file:
                print(json.dumps(done[name]), file=file)
    sailed = [each for name, each in done.items() if name.startswith(f"{boat} ")]
    alarms, worst = sum(each["alarms"] for each in sailed), math.degrees(max(each["worst"] for each in sailed))
    gone, spent = sum(each["gone"] for each in sailed), sum(each["seconds"] for each in sailed)
    print(
        f"| {boat} | {len(sailed)} h without a fault | {alarms} false | {worst:.1f} | "
        f"{gone} runs where another monitor would have looked; {spent:.0f} s of one core |",
        flush=True,
    )
    return int(alarms)


def compared(boat: str, count: int, limits: AlarmLimits, run: Callable[..., Seen]) -> int:
    """Print how far the compiled loop is from the plain one in short runs, half of them with a jammed rudder."""
    job, apart = study_of(boat, max(1, count // len(SIDES_DEG)), 120.0, 1), 0.0
    for number in range(number_of_runs(job)):
        jams_at = 70.0 if number % 2 else NEVER
        setting, again = setting_of(job, number), setting_of(job, number)
        assert setting is not None
        assert again is not None
        compiled_loop = run(setting, workspace_of(setting), limits, jams_at, 0.3)
        plain = watched_run(again, workspace_of(again), limits, jams_at, 0.3)
        same = (compiled_loop.alarms, compiled_loop.first, compiled_loop.departed, compiled_loop.gone)
        assert same == (plain.alarms, plain.first, plain.departed, plain.gone), f"run {number}: {compiled_loop} {plain}"
        apart = max(apart, abs(compiled_loop.worst - plain.worst))
    print(
        f"{number_of_runs(job)} runs of 120 s: the same alarms at the same ticks, largest error {apart:.1e} rad apart"
    )
    return 0


def departures(boat: str, count: int, limits: AlarmLimits, run: Callable[..., Seen]) -> int:
    """Print the line of the departures, four minutes each; return how many were missed."""
    random, began = np.random.default_rng(20261121), time.monotonic()
    job = study_of(boat, max(1, 2 * count // len(SIDES_DEG)), 240.0, 1_000_001)
    made, missed, worst, delays, before = 0, 0, 0.0, [], 0
    for number in range(number_of_runs(job)):
        if made == count:
            break
        jams_at, jam = random.uniform(90.0, 150.0), math.radians(random.uniform(-30.0, 30.0))
        setting = setting_of(job, number)
        assert setting is not None
        seen = run(setting, workspace_of(setting), limits, jams_at, jam)
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
    return missed


if __name__ == "__main__":
    sys.exit(main())
