"""The large-signal response of the loop: its motion against an integrator, and what is made of it, number by number."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import pytest
from scipy.integrate import solve_ivp

from autopilot.control import margins
from autopilot.control.law import LawInput
from autopilot.control.limits import RudderLimits
from autopilot.control.margins import Loop, Recovery, Trace, recoveries, trace
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import NavState, Reference

BOAT = Norrbin(0.3, 2.0, n3=2.0, reference_speed=4.0)
LIMITS = RudderLimits(0.5, math.inf)
LOOP = Loop(BOAT, SteeringGear(0.5, math.inf, 0.4), LIMITS, 0.25, 20.0)


class Ordered:
    """A law that orders what the test says at time [s] and heading error [rad], and keeps what it was shown."""

    def __init__(self, order: Callable[[float, NavState], float]) -> None:
        self.order = order
        self.shown: list[tuple[NavState, float, float]] = []
        self.resets: list[float] = []

    def first(self, rudder: float) -> int:
        self.resets.append(rudder)
        self.shown = []
        return 0

    def step(self, memory: int, given: LawInput) -> tuple[float, int]:
        assert given.model == BOAT and given.reference == Reference(0.0) and memory == len(self.shown)
        self.shown.append((given.state, given.last_rudder, given.dt))
        return self.order(given.state.time, given.state), memory + 1


def test_the_motion_is_that_of_the_boat_behind_its_lag_and_dead_time() -> None:
    """Rudder to one side at 1 s, to the other at 3 s; lag 0.4 s, dead time 0.25 s here and 0.1 s in the gear."""
    loop = LOOP._replace(gear=LOOP.gear._replace(delay=0.1))
    law = Ordered(lambda now, _: 0.2 if 1.0 - 1e-9 <= now < 3.0 - 1e-9 else -0.3 if now > 2.0 else 0.0)
    found = trace(loop, law, 0.7, 6.0)
    assert law.resets == [0.0]

    def motion(t: float, x: list[float]) -> list[float]:
        order = 0.0 if t < 1.35 else 0.2 if t < 3.35 else -0.3
        acceleration = (0.3 * x[2] - x[1] - 2.0 * x[1] ** 3) / 2.0
        return [x[1], acceleration, (order - x[2]) / 0.4]

    true = solve_ivp(motion, (0.0, 6.0), [0.7, 0.0, 0.0], t_eval=found.time, max_step=0.01, rtol=1e-8)
    assert len(found.time) == 120 and found.time[1] == 0.05
    assert found.error == pytest.approx(true.y[0], abs=1e-3)
    assert found.rudder == pytest.approx(true.y[2], abs=1e-2)
    assert max(found.rudder) > 0.19 and min(found.rudder) < -0.29
    state, _, dt = law.shown[60]
    assert dt == pytest.approx(0.05)
    assert (state.time, state.rate) == pytest.approx((3.0, true.y[1][60]), abs=1e-3)
    assert (state.heading, state.rudder) == (found.error[60], found.rudder[60])
    assert (state.speed, state.bias, state.heading_age) == (4.0, 0.0, 0.0)


def test_the_law_is_shown_what_the_limits_let_through() -> None:
    law = Ordered(lambda now, state: 2.0)
    trace(LOOP._replace(limits=RudderLimits(0.5, 0.4)), law, 0.1, 2.0)
    assert [last for _, last, _ in law.shown[:3]] == pytest.approx([0.0, 0.02, 0.04])
    assert law.shown[-1][1] == 0.5


def by_hand(error: float, times: list[float], errors: list[float]) -> tuple[float, float]:
    """How far it went past, and when it came within a twentieth for good."""
    within = max(0.05 * abs(error), math.radians(0.5))
    past = max(0.0, max((-e if error >= 0.0 else e) for e in errors))
    inside = itertools.takewhile(lambda each: abs(each[1]) <= within, zip(times[::-1], errors[::-1], strict=True))
    return past, min((t for t, _ in inside), default=math.inf)


@pytest.mark.parametrize("error", [-2.0, -0.3, 0.0, 0.01, 0.3, 2.0])
@pytest.mark.parametrize("damping", [1.0, 4.0])
def test_a_recovery_is_what_its_trace_shows(error: float, damping: float) -> None:
    def order(_: float, state: NavState) -> float:
        return -(2.0 * state.heading + damping * state.rate)

    found = recoveries(LOOP, Ordered(order), 0.5, [error])[0]
    motion = trace(LOOP, Ordered(order), error, 150.0)
    overshoot, settling = by_hand(error, motion.time, motion.error)
    assert (found.error, found.corrected) == (error, True)
    assert found.overshoot == pytest.approx(overshoot, abs=1e-12)
    assert found.settling == settling
    assert found.swing <= max(0.05 * abs(error), math.radians(0.5))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_what_does_not_come_back_is_not_corrected(side: float) -> None:
    idle = recoveries(LOOP, Ordered(lambda *_: 0.0), 0.5, [side * 0.4])
    assert idle == [Recovery(side * 0.4, False, 0.0, math.inf, 0.4)]


@pytest.mark.parametrize(
    ("late", "is_corrected"),
    [(0.79, True), (0.82, False)],
)
def test_the_last_fifth_of_the_time_has_to_lie_within(late: float, is_corrected: bool) -> None:
    """A boat put on its course at a share of the time: by a rudder that moves it, then stops it."""
    seconds = 50.0 + 2.0 * math.pi / (0.3 * 0.5)
    kick = Ordered(lambda now, _: 0.5 if late * seconds < now + 0.7 < late * seconds + 0.4 else 0.0)
    motion = trace(LOOP, kick, 0.02, seconds)
    outside = [t for t, e in zip(motion.time, motion.error, strict=True) if abs(e) > math.radians(0.5)]
    assert outside, "the kick is seen"
    end = Ordered(lambda now, _: 0.0)
    assert not recoveries(LOOP, end, 0.5, [0.02])[0].corrected
    assert recoveries(LOOP, end, 0.5, [0.008])[0].corrected, "within half a degree from the beginning"
    assert recoveries(LOOP, end, 0.5, [0.008])[0].settling == 0.0


class Counting(Ordered):
    """A law that asks for nothing."""

    def step(self, memory: int, given: LawInput) -> tuple[float, int]:
        """Take note of the state."""
        self.shown.append((given.state, given.last_rudder, given.dt))
        return 0.0, memory


@pytest.mark.parametrize(
    ("time_constant", "bandwidth", "own"),
    [
        (2.0, 0.5, 80.0),  # 25/0.5 = 50 s, 40 time constants are 80 s
        (1.0, 0.5, 50.0),  # 40 time constants are less than the loop's own
        (10.0, 0.5, 200.0),  # never more than four times its own
    ],
)
def test_recoveries_are_simulated_for_own_time_and_one_slow_wave(
    time_constant: float, bandwidth: float, own: float
) -> None:
    boat = BOAT._replace(time_constant=time_constant)
    law = Counting(lambda *_: 0.0)
    recoveries(LOOP._replace(model=boat, rate_hz=2.0), law, bandwidth, [0.1])
    assert len(law.shown) == round(2.0 * (own + 2.0 * math.pi / 0.15))


def test_a_loop_that_never_crosses_over_is_not_looked_at_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(margins, "MOST_TICKS", 300)
    law = Counting(lambda *_: 0.0)
    assert not recoveries(LOOP, law, 0.0, [0.1])[0].corrected
    assert len(law.shown) == 300


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("error", "errors", "wanted"),
    [
        (1.0, [1.0, 0.5, 0.1, *[0.04] * 7], (True, 0.0, 3.0, 0.04)),
        (1.0, [1.0, 0.5, -0.3, *[0.05] * 7], (True, 0.3, 3.0, 0.05)),
        (1.0, [*[1.0] * 7, 0.051, 0.05, -0.05], (True, 0.05, 8.0, 0.05)),
        (1.0, [*[1.0] * 8, 0.051, 0.01], (False, 0.0, math.inf, 0.051)),
        (1.0, [*[1.0] * 11, 0.06, 0.01, 0.0], (True, 0.0, 12.0, 0.01)),
        (1.0, [1.0, 0.5, 0.06, 0.01], (True, 0.0, 3.0, 0.01)),
        (1.0, [1.0, 0.5, 0.01, 0.06], (False, 0.0, math.inf, 0.06)),
        (0.1, [0.1, 0.0088, *[0.0087] * 8], (True, 0.0, 2.0, 0.0087)),
        (0.1, [0.0087] * 10, (True, 0.0, 0.0, 0.0087)),
    ],
)
def test_what_is_made_of_a_trace(
    monkeypatch: pytest.MonkeyPatch,
    side: float,
    error: float,
    errors: list[float],
    wanted: tuple[bool, float, float, float],
) -> None:
    """A twentieth, half a degree at least; it must lie within for the last fifth."""
    motion = Trace([float(n) for n in range(len(errors))], [side * each for each in errors], [])
    monkeypatch.setattr("autopilot.control.margins.trace", lambda *_: motion)
    assert recoveries(LOOP, Ordered(lambda *_: 0.0), 0.5, [side * error]) == [Recovery(side * error, *wanted)]
