"""The loop in waves: what the rudder is spared, what the heading pays, and that the filter is gone when the sea is."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
import pytest
from plant import Plant, sail

from autopilot.angles import wrap
from autopilot.control.backstepping import Backstepping, lqr_gains
from autopilot.control.pid import Pid, equivalent_pid
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import Order, OrderKind, Tick
from autopilot.vessel.schema import Control, Estimator, Model, Rudder, Sensors, Vessel

LANXIN = Vessel(
    2,
    "lanxin",
    Model(0.701, 0.332, 4.63, 1.0, 3.2828),
    Rudder(30.0, 20.0, 0.1, 0.05),
    sensors=Sensors(0.3, 0.0, 0.2),
    control=Control(backstepping=Backstepping(2.0, 2.0, 1.0)),
)
"""A quick boat: its loop has a natural frequency of 2.2 rad/s."""
SHIP = Vessel(
    2,
    "ship",
    Model(0.1, 20.0, 5.0, 1.0, 50.0),
    Rudder(30.0, 2.5, 0.1, 0.05),
    sensors=Sensors(0.3, 0.0, 0.2),
    control=Control(backstepping=Backstepping(0.13, 0.13, 0.0043)),
)
"""A slow one: 0.15 rad/s."""
STEP = 0.05


def sea(w0: float, deviation_deg: float, begins: float = 0.0, ends: float = math.inf) -> Callable[[float], float]:
    """Return waves about w0 as an equivalent rudder: sines with frequencies and phases drawn once."""
    random = np.random.default_rng(11)
    band = np.linspace(0.75, 1.25, 25) * w0 + random.uniform(-0.01, 0.01, 25) * w0
    weight = np.exp(-0.5 * ((band / w0 - 1.0) / 0.12) ** 2)
    size = math.radians(deviation_deg) * weight / math.sqrt(0.5 * float(np.sum(weight * weight)))
    phase = random.uniform(0.0, 2.0 * math.pi, 25)
    times = STEP * np.arange(round(450.0 / STEP))
    values = (np.cos(np.outer(times, band) + phase) @ size).tolist()
    return lambda time: values[int(time / STEP)] if begins <= time < ends else 0.0


class Result(NamedTuple):
    rms_deg: float
    travel_deg_s: float


def run(
    vessel: Vessel,
    disturbance: Callable[[float], float],
    seconds: float,
    course: Order | Callable[[float], Order] | None = None,
    gain_factor: float = 1.0,
) -> tuple[list[Tick], Plant, list[float]]:
    model = model_of(vessel)
    box = Plant(model._replace(gain=gain_factor * model.gain), gear_of(vessel), disturbance=disturbance)
    box.heading_noise, box.rate_noise = math.radians(0.3), math.radians(0.2)
    headings: list[float] = []
    order = course or Order(OrderKind.HEADING, 0.0, serial=1)

    def watched(now: float) -> Order:
        headings.append(box.heading)
        return order if isinstance(order, Order) else order(now)

    return sail(build_pilot(vessel), box, watched, seconds, STEP, sense_every=2), box, headings


def judged(ticks: list[Tick], headings: list[float], since: float) -> Result:
    """Rms of the boat's whole heading, waves and all, and rudder travel."""
    late = [tick for tick in ticks if tick.now >= since]
    true = headings[-len(late) :]
    travel = sum(abs(b.command.angle - a.command.angle) for a, b in itertools.pairwise(late))
    return Result(
        math.degrees(math.sqrt(sum(h * h for h in true) / len(true))),
        math.degrees(travel) / (late[-1].now - late[0].now),
    )


def without_filter(vessel: Vessel) -> Vessel:
    return dataclasses.replace(vessel, estimator=Estimator(wave_filter="off"))


@pytest.mark.parametrize(("vessel", "w0", "deviation_deg"), [(LANXIN, 2.2, 4.0), (SHIP, 0.9, 60.0)])
def test_waves_that_the_boat_cannot_hold_do_not_wear_the_rudder(
    vessel: Vessel, w0: float, deviation_deg: float
) -> None:
    waves = sea(w0, deviation_deg)
    ticks, _, headings = run(vessel, waves, 240.0)
    filtered = judged(ticks, headings, 60.0)
    ticks, _, headings = run(without_filter(vessel), waves, 240.0)
    plain = judged(ticks, headings, 60.0)
    assert filtered.travel_deg_s < 0.5 * plain.travel_deg_s
    assert filtered.rms_deg < 1.1 * plain.rms_deg


def test_a_quick_boat_still_steers_against_a_slow_swell() -> None:
    waves = sea(0.45, 4.0)
    ticks, _, headings = run(LANXIN, waves, 200.0)
    filtered = judged(ticks, headings, 60.0)
    ticks, _, headings = run(without_filter(LANXIN), waves, 200.0)
    plain = judged(ticks, headings, 60.0)
    assert filtered.rms_deg < 1.3 * plain.rms_deg
    assert filtered.travel_deg_s < plain.travel_deg_s


def that_meets(vessel: Vessel, law: Literal["backstepping", "pid"] = "backstepping") -> Vessel:
    """The boat with gains that weigh the rudder's rate, to which waves are states, or with the PID of the same loop,
    which is shown slow waves alone."""
    model = model_of(vessel)
    gains = lqr_gains(model, 1.720482486564647 if vessel is LANXIN else 0.16060473464261749)
    control = Control(law=law, backstepping=Backstepping(*gains), pid=Pid(*equivalent_pid(model, gains, 10.0)))
    return dataclasses.replace(vessel, control=control)


@pytest.mark.parametrize("gain_factor", [1.0, 0.7, 1.4])
def test_a_slow_swell_that_is_met_hardly_moves_a_quick_boat(gain_factor: float) -> None:
    waves = sea(0.6, 3.0)
    results = []
    for vessel in (that_meets(LANXIN), that_meets(LANXIN, "pid")):
        ticks, _, headings = run(vessel, waves, 120.0, gain_factor=gain_factor)
        results.append(judged(ticks, headings, 50.0))
    assert results[0].rms_deg < 0.6 * results[1].rms_deg


def test_waves_too_quick_and_too_strong_for_a_ship_are_left_alone_even_so() -> None:
    ticks, _, headings = run(that_meets(SHIP), sea(0.9, 60.0), 150.0)
    met = judged(ticks, headings, 60.0)
    ticks, _, headings = run(that_meets(SHIP, "pid"), sea(0.9, 60.0), 150.0)
    left = judged(ticks, headings, 60.0)
    assert met.travel_deg_s < 1.1 * left.travel_deg_s
    assert met.rms_deg < 1.1 * left.rms_deg


def test_meeting_waves_costs_next_to_nothing_in_calm_water() -> None:
    results = []
    for vessel in (that_meets(LANXIN), dataclasses.replace(that_meets(LANXIN), estimator=Estimator())):
        ticks, _, headings = run(vessel, lambda _: 0.0, 200.0)
        results.append(judged(ticks, headings, 140.0))
    assert results[0].travel_deg_s < results[1].travel_deg_s + 0.2
    assert results[0].rms_deg < 0.1


def test_taking_the_helm_in_waves_that_are_met_makes_no_bump() -> None:
    vessel, waves = that_meets(LANXIN), sea(0.6, 3.0)
    standby = Order(OrderKind.STANDBY, serial=1)

    def helm(now: float) -> Order:
        return standby if now < 60.0 else Order(OrderKind.HEADING, math.nan, serial=2)

    ticks, _, _ = run(vessel, waves, 62.0, helm)
    first = next(index for index, tick in enumerate(ticks) if tick.command.engaged)
    angles = [math.degrees(tick.command.angle) for tick in ticks[first : first + 20]]
    assert abs(angles[0] - math.degrees(ticks[first - 1].state.rudder)) < 0.5
    assert max(abs(b - a) for a, b in itertools.pairwise(angles)) < 0.6


@pytest.mark.parametrize(("vessel", "w0", "deviation_deg"), [(LANXIN, 2.2, 4.0), (SHIP, 0.9, 60.0)])
def test_a_rising_sea_is_noticed_and_a_dying_one_forgotten(vessel: Vessel, w0: float, deviation_deg: float) -> None:
    ticks, _, headings = run(vessel, sea(w0, deviation_deg, 100.0, 260.0), 420.0)
    in_waves = [tick.state for tick in ticks if 160.0 < tick.now < 260.0]
    wave = [tick.state.wave_heading for tick in ticks if 160.0 < tick.now < 260.0]
    assert np.mean([state.wave_deviation for state in in_waves]) == pytest.approx(np.std(wave), rel=0.3)
    assert np.mean([state.wave_frequency for state in in_waves]) == pytest.approx(w0, rel=0.3)
    calm = ticks[-1].state
    assert math.degrees(calm.wave_deviation) < 0.35
    assert abs(math.degrees(calm.wave_heading)) < 0.1
    travel = judged(ticks[:-1], headings[:-1], 160.0)
    assert travel.travel_deg_s < 2.0


@pytest.mark.parametrize("gain_factor", [1.0, 0.7])
def test_after_a_sea_a_turn_in_calm_water_is_as_good_as_ever(gain_factor: float) -> None:
    waves = sea(2.2, 4.0, 5.0, 60.0)
    box = Plant(model_of(LANXIN)._replace(gain=0.701 * gain_factor), gear_of(LANXIN), disturbance=waves)
    goal = math.radians(90.0)

    def course(now: float) -> Order:
        return Order(OrderKind.HEADING, 0.0 if now < 70.0 else goal, serial=1)

    ticks = sail(build_pilot(LANXIN), box, course, 130.0, STEP)
    over = max(wrap(tick.state.heading - goal) for tick in ticks if tick.now > 75.0)
    assert math.degrees(over) < (1.0 if gain_factor == 1.0 else 3.0)


def test_a_push_beyond_any_wave_is_answered() -> None:
    """A gust worth 12 deg of rudder for 20 s, in a sea: the bow comes back, and what is taken for sea stays bounded."""
    waves = sea(0.9, 60.0)
    push = math.radians(12.0)
    ticks, _, headings = run(SHIP, lambda t: waves(t) + (push if 150.0 < t < 170.0 else 0.0), 320.0)
    before = next(tick.state.wave_deviation for tick in ticks if tick.now > 149.0)
    worst = max(abs(math.degrees(h)) for h in headings[round(150 / STEP) : round(220 / STEP)])
    assert worst > 5.0, "the push must be one"
    late = headings[round(260 / STEP) :]
    assert math.degrees(abs(float(np.mean(late)))) < 1.0
    assert max(tick.state.wave_deviation for tick in ticks if tick.now > 150.0) < 4.0 * before
