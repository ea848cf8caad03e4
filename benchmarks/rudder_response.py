"""The watch over a rudder without a sensor: false alarms by the hour, and how soon a stuck or reversed one is seen.

    python benchmarks/rudder_response.py [--hours 20] [--faults 60]

The closed loop is `sitl.campaign`'s, compiled, and so is the watch, `autopilot.supervision.rudder_response` itself. The
courses are held for a minute each, and then changed by 10 to 60 deg. The sea is that of `off_course.py`, from five
sides; K of the real boat is the model's, 30 % less, and 40 % more. `evidence` is how much likelier, as a natural
logarithm, the watch ever held it that the boat does not answer, in both its seas together: 14 and more is an alarm, 11
and more in a turn, where each of both is enough, too.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from off_course import SIDES_DEG, STATE_5

from autopilot.angles import shortest_turn, wrap
from autopilot.control.registry import own_step
from autopilot.estimation.fusion import Measured
from autopilot.supervision.rudder_answer import by_blocks, by_headings, verdict_at
from sitl.boat import boat_step
from sitl.campaign.compiled_run import CALM, Setting, Workspace, measurement_of, readings
from sitl.campaign.compiled_tick import Measurement, initial_state, tick
from sitl.campaign.setting import setting_of, workspace_of
from sitl.campaign.study import BoatSection, Job, MismatchSection, SeaSection, Study, number_of_runs
from sitl.compiled import compiled
from sitl.scenario import HullSection, SecondOrderSection, WavesSection
from sitl.sea import WaterState, water_step

HELD_S = 60.0
TURNS_DEG = (0.0, 30.0, 20.0, 80.0, 70.0, 30.0, -30.0, -20.0)
"""The courses, one a minute."""
SETTLED_S = 60.0
WORKS, STUCK, REVERSED, TRAILS = 0, 1, 2, 3
FAULTS = {"stuck": STUCK, "reversed": REVERSED, "trailing amidships": TRAILS}
BOATS = {
    "as modelled": MismatchSection(),
    "K 30 % less": MismatchSection(K=0.7),
    "K 40 % more": MismatchSection(K=1.4),
}
SEAS = {
    "sea state 5": STATE_5,
    "the fault matrix's": SeaSection(
        WavesSection(second_order=SecondOrderSection(frequency_rad_s=1.0, damping=0.1, sigma_deg=30.0))
    ),
    "calm": SeaSection(),
}


class Seen(NamedTuple):
    """Alarms before the fault; the most evidence; of the fault: when it was seen [s], how far off [rad] the boat was
    then, which alarm, and when the order first was 5 deg from where the rudder is [s]."""

    alarms: int
    evidence: float
    seen: float
    off: float
    is_reversed: bool
    moved: float


def watched_run(setting: Setting, workspace: Workspace, fault: int, begins: float, courses: np.ndarray) -> Seen:
    """Run as `sitl.campaign.compiled_run.run_compiled` does, watched; the steering gear fails at `begins` [s]."""
    instruments, dt = setting.instruments, setting.dt
    state = setting.start
    water, acting, felt_dt = WaterState(setting.swell, 0.0, 0.0, 0), CALM, dt * setting.water_every
    lag = math.ceil(instruments.noise.latency / dt - 1.0e-7)
    taken, order, command = 0, 0.0, 0.0
    heading, rate, speed = readings(instruments, 0, state)
    workspace.readings[0, 0], workspace.readings[0, 1], workspace.readings[0, 2] = heading, rate, speed
    measurement = Measurement(Measured(0.0, wrap(heading), rate), speed)
    pilot_state = initial_state(setting.campaign, setting.filtered, lag * dt, measurement, workspace.rudder)
    alarms, most, seen, off, is_reversed, moved = 0, 0.0, math.inf, 0.0, False, math.inf
    held, before = math.nan, 0
    for step in range(setting.steps):
        now = step * dt
        if step >= lag and (step - lag) % instruments.every == 0:
            measurement = measurement_of(instruments, workspace, (step - lag) // instruments.every, dt)
            target = courses[min(int(now / HELD_S), len(courses) - 1)]
            pilot_state = tick(setting.campaign, pilot_state, workspace.rudder, now, measurement, target)
            command = pilot_state.command
            response = pilot_state.answer.response
            found = verdict_at(pilot_state.answer, now, now >= pilot_state.guide.turning_until)
            if now < begins:
                (stuck, wrong), (stuck_too, wrong_too) = by_headings(response), by_blocks(response)
                most = max(most, stuck + stuck_too, wrong + wrong_too)
            if found != 0 and now >= begins:
                return Seen(alarms, most, now - begins, abs(shortest_turn(target, state.heading)), found < 0, moved)
            alarms += found != 0 and before == 0
            before = found
        workspace.orders[step % len(workspace.orders)] = command
        while taken <= step and taken * dt + setting.plant.gear.delay <= now:
            order = workspace.orders[taken % len(workspace.orders)]
            taken += 1
        if step % setting.water_every == 0:
            water, acting = water_step(
                setting.water, workspace.surface, water, step // setting.water_every, felt_dt, state
            )
        steered = order
        if now >= begins and fault != WORKS:
            held = state.rudder if math.isnan(held) else held
            steered = faulty(fault, order, held)
            moved = now - begins if moved == math.inf and abs(command - held) > math.radians(5.0) else moved
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
    return Seen(alarms, most, seen, off, is_reversed, moved)


def faulty(fault: int, order: float, held: float) -> float:
    """Return where the gear goes [rad] that is stuck at `held`, works the wrong way, or lets the rudder trail."""
    if fault == STUCK:
        return held
    return -order if fault == REVERSED else 0.0


def job_of(boat: str, sea: str, mismatch: str, runs: int, seconds: float, seed: int) -> Job:
    """Return the runs of one boat in one sea."""
    sides = SIDES_DEG if sea == "sea state 5" else SIDES_DEG[:1]
    made = Study(
        1,
        "answers",
        {boat: BoatSection(boat, HullSection())},
        seed=seed,
        runs=runs,
        seconds=seconds,
        heading_hz=20,
        seas={sea: SEAS[sea]},
        sides_deg=sides,
        mismatches={mismatch: BOATS[mismatch]},
    )
    return Job(made, ".")


def asked(job: Job, number: int) -> Setting:
    """Return the setting of a run with the monitor asked: a campaign asks nothing of a boat that is its file's."""
    setting = setting_of(job, number)
    assert setting is not None
    alarms = setting.campaign.alarms._replace(rudder_response=True)
    return setting._replace(campaign=setting.campaign._replace(alarms=alarms))


def quiet(boat: str, sea: str, mismatch: str, hours: float, run: Callable[..., Seen]) -> None:
    """Print the line of runs without a fault, half an hour each."""
    sides = 5 if sea == "sea state 5" else 1
    job = job_of(boat, sea, mismatch, max(1, round(2 * hours / sides)), 1800.0, 1)
    courses = np.radians(np.tile(TURNS_DEG, 10))
    seen = []
    for number in range(number_of_runs(job)):
        setting = asked(job, number)
        seen.append(run(setting, workspace_of(setting), WORKS, math.inf, courses))
    alarms, most = sum(each.alarms for each in seen), max(each.evidence for each in seen)
    print(
        f"| {boat}, {mismatch} | {sea} | {0.5 * len(seen):g} h | {alarms} | {most:.1f} |",
        flush=True,
    )


def faults(boat: str, sea: str, mismatch: str, name: str, count: int, run: Callable[..., Seen]) -> None:
    """Print the line of runs with a fault: when it was seen, and how far off the boat was."""
    random = np.random.default_rng(20261121)
    sides = 5 if sea == "sea state 5" else 1
    job = job_of(boat, sea, mismatch, max(1, count // sides), 130.0, 500_001)
    for turn in (0.0, 30.0):
        times, off, named, late = [], [], 0, []
        for number in range(number_of_runs(job)):
            setting = asked(job, number)
            # in the turn it fails while the rudder is at work
            begins = random.uniform(70.0, 90.0) if turn == 0.0 else HELD_S + random.uniform(0.5, 2.0)
            courses = np.radians(np.array([0.0, turn, turn]))
            seen = run(setting, workspace_of(setting), FAULTS[name], begins, courses)
            if math.isinf(seen.seen):
                continue
            times.append(seen.seen)
            late.append(seen.seen - min(seen.moved, seen.seen))
            off.append(math.degrees(seen.off))
            named += seen.is_reversed == (name == "reversed")
        state = "course held" if turn == 0.0 else "in a turn of 30 deg"
        runs = number_of_runs(job)
        if not times:
            print(f"| {name} | {state} | {sea} | 0 of {runs} | | | | |", flush=True)
            continue
        print(
            f"| {name} | {state} | {sea} | {len(times)} of {runs} | {np.median(times):.1f} | {np.max(times):.1f} | "
            f"{np.max(late):.1f} | {'' if turn else f'{np.median(off):.0f} to {np.max(off):.0f}'} | {named} |",
            flush=True,
        )


def main() -> int:
    """Run all and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--boat", default="lanxin")
    parser.add_argument("--hours", type=float, default=20.0, help="simulated hours of each line without a fault")
    parser.add_argument("--faults", type=int, default=60, help="runs of each line with a fault")
    arguments = parser.parse_args()
    run = compiled(watched_run, quick=True, instead=own_step("backstepping"))
    print("| boat | sea | simulated | alarms | most evidence |\n|---|---|---|---|---|")
    for sea in SEAS:
        for mismatch in BOATS:
            if arguments.hours:
                quiet(arguments.boat, sea, mismatch, arguments.hours, run)
    print("\n| rudder | state | sea | seen | median, s | latest, s | after 5 deg, s | off, deg | named so |")
    print("|---|---|---|---|---|---|---|---|---|")
    for sea in SEAS:
        for name in FAULTS:
            if arguments.faults:
                faults(arguments.boat, sea, "as modelled", name, arguments.faults, run)
    return 0


if __name__ == "__main__":
    sys.exit(main())
