"""Manoeuvres of an independent simulator: found, rightly named and measured, with any rudder, sampling and boat.

The simulator has nothing of the project's: Norrbin's equation by Runge and Kutta, a rudder of limited rate, the speed
lost in the turn, yaw in waves, and noise on what is recorded. A boat of time constant T turns with K = 0.8/T.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from autopilot.identification.trial_measures import Measures, measures_of, record_of

DEG = math.pi / 180.0
CRUISE = 5.0


class Boat(NamedTuple):
    """T [s], rudder rate [deg/s], n1 (-1: course-unstable)."""

    T: float
    rudder_rate: float
    n1: float = 1.0

    @property
    def gain(self) -> float:
        """K [1/s]."""
        return 0.8 / self.T

    @property
    def n3(self) -> float:
        """n3 [s^2/rad^2] that takes a tenth off the rate at 20 deg; a strong one for an unstable boat."""
        return (0.1 if self.n1 > 0.0 else 12.0) / (self.gain * 20.0 * DEG) ** 2


class Sea(NamedTuple):
    """Noise of compass and rudder [deg], yaw in waves [deg rms] at their period [s]."""

    compass: float = 0.0
    rudder: float = 0.0
    yaw: float = 0.0
    period: float = 6.0


CALM, NOISY = Sea(), Sea(0.3, 0.2)


class Sailed(NamedTuple):
    """What is recorded, and the truth: times [s] of the executes, and time, heading, rudder, north, east, rate."""

    columns: dict[str, np.ndarray]
    executes: list[float]
    truth: np.ndarray


Helm = Callable[[float, float, float], float]
"""Ordered rudder [rad] at time, heading and yaw rate."""


def sail(boat: Boat, helm: Helm, seconds: float, hz: float, sea: Sea = CALM, seed: int = 1) -> Sailed:
    """Return what is recorded at `hz` of a boat under `helm`, which looks at the heading in every step."""
    steps_a_sample = max(1, math.ceil(1.0 / hz / min(boat.T / 20.0, 0.25)))
    dt = 1.0 / hz / steps_a_sample
    count = int(seconds * hz) * steps_a_sample
    T, K, n1, n3 = boat.T, boat.gain, boat.n1, boat.n3
    reach = boat.rudder_rate * DEG * dt

    def slope(x: np.ndarray, delta: float) -> np.ndarray:
        r, psi, u = x[0], x[1], x[2]
        lost = u * (1.0 + 0.5 * min((r * T) ** 2, 4.0))
        forward = (CRUISE - lost) / (2.0 * T)
        return np.array(((K * delta - n1 * r - n3 * r**3) / T, r, forward, u * math.cos(psi), u * math.sin(psi)))

    x = np.array((0.0, 1.0, CRUISE, 0.0, 0.0))
    delta, last_order = 0.0, 0.0
    executes: list[float] = []
    rows = np.empty((count, 8))
    for i in range(count):
        now = i * dt
        order = helm(now, x[1] - 1.0, x[0])
        if order != last_order:
            executes.append(now)
            last_order = order
        rows[i] = (now, x[1], delta, x[3], x[4], x[0], x[2], order)
        after = delta + min(max(order - delta, -reach), reach)
        middle = 0.5 * (delta + after)
        k1 = slope(x, delta)
        k2 = slope(x + 0.5 * dt * k1, middle)
        k3 = slope(x + 0.5 * dt * k2, middle)
        k4 = slope(x + dt * k3, after)
        x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        delta = after
    rng = np.random.default_rng(seed)
    seen = rows[::steps_a_sample]
    time = seen[:, 0]
    heading = seen[:, 1] + sea.compass * DEG * rng.normal(size=time.size)
    rate = seen[:, 5].copy()
    for _ in range(12 if sea.yaw else 0):
        w, phase = 2.0 * math.pi / sea.period * rng.normal(1.0, 0.15), rng.uniform(0.0, 2.0 * math.pi)
        size = sea.yaw * DEG * math.sqrt(2.0 / 12.0)
        heading = heading + size * np.sin(w * time + phase)
        rate = rate + size * w * np.cos(w * time + phase)
    columns = {
        "time_s": time,
        "heading_rad": np.angle(np.exp(1j * heading)),
        "rudder_rad": seen[:, 2] + sea.rudder * DEG * rng.normal(size=time.size),
        "speed_m_s": seen[:, 6],
        "latitude_rad": 0.9 + seen[:, 3] / 6371000.8,
        "longitude_rad": 0.1 + seen[:, 4] / 6371000.8 / math.cos(0.9),
    }
    return Sailed(columns, executes, rows)


def zigzag(angle: float, execute: float, begins: float, legs: int = 6) -> Helm:
    """Return the helm of a zigzag of so many executes, amidships after the last."""
    side, count = 1.0, 1

    def helm(now: float, swing: float, _: float) -> float:
        nonlocal side, count
        if now < begins:
            return 0.0
        if side * swing >= execute * DEG:
            side, count = -side, count + 1
        return side * angle * DEG if count <= legs else 0.0

    return helm


def turn(angle: float, begins: float, ends: float = math.inf) -> Helm:
    return lambda now, _, __: angle * DEG if begins <= now < ends else 0.0


def staircase(boat: Boat, begins: float) -> tuple[Helm, float]:
    """Return the helm of a spiral from 15 deg to starboard to port and back, and how long it takes [s]."""
    angles = (15.0, 10.0, 5.0, 2.0, 0.0, -2.0, -5.0, -10.0, -15.0, -10.0, -5.0, -2.0, 0.0, 2.0, 5.0, 10.0, 15.0)
    each = 6.0 * boat.T + 3.0 + 5.0 / boat.rudder_rate
    first = begins + 15.0 / boat.rudder_rate

    def helm(now: float, _: float, __: float) -> float:
        if now < begins:
            return 0.0
        return angles[min(int(max(now - first, 0.0) / each), len(angles) - 1)] * DEG

    return helm, first + each * len(angles)


def measured(sailed: Sailed) -> Measures:
    return measures_of(record_of("simulated", sailed.columns))


def at(sailed: Sailed, time: float) -> float:
    """Return the true heading [rad] at a time."""
    return float(np.interp(time, sailed.truth[:, 0], sailed.truth[:, 1]))


RATES, SAMPLINGS, BOATS = (1.0, 2.3, 5.0, 15.0, 60.0), (1.0, 5.0, 10.0, 50.0), (0.3, 1.5, 6.0, 25.0, 100.0)


def is_seen(T: float, hz: float) -> bool:
    """Return whether a log shows how the boat turns, and has no more than a few ten thousand samples of it."""
    return 1.0 / hz <= 0.7 * T and T * hz <= 1300.0


def seconds_of_zigzag(boat: Boat, angle: float) -> float:
    return 5.0 + 8.0 * (6.0 * boat.T + 2.0 * angle / boat.rudder_rate)


def zigzag_of(boat: Boat, angle: float, hz: float, sea: Sea, seed: int = 1) -> Sailed:
    begins = 5.0 + 3.0 / hz
    return sail(boat, zigzag(angle, angle, begins), seconds_of_zigzag(boat, angle), hz, sea, seed)


def check_zigzag(boat: Boat, angle: float, hz: float, sea: Sea, sailed: Sailed) -> None:
    found = measured(sailed)
    assert (len(found.zigzags), len(found.circles), found.spiral) == (1, 0, None)
    (one,) = found.zigzags
    executes, times = sailed.executes, sailed.truth[:, 0]
    sample = 1.0 / hz
    # a rudder angle is as sharp as its noise; a moment as the sample or as the noise over the rate of the rudder
    sharp = sample + 4.0 * sea.rudder / boat.rudder_rate * min(1.0, 1.0 / math.sqrt(hz)) + 0.01
    assert one.begins == pytest.approx(executes[0], abs=sharp)
    reached = np.abs(sailed.truth[:, 2]).max() / DEG
    assert one.rudder / DEG == pytest.approx(reached, abs=0.3 + 2.0 * sea.rudder)
    fastest = np.abs(sailed.truth[:, 5]).max() / DEG
    blur = 0.2 + fastest * sharp + 1.5 * sea.compass + 2.5 * sea.yaw
    assert one.execute / DEG == pytest.approx((at(sailed, executes[1]) - 1.0) / DEG, abs=blur)
    assert one.initial_time == pytest.approx(executes[1] - executes[0], abs=2.0 * sharp)
    assert len(one.overshoots) >= 4
    for number in range(4):
        begin, end = executes[number + 1], executes[number + 2]
        sign = 1.0 if number % 2 == 0 else -1.0
        part = (times >= begin) & (times <= end)
        peak = float(np.max(sign * (sailed.truth[part, 1] - at(sailed, begin)))) / DEG
        assert one.overshoots[number] / DEG == pytest.approx(peak, abs=blur), number
    assert one.period == pytest.approx(np.mean([executes[k + 2] - executes[k] for k in (1, 2, 3)]), abs=2.0 * sharp)


GRID = [(T, rate, hz) for T, rate, hz in itertools.product(BOATS, RATES, SAMPLINGS) if is_seen(T, hz)]


def check_circle(boat: Boat, hz: float, sea: Sea, side: float = 1.0) -> None:
    begins = 5.0 + 3.0 / hz
    seconds = begins + 35.0 / boat.rudder_rate + 30.0 * boat.T
    sailed = sail(boat, turn(side * 35.0, begins), seconds, hz, sea)
    found = measured(sailed)
    assert (len(found.zigzags), len(found.circles), found.spiral) == (0, 1, None)
    (one,) = found.circles
    sharp = 1.0 / hz + 4.0 * sea.rudder / boat.rudder_rate * min(1.0, 1.0 / math.sqrt(hz)) + 0.01
    assert one.begins == pytest.approx(sailed.executes[0], abs=sharp)
    assert one.rudder / DEG == pytest.approx(side * 35.0, abs=0.3 + sea.rudder)
    time, heading, _, north, east, rate, *_ = sailed.truth.T
    turned = side * (heading - 1.0)
    i0 = int(np.searchsorted(time, begins))
    n, e = north - north[i0], east - east[i0]
    ahead, abeam = n * math.cos(1.0) + e * math.sin(1.0), side * (e * math.cos(1.0) - n * math.sin(1.0))
    fastest = float(np.abs(rate).max())
    blur_s = 2.0 * sharp + (sea.compass + 2.5 * sea.yaw) * 2.0 * DEG / fastest
    for name, angle in (("time_90", 90.0), ("time_180", 180.0), ("time_360", 360.0)):
        truth = float(np.interp(angle * DEG, turned, time)) - begins
        assert getattr(one, name) == pytest.approx(truth, abs=blur_s), name
    blur_m = CRUISE * blur_s + 0.05
    assert one.advance == pytest.approx(float(np.interp(90.0 * DEG, turned, ahead)), abs=blur_m)
    assert one.transfer == pytest.approx(float(np.interp(90.0 * DEG, turned, abeam)), abs=blur_m)
    assert one.tactical_diameter == pytest.approx(float(np.interp(180.0 * DEG, turned, abeam)), abs=blur_m)
    assert one.rate == pytest.approx(float(rate[-1]), rel=0.06)


def check_pull_out(boat: Boat, hz: float, sea: Sea) -> None:
    begins = 5.0 + 3.0 / hz
    ends = begins + 20.0 / boat.rudder_rate + 12.0 * boat.T
    seconds = ends + 20.0 / boat.rudder_rate + 12.0 * boat.T
    sailed = sail(boat, turn(20.0, begins, ends), seconds, hz, sea)
    found = measured(sailed)
    assert (len(found.zigzags), len(found.pull_outs), found.spiral) == (0, 1, None)
    (one,) = found.pull_outs
    sharp = 1.0 / hz + 4.0 * sea.rudder / boat.rudder_rate * min(1.0, 1.0 / math.sqrt(hz)) + 0.01
    assert one.begins == pytest.approx(sailed.executes[1], abs=sharp)
    before = float(np.interp(ends, sailed.truth[:, 0], sailed.truth[:, 5]))
    assert one.turn_rate == pytest.approx(before, rel=0.1)
    assert abs(one.residual_rate - float(sailed.truth[-1, 5])) < 0.1 * before


def check_spiral(boat: Boat, hz: float, sea: Sea) -> None:
    begins = 5.0 + 3.0 / hz
    helm, seconds = staircase(boat, begins)
    sailed = sail(boat, helm, seconds, hz, sea)
    found = measured(sailed)
    assert found.zigzags == ()
    assert found.spiral is not None
    assert (len(found.spiral.down), len(found.spiral.up)) == (9, 9)
    sharp = 1.0 / hz + 4.0 * sea.rudder / boat.rudder_rate * min(1.0, 1.0 / math.sqrt(hz)) + 0.01
    assert found.spiral.begins == pytest.approx(begins, abs=sharp)
    largest = boat.gain * 15.0 * DEG
    # the slope of a line through a sinusoid a sin(w t) over a time L is 12 a / (w L^2) at most
    over = 0.3 * (6.0 * boat.T + 3.0)
    wavy = 12.0 * math.sqrt(2.0) * sea.yaw * DEG * sea.period / (2.0 * math.pi * over**2)
    for angle, rate in (*found.spiral.down, *found.spiral.up):
        roots = np.roots([boat.n3, 0.0, boat.n1, -boat.gain * angle])
        truth = roots[np.abs(roots.imag) < 1e-9].real
        nearest = float(truth[np.argmin(np.abs(truth - rate))])
        assert rate == pytest.approx(nearest, abs=0.08 * largest + wavy)


SEAS = {"calm": CALM, "noisy": NOISY, "waves": Sea(0.3, 0.3, 1.0)}


def sea_of(name: str, T: float, hz: float) -> Sea:
    """Return the sea; waves of 1.5 s for a toy and of 8 s for a ship, three samples long at least."""
    return SEAS[name]._replace(period=max(min(max(T, 1.5), 8.0), 3.0 / hz))


CASES = [(*one, list(SEAS)[number % 3]) for number, one in enumerate(GRID[::5])]
"""A fifth of the boats, rudders and samplings, the seas in turn."""


@pytest.mark.parametrize("angle", [10.0, 20.0])
@pytest.mark.parametrize(("T", "rate", "hz", "sea"), CASES)
def test_a_zigzag_is_found_with_any_rudder_and_sampling(
    angle: float, T: float, rate: float, hz: float, sea: str
) -> None:
    boat, there = Boat(T, rate), sea_of(sea, T, hz)
    check_zigzag(boat, angle, hz, there, zigzag_of(boat, angle, hz, there))


@pytest.mark.parametrize(("T", "rate", "hz", "sea"), CASES)
def test_a_circle_begins_where_the_rudder_began_to_move(T: float, rate: float, hz: float, sea: str) -> None:
    check_circle(Boat(T, rate), hz, sea_of(sea, T, hz), -1.0 if rate > 4.0 else 1.0)


@pytest.mark.parametrize(("T", "rate", "hz", "sea"), CASES)
def test_a_pull_out_is_found_with_any_rudder_and_sampling(T: float, rate: float, hz: float, sea: str) -> None:
    check_pull_out(Boat(T, rate), hz, sea_of(sea, T, hz))


@pytest.mark.parametrize(("T", "rate", "hz", "sea"), [one for one in CASES if one[0] * one[2] <= 150.0])
def test_a_spiral_is_found_with_all_its_angles(T: float, rate: float, hz: float, sea: str) -> None:
    check_spiral(Boat(T, rate), hz, sea_of(sea, T, hz))


@settings(max_examples=25, deadline=None)
@example(T=1.0, rate=1.0, hz=2.0, angle=26.75, execute=23.5, seed=44)
@example(T=0.9921875, rate=25.0, hz=1.0, angle=11.0, execute=7.0, seed=2)
@example(T=6.0986, rate=42.4348, hz=1.4326, angle=12.0253, execute=9.1126, seed=115)
@given(
    T=st.floats(0.5, 40.0),
    rate=st.floats(1.0, 60.0),
    hz=st.floats(1.0, 20.0),
    angle=st.floats(7.0, 35.0),
    execute=st.floats(7.0, 30.0),
    seed=st.integers(0, 1000),
)
def test_a_zigzag_of_any_angles_is_found(
    T: float, rate: float, hz: float, angle: float, execute: float, seed: int
) -> None:
    """Named by its angles, whatever they are; nothing else is found in it."""
    hz = max(hz, 2.0 / T)
    boat, begins = Boat(T, rate), 6.0 + 3.0 / hz
    seconds = begins + 8.0 * (2.5 * T * (execute / angle + 1.5) + 2.0 * angle / rate)
    sailed = sail(boat, zigzag(angle, execute, begins), seconds, hz, NOISY, seed)
    found = measured(sailed)
    assert (len(found.zigzags), found.spiral) == (1, None)
    (one,) = found.zigzags
    reached = np.abs(sailed.truth[:, 2]).max() / DEG
    assert one.rudder / DEG == pytest.approx(reached, abs=0.9)
    sharp = 1.0 / hz + 0.8 / rate
    assert one.begins == pytest.approx(sailed.executes[0], abs=sharp)
    fastest = np.abs(sailed.truth[:, 5]).max() / DEG
    assert one.execute / DEG == pytest.approx((at(sailed, sailed.executes[1]) - 1.0) / DEG, abs=1.2 + fastest * sharp)


@pytest.mark.parametrize("rate", [2.3, 15.0])
def test_a_course_held_in_waves_is_no_manoeuvre(rate: float) -> None:
    """The rudder goes to either side, and no heading goes first."""
    boat = Boat(6.0, rate)
    waves = math.radians(3.0)

    def helm(now: float, swing: float, turning: float) -> float:
        seen = swing + waves * math.sin(2.0 * math.pi * now / 7.0)
        return max(min(-1.5 * seen - 6.0 * turning, 20.0 * DEG), -20.0 * DEG)

    found = measured(sail(boat, helm, 300.0, 10.0, NOISY))
    assert (found.zigzags, found.circles, found.pull_outs, found.spiral) == ((), (), (), None)


def test_a_rudder_by_the_clock_is_no_zigzag() -> None:
    """A binary sequence knows no heading: what it swings through differs."""
    steps = np.sign(np.random.default_rng(5).normal(size=100))

    def helm(now: float, _: float, __: float) -> float:
        return float(10.0 * DEG * steps[int(now / 4.0)]) if now >= 5.0 else 0.0

    found = measured(sail(Boat(6.0, 15.0), helm, 300.0, 10.0, NOISY))
    assert all(len(one.overshoots) <= 3 for one in found.zigzags)
    assert found.spiral is None
    assert found.circles == ()


def test_a_stepped_turn_is_one_circle_at_its_last_angle() -> None:
    """A rudder that stops on its way is executed when it leaves the angle at which it stood."""
    boat = Boat(6.0, 5.0)

    def helm(now: float, _: float, __: float) -> float:
        return 0.0 if now < 10.0 else 20.0 * DEG if now < 20.0 else 35.0 * DEG

    (one,) = measured(sail(boat, helm, 200.0, 10.0, NOISY)).circles
    assert one.rudder / DEG == pytest.approx(35.0, abs=0.3)
    assert one.begins == pytest.approx(20.0, abs=0.2)
