"""The dead band of the order: a rudder that rests until it is wrong by more, and then goes all the way."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from autopilot.control.limits import Rest, RudderLimits, limit, limited
from autopilot.runtime.build import build_pilot
from autopilot.signals import HeadingSample, Order, OrderKind, Tick
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Limits, Vessel

LIMITS = RudderLimits(0.5, 0.3)
angles = st.floats(-0.5, 0.5)


@given(angles, st.floats(-2.0, 2.0), st.floats(0.0, 0.5), st.booleans())
def test_without_a_dead_band_the_limits_have_the_last_word(
    command: float, demand: float, dt: float, is_moving: bool
) -> None:
    within = limit(LIMITS, command, demand, dt)
    assert limited(LIMITS, 0.0, Rest(command, command, is_moving), (command, dt), demand).command == within


@given(angles, st.floats(-2.0, 2.0), st.floats(0.001, 0.2))
def test_a_rudder_at_rest_stays_within_the_band_and_leaves_it_for_its_goal(
    command: float, demand: float, band: float
) -> None:
    wanted = min(max(demand, -0.5), 0.5)
    rest = Rest(command, command, False)
    for _ in range(200):
        rest = limited(LIMITS, band, rest, (rest.command, 0.02), demand)
    assert rest.command == (command if abs(wanted - command) <= band else wanted)
    assert not rest.is_moving
    assert rest.allowed == wanted, "a law has nothing to unwind where only the dead band holds the rudder"


def test_the_edges_of_the_dead_band() -> None:
    assert Rest() == (0.0, 0.0, False)
    rest = Rest(0.25, 0.25, False)
    assert limited(LIMITS, 0.25, rest, (0.25, 1.0), 0.5) == (0.25, 0.5, False), "off by just the band is near enough"
    late = limited(LIMITS, 0.25, rest, (0.25, 0.5), -0.01)
    assert late == (0.25 - 0.15, 0.25 - 0.15, True)
    on_its_way = rest._replace(is_moving=True)
    assert limited(LIMITS, 0.25, on_its_way, (0.25, 1.0), 0.3) == (0.3, 0.3, False), "it goes all the way"
    at_once = limited(LIMITS, 0.0, rest, (0.2, 0.0), 0.25)
    assert at_once == (0.2, 0.25, False), "what the limits made, whatever was commanded"


def held(vessel: Vessel, order: Order) -> list[Tick]:
    """A minute on a compass that swings to and fro by 0.3 deg."""
    pilot = build_pilot(vessel)
    swing = math.radians(0.3)
    return [
        pilot.step(tick / 20.0, (HeadingSample(tick / 20.0, swing * math.sin(tick), 0.0),), order)
        for tick in range(1200)
    ]


def travel(ticks: list[Tick]) -> float:
    angles = [tick.command.angle for tick in ticks]
    return sum(abs(after - before) for before, after in itertools.pairwise(angles))


def test_a_dead_band_spares_the_rudder_on_a_course_and_no_ordered_angle() -> None:
    busy = load_vessel("lanxin")
    calm = replace(busy, limits=Limits(dead_band_deg=2.0))
    north = Order(OrderKind.HEADING, 0.0, serial=1)
    assert travel(held(busy, north)) > 0.1
    assert travel(held(calm, north)) < 0.5 * travel(held(busy, north))
    over = Order(OrderKind.RUDDER, rudder=math.radians(1.0), serial=1)
    assert held(calm, over)[-1].command.angle == math.radians(1.0)
