"""Roll damping beside the heading law: it stays where it helps, goes where it does not, is silent without roll."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from boats import BOATS, vessel_of
from hypothesis import given
from hypothesis import strategies as st

from autopilot.control.roll_damping import (
    FADE,
    PERIOD,
    SETTLE,
    Phase,
    RollDamper,
    RollDamping,
    Tally,
    checked,
    damped,
    rolled,
)
from autopilot.runtime.build import build_pilot
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, RollSample, SpeedSample
from autopilot.vessel.schema import Roll

DT = 0.1
DAMPING = RollDamping(rate_gain=0.5, most=0.1, lowest=0.6)


class Damper:
    """A damper with its memory held."""

    def __init__(self, damping: RollDamping) -> None:
        self.damping, self.memory = checked(damping), RollDamper()

    @property
    def phase(self) -> Phase:
        return self.memory.phase

    @property
    def weight(self) -> float:
        return self.memory.weight

    def on_sample(self, sample: RollSample) -> None:
        self.memory = rolled(self.memory, sample)

    def update(self, now: float, dt: float, *, engaged: bool = True) -> float:
        self.memory, rudder = damped(self.damping, self.memory, now, dt, engaged=engaged)
        return rudder


class RollingBoat:
    """phi'' + 2 zeta w0 phi' + w0^2 phi = swell + force x rudder."""

    def __init__(self, swell: float, force: float, natural: float = 1.1) -> None:
        self.swell, self.force, self.natural = swell, force, natural
        self.roll = self.rate = self.time = 0.0

    def step(self, rudder: float) -> RollSample:
        for _ in range(10):
            h = DT / 10
            push = 0.02 * math.sin(self.swell * self.time) + self.force * rudder
            self.rate += h * (push - 0.2 * self.natural * self.rate - self.natural**2 * self.roll)
            self.roll += h * self.rate
            self.time += h
        return RollSample(self.time, self.roll, self.rate)


def sailed(boat: RollingBoat, seconds: float, damper: Damper) -> list[Phase]:
    phases, rudder = [], 0.0
    for _ in range(round(seconds / DT)):
        damper.on_sample(boat.step(rudder))
        rudder = damper.update(boat.time, DT)
        phases.append(damper.phase)
    return phases


NORTH = Order(OrderKind.HEADING, 0.0, serial=1)
LONG = 2.0 * (PERIOD + SETTLE) + 30.0


def test_roll_damping_is_tried_off_then_on_and_kept_where_it_helps() -> None:
    damper = Damper(DAMPING)
    phases = sailed(RollingBoat(1.1, 0.4), LONG, damper)
    assert list(dict.fromkeys(phases)) == [Phase.WITHOUT, Phase.WITH, Phase.KEPT_ON]
    assert damper.weight == pytest.approx(1.0)


def test_a_gain_of_the_wrong_sign_is_found_out() -> None:
    damper = Damper(DAMPING)
    phases = sailed(RollingBoat(1.1, -0.1), LONG, damper)
    assert phases[-1] is Phase.KEPT_OFF
    assert damper.weight == 0.0


def test_slow_roll_is_left_alone_without_a_try() -> None:
    phases = sailed(RollingBoat(0.4, 0.4), LONG, damper := Damper(DAMPING))
    assert Phase.WITH not in phases
    assert damper.weight == 0.0


def test_when_the_sea_turns_slow_it_lets_go() -> None:
    boat, damper = RollingBoat(1.1, 0.4), Damper(DAMPING)
    assert sailed(boat, LONG, damper)[-1] is Phase.KEPT_ON
    boat.swell = 0.4
    assert Phase.KEPT_ON not in sailed(boat, 2.0 * PERIOD + 20.0, damper)[-100:]


def test_without_fresh_roll_it_is_silent_at_once() -> None:
    boat, damper = RollingBoat(1.1, 0.4), Damper(DAMPING)
    sailed(boat, LONG, damper)
    assert damper.update(boat.time + 0.49, DT) != 0.0
    assert damper.update(boat.time + 0.51, DT) == 0.0
    assert damper.weight == 0.0 and damper.phase is Phase.WITHOUT


def test_roll_damping_fades_in_no_faster_than_its_fade_time() -> None:
    boat, damper = RollingBoat(1.1, 0.4), Damper(DAMPING)
    before = 0.0
    for _ in range(round(LONG / DT)):
        damper.on_sample(boat.step(before))
        damper.update(boat.time, DT)
        assert abs(damper.weight - before) <= DT / FADE + 1e-12
        before = damper.weight


@given(st.lists(st.tuples(st.floats(), st.one_of(st.none(), st.floats()), st.floats(0.0, 100.0)), max_size=60))
def test_never_more_rudder_than_the_file_says(samples: list[tuple[float, float | None, float]]) -> None:
    damper, now = Damper(DAMPING), 0.0
    for roll, rate, dt in samples:
        now += dt
        damper.on_sample(RollSample(now, roll, rate))
        assert abs(damper.update(now, dt)) <= DAMPING.most


@pytest.mark.parametrize("bad", [(math.nan, 0.1, 0.5), (0.5, 0.0, 0.5), (0.5, math.inf, 0.5), (0.5, 0.1, -1.0)])
def test_settings_are_numbers(bad: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="roll damping"):
        Damper(RollDamping(*bad))


def commands(roll: Roll | None, kind: OrderKind = OrderKind.HEADING) -> list[float]:
    """The whole pilot on a boat that lies dead on course and rolls."""
    vessel = vessel_of(BOATS["lanxin"])
    # nobody may take the boat for one whose compass is frozen
    alarms = replace(vessel.alarms, frozen_heading=False)
    pilot = build_pilot(replace(vessel, control=replace(vessel.control, roll=roll), alarms=alarms))
    commanded = []
    for index in range(round(150.0 / 0.1)):
        now = 0.1 * index
        rate = 0.05 * math.cos(1.1 * now)
        samples = (HeadingSample(now, 0.0, 0.0), RollSample(now, 0.05 / 1.1 * math.sin(1.1 * now), rate))
        commanded.append(pilot.step(now, samples, Order(kind, 0.0, 0.05, serial=1)).command.angle)
    return commanded


def test_the_pilot_moves_the_rudder_against_roll_only_where_the_file_says_so() -> None:
    assert max(map(abs, commands(None))) < 1e-9
    against = commands(Roll(0.5, 5.0, 0.6))
    assert max(map(abs, against[: round(PERIOD / 0.1)])) < 1e-9
    assert 0.5 * 0.05 * 0.8 < max(map(abs, against[round((PERIOD + SETTLE + FADE) / 0.1) :])) <= math.radians(5.0)


def test_without_steerage_the_rudder_waits_for_roll_too() -> None:
    vessel = vessel_of(BOATS["lanxin"])
    pilot = build_pilot(replace(vessel, control=replace(vessel.control, roll=Roll(0.5, 5.0, 0.6))))
    for index in range(round(150.0 / 0.1)):
        now = 0.1 * index
        roll = RollSample(now, 0.05 / 1.1 * math.sin(1.1 * now), 0.05 * math.cos(1.1 * now))
        samples = (HeadingSample(now, 0.0, 0.0), SpeedSample(now, 0.0), roll)
        tick = pilot.step(now, samples, Order(OrderKind.HEADING, 0.0, serial=1))
        assert tick.command.angle == 0.0


def test_trials_keep_the_rudder_they_order() -> None:
    assert commands(Roll(0.5, 5.0, 0.6), OrderKind.RUDDER)[-1] == pytest.approx(0.05)


def test_a_fail_safe_that_steers_ends_it_and_it_begins_anew_after() -> None:
    """Roll rudder that nobody gives any more must not be taken off the law's, nor come back at once."""
    vessel = vessel_of(BOATS["lanxin"])
    failsafe = replace(vessel.failsafe, action="dead_reckoning", release_after_s=60.0, resume=True)
    with_roll = replace(vessel.control, roll=Roll(0.5, 5.0, 0.6))
    pilot = build_pilot(replace(vessel, control=with_roll, failsafe=failsafe))
    demands: dict[Mode, list[float]] = {}
    lost = 2.0 * (PERIOD + SETTLE) + FADE
    for index in range(round((lost + 30.0) / 0.1)):
        now = 0.1 * index
        size = 0.1 if now < PERIOD + SETTLE else 0.06
        roll = RollSample(now, size / 1.1 * math.sin(1.1 * now), size * math.cos(1.1 * now))
        is_silent = lost <= now < lost + 7.3
        tick = pilot.step(now, (roll,) if is_silent else (HeadingSample(now, 0.0, 0.0), roll), NORTH)
        if now > lost + 2.0:
            demands.setdefault(tick.mode, []).append(tick.demand)
        elif now < lost:
            phase = pilot.state.control.damper.phase
    assert phase is Phase.KEPT_ON
    for mode in (Mode.FAILSAFE, Mode.ENGAGED):
        assert max(map(abs, demands[mode])) < math.radians(0.2)


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), min_size=1, max_size=50))
def test_the_tally_is_deviation_and_mean_frequency_of_what_was_measured(rolled: list[tuple[float, float]]) -> None:
    tally = Tally()
    for roll, rate in rolled:
        tally = tally.with_sample(roll, rate, 0.5)
    rolls, rates = ([each[n] for each in rolled] for n in (0, 1))
    assert tally.time == pytest.approx(0.5 * len(rolled))
    deviation = float(np.std(rolls))
    assert tally.deviation == pytest.approx(deviation, abs=1e-7)
    if deviation > 1e-3:
        assert tally.frequency == pytest.approx(math.sqrt(np.mean(np.square(rates))) / deviation, rel=1e-4)
    assert (Tally().deviation, Tally().frequency) == (0.0, 0.0)


class Rolled:
    """A damper in a roll of a given size and frequency, a tenth of a second a tick."""

    def __init__(self, least: float = 0.1, lowest: float = 0.5) -> None:
        self.damper = Damper(RollDamping(2.0, 0.1, lowest, least))
        self.now = 0.0

    def on(self, seconds: float, size: float, frequency: float = 1.0) -> list[Phase]:
        phases = []
        for _ in range(round(seconds / 0.1)):
            self.now += 0.1
            phase = frequency * self.now
            self.damper.on_sample(RollSample(self.now, size * math.sin(phase), size * frequency * math.cos(phase)))
            self.damper.update(self.now, 0.1)
            phases.append(self.damper.phase)
        return phases


def test_a_minute_without_and_a_minute_with_are_measured_each_after_ten_seconds() -> None:
    rolled = Rolled()
    phases = rolled.on(145.0, 0.1)
    changes = [(n, phase) for n, (before, phase) in enumerate(pairwise(phases), 1) if phase is not before]
    assert [phase for _, phase in changes] == [Phase.WITH, Phase.KEPT_OFF], "as much roll with as without is no help"
    assert [n for n, _ in changes] == pytest.approx([700, 1400], abs=4)


@pytest.mark.parametrize(("share", "phase"), [(0.88, Phase.KEPT_ON), (0.92, Phase.KEPT_OFF), (1.5, Phase.KEPT_OFF)])
def test_it_stays_where_the_roll_is_less_by_the_share_that_the_file_asks_for(share: float, phase: Phase) -> None:
    rolled = Rolled(least=0.1)
    rolled.on(70.5, 0.1)
    assert rolled.on(70.5, 0.1 * share)[-1] is phase


@pytest.mark.parametrize(("frequency", "phase"), [(0.45, Phase.KEPT_OFF), (0.55, Phase.WITH)])
def test_a_roll_slower_than_the_lowest_frequency_is_not_even_tried(frequency: float, phase: Phase) -> None:
    assert Rolled(lowest=0.5).on(70.5, 0.1, frequency)[-1] is phase


@pytest.mark.parametrize(("grown", "phase"), [(1.15, Phase.KEPT_ON), (1.35, Phase.WITHOUT)])
def test_a_roll_grown_by_a_quarter_over_that_without_is_measured_anew_within_a_minute(
    grown: float, phase: Phase
) -> None:
    rolled = Rolled()
    rolled.on(71.0, 0.1)
    assert rolled.on(71.0, 0.05)[-1] is Phase.KEPT_ON
    assert rolled.on(130.0, 0.1 * grown)[-1] is phase


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_decision_stands_for_ten_minutes(share: float) -> None:
    rolled = Rolled()
    rolled.on(71.0, 0.1)
    kept = rolled.on(71.0, 0.1 * share)[-1]
    assert kept in (Phase.KEPT_ON, Phase.KEPT_OFF)
    later = rolled.on(720.0, 0.1 * share)
    assert len([phase for phase in later if phase is kept]) == pytest.approx(6500, abs=620)
    assert set(later[:5900]) == {kept} and Phase.WITHOUT in later


def test_the_roll_weight_ramps_in_five_seconds_and_drops_without_the_helm() -> None:
    rolled = Rolled()
    rolled.on(69.8, 0.1)
    weights = []
    for _ in range(80):
        rolled.on(0.1, 0.1)
        weights.append(rolled.damper.weight)
    steps = [after - before for before, after in pairwise(weights) if 0.0 < after < 1.0 and before > 0.0]
    assert steps == pytest.approx([0.02] * len(steps)) and len(steps) > 40 and weights[-1] == 1.0
    rolled.damper.on_sample(RollSample(rolled.now, 0.0, 0.01))
    assert rolled.damper.update(rolled.now, 0.0) == pytest.approx(-0.02), "k p against the roll's rate"
    rolled.damper.on_sample(RollSample(rolled.now, 0.0, -1.0))
    assert rolled.damper.update(rolled.now, 0.0) == pytest.approx(0.1), "and no more than the file says"
    assert rolled.damper.update(rolled.now + 0.5, 0.0) != 0.0
    assert rolled.damper.update(rolled.now, 0.1, engaged=False) == rolled.damper.weight == 0.0
    assert rolled.damper.phase is Phase.WITHOUT
