"""Features two by two: every pair of choices and of troubles meets in some run of a generated plan.

What a file may choose (law, roll damping, wave filter, fail-safe), what instruments bring, how late it comes, and two
troubles one after the other. The plan holds every pair of levels of every two factors in as few runs as a greedy search
finds. Every run must keep the limits, hand the rudder over as the file says, come back on course without an alarm left,
and replay to the same commands.
"""

from __future__ import annotations

import itertools
import math
import os
import random
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from alarm_texts import words_of
from plant import Plant

from autopilot.angles import wrap
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot, gear_of, law_of, limits_of, model_of, pilot_config
from autopilot.signals import (
    HeadingSample,
    HelmSample,
    Mode,
    Order,
    OrderKind,
    RateSample,
    RollSample,
    RudderSample,
    Sample,
    SpeedSample,
    Tick,
)
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Roll, Vessel

SEED = os.environ.get("NORRBIN_PLAN_SEED", "1")
FACTORS: dict[str, tuple[str, ...]] = {
    "law": ("backstepping", "pid", "sliding"),
    "roll": ("no roll", "roll shown", "roll damped"),
    "waves": ("auto", "meet", "off"),
    "gyro": ("with the heading", "none", "apart"),
    "speed": ("none", "water", "ground"),
    "rudder": ("unknown", "measured", "ordered"),
    "failsafe": ("release", "amidships", "hold", "dead_reckoning"),
    "timing": ("regular", "jittered", "late"),
    "first": ("heading lost", "helm taken", "parameters", "standby", "no ticks", "nothing"),
    "second": ("heading lost", "helm taken", "parameters", "standby", "no ticks", "nothing"),
}
Row = dict[str, str]

DT = 0.05
COURSE = math.radians(45.0)
TROUBLES = {"first": (25.0, 31.0), "second": (33.0, 39.0)}
"""When the troubles begin and end; the second comes two seconds after the first, while its traces are fresh."""
ENGAGES_AGAIN, JUDGED, END = 41.0, 60.0, 65.0
HOLE_S = 0.8
LATE_S = 0.25
OFF_COURSE = math.radians(3.0)


def plan(seed: str) -> list[Row]:
    """Return rows that hold every pair of levels: each the best of some by the pairs that it adds."""
    chance = random.Random(seed)
    names = list(FACTORS)
    missing = {((a, x), (b, y)) for a, b in itertools.combinations(names, 2) for x in FACTORS[a] for y in FACTORS[b]}
    rows = []
    while missing:
        best, gained = {}, set()
        # each candidate holds one pair that is missing, so that every row adds something
        for pair in chance.sample(sorted(missing), min(40, len(missing))):
            row = {name: chance.choice(levels) for name, levels in FACTORS.items()} | dict(pair)
            added = missing & pairs_of(row)
            if len(added) > len(gained):
                best, gained = row, added
        rows.append(best)
        missing -= gained
    return rows


def pairs_of(row: Row) -> set[tuple[tuple[str, str], tuple[str, str]]]:
    return set(itertools.combinations([(name, row[name]) for name in FACTORS], 2))


def vessel_of(row: Row) -> Vessel:
    boat = load_vessel("lanxin")
    roll = Roll(rate_gain_s=0.15, rudder_max_deg=3.0) if row["roll"] == "roll damped" else None
    return replace(
        boat,
        control=replace(boat.control, law=row["law"], roll=roll),  # type: ignore[arg-type]
        estimator=replace(boat.estimator, wave_filter=row["waves"]),  # type: ignore[arg-type]
        failsafe=replace(boat.failsafe, action=row["failsafe"], release_after_s=4.0),  # type: ignore[arg-type]
    )


@dataclass
class Sailed:
    """A run: its ticks, the true headings, and what was changed before which tick."""

    ticks: list[Tick] = field(default_factory=list)
    headings: list[float] = field(default_factory=list)
    changes: dict[int, Vessel] = field(default_factory=dict)


def trouble(row: Row, now: float) -> str:
    return next((row[name] for name, (begins, ends) in TROUBLES.items() if begins <= now < ends), "nothing")


def order_at(row: Row, now: float) -> Order:
    """45 deg throughout; standing by where that is the trouble, and ordered anew after each trouble."""
    serial = 1 + sum(now >= ends for _, ends in TROUBLES.values()) + (now >= ENGAGES_AGAIN)
    if trouble(row, now) == "standby":
        return Order(OrderKind.STANDBY, serial=10 + serial)
    return Order(OrderKind.HEADING, COURSE, serial=serial)


def sensed(row: Row, plant: Plant, roll: tuple[float, float], command: float) -> list[Sample]:
    """What the instruments bring, measured now."""
    now, samples = plant.time, list(plant.sense())
    what = trouble(row, now)
    if row["gyro"] != "with the heading":
        rates = [
            RateSample(each.time, each.rate, "gyro")
            for each in samples
            if isinstance(each, HeadingSample) and each.rate is not None
        ]
        samples = [each._replace(rate=None) for each in samples if isinstance(each, HeadingSample)]
        samples += rates if row["gyro"] == "apart" else []
    if what == "heading lost":
        samples = [each for each in samples if not isinstance(each, HeadingSample)]
    if row["speed"] != "none":
        samples.append(SpeedSample(now, 4.63, row["speed"] == "ground", "log"))
    if row["rudder"] != "unknown":
        is_order = row["rudder"] == "ordered"
        samples.append(RudderSample(now, command if is_order else plant.rudder, is_order, "sensor"))
    if row["roll"] != "no roll":
        samples.append(RollSample(now, *roll, "gyro"))
    samples.append(HelmSample(now, what != "helm taken", "the skipper has the helm" * (what == "helm taken"), "helm"))
    return samples


def sail(row: Row) -> Sailed:
    vessel, chance = vessel_of(row), random.Random(str(row))
    noise = math.radians(0.1)
    plant = Plant(model_of(vessel), gear_of(vessel), heading_noise=noise, rate_noise=noise)
    pilot, run = build_pilot(vessel), Sailed()
    roll, roll_rate, angle = 0.0, 0.0, 0.0
    waiting: list[tuple[float, Sample]] = []
    silent_until = -1.0
    while plant.time < END:
        now = plant.time
        late = LATE_S if row["timing"] == "late" else 0.0
        waiting += [(now + late, sample) for sample in sensed(row, plant, (roll, roll_rate), angle)]
        what = trouble(row, now)
        if what == "parameters" and trouble(row, now - DT) != what:
            softer = vessel_of(row)
            gains = softer.control.backstepping
            assert gains is not None
            vessel = replace(softer, control=replace(softer.control, backstepping=replace(gains, k1_1_s=1.6)))
            pilot.reconfigure(pilot_config(vessel), law_of(vessel, row["law"]))
            run.changes[len(run.ticks)] = vessel
        if what == "no ticks" and trouble(row, now - DT) != what:
            silent_until = now + HOLE_S
        skips = now < silent_until or (row["timing"] == "jittered" and chance.random() < 0.2)
        if not skips:
            arrived = tuple(sample for at, sample in waiting if at <= now)
            waiting = [(at, sample) for at, sample in waiting if at > now]
            tick = pilot.step(now, arrived, order_at(row, now))
            run.ticks.append(tick)
            run.headings.append(plant.heading)
            angle = tick.command.angle if tick.command.engaged else 0.0
        plant.step(angle, DT)
        roll_rate += DT * (0.02 * math.sin(1.1 * now) + 0.1 * angle - 0.2 * roll_rate - 1.2 * roll)
        roll += DT * roll_rate
    return run


def check_limits(vessel: Vessel, run: Sailed) -> None:
    limits = limits_of(vessel)
    for before, tick in itertools.pairwise(run.ticks):
        command = tick.command
        known = tick.state[:6] if tick.state.valid else ()
        assert all(math.isfinite(value) for value in (command.angle, tick.demand, *known)), tick.now
        assert abs(command.angle) <= limits.angle_max + 1e-9, tick.now
        if command.engaged and before.command.engaged:
            moved = abs(command.angle - before.command.angle)
            assert moved <= limits.rate_max * (tick.now - before.now) + 1e-9, tick.now


def check_hands(vessel: Vessel, row: Row, run: Sailed) -> None:
    """Nobody's rudder is moved while standing by or overridden, and the fail-safe does what the file says."""
    for tick in run.ticks:
        if tick.mode in (Mode.STANDBY, Mode.OVERRIDE, Mode.FAULT):
            assert not tick.command.engaged, (tick.now, tick.mode)
        if tick.mode is Mode.FAILSAFE and row["failsafe"] == "release":
            assert not tick.command.engaged, tick.now
    for name, (begins, ends) in TROUBLES.items():
        # the heading is a second old before it is lost; the boat was engaged anew only after the first trouble
        during = [tick for tick in run.ticks if begins + 2.0 <= tick.now < ends]
        expected = {"helm taken": {Mode.OVERRIDE}, "standby": {Mode.STANDBY}, "heading lost": {Mode.FAILSAFE}}
        if row[name] in expected:
            assert {tick.mode for tick in during} <= expected[row[name]], (name, {tick.mode for tick in during})


def check_course(run: Sailed) -> None:
    """On course before the troubles and after them, with no alarm that asks for anything."""
    for begins, ends in ((15.0, TROUBLES["first"][0]), (JUDGED, END)):
        part = [
            (tick, heading) for tick, heading in zip(run.ticks, run.headings, strict=True) if begins <= tick.now < ends
        ]
        assert {tick.mode for tick, _ in part} == {Mode.ENGAGED}, begins
        assert max(abs(wrap(heading - COURSE)) for _, heading in part) < OFF_COURSE, begins
        assert {alarm for tick, _ in part for alarm in words_of(tick)} == set(), begins


def check_replay(row: Row, run: Sailed) -> None:
    pilot: Pilot = build_pilot(vessel_of(row))
    for number, tick in enumerate(run.ticks):
        if number in run.changes:
            changed = run.changes[number]
            pilot.reconfigure(pilot_config(changed), law_of(changed, row["law"]))
        again: Any = pilot.step(tick.now, tick.samples, tick.order)
        assert again.command == tick.command, tick.now


PLAN = plan(SEED)


def test_the_plan_holds_every_pair() -> None:
    held = set().union(*map(pairs_of, PLAN))
    wanted = sum(len(FACTORS[a]) * len(FACTORS[b]) for a, b in itertools.combinations(FACTORS, 2))
    assert len(held) == wanted
    assert len(PLAN) < 80


@pytest.mark.parametrize("row", PLAN, ids=lambda row: ", ".join(row.values()))
def test_a_run_with_a_pair_of_features(row: Row) -> None:
    run = sail(row)
    check_limits(vessel_of(row), run)
    check_hands(vessel_of(row), row, run)
    check_course(run)
    check_replay(row, run)
